"""Paths of a report: which become entries, which join other entries, and the warnings.

Anybody may have written the documents: the page shows every part that it can read.
"""

import json
import shutil
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal.commands.report import gathered
from mapdeal.commands.report_entries import Draft, Grids, columns_of
from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.pipeline.settings import DEFAULT_SETTINGS
from mapdeal.report.document import Item, Table
from pipeline import reported
from pipeline.reported import changed, document, entries_of, layer_names, report_of, rooms_grid

ROOM = grid_from_text("#####\n#...#\n#####")
EXAMPLES = Path(__file__).parents[2] / "examples"
STAGES = ["inflated", "esdf", "cost"]


def test_a_run_has_a_layer_for_each_stage_and_all_that_its_manifest_lists(run):
    (entry,) = entries_of(run)
    assert (entry.name, layer_names(entry), entry.warnings) == ("rooms", STAGES, ())
    inflated, field, _ = entry.layers
    assert (inflated.title, field.title) == ("Inflated by 0.25 m (disc)", "Signed distance field")
    assert (field.states, field.convention, field.unit) == ("inflated", "fast-planner", "m")
    tables = {table.title: dict(table.rows) for table in entry.tables}
    manifest = document(run / "manifest.json")
    assert tables["inflate: parameters"]["radius"] == "0.25"
    assert tables["Files written, and their SHA-256"] == manifest["outputs"]
    assert tables["Files read, and their SHA-256"] == manifest["inputs"]
    assert (entry.figures["cells"], entry.figures["m per cell"]) == ("20 x 8", 0.25)
    # the curve of the costs stays whatever comes behind them
    changed(run / "manifest.json", lambda file: file["stages"].append(file["stages"].pop(0)))
    assert entry.curve.inflation_radius == entries_of(run)[0].curve.inflation_radius == 0.8


def test_the_map_that_a_run_was_made_of_joins_it_in_whatever_order(run, rooms, tmp_path):
    (tmp_path / "bare.yaml").write_text("stages:\n- esdf: {}\n")
    bare = mapdeal.run(rooms, tmp_path / "bare", tmp_path / "bare.yaml").folder
    for paths in ((rooms, run), (run, rooms)):
        (entry,) = entries_of(*paths)
        assert layer_names(entry) == ["input", *STAGES]
    for paths in ((rooms, bare), (bare, rooms)):
        (entry,) = entries_of(*paths)
        assert layer_names(entry) == ["input", "esdf"]
        assert entry.layers[1].states == "input"


def test_grids_join_what_covers_the_same_cells_and_maps_do_not(rooms, tmp_path):
    near, far, again = (tmp_path / name for name in ("near.npz", "far.npz", "again.yaml"))
    mapdeal.write_map(far, mapdeal.esdf(ROOM))
    mapdeal.write_map(near, mapdeal.esdf(rooms_grid()))
    mapdeal.write_map(again, rooms_grid())
    joined, alone = entries_of(rooms, near, far)
    assert layer_names(joined) == ["rooms", "near"]  # its map is that of the entry
    assert joined.layers[1].states == "rooms"
    assert layer_names(alone) == ["far-map", "far"]
    assert [layer_names(entry) for entry in entries_of(rooms, again)] == [["rooms"], ["again"]]


def test_a_map_that_has_changed_since_does_not_join_its_run(run, rooms):
    assert report_of(run).title == "rooms"
    mapdeal.write_map(rooms, rooms_grid(walls=1), force=True)
    report = report_of(run, rooms)
    assert (len(report.entries), report.title) == (2, "2 maps")


def test_a_batch_has_an_entry_for_each_map_and_one_that_failed_has_the_reason(tmp_path, command):
    maps_run = tmp_path / "batch"
    mapdeal.write_map(tmp_path / "maps" / "a" / "one.yaml", rooms_grid())
    mapdeal.write_map(tmp_path / "maps" / "two.yaml", ROOM)
    (tmp_path / "maps" / "bad.yaml").write_text("image: none.pgm\nresolution: x\n")
    words = ["run", tmp_path / "maps", "-o", maps_run, "--jobs", 1, "--no-images"]
    assert command(*words)[0] == 5
    entries = {entry.name: entry for entry in entries_of(maps_run)}
    states = {name: entry.status for name, entry in entries.items()}
    assert states == {"a/one": "done", "bad": "failed", "two": "done"}
    assert entries["bad"].layers == ()
    assert "bad.yaml" in entries["bad"].warnings[0]
    shutil.rmtree(maps_run / "two")
    with pytest.warns(mapdeal.MapdealWarning) as caught:
        entries = {entry.name: entry for entry in entries_of(maps_run)}
    assert (len(caught), len(entries["a/one"].layers), entries["two"].layers) == (1, 3, ())
    assert entries["two"].warnings[0].endswith("so this run is not shown")
    (maps_run / "summary.json").unlink()  # a folder with runs below is as a batch
    assert [entry.name for entry in entries_of(maps_run)] == ["a/one"]


