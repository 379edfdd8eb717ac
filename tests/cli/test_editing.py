"""The commands that change a map, from file to file."""

import json

import numpy as np
import pytest
import yaml

from drawn import cells, grid_from_text
from mapdeal import (
    BitMap,
    Circle,
    Costmap,
    OccupancyGrid,
    Polygon,
    apply_keepout_mask,
    draw,
    exponential_cost,
    read_bit_map,
    read_map,
    shift_origin,
    window,
    write_map,
)

ROOM = "........\n.#......\n......?.\n...##..."


@pytest.fixture
def room(tmp_path):
    """A map that lies straight: cell (row, col) begins at (1.5 + col / 10, -2 + row / 10)."""
    write_map(tmp_path / "room.yaml", grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.0)))
    return tmp_path / "room.yaml"


@pytest.fixture
def costs(tmp_path):
    write_map(tmp_path / "costs.npz", Costmap(np.full((4, 8), 9, np.uint8), 0.1, (1.5, -2.0, 0.0)))
    return tmp_path / "costs.npz"


def test_a_polygon_by_its_points(command, room, tmp_path):
    output = tmp_path / "o.yaml"
    words = ["--point", "1.51,-1.99", "--point", "1.75,-1.99", "--point", "1.75,-1.81",
             "--point", "1.51,-1.81"]  # fmt: skip
    code, out, err = command("edit", "polygon", room, "-o", output, *words, "--value", 100)
    assert (code, err) == (0, "")
    expected = cells("........\n.#......\n###...?.\n#####...")
    assert np.array_equal(read_map(output).occupancy, expected)
    assert yaml.safe_load(output.read_text())["mode"] == "trinary"
    assert "8 x 4 cells" in out


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_line_and_circles_on_costs(command, costs, tmp_path):
    command("edit", "line", costs, "-o", tmp_path / "l.npz", "--point", "1.55,-1.95",
            "--point=2.25,-1.95", "--value", 255)  # fmt: skip
    assert read_map(tmp_path / "l.npz").cost.tolist() == [[255] * 8] + [[9] * 8] * 3
    command("edit", "circle", costs, "-o", tmp_path / "c.npz", "--point", "1.65,-1.85",
            "--point", "2.15,-1.75", "--radius", 0.1, "--value", 253)  # fmt: skip
    found = read_map(tmp_path / "c.npz")
    assert np.argwhere(found.cost == 253).tolist() == [
        [0, 1], [1, 0], [1, 1], [1, 2], [1, 6], [2, 1], [2, 5], [2, 6], [2, 7], [3, 6],
    ]  # fmt: skip
    assert found.scale == "costmap2d"


def test_the_shapes_of_a_file_with_one_more_on_top(command, room, tmp_path):
    file = tmp_path / "zones.yaml"
    file.write_text(
        "shapes:\n"
        "- {type: polygon, points: [[1.5, -2], [2.2, -2], [2.2, -1.7], [1.5, -1.7]], value: 60}\n"
        "- {type: circle, center: [1.55, -1.95], radius: 0.01}\n"
    )
    output = tmp_path / "o.npz"
    code, _, err = command("edit", "circle", room, "-o", output, "--file", file, "--value", 100,
                           "--point", "2.25,-1.65", "--radius", 0.02)  # fmt: skip
    assert (code, err) == (0, "")
    expected = np.full((4, 8), 60)
    expected[0, 0] = expected[3, 7] = 100
    assert np.array_equal(read_map(output).occupancy, expected)


def test_a_mask_drawn_on_a_blank_grid_saved_and_laid_over_the_costs(
    command, room, tmp_path, mapdeal_warnings
):
    mask, output = tmp_path / "mask.yaml", tmp_path / "cost.npz"
    code, _, _ = command("edit", "circle", room, "-o", mask, "--blank", "--point", "2.0,-1.8",
                         "--radius", 0.15, "--value", 80)  # fmt: skip
    assert code == 0
    assert yaml.safe_load(mask.read_text())["mode"] == "raw"
    drawn = read_map(mask)
    assert set(np.unique(drawn.occupancy).tolist()) == {0, 80}
    code, _, err = command("cost", room, "-o", output, "--mask", mask)
    assert code == 0
    assert "1 unknown cells became free" in err
    plain = exponential_cost(read_map(room))
    assert np.array_equal(read_map(output).cost, apply_keepout_mask(plain, drawn).cost)
    assert (read_map(output).cost[drawn.occupancy == 80] >= 203).all()


