import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

import mapdeal
from drawn import grid_from_text
from mapdeal import OccupancyGrid, read_map, write_map

SQUARE = "inflate --radius 0.1 --kernel square --lethal-threshold 50"


def by_square(grid):
    options = {"kernel": "square", "lethal_threshold": 50, "inflate_unknown": False}
    return mapdeal.inflate(grid, radius=0.1, **options)


AS_IN_PYTHON = {
    f"{SQUARE} --no-inflate-unknown": by_square,
    f"{SQUARE} --inflate-unknown no": by_square,
    "active --margin 0.1": lambda grid: mapdeal.active_region(grid, margin=0.1),
    "clean --min-obstacle 2": lambda grid: mapdeal.clean(grid, min_obstacle=2).grid,
    "rotate --yaw 0": mapdeal.rotate,
    "rotate --yaw -1.2 --rule nearest": lambda grid: mapdeal.rotate(grid, -1.2, rule="nearest"),
    "rotate --straighten": mapdeal.straighten,
    "rescale --resolution 0.25": lambda grid: mapdeal.rescale(grid, 0.25),
    "rescale --resolution 0.05": lambda grid: mapdeal.rescale(grid, 0.05),
    "shift --origin 1.62,-1.71 --default 0": lambda grid: mapdeal.shift_origin(
        grid, (1.62, -1.71), default=0
    ),
    "window --at 1.75,-1.85 --size 0.3,0.3": lambda grid: mapdeal.window(
        grid, center_xy=(1.75, -1.85), size_xy=(0.3, 0.3)
    ),
    "esdf --convention border": lambda grid: mapdeal.esdf(grid, convention="border"),
    "cost --model rings --values 80,40": lambda grid: mapdeal.ring_cost(grid, values=(80, 40)),
}


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("line", AS_IN_PYTHON)
def test_a_command_writes_what_its_function_makes(sh, room, line):
    assert sh(f"{line} room.yaml -o o.npz")[0] == 0
    found, expected = read_map("o.npz"), AS_IN_PYTHON[line](room)
    assert (type(found), found.frame) == (type(expected), expected.frame)
    np.testing.assert_array_equal(found.layer, expected.layer)


def test_the_results_of_a_turn_and_another_resolution_are_printed(sh, room):
    written, *lines = sh.ok("rotate room.yaml -o o.yaml --yaw 0").splitlines()
    assert re.match(r"o.yaml: \d+ x \d+ cells at 1.3, -2, occupied ", written)
    baked = "the yaw of the origin, 0.4 rad (22.9183 degrees), is now in the cells"
    assert lines == [baked, "all walls stay where they are"]
    assert baked not in sh.ok("rotate o.yaml -o q.yaml --yaw 0")
    assert yaml.safe_load(Path("o.yaml").read_text())["origin"] == [1.3, -2.0, 0.0]
    out = sh.ok("rotate room.yaml -o p.npz --yaw -1.2")
    assert f"{baked}\nturned by -1.2 rad (-68.7549 degrees) about x 0, y 0" in out
    out = sh.ok("rescale room.yaml -o r.yaml --resolution 0.25")
    assert out.startswith("r.yaml: 4 x 2 cells at 1.5, -2, yaw 0.4, occupied ")
    write_map("empty.yaml", room.with_values(np.zeros_like(room.occupancy)))
    line = "warning: rotate: no direction of walls stands out, the map is not turned\n"
    assert sh.err("rotate empty.yaml -o e.yaml --straighten") == line
    assert read_map("e.yaml").frame == room.frame


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("words", ["rotate --yaw 1", "rescale --resolution 0.3"])
def test_costs_stay_costs(sh, room, words):
    costs = np.where(room.occupancy < 0, 255, room.occupancy * 2.54).astype(np.uint8)
    write_map("c.npz", mapdeal.Costmap(costs, 0.1, room.origin))
    assert sh(f"{words} c.npz -o o.npz")[0] == 0
    assert {0, 254} <= set(read_map("o.npz").cost.ravel().tolist()) <= {0, 254, 255}


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


