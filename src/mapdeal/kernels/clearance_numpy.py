"""Clearance trees on numpy and scipy: the same to the last bit as clearance_tree.h."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.clearance_tree import ClearanceTree, RootedTree
from mapdeal.kernels.distance import SquaredDistances, unreachable
from mapdeal.kernels.threads import for_rows

Cells = NDArray[np.int64]

_CLOSED = -1


class _Pairs(NamedTuple):
    """Pairs of neighbouring cells of different basins, the narrower and the wider one."""

    narrower: Cells
    wider: Cells


def clearance_tree(squared: SquaredDistances, is_traversable: NDArray[np.bool_]) -> ClearanceTree:
    """Do as `mapdeal.kernels.clearance_tree.clearance_tree`."""
    height, width = squared.shape
    heights = np.where(is_traversable, squared, 0).astype(np.int64)
    heights[heights == 0] = _CLOSED
    towards = _steepest(heights).reshape(-1)
    while not np.array_equal(farther := towards[towards], towards):
        towards = farther
    flat = heights.reshape(-1)
    peak_cells = np.flatnonzero((towards == np.arange(len(towards))) & (flat != _CLOSED))
    numbers = np.full(len(towards), -1, dtype=np.int32)
    numbers[peak_cells] = np.arange(len(peak_cells))
    basins: NDArray[np.int32] = numbers[towards]
    # of the falling order of cells: the larger neighbour of a cell comes first
    pairs = _pairs_of_basins(flat, basins, width)
    step = pairs.wider - pairs.narrower
    best = np.lexsort((-step, -pairs.narrower, -flat[pairs.narrower]))
    narrower, wider = pairs.narrower[best], pairs.wider[best]
    kept = _spanning(basins[narrower], basins[wider], len(peak_cells))
    cells = narrower[kept]
    return ClearanceTree(
        basins=basins.reshape(height, width),
        peaks=flat[peak_cells],
        peak_cells=peak_cells,
        one=basins[cells],
        other=basins[wider[kept]],
        squares=flat[cells],
        cells=cells,
    )


def _steepest(heights: NDArray[np.int64]) -> Cells:
    """Return for each cell the flat index of the largest of itself and its four neighbours."""
    height, width = heights.shape
    around = np.pad(heights, 1, constant_values=_CLOSED)
    own = np.arange(heights.size).reshape(height, width)
    best = around[:-2, 1:-1].copy()
    towards: Cells = own - width
    # in rising order of flat indices, so that of equal squares the last one wins
    for rows, cols, step in ((1, 0, -1), (1, 1, 0), (1, 2, 1), (2, 1, width)):
        candidate = around[rows : rows + height, cols : cols + width]
        larger = candidate >= best
        best[larger] = candidate[larger]
        towards[larger] = own[larger] + step
    closed = heights == _CLOSED
    towards[closed] = own[closed]
    return towards


def _pairs_of_basins(heights: Cells, basins: NDArray[np.int32], width: int) -> _Pairs:
    own = np.arange(len(basins)).reshape(-1, width)
    firsts = np.concatenate([own[:, :-1].reshape(-1), own[:-1].reshape(-1)])
    seconds = np.concatenate([own[:, 1:].reshape(-1), own[1:].reshape(-1)])
    apart = (basins[firsts] != basins[seconds]) & (basins[firsts] >= 0) & (basins[seconds] >= 0)
    firsts, seconds = firsts[apart], seconds[apart]
    is_narrower = heights[firsts] <= heights[seconds]
    return _Pairs(np.where(is_narrower, firsts, seconds), np.where(is_narrower, seconds, firsts))


def _spanning(one: NDArray[np.int32], other: NDArray[np.int32], count: int) -> Cells:
    """Return which pairs make the spanning forest that prefers those that come first."""
    # scipy's is that of least weight; the position in the list as weight makes it the only one.
    if not len(one):
        return np.zeros(0, dtype=np.int64)
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import minimum_spanning_tree

    low, high = np.minimum(one, other).astype(np.int64), np.maximum(one, other)
    _, first = np.unique(low * count + high, return_index=True)
    weights = first + 1.0  # 0 would be no edge
    graph = coo_array((weights, (low[first], high[first])), shape=(count, count))
    kept = minimum_spanning_tree(graph.tocsr()).data
    return np.sort(kept.astype(np.int64)) - 1


def rooted(tree: ClearanceTree, root: int) -> RootedTree:
    """Do as `mapdeal.kernels.clearance_tree.rooted`, a generation of basins at a time."""
    count, edges = len(tree.peaks), len(tree.squares)
    ends = np.concatenate([tree.one, tree.other])
    beyond = np.concatenate([tree.other, tree.one])
    sides = np.argsort(ends, kind="stable")
    # both sides of a basin's edges in the order of the edges
    sides = sides[np.lexsort((sides % max(edges, 1), ends[sides]))]
    begins = np.searchsorted(ends[sides], np.arange(count + 1))
    parent_edges = np.full(count, -1, dtype=np.int32)
    bottlenecks = np.full(count, -1, dtype=np.int64)
    bottlenecks[root] = tree.peaks[root]
    generation = np.array([root], dtype=np.int32)
    order = [generation]
    while len(generation):
        lengths = begins[generation + 1] - begins[generation]
        shifts = np.repeat(begins[generation] - np.cumsum(lengths) + lengths, lengths)
        chosen = sides[np.arange(len(shifts)) + shifts]
        parents = np.repeat(generation, lengths)
        children = beyond[chosen]
        new = bottlenecks[children] < 0
        chosen, parents, generation = chosen[new] % max(edges, 1), parents[new], children[new]
        parent_edges[generation] = chosen
        bottlenecks[generation] = np.minimum(bottlenecks[parents], tree.squares[chosen])
        order.append(generation)
    return RootedTree(np.concatenate(order), parent_edges, bottlenecks)


def widest_metres(
    basins: NDArray[np.int32],
    squared: SquaredDistances,
    limits: NDArray[np.int64],
    resolution: float,
    metres: NDArray[np.float32],
) -> None:
    """Fill in the metres of the lesser of square and basin's limit, the first of -1."""
    endless = unreachable(squared)

    def some(rows: slice) -> None:  # metres may lie over the basins
        widest = np.minimum(squared[rows], limits[basins[rows] + 1])
        metres[rows] = _metres(widest, resolution, endless)

    for_rows(some, squared.shape)


def clearance_metres(
    squared: SquaredDistances, resolution: float, metres: NDArray[np.float32]
) -> None:
    """Fill in the metres of squares; they may lie over them."""
    endless = unreachable(squared)

    def some(rows: slice) -> None:
        metres[rows] = _metres(squared[rows], resolution, endless)

    for_rows(some, squared.shape)


def _metres(squared: SquaredDistances, resolution: float, endless: int) -> NDArray[np.float64]:
    return np.where(squared == endless, np.inf, np.sqrt(squared.astype(np.float64)) * resolution)


def basin_areas(
    basins: NDArray[np.int32], squared: SquaredDistances, above: int, count: int
) -> NDArray[np.int64]:
    counted = basins[(basins >= 0) & (squared > above)]
    return np.bincount(counted, minlength=count).astype(np.int64)
