"""costmap_2d's line of cells between two cells, in closed form, for many lines at once.

References
----------
``raytraceLine`` and ``bresenham2D`` in ``costmap_2d.hpp`` of both ROS navigation stacks: n is
the larger difference, the error starts at n // 2 and grows by the smaller difference with each
step; where it reaches n, the minor axis moves. So after i steps the minor axis has moved
(n // 2 + i * minor) // n times. The line from b to a is not always that from a to b.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mapdeal.kernels.spans import Indices, Spans, bands, enumerated

Cell = tuple[int, int]

FARTHEST_CELL = 1 << 30
"""Cell indices up to which no product in here or in `polygons` exceeds 64 bits."""


class Edges(NamedTuple):
    """Lines between cells, each from its first to its second end: arrays of int64, shape (N,)."""

    row: Indices
    col: Indices
    next_row: Indices
    next_col: Indices

    @property
    def bottom(self) -> Indices:
        """The lowest row of each."""
        return np.minimum(self.row, self.next_row)

    @property
    def top(self) -> Indices:
        """The highest row of each."""
        return np.maximum(self.row, self.next_row)

    def chosen(self, which: Indices) -> Edges:
        """Return some of the edges."""
        return Edges(*(column[which] for column in self))


def edges_through(cells: Sequence[Cell], *, closed: bool = False) -> Edges:
    """Return the edges from each cell to the next, and from the last to the first."""
    ends = np.array(cells, dtype=np.int64).reshape(-1, 2)
    following = np.roll(ends, -1, axis=0)
    if not closed:
        ends, following = ends[:-1], following[:-1]
    return Edges(ends[:, 0], ends[:, 1], following[:, 0], following[:, 1])


def line_spans(edges: Edges, shape: tuple[int, int]) -> Iterator[Spans]:
    """Return the cells of lines, their ends included, that lie in a grid, in parts."""
    for bottom, top in bands(edges.bottom, edges.top + 1, shape[0]):
        _, spans = runs(edges, bottom, top)
        yield spans.clipped(shape[1])


def runs(edges: Edges, bottom: int, top: int) -> tuple[Indices, Spans]:
    """Return how far each line reaches within each of the rows `bottom` .. `top` - 1."""
    which, rows = enumerated(np.maximum(edges.bottom, bottom), np.minimum(edges.top + 1, top))
    row, col, next_row, next_col = edges.chosen(which)
    across, along = np.abs(next_row - row), np.abs(next_col - col)
    moved = np.abs(rows - row)
    n = np.maximum(np.maximum(across, along), 1)
    # Where rows are the major axis there is one cell a row. Elsewhere row k holds the steps i
    # with (n // 2 + i * across) // n == k.
    single = (n // 2 + moved * along) // n
    steps = np.maximum(across, 1)
    first = np.where(moved == 0, 0, -((n // 2 - moved * n) // steps))
    last = np.where(moved == across, n, -((n // 2 - (moved + 1) * n) // steps) - 1)
    first, last = (np.where(across >= along, single, end) for end in (first, last))
    to_the_right = next_col >= col
    lowest = np.where(to_the_right, col + first, col - last)
    highest = np.where(to_the_right, col + last, col - first)
    return which, Spans(rows, lowest, highest + 1)
