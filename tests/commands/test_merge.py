import json
import math
import types
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mapdeal
from bad_maps import tree
from conftest import NO_TEST_DATA
from drawn import cells, grid_from_text
from mapdeal import OccupancyGrid, merge, read_map, write_map
from mapdeal.files.source import sha256_of
from mapdeal.maps.npz import write_npz
from mapdeal.pictures import colours

HALL = "#######\n#.....#\n#..#..#\n#######"
PART = "????#??\n?...#..\n?..#.?."


@pytest.fixture
def folder(here):
    """Maps of one frame: b.yaml is two columns and a row off, c.yaml has half the resolution."""
    first = grid_from_text(HALL, 0.1, (1.5, -2.0, 0.4))
    write_map("a.yaml", first)
    write_map("b.yaml", OccupancyGrid(cells(PART), 0.1, first.frame.window(1, 2, 3, 7).origin))
    write_map("c.yaml", grid_from_text("..\n#.", 0.2, (1.5, -2.0, 0.4)))
    return here


def maps(*names):
    return [read_map(f"{name}.yaml") for name in names]


def end(name):
    """Return the part of a document of align about one of its maps."""
    files = [Path(f"{name}.yaml"), Path(f"{name}.pgm")]
    return {"file": f"{name}.yaml", "sha256": {file.name: sha256_of(file) for file in files}}


def transform_file(name, transform, first=None, second=None):
    document = {"x": transform.x, "y": transform.y, "yaw": transform.yaw}
    if first:
        document = {"transform": document, "first": end(first), "second": end(second)}
    Path(name).write_text(json.dumps(document))
    return name


def same(name, expected):
    np.testing.assert_array_equal(read_map(name).occupancy, expected.grid.occupancy)


@pytest.mark.parametrize("rule", ["occupied", "newest"])
def test_maps_of_one_frame_are_merged(sh, folder, rule):
    for name in "ab":
        with open(f"{name}.yaml", "a") as file:
            file.write(f"building: hall {name}\n")
    out = sh.ok(f"merge a.yaml b.yaml c.yaml -o o.yaml --rule {rule}")
    expected = merge(maps("a", "b", "c"), rule=rule)
    same("o.yaml", expected)
    assert read_map("o.yaml").origin == expected.grid.origin
    assert "building: hall a\n" in Path("o.yaml").read_text()
    assert out.startswith("o.yaml: 9 x 4 cells at 1.5, -2, yaw 0.4, ")
    assert (f"{expected.kept} cells are from before it" in out) == (rule == "newest")


def test_the_printed_table_agrees_with_counts_by_hand(sh, folder):
    """Of a and b: HALL's columns 2.. and rows 1.. under PART's, cell by cell."""
    document = sh.json("merge a.yaml b.yaml -o o.yaml --same-wall 0 --json")
    # north to south, HALL above and PART below: "#####" ....#  known by both: 1, occupied in both
    #   "....#" .:  "?...#", the first column is unknown; the last is occupied in both
    #   ".#..#" :   "?..#.", occupied in a, free in b: columns 3, 6; the other way round: 5
    first, second = document["merged"]
    assert (document["rule"], document["common"], document["conflicts"]) == ("occupied", 9, 3)
    assert document["figures"]["width"] == 9
    counts = {"file": "a.yaml", "known": 28, "common": 9, "conflicts": 3, "occupied_here": 2,
              "free_here": 1}  # fmt: skip
    assert first.items() >= counts.items()
    assert first["sha256"].keys() == {"a.yaml", "a.pgm"}
    counts = {"file": "b.yaml", "known": 12, "occupied_here": 1, "free_here": 2, "walls": 3,
              "met": 3, "conflict_share": 3 / 9, "added": 3 + 1}  # fmt: skip
    assert second.items() >= counts.items()  # added: two columns in the east, and the wall
    assert second["transform"] == {"x": 0.0, "y": 0.0, "yaw": 0.0, "yaw_deg": 0.0}


STEP = mapdeal.Transform(0.7, -0.3, 0.9)
TURNED = mapdeal.Transform(-0.2, 0.5, -2.0)


