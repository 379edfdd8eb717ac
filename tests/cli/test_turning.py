"""The commands that bring maps onto other lattices, from file to file."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from drawn import grid_from_text
from mapdeal import Costmap, read_map, rescale, rotate, write_map

ROOM = "\n".join(
    ["#" * 40, *["#" + "." * 38 + "#"] * 9, "#" * 25 + "." * 6 + "#" * 9,
     *["#" + "." * 37 + "?#"] * 9, "#" * 40]
)  # fmt: skip


@pytest.fixture
def room(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    grid = grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.3))
    write_map("room.yaml", grid)
    return grid


def test_the_yaw_is_baked_out(command, room):
    code, out, err = command("rotate", "room.yaml", "-o", "o.yaml", "--yaw", 0)
    assert (code, err) == (0, "")
    written, told = out.splitlines()
    assert written.startswith("o.yaml: 46 x 32 cells at 0.8, -2, occupied ")
    assert told == "turned by 0 rad (0 degrees) about x 0, y 0"
    found = read_map("o.yaml")
    assert found.origin == (0.8, -2.0, 0.0)
    assert yaml.safe_load(Path("o.yaml").read_text())["origin"] == [0.8, -2.0, 0.0]
    assert np.array_equal(found.occupancy, rotate(room).occupancy)
    walls = room.frame.xy_from_rowcol(np.argwhere(room.occupied()))
    cells, inside = found.frame.bounded_rowcol_from_xy(walls)
    assert inside.all()
    assert (found.occupancy[tuple(cells.T)] == 100).all()


def test_a_turn_with_a_rule_is_told(command, room):
    words = ["--yaw", "-1.2", "--rule", "nearest", "-v"]
    code, out, err = command("rotate", "room.yaml", "-o", "o.npz", *words)
    assert (code, "rotate: yaw=-1.2, straighten=no, rule=nearest" in err) == (0, True)
    assert "turned by -1.2 rad (-68.7549 degrees) about x 0, y 0" in out
    expected = rotate(room, -1.2, rule="nearest")
    assert np.array_equal(read_map("o.npz").occupancy, expected.occupancy)
    assert command("rotate", "room.yaml", "-o", "q.npz", "--yaw", "1", "-q") == (0, "", "")


def test_walls_are_brought_along_the_axes(command, room):
    code, out, err = command("rotate", "room.yaml", "-o", "o.yaml", "--straighten")
    assert (code, err) == (0, "")
    assert "turned by -0.3 rad (-17.1887 degrees) about x 0, y 0" in out
    assert np.array_equal(read_map("o.yaml").occupancy, room.occupancy)


def test_a_map_without_walls_is_written_as_it_is(command, room):
    write_map("empty.yaml", room.with_values(np.zeros_like(room.occupancy)))
    code, out, err = command("rotate", "empty.yaml", "-o", "o.yaml", "--straighten")
    warning = "warning: rotate: no direction of walls stands out, the map is not turned\n"
    assert (code, err) == (0, warning)
    assert len(out.splitlines()) == 1
    assert read_map("o.yaml").origin == room.origin


@pytest.mark.parametrize("resolution", [0.2, 0.25, 0.05, 0.1])
def test_a_map_at_another_resolution(command, room, resolution):
    code, out, err = command("rescale", "room.yaml", "-o", "o.yaml", "--resolution", resolution)
    assert (code, err) == (0, "")
    found = read_map("o.yaml")
    assert (found.resolution, found.origin) == (resolution, room.origin)
    assert np.array_equal(found.occupancy, rescale(room, resolution).occupancy)
    width, height = (math.ceil(cells * 0.1 / resolution - 1e-9) for cells in (40, 21))
    assert out.startswith(f"o.yaml: {width} x {height} cells at 1.5, -2, yaw 0.3, occupied ")


@pytest.mark.usefixtures("mapdeal_warnings")
def test_costs_stay_costs(command, room):
    costs = np.where(room.occupancy < 0, 255, room.occupancy * 2.54).astype(np.uint8)
    write_map("c.npz", Costmap(costs, 0.1, room.origin))
    for words in (["rotate", "--yaw", 1], ["rescale", "--resolution", 0.3]):
        name, *options = words
        assert command(name, "c.npz", "-o", f"{name}.npz", *options)[0] == 0
        found = read_map(f"{name}.npz")
        assert {0, 254} <= set(found.cost.ravel().tolist()) <= {0, 254, 255}
