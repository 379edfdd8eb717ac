"""What sensors measure, into cells: the points of clouds, and the evidence that rays leave.

A ray passes the cells of costmap_2d's line between both ends (`mapdeal.kernels.polygons`), the
first included, the last not: that is where it hits, or where it stops. Ends may lie outside of the
grid; what lies inside is then the same as it would be on a larger one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.arrays import Bytes, Floats, Integers, Mask
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.polygons import Edges, enumerated, runs
from mapdeal.kernels.threads import in_parallel, thread_count

_TURN = 2 * math.pi


def mark_cloud(
    points: Floats, rule: tuple[float, ...], hit: Mask, *, is_placed: bool
) -> tuple[Integers, Floats]:
    """Mark the cells of points, compiled only; return counts, and points as the robot sees them."""
    from mapdeal.kernels import _clouds

    counts = np.zeros(6, dtype=np.int64)
    counts[0] = len(points)
    if not len(points):
        return counts, np.empty((0, 2))
    seen = np.empty((len(points), 2))
    bytes_ = hit.view(np.uint8)
    found = _clouds.mark(np.ascontiguousarray(points), rule, is_placed, bytes_, seen, counts)
    return counts, seen[:found]


def cover_angles(angles: Floats, first: Floats, last: Floats) -> None:
    """Put angles into equal bins of a turn, from -pi, and keep the first and last of each."""
    if engine_name() == "compiled":
        from mapdeal.kernels import _clouds

        _clouds.cover(np.ascontiguousarray(angles), _TURN, math.pi, first, last)
        return
    angles = angles - _TURN * np.ceil((angles - math.pi) / _TURN)
    angles = np.minimum(angles, math.pi)  # rounding may have passed it
    bins = ((angles + math.pi) * (len(first) / _TURN)).astype(np.int64)
    np.clip(bins, 0, len(first) - 1, out=bins)
    np.minimum.at(first, bins, angles)
    np.maximum.at(last, bins, angles)


def cells_of_points(
    points_xy: Floats, origin: tuple[float, float, float], resolution: float,
    precision: tuple[float, float, float],
) -> Integers | None:  # fmt: skip
    """Return row and column of points, as if the grid went on for ever."""
    # `precision`: rounding, tolerance and farthest coordinate, as in clouds.h
    if engine_name() != "compiled":
        return None
    from mapdeal.kernels import _rays

    x, y, yaw = origin
    cells = np.empty(points_xy.shape, dtype=np.int64)
    is_near = _rays.cells(
        np.ascontiguousarray(points_xy), cells, x, y, math.cos(-yaw), math.sin(-yaw),
        resolution, *precision,
    )  # fmt: skip
    return cells if is_near else None


MOST_EXPANSION = 132
"""No LZF data expand to more than so many times their length: 264 bytes are a copy of 2."""


def lzf_expanded(data: bytes, size: int) -> Bytes | None:
    if size > MOST_EXPANSION * len(data):
        return None
    expanded = np.empty(size, dtype=np.uint8)
    if engine_name() == "compiled":
        from mapdeal.kernels import _compiled

        return expanded if _compiled.lzf_expand(data, expanded) else None
    return expanded if _expand(data, memoryview(expanded.data)) else None


def _expand(data: bytes, to: memoryview) -> bool:
    place = filled = 0
    while place < len(data):
        control = data[place]
        place += 1
        if control < 32:
            run = control + 1
            if run > len(data) - place or run > len(to) - filled:
                return False
            to[filled : filled + run] = data[place : place + run]
            place += run
            filled += run
            continue
        run = control >> 5
        if run == 7:
            if place >= len(data):
                return False
            run += data[place]
            place += 1
        if place >= len(data):
            return False
        back = filled - ((control & 31) << 8) - data[place] - 1
        place += 1
        run += 2
        if back < 0 or run > len(to) - filled:
            return False
        while run > 0:  # what is copied may be what was copied just now
            part = min(run, filled - back)
            to[filled : filled + part] = to[back : back + part]
            filled, run = filled + part, run - part
    return filled == len(to)


Counts = NDArray[np.int32]

DISTANCE_UNIT = 1 << 20
"""What `measure_rays` adds for a distance of one truncation: sums of whole numbers are exact."""

SEEN, A_HIT, MOST_HITS = 1, 2, 3
"""What `weigh_rays` notes of cells beside their values: hits are counted up to a few."""

_PARTS_PER_THREAD = 2  # each part of the rows costs another look at every beam
_CELLS_TOGETHER = 1 << 20


class Odds(NamedTuple):
    """What beams add to a cell's value, and between what it is kept."""

    on_miss: int
    on_hit: int
    lowest: int
    highest: int