@pytest.mark.parametrize("fits", [True, False])
def test_layers_hold_what_the_files_hold_in_much_and_little_memory(run, rooms, fits, monkeypatch):
    if not fits:
        monkeypatch.setattr("mapdeal.commands.report_entries.room", lambda: 0)
    with Grids(DEFAULT_SETTINGS) as grids:
        layers = gathered([run, rooms], grids).entries[0].layers
        values = [layer.values[:] for layer in layers]
        assert all(layer.values[2:4].tolist() == value[2:4].tolist()
                   for layer, value in zip(layers, values, strict=True))  # fmt: skip
        assert [grids.grid(path).is_lazy for path in (run / "esdf.npz", rooms)] == [not fits] * 2
    with np.load(run / "esdf.npz") as field, np.load(run / "cost.npz") as costs:
        assert values[1].view(np.int8).tolist() == field["occupancy"].tolist()
        assert values[2].tobytes() == field["distance"].tobytes()
        assert values[3].tobytes() == costs["cost"].tobytes()
        assert layers[1].frame.origin == tuple(field["origin"])


def test_layers_of_a_cloud_lie_on_its_map_with_their_units(command, tmp_path):
    cloud, map_, layers = EXAMPLES / "clouds/ramp.pcd", tmp_path / "m.yaml", tmp_path / "l.npz"
    code, _, err = command("build", "--cloud", cloud, "-o", map_, "--layers", layers)
    assert code == 0, err
    units = {"points": "points", "slope": "m/m", "obstacle_height": "m", "floor_height": "m"}
    with Grids(DEFAULT_SETTINGS) as grids, np.load(layers) as stored:
        (entry,) = gathered([map_, layers], grids).entries
        assert layer_names(entry) == ["m", *(f"l-{name}" for name in units)]
        for layer, (name, unit) in zip(entry.layers[1:], units.items(), strict=True):
            assert layer.unit == layer.style.bar.unit == unit
            assert np.array_equal(layer.values[:], stored[name], equal_nan=True)
            assert layer.style.scale.high == pytest.approx(np.nanmax(stored[name]))
        assert entry.layers[-1].style.scale.low == pytest.approx(np.nanmin(stored["floor_height"]))
    (alone,) = entries_of(layers)
    assert layer_names(alone) == ["l-map", *(f"l-{name}" for name in units)]


def test_layers_of_one_file_may_be_read_in_turns(rooms, tmp_path):
    reach = mapdeal.reach(mapdeal.read_map(rooms), radius=0.1)
    mapdeal.write_map(tmp_path / "reach.npz", reach)
    with Grids(DEFAULT_SETTINGS) as grids:
        (entry,) = gathered([rooms, tmp_path / "reach.npz"], grids).entries
        assert layer_names(entry) == ["rooms", "reach-clearance", "reach-widest", "reach"]
        layers = entry.layers[1:3]
        read = [[layer.values[rows] for layer in layers] for rows in (slice(0, 2), slice(2, 8))]
    clearance, widest = (np.vstack(rows) for rows in zip(*read, strict=True))
    np.testing.assert_array_equal(clearance, reach.clearance)
    np.testing.assert_array_equal(widest, reach.widest)


def test_a_run_that_asks_what_can_be_reached_shows_the_answer(rooms, tmp_path):
    x, y = rooms_grid().frame.xy_from_rowcol([(3, 5)])[0].tolist()
    parameters = f"{{radius: 0.2, start: [{x}, {y}], goals: {{lab: [{x}, {y}]}}}}"
    (tmp_path / "asks.yaml").write_text(f"stages:\n- reach: {parameters}\n")
    (entry,) = entries_of(mapdeal.run(rooms, tmp_path / "asks", tmp_path / "asks.yaml").folder)
    assert layer_names(entry) == ["reach-clearance", "reach-widest", "reach"]
    assert [item.kind for item in entry.items] == ["start", "goal", "passage"]
    assert "What the robot can reach" in [table.title for table in entry.tables]