def test_a_mask_that_is_unknown_outside_of_its_shapes_changes_nothing_there(
    command, room, tmp_path
):
    mask, output = tmp_path / "mask.yaml", tmp_path / "cost.npz"
    command("edit", "circle", room, "-o", mask, "--blank", "--background", -1, "--point",
            "2.0,-1.8", "--radius", 0.15, "--value", 100)  # fmt: skip
    drawn = read_map(mask).occupancy
    assert set(np.unique(drawn).tolist()) == {-1, 100}
    assert command("cost", room, "-o", output, "--mask", mask)[2] == ""
    expected = exponential_cost(read_map(room)).cost.copy()
    expected[drawn == 100] = 254
    assert np.array_equal(read_map(output).cost, expected)
    code, _, err = command("edit", "circle", room, "-o", tmp_path / "x.yaml", "--background", -1,
                           "--point", "2.0,-1.8", "--radius", 0.15, "--value", 100)  # fmt: skip
    assert (code, "--blank" in err) == (2, True)


def test_a_mask_on_costs_of_the_other_scale(command, room, tmp_path):
    mask, output = tmp_path / "mask.npz", tmp_path / "cost.yaml"
    command("edit", "reset", room, "-o", mask, "--blank", "--corner", "1.5,-2", "--size", "0.2,0.2",
            "--value", 99)  # fmt: skip
    assert command("cost", room, "-o", output, "--model", "rings", "--mask", mask)[0] == 0
    assert (read_map(output).occupancy[:2, :2] == 99).all()


def test_the_mask_is_an_input_that_no_output_may_replace(command, room, tmp_path):
    mask = tmp_path / "mask.npz"
    command("convert", room, "-o", mask)
    before = mask.read_bytes()
    code, _, err = command("cost", room, "-o", mask, "--mask", mask, "--force")
    assert (code, "the output is the input" in err) == (4, True)
    assert mask.read_bytes() == before


@pytest.mark.parametrize("output", ["zones.yaml", "link.yaml", "zones.pgm"])
def test_the_shapes_are_an_input_that_no_output_may_replace(command, room, tmp_path, output):
    zones = tmp_path / "zones.yaml"
    zones.write_text("shapes:\n- {type: circle, center: [2, -1.8], radius: 0.1, value: 100}\n")
    (tmp_path / "link.yaml").symlink_to(zones)
    before = zones.read_bytes()
    words = ["edit", "circle", room, "--file", zones, "-o", tmp_path / output, "--force"]
    code, _, err = command(*words)
    assert (code, "the output is the input" in err) == (4, True)
    assert zones.read_bytes() == before


@pytest.mark.parametrize(
    ("words", "same"),
    [
        (["--robot-16-gon", "no"], True),
        (["--robot-16-gon=no"], True),
        (["--no-robot-16-gon"], True),
        (["--robot-16-gon", "yes"], False),
        (["--robot-16-gon"], False),
    ],
)
def test_the_16_gon_can_be_written_as_flags_are(command, room, tmp_path, words, same):
    shape = ["cost", room, "--robot-radius", 0.2, "-o"]
    assert command(*shape, tmp_path / "c.npz")[0] == 0
    assert command(*shape, tmp_path / "p.npz", *words)[0] == 0
    circle, other = read_map(tmp_path / "c.npz").cost, read_map(tmp_path / "p.npz").cost
    assert np.array_equal(circle, other) is same


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_reset_region_is_unknown_unless_a_value_is_given(command, room, costs, tmp_path):
    words = ["--corner", "1.6,-1.9", "--size", "0.2,0.1"]
    command("edit", "reset", room, "-o", tmp_path / "a.yaml", *words)
    assert np.array_equal(
        read_map(tmp_path / "a.yaml").occupancy, cells("........\n.#......\n.??...?.\n...##...")
    )
    command("edit", "reset", costs, "-o", tmp_path / "b.npz", *words)
    assert read_map(tmp_path / "b.npz").cost[1].tolist() == [9, 255, 255, 9, 9, 9, 9, 9]
    command("edit", "reset", costs, "-o", tmp_path / "c.npz", "--at", "1.7,-1.85", "--size",
            "0.2,0.1", "--value", 0)  # fmt: skip
    assert read_map(tmp_path / "c.npz").cost[1].tolist() == [9, 0, 0, 9, 9, 9, 9, 9]


