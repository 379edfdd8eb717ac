"""Cells of polygons, discs and lines, as spans of rows.

References
----------
``raytraceLine`` and ``bresenham2D`` in ``costmap_2d.hpp`` of both ROS navigation stacks: n is
the larger difference, the error starts at n // 2 and grows by the smaller difference with each
step; where it reaches n, the minor axis moves. So after i steps the minor axis has moved
(n // 2 + i * minor) // n times. The line from b to a is not always that from a to b.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.int64]

_SHORT = 8
"""Cells up to which runs are painted all together, cell by cell, rather than one by one."""

MOST_TOGETHER = 1 << 20
"""Runs that are made at the same time, so that no shape takes memory beyond its map's."""


class Spans(NamedTuple):
    """Cells as runs along rows; runs may overlap."""

    rows: Indices
    starts: Indices
    stops: Indices

    def clipped(self, width: int) -> Spans:
        """Return what lies in columns 0 .. `width` - 1, without empty runs."""
        starts, stops = np.clip(self.starts, 0, width), np.clip(self.stops, 0, width)
        kept = starts < stops
        return Spans(self.rows[kept], starts[kept], stops[kept])


def paint(
    values: NDArray[Any], spans: Spans, value: int, *, over: NDArray[np.bool_] | None = None
) -> None:
    """Give the cells of `spans` a value, in place."""
    long, short = _by_length(spans)
    for row, start, stop in zip(*(column.tolist() for column in long), strict=True):
        cells = values[row, start:stop]
        if over is None:
            cells[:] = value
        else:
            cells[over[cells.view(np.uint8)]] = value
    for rows, cols in short:
        if over is not None:
            kept = over[values[rows, cols].view(np.uint8)]
            rows, cols = rows[kept], cols[kept]
        values[rows, cols] = value


def enumerated(starts: Indices, stops: Indices) -> tuple[Indices, Indices]:
    """Return the numbers of all half open ranges one after the other, and whose each is.

    Examples
    --------
    >>> whose, numbers = enumerated(np.array([5, 0, 2]), np.array([7, 0, 5]))
    >>> whose.tolist(), numbers.tolist()
    ([0, 0, 2, 2, 2], [5, 6, 2, 3, 4])
    """
    counts = np.maximum(stops - starts, 0)
    whose = np.repeat(np.arange(len(counts)), counts)
    before = np.cumsum(counts) - counts
    return whose, np.arange(len(whose)) - before[whose] + starts[whose]


def halves(spans: Spans) -> tuple[Indices, Indices, Indices]:
    """Return two runs for each, as long as a power of two, that overlap and together are it.

    Examples
    --------
    >>> spans = Spans(np.array([4, 5]), np.array([0, -1]), np.array([4, 4]))
    >>> [column.tolist() for column in halves(spans)]
    [[4, 5, 5], [0, -1, 0], [2, 2, 2]]
    """
    lengths = spans.stops - spans.starts
    exponents = np.frexp(lengths.astype(np.float64))[1].astype(np.int64) - 1
    second = np.flatnonzero(lengths != 1 << exponents)
    others = (spans.stops - (1 << exponents))[second]
    return (
        np.concatenate([spans.rows, spans.rows[second]]),
        np.concatenate([spans.starts, others]),
        np.concatenate([exponents, exponents[second]]),
    )


def bands(starts: Indices, stops: Indices, height: int) -> Iterator[tuple[int, int]]:
    """Return ranges of rows that hold about `MOST_TOGETHER` rows of all given ranges each."""
    change = np.zeros(height + 1, dtype=np.int64)
    np.add.at(change, np.clip(starts, 0, height), 1)
    np.add.at(change, np.clip(np.maximum(starts, stops), 0, height), -1)
    in_row = np.cumsum(change[:-1])
    used = np.flatnonzero(in_row)
    if used.size == 0:
        return
    bottom, top = int(used[0]), int(used[-1]) + 1
    share = np.cumsum(in_row[bottom:top]) // MOST_TOGETHER
    edges = bottom + np.flatnonzero(np.diff(share, prepend=-1))
    yield from zip(edges.tolist(), [*edges[1:].tolist(), top], strict=True)


def _by_length(spans: Spans) -> tuple[Spans, Iterator[tuple[Indices, Indices]]]:
    """Return the long runs, and the cells of the short ones, each once per run."""
    lengths = spans.stops - spans.starts
    is_long = lengths > _SHORT
    long = Spans(*(column[is_long] for column in spans))
    rows, starts, lengths = spans.rows[~is_long], spans.starts[~is_long], lengths[~is_long]

    def cells() -> Iterator[tuple[Indices, Indices]]:
        for k in range(_SHORT):
            reach = lengths > k
            if not reach.any():
                return
            yield rows[reach], starts[reach] + k

    return long, cells()