def test_shares_are_those_of_the_map_as_read_and_not_of_what_a_run_made_of_it(run, rooms):
    (alone,), (both,) = entries_of(run), entries_of(run, rooms)
    assert not {"occupied %", "free %", "unknown %"} & set(alone.figures)
    for name, state in (("occupied %", 100), ("unknown %", -1)):
        assert both.figures[name] == round(100 * np.mean(rooms_grid().occupancy == state), 2)
    assert both.figures["lethal %"] > both.figures["occupied %"]  # inflated


@pytest.mark.parametrize("fits", [True, False])
def test_what_reading_a_map_warns_of_is_on_the_page_and_given_once(tmp_path, fits, monkeypatch):
    if not fits:
        monkeypatch.setattr("mapdeal.commands.report_entries.room", lambda: 0)
    dark = np.full((8, 20), -1, np.int8)
    paths = [reported.write_cells(tmp_path / f"{name}.yaml", dark) for name in ("one", "two")]
    with pytest.warns(mapdeal.MapdealWarning, match="known") as caught:
        entries = entries_of(*paths)
    texts = [entry.warnings[0] for entry in entries]
    assert [text.partition(": ")[0] for text in texts] == ["one.yaml", "two.yaml"]
    assert len(caught) == 2


def test_what_reading_the_map_of_a_run_warns_of_is_on_its_page(rooms, run):
    rooms.write_text(rooms.read_text().replace("free_thresh: ", "free_thresh: 0.3 # "))
    paths = (rooms, rooms.with_suffix(".pgm"))
    sums = {path.name: sha256(path.read_bytes()).hexdigest() for path in paths}
    changed(run / "manifest.json", lambda document: document.update(inputs=sums, warnings=[]))
    with pytest.warns(mapdeal.MapdealWarning) as caught:
        (entry,) = entries_of(run, rooms)
    assert layer_names(entry)[0] == "input"
    assert [text.partition(":")[0] for text in entry.warnings] == ["rooms.yaml"] * len(caught)


def test_pages_show_no_absolute_path(tmp_path, rooms, command, save_output):
    shifted, imageless, robot = (tmp_path / f"{name}.yaml" for name in ("other", "bare", "robot"))
    mapdeal.write_map(shifted, rooms_grid(walls=3))
    imageless.write_text(rooms.read_text().replace("rooms.pgm", "no.pgm"))
    robot.write_text("global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.2}}}\n")
    maps = [rooms, shifted, imageless, tmp_path / "gone.yaml", robot]
    ends = rooms_grid().frame.xy_from_rowcol([(3, 4), (3, 14)]).tolist()
    start, goal = (f"{x},{y}" for x, y in ends)
    at = ["--from", start, "--to", goal, "--robot-radius", "0.05"]
    (tmp_path / "documents").mkdir()
    documents = [save_output(f"documents/{name}.json", *words) for name, words in {
        "reach": ["reach", rooms, *at],
        "route": ["route", rooms, *at],
        "align": ["align", rooms, shifted, "--json"],
        "diff": ["diff", rooms, shifted, "--json"],
        "lint": ["lint", *maps, "--format", "json"],
        "params": ["lint", rooms, "--params-file", robot, "--format", "json"],
        "score": ["score", rooms, "--truth", shifted, "--json"],
    }.items()]  # fmt: skip
    batch = tmp_path / "batch"
    command("run", imageless, rooms, "-o", batch, "-q", "--jobs", 1, "--no-images")

    def check_pages(*pages):
        for paths in ([batch], *([path] for path in documents[2:]), *pages):
            code, _, err = command("report", *paths, "-o", tmp_path / "page.html", "--force")
            assert code == int("error: " in err), err  # lint has found a map without its image
            page = (tmp_path / "page.html").read_text()
            assert str(tmp_path) not in page
            assert "rooms" in page

    moved = shutil.move(rooms, tmp_path / "elsewhere.yaml")
    check_pages()
    shutil.move(moved, rooms)
    (batch / "rooms/esdf.npz").write_bytes(b"torn")
    check_pages([rooms, *documents], [batch / "rooms"])
    _, out, _ = command("report", EXAMPLES / "maps/office.yaml", "-o", tmp_path / "o.html")
    assert Path(out.split()[-1]).samefile(EXAMPLES / "maps/office.yaml")  # the next command
    assert str(EXAMPLES) not in (tmp_path / "o.html").read_text()