@pytest.fixture
def expected(folder, monkeypatch):
    """As a, b and c, but b lies in a frame that STEP leads to, and c in one that TURNED does."""
    a, b, c = maps("a", "b", "c")
    for name, grid, transform in (("b", b, STEP), ("c", c, TURNED)):
        grid = OccupancyGrid(grid.occupancy, grid.resolution, transform.frame(grid.frame).origin)
        write_map(f"{name}.yaml", grid, force=True)
    nowhere = types.SimpleNamespace(same_place=False)  # no frame is proposed, which takes long
    monkeypatch.setattr("mapdeal.commands.two_maps.placed", lambda *_: nowhere)
    return merge([a, b, c])


TO_B, TO_C = ("s.json", STEP), ("o.json", TURNED)


@pytest.mark.parametrize("files", [
    [(*TO_B, ""), (*TO_C, "")], [(*TO_B, "ab"), ("o.json", TURNED.inverse(), "ca")]
], ids=["in order", "turned round"])  # fmt: skip
def test_transforms_of_files(sh, expected, files):
    options = [f"--by {transform_file(name, move, *ends)}" for name, move, ends in files]
    document = sh.json(f"merge a.yaml b.yaml c.yaml -o o.npz {' '.join(options)} --json")
    same("o.npz", expected)
    found = document["merged"][2]["transform"]
    assert (found["x"], found["y"], found["yaw"]) == pytest.approx(TURNED.pose)


def test_files_serve_python_as_they_do_the_shell(folder, expected):
    files = [transform_file("s.json", STEP), folder / transform_file("o.json", TURNED)]
    a, b, _ = maps("a", "b", "c")
    for sources, transforms in (
        (["a.yaml", b, folder / "c.yaml"], files), ([a, "b.yaml", "c.yaml"], [STEP, TURNED.pose])
    ):  # fmt: skip
        found = merge(sources, transforms=transforms)
        np.testing.assert_array_equal(found.grid.occupancy, expected.grid.occupancy)
        assert found.transforms == (mapdeal.Transform(), STEP, TURNED)


def test_checksums_of_no_map_are_warned_of_and_those_of_all_must_be_there(sh, expected):
    transform_file("s.json", STEP, "a", "c")
    message = "is between other maps: the checksums are not those of these two"
    assert sh.err("merge a.yaml b.yaml -o o.npz --by s.json") == f"warning: s.json: {message}\n"
    same("o.npz", merge(maps("a", "b"), transforms=[STEP]))
    message = "--by: must be 2, one for each map except the first, got 1"
    assert message in sh.err("merge a.yaml b.yaml c.yaml -o o.yaml --by s.json", 2)
    assert not Path("o.yaml").exists()


def replace_search(monkeypatch, *, same_place):
    """Return the list of pairs of maps that the replaced search is asked to align."""
    found = types.SimpleNamespace(same_place=same_place, transform=STEP, reason="another fits")
    pairs = []
    monkeypatch.setattr("mapdeal.compare.align.placed", lambda *pair: pairs.append(pair) or found)
    return pairs


def test_maps_are_aligned_to_the_first(sh, expected, monkeypatch):
    pairs = replace_search(monkeypatch, same_place=True)
    document = sh.json("merge a.yaml b.yaml -o o.npz --by align --json")
    ((first, second),) = pairs
    np.testing.assert_array_equal(first.occupancy, cells(HALL))
    np.testing.assert_array_equal(second.occupancy, cells(PART))
    assert document["merged"][1]["transform"]["x"] == STEP.x
    same("o.npz", merge(maps("a", "b"), transforms=[STEP]))


def test_a_map_that_is_perhaps_of_another_place_is_not_merged(sh, folder, monkeypatch):
    replace_search(monkeypatch, same_place=False)
    before = tree(folder)
    message = "b.yaml: its placement on a.yaml is uncertain: another fits"
    code, out, err = sh("merge a.yaml b.yaml -o o.yaml --by align")
    assert (code, out, err.splitlines()[0]) == (1, "", f"error: {message}")
    assert tree(folder) == before


