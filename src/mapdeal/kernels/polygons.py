"""Polygons of cells: outline and inside, exactly, in integers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mapdeal.kernels.bresenham import Cell, Edges, edges_through, runs
from mapdeal.kernels.spans import Indices, Spans, bands, enumerated

_COUNT_BITS = 20
"""Bits that count how many runs of one kind a cell lies in; three such counts share 64 bits."""
_SOLID, _HOLLOW, _RIM = (1 << (_COUNT_BITS * k) for k in range(3))
_ONE_COUNT = (1 << _COUNT_BITS) - 1


def polygon_spans(rings: Sequence[Sequence[Cell]], shape: tuple[int, int]) -> Iterator[Spans]:
    """Return the cells of a polygon of any form, with holes or without, in parts.

    Notes
    -----
    The outline is costmap_2d's lines of cells between the corners; inside of it is every cell
    whose centre an odd number of edges between the corners' centres surround. What is inside
    of a hole in the same sense, but not on its edge, is left out. What comes of a polygon that
    reaches beyond the grid is exactly its part inside of it.

    For a convex polygon these are the cells of costmap_2d's ``convexFillCells``, which fills
    each column from its lowest to its highest cell: a column meets just two of its edges, also
    after the corners were moved to their cells, since that keeps their order along both axes;
    and a cell between the two lines of cells lies between the edges.
    """
    ring_of = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    yield from _drawn(_edges_of(rings), ring_of, shape)


def stacked_spans(outlines: Sequence[Sequence[Cell]], shape: tuple[int, int]) -> Iterator[Spans]:
    """Return the cells of many polygons that share no rows: as `polygon_spans` does of each.

    Examples
    --------
    >>> (spans,) = stacked_spans([[(0, 0), (0, 4), (1, 0)], [(2, 1), (3, 1), (3, 2)]], (4, 9))
    >>> [column.tolist() for column in spans]
    [[0, 1, 2, 3], [0, 0, 1, 1], [5, 3, 2, 3]]
    """
    edges = _edges_of(outlines)
    yield from _drawn(edges, np.zeros(len(edges.row), dtype=np.int64), shape)


def _edges_of(rings: Sequence[Sequence[Cell]]) -> Edges:
    of_rings = [edges_through(ring, closed=True) for ring in rings]
    return Edges(*(np.concatenate(columns) for columns in zip(*of_rings, strict=True)))


def _drawn(edges: Edges, ring_of: Indices, shape: tuple[int, int]) -> Iterator[Spans]:
    """Return the cells of rings, of which the first may have any number of parts."""
    for bottom, top in bands(edges.bottom, edges.top + 1, shape[0]):
        which, outline = runs(edges, bottom, top)
        rim = ring_of[which]
        inside_of, inside = _inside(edges, ring_of, bottom, top, shape[1])
        spans = Spans(*map(np.concatenate, zip(outline, inside, strict=True)))
        kinds = np.where(
            np.concatenate([rim, inside_of]) == 0,
            _SOLID,
            np.repeat([_RIM, _HOLLOW], [len(rim), len(inside_of)]),
        )
        yield _covered(spans, kinds, shape[1])


def _inside(
    edges: Edges, ring_of: Indices, bottom: int, top: int, width: int
) -> tuple[Indices, Spans]:
    """Return whose inside it is, and the cells inside of each ring by the even-odd rule.

    Cells on an edge belong to the outline, and may be missing here.
    """
    which, rows = enumerated(np.maximum(edges.bottom, bottom), np.minimum(edges.top, top))
    row, col, next_row, next_col = edges.chosen(which)
    up = next_row > row
    low_row, low_col = np.where(up, row, next_row), np.where(up, col, next_col)
    high_row, high_col = np.where(up, next_row, row), np.where(up, next_col, col)
    # First column that is not left of the edge at the rows' centres.
    passed = -(((rows - low_row) * (low_col - high_col)) // (high_row - low_row))
    cols = np.clip(low_col + passed, 0, width)
    count = int(ring_of[-1]) + 1
    keys = np.sort(((rows - bottom) * count + ring_of[which]) * (width + 1) + cols)
    places, cols = np.divmod(keys, width + 1)
    # A closed ring crosses a row an even number of times: enter, leave, enter, leave.
    rows, rings = np.divmod(places[::2], count)
    return rings, Spans(rows + bottom, cols[::2], cols[1::2])


def _covered(spans: Spans, kinds: Indices, width: int) -> Spans:
    """Return the runs of cells that are solid, and in no hollow or on its rim; none overlap."""
    starts, stops = (np.clip(ends, 0, width) for ends in (spans.starts, spans.stops))
    keys = np.concatenate([spans.rows * (width + 1) + ends for ends in (starts, stops)])
    order = np.argsort(keys, kind="stable")
    keys, counts = keys[order], np.cumsum(np.concatenate([kinds, -kinds])[order])
    is_last = np.append(keys[1:] != keys[:-1], True)
    keys, counts = keys[is_last], counts[is_last]
    solid = (counts & _ONE_COUNT) > 0
    hollow = ((counts >> _COUNT_BITS) & _ONE_COUNT) > 0
    rim = (counts >> (2 * _COUNT_BITS)) > 0
    covered = solid & (~hollow | rim)
    change = np.diff(covered.astype(np.int8), prepend=0)
    rows, begins = np.divmod(keys[change == 1], width + 1)
    return Spans(rows, begins, keys[change == -1] % (width + 1))