def test_documents_of_another_system_show_no_folder_of_it(tmp_path, rooms, save_output):
    path = save_output("diff.json", "diff", rooms, rooms, "--json")
    diff = document(path)
    diff["first"]["file"], diff["second"]["file"] = "C:\\maps\\a.yaml", "/home/me/my maps/b.yaml"
    path.write_text(json.dumps(diff))
    with pytest.warns(mapdeal.MapdealWarning, match="is not shown"):
        (entry,) = entries_of(path)
    rows = dict(row for table in entry.tables for row in table.rows)
    assert (rows["first map"], rows["second map"]) == ("a.yaml", "b.yaml")
    assert [text.split(":")[0] for text in entry.warnings] == ["a.yaml", "b.yaml"]


def test_a_map_that_is_named_many_times_is_on_the_page_once(rooms, here, tmp_path, save_output):
    (tmp_path / "deep").mkdir()
    Path("link.yaml").symlink_to("rooms.yaml")
    Path("hard.yaml").hardlink_to("rooms.yaml")
    names = ["rooms.yaml", "./rooms.yaml", "deep/../rooms.yaml", "link.yaml", "hard.yaml", rooms]
    lint = save_output("lint.json", "lint", "rooms.yaml", "--format", "json")
    maps = [{**document(lint)["maps"][0], "file": str(names[k % 6])} for k in range(301)]
    changed(lint, lambda document: document.update(maps=maps))
    (entry,) = entries_of(lint, save_output("score.json", "score", "link.yaml", "--json"))
    assert layer_names(entry) == ["rooms"]
    assert sum(table.title.startswith("Score") for table in entry.tables) == 1
    (entry,) = entries_of(*(tmp_path / name for name in names))
    assert layer_names(entry) == ["rooms"]


def test_a_run_that_is_named_many_times_is_on_the_page_once(run, tmp_path):
    entry_of_run = {"map": "rooms.yaml", "folder": "rooms", "status": "done"}
    places = ["rooms", "./rooms", "rooms/."] * 100
    summary = run.parent / "summary.json"
    entries = [{**entry_of_run, "folder": place} for place in places]
    summary.write_text(json.dumps({"maps": entries}))
    for paths in ([summary], [run, run / "manifest.json"], [run.parent, run]):
        (entry,) = entries_of(*paths)
        assert layer_names(entry) == STAGES
        assert all(table.rows for table in entry.tables)
    (tmp_path / "link").symlink_to(run)
    mapdeal.write_map(tmp_path / "other.yaml", rooms_grid(walls=3))
    paths = [run, tmp_path / "other.yaml", run / ".." / run.name, tmp_path / "link"]
    assert [entry.name for entry in entries_of(*paths)] == ["rooms", "other"]
    assert [entry.name for entry in entries_of(*paths[:0:-1])] == ["link", "other"]


@pytest.mark.parametrize("name", ["esdf.npz", "inflated.yaml"])
@pytest.mark.parametrize("change", ["smaller", "of another kind"])
def test_a_file_that_changes_while_a_page_is_made_ends_it(run, name, change):
    """Of many files those that were used longest ago are read again when their rows are due."""
    with Grids(DEFAULT_SETTINGS) as grids:
        (entry,) = gathered([run], grids).entries
        for path in sorted(run.glob("*")):  # as if there were many more
            if path.suffix in (".npz", ".yaml"):
                grids._grids.pop(path, None)
        grids._layer_read = None
        (run / name).unlink()
        if change == "smaller":
            grid = grid_from_text("..#")
            product = mapdeal.esdf(grid) if name == "esdf.npz" else grid
            mapdeal.write_map(run / name, product, force=True)
        else:
            shutil.copy((run / "cost").with_suffix((run / name).suffix), run / name)
        with pytest.raises(FileAccessError, match="changed while it was read"):
            for layer in entry.layers:
                layer.values[:]