def test_clipping_is_a_warning_or_a_finding(command, room, tmp_path):
    words = ["edit", "polygon", room, "-o", tmp_path / "o.yaml", "--value", 100, "--point",
             "2.0,-1.9", "--point", "9,-1.9", "--point", "2.0,-1.7"]  # fmt: skip
    code, out, err = command(*words, "--strict")
    assert (code, out) == (1, "")
    assert err.startswith("warning: polygon: vertex 2")
    assert err.endswith("error: 1 warning, and --strict allows none; nothing was written\n")
    assert not (tmp_path / "o.yaml").exists()
    code, _, err = command(*words)
    assert code == 0
    assert err.count("warning: ") == err.count("\n") == 1
    expected = draw_quietly(read_map(room), Polygon([(2.0, -1.9), (9, -1.9), (2.0, -1.7)]))
    assert np.array_equal(read_map(tmp_path / "o.yaml").occupancy, expected.occupancy)


def draw_quietly(grid, shape):
    with pytest.warns(UserWarning, match="clipped"):
        return draw(grid, shape, value=100)


def test_window_and_shift_tell_where_they_end_up(command, room, tmp_path):
    code, out, _ = command("window", room, "-o", tmp_path / "w.yaml", "--at", "1.75,-1.85",
                           "--size", "0.3,0.3")  # fmt: skip
    assert code == 0
    assert "3 x 3 cells at 1.6, -2, " in out
    expected = window(read_map(room), center_xy=(1.75, -1.85), size_xy=(0.3, 0.3))
    assert np.array_equal(read_map(tmp_path / "w.yaml").occupancy, expected.occupancy)
    assert read_map(tmp_path / "w.yaml").origin == (1.6, -2.0, 0.0)
    code, out, _ = command("shift", room, "-o", tmp_path / "s.yaml", "--origin", "1.62,-2.21",
                           "--default", 0)  # fmt: skip
    assert code == 0
    assert "at 1.6, -2.3, " in out
    expected = shift_origin(read_map(room), (1.62, -2.21), default=0)
    assert np.array_equal(read_map(tmp_path / "s.yaml").occupancy, expected.occupancy)


def test_what_lies_beyond_the_map_can_have_a_value(command, room, tmp_path):
    command("window", room, "-o", tmp_path / "w.npz", "--corner", "2.2,-1.7", "--size", "0.2,0.1",
            "--default", 7)  # fmt: skip
    assert read_map(tmp_path / "w.npz").occupancy.tolist() == [[0, 7]]


@pytest.mark.parametrize(
    ("overlay", "row"), [("seq", [60, 80, 80, 20, 20, 20]), ("max", [60, 80, 80, 80, 80, 20])]
)
def test_which_of_two_zones_wins(command, room, tmp_path, overlay, row):
    zones = tmp_path / "zones.yaml"
    zones.write_text(
        "shapes:\n"
        "- {type: line, points: [[1.55, -1.95], [1.75, -1.95]], value: 60}\n"
        "- {type: line, points: [[1.65, -1.95], [1.95, -1.95]], value: 80}\n"
        "- {type: line, points: [[1.85, -1.95], [2.05, -1.95]], value: 20}\n"
    )
    words = ["edit", "line", room, "-o", tmp_path / "o.npz", "--blank", "--background", -1]
    assert command(*words, "--file", zones, "--overlay", overlay)[0] == 0
    assert read_map(tmp_path / "o.npz").occupancy[0].tolist() == [*row, -1, -1]


def test_a_yaw_is_honoured_by_every_command(command, tmp_path):
    write_map(tmp_path / "m.yaml", grid_from_text("....\n....\n....", 0.1, (1.5, -2.0, 0.4)))
    grid = read_map(tmp_path / "m.yaml")
    x, y = grid.frame.xy_from_rowcol([[1, 2]])[0]
    point = f"{x},{y}"
    command("edit", "circle", tmp_path / "m.yaml", "-o", tmp_path / "c.yaml", "--point", point,
            "--radius", 0.01, "--value", 100)  # fmt: skip
    assert np.argwhere(read_map(tmp_path / "c.yaml").occupancy).tolist() == [[1, 2]]
    command("edit", "reset", tmp_path / "m.yaml", "-o", tmp_path / "r.yaml", "--at", point,
            "--size", "0.1,0.1", "--value", 100)  # fmt: skip
    assert np.argwhere(read_map(tmp_path / "r.yaml").occupancy).tolist() == [[1, 2]]
    _, out, _ = command("window", tmp_path / "c.yaml", "-o", tmp_path / "w.yaml", "--at", point,
                        "--size", "0.1,0.1")  # fmt: skip
    assert read_map(tmp_path / "w.yaml").occupancy.tolist() == [[100]]
    assert "yaw 0.4" in out
    command("shift", tmp_path / "c.yaml", "-o", tmp_path / "s.yaml", "--origin", point)
    assert read_map(tmp_path / "s.yaml").occupancy[0, 0] == 100


