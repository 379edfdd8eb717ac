"""Documents in a report: the entry that shows each of lint, reach, route, diff, score, align."""

import io
import json
import shutil
from functools import partial

import numpy as np
import pytest

import mapdeal
from compare.buildings import HALL, WALLS, drawn
from drawn import grid_from_text
from mapdeal import Costmap
from mapdeal.commands.report_documents import MOST_POINTS, route_items
from mapdeal.commands.report_entries import Draft, drafts_about
from mapdeal.commands.route import PairedRoutes
from mapdeal.files.transaction import Transaction
from mapdeal.grid.frame import Transform
from mapdeal.grid.reach import Route
from mapdeal.planning.routes import Terrain, route_over
from mapdeal.sensors.points import NumberLines
from pipeline.reported import ROOMS, changed, document, entries_of, layer_names, write_cells

SHUT = ROOMS.replace("................", ".......#........", 1)


@pytest.fixture
def shut(tmp_path):
    """The rooms, with a narrower door."""
    mapdeal.write_map(tmp_path / "shut.yaml", grid_from_text(SHUT))
    return tmp_path / "shut.yaml"


def place(path, row, col):
    x, y = mapdeal.read_map(path).frame.xy_from_rowcol([(row, col)])[0]
    return f"{x:.6f},{y:.6f}"


def test_reach_belongs_to_what_is_named_before_it(save_output, rooms, shut):
    reach = save_output(
        "reach.json", "reach", shut, "--from", place(shut, 3, 4), "--to",
        f"lab={place(shut, 4, 14)}", "--robot-radius", 0.3, "--min-area", 0.1,
    )  # fmt: skip
    passage, *_ = document(reach)["passages"]
    # a document before all belongs to the first
    orders = ((rooms, shut, reach), 1), ((shut, reach, rooms), 0), ((reach, shut, rooms), 0)
    for paths, owner in orders:
        entries = entries_of(*paths)
        assert [bool(entry.items) for entry in entries] == [number == owner for number in (0, 1)]
        items = {item.kind: item for item in entries[owner].items}
        assert list(items) == ["start", "goal", "passage"]
        assert items["passage"].place == (passage["x"], passage["y"])
        assert [{"x": x, "y": y} for x, y in items["passage"].lines[0].tolist()] == passage["ends"]
        assert (items["goal"].tone, items["goal"].label) == ("error", "lab")


def test_a_route_is_a_line(save_output, rooms):
    ends = "--from", place(rooms, 3, 4), "--to", place(rooms, 3, 14)
    path = save_output("route.json", "route", rooms, "--robot-radius", 0.2, *ends)
    (entry,) = entries_of(rooms, path)
    (route,) = (item for item in entry.items if item.kind == "route")
    assert np.array_equal(route.lines[0], document(path)["points"])


def test_a_long_route_keeps_its_ends_and_few_of_its_points():
    points = np.stack([np.arange(70_001.0), np.sqrt(np.arange(70_001.0))], axis=1)
    *_, item = route_items(Route("astar", True, (0.0, 0.0), (1.0, 1.0), points, 1.0, 1.0, 1.0))
    (line,) = item.lines
    assert len(line) == MOST_POINTS
    assert (line[0].tolist(), line[-1].tolist()) == (points[0].tolist(), points[-1].tolist())
    assert np.diff(line[:, 0]).max() <= 4
    assert set(map(tuple, line.tolist())) <= set(map(tuple, points.tolist()))


@pytest.fixture
def findings(save_output, rooms, shut):
    """Return a function that lints maps into a document."""
    words = ("--robot-radius", 0.3, "--format", "json")
    return lambda *maps: save_output("lint.json", "lint", *maps, *words)


def test_findings_belong_to_the_maps_that_they_name(findings, rooms, shut):
    path = findings(rooms, shut)
    changed(path, lambda lint: lint["maps"][0]["findings"][0].update(message="of this map"))
    by_file = {part["file"]: part["findings"] for part in document(path)["maps"]}
    for paths in ((rooms, shut), (shut, rooms)):
        for map_path, entry in zip(paths, entries_of(*paths, path), strict=True):
            texts = [item.text for item in entry.items if ": place " not in item.text]
            assert len(texts) == len(by_file[str(map_path)])
            for finding in by_file[str(map_path)]:
                assert any(finding["message"] in text for text in texts)


