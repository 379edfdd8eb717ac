"""Clearance trees on the compiled module, in threads; clearance_twin.py is their twin.

It takes squares in 32 bits. Others are made so where they fit; where they do not, the twin serves.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels import _clearance_tree
from mapdeal.kernels.clearance_tree import ClearanceTree, RootedTree
from mapdeal.kernels.distance import SquaredDistances, unreachable
from mapdeal.kernels.threads import CELLS_WORTH_A_THREAD, for_rows, in_parallel, use_threads

_MOST = unreachable(np.zeros(0, dtype=np.int32))


def fits(squared: SquaredDistances) -> bool:
    """Return whether there are few enough cells, and their squares fit 32 bits."""
    if not 0 < squared.size <= _clearance_tree.most_cells:
        return False
    if squared.dtype == np.int32:
        return True
    return int(squared.max(where=squared != unreachable(squared), initial=0)) < _MOST


def clearance_tree(squared: SquaredDistances, is_traversable: NDArray[np.bool_]) -> ClearanceTree:
    """Do as `mapdeal.kernels.clearance_tree.clearance_tree`, on squares that fit."""
    narrow = _narrow(squared)
    basins = np.empty(narrow.shape, dtype=np.int32)
    mask = np.ascontiguousarray(is_traversable).view(np.uint8)
    work = _clearance_tree.Basins(narrow, mask, basins)
    _in_bands(work.point, work.bands, narrow.size)
    peak_count, edge_count = work.counts()
    peaks, peak_cells = np.empty(peak_count, np.int64), np.empty(peak_count, np.int64)
    work.number(peaks, peak_cells)
    work.join()
    _in_bands(work.label, work.bands, narrow.size)
    keys = np.empty(edge_count, dtype=np.uint64)
    work.take_edges(keys)
    one, other, squares, cells = _spanning(_sorted(keys), basins, peak_count)
    for some in (peaks, squares):
        some[some == _MOST] = unreachable(squared)
    return ClearanceTree(basins, peaks, peak_cells, one, other, squares, cells)


def _narrow(squared: SquaredDistances) -> NDArray[np.int32]:
    if squared.dtype == np.int32:
        return np.ascontiguousarray(squared, dtype=np.int32)
    narrow = np.empty(squared.shape, dtype=np.int32)

    def some(rows: slice) -> None:
        narrow[rows] = np.minimum(squared[rows], _MOST)

    for_rows(some, squared.shape)
    return narrow


def _in_bands(work: Callable[[int, int], object], bands: int, cells: int) -> None:
    if cells < CELLS_WORTH_A_THREAD:
        with use_threads(1):
            in_parallel(work, bands)
    else:
        in_parallel(work, bands)


def _sorted(keys: NDArray[np.uint64]) -> NDArray[np.uint64]:
    spare = np.empty_like(keys)
    return spare if _clearance_tree.sort_edges(keys, spare) else keys


def _spanning(
    keys: NDArray[np.uint64], basins: NDArray[np.int32], count: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int64], NDArray[np.int64]]:
    one, other = np.empty(count, np.int32), np.empty(count, np.int32)
    squares, cells = np.empty(count, np.int64), np.empty(count, np.int64)
    sets = np.arange(count, dtype=np.int32)
    kept = _clearance_tree.span_basins(basins, keys, sets, one, other, squares, cells)
    return one[:kept], other[:kept], squares[:kept], cells[:kept]


def rooted(tree: ClearanceTree, root: int) -> RootedTree:
    """Do as `mapdeal.kernels.clearance_tree.rooted`."""
    count, edges = len(tree.peaks), len(tree.squares)
    begins, ends = np.empty(count + 1, np.int32), np.empty(2 * edges, np.int32)
    order = np.empty(count, np.int32)
    parent_edges = np.full(count, -1, dtype=np.int32)
    bottlenecks = np.full(count, -1, dtype=np.int64)
    order[0], bottlenecks[root] = root, tree.peaks[root]
    found = _clearance_tree.root_tree(
        tree.one, tree.other, tree.squares, begins, ends, order, parent_edges, bottlenecks
    )
    return RootedTree(order[:found], parent_edges, bottlenecks)


def widest_metres(
    basins: NDArray[np.int32],
    squared: SquaredDistances,
    limits: NDArray[np.int64],
    resolution: float,
    metres: NDArray[np.float32],
) -> None:
    """Do as `mapdeal.kernels.clearance_numpy.widest_metres`."""
    narrow = _narrow(squared)
    limits_in_metres = np.empty((1, len(limits)), np.float32)
    narrow_limits = np.minimum(limits, _MOST).astype(np.int32).reshape(1, -1)
    _clearance_tree.paint(narrow_limits, None, None, resolution, _bytes_of(limits_in_metres))

    def some(rows: slice) -> None:
        _clearance_tree.paint(
            narrow[rows], basins[rows], limits_in_metres[0], resolution, _bytes_of(metres[rows])
        )

    for_rows(some, squared.shape)


def clearance_metres(
    squared: SquaredDistances, resolution: float, metres: NDArray[np.float32]
) -> None:
    """Do as `mapdeal.kernels.clearance_numpy.clearance_metres`."""
    narrow = _narrow(squared)

    def some(rows: slice) -> None:
        _clearance_tree.paint(narrow[rows], None, None, resolution, _bytes_of(metres[rows]))

    for_rows(some, squared.shape)


def _bytes_of(metres: NDArray[np.float32]) -> NDArray[np.uint8]:
    return metres.view(np.uint8)


def basin_areas(
    basins: NDArray[np.int32], squared: SquaredDistances, above: int, count: int
) -> NDArray[np.int64]:
    """Do as `mapdeal.kernels.clearance_numpy.basin_areas`."""
    narrow = _narrow(squared)
    free: deque[NDArray[np.int32]] = deque()  # counts of a thread at a time, not of each part

    def some(rows: slice) -> None:
        try:
            counts = free.pop()
        except IndexError:
            counts = np.zeros(count + 1, np.int32)
        _clearance_tree.count_above(narrow[rows], basins[rows], above, counts)
        free.append(counts)

    for_rows(some, squared.shape)
    areas = np.zeros(count, np.int64)
    for counts in free:
        areas += counts[1:]
    return areas
