"""Documents in a report: which entry gets what lint, reach, route and diff tell."""

import json
import shutil

import numpy as np
import pytest

import mapdeal
from compare.buildings import WALLS, drawn
from drawn import grid_from_text
from mapdeal.commands.report import gathered
from mapdeal.commands.report_entries import Draft, Grids, drafts_about
from mapdeal.grid.frame import Transform
from mapdeal.pipeline.settings import DEFAULT_SETTINGS
from pipeline.reported import entries_of

ROOMS = """
    ##################
    #.......#........#
    #.......#........#
    #.......#........#
    #................#
    #................#
    #.......#........#
    ##################
"""
SHUT = ROOMS.replace("................", ".......#........", 1)


@pytest.fixture
def shut(tmp_path):
    mapdeal.write_map(tmp_path / "shut.yaml", grid_from_text(SHUT))
    return tmp_path / "shut.yaml"


@pytest.fixture
def rooms(tmp_path):
    mapdeal.write_map(tmp_path / "rooms.yaml", grid_from_text(ROOMS))
    return tmp_path / "rooms.yaml"


def place(path, row, col):
    x, y = mapdeal.read_map(path).frame.xy_from_rowcol([(row, col)])[0]
    return f"{x:.6f},{y:.6f}"


def reach_of(command, path, tmp_path):
    out = tmp_path / f"{path.stem}_reach.json"
    code, _, err = command(
        "reach", path, "--from", place(path, 3, 2), "--to", f"lab={place(path, 4, 12)}",
        "--robot-radius", 0.3, "--min-area", 0.1, "-o", out,
    )  # fmt: skip
    assert code in (0, 1), err
    return out


def test_reach_belongs_to_what_is_named_before_it(command, rooms, shut, tmp_path):
    reach = reach_of(command, shut, tmp_path)
    told = json.loads(reach.read_text())
    assert told["passages"]
    # a document before all belongs to the first
    orders = ((rooms, shut, reach), 1), ((shut, reach, rooms), 0), ((reach, shut, rooms), 0)
    for paths, owner in orders:
        entries = entries_of(*paths)
        assert [bool(one.items) for one in entries] == [number == owner for number in (0, 1)]
        items = {item.kind: item for item in entries[owner].items}
        assert list(items) == ["start", "goal", "passage"]
        passage = told["passages"][0]
        assert items["passage"].place == (passage["x"], passage["y"])
        assert items["passage"].lines[0].tolist() == passage["ends"]
        assert (items["goal"].tone, items["goal"].label) == ("error", "lab")


def test_a_route_is_a_line(command, rooms, tmp_path):
    out = tmp_path / "route.json"
    arguments = "--from", place(rooms, 3, 2), "--to", place(rooms, 3, 12), "-o", out
    assert command("route", rooms, "--robot-radius", 0.2, *arguments)[0] == 0
    (entry,) = entries_of(rooms, out)
    (route,) = (item for item in entry.items if item.kind == "route")
    points = json.loads(out.read_text())["points"]
    assert np.array_equal(route.lines[0], points)


def test_findings_belong_to_the_maps_that_they_name(command, rooms, shut, tmp_path):
    _, out, _ = command("lint", rooms, shut, "--robot-radius", 0.3, "--format", "json")
    told = {one["file"]: one["findings"] for one in json.loads(out)["maps"]}
    told[str(rooms)][0]["message"] = "of the other map"
    maps = [{"file": file, "findings": found, "suppressed": 0} for file, found in told.items()]
    (tmp_path / "lint.json").write_text(json.dumps({**json.loads(out), "maps": maps}))
    for paths in ((rooms, shut), (shut, rooms)):
        for path, entry in zip(paths, entries_of(*paths, tmp_path / "lint.json"), strict=True):
            texts = [item.text for item in entry.items if ": place " not in item.text]
            assert len(texts) == len(told[str(path)])
            for finding in told[str(path)]:
                assert any(finding["message"] in text for text in texts)


def test_findings_alone_bring_the_maps_with_them(command, rooms, tmp_path):
    _, out, _ = command("lint", rooms, "--robot-radius", 0.3, "--format", "json")
    (tmp_path / "lint.json").write_text(out.replace("rooms.yaml", "gone.yaml"))
    with pytest.warns(mapdeal.MapdealWarning, match=r"gone\.yaml: .*so this map is not shown"):
        (entry,) = entries_of(tmp_path / "lint.json")
    assert (entry.name, entry.layers) == ("gone", ())
    (tmp_path / "lint.json").write_text(out)
    (entry,) = entries_of(tmp_path / "lint.json")
    assert [layer.name for layer in entry.layers] == ["rooms"]
    assert len(entry.items) >= len(json.loads(out)["maps"][0]["findings"])