def test_costs_in_both_encodings(sh, room):
    sh("cost room.yaml -o o.yaml")
    assert "warning: " in sh.err("cost room.yaml -o b.yaml --encoding costmap2d")
    costs = read_map("b.yaml")
    assert costs.scale == "costmap2d"
    assert np.array_equal(read_map("o.yaml").occupancy, costs.to_occupancy().occupancy)


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


def test_convert_between_all_formats_keeps_cells_and_unknown_keys(sh, room):
    with open("room.yaml", "a") as file:
        file.write("height: 0.5\n")
    for source, target in [("room.yaml", "b.png"), ("b.yaml", "c.npz"), ("c.npz", "d.yaml")]:
        assert sh(f"convert {source} -o {target}")[0] == 0
        read = read_map(target.replace(".png", ".yaml"))
        assert np.array_equal(read.occupancy, room.occupancy)
        assert read.origin == room.origin
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
    # row, column, height and width of what is known
    walls = "?????\n?.???\n???#?\n?????\n?????"
    for drawing, box in ((walls, [2, 1, 2, 3]), ("??\n??", None), ("?+", [0, 1, 1, 1])):
        write_map("m.npz", grid_from_text(drawing), force=True)
        assert sh.json("info m.npz --json")["known_box"] == box


def test_quiet_says_nothing_verbose_more_and_costs_as_a_map_are_warned_of(sh, room):
    assert sh("inflate room.yaml -o a.yaml -q") == (0, "", "")
    code, out, err = sh("inflate room.yaml -o b.yaml -v")
    assert (code, "b.yaml" in out, "radius" in err) == (0, True, True)
    sh("cost room.yaml -o c.npz")
    assert "contains costs" in sh.err("inflate c.npz -o i.npz")


def test_convert_prints_the_counts_of_its_output(sh):
    write_map("raw.yaml", OccupancyGrid([[0, 20, 50, 80]], 0.25))
    _, out, err = sh("convert raw.yaml -o t.yaml --mode trinary")
    assert "3 values" in err
    assert "occupied 25.00 %, free 50.00 %, unknown 25.00 %" in out
    assert read_map("t.yaml").occupancy.tolist() == [[0, 0, -1, 100]]


SHAPE = "[[0.3,0.2],[-0.3,0.2],[-0.3,-0.2],[0.3,-0.2]]"
ROBOT = f"--footprint {SHAPE} --inflation-radius 0.55"


def test_the_picture_is_that_of_the_python_face(sh, room):
    out = sh.ok(f"cost room.yaml -o c.npz {ROBOT} --lookup nav2 --curve new/curve.png")
    assert out.startswith("c.npz: 8 x 4 cells")
    footprint = mapdeal.Footprint.parse(SHAPE)
    curve = mapdeal.cost_curve(room, footprint=footprint, inflation_radius=0.55, lookup="nav2")
    title = "room: cost, inscribed 0.2 m, inflation 0.55 m, factor 10"
    drawn = mapdeal.draw_picture(curve, title=title)
    assert Path("new/curve.png").read_bytes() == drawn.png() != curve._repr_png_()


@pytest.mark.parametrize(("words", "model"), [
    (ROBOT, "exponential"),
    ("--model rings --values 90,20", "rings"),
    ("--model threshold --view per-map", "threshold"),
])  # fmt: skip
@pytest.mark.usefixtures("mapdeal_warnings")
def test_json_is_one_document(sh, here, room, words, model):
    document = json.loads(sh.ok(f"cost room.yaml -o c.npz --json -q {words}"))
    grid = read_map("c.npz")
    assert document["figures"] == grid.figures()
    assert document["parameters"]["model"] == model
    parameters = {k: v for k, v in document["parameters"].items() if k != "lethal_threshold"}
    curve = mapdeal.cost_curve(room, **parameters)
    assert {k: document[k] for k in curve.document()} == curve.document()
    assert document["cost_scale"] == grid.scale
    assert document["circumscribed_cost"] == grid.circumscribed_cost
    assert not list(here.glob("*.png"))