def test_the_obstacles_in_bits_and_back(command, room, tmp_path):
    code, out, err = command("pack", room, "-o", tmp_path / "b.pbm")
    assert code == 0
    assert "1 unknown cells" in err
    assert "occupied 9.38 %" in out
    bits = read_bit_map(tmp_path / "b.pbm")
    assert np.array_equal(bits.packed, BitMap.from_occupancy(read_map(room)).packed)
    assert command("unpack", tmp_path / "b.pbm", "-o", tmp_path / "u.yaml")[0] == 0
    grid = read_map(tmp_path / "u.yaml")
    assert np.array_equal(grid.occupancy, np.maximum(read_map(room).occupancy, 0))
    assert (grid.resolution, grid.origin) == (0.1, (1.5, -2.0, 0.0))


def test_packing_a_field_takes_what_it_counts_as_obstacles(command, room, tmp_path):
    command("esdf", room, "-o", tmp_path / "e.npz", "--unknown", "occupied")
    code, _, err = command("pack", tmp_path / "e.npz", "-o", tmp_path / "b.pbm")
    assert (code, err) == (0, "")
    assert read_bit_map(tmp_path / "b.pbm").count() == 4


@pytest.mark.usefixtures("mapdeal_warnings")
def test_costs_read_as_bytes_are_written_as_bytes(command, costs, tmp_path):
    command("convert", costs, "-o", tmp_path / "b.yaml", "--encoding", "costmap2d")
    code, _, _ = command("edit", "circle", tmp_path / "b.yaml", "-o", tmp_path / "c.yaml",
                         "--point", "1.65,-1.85", "--radius", 0.01, "--value", 253)  # fmt: skip
    assert code == 0
    found = read_map(tmp_path / "c.yaml")
    assert (found.scale, found.cost[1, 1], found.cost[0, 0]) == ("costmap2d", 253, 9)


def test_keys_that_map_server_does_not_know_are_kept(command, room, tmp_path):
    with room.open("a") as file:
        file.write("height: 0.5\n")
    command("window", room, "-o", tmp_path / "w.yaml", "--corner", "1.5,-2", "--size", "0.1,0.1")
    assert yaml.safe_load((tmp_path / "w.yaml").read_text())["height"] == 0.5


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ([], [0, 3, 127, 251, 254, 255]),
        (["--static-layer"], [0, 0, 0, 253, 254, 255]),
        (["--static-layer", "--no-trinary-costmap"], [0, 2, 127, 253, 254, 255]),
        (["--static-layer", "--trinary-costmap", "no"], [0, 2, 127, 253, 254, 255]),
        (["--static-layer", "--lethal-threshold", 50], [0, 0, 254, 253, 254, 255]),
        (["--static-layer", "--no-track-unknown"], [0, 0, 0, 253, 254, 0]),
        (["--static-layer", "--inscribed-value", "none"], [0, 0, 0, 0, 254, 255]),
        (["--static-layer", "--inscribed-value", 50], [0, 0, 253, 0, 254, 255]),
    ],
)
def test_a_map_as_costs(command, tmp_path, options, expected):
    write_map(tmp_path / "m.yaml", OccupancyGrid([[0, 1, 50, 99, 100, -1]], 0.25))
    words = ["convert", tmp_path / "m.yaml", "-o", tmp_path / "c.npz", "--encoding", "costmap2d"]
    assert command(*words, *options)[0] == 0
    found = read_map(tmp_path / "c.npz")
    assert found.cost.tolist() == [expected]
    assert found.scale == "costmap2d"


def test_costs_as_ros_publishes_them_and_as_amcl_sees_them(command, tmp_path):
    stored = Costmap([[0, 1, 128, 253, 254, 255]], 0.25, (1.5, -2.0, 0.4))
    write_map(tmp_path / "c.npz", stored)
    command("convert", tmp_path / "c.npz", "-o", tmp_path / "o.npz", "--encoding", "occupancy")
    published = read_map(tmp_path / "o.npz")
    assert (published.scale, published.cost.tolist()) == ("occupancy", [[0, 1, 50, 99, 100, -1]])
    for name in ("a.npz", "a.yaml"):
        command("convert", tmp_path / "c.npz", "-o", tmp_path / name, "--encoding", "amcl")
        seen = read_map(tmp_path / name)
        assert seen.occupancy.tolist() == [[0, -1, -1, -1, 100, -1]]
        assert seen.origin == stored.origin
    assert np.load(tmp_path / "a.npz")["amcl"].tolist() == [[-1, 0, 0, 0, 1, 0]]
    command("convert", tmp_path / "o.npz", "-o", tmp_path / "b.npz", "--encoding", "costmap2d")
    assert read_map(tmp_path / "b.npz").cost.tolist() == [[0, 3, 127, 251, 254, 255]]


