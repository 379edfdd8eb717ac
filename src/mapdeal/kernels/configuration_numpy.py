"""Open poses and the ways between them, in numpy and scipy: the twin of the compiled kernel.

`mapdeal.kernels.configuration_space` has the rules.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.blocks import Layer
from mapdeal.kernels.components import least_joined
from mapdeal.kernels.polygons import Indices, Spans, halves

Bits = NDArray[np.uint8]
Labels = NDArray[np.int32]
Mask = NDArray[np.bool_]


class OpenPoses:
    """A plane of bits for each heading."""

    def __init__(self, blocked: Layer, footprints: Sequence[Spans]) -> None:
        self.shape = blocked.shape
        dilations = _Dilations(np.asarray(blocked))
        self._planes = [np.packbits(dilations.open_cells(spans), axis=1) for spans in footprints]
        self.headings = np.zeros(self.shape, dtype=np.uint8)
        for k in self._all():
            self.headings += self._plane(k)

    def at(self, row: int, col: int) -> Mask:
        """Return which headings are open in a cell, shape (K,)."""
        return np.array([self._plane(k, slice(row, row + 1))[0, col] for k in self._all()])

    def reach(
        self, seeds: Sequence[tuple[int, int, int]], cells: Sequence[tuple[int, int]]
    ) -> tuple[NDArray[np.uint8], Mask]:
        """Return which cells are reached from poses, and in which headings those asked for are."""
        counts, (one, other) = self._joined()
        firsts = np.cumsum([0, *counts])
        least = least_joined(one, other, int(firsts[-1]))
        labels = [self._labels(heading)[row, col] for heading, row, col in seeds]
        is_reached = np.zeros(len(least), dtype=np.bool_)
        for (heading, _, _), label in zip(seeds, labels, strict=True):
            if label:
                is_reached[least[firsts[heading] + label - 1]] = True
        reachable = np.zeros(self.shape, dtype=np.uint8)
        headings = np.zeros((len(cells), len(self._planes)), dtype=np.bool_)
        rows, cols = np.array(cells, dtype=np.int64).reshape(-1, 2).T
        for k in self._all():
            of_labels = np.append(False, is_reached[least[firsts[k] : firsts[k + 1]]])
            reached = of_labels[self._labels(k)]
            reachable |= reached
            headings[:, k] = reached[rows, cols]
        return reachable, headings

    def _all(self) -> range:
        return range(len(self._planes))

    def _plane(self, heading: int, rows: slice = slice(None)) -> Mask:
        width = self.shape[1]
        return np.unpackbits(self._planes[heading][rows], axis=1, count=width).view(np.bool_)

    def _labels(self, heading: int) -> Labels:
        """Return the component, 1, 2, ... of each open cell, 0 elsewhere: always the same."""
        from scipy import ndimage

        labels: Labels = ndimage.label(self._plane(heading))[0]
        return labels

    def _joined(self) -> tuple[list[int], NDArray[np.int64]]:
        """Return how many components each heading has, and which touch the next heading's."""
        counts, pairs = [], []
        before = first = self._labels(0)
        start = 0
        for labels in chain(map(self._labels, range(1, len(self._planes))), [first]):
            counts.append(int(before.max(initial=0)))
            following = start + counts[-1] if len(counts) < len(self._planes) else 0
            both = (before > 0) & (labels > 0)
            found = np.unique(before[both].astype(np.int64) << 32 | labels[both])
            pairs.append([start - 1 + (found >> 32), following - 1 + (found & 0xFFFFFFFF)])
            before, start = labels, following
        return counts, np.concatenate(pairs, axis=1)


def memory(shape: tuple[int, int], heading_count: int, extent: int) -> int:
    """Return what `mapdeal.kernels.configuration_space.memory` does."""
    height, width = shape
    planes = heading_count * height * (width // 8 + 1)
    dilations = height * width * (extent.bit_length() + 3)
    # three headings' labels, and pairs of those that touch, which are sorted
    labels = height * width * (3 * 4 + 3 * 8 + 6)
    return planes + max(dilations, labels) + 2 * height * width


class _Dilations:
    """Blocked cells, and for each power of two where such a run of cells has a blocked one."""

    def __init__(self, blocked: Mask) -> None:
        self._of_exponents = [blocked]
        """Of exponent e in column j: whether one of the columns j .. j + 2^e - 1 is blocked."""

    def open_cells(self, spans: Spans) -> Mask:
        height, width = self._of_exponents[0].shape
        rows = _held(spans.rows, spans.rows + 1, height)
        cols = _held(spans.starts, spans.stops, width)
        opened = np.zeros((height, width), dtype=np.bool_)
        inner = opened[rows, cols]
        inner[:] = True
        if inner.size:
            runs = (column.tolist() for column in halves(spans))
            for row, start, exponent in zip(*runs, strict=True):
                touched = self._dilated(exponent)[
                    rows.start + row : rows.stop + row, cols.start + start : cols.stop + start
                ]
                inner &= ~touched
        return opened

    def _dilated(self, exponent: int) -> Mask:
        while len(self._of_exponents) <= exponent:
            last = self._of_exponents[-1]
            step = 1 << (len(self._of_exponents) - 1)
            self._of_exponents.append(last[:, :-step] | last[:, step:])
        return self._of_exponents[exponent]


def _held(starts: Indices, stops: Indices, size: int) -> slice:
    """Return the places from which all these runs are within 0 .. `size` - 1."""
    first, end = max(0, -int(starts.min())), min(size, size + 1 - int(stops.max()))
    return slice(first, max(first, end))
