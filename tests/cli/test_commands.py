import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from drawn import grid_from_text
from mapdeal import OccupancyGrid, inflate, read_map, write_map

ROOM = "........\n.#......\n......?.\n...##..."


@pytest.fixture
def room(here):
    write_map("room.yaml", grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.4)))
    return read_map("room.yaml")


@pytest.mark.parametrize("flag", ["--no-inflate-unknown", "--inflate-unknown no"])
def test_parameters_reach_their_stage(sh, room, flag):
    sh(f"inflate room.yaml -o a.npz --radius 0.1 --kernel square --lethal-threshold 50 {flag}")
    expected = inflate(
        room, radius=0.1, kernel="square", lethal_threshold=50, inflate_unknown=False
    )
    assert np.array_equal(read_map("a.npz").occupancy, expected.occupancy)


def test_the_field_as_npz_view_and_bare_array(sh, room):
    for name in ("e.npz", "v.yaml", "b.npy"):
        assert sh(f"esdf room.yaml -o {name} --convention border")[0] == 0
    assert np.array_equal(np.load("b.npy"), read_map("e.npz").distance)
    about = yaml.safe_load(Path("b.yaml").read_text())
    assert (about["resolution"], about["origin"]) == (0.1, [1.5, -2.0, 0.4])
    assert about["convention"] == "border"
    assert yaml.safe_load(Path("v.yaml").read_text())["mode"] == "raw"
    view = read_map("v.yaml").occupancy
    assert (view.max(), view[0, 3], view[1, 6]) == (100, 100, -1)


def test_costs_in_both_encodings_and_models(sh, room):
    sh("cost room.yaml -o o.yaml")
    assert "warning: " in sh.err("cost room.yaml -o b.yaml --encoding costmap2d")
    costs = read_map("b.yaml")
    assert costs.scale == "costmap2d"
    assert np.array_equal(read_map("o.yaml").occupancy, costs.to_occupancy().occupancy)
    sh("cost room.yaml -o r.npz --model rings --values 80,40")
    rings = read_map("r.npz")
    assert rings.scale == "occupancy"
    assert set(np.unique(rings.cost).tolist()) == {0, 40, 80, 100}


def test_a_robot_s_shape_sets_the_radii_and_reports_the_circumscribed_cost(sh, room):
    shape = "--footprint [[0.3,0.4],[0.3,-0.4],[-0.3,-0.4],[-0.3,0.4]]"
    # trunc(252 exp(-10 (0.5 - 0.3))) is 34
    assert "circumscribed_cost 34" in sh(f"cost room.yaml -o c.npz {shape} --inflation-radius 1")[1]
    assert int(np.load("c.npz")["circumscribed_cost"]) == 34
    found = []
    for words in (shape, "--radius 0.5", "--robot-radius 0.45 --footprint-padding 0.05"):
        sh(f"inflate room.yaml -o i.npz --force {words}")
        found.append(read_map("i.npz").occupancy.tolist())
    assert found[0] == found[1] == found[2]


def test_convert_between_all_formats_keeps_cells_and_unknown_keys(sh, here):
    grid = grid_from_text(ROOM)
    write_map("a.yaml", grid)
    with open("a.yaml", "a") as file:
        file.write("height: 0.5\n")
    for source, target in [("a.yaml", "b.png"), ("b.yaml", "c.npz"), ("c.npz", "d.yaml")]:
        assert sh(f"convert {source} -o {target}")[0] == 0
        read = read_map(target.replace(".png", ".yaml"))
        assert np.array_equal(read.occupancy, grid.occupancy)
        assert read.origin == grid.origin
    assert yaml.safe_load(Path("b.yaml").read_text())["height"] == 0.5


def test_info_as_text_and_as_json(sh, room):
    report = json.loads(sh.ok("info room.yaml --json"))
    assert (report["width"], report["height"], report["resolution"]) == (8, 4, 0.1)
    assert (report["occupied"], report["unknown"], report["free"]) == (3, 1, 28)
    assert (report["origin"], report["known_box"]) == ([1.5, -2.0, 0.4], [0, 0, 4, 8])
    assert sh.ok("info room.yaml room.yaml").count("sha256") == 2
    sh("esdf room.yaml -o e.npz --max-distance 0.5 --unknown occupied")
    report = sh.json("info e.npz --json")
    assert report["kind"] == "distance field"
    assert (report["max_distance"], report["unknown"]) == (0.5, "occupied")
    assert "max_distance 0.5 m" in sh.ok("info e.npz")


@pytest.mark.parametrize(
    ("drawing", "box"),
    [("?????\n?.???\n???#?\n?????\n?????", [2, 1, 2, 3]), ("??\n??", None), ("?+", [0, 1, 1, 1])],
)
def test_info_gives_row_column_height_and_width_of_what_is_known(sh, drawing, box):
    write_map("m.npz", grid_from_text(drawing))
    assert sh.json("info m.npz --json")["known_box"] == box


def test_quiet_says_nothing_and_verbose_more(sh, room):
    assert sh("inflate room.yaml -o a.yaml -q") == (0, "", "")
    code, out, err = sh("inflate room.yaml -o b.yaml -v")
    assert (code, "b.yaml" in out, "radius" in err) == (0, True, True)


def test_costs_that_are_passed_as_a_map_are_warned_of(sh, room):
    sh("cost room.yaml -o c.npz")
    assert "contains costs" in sh.err("inflate c.npz -o i.npz")


def test_convert_tells_what_it_wrote_not_what_it_read(sh):
    write_map("raw.yaml", OccupancyGrid([[0, 20, 50, 80]], 0.25))
    _, out, err = sh("convert raw.yaml -o t.yaml --mode trinary")
    assert "3 values" in err
    assert "occupied 25.00 %, free 50.00 %, unknown 25.00 %" in out
    assert read_map("t.yaml").occupancy.tolist() == [[0, 0, -1, 100]]
