"""Which paths of a report become what: cases that a person meets later than the plain ones."""

import json
import shutil
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal.commands.report import gathered
from mapdeal.commands.report_entries import Grids
from mapdeal.errors import FileAccessError
from mapdeal.pipeline.settings import DEFAULT_SETTINGS
from pipeline.reported import entries_of, layer_names, rooms_grid


@pytest.fixture
def machine(tmp_path, rooms, command):
    """A folder of documents that name maps of this machine by absolute paths, and others."""
    other = tmp_path / "other.yaml"
    mapdeal.write_map(other, rooms_grid(walls=3))
    (tmp_path / "imageless.yaml").write_text(rooms.read_text().replace("rooms.pgm", "no.pgm"))
    robot = tmp_path / "robots" / "nav2.yaml"
    robot.parent.mkdir()
    robot.write_text("global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.2}}}\n")
    maps = [rooms, other, tmp_path / "imageless.yaml", tmp_path / "gone.yaml", robot]
    documents = tmp_path / "documents"
    documents.mkdir()
    for name, words in {
        "diff": ["diff", rooms, other, "--json"],
        "score": ["score", rooms, "--truth", other, "--json"],
        "lint": ["lint", *maps, "--format", "json"],
        "params": ["lint", rooms, "--params-file", robot, "--format", "json"],
    }.items():
        (documents / f"{name}.json").write_text(command(*words)[1])
    command("align", rooms, other, "-o", documents / "align.json")
    at = ["--from", "2,-1.2", "--to", "4,-1.2", "--robot-radius", "0.05", "-q"]
    command("reach", rooms, *at, "-o", documents / "reach.json")
    command("route", rooms, *at, "-o", documents / "route.json")
    command("run", tmp_path / "imageless.yaml", rooms, "-o", tmp_path / "batch", "-q")
    return documents


@pytest.mark.parametrize("state", ["there", "gone"])
def test_pages_show_no_absolute_path(machine, command, state):
    folder = machine.parent
    maps = [folder / "rooms.yaml"]
    pages = [[path] for path in sorted(machine.iterdir()) if path.stem not in ("reach", "route")]
    pages += [[folder / "batch"], [*maps, *sorted(machine.iterdir())], [folder / "batch/rooms"]]
    if state == "gone":
        pages = pages[:5]
        shutil.move(maps[0], folder / "elsewhere.yaml")
        (folder / "batch/rooms/esdf.npz").write_bytes(b"torn")
    assert len(pages) == (5 if state == "gone" else 8)
    for paths in pages:
        code, _, err = command("report", *paths, "-o", folder / "page.html", "--force")
        assert code == 0, err
        page = (folder / "page.html").read_text()
        assert str(folder) not in page
        assert "rooms" in page


def test_documents_of_another_system_show_no_folder_of_it(machine):
    told = json.loads((machine / "diff.json").read_text())
    told["first"]["file"], told["second"]["file"] = "C:\\maps\\a.yaml", "/home/me/my maps/b.yaml"
    (machine / "diff.json").write_text(json.dumps(told))
    with pytest.warns(mapdeal.MapdealWarning, match="is not shown"):
        (entry,) = entries_of(machine / "diff.json")
    rows = dict(row for table in entry.tables for row in table.rows)
    assert (rows["first map"], rows["second map"]) == ("a.yaml", "b.yaml")
    assert [text.split(":")[0] for text in entry.warnings] == ["a.yaml", "b.yaml"]


def test_a_map_that_is_named_many_times_is_on_the_page_once(rooms, tmp_path, command, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "deep").mkdir()
    Path("link.yaml").symlink_to("rooms.yaml")
    Path("hard.yaml").hardlink_to("rooms.yaml")
    _, out, _ = command("lint", "rooms.yaml", "--format", "json")
    told = json.loads(out)
    names = ["rooms.yaml", "./rooms.yaml", "deep/../rooms.yaml", "link.yaml", "hard.yaml", rooms]
    told["maps"] = [{**told["maps"][0], "file": str(names[k % 6])} for k in range(301)]
    (tmp_path / "lint.json").write_text(json.dumps(told))
    (tmp_path / "score.json").write_text(command("score", "link.yaml", "--json")[1])
    (entry,) = entries_of(tmp_path / "lint.json", tmp_path / "score.json")
    assert layer_names(entry) == ["rooms"]
    assert sum(table.title.startswith("Score") for table in entry.tables) == 1
    (entry,) = entries_of(*(tmp_path / name for name in names))
    assert layer_names(entry) == ["rooms"]


