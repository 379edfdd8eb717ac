"""What rays leave in cells, on numpy: the same to the last bit as rays.h."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.polygons import enumerated

if TYPE_CHECKING:
    from mapdeal.kernels.rays import Odds

DISTANCE_UNIT = 1 << 20
SEEN, A_HIT, MOST_HITS = 1, 2, 3

_CELLS_TOGETHER = 1 << 21

Cells = NDArray[np.int64]
Counts = NDArray[np.int32]


class _Passed(NamedTuple):
    """Cells that rays up to, but without, `stop` pass: whose, in their order, and where, flat."""

    whose: Cells
    at: Cells
    stop: int


def count_rays(
    starts: Cells, ends: Cells, is_hit: NDArray[np.bool_], hits: Counts, misses: Counts
) -> None:
    """Do as `mapdeal.kernels.rays.count_rays`."""
    for passed in _passed(starts, ends, misses.shape, with_end=False):
        np.add.at(misses.reshape(-1), passed.at, 1)
    np.add.at(hits.reshape(-1), _hit(ends, is_hit, hits.shape).at, 1)


def weigh_rays(
    starts: Cells,
    ends: Cells,
    is_hit: NDArray[np.bool_],
    odds: Odds,
    values: Counts,
    seen: NDArray[np.uint8],
) -> None:
    """Do as `mapdeal.kernels.rays.weigh_rays`."""
    hit = _hit(ends, is_hit, values.shape)
    _note_hits(hit.at, seen.reshape(-1))
    done = 0
    for whose, at, stop in _passed(starts, ends, values.shape, with_end=False):
        some = slice(done, int(np.searchsorted(hit.whose, stop)))
        done = some.stop
        at = np.concatenate([at, hit.at[some]])
        order = np.concatenate([2 * whose, 2 * hit.whose[some] + 1])
        counts = [len(whose), some.stop - some.start]
        added = np.repeat([odds.on_miss, odds.on_hit], counts)
        _add_in_order(at, order, added, odds, values, seen)


def measure_rays(
    starts: Cells,
    ends: Cells,
    sensors_rowcol: NDArray[np.float64],
    ranges: NDArray[np.float64],
    truncation: float,
    behind: float,
    sums: NDArray[np.int64] | NDArray[np.float64],
    weights: Counts,
    cell: float,
) -> None:
    """Do as `mapdeal.kernels.rays.measure_rays`."""
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


def _average_in_order(
    at: Cells, shares: NDArray[np.float64], means: NDArray[np.float64], weights: Counts
) -> None:
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


def _hit(ends: Cells, is_hit: NDArray[np.bool_], shape: tuple[int, ...]) -> _Passed:
    inside = is_hit & ((ends >= 0) & (ends < shape)).all(axis=1)
    whose = np.flatnonzero(inside)
    return _Passed(whose, ends[whose, 0] * shape[1] + ends[whose, 1], len(ends))


def _passed(
    starts: Cells, ends: Cells, shape: tuple[int, ...], *, with_end: bool
) -> Iterator[_Passed]:
    """Yield the cells of lines that lie in a grid, about `_CELLS_TOGETHER` at a time."""
    first, last, across, along = _steps_inside(starts, ends, shape, with_end=with_end)
    counts = np.maximum(last - first + 1, 0)
    share = (np.cumsum(counts) - counts) // _CELLS_TOGETHER
    edges = np.flatnonzero(np.diff(share, prepend=-1))
    for begin, stop in pairwise([*edges.tolist(), len(starts)]):
        some = slice(begin, stop)
        which, steps = enumerated(first[some], last[some] + 1)
        whose = which + begin
        n = np.maximum(np.maximum(across, along), 1)[whose]
        rows = (n // 2 + steps * across[whose]) // n
        cols = (n // 2 + steps * along[whose]) // n
        row = starts[whose, 0] + np.where(ends[whose, 0] < starts[whose, 0], -rows, rows)
        col = starts[whose, 1] + np.where(ends[whose, 1] < starts[whose, 1], -cols, cols)
        yield _Passed(whose, row * shape[1] + col, stop)


def _steps_inside(
    starts: Cells, ends: Cells, shape: tuple[int, ...], *, with_end: bool
) -> tuple[Cells, Cells, Cells, Cells]:
    """Return first and last step of each line in a grid, and its extent in rows and columns."""
    extent = np.abs(ends - starts)
    n = np.maximum(extent.max(axis=1), 1)
    first = np.zeros(len(starts), dtype=np.int64)
    last = extent.max(axis=1) - (0 if with_end else 1)
    for axis in (0, 1):
        size, start = shape[axis], starts[:, axis]
        forward = ends[:, axis] >= start
        few = np.where(forward, -start, start - (size - 1))
        many = np.where(forward, size - 1 - start, start)
        # After i steps the line has moved (n // 2 + i * extent) // n cells along this axis.
        moves = extent[:, axis] > 0
        each = np.maximum(extent[:, axis], 1)
        first = np.maximum(first, np.where(moves, -((n // 2 - few * n) // each), 0))
        last = np.minimum(last, np.where(moves, -((n // 2 - (many + 1) * n) // each) - 1, last))
        last = np.where(~moves & ((few > 0) | (many < 0)), -1, last)
    return first, last, extent[:, 0], extent[:, 1]


def _note_hits(at: Cells, seen: NDArray[np.uint8]) -> None:
    cells, counts = np.unique(at, return_counts=True)
    hits = np.minimum(seen[cells] // A_HIT + counts, MOST_HITS)
    seen[cells] = SEEN + A_HIT * hits


def _add_in_order(
    at: Cells, order: Cells, added: Cells, odds: Odds, values: Counts, seen: NDArray[np.uint8]
) -> None:
    """Add to cells in order, clamping after each: many at a time."""
    # To add and clamp, x -> min(max(x + a, low), high), is a function of three numbers, and so are
    # several of them one after the other: pairs of neighbours become one until each cell has one.
    if len(at) == 0:
        return
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
    flat = values.reshape(-1)
    flat[at] = np.clip(flat[at] + a, low, high)
    seen.reshape(-1)[at] |= SEEN
