"""The commands that bring maps onto other lattices, from file to file."""

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
def room(here):
    grid = grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.3))
    write_map("room.yaml", grid)
    return grid


def same(found, expected):
    assert np.array_equal(read_map(found).occupancy, expected.occupancy)
    assert read_map(found).frame == expected.frame


def test_the_yaw_is_baked_out(sh, room):
    written, told = sh.ok("rotate room.yaml -o o.yaml --yaw 0").splitlines()
    assert written.startswith("o.yaml: 46 x 32 cells at 0.8, -2, occupied ")
    assert told == "turned by 0 rad (0 degrees) about x 0, y 0"
    same("o.yaml", rotate(room))
    assert yaml.safe_load(Path("o.yaml").read_text())["origin"] == [0.8, -2.0, 0.0]


def test_a_turn_with_a_rule_is_told(sh, room):
    code, out, err = sh("rotate room.yaml -o o.npz --yaw -1.2 --rule nearest -v")
    assert (code, "rotate: yaw=-1.2, straighten=no, rule=nearest" in err) == (0, True)
    assert "turned by -1.2 rad (-68.7549 degrees) about x 0, y 0" in out
    same("o.npz", rotate(room, -1.2, rule="nearest"))
    assert sh.ok("rotate room.yaml -o q.npz --yaw 1 -q") == ""


def test_walls_are_brought_along_the_axes_if_there_are_any(sh, room):
    out = sh.ok("rotate room.yaml -o o.yaml --straighten")
    assert "turned by -0.3 rad (-17.1887 degrees) about x 0, y 0" in out
    assert np.array_equal(read_map("o.yaml").occupancy, room.occupancy)
    empty = room.with_values(np.zeros_like(room.occupancy))
    write_map("empty.yaml", empty)
    code, out, err = sh("rotate empty.yaml -o e.yaml --straighten")
    warning = "warning: rotate: no direction of walls stands out, the map is not turned\n"
    assert (code, out.count("\n"), err) == (0, 1, warning)
    same("e.yaml", empty)


@pytest.mark.parametrize(("resolution", "size"), [(0.25, "16 x 9"), (0.05, "80 x 42")])
def test_a_map_at_another_resolution(sh, room, resolution, size):
    out = sh.ok(f"rescale room.yaml -o o.yaml --resolution {resolution}")
    assert out.startswith(f"o.yaml: {size} cells at 1.5, -2, yaw 0.3, occupied ")
    same("o.yaml", rescale(room, resolution))


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("words", ["rotate --yaw 1", "rescale --resolution 0.3"])
def test_costs_stay_costs(sh, room, words):
    costs = np.where(room.occupancy < 0, 255, room.occupancy * 2.54).astype(np.uint8)
    write_map("c.npz", Costmap(costs, 0.1, room.origin))
    assert sh(f"{words} c.npz -o o.npz")[0] == 0
    assert {0, 254} <= set(read_map("o.npz").cost.ravel().tolist()) <= {0, 254, 255}
