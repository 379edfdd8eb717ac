"""The cells that points lie in, in one pass over the points."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name


class Precision(NamedTuple):
    """How exactly coordinates are known."""

    rounding: float
    tolerance: float
    farthest: float


def cells_of_points(
    points_xy: NDArray[np.float64],
    origin: tuple[float, float, float],
    resolution: float,
    precision: Precision,
) -> NDArray[np.int64] | None:
    """Return row and column of points, as if the grid went on for ever."""
    if engine_name() != "compiled":
        return None
    from mapdeal.kernels import _rays

    x, y, yaw = origin
    cells = np.empty(points_xy.shape, dtype=np.int64)
    is_near = _rays.cells(
        np.ascontiguousarray(points_xy), cells, x, y, math.cos(-yaw), math.sin(-yaw),
        resolution, *precision,
    )  # fmt: skip
    return cells if is_near else None