def test_findings_alone_bring_the_maps_with_them(findings, rooms):
    path = findings(rooms)
    (entry,) = entries_of(path)
    assert layer_names(entry) == ["rooms"]
    assert len(entry.items) >= len(document(path)["maps"][0]["findings"])
    path.write_text(path.read_text().replace("rooms.yaml", "gone.yaml"))
    with pytest.warns(mapdeal.MapdealWarning, match=r"gone\.yaml: .*so this map is not shown"):
        (entry,) = entries_of(path)
    assert (entry.name, entry.layers) == ("gone", ())


def test_findings_of_other_maps_are_counted_not_guessed(findings, rooms, shut, tmp_path):
    path = findings(shut, rooms)
    (tmp_path / "other").mkdir()
    third = shutil.copy(shut, tmp_path / "other" / "third.yaml")
    shutil.copy(shut.with_suffix(".pgm"), tmp_path / "other")
    with pytest.warns(mapdeal.MapdealWarning, match=r"findings of .*shut\.yaml"):
        (entry,) = entries_of(third, path)
    assert entry.items == ()
    clean = {"file": "far.yaml", "findings": [], "suppressed": 0}
    changed(path, lambda lint: lint.update(maps=[clean, clean]))
    assert entries_of(third, path)[0].items == ()  # a warning would be an error


@pytest.mark.parametrize(("file", "found"), [
    ("aa/one.yaml", []),  # two runs of such a file, and neither is of that folder
    ("maps/a/one.yaml", [0]), ("somewhere/a/one.yaml", [0]), ("b/one.yaml", [1]),
    ("maps/two.yaml", [2]), ("two.pgm", [2]), ("", []),
])  # fmt: skip
def test_which_entries_a_name_is_of(file, found, tmp_path):
    drafts = [Draft(name, tmp_path / name) for name in ("a/one", "b/one", "two")]
    for draft in drafts[:2]:
        draft.names.add(f"{draft.name}.yaml")
        draft.files.add("one.yaml")
    drafts[2].files |= {"two.yaml", "two.pgm"}
    assert [drafts.index(draft) for draft in drafts_about(file, drafts)] == found


def test_a_diff_shows_both_maps_and_what_differs(save_output, rooms, shut, tmp_path):
    changes = mapdeal.read_map(rooms).occupancy != mapdeal.read_map(shut).occupancy
    path, sent = save_output("diff.json", "diff", rooms, shut, "--json"), tmp_path / "sent"
    sent.mkdir()  # maps are looked for beside the document, too
    for file in (path, rooms, rooms.with_suffix(".pgm"), shut, shut.with_suffix(".pgm")):
        shutil.move(file, sent)
    (entry,) = entries_of(sent / "diff.json")
    assert layer_names(entry) == ["first", "second", "difference"]
    assert entry.compared == ("first", "second")
    assert not entry.opens_swiped  # it opens on what differs
    difference, frame = entry.layers[-1], entry.layers[0].frame
    added = next(value for value, name in difference.style.labels.items() if "added" in name)
    assert np.array_equal(difference.values[:] == added, changes)
    (item,), (cell,) = entry.items, np.argwhere(changes)
    x, y = frame.xy_from_rowcol([cell])[0]
    assert item.place == pytest.approx((x, y))
    assert (item.kind, item.text) == ("added", f"1. 0.0625 m2 at {x:.2f}, {y:.2f}")
    corners = frame.xy_from_continuous_rowcol(cell + np.array([(0, 0), (0, 1), (1, 0), (1, 1)]))
    line = np.unique(item.lines[0].round(9), axis=0)
    assert line == pytest.approx(np.unique(corners.round(9), axis=0))
    assert {claim.about: (claim.state, claim.evidence) for claim in entry.claims} == {
        "obstacles": ("warning", "added"), "cells": ("warning", "What differs"),
        "geometry": ("good", ""),
    }  # fmt: skip