def test_a_run_that_is_named_many_times_is_on_the_page_once(run):
    told = {"map": "rooms.yaml", "folder": "rooms", "status": "done"}
    places = ["rooms", "./rooms", "rooms/."] * 100
    summary = run.parent / "summary.json"
    summary.write_text(json.dumps({"maps": [{**told, "folder": one} for one in places]}))
    for paths in ([summary], [run, run / "manifest.json"], [run.parent, run]):
        (entry,) = entries_of(*paths)
        assert layer_names(entry) == ["inflated", "esdf", "cost"]
        assert all(table.rows for table in entry.tables)


def test_a_method_that_has_many_names_is_on_the_page_once(command, tmp_path):
    log = tmp_path / "log.clf"
    scan = f"FLASER 180 {'2.0 ' * 180}0.5 0 0 0.5 0 0 {{0}} robot {{0}}\n"
    log.write_text("".join(scan.format(time) for time in (1.0, 2.0)))
    assert command("build", log, "-o", tmp_path / "c", "--compare")[0] == 0
    document = tmp_path / "c" / "comparison.json"
    told = json.loads(document.read_text())
    told["methods"] |= {f"{k}/tsdf": told["methods"]["tsdf"] for k in range(301)}
    document.write_text(json.dumps(told))
    (entry,) = entries_of(tmp_path / "c")
    assert layer_names(entry) == ["log-odds", "counting", "tsdf"]
    assert entry.compared == ("log-odds", "counting")


@pytest.mark.parametrize("fits", [True, False])
def test_what_reading_a_map_warns_of_is_on_the_page_and_given_once(tmp_path, fits, monkeypatch):
    if not fits:
        monkeypatch.setattr("mapdeal.commands.report_entries.memory_limit", lambda: (0, ""))
    grid = rooms_grid()
    dark = mapdeal.OccupancyGrid(np.full_like(grid.occupancy, -1), 0.25, (1.5, -2.0, 0.4))
    for name in ("one", "two"):
        mapdeal.write_map(tmp_path / f"{name}.yaml", dark)
    with pytest.warns(mapdeal.MapdealWarning, match="known") as given:
        entries = entries_of(tmp_path / "one.yaml", tmp_path / "two.yaml")
    assert len(given) == 2
    for entry in entries:
        assert entry.warnings[0].startswith(f"{entry.name}.yaml: ")


def test_what_reading_the_map_of_a_run_warns_of_is_on_its_page(rooms, run):
    manifest = json.loads((run / "manifest.json").read_text())
    text = rooms.read_text().replace("free_thresh: ", "free_thresh: 0.3 # ")
    rooms.write_text(text)
    manifest["inputs"] = mapdeal_sums(rooms, rooms.with_suffix(".pgm"))
    manifest["warnings"] = []
    (run / "manifest.json").write_text(json.dumps(manifest))
    with pytest.warns(mapdeal.MapdealWarning) as given:
        (entry,) = entries_of(run, rooms)
    assert layer_names(entry)[0] == "input"
    assert [text.partition(":")[0] for text in entry.warnings] == ["rooms.yaml"] * len(given)


def mapdeal_sums(*paths):
    return {path.name: sha256(path.read_bytes()).hexdigest() for path in paths}


def test_layers_of_one_file_may_be_read_in_turns(rooms, tmp_path):
    reach = mapdeal.reach(mapdeal.read_map(rooms), radius=0.1)
    mapdeal.write_map(tmp_path / "reach.npz", reach)
    with Grids(DEFAULT_SETTINGS) as grids:
        (entry,) = gathered([rooms, tmp_path / "reach.npz"], grids).entries
        assert layer_names(entry) == ["rooms", "reach-clearance", "reach-widest", "reach"]
        layers = entry.layers[1:]
        whole = [np.array(layer.values[:]) for layer in layers]
        assert len(layers) == 3
        for rows in (slice(0, 2), slice(2, 5)):
            for layer, values in zip(layers, whole, strict=True):
                assert np.array_equal(layer.values[rows], values[rows], equal_nan=True)
    assert np.array_equal(whole[0], reach.clearance, equal_nan=True)
    assert np.array_equal(whole[1], reach.widest, equal_nan=True)


def test_maps_of_a_diff_are_looked_for_beside_its_document(rooms, tmp_path, command):
    other = tmp_path / "other.yaml"
    mapdeal.write_map(other, rooms_grid(walls=3))
    code, out, _ = command("diff", rooms, other, "--json")
    assert code == 1
    sent = tmp_path / "sent"
    sent.mkdir()
    for path in (rooms, other):
        shutil.move(path, sent)
        shutil.move(path.with_suffix(".pgm"), sent)
    (sent / "diff.json").write_text(out)
    (entry,) = entries_of(sent / "diff.json")
    assert layer_names(entry) == ["first", "second", "difference"]
    assert entry.compared == ("first", "second")