def test_the_local_run_of_a_batch_has_an_entry_of_its_own(run):
    shutil.copytree(run, run.parent / "copy")
    shutil.move(run.parent / "copy", run / "local")
    map_entry = {"map": "rooms.yaml", "folder": "rooms", "status": "unchanged", "local": {}}
    (run.parent / "summary.json").write_text(json.dumps({"maps": [map_entry]}))
    entries = entries_of(run.parent)
    for found in (entries, entries_of(run)):
        assert [entry.name for entry in found] == ["rooms", "rooms/local"]
    for entry in entries:
        assert len(entry.layers) == 3
        assert "Input" not in [table.title for table in entry.tables]  # failed maps alone have it


def test_a_page_is_not_written_over_a_file_that_was_read(run, command):
    page, before = run / "page.html", (run / "cost.npz").read_bytes()
    page.symlink_to(run / "cost.npz")
    code, _, err = command("report", run, "-o", page, "--force")
    assert (code, "the output is the input" in err) == (4, True)
    assert (run / "cost.npz").read_bytes() == before


@pytest.fixture
def batch(run):
    map_entry = {"map": "rooms.yaml", "folder": run.name, "status": "done"}
    (run.parent / "summary.json").write_text(json.dumps({"maps": [map_entry, dict(map_entry)]}))
    return run.parent


def test_columns_of_figures():
    esdf = {"width": 20, "height": 5, "resolution": 0.25, "occupied": 7, "highest_distance": 1.2}
    assert columns_of({"esdf": esdf, "reach": {"reachable_m2": 4, "width": 3, "height": 1}}) == {
        "cells": "20 x 5", "m per cell": 0.25, "occupied %": 7.0, "reachable m2": 4.0,
    }  # fmt: skip
    cost = {"width": 20, "height": 5, "lethal": 3, "free": 9, "unknown": 9}
    assert columns_of({"cost": cost}) == {"cells": "20 x 5", "lethal %": 3.0}
    assert columns_of({"cost": {"width": 0, "height": 5, "free": 0}, "esdf": [1]}) == {}


def test_a_stage_is_in_a_manifest_but_once(run):
    """Recipes have each stage once; a hundred thousand of them would be as many layers."""
    manifest = run / "manifest.json"
    original = document(manifest)
    for odd in ({**original, "stages": [*original["stages"], {"esdf": {}}]}, []):
        manifest.write_text(json.dumps(odd))
        with pytest.raises(MalformedInputError, match="is not the manifest of a run"):
            entries_of(run)


OUTSIDE = ["../cost.npz", "..", ".", "", "a\0", "\ud800", "n" * 9000]


def without_costs(manifest, folder):
    """Name costs that lie outside of the folder of the run instead of its own."""
    del manifest["outputs"]["cost.npz"], manifest["outputs"]["cost.yaml"]
    manifest["outputs"] |= dict.fromkeys([*OUTSIDE, str(folder.parent / "cost.npz")], "00")


@pytest.mark.filterwarnings("ignore::mapdeal.MapdealWarning")
@pytest.mark.parametrize(("change", "layers", "count", "expected"), [
    *[(lambda document, _, value=value: document.update(warnings=value), STAGES, 0, [])
      for value in (5, True, "text", {"a": 1}, None)],
    (lambda document, _: document["stages"][-1]["cost"].update(inscribed_radius=-1), STAGES, 0, []),
    (lambda document, _: document["outputs"].update({f"f{k}": "0" for k in range(300)}), STAGES, 21,
     ["f19: is missing, though the manifest lists it",
      "manifest.json: 280 more of the files that it lists are missing, or are others"]),
    (without_costs, STAGES[:2], 7, ["manifest.json: the run wrote no values of stage cost"]),
    (lambda document, _: document["stages"].extend(
        {name: {}} for name in ("../esdf", "/etc/passwd", "", "a\0")), STAGES, 4,
     ["manifest.json: the run wrote no values of stage ../esdf"]),
    (lambda _, folder: (folder / "cost.npz").write_bytes(b"PK"), STAGES[:2], 2,
     ["cost.npz: is not what the run wrote: its checksum differs",
      "cost.npz: is not an npz file, so layer cost is not shown"]),
    (lambda _, folder: (folder / "cost.npz").unlink(), STAGES[:2], 2,
     ["cost.npz: is missing, though the manifest lists it"]),
])  # fmt: skip
def test_an_odd_manifest_or_file_leaves_the_rest(run, change, layers, count, expected):
    for name in ("cost.npz", "cost.yaml"):  # where the run must not look for them
        (run.parent / name).write_bytes((run / name).read_bytes())
    changed(run / "manifest.json", lambda document: change(document, run))
    (entry,) = entries_of(run)
    assert (layer_names(entry), len(entry.warnings)) == (layers, count)
    assert set(expected) <= set(entry.warnings)


