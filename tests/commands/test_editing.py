from pathlib import Path

import numpy as np
import pytest
import yaml

import mapdeal
import states
from drawn import cells, grid_from_text
from mapdeal import BitMap, Costmap, exponential_cost, read_map, write_map


@pytest.fixture(autouse=True)
def room(here):
    """A map that lies straight: cell (row, col) begins at (1.5 + col / 10, -2 + row / 10)."""
    drawing = "........\n.#......\n......?.\n...##..."
    write_map("room.yaml", grid_from_text(drawing, 0.1, (1.5, -2.0, 0.0)))
    write_map("costs.npz", Costmap(np.full((4, 8), 9, np.uint8), 0.1, (1.5, -2.0, 0.0)))
    return read_map("room.yaml")


def occupancy(name):
    return read_map(name).occupancy.tolist()


def test_a_polygon_by_its_points_and_a_region_without_a_value(sh):
    line = "edit polygon room.yaml --value 100 --point"
    out = sh.ok(f"{line} 1.51,-1.99 1.75,-1.99 1.75,-1.81 --point 1.51,-1.81 -o o.yaml")
    assert occupancy("o.yaml") == cells("........\n.#......\n###...?.\n#####...").tolist()
    assert yaml.safe_load(Path("o.yaml").read_text())["mode"] == "trinary"
    assert "8 x 4 cells" in out
    sh("edit reset room.yaml -o a.yaml --corner 1.6,-1.9 --size 0.2,0.1")
    assert occupancy("a.yaml") == cells("........\n.#......\n.??...?.\n...##...").tolist()


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_line_circles_and_a_region_on_costs(sh):
    sh("edit line costs.npz -o l.npz --point 1.55,-1.95 --point=2.25,-1.95 --value 255")
    assert read_map("l.npz").cost.tolist() == [[255] * 8] + [[9] * 8] * 3
    sh("convert costs.npz -o b.yaml --encoding costmap2d")  # bytes are read and written as bytes
    sh("edit circle b.yaml -o c.yaml --point 1.65,-1.85 2.15,-1.75 --radius 0.1 --value 253")
    found = read_map("c.yaml")
    assert (found.scale, np.argwhere(found.cost == 253).tolist()) == ("costmap2d", [
        [0, 1], [1, 0], [1, 1], [1, 2], [1, 6], [2, 1], [2, 5], [2, 6], [2, 7], [3, 6],
    ])  # fmt: skip
    sh("edit reset costs.npz -o r.npz --corner 1.6,-1.9 --size 0.2,0.1")
    assert read_map("r.npz").cost[1].tolist() == [9, 255, 255, 9, 9, 9, 9, 9]
    sh("edit reset costs.npz -o s.npz --at 1.7,-1.85 --size 0.2,0.1 --value 0")
    assert read_map("s.npz").cost[1].tolist() == [9, 0, 0, 9, 9, 9, 9, 9]


@pytest.mark.parametrize(("overlay", "circles"), [("seq", 50), ("max", 60)])
def test_the_shapes_of_a_file_with_one_more_on_top(sh, overlay, circles):
    Path("zones.yaml").write_text(
        "shapes:\n"
        "- {type: polygon, points: [[1.5, -2], [2.2, -2], [2.2, -1.7], [1.5, -1.7]], value: 60}\n"
        "- {type: circle, center: [1.55, -1.95], radius: 0.01}\n"
    )
    line = "edit circle room.yaml -o o.npz --blank --background -1 --file zones.yaml --value 50"
    sh.ok(f"{line} --point 2.15,-1.65 --radius 0.02 --overlay {overlay}")
    expected = np.full((4, 8), 60)
    expected[0, 0] = expected[3, 6] = circles
    assert occupancy("o.npz") == expected.tolist()


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize(
    ("more", "values"), [("--value 80", {0, 80}), ("--background -1 --value 100", {-1, 100})]
)
def test_a_mask_drawn_on_a_blank_grid_is_laid_over_the_costs(sh, room, more, values):
    sh(f"edit circle room.yaml -o mask.yaml --blank --point 2.0,-1.8 --radius 0.15 {more}")
    drawn = read_map("mask.yaml")
    assert set(np.unique(drawn.occupancy).tolist()) == values
    err = sh.err("cost room.yaml -o c.npz --mask mask.yaml")
    plain = exponential_cost(room)
    assert np.array_equal(read_map("c.npz").cost, mapdeal.apply_keepout_mask(plain, drawn).cost)
    if 80 in values:
        assert "1 unknown cells became free" in err
        assert yaml.safe_load(Path("mask.yaml").read_text())["mode"] == "raw"


def test_a_mask_on_costs_of_the_other_scale(sh):
    sh("edit reset room.yaml -o m.npz --blank --corner 1.5,-2 --size 0.2,0.2 --value 99")
    sh("cost room.yaml -o c.yaml --model rings --mask m.npz")
    assert (read_map("c.yaml").occupancy[:2, :2] == 99).all()


def test_window_and_shift_tell_where_they_end_up(sh):
    with open("room.yaml", "a") as file:
        file.write("height: 0.5\n")
    out = sh.ok("window room.yaml -o w.yaml --at 1.75,-1.85 --size 0.3,0.3")
    assert "3 x 3 cells at 1.6, -2, " in out
    assert yaml.safe_load(Path("w.yaml").read_text())["height"] == 0.5  # which is no key of ROS
    assert "at 1.6, -2.3, " in sh("shift room.yaml -o s.yaml --origin 1.62,-2.21 --default 0")[1]
    sh("window room.yaml -o w.npz --corner 2.2,-1.7 --size 0.2,0.1 --default 7")
    assert occupancy("w.npz") == [[0, 7]]


