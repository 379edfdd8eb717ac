"""The compiled engine: distances, clearance trees, and open poses.

The module scipy_twins.py has the same functions; the algorithms are in the files .h.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels import _clearance_tree, _compiled, arrays, components
from mapdeal.kernels._configuration_space import PoseMaker, flood
from mapdeal.kernels.arrays import Basins, Bytes, Integers, Mask, Metres, SquaredDistances
from mapdeal.kernels.blocks import Border, Halo, Layer, Runs
from mapdeal.kernels.polygons import Cell, Pose, Spans, halves
from mapdeal.kernels.threads import claim_tables, for_rows, in_bands

LONGEST_SIDE = _compiled.longest_side  # cells; the scipy twin handles longer ones
_MOST = arrays.unreachable(np.zeros(0, dtype=np.int32))
Words = NDArray[np.uint64]
_WORD, _SHIFTS, _WIDE = 64, 8, 16
_BAND_ROWS = 32  # of poses at a time: more save work at edges, fewer stay in the cache
_SHARE_WAITING = 64  # the share of tiles that may wait at a time is 1 / 64
_FEWEST_WAITING = 1024


def squares(marked: Mask, limit: int | None) -> SquaredDistances:
    squared = np.empty(marked.shape, arrays.dtype_of_squares(marked.shape))
    transform = _transform(marked, squared, limit)
    transform.to_squares(both_kinds=False)
    _run(transform, squared.size)
    return squared


def bytes_of_squares(marked: Mask, table: Bytes) -> Bytes:
    """Return the table's entry for each cell's square, the last entry for larger squares."""
    looked_up = np.empty(marked.shape, np.uint8)
    transform = _transform(marked, looked_up, len(table) - 2)
    transform.to_bytes(table)
    _run(transform, looked_up.size)
    return looked_up


def metres(
    marked: Mask, scale: float, outside_shift: float, inside_shift: float, clip: float,
    gain: float, halo: Halo | None = None,
) -> Metres:  # fmt: skip
    distance = np.empty(marked.shape, np.float32)
    cells = (clip + max(abs(outside_shift), abs(inside_shift))) / scale + 1
    beyond = math.ceil(cells * cells) if cells < LONGEST_SIDE else None
    transform = _transform(marked, distance, beyond)
    if halo is not None:
        transform.place(halo.height, _row_of(halo.before), _row_of(halo.after))
    transform.to_metres(scale, outside_shift, inside_shift, clip, gain)
    _run(transform, distance.size)
    return distance


def _row_of(row: Border | None) -> tuple[Bytes, Runs] | None:
    return None if row is None else (np.ascontiguousarray(row[0]).view(np.uint8), row[1])


def _transform(marked: Mask, result: NDArray[Any], limit: int | None) -> _compiled.Transform:
    most = _compiled.unlimited if limit is None else min(limit, _compiled.unlimited)
    mask = np.ascontiguousarray(marked).view(np.uint8)
    return _compiled.Transform(mask, result.view(np.uint8), most)


def _run(transform: _compiled.Transform, cells: int) -> None:
    in_bands(transform.scan, transform.bands, cells)
    transform.join()
    in_bands(transform.solve, transform.bands, cells)


def fits(squared: SquaredDistances) -> bool:
    """Return whether there are few enough cells, and their squares fit 32 bits."""
    if not 0 < squared.size <= _clearance_tree.most_cells:
        return False
    if squared.dtype == np.int32:
        return True
    return int(squared.max(where=squared != arrays.unreachable(squared), initial=0)) < _MOST


def clearance_tree(squared: SquaredDistances, is_traversable: Mask) -> components.ClearanceTree:
    narrow = _narrow(squared)
    basins = np.empty(narrow.shape, dtype=np.int32)
    mask = np.ascontiguousarray(is_traversable).view(np.uint8)
    work = _clearance_tree.Basins(narrow, mask, basins)
    in_bands(work.point, work.bands, narrow.size)
    peak_count, edge_count = work.counts()
    claim_tables(components.BYTES_OF_BASIN * peak_count + components.BYTES_OF_EDGE * edge_count)
    peaks, peak_cells = np.empty(peak_count, np.int64), np.empty(peak_count, np.int64)
    work.number(peaks, peak_cells)
    work.join()
    in_bands(work.label, work.bands, narrow.size)
    keys = np.empty(edge_count, dtype=np.uint64)
    work.take_edges(keys)
    spare = np.empty_like(keys)
    in_order = spare if _clearance_tree.sort_edges(keys, spare) else keys
    del keys, spare
    firsts, seconds = np.empty((2, peak_count), np.int32)
    squares, cells = np.empty((2, peak_count), np.int64)
    sets = np.arange(peak_count, dtype=np.int32)
    count = _clearance_tree.span_basins(basins, in_order, sets, firsts, seconds, squares, cells)
    for values in (peaks, squares):
        values[values == _MOST] = arrays.unreachable(squared)
    return components.ClearanceTree(
        basins, peaks, peak_cells, firsts[:count], seconds[:count], squares[:count], cells[:count]
    )


def _narrow(squared: SquaredDistances) -> NDArray[np.int32]:
    if squared.dtype == np.int32:
        return np.ascontiguousarray(squared, dtype=np.int32)
    narrow = np.empty(squared.shape, dtype=np.int32)

    def convert(rows: slice) -> None:
        narrow[rows] = np.minimum(squared[rows], _MOST)

    for_rows(convert, squared.shape)
    return narrow


def rooted(tree: components.ClearanceTree, root: int) -> components.RootedTree:
    count, edges = len(tree.peaks), len(tree.squares)
    begins, ends = np.empty(count + 1, np.int32), np.empty(2 * edges, np.int32)
    order = np.empty(count, np.int32)
    parent_edges = np.full(count, -1, dtype=np.int32)
    bottlenecks = np.full(count, -1, dtype=np.int64)
    order[0], bottlenecks[root] = root, tree.peaks[root]
    found = _clearance_tree.root_tree(
        tree.firsts, tree.seconds, tree.squares, begins, ends, order, parent_edges, bottlenecks
    )
    return components.RootedTree(order[:found], parent_edges, bottlenecks)


def widest_metres(
    basins: Basins, squared: SquaredDistances, limits: Integers, resolution: float, metres: Metres
) -> None:
    """Fill in the metres of the smaller of square and basin limit; `limits[0]` is of basin -1."""
    narrow = _narrow(squared)
    limits_in_metres = np.empty((1, len(limits)), np.float32)
    narrow_limits = np.minimum(limits, _MOST).astype(np.int32).reshape(1, -1)
    clearance_metres(narrow_limits, resolution, limits_in_metres)

    def fill(rows: slice) -> None:
        part = metres[rows].view(np.uint8)
        _clearance_tree.paint(narrow[rows], basins[rows], limits_in_metres[0], resolution, part)

    for_rows(fill, squared.shape)


def clearance_metres(squared: SquaredDistances, resolution: float, metres: Metres) -> None:
    """Fill in the metres of squares; `metres` may share the memory of `squared`."""
    narrow = _narrow(squared)
    paint = _clearance_tree.paint
    bytes_ = metres.view(np.uint8)
    for_rows(lambda rows: paint(narrow[rows], None, None, resolution, bytes_[rows]), squared.shape)


def basin_areas(basins: Basins, squared: SquaredDistances, above: int, count: int) -> Integers:
    narrow = _narrow(squared)
    free: deque[Basins] = deque()  # one array for each thread, reused for its parts

    def count_rows(rows: slice) -> None:
        try:
            counts = free.pop()
        except IndexError:
            counts = np.zeros(count + 1, np.int32)
        _clearance_tree.count_above(narrow[rows], basins[rows], above, counts)
        free.append(counts)

    for_rows(count_rows, squared.shape)
    areas = np.zeros(count, np.int64)
    for counts in free:
        areas += counts[1:]
    return areas


class OpenPoses:
    """A bit for each heading of each cell; a word is 64 cells of a row."""

    def __init__(self, blocked: Layer, footprints: Sequence[Spans], closed: Mask | None) -> None:
        self.shape = blocked.shape
        self._count = len(footprints)
        self._closed = closed
        self._maker = _maker(_packed(blocked), self.shape, footprints)
        self.headings = np.empty(self.shape, dtype=np.uint8)
        self._planes: Words | None = self._open_planes(self.headings)

    def at(self, row: int, col: int) -> Mask:
        if self._planes is None:
            self._planes = self._open_planes()
        return _bits_at(self._planes, row, col)

    def reach(self, seeds: Sequence[Pose], cells: Sequence[Cell]) -> tuple[Bytes, Mask]:
        planes = self._open_planes() if self._planes is None else self._planes
        self._planes = None  # the flood clears the bits of reached poses
        opened = [_bits_at(planes, row, col) for row, col in cells]
        reached = np.zeros(planes.shape[:2], dtype=np.uint64)
        starts = np.array(seeds, dtype=np.int64).reshape(-1, 3)
        most_waiting = max(_FEWEST_WAITING, reached.size // _SHARE_WAITING)
        flood(self._maker, planes, reached, starts, most_waiting)
        headings = np.zeros((len(cells), self._count), dtype=np.bool_)
        for k, (row, col) in enumerate(cells):
            headings[k] = opened[k] & ~_bits_at(planes, row, col)
        del planes
        reachable = np.empty(self.shape, dtype=np.uint8)

        def unpack(rows: slice) -> None:
            bits = reached[rows].view(np.uint8)
            reachable[rows] = np.unpackbits(bits, axis=1, count=self.shape[1], bitorder="little")

        for_rows(unpack, self.shape)
        return reachable, headings

    def _open_planes(self, numbers: Bytes | None = None) -> Words:
        height, width = self.shape
        words = height * -(-width // _WORD) * self._count
        claim_tables(8 * words - self._count * height * width // 8)  # the last words of all rows
        planes = np.empty((height, -(-width // _WORD), self._count), dtype=np.uint64)
        make = self._maker.make
        shape = (height, width * self._count)
        for_rows(lambda rows: make(rows.start, rows.stop, planes, numbers), shape, _BAND_ROWS)
        if self._closed is not None:
            bits = np.zeros((height, planes.shape[1] * _WORD), dtype=np.bool_)
            bits[:, :width] = self._closed
            words = np.packbits(bits, axis=1, bitorder="little").view("<u8")
            planes &= ~words[:, :, np.newaxis]
            if numbers is not None:
                numbers[self._closed] = 0
        return planes


def _bits_at(planes: Words, row: int, col: int) -> Mask:
    word, bit = divmod(col, _WORD)
    return np.asarray(planes[row, word] >> np.uint64(bit) & np.uint64(1), dtype=np.bool_)


def _packed(blocked: Layer) -> Bytes:
    """Return one bit per cell, the lowest first; padding bits of a row are set."""
    height, width = blocked.shape
    packed = np.empty((height, -(-width // 8)), dtype=np.uint8)

    def pack(rows: slice) -> None:
        packed[rows] = np.packbits(blocked[rows], axis=1, bitorder="little")

    for_rows(pack, (height, width))
    if width % 8:
        packed[:, -1] |= 0xFF << width % 8 & 0xFF
    return packed


def _maker(blocked: Bytes, shape: tuple[int, int], footprints: Sequence[Spans]) -> PoseMaker:
    """Return a maker of poses, given the runs of all headings as places in a work area."""
    fitting = [all(side.start < side.stop for side in spans.places(shape)) for spans in footprints]
    runs = [halves(spans) for spans, fits in zip(footprints, fitting, strict=True) if fits]
    if not runs:
        empty = np.zeros(0, dtype=np.int64)
        firsts = np.zeros(_SHIFTS * len(footprints) + 1, dtype=np.int64)
        return PoseMaker(blocked, shape[1], firsts, empty, (0, 0, 0, 1, _WIDE, _BAND_ROWS))
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
