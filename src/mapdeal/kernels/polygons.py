"""Polygons of cells: outline and inside, exactly, in integers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mapdeal.kernels.bresenham import Cell, extents, line_spans
from mapdeal.kernels.spans import Indices, Spans, joined


def convex_spans(corners: Sequence[Cell], shape: tuple[int, int]) -> Spans:
    """Return the cells of a convex polygon as costmap_2d fills it.

    Parameters
    ----------
    corners : sequence of tuple of int
        Row and column of each corner's cell, in the grid or not, at most
        `mapdeal.kernels.bresenham.FARTHEST_CELL` away from it.
    shape : tuple of int
        Rows and columns of the grid.

    Notes
    -----
    The outline by `line_spans`, and in each column everything between its lowest and its
    highest cell (``convexFillCells``). What is left of a polygon that reaches beyond the grid
    is exactly its part inside of it.
    """
    height, width = shape
    lowest = np.full(width, height, dtype=np.int64)
    highest = np.full(width, -1, dtype=np.int64)
    for (row, col), (next_row, next_col) in _edges(corners):
        cols, low, high = extents((col, row), (next_col, next_row), width)
        lowest[cols] = np.minimum(lowest[cols], low)
        highest[cols] = np.maximum(highest[cols], high)
    crossed = np.flatnonzero(lowest <= highest)
    if crossed.size == 0:
        return joined([])
    left, right = int(crossed[0]), int(crossed[-1]) + 1
    lowest, highest = lowest[left:right], highest[left:right]
    bottom, top = max(int(lowest.min()), 0), min(int(highest.max()), height - 1)
    parts = []
    for row in range(bottom, top + 1):
        inside = np.zeros(right - left + 2, dtype=np.int8)
        inside[1:-1] = (lowest <= row) & (row <= highest)
        ends = left + np.flatnonzero(np.diff(inside)).reshape(-1, 2)
        parts.append(Spans(np.full(len(ends), row), ends[:, 0], ends[:, 1]))
    return joined(parts)


def ring_spans(rings: Sequence[Sequence[Cell]], shape: tuple[int, int]) -> Spans:
    """Return the cells of a polygon of any form, with holes or without.

    Parameters
    ----------
    rings : sequence of sequences of tuple of int
        The corners of the outline and of each hole, as in `convex_spans`.
    shape : tuple of int
        Rows and columns of the grid.

    Notes
    -----
    The outlines by `line_spans`, and every cell whose centre an odd number of edges between
    the corners' centres surround. For a convex polygon of cells that is `convex_spans`.
    """
    edges = [edge for ring in rings for edge in _edges(ring)]
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


def _edges(corners: Sequence[Cell]) -> list[tuple[Cell, Cell]]:
    return list(pairwise([*corners, corners[0]]))