def test_a_yaw_is_honoured_by_every_command(sh):
    write_map("m.yaml", grid_from_text("....\n....\n....", 0.1, (1.5, -2.0, 0.4)))
    x, y = read_map("m.yaml").frame.xy_from_rowcol([[1, 2]])[0]
    sh(f"edit circle m.yaml -o c.yaml --point {x},{y} --radius 0.01 --value 100")
    sh(f"edit reset m.yaml -o r.yaml --at {x},{y} --size 0.1,0.1 --value 100")
    for name in ("c.yaml", "r.yaml"):
        assert np.argwhere(read_map(name).occupancy).tolist() == [[1, 2]]
    assert "yaw 0.4" in sh(f"window c.yaml -o w.yaml --at {x},{y} --size 0.1,0.1")[1]
    assert occupancy("w.yaml") == [[100]]
    sh(f"shift c.yaml -o s.yaml --origin {x},{y}")
    assert occupancy("s.yaml")[0][0] == 100


def test_the_obstacles_in_bits_and_back(sh, room):
    code, out, err = sh("pack room.yaml -o b.pbm")
    assert (code, "1 unknown cells" in err, "occupied 9.38 %" in out) == (0, True, True)
    assert np.array_equal(mapdeal.read_bit_map("b.pbm").packed, BitMap.from_occupancy(room).packed)
    line = "--point 1.75,-1.85 --radius 0.02 --value 100 -o x.pbm"
    assert "only an edited .pbm can be written as one" in sh.err(f"edit circle room.yaml {line}", 2)
    sh.ok(f"edit circle b.pbm {line}")
    assert mapdeal.read_bit_map("x.pbm").count() == mapdeal.read_bit_map("b.pbm").count() + 1
    assert sh("unpack b.pbm -o u.yaml")[0] == 0
    grid = read_map("u.yaml")
    assert np.array_equal(grid.occupancy, np.maximum(room.occupancy, 0))
    assert (grid.resolution, grid.origin) == (0.1, (1.5, -2.0, 0.0))
    sh("esdf room.yaml -o e.npz --unknown occupied")
    sh.ok("pack e.npz -o e.pbm")  # a field keeps the obstacles that it was computed with
    assert mapdeal.read_bit_map("e.pbm").count() == 4


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize(("options", "expected"), [
    ("", [0, 3, 127, 251, 254, 255]),  # round(2.54 v)
    ("--static-layer", [0, 0, 0, 253, 254, 255]),
    ("--static-layer --no-trinary-costmap", [0, 2, 127, 253, 254, 255]),
    ("--static-layer --lethal-threshold 50", [0, 0, 254, 253, 254, 255]),
    ("--static-layer --no-track-unknown", [0, 0, 0, 253, 254, 0]),
    ("--static-layer --inscribed-value none", [0, 0, 0, 0, 254, 255]),
    ("--static-layer --inscribed-value 50", [0, 0, 253, 0, 254, 255]),
])  # fmt: skip
def test_a_map_as_costs(sh, options, expected):
    write_map("m.yaml", mapdeal.OccupancyGrid([[0, 1, 50, 99, 100, -1]], 0.25))
    assert sh(f"convert m.yaml -o c.npz --encoding costmap2d {options}")[0] == 0
    found = read_map("c.npz")
    assert (found.scale, found.cost.tolist()) == ("costmap2d", [expected])


def test_costs_as_ros_publishes_them_and_as_amcl_sees_them(sh):
    stored = Costmap([[0, 1, 128, 253, 254, 255]], 0.25, (1.5, -2.0, 0.4))
    write_map("c.npz", stored)
    sh.ok("convert c.npz -o o.npz --encoding occupancy")
    published = read_map("o.npz")
    assert (published.scale, published.cost.tolist()) == ("occupancy", [[0, 1, 50, 99, 100, -1]])
    for name in ("a.npz", "a.yaml"):
        sh(f"convert c.npz -o {name} --encoding amcl")
        assert occupancy(name) == [[0, -1, -1, -1, 100, -1]]
        assert read_map(name).origin == stored.origin
    assert np.load("a.npz")["amcl"].tolist() == [[-1, 0, 0, 0, 1, 0]]
    sh("convert o.npz -o b.npz --encoding costmap2d")
    assert read_map("b.npz").cost.tolist() == [[0, 3, 127, 251, 254, 255]]
    sh.ok("convert c.npz -o d.npz --encoding costmap2d")  # as they are
    assert read_map("d.npz").cost.tolist() == stored.cost.tolist()


def test_the_trajectory_of_a_state_is_converted_to_poses(sh):
    graph = states.pose_graph({(0, 0): (0, 0, 0)}, [(0, 0.5, 1, 2, 0), (0, 1.5, 1, 3, 0)])
    Path("s.pbstream").write_bytes(states.state(graph, states.submap(states.random_cells(4, 5))))
    assert sh("convert s.pbstream -o p.txt")[:2] == (0, "p.txt: 2 poses of s.pbstream\n")
    assert np.loadtxt("p.txt")[:, 1:3].tolist() == [[1, 2], [1, 3]]


def test_a_round_robot_as_costmap_2d_has_it(sh):
    sh("cost room.yaml -o c.npz --robot-radius 0.2")
    sh("cost room.yaml -o p.npz --robot-radius 0.2 --robot-16-gon")
    circle, polygon = read_map("c.npz"), read_map("p.npz")
    assert np.count_nonzero(circle.cost == 253) > np.count_nonzero(polygon.cost == 253)
    assert (circle.circumscribed_cost, polygon.circumscribed_cost < 253) == (253, True)
