"""Sizes of connected components, found while rows go by: no labels of the whole are kept.

Marked cells are runs along their rows. Runs of neighbouring rows that touch are joined; of what is
behind, only the components that reach the last row can still grow. Of each size some components are
remembered by a cell of theirs: the middle of the longest run, which is well inside of most.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.groups import least_joined

Cells = NDArray[np.int64]

MOST_PLACES = 20
"""Components of a size of which a cell is kept."""

_CELLS_TOGETHER = 1 << 18
_NOWHERE = np.iinfo(np.int64).max


class _Front(NamedTuple):
    """The runs of the last row, shape (N,), and the components that they belong to."""

    starts: Cells
    stops: Cells
    components: Cells
    """Of each run, 0 .. K - 1."""
    sizes: Cells
    """Cells so far of each component, shape (K,)."""
    longest: Cells
    """The longest run so far of each component, cells."""
    middles: Cells
    """The cell in the middle of that."""


class Components:
    """Measures the 8-connected components of marked cells, of which some rows come at a time."""

    def __init__(self, last_row: int | None = None) -> None:
        nothing = np.zeros(0, dtype=np.int64)
        self._front = _Front(nothing, nothing, nothing, nothing, nothing, nothing)
        self._closed: Counter[int] = Counter()
        self._places: dict[int, list[int]] = {}
        self._row, self._step = (0, 1) if last_row is None else (last_row, -1)

    def add(self, marked: NDArray[np.bool_]) -> None:
        """Take the next rows."""
        height, width = marked.shape
        step = max(1, _CELLS_TOGETHER // width)
        for first in range(0, height, step):
            self._add_band(marked[first : first + step])

    def sizes(self) -> tuple[Cells, Cells]:
        """Return the sizes of the components so far, and how many there are of each."""
        found = self._closed + Counter(self._front.sizes.tolist())
        listed = sorted(found.items())
        sizes, counts = np.array(listed, dtype=np.int64).reshape(-1, 2).T
        return sizes, counts

    def places(self) -> dict[int, list[int]]:
        """Return a cell of some components of each size, those with the lowest of such cells."""
        found = {size: list(listed) for size, listed in self._places.items()}
        for size, middle in zip(
            self._front.sizes.tolist(), self._front.middles.tolist(), strict=True
        ):
            found.setdefault(size, []).append(middle)
        return {size: sorted(found[size])[:MOST_PLACES] for size in sorted(found)}

    def _add_band(self, marked: NDArray[np.bool_]) -> None:
        height, width = marked.shape
        front, stride = self._front, width + 1
        starts, stops = _runs(marked)
        # the last row of the band before comes first, as row 0
        before, live = len(front.starts), len(front.sizes)
        all_starts = np.concatenate([front.starts, starts + stride])
        all_stops = np.concatenate([front.stops, stops + stride])
        nodes = np.concatenate([front.components, live + np.arange(len(starts))])
        one, other = _touching(all_starts, all_stops, stride)
        least = least_joined(nodes[one], nodes[other], live + len(starts))
        lengths = stops - starts
        cells = np.concatenate([front.sizes, lengths])
        sizes = np.zeros(len(cells), dtype=np.int64)
        np.add.at(sizes, least, cells)
        longest, middles = _middles(
            least,
            np.concatenate([front.longest, lengths]),
            np.concatenate([front.middles, self._middles_of(starts, lengths, marked.shape)]),
        )
        self._row += self._step * height
        in_last_row = before + int(np.searchsorted(starts, (height - 1) * stride))
        reached, components = np.unique(least[nodes[in_last_row:]], return_inverse=True)
        shift = height * stride
        self._front = _Front(
            all_starts[in_last_row:] - shift, all_stops[in_last_row:] - shift, components,
            sizes[reached], longest[reached], middles[reached],
        )  # fmt: skip
        sizes[reached] = 0
        closed = np.flatnonzero(sizes)
        self._close(sizes[closed], middles[closed])

    def _middles_of(self, starts: Cells, lengths: Cells, shape: tuple[int, int]) -> Cells:
        """Return the cell in the middle of each run of a band, as the whole grid counts cells."""
        height, width = shape
        rows = np.arange(height)
        bounds = np.searchsorted(starts, np.append(rows, height) * (width + 1))
        in_whole = (self._row + self._step * rows) * width
        shifts = np.repeat(in_whole - rows * (width + 1), np.diff(bounds))
        return starts + shifts + ((lengths - 1) >> 1)

    def _close(self, sizes: Cells, middles: Cells) -> None:
        """Count components that grow no more."""
        if not len(sizes):
            return
        short = sizes.astype(np.uint16) if sizes.max() < 1 << 16 else sizes  # sorted in one go
        order = np.argsort(short, kind="stable")
        sizes, middles = sizes[order], middles[order]
        firsts = np.flatnonzero(np.diff(sizes, prepend=0))
        stops = np.append(firsts[1:], len(sizes))
        for size, first, stop in zip(
            sizes[firsts].tolist(), firsts.tolist(), stops.tolist(), strict=True
        ):
            self._closed[size] += stop - first
            some = middles[first:stop]
            if len(some) > MOST_PLACES:
                some = np.partition(some, MOST_PLACES)[:MOST_PLACES]
            kept = self._places.get(size, [])
            self._places[size] = sorted(kept + some.tolist())[:MOST_PLACES]


def _middles(least: Cells, lengths: Cells, middles: Cells) -> tuple[Cells, Cells]:
    """Return the length and the middle of the longest run of each component."""
    longest = np.zeros(len(least), dtype=np.int64)
    np.maximum.at(longest, least, lengths)
    is_longest = lengths == longest[least]
    found = np.full(len(least), _NOWHERE)
    np.minimum.at(found, least[is_longest], middles[is_longest])
    return longest, found


def _runs(marked: NDArray[np.bool_]) -> tuple[Cells, Cells]:
    """Return where runs of marked cells begin and end, as numbers of cells.

    Rows are counted as one cell wider than they are, so that no run touches one of the next row.
    """
    height, width = marked.shape
    edges = np.empty((height, width + 1), dtype=np.bool_)
    edges[:, 0], edges[:, -1] = marked[:, 0], marked[:, -1]
    np.not_equal(marked[:, 1:], marked[:, :-1], out=edges[:, 1:-1])
    at = np.flatnonzero(edges)
    return at[::2], at[1::2]


def _touching(starts: Cells, stops: Cells, stride: int) -> tuple[Cells, Cells]:
    """Return pairs of runs, as positions in the list, that touch over an edge or a corner."""
    first = np.searchsorted(stops, starts + stride)
    behind = np.searchsorted(starts, stops + stride, side="right")
    counts = np.maximum(behind - first, 0)
    one = np.repeat(np.arange(len(starts)), counts)
    ends = np.cumsum(counts)
    other = np.arange(len(one)) + np.repeat(first - ends + counts, counts)
    return one, other
