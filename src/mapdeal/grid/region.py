"""Regions of a grid that are given in metres."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.coordinates import Point, cells_at, cells_to_cover, check_point
from mapdeal.grid.frame import Frame

MOST_CELLS = 1_000_000_000
"""Of a window that is made."""


_TOUCHING = 1e-6
"""In cells: borders that differ by less are the same on paper."""


class Region(NamedTuple):
    """A rectangle of cells, inside a grid or not: its first cell and its size."""

    row: int
    col: int
    height: int
    width: int

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.height * self.width

    def shared_with(self, shape: tuple[int, int]) -> tuple[slice, slice]:
        """Return the rows and columns of a grid that lie in the region; they may be none."""
        rows = _overlap(self.row, self.height, shape[0])
        return rows, _overlap(self.col, self.width, shape[1])

    def holds(self, cells_rowcol: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return whether each cell, shape (N, 2), lies in the region."""
        from_first = cells_rowcol - (self.row, self.col)
        inside: NDArray[np.bool_] = (from_first >= 0) & (from_first < (self.height, self.width))
        return inside[:, 0] & inside[:, 1]

    def place_of(self, rows: slice, cols: slice) -> tuple[slice, slice]:
        """Return where rows and columns of the grid lie in an array of the region's size."""
        return (
            slice(rows.start - self.row, rows.stop - self.row),
            slice(cols.start - self.col, cols.stop - self.col),
        )

    def frame_in(self, frame: Frame) -> Frame:
        """Return the region's own frame."""
        if self.height * self.width > MOST_CELLS:
            rule = f"a window must not have more than {MOST_CELLS} cells"
            raise ParameterError(rule, place="size", got=(self.width, self.height))
        return frame.window(self.row, self.col, self.height, self.width)


def region_of(
    frame: Frame,
    size_xy: Point,
    *,
    corner_xy: Point | None = None,
    center_xy: Point | None = None,
) -> Region:
    """Return the cells of a region in metres."""
    size_x, size_y = check_point(size_xy, "size")
    corner_xy, center_xy = (
        None if point is None else check_point(point, name)
        for point, name in ((corner_xy, "corner"), (center_xy, "center"))
    )
    if not (size_x > 0 and size_y > 0):
        rule = "must be two numbers of metres above 0"
        raise ParameterError(rule, place="size", got=(size_x, size_y))
    if corner_xy is not None and center_xy is None:
        row, col = frame.unbounded_rowcol_from_xy([corner_xy])[0].tolist()
    elif center_xy is not None and corner_xy is None:
        middle = frame.continuous_rowcol_from_xy([center_xy])[0]
        half = np.array([size_y, size_x]) / frame.resolution / 2
        row, col = cells_at(middle - half, frame.tolerance_at([center_xy])[0]).tolist()
    else:
        raise ParameterError("either a corner or a center must be given", place="region")
    height, width = (cells_to_cover(size, frame.resolution) for size in (size_y, size_x))
    return Region(row, col, max(height, 1), max(width, 1))


def region_around(frame: Frame, other: Frame) -> Region:
    """Return the cells of a lattice that hold all of another grid."""
    corners = [[row, col] for row in (0, other.height) for col in (0, other.width)]
    places = frame.continuous_rowcol_from_xy(other.xy_from_continuous_rowcol(corners))
    row, col = np.floor(places.min(axis=0) + _TOUCHING).astype(int).tolist()
    top, right = np.ceil(places.max(axis=0) - _TOUCHING).astype(int).tolist()
    return Region(row, col, top - row, right - col)


def _overlap(first: int, count: int, size: int) -> slice:
    """Return the part of `first` .. `first` + `count` that lies in 0 .. `size`, perhaps empty."""
    start = min(max(first, 0), size)
    return slice(start, max(start, min(first + count, size)))