def count_rays(
    starts: Integers, ends: Integers, is_hit: Mask, hits: Counts, misses: Counts
) -> None:
    if engine_name() == "compiled":
        from mapdeal.kernels import _rays

        _by_rows(_rays.count, hits, starts, ends, is_hit.view(np.uint8), hits, misses)
        return
    for _, at, _ in _passed(starts, ends, misses.shape, with_end=False):
        np.add.at(misses.reshape(-1), at, 1)
    np.add.at(hits.reshape(-1), _hit(ends, is_hit, hits.shape)[1], 1)


def weigh_rays(
    starts: Integers, ends: Integers, is_hit: Mask, odds: Odds, values: Counts, seen: Bytes
) -> None:
    """Add to cells, in place, what each ray says of them, clamping after each."""
    if engine_name() == "compiled":
        from mapdeal.kernels import _rays

        _by_rows(_rays.weigh, values, starts, ends, is_hit.view(np.uint8), *odds, values, seen)
        return
    who_hits, hit_at = _hit(ends, is_hit, values.shape)
    cells, counts = np.unique(hit_at, return_counts=True)
    noted = seen.reshape(-1)
    noted[cells] = SEEN + A_HIT * np.minimum(noted[cells] // A_HIT + counts, MOST_HITS)
    done = 0
    for whose, at, stop in _passed(starts, ends, values.shape, with_end=False):
        some = slice(done, int(np.searchsorted(who_hits, stop)))
        done = some.stop
        at = np.concatenate([at, hit_at[some]])
        order = np.concatenate([whose, who_hits[some]])
        added = np.repeat([odds.on_miss, odds.on_hit], [len(whose), some.stop - some.start])
        _add_in_order(at, order, added, odds, values.reshape(-1))
        noted[at] |= SEEN


def measure_rays(
    starts: Integers, ends: Integers, sensors_rowcol: Floats, ranges: Floats, truncation: float,
    behind: float, sums: Integers | Floats, weights: Counts, cell: float = 1.0,
) -> None:  # fmt: skip
    """Add to cells, in place, their signed distances to what rays hit."""
    if engine_name() == "compiled":
        from mapdeal.kernels import _rays

        _by_rows(
            _rays.measure, sums, starts, ends, np.ascontiguousarray(sensors_rowcol),
            np.ascontiguousarray(ranges), truncation, behind, cell, sums, weights,
        )  # fmt: skip
        return
    flat: NDArray[Any] = sums.reshape(-1)
    keeps_means = sums.dtype == np.float64
    for whose, at, _ in _passed(starts, ends, sums.shape, with_end=not keeps_means):
        row, col = np.divmod(at, sums.shape[1])
        y = row + 0.5 - sensors_rowcol[whose, 0]
        x = col + 0.5 - sensors_rowcol[whose, 1]
        distance = (ranges[whose] - np.sqrt(y * y + x * x) * cell) / truncation
        near = distance >= -behind
        share = np.minimum(np.maximum(distance[near], -1.0), 1.0)
        if keeps_means:
            _average_in_order(at[near], share, flat, weights.reshape(-1))
            continue
        whole = (share * DISTANCE_UNIT + (DISTANCE_UNIT + 0.5)).astype(np.int64) - DISTANCE_UNIT
        np.add.at(flat, at[near], whole)
        np.add.at(weights.reshape(-1), at[near], 1)


def _by_rows(
    work: Callable[..., None], layer: NDArray[Any], starts: Integers, ends: Integers, *others: Any
) -> None:
    # Each thread follows all rays, but only through its own rows, so that beams come to every cell
    # in their order, and nothing depends on the number of threads.
    starts, ends = np.ascontiguousarray(starts), np.ascontiguousarray(ends)
    height = len(layer)
    parts = min(height, 1 if thread_count() == 1 else _PARTS_PER_THREAD * thread_count())

    def some(first: int, end: int) -> None:
        for k in range(first, end):
            work(starts, ends, *others, height * k // parts, height * (k + 1) // parts)

    in_parallel(some, parts)


def _hit(ends: Integers, is_hit: Mask, shape: tuple[int, ...]) -> tuple[Integers, Integers]:
    whose = np.flatnonzero(is_hit & ((ends >= 0) & (ends < shape)).all(axis=1))
    return whose, ends[whose, 0] * shape[1] + ends[whose, 1]


def _passed(
    starts: Integers, ends: Integers, shape: tuple[int, ...], *, with_end: bool
) -> Iterator[tuple[Integers, Integers, int]]:
    """Yield cells of lines in a grid, about `_CELLS_TOGETHER` at a time: whose, and where, flat.

    With each they are those of all lines from the last to, but without, the third number.
    """
    height, width = shape
    edges = Edges(*starts.T, *ends.T)
    most = np.minimum(np.abs(ends - starts).max(axis=1) + 1, height + width)  # cells inside
    share = (np.cumsum(most) - most) // _CELLS_TOGETHER
    begins = np.flatnonzero(np.diff(share, prepend=-1))
    for begin, stop in pairwise([*begins.tolist(), len(starts)]):
        ray, spans = runs(edges.chosen(np.arange(begin, stop)), 0, height)
        run, cols = enumerated(np.clip(spans.starts, 0, width), np.clip(spans.stops, 0, width))
        whose, rows = ray[run] + begin, spans.rows[run]
        if not with_end:
            passed = (rows != ends[whose, 0]) | (cols != ends[whose, 1])
            whose, rows, cols = whose[passed], rows[passed], cols[passed]
        yield whose, rows * width + cols, stop


def _average_in_order(at: Integers, shares: Floats, means: Floats, weights: Counts) -> None:
    """Take what each ray says of a cell into its mean, the first of all cells, then the second."""
    order = np.argsort(at, kind="stable")
    at, shares = at[order], shares[order]
    (following,) = np.nonzero(np.diff(at, prepend=-1))
    stops = np.append(following[1:], len(at))
    while len(following):
        cells = at[following]
        means[cells] = (weights[cells] * means[cells] + shares[following]) / (weights[cells] + 1)
        weights[cells] += 1
        following += 1
        following, stops = following[following < stops], stops[following < stops]


def _add_in_order(
    at: Integers, order: Integers, added: Integers, odds: Odds, values: Counts
) -> None:
    """Add to cells in order, clamping after each: many at a time."""
    # To add and clamp, x -> min(max(x + a, low), high), is a function of three numbers, and so are
    # several of them one after the other: pairs of neighbours become one until each cell has one.
    sorting = np.lexsort((order, at))
    at, a = at[sorting], added[sorting].astype(np.int64)
    low = np.full(len(at), odds.lowest, dtype=np.int64)
    high = np.full(len(at), odds.highest, dtype=np.int64)
    while True:
        starts = np.flatnonzero(np.diff(at, prepend=-1))
        place = np.arange(len(at)) - np.repeat(starts, np.diff(starts, append=len(at)))
        first = np.flatnonzero(place % 2 == 0)
        has_next = np.append(place[1:] % 2 == 1, False)[first]
        if not has_next.any():
            break
        before = first[has_next]
        more, floor, top = a[before + 1], low[before + 1], high[before + 1]
        a[before] += more
        low[before] = np.clip(low[before] + more, floor, top)
        high[before] = np.clip(high[before] + more, floor, top)
        at, a, low, high = at[first], a[first], low[first], high[first]
    values[at] = np.clip(values[at] + a, low, high)
