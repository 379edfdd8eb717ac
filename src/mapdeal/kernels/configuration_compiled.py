"""Open poses and the ways between them, compiled.

`mapdeal.kernels.configuration_space` has the rules, `configuration_space.h` the algorithms.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels._configuration_space import PoseMaker, flood
from mapdeal.kernels.blocks import Layer
from mapdeal.kernels.polygons import Spans, halves
from mapdeal.kernels.threads import for_rows, in_parallel, thread_count

Bits = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Words = NDArray[np.uint64]

_WORD, _SHIFTS, _WIDE = 64, 8, 16
_BAND_ROWS = 32
"""Rows of poses that are made together: more save work at their edges, fewer stay in the cache."""

_SHARE_WAITING = 64
"""One of so many tiles may wait at a time."""

_FEWEST_WAITING = 1024


class OpenPoses:
    """A bit for each heading of each cell; a word is 64 cells of a row."""

    def __init__(self, blocked: Layer, footprints: Sequence[Spans]) -> None:
        self.shape = blocked.shape
        self._count = len(footprints)
        self._maker = _maker(_packed(blocked), self.shape, footprints)
        self.headings = np.empty(self.shape, dtype=np.uint8)
        self._planes: Words | None = self._made(self.headings)

    def at(self, row: int, col: int) -> Mask:
        """Return which headings are open in a cell, shape (K,)."""
        if self._planes is None:
            self._planes = self._made()
        return _bits_at(self._planes, row, col)

    def reach(
        self, seeds: Sequence[tuple[int, int, int]], cells: Sequence[tuple[int, int]]
    ) -> tuple[NDArray[np.uint8], Mask]:
        """Return which cells are reached from poses, and in which headings those asked for are."""
        planes = self._made() if self._planes is None else self._planes
        self._planes = None  # what is reached is taken out
        opened = [_bits_at(planes, row, col) for row, col in cells]
        reached = np.zeros(planes.shape[:2], dtype=np.uint64)
        starts = np.array(seeds, dtype=np.int64).reshape(-1, 3)
        most = _most_waiting(reached.size)
        flood(self._maker, planes, reached, starts, most)
        headings = np.zeros((len(cells), self._count), dtype=np.bool_)
        for k, (row, col) in enumerate(cells):
            headings[k] = opened[k] & ~_bits_at(planes, row, col)
        del planes
        return _unpacked(reached, self.shape), headings

    def _made(self, numbers: Bits | None = None) -> Words:
        """Return the planes of open poses, and fill in how many headings are open in each cell."""
        height, width = self.shape
        planes = np.empty((height, -(-width // _WORD), self._count), dtype=np.uint64)

        def make(first: int, end: int) -> None:
            for row in range(first * _BAND_ROWS, min(end * _BAND_ROWS, height), _BAND_ROWS):
                self._maker.make(row, min(row + _BAND_ROWS, height), planes, numbers)

        in_parallel(make, -(-height // _BAND_ROWS))
        return planes


def memory(shape: tuple[int, int], heading_count: int, extent: int) -> int:
    """Return what `mapdeal.kernels.configuration_space.memory` does."""
    height, width = shape
    tiles = height * -(-width // _WORD)
    of_tile = 8 * heading_count
    # the cells that are blocked, those that are reached, and the slots of tiles
    beside = height * (width // 8 + 1) + tiles * (8 + 4 + 1)
    waiting = _most_waiting(tiles) * (of_tile + 4 + 8)
    rows, words = _BAND_ROWS + min(extent, height), _WIDE + 1 + min(extent, width) // _WORD
    areas = thread_count() * rows * (extent.bit_length() + 1) * words * 8
    return tiles * of_tile + beside + max(waiting, areas) + 2 * height * width


def _most_waiting(tiles: int) -> int:
    return max(_FEWEST_WAITING, tiles // _SHARE_WAITING)


def _bits_at(planes: Words, row: int, col: int) -> Mask:
    word, bit = divmod(col, _WORD)
    bits: Mask = (planes[row, word] >> np.uint64(bit) & np.uint64(1)).astype(np.bool_)
    return bits


def _packed(blocked: Layer) -> Bits:
    """Return a bit a cell, the lowest first; those behind the last are set."""
    height, width = blocked.shape
    packed = np.empty((height, -(-width // 8)), dtype=np.uint8)

    def pack(rows: slice) -> None:
        packed[rows] = np.packbits(blocked[rows], axis=1, bitorder="little")

    for_rows(pack, (height, width))
    if width % 8:
        packed[:, -1] |= 0xFF << width % 8 & 0xFF
    return packed


def _unpacked(words: Words, shape: tuple[int, int]) -> Bits:
    """Return a byte a cell of a bit a cell."""
    values = np.empty(shape, dtype=np.uint8)

    def unpack(rows: slice) -> None:
        bits = words[rows].view(np.uint8)
        values[rows] = np.unpackbits(bits, axis=1, count=shape[1], bitorder="little")

    for_rows(unpack, shape)
    return values


def _maker(blocked: Bits, shape: tuple[int, int], footprints: Sequence[Spans]) -> PoseMaker:
    """Return what makes poses: the runs of all headings, as places in a work area."""
    fitting = [_fits(spans, shape) for spans in footprints]
    runs = [halves(spans) for spans, fits in zip(footprints, fitting, strict=True) if fits]
    if not runs:
        nothing = np.zeros(0, dtype=np.int64)
        firsts = np.zeros(_SHIFTS * len(footprints) + 1, dtype=np.int64)
        return PoseMaker(blocked, shape[1], firsts, nothing, (0, 0, 0, 1, _WIDE, _BAND_ROWS))
    heading = np.repeat(np.flatnonzero(fitting), [len(rows) for rows, _, _ in runs])
    rows, starts, exponents = map(np.concatenate, zip(*runs, strict=True))
    first_row, first_byte = int(rows.min()), int(starts.min()) // 8
    levels = int(exponents.max()) + 1
    ends = starts + (1 << exponents) - 8 * first_byte
    level_words = _WIDE + 1 + int(ends.max()) // _WORD
    halo = int(rows.max()) - first_row
    bits = starts - 8 * first_byte
    offsets = ((rows - first_row) * levels + exponents) * (8 * level_words) + bits // 8
    kinds = heading * _SHIFTS + bits % 8
    order = np.lexsort((offsets, kinds))
    firsts = np.searchsorted(kinds[order], np.arange(_SHIFTS * len(footprints) + 1))
    area = first_row, first_byte, halo, levels, level_words, _BAND_ROWS
    return PoseMaker(blocked, shape[1], firsts.astype(np.int64), offsets[order], area)


def _fits(spans: Spans, shape: tuple[int, int]) -> bool:
    return all(
        max(0, -int(starts.min())) <= min(size - 1, size - int(stops.max()))
        for starts, stops, size in (
            (spans.rows, spans.rows + 1, shape[0]),
            (spans.starts, spans.stops, shape[1]),
        )
    )
