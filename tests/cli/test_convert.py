"""The command ``convert`` between the scales of costs."""

import numpy as np
import pytest

from mapdeal import Costmap, OccupancyGrid, read_map, write_map

MAP = OccupancyGrid(np.array([[0, 1, 50, 99, 100, -1]], dtype=np.int8), 0.5)
BYTES = Costmap(np.array([[0, 3, 127, 252, 254, 255]], dtype=np.uint8), 0.5)


@pytest.mark.parametrize(
    ("grid", "scale", "values"),
    [
        (MAP, "occupancy", [0, 1, 50, 99, 100, -1]),
        (MAP, "costmap2d", [0, 3, 127, 251, 254, 255]),  # round(2.54 v)
        (BYTES, "costmap2d", [0, 3, 127, 252, 254, 255]),
        # as costmap_2d publishes them: 1 + 97 (c - 1) // 251
        (BYTES, "occupancy", [0, 1, 49, 98, 100, -1]),
    ],
)
def test_scales_are_converted_by_their_formula(command, tmp_path, grid, scale, values):
    write_map(tmp_path / "in.npz", grid)
    out = tmp_path / "out.npz"
    code, _, err = command("convert", tmp_path / "in.npz", "-o", out, "--encoding", scale)
    assert (code, err) == (0, "")
    found = read_map(out)
    assert (found.cost if isinstance(found, Costmap) else found.occupancy).tolist() == [values]
    assert isinstance(found, Costmap) == (grid is BYTES or scale == "costmap2d")
