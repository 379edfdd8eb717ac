"""costmap_2d's line of cells between two cells, in closed form.

References
----------
``raytraceLine`` and ``bresenham2D`` in ``costmap_2d.hpp`` of both ROS navigation stacks: n is
the larger difference, the error starts at n // 2 and grows by the smaller difference with each
step; where it reaches n, the minor axis moves. So after i steps the minor axis has moved
(n // 2 + i * minor) // n times. The line from b to a is not always that from a to b.
"""

from __future__ import annotations

import numpy as np

from mapdeal.kernels.spans import Indices, Spans

Cell = tuple[int, int]

FARTHEST_CELL = 1 << 30
"""Cell indices up to which no product in here or in `polygons` exceeds 64 bits."""


def line_spans(start: Cell, stop: Cell, shape: tuple[int, int]) -> Spans:
    """Return the cells from `start` to `stop`, both included, that lie in a grid.

    Parameters
    ----------
    start, stop : tuple of int
        Row and column of the ends, in the grid or not, at most `FARTHEST_CELL` away from it.
    shape : tuple of int
        Rows and columns of the grid.

    Examples
    --------
    >>> spans = line_spans((0, 0), (2, 4), (3, 9))  # (0,0) (1,1) (1,2) (2,3) (2,4)
    >>> [list(column) for column in zip(*(c.tolist() for c in spans))]
    [[0, 0, 1], [1, 1, 3], [2, 3, 5]]
    """
    rows, first, last = extents(start, stop, shape[0])
    return Spans(rows, first, last + 1).clipped(shape[1])


def extents(start: Cell, stop: Cell, size: int) -> tuple[Indices, Indices, Indices]:
    """Return how far a line of cells reaches within each of the lanes 0 .. `size` - 1.

    Parameters
    ----------
    start, stop : tuple of int
        Lane and position in it: (row, column), or (column, row) for extents of columns.
    size : int
        Number of lanes.

    Returns
    -------
    lanes, lowest, highest : numpy.ndarray of int64, shape (N,)
        Of each lane that the line crosses the smallest and the largest position, both on it.
    """
    (u0, v0), (u1, v1) = start, stop
    up = 1 if u1 >= u0 else -1
    across, along = abs(u1 - u0), abs(v1 - v0)
    low, high = max(min(u0, u1), 0), min(max(u0, u1), size - 1)
    lanes = np.arange(low, high + 1, dtype=np.int64)
    moved = (lanes - u0) * up
    if across >= along:  # one cell a lane
        n = max(across, 1)
        first = last = (n // 2 + moved * along) // n
    else:
        # Lane k holds the steps i with (n // 2 + i * across) // n == k.
        n, divisor = along, max(across, 1)
        first = np.where(moved == 0, 0, -((n // 2 - moved * n) // divisor))
        last = np.where(moved == across, n, -((n // 2 - (moved + 1) * n) // divisor) - 1)
    down = v0 - last, v0 - first
    lowest, highest = (v0 + first, v0 + last) if v1 >= v0 else down
    return lanes, lowest, highest