def test_findings_of_other_maps_are_told_not_guessed(command, rooms, shut, tmp_path):
    _, out, _ = command("lint", shut, rooms, "--robot-radius", 0.3, "--format", "json")
    (tmp_path / "lint.json").write_text(out)
    (tmp_path / "other").mkdir()
    other = shutil.copy(shut, tmp_path / "other" / "third.yaml")
    shutil.copy(shut.with_suffix(".pgm"), tmp_path / "other")
    with pytest.warns(mapdeal.MapdealWarning, match=r"findings of .*shut\.yaml"):
        (entry,) = entries_of(other, tmp_path / "lint.json")
    assert entry.items == ()


@pytest.mark.parametrize(("file", "found"), [
    ("maps/a/one.yaml", [0]),
    ("somewhere/a/one.yaml", [0]),
    ("b/one.yaml", [1]),
    ("aa/one.yaml", []),  # two runs of such a file, and neither is of that folder
    ("maps/two.yaml", [2]),
    ("two.pgm", [2]),
    ("", []),
])  # fmt: skip
def test_which_entries_a_name_is_of(file, found, tmp_path):
    drafts = [Draft(name, tmp_path / name) for name in ("a/one", "b/one", "two")]
    drafts[0].names.add("a/one.yaml")
    drafts[1].names.add("b/one.yaml")
    for draft in drafts[:2]:
        draft.files.add("one.yaml")
    drafts[2].files |= {"two.yaml", "two.pgm"}
    assert [drafts.index(one) for one in drafts_about(file, drafts)] == found


def test_a_diff_shows_both_maps_and_what_differs(command, rooms, shut, tmp_path):
    code, out, _ = command("diff", rooms, shut, "--json")
    assert code == 1
    (tmp_path / "diff.json").write_text(out)
    with Grids(DEFAULT_SETTINGS) as grids:
        (entry,) = gathered([tmp_path / "diff.json"], grids).entries
        difference = entry.layers[-1].values[:]
    assert [layer.name for layer in entry.layers] == ["first", "second", "difference"]
    assert entry.compared == ("first", "second")
    changed = mapdeal.read_map(rooms).occupancy != mapdeal.read_map(shut).occupancy
    added = next(value for value, name in entry.layers[-1].style.labels.items() if "added" in name)
    assert np.array_equal(difference == added, changed)
    (item,) = entry.items
    ((row, col),) = np.argwhere(changed)
    x, y = mapdeal.read_map(rooms).frame.xy_from_rowcol([(row, col)])[0]
    assert item.place == pytest.approx((x, y))
    assert item.text == f"wall added: 1 cell at {x:.6g}, {y:.6g}"


def test_groups_of_cells_that_differ_are_listed_by_size(command, tmp_path):
    before, after = np.zeros((30, 40), np.int8), np.zeros((30, 40), np.int8)
    before[3, 4:9] = 100  # gone
    after[20:22, 30] = after[22, 31] = 100  # touch over a corner
    after[10, 10] = 100
    for name, cells in (("before", before), ("after", after)):
        grid = mapdeal.OccupancyGrid(cells, 0.5, (2.0, -1.0, 0.3))
        mapdeal.write_map(tmp_path / f"{name}.yaml", grid)
    maps = tmp_path / "before.yaml", tmp_path / "after.yaml"
    (tmp_path / "diff.json").write_text(command("diff", *maps, "--json")[1])
    (entry,) = entries_of(tmp_path / "diff.json")
    assert [item.text.partition(" at ")[0] for item in entry.items] == [
        "wall added: 3 cells", "wall added: 1 cell", "wall removed: 5 cells"
    ]  # fmt: skip
    middles = [(21, 30), (10, 10), (3, 6)]
    places = [item.place for item in entry.items]
    assert np.allclose(places, grid.frame.xy_from_rowcol(middles))