def test_a_diff_with_a_tolerance_or_a_transform_shows_what_it_found(command, rooms, tmp_path):
    grid = mapdeal.read_map(rooms)
    x, y, yaw = grid.origin
    moved = mapdeal.OccupancyGrid(grid.occupancy, grid.resolution, (x + 0.75, y - 0.5, yaw))
    mapdeal.write_map(tmp_path / "moved.yaml", moved)
    (tmp_path / "by.json").write_text('{"x": 0.75, "y": -0.5, "yaw": 0}')
    for words in (["--by", tmp_path / "by.json"], ["--tolerance", "30"]):
        _, out, _ = command("diff", rooms, tmp_path / "moved.yaml", *words, "--json")
        (tmp_path / "diff.json").write_text(out)
        (entry,) = entries_of(tmp_path / "diff.json")
        assert len(entry.items) == len(json.loads(out)["changes"])
        claims = {claim.about: claim.state for claim in entry.claims}
        if "--by" in words:
            assert {"cells": "good", "obstacles": "good"}.items() <= claims.items()
            assert np.allclose(entry.layers[1].frame.origin, entry.layers[0].frame.origin)


def test_groups_of_cells_that_differ_are_listed_by_size(save_output, tmp_path):
    def difference(*cells):
        maps = [write_cells(tmp_path / f"{k}.yaml", values) for k, values in enumerate(cells)]
        return entries_of(save_output("diff.json", "diff", *maps, "--json"))[0]

    before, after = np.zeros((30, 40), np.int8), np.zeros((30, 40), np.int8)
    before[3, 4:9] = 100  # gone
    after[20:22, 30] = after[22, 31] = 100  # touch over a corner
    after[10, 10] = 100
    entry = difference(before, after)
    assert [(item.kind, item.text.partition(" at ")[0]) for item in entry.items] == [
        ("removed", "1. 0.312 m2"), ("added", "2. 0.188 m2"), ("added", "3. 0.0625 m2")
    ]  # fmt: skip
    middles = entry.layers[0].frame.xy_from_rowcol([(3, 6), (21, 30), (10, 10)])
    assert np.allclose([item.place for item in entry.items], middles)
    # of many, twenty
    walls = np.zeros_like(after)
    walls[1:23:3, 2::4], walls[26, 2:6] = 100, 100
    items = difference(np.zeros_like(after), walls).items
    assert items[0].text.startswith("1. 0.25 m2 at ")
    assert (len(items), items[-1].text) == (21, "61 smaller changes not listed")


def test_a_diff_of_maps_that_are_gone_or_changed_says_so(save_output, rooms, shut):
    path = save_output("diff.json", "diff", rooms, shut, "--json")
    mapdeal.write_map(shut, grid_from_text(ROOMS), force=True)
    with pytest.warns(mapdeal.MapdealWarning, match=r"shut\.yaml: is not the map that diff\.json"):
        (entry,) = entries_of(path)
    assert len(entry.layers) == 3
    rooms.unlink()
    with pytest.warns(mapdeal.MapdealWarning) as caught:
        (entry,) = entries_of(path)
    assert "so this map is not shown" in str(caught[0].message)
    assert layer_names(entry) == ["second"]
    assert [text.partition(":")[0] for text in entry.warnings] == ["rooms.yaml", "shut.yaml"]


def scores_of(entry):
    return [table for table in entry.tables if "Score" in table.title]


def test_a_score_is_a_table_of_the_map_that_it_names(save_output, rooms, shut):
    bounds = ("--min", "coverage=0.9", "--max", "dist_truth_to_est_m.mean=0.001")
    path = save_output("score.json", "score", rooms, "--truth", shut, *bounds, "--json")
    values = document(path)["values"]
    for paths, owner in (((shut, rooms), 1), ((), 0)):
        entries = entries_of(*paths, path)
        tables = [scores_of(entry) for entry in entries]
        assert [len(found) for found in tables] == [k == owner for k in range(len(entries))]
        (table,) = tables[owner]
        assert table.title == "Score: does not pass"
        rows = dict(table.rows)
        assert rows["truth"] == "shut.yaml"
        coverage = f"{100 * values['coverage']:.1f} %"
        assert rows["known area of the true map, known in the map (coverage)"] == coverage
        far = values["dist_truth_to_est_m"]["mean"]
        assert [text for name, text in table.rows if name == "bound"] == [
            f"coverage at least 0.9: holds, found {values['coverage']:.9g}",
            f"dist_truth_to_est_m.mean at most 0.001: missed, found {far:.9g}",
        ]
    assert entries[0].name == "rooms"