def test_a_round_robot_as_costmap_2d_has_it(command, room, tmp_path):
    shape = ["--robot-radius", 0.2]
    command("cost", room, "-o", tmp_path / "c.npz", *shape)
    command("cost", room, "-o", tmp_path / "p.npz", *shape,
            "--robot-16-gon")  # fmt: skip
    circle, polygon = read_map(tmp_path / "c.npz"), read_map(tmp_path / "p.npz")
    assert np.count_nonzero(circle.cost == 253) > np.count_nonzero(polygon.cost == 253)
    assert (circle.circumscribed_cost, polygon.circumscribed_cost < 253) == (253, True)
    code, _, err = command("cost", room, "-o", tmp_path / "x.npz", "--robot-16-gon")
    assert code == 2
    assert "--robot-radius" in err


def test_the_pictures_of_changes(command, room, tmp_path):
    point = ["--point", "1.65,-1.85"]
    for words in (
        ["edit", "circle", room, "--radius", 0.1, "--value", 100, *point],
        ["window", room, "--at", "1.7,-1.8", "--size", "0.4,0.4"],
        ["shift", room, "--origin", "1.6,-2"],
        ["rotate", room, "--yaw", 0.5],
        ["rescale", room, "--resolution", 0.2],
        ["pack", room],
    ):
        output = tmp_path / ("b.pbm" if words[0] == "pack" else f"{words[0]}.yaml")
        picture = tmp_path / f"{words[0]}_picture.png"
        assert command(*words, "-o", output, "--image", picture)[0] == 0
        assert picture.read_bytes().startswith(b"\x89PNG")


def test_geojson_from_the_command_line(command, room, tmp_path):
    ring = [[1.5, -2.0], [1.75, -2.0], [1.75, -1.8], [1.5, -2.0]]
    zone = {
        "type": "Feature",
        "properties": {"value": 100},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    (tmp_path / "zones.geojson").write_text(json.dumps(zone))
    words = [
        "edit",
        "polygon",
        room,
        "-o",
        tmp_path / "o.npz",
        "--file",
        tmp_path / "zones.geojson",
    ]
    assert command(*words)[0] == 0
    expected = draw(read_map(room), Polygon(ring[:-1]), value=100)
    assert np.array_equal(read_map(tmp_path / "o.npz").occupancy, expected.occupancy)


def test_commands_do_what_the_library_does(command, room, tmp_path):
    command("edit", "circle", room, "-o", tmp_path / "o.npz", "--point", "1.83,-1.77", "--radius",
            0.17, "--value", 42)  # fmt: skip
    expected = draw(read_map(room), Circle((1.83, -1.77), 0.17), value=42)
    assert np.array_equal(read_map(tmp_path / "o.npz").occupancy, expected.occupancy)


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_keepout_mask_of_a_real_map_from_zones_to_costs(command, real_maps, tmp_path):
    depot = next(real_maps.rglob("depot.yaml"))
    zones = tmp_path / "zones.yaml"
    zones.write_text(
        "shapes:\n"
        "- {type: polygon, points: [[2, 2], [8, 2], [8, 5], [5, 3.5], [2, 5]], value: 100}\n"
        "- {type: polygon, points: [[20, 3], [26, 4], [25, 9]], value: 80}\n"
    )
    mask = tmp_path / "mask.yaml"
    words = ["edit", "polygon", depot, "-o", mask, "--blank", "--file", zones]
    assert command(*words)[0] == 0
    drawn = read_map(mask)
    assert drawn.frame == read_map(depot).frame
    # A point in the bay of the first, one in each zone, and one far away.
    points = [(5, 4.5), (3, 3), (24, 5), (15, 12)]
    cells, _ = drawn.frame.bounded_rowcol_from_xy(points)
    assert drawn.occupancy[tuple(cells.T)].tolist() == [0, 100, 80, 0]
    assert command("cost", depot, "-o", tmp_path / "c.npz", "--mask", mask)[0] == 0
    cost, plain = read_map(tmp_path / "c.npz").cost, exponential_cost(read_map(depot)).cost
    assert np.array_equal(cost, np.maximum(plain, np.round(drawn.occupancy * 2.54)))