def test_of_many_differences_fifty_are_listed(tmp_path, command):
    walls = np.zeros((9, 130), dtype=np.int8)
    mapdeal.write_map(tmp_path / "a.yaml", mapdeal.OccupancyGrid(walls, 0.25, (1.5, -2.0, 0.4)))
    walls[4, 2::4], walls[3, 2] = 100, 100
    mapdeal.write_map(tmp_path / "b.yaml", mapdeal.OccupancyGrid(walls, 0.25, (1.5, -2.0, 0.4)))
    _, out, _ = command("diff", tmp_path / "a.yaml", tmp_path / "b.yaml", "--json")
    (tmp_path / "diff.json").write_text(out)
    (entry,) = entries_of(tmp_path / "diff.json")
    assert entry.items[0].text.startswith("wall added: 2 cells at ")
    assert len(entry.items) == 32
    walls[1, 2::4], walls[7, 2:6] = 100, 100  # 32 more, and one
    mapdeal.write_map(
        tmp_path / "b.yaml", mapdeal.OccupancyGrid(walls, 0.25, (1.5, -2.0, 0.4)), force=True
    )
    _, out, _ = command("diff", tmp_path / "a.yaml", tmp_path / "b.yaml", "--json")
    (tmp_path / "diff.json").write_text(out)
    (entry,) = entries_of(tmp_path / "diff.json")
    assert len(entry.items) == 51
    assert entry.items[-1].text == "wall added: 15 smaller groups not listed"


@pytest.mark.parametrize("name", ["esdf.npz", "inflated.yaml"])
@pytest.mark.parametrize("other", ["smaller", "of another kind"])
def test_a_file_that_changes_while_a_page_is_made_ends_it(run, name, other):
    """Of many files those that were used longest ago are read again when their rows are due."""
    with Grids(DEFAULT_SETTINGS) as grids:
        (entry,) = gathered([run], grids).entries
        for path in sorted(run.glob("*")):  # as if there were many more
            if path.suffix in (".npz", ".yaml"):
                grids._kept.pop(path, None)
        grids._made = None
        (run / name).unlink()
        if other == "smaller":
            grid = grid_from_text("..#")
            mapdeal.write_map(run / name, mapdeal.esdf(grid) if name[0] == "e" else grid,
                              force=True)  # fmt: skip
        else:
            shutil.copy((run / "cost").with_suffix((run / name).suffix), run / name)
        with pytest.raises(FileAccessError, match="changed while it was read"):
            for layer in entry.layers:
                layer.values[:]


def test_the_local_run_of_a_batch_has_an_entry_of_its_own(run):
    shutil.copytree(run, run.parent / "copy")
    shutil.move(run.parent / "copy", run / "local")
    told = {"map": "rooms.yaml", "folder": "rooms", "status": "unchanged", "local": {}}
    (run.parent / "summary.json").write_text(json.dumps({"maps": [told]}))
    entries = entries_of(run.parent)
    assert [entry.name for entry in entries] == ["rooms", "rooms/local"]
    assert [entry.name for entry in entries_of(run)] == ["rooms", "rooms/local"]
    for entry in entries:
        assert len(entry.layers) == 3
        assert "Input" not in [table.title for table in entry.tables]  # of those that failed


def test_the_curve_of_the_costs_stays_whatever_comes_behind_them(run):
    manifest = json.loads((run / "manifest.json").read_text())
    manifest["stages"].append(manifest["stages"].pop(0))
    (run / "manifest.json").write_text(json.dumps(manifest))
    (entry,) = entries_of(run)
    assert entry.curve.inflation_radius == 0.8


def test_maps_without_findings_are_not_missed(run, tmp_path):
    clean = {"file": "far.yaml", "findings": [], "suppressed": 0}
    document = {"errors": 0, "warnings": 0, "notes": 0, "suppressed": 0, "maps": [clean, clean]}
    (tmp_path / "lint.json").write_text(json.dumps(document))
    (entry,) = entries_of(run, tmp_path / "lint.json")  # a warning would be an error
    assert entry.items == ()


def test_a_page_is_not_written_over_a_file_that_was_read(run, command):
    page = run / "page.html"
    page.symlink_to(run / "cost.npz")
    before = (run / "cost.npz").read_bytes()
    code, _, err = command("report", run, "-o", page, "--force")
    assert (code, "the output is the input" in err) == (4, True)
    assert (run / "cost.npz").read_bytes() == before