def test_scores_of_maps_that_are_gone_or_changed_are_warned_of(save_output, rooms, shut, tmp_path):
    path = save_output("score.json", "score", rooms, "--json")
    mapdeal.write_map(tmp_path / "third.yaml", grid_from_text(ROOMS))
    with pytest.warns(mapdeal.MapdealWarning, match=r"score of .*rooms\.yaml is left out"):
        entries = entries_of(shut, tmp_path / "third.yaml", path)
    assert [scores_of(entry) for entry in entries] == [[], []]
    ((score,),) = map(scores_of, entries_of(path))
    rows = dict(score.rows)
    assert rows["corners and ends of walls (corners)"].isdigit()
    assert "truth" not in rows
    mapdeal.write_map(rooms, grid_from_text(SHUT), force=True)
    message = r"rooms\.yaml: is not the map that score\.json"
    with pytest.warns(mapdeal.MapdealWarning, match=message):
        (entry,) = entries_of(rooms, path)
    assert any("score.json" in text for text in entry.warnings)


def test_an_alignment_shows_the_first_map_where_it_lies_on_the_second(save_output, tmp_path):
    here, there = Transform(-3.2, 11.7, 0.3), Transform(5.0, 2.0, 2.2)
    maps = tmp_path / "a.yaml", tmp_path / "b.yaml"
    for path, where in zip(maps, (here, there), strict=True):
        mapdeal.write_map(path, drawn(WALLS, 0.2, where))
    align = save_output("t.json", "align", *maps, "--json")
    (entry,) = entries_of(align)
    assert entry.compared == ("first", "second")
    first, second = (layer.frame for layer in entry.layers)
    assert second == mapdeal.read_map(maps[1]).frame
    cell = mapdeal.read_map(maps[0]).frame.unbounded_rowcol_from_xy(here.points([[8.0, 6.0]]))
    assert np.hypot(*(first.xy_from_rowcol(cell) - there.points([[8.0, 6.0]]))[0]) < 0.25
    assert entry.tables[0].title == "Alignment"
    assert dict(entry.tables[0].rows)["same place"] == "yes"
    maps[0].unlink()
    with pytest.warns(mapdeal.MapdealWarning, match="so this map is not shown"):
        (entry,) = entries_of(align)
    assert layer_names(entry) == ["second"]


def test_an_uncertain_alignment_shows_its_candidates(save_output, tmp_path):
    for name, place in (("a", Transform()), ("b", Transform(5.0, 2.0, 2.2))):
        mapdeal.write_map(tmp_path / f"{name}.yaml", drawn(HALL, 0.2, place))
    align = save_output("t.json", "align", tmp_path / "a.yaml", tmp_path / "b.yaml", "--json")
    (entry,) = entries_of(align)
    titles = [title for title, _ in entry.tables[0].rows if title.startswith("candidate")]
    assert [title.split(",")[0] for title in titles] == [f"candidate {k}" for k in (1, 2, 3)]


def test_lines_go_to_the_disk_as_they_come(tmp_path):
    folder = tmp_path / "new"
    sizes = []

    def pairs():
        for line in range(1, 101):
            sizes.append(sum(file.stat().st_size for file in folder.iterdir()))
            yield NumberLines(np.full((1, 4), np.nan), [line], {0: "x" * 10_000})

    terrain = Terrain.of(Costmap(np.zeros((3, 5), np.uint8), 0.5, (1.0, -2.0, 0.4)))
    routes = PairedRoutes(pairs(), "pairs", {"plain": partial(route_over, terrain)})
    with Transaction([folder / "r.jsonl"]) as transaction:
        routes.write(transaction, folder / "r.jsonl")
    assert (routes.counts["pairs"], routes.counts["failed"]) == (100, 100)
    assert sizes == sorted(sizes)
    assert sizes[-1] > 985_000 - io.DEFAULT_BUFFER_SIZE  # which Python 3.14 has made larger
    assert [file.name for file in folder.iterdir()] == ["r.jsonl"]
    assert (folder / "r.jsonl").read_text().count('"line": ') == 100
