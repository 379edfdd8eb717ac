"""The commands that change a map, from file to file."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import mapdeal
from drawn import cells, grid_from_text
from mapdeal import BitMap, Costmap, Polygon, exponential_cost, read_map, write_map

ROOM = "........\n.#......\n......?.\n...##..."


@pytest.fixture
def room(here):
    """A map that lies straight: cell (row, col) begins at (1.5 + col / 10, -2 + row / 10)."""
    write_map("room.yaml", grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.0)))
    return read_map("room.yaml")


@pytest.fixture
def costs(here):
    write_map("costs.npz", Costmap(np.full((4, 8), 9, np.uint8), 0.1, (1.5, -2.0, 0.0)))


def occupancy(name):
    return read_map(name).occupancy.tolist()


def test_a_polygon_by_its_points(sh, room):
    out = sh.ok(
        "edit polygon room.yaml -o o.yaml --value 100"
        " --point 1.51,-1.99 --point 1.75,-1.99 --point 1.75,-1.81 --point 1.51,-1.81"
    )
    assert occupancy("o.yaml") == cells("........\n.#......\n###...?.\n#####...").tolist()
    assert yaml.safe_load(Path("o.yaml").read_text())["mode"] == "trinary"
    assert "8 x 4 cells" in out


@pytest.mark.usefixtures("mapdeal_warnings", "costs")
def test_a_line_and_circles_on_costs(sh):
    sh("edit line costs.npz -o l.npz --point 1.55,-1.95 --point=2.25,-1.95 --value 255")
    assert read_map("l.npz").cost.tolist() == [[255] * 8] + [[9] * 8] * 3
    sh("edit circle costs.npz -o c.npz --point 1.65,-1.85 --point 2.15,-1.75 --radius 0.1"
       " --value 253")  # fmt: skip
    found = read_map("c.npz")
    assert np.argwhere(found.cost == 253).tolist() == [
        [0, 1], [1, 0], [1, 1], [1, 2], [1, 6], [2, 1], [2, 5], [2, 6], [2, 7], [3, 6],
    ]  # fmt: skip
    assert found.scale == "costmap2d"


def test_the_shapes_of_a_file_with_one_more_on_top(sh, room):
    Path("zones.yaml").write_text(
        "shapes:\n"
        "- {type: polygon, points: [[1.5, -2], [2.2, -2], [2.2, -1.7], [1.5, -1.7]], value: 60}\n"
        "- {type: circle, center: [1.55, -1.95], radius: 0.01}\n"
    )
    sh.ok("edit circle room.yaml -o o.npz --file zones.yaml --value 100 --point 2.25,-1.65"
          " --radius 0.02")  # fmt: skip
    expected = np.full((4, 8), 60)
    expected[0, 0] = expected[3, 7] = 100
    assert occupancy("o.npz") == expected.tolist()


CIRCLE = "edit circle room.yaml -o mask.yaml --blank --point 2.0,-1.8 --radius 0.15"


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_mask_drawn_on_a_blank_grid_is_laid_over_the_costs(sh, room):
    assert sh(f"{CIRCLE} --value 80")[0] == 0
    assert yaml.safe_load(Path("mask.yaml").read_text())["mode"] == "raw"
    drawn = read_map("mask.yaml")
    assert set(np.unique(drawn.occupancy).tolist()) == {0, 80}
    assert "1 unknown cells became free" in sh.err("cost room.yaml -o c.npz --mask mask.yaml")
    plain = exponential_cost(room)
    assert np.array_equal(read_map("c.npz").cost, mapdeal.apply_keepout_mask(plain, drawn).cost)
    assert (read_map("c.npz").cost[drawn.occupancy == 80] >= 203).all()


def test_a_mask_that_is_unknown_outside_of_its_shapes_changes_nothing_there(sh, room):
    sh(f"{CIRCLE} --background -1 --value 100")
    drawn = read_map("mask.yaml").occupancy
    assert set(np.unique(drawn).tolist()) == {-1, 100}
    sh.ok("cost room.yaml -o c.npz --mask mask.yaml")
    expected = exponential_cost(room).cost.copy()
    expected[drawn == 100] = 254
    assert np.array_equal(read_map("c.npz").cost, expected)


def test_a_mask_on_costs_of_the_other_scale(sh, room):
    sh("edit reset room.yaml -o mask.npz --blank --corner 1.5,-2 --size 0.2,0.2 --value 99")
    assert sh("cost room.yaml -o c.yaml --model rings --mask mask.npz")[0] == 0
    assert (read_map("c.yaml").occupancy[:2, :2] == 99).all()


@pytest.mark.parametrize("output", ["zones.yaml", "link.yaml", "zones.pgm", "mask.npz"])
def test_shapes_and_masks_are_inputs_that_no_output_may_replace(sh, room, output):
    zones, mask = Path("zones.yaml"), Path("mask.npz")
    zones.write_text("shapes:\n- {type: circle, center: [2, -1.8], radius: 0.1, value: 100}\n")
    Path("link.yaml").symlink_to(zones)
    sh("convert room.yaml -o mask.npz")
    before = zones.read_bytes(), mask.read_bytes()
    words = "cost room.yaml --mask" if output == "mask.npz" else "edit circle room.yaml --file"
    source = mask if output == "mask.npz" else zones
    err = sh.err(f"{words} {source} -o {output} --force", 4)
    assert "the output is the input" in err
    assert (zones.read_bytes(), mask.read_bytes()) == before


@pytest.mark.usefixtures("mapdeal_warnings", "room", "costs")
def test_a_reset_region_is_unknown_unless_a_value_is_given(sh):
    sh("edit reset room.yaml -o a.yaml --corner 1.6,-1.9 --size 0.2,0.1")
    assert occupancy("a.yaml") == cells("........\n.#......\n.??...?.\n...##...").tolist()
    sh("edit reset costs.npz -o b.npz --corner 1.6,-1.9 --size 0.2,0.1")
    assert read_map("b.npz").cost[1].tolist() == [9, 255, 255, 9, 9, 9, 9, 9]
    sh("edit reset costs.npz -o c.npz --at 1.7,-1.85 --size 0.2,0.1 --value 0")
    assert read_map("c.npz").cost[1].tolist() == [9, 0, 0, 9, 9, 9, 9, 9]


def test_clipping_is_a_warning_or_a_finding(sh, room):
    line = "edit polygon room.yaml -o o.yaml --value 100 --point 2.0,-1.9 9,-1.9 2.0,-1.7"
    code, out, err = sh(f"{line} --strict")
    assert (code, out) == (1, "")
    assert err.startswith("warning: polygon: vertex 2")
    assert err.endswith("error: 1 warning, and --strict allows none; nothing was written\n")
    assert not Path("o.yaml").exists()
    err = sh.err(line)
    assert err.count("warning: ") == err.count("\n") == 1
    with pytest.warns(UserWarning, match="clipped"):
        expected = mapdeal.draw(room, Polygon([(2.0, -1.9), (9, -1.9), (2.0, -1.7)]), value=100)
    assert np.array_equal(read_map("o.yaml").occupancy, expected.occupancy)


def test_window_and_shift_tell_where_they_end_up(sh, room):
    out = sh.ok("window room.yaml -o w.yaml --at 1.75,-1.85 --size 0.3,0.3")
    assert "3 x 3 cells at 1.6, -2, " in out
    expected = mapdeal.window(room, center_xy=(1.75, -1.85), size_xy=(0.3, 0.3))
    assert np.array_equal(read_map("w.yaml").occupancy, expected.occupancy)
    assert read_map("w.yaml").origin == (1.6, -2.0, 0.0)
    _, out, _ = sh("shift room.yaml -o s.yaml --origin 1.62,-2.21 --default 0")
    assert "at 1.6, -2.3, " in out
    expected = mapdeal.shift_origin(room, (1.62, -2.21), default=0)
    assert np.array_equal(read_map("s.yaml").occupancy, expected.occupancy)


def test_what_lies_beyond_the_map_can_have_a_value(sh, room):
    sh("window room.yaml -o w.npz --corner 2.2,-1.7 --size 0.2,0.1 --default 7")
    assert occupancy("w.npz") == [[0, 7]]


@pytest.mark.parametrize(
    ("overlay", "row"), [("seq", [60, 80, 80, 20, 20, 20]), ("max", [60, 80, 80, 80, 80, 20])]
)
def test_which_of_two_zones_wins(sh, room, overlay, row):
    Path("zones.yaml").write_text(
        "shapes:\n"
        "- {type: line, points: [[1.55, -1.95], [1.75, -1.95]], value: 60}\n"
        "- {type: line, points: [[1.65, -1.95], [1.95, -1.95]], value: 80}\n"
        "- {type: line, points: [[1.85, -1.95], [2.05, -1.95]], value: 20}\n"
    )
    line = "edit line room.yaml -o o.npz --blank --background -1 --file zones.yaml --overlay"
    assert sh(f"{line} {overlay}")[0] == 0
    assert occupancy("o.npz")[0] == [*row, -1, -1]


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
    assert sh("unpack b.pbm -o u.yaml")[0] == 0
    grid = read_map("u.yaml")
    assert np.array_equal(grid.occupancy, np.maximum(room.occupancy, 0))
    assert (grid.resolution, grid.origin) == (0.1, (1.5, -2.0, 0.0))


def test_packing_a_field_takes_what_it_counts_as_obstacles(sh, room):
    sh("esdf room.yaml -o e.npz --unknown occupied")
    sh.ok("pack e.npz -o b.pbm")
    assert mapdeal.read_bit_map("b.pbm").count() == 4


@pytest.mark.usefixtures("mapdeal_warnings", "costs")
def test_costs_read_as_bytes_are_written_as_bytes(sh):
    sh("convert costs.npz -o b.yaml --encoding costmap2d")
    line = "edit circle b.yaml -o c.yaml --point 1.65,-1.85 --radius 0.01 --value 253"
    assert sh(line)[0] == 0
    found = read_map("c.yaml")
    assert (found.scale, found.cost[1, 1], found.cost[0, 0]) == ("costmap2d", 253, 9)


def test_keys_that_map_server_does_not_know_are_kept(sh, room):
    with open("room.yaml", "a") as file:
        file.write("height: 0.5\n")
    sh("window room.yaml -o w.yaml --corner 1.5,-2 --size 0.1,0.1")
    assert yaml.safe_load(Path("w.yaml").read_text())["height"] == 0.5


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("", [0, 3, 127, 251, 254, 255]),
        ("--static-layer", [0, 0, 0, 253, 254, 255]),
        ("--static-layer --no-trinary-costmap", [0, 2, 127, 253, 254, 255]),
        ("--static-layer --trinary-costmap no", [0, 2, 127, 253, 254, 255]),
        ("--static-layer --lethal-threshold 50", [0, 0, 254, 253, 254, 255]),
        ("--static-layer --no-track-unknown", [0, 0, 0, 253, 254, 0]),
        ("--static-layer --inscribed-value none", [0, 0, 0, 0, 254, 255]),
        ("--static-layer --inscribed-value 50", [0, 0, 253, 0, 254, 255]),
    ],
)
def test_a_map_as_costs(sh, options, expected):
    write_map("m.yaml", mapdeal.OccupancyGrid([[0, 1, 50, 99, 100, -1]], 0.25))
    assert sh(f"convert m.yaml -o c.npz --encoding costmap2d {options}")[0] == 0
    found = read_map("c.npz")
    assert (found.scale, found.cost.tolist()) == ("costmap2d", [expected])


def test_costs_as_ros_publishes_them_and_as_amcl_sees_them(sh):
    stored = Costmap([[0, 1, 128, 253, 254, 255]], 0.25, (1.5, -2.0, 0.4))
    write_map("c.npz", stored)
    sh("convert c.npz -o o.npz --encoding occupancy")
    published = read_map("o.npz")
    assert (published.scale, published.cost.tolist()) == ("occupancy", [[0, 1, 50, 99, 100, -1]])
    for name in ("a.npz", "a.yaml"):
        sh(f"convert c.npz -o {name} --encoding amcl")
        assert occupancy(name) == [[0, -1, -1, -1, 100, -1]]
        assert read_map(name).origin == stored.origin
    assert np.load("a.npz")["amcl"].tolist() == [[-1, 0, 0, 0, 1, 0]]
    sh("convert o.npz -o b.npz --encoding costmap2d")
    assert read_map("b.npz").cost.tolist() == [[0, 3, 127, 251, 254, 255]]


def test_a_round_robot_as_costmap_2d_has_it(sh, room):
    sh("cost room.yaml -o c.npz --robot-radius 0.2")
    sh("cost room.yaml -o p.npz --robot-radius 0.2 --robot-16-gon")
    circle, polygon = read_map("c.npz"), read_map("p.npz")
    assert np.count_nonzero(circle.cost == 253) > np.count_nonzero(polygon.cost == 253)
    assert (circle.circumscribed_cost, polygon.circumscribed_cost < 253) == (253, True)


@pytest.mark.parametrize(
    "words",
    [
        "edit circle room.yaml --radius 0.1 --value 100 --point 1.65,-1.85 -o o.yaml",
        "window room.yaml --at 1.7,-1.8 --size 0.4,0.4 -o o.yaml",
        "shift room.yaml --origin 1.6,-2 -o o.yaml",
        "rotate room.yaml --yaw 0.5 -o o.yaml",
        "rescale room.yaml --resolution 0.2 -o o.yaml",
        "pack room.yaml -o o.pbm",
    ],
)
def test_the_pictures_of_changes(sh, room, words):
    assert sh(f"{words} --image p.png")[0] == 0
    assert Path("p.png").read_bytes().startswith(b"\x89PNG")


def test_geojson_from_the_command_line(sh, room):
    ring = [[1.5, -2.0], [1.75, -2.0], [1.75, -1.8], [1.5, -2.0]]
    shape = {"type": "Polygon", "coordinates": [ring]}
    zone = {"type": "Feature", "properties": {"value": 100}, "geometry": shape}
    Path("zones.geojson").write_text(json.dumps(zone))
    assert sh("edit polygon room.yaml -o o.npz --file zones.geojson")[0] == 0
    expected = mapdeal.draw(room, Polygon(ring[:-1]), value=100)
    assert np.array_equal(read_map("o.npz").occupancy, expected.occupancy)


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_keepout_mask_of_a_real_map_from_zones_to_costs(sh, real_maps):
    depot = next(real_maps.rglob("depot.yaml"))
    Path("zones.yaml").write_text(
        "shapes:\n"
        "- {type: polygon, points: [[2, 2], [8, 2], [8, 5], [5, 3.5], [2, 5]], value: 100}\n"
        "- {type: polygon, points: [[20, 3], [26, 4], [25, 9]], value: 80}\n"
    )
    assert sh(f"edit polygon {depot} -o mask.yaml --blank --file zones.yaml")[0] == 0
    drawn = read_map("mask.yaml")
    assert drawn.frame == read_map(depot).frame
    # a point in the bay of the first, one in each zone, and one far away
    cells_, _ = drawn.frame.bounded_rowcol_from_xy([(5, 4.5), (3, 3), (24, 5), (15, 12)])
    assert drawn.occupancy[tuple(cells_.T)].tolist() == [0, 100, 80, 0]
    assert sh(f"cost {depot} -o c.npz --mask mask.yaml")[0] == 0
    cost, plain = (read_map("c.npz").cost, exponential_cost(read_map(depot)).cost)
    assert np.array_equal(cost, np.maximum(plain, np.round(drawn.occupancy * 2.54)))
