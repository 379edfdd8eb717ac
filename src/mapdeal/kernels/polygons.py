"""Polygons of cells: outline and inside, exactly, in integers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mapdeal.kernels.bresenham import Cell, line_spans
from mapdeal.kernels.spans import Indices, Spans, joined


def polygon_spans(rings: Sequence[Sequence[Cell]], shape: tuple[int, int]) -> Spans:
    """Return the cells of a polygon of any form, with holes or without, that lie in a grid.

    Parameters
    ----------
    rings : sequence of sequences of tuple of int
        Row and column of each corner's cell, of the outline and of each hole; in the grid or
        not, at most `mapdeal.kernels.bresenham.FARTHEST_CELL` away from it.
    shape : tuple of int
        Rows and columns of the grid.

    Notes
    -----
    The outlines by `line_spans`, and every cell whose centre an odd number of edges between
    the corners' centres surround. What is left of a polygon that reaches beyond the grid is
    exactly its part inside of it.

    For a convex polygon these are the cells of costmap_2d's ``convexFillCells``, which fills
    each column from its lowest to its highest cell: a column meets just two of its edges, also
    after the corners were moved to their cells, since that keeps their order along both axes;
    and a cell between the two lines of cells lies between the edges.

    Examples
    --------
    >>> spans = polygon_spans([[(0, 0), (0, 4), (3, 0)]], (9, 9))
    >>> sorted(set(zip(*(column.tolist() for column in spans))))[-1]
    (3, 0, 1)
    """
    edges = [edge for ring in rings for edge in pairwise([*ring, ring[0]])]
    outlines = [line_spans(*edge, shape) for edge in edges]
    return joined([*outlines, _inside(edges, shape)])


def _inside(edges: list[tuple[Cell, Cell]], shape: tuple[int, int]) -> Spans:
    """Return the cells inside by the even-odd rule; those on an edge belong to its outline."""
    all_rows: list[Indices] = []
    all_cols: list[Indices] = []
    for (row, col), (next_row, next_col) in edges:
        if row == next_row:
            continue
        if row > next_row:
            row, col, next_row, next_col = next_row, next_col, row, col
        rows = np.arange(max(row, 0), min(next_row, shape[0]), dtype=np.int64)
        # First column that is not left of the edge at the rows' centres.
        passed = -(((rows - row) * (col - next_col)) // (next_row - row))
        all_rows.append(rows)
        all_cols.append(col + passed)
    if not all_rows:
        return joined([])
    rows, cols = np.concatenate(all_rows), np.concatenate(all_cols)
    order = np.lexsort((cols, rows))
    rows, cols = rows[order], cols[order]
    # A closed ring crosses a row an even number of times: enter, leave, enter, leave.
    return Spans(rows[::2], cols[::2], cols[1::2]).clipped(shape[1])
