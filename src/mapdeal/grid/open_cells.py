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
    """Return the row and column of the cell that a point of the map frame lies in."""
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
    """Return where the open cell is that is nearest to a cell, as a hint."""
    nearest = nearest_marked(is_open, cell)
    if nearest is None:
        return "no cell of the map is open"
    x, y = frame.xy_from_rowcol([nearest])[0].round(6).tolist()
    metres = math.dist(nearest, cell) * frame.resolution
    return f"the nearest open cell is {metres:.3g} m away, at {x + 0.0:.10g},{y + 0.0:.10g}"


def nearest_marked(marked: NDArray[np.bool_], cell: Cell) -> Cell | None:
    """Return the marked cell nearest to a cell, the first of several, row by row; None if none is.

    The cell may lie outside. Rows are searched from it on: a list of all marked cells would take
    much memory.
    """
    best = None
    for row in sorted(range(len(marked)), key=lambda row: abs(row - cell[0])):
        away = (row - cell[0]) ** 2
        if best is not None and away > best[0]:
            break
        cols = np.flatnonzero(marked[row])
        if len(cols):
            col = int(cols[np.argmin(np.abs(cols - cell[1]))])
            found = (away + (col - cell[1]) ** 2, row, col)
            best = found if best is None else min(best, found)
    return None if best is None else best[1:]