def test_a_diff_of_maps_that_are_gone_or_changed_says_so(command, rooms, shut, tmp_path):
    (tmp_path / "diff.json").write_text(command("diff", rooms, shut, "--json")[1])
    mapdeal.write_map(shut, grid_from_text(ROOMS), force=True)
    with pytest.warns(mapdeal.MapdealWarning, match=r"shut\.yaml: is not the map that diff\.json"):
        (entry,) = entries_of(tmp_path / "diff.json")
    assert len(entry.layers) == 3
    rooms.unlink()
    with pytest.warns(mapdeal.MapdealWarning) as given:
        (entry,) = entries_of(tmp_path / "diff.json")
    assert "so this map is not shown" in str(given[0].message)
    assert [layer.name for layer in entry.layers] == ["second"]
    assert [text.partition(":")[0] for text in entry.warnings] == ["rooms.yaml", "shut.yaml"]


def test_a_score_is_a_table_of_the_map_that_it_names(command, rooms, shut, tmp_path):
    words = ("--min", "coverage=0.9", "--max", "dist_truth_to_est_m.mean=0.001")
    code, out, _ = command("score", rooms, "--truth", shut, *words, "--json")
    assert code == 1
    (tmp_path / "score.json").write_text(out)
    values = json.loads(out)["values"]
    for paths, owner in (((shut, rooms), 1), ((), 0)):
        entries = entries_of(*paths, tmp_path / "score.json")
        tables = [[table for table in one.tables if "Score" in table.title] for one in entries]
        assert [len(found) for found in tables] == [k == owner for k in range(len(entries))]
        (table,) = tables[owner]
        assert table.title == "Score: does not pass"
        rows = dict(table.rows)
        assert rows["truth"] == "shut.yaml"
        told = f"{100 * values['coverage']:.1f} %"
        assert rows["known area of the truth that the map knows (coverage)"] == told
        far = values["dist_truth_to_est_m"]["mean"]
        assert [text for name, text in table.rows if name == "bound"] == [
            f"coverage at least 0.9: holds, found {values['coverage']:.9g}",
            f"dist_truth_to_est_m.mean at most 0.001: missed, found {far:.9g}",
        ]
    assert entries[0].name == "rooms"


def test_the_score_of_a_map_that_is_not_here_is_left_out(command, rooms, shut, tmp_path):
    (tmp_path / "score.json").write_text(command("score", rooms, "--json")[1])
    mapdeal.write_map(tmp_path / "third.yaml", grid_from_text(ROOMS))
    with pytest.warns(mapdeal.MapdealWarning, match=r"score of .*rooms\.yaml is left out"):
        entries = entries_of(shut, tmp_path / "third.yaml", tmp_path / "score.json")
    assert not [table for one in entries for table in one.tables if "Score" in table.title]
    (one,) = entries_of(tmp_path / "score.json")
    rows = dict(next(table for table in one.tables if table.title == "Score").rows)
    assert rows["corners and ends of walls (corners)"].isdigit()
    assert "truth" not in rows


def test_a_map_that_has_changed_since_it_was_scored_is_told_of(command, rooms, tmp_path):
    (tmp_path / "score.json").write_text(command("score", rooms, "--json")[1])
    mapdeal.write_map(rooms, grid_from_text(SHUT), force=True)
    told = r"rooms\.yaml: is not the map that score\.json"
    with pytest.warns(mapdeal.MapdealWarning, match=told):
        (entry,) = entries_of(rooms, tmp_path / "score.json")
    assert any("score.json" in text for text in entry.warnings)


def test_an_alignment_shows_the_first_map_where_it_lies_on_the_second(command, tmp_path):
    here, there = Transform(-3.2, 11.7, 0.3), Transform(5.0, 2.0, 2.2)
    maps = tmp_path / "a.yaml", tmp_path / "b.yaml"
    for path, place in zip(maps, (here, there), strict=True):
        mapdeal.write_map(path, drawn(WALLS, 0.2, place))
    assert command("align", *maps, "-o", tmp_path / "t.json")[0] == 0
    (entry,) = entries_of(tmp_path / "t.json")
    assert entry.compared == ("first", "second")
    first, second = (layer.frame for layer in entry.layers)
    assert second == mapdeal.read_map(maps[1]).frame
    cell = mapdeal.read_map(maps[0]).frame.unbounded_rowcol_from_xy(here.points([[8.0, 6.0]]))
    moved = first.xy_from_rowcol(cell)
    assert np.hypot(*(moved - there.points([[8.0, 6.0]]))[0]) < 0.25
    alignment, *_ = entry.tables
    assert alignment.title == "Alignment"
    assert dict(alignment.rows)["same place"] == "yes"
    maps[0].unlink()
    with pytest.warns(mapdeal.MapdealWarning, match="so this map is not shown"):
        (entry,) = entries_of(tmp_path / "t.json")
    assert [layer.name for layer in entry.layers] == ["second"]
