"""Solids of marked cells, in cells: few boxes, or one closed surface of triangles.

Equal runs of marked cells in consecutive rows form a rectangle. Its upper and lower edges are
divided at the corners of adjacent rectangles, so that triangles meet edge to edge and the surface
is closed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mapdeal.kernels.arrays import Bytes, Integers, Mask
from mapdeal.kernels.components import labelled
from mapdeal.kernels.polygons import enumerated


def run_count(marked: Mask) -> int:
    return int(np.count_nonzero(marked[:, 0]) + np.count_nonzero(marked[:, 1:] & ~marked[:, :-1]))


class Rectangles(NamedTuple):
    """Rows and columns of rectangles, half open, each shape (N,)."""

    first_row: Integers
    end_row: Integers
    first_col: Integers
    end_col: Integers


def rectangles(marked: Mask) -> Rectangles:
    # A straight wall across the rows has many short runs along rows, but few along columns.
    across = _rectangles_by_rows(marked)
    first_col, end_col, first_row, end_row = _rectangles_by_rows(np.ascontiguousarray(marked.T))
    along = Rectangles(first_row, end_row, first_col, end_col)
    components = labelled(marked, corners=False)
    count = len(components.sizes)
    owners = [components.cells[found.first_row, found.first_col] for found in (across, along)]
    few = np.bincount(owners[0], minlength=count) <= np.bincount(owners[1], minlength=count)
    is_across, is_along = few[owners[0]], ~few[owners[1]]
    both = zip(across, along, strict=True)
    columns = [np.concatenate([rows[is_across], cols[is_along]]) for rows, cols in both]
    order = np.lexsort(columns[2::-2])
    return Rectangles(*(column[order] for column in columns))


def _rectangles_by_rows(marked: Mask) -> Rectangles:
    width = marked.shape[1]
    edges = np.diff(np.pad(marked, ((0, 0), (1, 1))).view(np.int8), axis=1)
    row, start = np.nonzero(edges == 1)
    _, stop = np.nonzero(edges == -1)
    places = np.min_scalar_type(width)  # up to 16 bits: a radix sort in linear time
    order = np.lexsort([stop.astype(places), start.astype(places)])
    row, start, stop = row[order], start[order], stop[order]
    key = start * (width + 1) + stop
    is_first = np.ones(len(row), dtype=np.bool_)
    is_first[1:] = (key[1:] != key[:-1]) | (row[1:] != row[:-1] + 1)
    is_last = np.roll(is_first, -1)
    if len(row):
        is_last[-1] = True
    return Rectangles(row[is_first], row[is_last] + 1, start[is_first], stop[is_first])


class Surface(NamedTuple):
    """A closed surface of triangles between corners."""

    corners: Integers  # row and column in cells, shape (N, 2)
    levels: Bytes  # of corners, shape (N,): 0 is the floor, 2 the top, 1 half-way
    triangles: Integers  # shape (M, 3), anticlockwise seen from outside


def surface(marked: Mask) -> Surface:
    # Each edge belongs to exactly two triangles. Where two marked cells share only a corner, four
    # walls meet: the vertical edge is divided at half height for two of these walls.
    found = _rectangles_by_rows(marked)
    stride = marked.shape[1] + 1
    lower, upper = found.first_row * stride, found.end_row * stride
    is_corner = np.zeros((marked.shape[0] + 1) * stride, dtype=np.bool_)
    for edge in (lower, upper):
        for col in found[2:]:
            is_corner[edge + col] = True
    keys = np.flatnonzero(is_corner)
    points = np.stack([keys // stride, keys % stride], axis=1)
    number_of = np.cumsum(is_corner, dtype=np.int32) - np.int32(1)
    # for each rectangle the indices in `points` of the ends of its lower and upper edge
    low, low_end = (number_of[lower + col].astype(np.int64) for col in found[2:])
    top, top_end = (number_of[upper + col].astype(np.int64) for col in found[2:])
    caps = np.concatenate([_fan(low, low_end, top), _fan(top, top_end, low_end, turned=True)])
    count = len(keys)
    cells = np.pad(marked, 1)
    rows, cols = points.T
    south_west, south_east = cells[rows, cols], cells[rows, cols + 1]
    north_west, north_east = cells[rows + 1, cols], cells[rows + 1, cols + 1]
    pinched = (south_west == north_east) & (south_east == north_west) & (south_west != south_east)
    # walls, with the marked cells on their left: begin, end, and whether each end is divided
    _, bottom = enumerated(low, low_end)
    _, above = enumerated(top, top_end)
    bottom = bottom[~cells[rows[bottom], cols[bottom] + 1]]
    above = above[~cells[rows[above] + 1, cols[above] + 1]]
    begin = np.concatenate([bottom, low_end, above + 1, top])
    end = np.concatenate([bottom + 1, top_end, above, low])
    of_bottom, of_side = np.zeros(len(bottom), np.bool_), np.zeros(len(top), np.bool_)
    begin_divided = np.concatenate([of_bottom, of_side, pinched[above + 1], pinched[top]])
    end_divided = np.concatenate([of_bottom, pinched[top_end], pinched[above], of_side])
    middles = np.flatnonzero(pinched)
    middle_of = np.zeros(count, dtype=np.int64)
    middle_of[middles] = 2 * count + np.arange(len(middles))
    walls = _walls(begin, end, begin_divided, end_divided, count, middle_of)
    levels = np.repeat(np.array([0, 2, 1], dtype=np.uint8), [count, count, len(middles)])
    triangles = np.concatenate([caps[:, ::-1], caps + count, walls])
    return Surface(np.concatenate([points, points, points[middles]]), levels, triangles)


def _fan(first: Integers, last: Integers, apex: Integers, *, turned: bool = False) -> Integers:
    """Return anticlockwise triangles from the pieces of edges to the apex of each edge."""
    whose, number = enumerated(first, last)
    ends = (number + 1, number) if turned else (number, number + 1)
    return np.stack([*ends, apex[whose]], axis=1)


def _walls(
    begin: Integers, end: Integers, begin_divided: Mask, end_divided: Mask, count: int,
    middle_of: Integers,
) -> Integers:  # fmt: skip
    """Return the triangles of walls; divided ends have a corner at half height."""
    parts = []
    for from_middle, to_middle in ((False, False), (True, False), (False, True), (True, True)):
        chosen = (begin_divided == from_middle) & (end_divided == to_middle)
        p, q = begin[chosen], end[chosen]
        p_top, q_top, p_mid, q_mid = p + count, q + count, middle_of[p], middle_of[q]
        corners = {
            (False, False): [(p, q, q_top), (p, q_top, p_top)],
            (True, False): [(p, q, p_mid), (p_mid, q, q_top), (p_mid, q_top, p_top)],
            (False, True): [(p, q, q_mid), (p, q_mid, p_top), (p_top, q_mid, q_top)],
            (True, True): [(p, q, q_mid), (p, q_mid, p_mid), (p_mid, q_mid, q_top),
                           (p_mid, q_top, p_top)],
        }[from_middle, to_middle]  # fmt: skip
        parts += [np.stack(triangle, axis=1) for triangle in corners]
    return np.concatenate(parts)