@pytest.mark.parametrize("place", ["..", "../out/rooms", "rooms/../rooms", ".", "", "/etc", None])
def test_a_batch_shows_no_run_outside_of_its_folder(batch, place):
    place = str(batch / "rooms") if place is None else place
    changed(batch / "summary.json", lambda summary: summary["maps"][0].update(folder=place))
    with pytest.warns(mapdeal.MapdealWarning) as caught:
        first, second = entries_of(batch)
    rule = f"{place} is in no folder of this batch, so it is not shown"
    assert [str(warning.message) for warning in caught] == [f"{batch}/summary.json: {rule}"]
    assert first.warnings == (f"summary.json: {rule.removeprefix(f'{batch}/')}",)
    assert (len(first.layers), len(second.layers)) == (0, 3)


def test_a_summary_without_maps_hides_no_run(batch):
    changed(batch / "summary.json", lambda summary: summary.update(maps=[]))
    (entry,) = entries_of(batch)
    assert len(entry.layers) == 3
    (batch / "rooms/manifest.json").unlink()
    with pytest.raises(FileAccessError, match="contains no run"):
        entries_of(batch)


BAD = "<img src=x onerror=alert(1)></script></title>-->]]>\u2028\u202e\0\ud800"


@pytest.mark.filterwarnings("ignore::mapdeal.MapdealWarning")
def test_names_in_documents_are_text_on_the_page(batch, tmp_path):
    def change(document):
        document["stages"].append({BAD: {BAD: BAD}})
        document["figures"][BAD] = {BAD: BAD}
        document |= {"warnings": [BAD], "options": {BAD: BAD}, "robot": {BAD: [BAD]}}
        document["version"] = BAD
        document["inputs"] = document["outputs"] = {**document["outputs"], BAD: BAD}

    of_batch = {"map": BAD, "folder": BAD, "status": BAD, "error": BAD}
    changed(batch / "rooms/manifest.json", change)
    changed(batch / "summary.json", lambda summary: summary["maps"][1].update(of_batch))
    page = mapdeal.write_report(tmp_path / "page.html", batch).path.read_text()
    assert not [text for text in ("<img src=x", "\0", "\u2028", "\u202e") if text in page]
    assert page.count("&lt;img src=x onerror=alert(1)&gt;&lt;/script&gt;") > 10
    assert (page.count("</script>"), page.count("</title>")) == (3, 1)


def test_an_entry_lists_no_more_than_browsers_can_show():
    draft = Draft("a", Path("a"))
    draft.items = [Item("goal", str(number)) for number in range(5002)]
    draft.tables = [Table("first", tuple((str(number), "x") for number in range(6000)))]
    draft.tables += [Table("other", (("a", "b"),))] * 5000
    draft.warn(str(number) for number in range(5000))
    entry = draft.entry(DEFAULT_SETTINGS)
    assert [item.text for item in entry.items[4999:]] == ["4999", "2 more are not listed"]
    assert entry.tables[0].rows[4999:] == (("4999", "x"), ("1000 more are not listed", ""))
    assert (len(entry.tables), entry.tables[-1].title) == (5001, "1 more are not listed")
    assert entry.warnings[-1] == "4999"


def test_a_page_keeps_to_its_size_whatever_it_lists(run, monkeypatch):
    monkeypatch.setattr("mapdeal.commands.report._LARGEST_PAGE", 400_000)
    line = {"type": "LineString", "coordinates": [[k / 7, k / 3] for k in range(500)]}
    feature = {"type": "Feature", "properties": {}, "geometry": line}
    shapes = {"type": "FeatureCollection", "features": [feature] * 9}
    (run / "shapes.json").write_text(json.dumps(shapes))
    noise = np.random.default_rng(1).integers(0, 101, size=(700, 900), dtype=np.int8)
    sources = [reported.write_cells(run / "noise.yaml", noise), run / "shapes.json"]
    assert 200_000 < mapdeal.write_report(run / "page.html", sources).size <= 400_000
