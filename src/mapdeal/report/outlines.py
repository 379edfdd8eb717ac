"""Outlines of groups of cells, as closed lines in the map frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame

# Edges of a cell at (row, col), its inside on the left: from corner to corner, in cells.
_EDGES = (
    ((-1, 0), (0, 0), (0, 1)),
    ((0, 1), (0, 1), (1, 0)),
    ((1, 0), (1, 1), (0, -1)),
    ((0, -1), (1, 0), (-1, 0)),
)
"""Neighbour beyond the edge, the corner it starts at, and the step to its end: (row, col)."""


def outlines_of(cells: NDArray[np.int64], frame: Frame) -> list[NDArray[np.float64]]:
    """Return the borders of a group of cells, each line closed, corners in metres.

    Parameters
    ----------
    cells : numpy.ndarray of int64, shape (N, 2)
        Row and column of each cell.
    frame : Frame
        Of the cells.

    Returns
    -------
    list of numpy.ndarray of float64, shape (M, 2)
        The outer border counterclockwise in the grid, holes clockwise; cells that touch at a
        corner alone are separate loops, or one, which encloses the same cells.
    """
    low = cells.min(axis=0)
    marked = np.zeros(tuple(cells.max(axis=0) - low + 3), dtype=np.bool_)
    marked[tuple((cells - low + 1).T)] = True
    after: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for beyond, start, step in _EDGES:
        outside = ~np.roll(marked, (-beyond[0], -beyond[1]), axis=(0, 1))
        for row, col in (np.argwhere(marked & outside) + start).tolist():
            after.setdefault((row, col), []).append((row + step[0], col + step[1]))
    lines = []
    while after:
        first = next(iter(after))
        loop = [first]
        while True:
            ends = after[loop[-1]]
            following = ends.pop() if len(ends) == 1 else ends.pop(_right_turn(loop, ends))
            if not ends:
                del after[loop[-1]]
            if following == first:
                break
            loop.append(following)
        corners = _without_straight(np.array(loop, dtype=np.float64))
        points = frame.xy_from_continuous_rowcol(corners + low - 1)
        lines.append(np.vstack([points, points[:1]]))
    return lines


def _right_turn(loop: list[tuple[int, int]], ends: list[tuple[int, int]]) -> int:
    """Return which of two ways on leads to the right, around the next cell at a corner."""
    if len(loop) < 2:
        return 0
    (r0, c0), (r1, c1) = loop[-2:]
    turns = [(c1 - c0) * (r - r1) - (r1 - r0) * (c - c1) for r, c in ends]
    return turns.index(min(turns))


def _without_straight(loop: NDArray[np.float64]) -> NDArray[np.float64]:
    before, after = loop - np.roll(loop, 1, axis=0), np.roll(loop, -1, axis=0) - loop
    turns: NDArray[np.float64] = loop[(before != after).any(axis=1)]
    return turns
