"""Runs of cells along rows: what shapes become before they are painted."""

from __future__ import annotations

from collections.abc import Iterator
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