def with_layers(name, grid, **layers):
    with open(name, "wb") as file:
        write_npz(file, grid, more=layers)


def test_evidence_of_build_is_summed(sh, folder):
    """Hits 2 of 3 beams of a, none of 9 of b: 2 of 12 is free; at the other cell 4 of 12."""
    grids = [OccupancyGrid([row], 0.1, (1.5, -2.0, 0.4)) for row in ([100, 100, 0], [0, 0, 0])]
    counts = [([[2, 4, 0]], [[1, 0, 5]]), ([[0, 0, 1]], [[9, 8, 9]])]
    for name, grid, (hits, misses) in zip("ab", grids, counts, strict=True):
        with_layers(f"{name}.npz", grid, hits=np.int32(hits), misses=np.int32(misses))
    line = "merge {} b.npz --rule evidence -o {}"
    assert sh(line.format("a.npz", "o.npz"))[0] == 0
    assert read_map("o.npz").occupancy.tolist() == [[0, 100, 0]]
    # 50, and hits times 7/3 less misses
    expected = [50 + 2 * 7 / 3 - 10, 50 + 4 * 7 / 3 - 8, 50 + 7 / 3 - 14]
    np.testing.assert_allclose(np.load("o.npz")["log_odds"], [expected])
    # a merged map can be merged: three give the same evidence in any order
    sh(line.format("o.npz", "p.npz"))
    three = merge(["a.npz", "b.npz", "b.npz"], rule="evidence")
    np.testing.assert_allclose(np.load("p.npz")["log_odds"], three.log_odds)


def test_a_map_without_evidence_is_warned_of(sh, folder):
    write_map("d.npz", read_map("a.yaml"))
    grid = read_map("b.yaml")
    with_layers("e.npz", grid, log_odds=np.full(grid.shape, 60.0))
    err = sh.err("merge e.npz d.npz --rule evidence -o o.npz")
    assert "warning: d.npz: has no evidence layers; each of its cells counts as one vote\n" in err


def test_the_picture_shows_conflicts(sh, folder):
    sh("merge a.yaml b.yaml -o o.yaml --same-wall 0 --image o.png --image-extent all")
    with Image.open("o.png") as image:
        shown = {colour for _, colour in image.convert("RGB").getcolors(1 << 20)}
    assert {colours.REMOVED, colours.ADDED, colours.RVIZ_OCCUPIED, colours.RVIZ_FREE} <= shown


def test_the_maps_of_one_floor_lie_on_each_other(sh, real_maps):
    """Three maps of it, of three robots and years, placed by transforms found otherwise."""
    place = real_maps / "align" / "PRBonn__tmcl"
    if not place.is_dir():
        pytest.skip(NO_TEST_DATA)
    real = json.loads((real_maps / "expected" / "align.json").read_text())["real"]
    truth = {entry["id"]: entry["truth"] for entry in real}
    files = ""
    for name in ("tmcl-youbot-faro", "tmcl-youbot-gmap"):
        yaw = math.radians(truth[name]["dtheta_deg"])
        transform = mapdeal.Transform(truth[name]["dx"], truth[name]["dy"], yaw)
        files += f" --by {transform_file(f'{name}.json', transform)}"
    names = ["2021_10_27/YouBotMap.yaml", "Faro/FMap.yaml", "GMap/GMap.yaml"]
    first, second, third = (place / name for name in names)
    counts = json.loads(sh.ok(f"merge {first} {second} {third} -o o.npz {files} --json"))
    assert all(count["met"] > 0.85 * count["walls"] for count in counts["merged"])
    # and as their own walls place them
    found = json.loads(sh.ok(f"merge {third} {first} -o q.npz --by align --json"))
    found = found["merged"][1]["transform"]
    placed_by_walls = mapdeal.Transform(found["x"], found["y"], found["yaw"]).after(transform)
    assert placed_by_walls.pose == pytest.approx((0, 0, 0), abs=0.1)
    # in one frame they do not, and it is said
    err = sh.err(f"merge {first} {third} -o p.npz")
    assert "do not lie in one frame" in err
    assert "--by align places maps by their walls" in err
