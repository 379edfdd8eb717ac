"""Where in a map something is, in words."""

from __future__ import annotations

import numpy as np

from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import UNKNOWN

_MIDDLE = 1 / 3
"""Share of the way from the middle to the border that is the middle still."""


def place_text(grid: OccupancyGrid, point_xy: tuple[float, float]) -> str:
    """Return in which part of what a map knows a point is, and the point."""
    known = np.asarray(grid.occupancy) != UNKNOWN
    rows, cols = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    at = f"at {point_xy[0] + 0.0:.4g},{point_xy[1] + 0.0:.4g}"
    if not len(rows):
        return at
    ends = [(row, col) for row in (rows[0], rows[-1]) for col in (cols[0], cols[-1])]
    corners = grid.frame.xy_from_rowcol(ends)
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = np.maximum((high - low) / 2, grid.resolution)
    x, y = (np.asarray(point_xy) - (low + high) / 2) / half
    north = "north" if y > _MIDDLE else "south" if y < -_MIDDLE else ""
    east = "east" if x > _MIDDLE else "west" if x < -_MIDDLE else ""
    part = "-".join(word for word in (north, east) if word) or "middle"
    return f"in the {part}, {at}"