_TOLERANCE = 1e-9
"""In cells: centres exactly on the rim belong to the shape, whatever rounding says."""

_LEVEL = 1e-12
"""In cells: a side that rises less lies within a single row's centre line."""

Position = tuple[float, float]


def capsule_spans(
    start: Position, stop: Position, radius: float, shape: tuple[int, int]
) -> Spans:  # fmt: skip
    """Return the cells whose centre lies within a distance of the segment between two points."""
    reach = radius + _TOLERANCE
    bottom = math.ceil(max(min(start[0], stop[0]) - reach - 0.5, 0))
    top = math.floor(min(max(start[0], stop[0]) + reach - 0.5, shape[0] - 1))
    rows = np.arange(bottom, top + 1, dtype=np.int64)
    if rows.size == 0:
        return Spans(rows, rows, rows)
    y: NDArray[np.float64] = rows.astype(np.float64) + 0.5
    # The shape is convex, so that it meets each row in one run: from the leftmost to the
    # rightmost of its parts.
    ends = [_disc(start, reach, y), _disc(stop, reach, y), *_rim(start, stop, reach, y)]
    left = np.min([end[0] for end in ends], axis=0)
    right = np.max([end[1] for end in ends], axis=0)
    first = np.ceil(np.clip(left - 0.5, -1, shape[1] + 1))
    last = np.floor(np.clip(right - 0.5, -1, shape[1] + 1))
    return Spans(rows, first.astype(np.int64), last.astype(np.int64) + 1).clipped(shape[1])


_Ends = tuple[NDArray[np.float64], NDArray[np.float64]]


def _disc(centre: Position, radius: float, y: NDArray[np.float64]) -> _Ends:
    """Return where a disc begins and ends in each row; inf, -inf where it has no part."""
    squared = radius**2 - (y - centre[0]) ** 2
    half = np.sqrt(np.maximum(squared, 0.0))
    within = squared >= 0
    return (np.where(within, centre[1] - half, np.inf), np.where(within, centre[1] + half, -np.inf))


def _rim(start: Position, stop: Position, radius: float, y: NDArray[np.float64]) -> list[_Ends]:
    """Return the same of the two long sides of the rectangle around the segment."""
    (y0, x0), (y1, x1) = start, stop
    length = math.hypot(y1 - y0, x1 - x0)
    if length == 0.0:
        return []
    across_y, across_x = radius * (x1 - x0) / length, -radius * (y1 - y0) / length
    sides = []
    for sign in (-1, 1):
        a_y, a_x = y0 + sign * across_y, x0 + sign * across_x
        b_y, b_x = y1 + sign * across_y, x1 + sign * across_x
        if abs(b_y - a_y) < _LEVEL:
            continue  # along a row: the discs at its ends reach as far
        share = (y - a_y) / (b_y - a_y)
        x = a_x + share * (b_x - a_x)
        within = (share >= 0) & (share <= 1)
        sides.append((np.where(within, x, np.inf), np.where(within, x, -np.inf)))
    return sides


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
        return Edges(*(column[which] for column in self))


def edges_through(cells: Sequence[Cell], *, closed: bool = False) -> Edges:
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


_COUNT_BITS = 20
"""Bits that count how many runs of one kind a cell lies in; three such counts share 64 bits."""
_SOLID, _HOLLOW, _RIM = (1 << (_COUNT_BITS * k) for k in range(3))
_ONE_COUNT = (1 << _COUNT_BITS) - 1


def polygon_spans(rings: Sequence[Sequence[Cell]], shape: tuple[int, int]) -> Iterator[Spans]:
    """Return the cells of a polygon of any form, with holes or without, in parts."""
    # The outline is costmap_2d's lines of cells between the corners; inside of it is every cell
    # whose centre an odd number of edges between the corners' centres surround. What is inside of a
    # hole in the same sense, but not on its edge, is left out. What comes of a polygon that reaches
    # beyond the grid is exactly its part inside of it.
    # For a convex polygon these are the cells of costmap_2d's ``convexFillCells``, which fills each
    # column from its lowest to its highest cell: a column meets just two of its edges, also after
    # the corners were moved to their cells, since that keeps their order along both axes; and a
    # cell between the two lines of cells lies between the edges.
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
    """Return whose inside it is, and the cells inside of each ring by the even-odd rule."""
    # Cells on an edge belong to the outline, and may be missing here.
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
