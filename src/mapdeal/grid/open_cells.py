"""Cells that points lie in, and which cell is open where one is not."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.coordinates import Point, check_point
from mapdeal.grid.frame import Frame

Cell = tuple[int, int]


def cell_of_point(frame: Frame, point: Point, name: str) -> Cell:
    """Return the row and column of the cell that a point of the map frame lies in.

    Raises
    ------
    ParameterError
        If it lies outside of the grid; the error calls the point `name`.
    """
    cells, inside = frame.bounded_rowcol_from_xy([check_point(point, name)])
    if not inside[0]:
        rule = "lies outside of the map"
        raise ParameterError(rule, place=name, got=point, hint=extent_text(frame))
    return int(cells[0, 0]), int(cells[0, 1])


def extent_text(frame: Frame) -> str:
    """Return where a grid lies in the map frame, as a hint."""
    height, width = frame.shape
    corners = [[0, 0], [0, width], [height, 0], [height, width]]
    corners_xy = frame.xy_from_continuous_rowcol(corners).round(6) + 0.0
    (x, y), (right, top) = corners_xy.min(axis=0).tolist(), corners_xy.max(axis=0).tolist()
    return f"the map lies within x {x:.10g} .. {right:.10g}, y {y:.10g} .. {top:.10g}"


def nearest_open_text(frame: Frame, is_open: NDArray[np.bool_], cell: Cell) -> str:
    """Return where the open cell is that is nearest to a cell, as a hint.

    Parameters
    ----------
    frame : Frame
        The grid.
    is_open : numpy.ndarray of bool, shape (H, W)
        The open cells.
    cell : tuple of int
        Row and column.
    """
    nearest = nearest_marked(is_open, cell)
    if nearest is None:
        return "no cell of the map is open"
    x, y = frame.xy_from_rowcol([nearest])[0].round(6).tolist()
    metres = math.dist(nearest, cell) * frame.resolution
    return f"the nearest open cell is {metres:.3g} m away, at {x + 0.0:.10g},{y + 0.0:.10g}"


def nearest_marked(marked: NDArray[np.bool_], cell: Cell) -> Cell | None:
    """Return the marked cell nearest to a cell, the first of several, row by row; None if none is.

    It is sought in a window that grows: a list of all marked cells would take much memory.
    """
    reach = 16
    while True:
        first = [max(at - reach, 0) for at in cell]
        rows, cols = (slice(low, at + reach + 1) for low, at in zip(first, cell, strict=True))
        found = np.argwhere(marked[rows, cols]) + first
        squares = ((found - np.array(cell)) ** 2).sum(axis=1)
        if len(found) and squares.min() <= reach * reach:
            row, col = found[int(np.argmin(squares))].tolist()
            return row, col
        if reach >= max(marked.shape):
            return None
        reach *= 2
