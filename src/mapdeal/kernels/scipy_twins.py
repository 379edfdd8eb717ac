"""The scipy twins of compiled.py: slower, but with the same results to the last bit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain

import numpy as np

from mapdeal.kernels import arrays, components, threads
from mapdeal.kernels.arrays import Basins, Bytes, Floats, Integers, Mask, Metres, SquaredDistances
from mapdeal.kernels.blocks import Border, Halo, Layer
from mapdeal.kernels.polygons import Cell, Pose, Spans, enumerated, halves

_CELLS_TOGETHER = 1 << 18
_NONE = np.iinfo(np.int64).max
_CLOSED = -1


def squares(marked: Mask, limit: int | None) -> SquaredDistances:
    squared = _squares_to(marked)
    if limit is not None:
        squared[squared > limit] = arrays.unreachable(squared)
    return squared


def bytes_of_squares(marked: Mask, table: Bytes) -> Bytes:
    return table[np.minimum(_squares_to(marked), len(table) - 1)]


def metres(
    marked: Mask, scale: float, outside_shift: float, inside_shift: float, clip: float,
    gain: float, halo: Halo | None = None,
) -> Metres:  # fmt: skip
    # the steps are those of `metres_of` in distance_columns.h
    if halo is None:
        squared = np.where(marked, _squares_to(~marked), _squares_to(marked))
    else:
        squared = squares_of_block(marked, halo)
    endless = squared == arrays.unreachable(squared)
    distance = np.sqrt(squared, dtype=np.float64)
    distance *= scale
    distance[endless] = math.inf
    np.subtract(inside_shift, distance, out=distance, where=marked)
    np.add(distance, outside_shift, out=distance, where=~marked)
    np.clip(distance, -clip, clip, out=distance)
    np.multiply(distance, gain, out=distance, where=~marked)
    return distance.astype(np.float32)


def squares_of_block(marked: Mask, halo: Halo) -> Integers:
    """Return each cell's squared distance to the nearest cell of the other kind in the grid."""
    # scipy's transform has no halo. So heights, the distances within the columns, are counted here,
    # and each square is the smallest of (x - i)^2 + height(i)^2 over all columns i.
    heights = np.minimum(_counts(marked, halo.before), _counts(marked[::-1], halo.after)[::-1])
    has_none = heights > halo.height
    own = np.where(has_none, 0, heights) ** 2
    squares = np.empty(marked.shape, dtype=np.int64)
    step = max(1, _CELLS_TOGETHER // marked.shape[1])
    for first in range(0, len(marked), step):
        rows = slice(first, first + step)
        for kind in (False, True):
            of_kind = marked[rows] == kind
            minima = row_minima(np.where(of_kind, own[rows], 0), ~(of_kind & has_none[rows]))
            np.copyto(squares[rows], minima, where=of_kind)
    return squares


def _counts(marked: Mask, before: Border | None) -> Integers:
    """Return the number of cells up the column to the nearest cell of the other kind."""
    counts = np.empty(marked.shape, dtype=np.int64)
    above_any_height = np.iinfo(np.uint32).max // 2
    last_row, last = before or (marked[0], np.full(marked.shape[1], above_any_height))
    last = last.astype(np.int64)
    for k, row in enumerate(marked):
        counts[k] = last = np.where(row == last_row, last + 1, 1)
        last_row = row
    return counts


def row_minima(values: Integers, exists: Mask) -> Integers:
    """Return the smallest (x - i)^2 + values[row, i] over all i that exist, for each row and x."""
    # The best i never decreases with x. So middle cells are solved first, and bound the columns to
    # try for the cells between them; all rows are solved at once.
    height, width = values.shape
    minima = np.full(values.shape, _NONE)
    has_sites = exists.any(axis=1)
    if not has_sites.all():
        if has_sites.any():
            minima[has_sites] = row_minima(values[has_sites], exists[has_sites])
        return minima
    # existing columns, row by row; those of row r are sites[ends[r] : ends[r + 1]]
    sites, added = np.nonzero(exists)[1], values[exists]
    ends = np.concatenate([[0], np.cumsum(exists.sum(axis=1))])
    best = np.empty(values.shape, dtype=np.int64)  # indices of sites
    step = 1 << max(width - 1, 0).bit_length()
    cells = np.array([0])
    while step:
        low = ends[:-1, np.newaxis] + np.zeros_like(cells)
        high = ends[1:, np.newaxis] - 1 + np.zeros_like(cells)
        if step < width:
            np.copyto(low, best[:, np.maximum(cells - step, 0)], where=cells >= step)
            inner = cells + step < width
            np.copyto(high, best[:, np.minimum(cells + step, width - 1)], where=inner)
        of_rows = np.broadcast_to(cells, low.shape).ravel()
        found, lowest = _lowest_in(of_rows, low.ravel(), high.ravel(), sites, added)
        best[:, cells] = found.reshape(height, -1)
        minima[:, cells] = lowest.reshape(height, -1)
        step //= 2
        cells = np.arange(step, width, 2 * step) if step else cells
    return minima


def _lowest_in(
    cells: Integers, low: Integers, high: Integers, sites: Integers, added: Integers
) -> tuple[Integers, Integers]:
    whose, candidates = enumerated(low, high + 1)
    starts = np.cumsum(high - low + 1) - (high - low + 1)
    values = (cells[whose] - sites[candidates]) ** 2 + added[candidates]
    lowest = np.minimum.reduceat(values, starts)
    hits = np.flatnonzero(values == lowest[whose])
    return candidates[hits[np.searchsorted(hits, starts)]], lowest


def _squares_to(marked: Mask) -> SquaredDistances:
    from scipy import ndimage

    height, width = marked.shape
    dtype = arrays.dtype_of_squares(marked.shape)
    if not marked.any():  # scipy would measure to a cell outside of the grid
        return np.full(marked.shape, np.iinfo(dtype).max, dtype=dtype)
    # The indices of the nearest cells are exact, unlike scipy's distances, float64 square roots.
    nearest = ndimage.distance_transform_edt(~marked, return_distances=False, return_indices=True)
    rows, cols = nearest.astype(dtype, copy=False)
    rows -= np.arange(height, dtype=dtype)[:, np.newaxis]
    cols -= np.arange(width, dtype=dtype)
    rows *= rows
    cols *= cols
    rows += cols
    return np.asarray(rows)


def clearance_tree(squared: SquaredDistances, is_traversable: Mask) -> components.ClearanceTree:
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
    basins: Basins = numbers[towards]
    threads.claim_tables(components.BYTES_OF_BASIN * len(peak_cells))
    # edges by falling order of cells: the larger neighbour of a cell comes first
    narrower, wider = _pairs_of_basins(flat, basins, width)
    best = np.lexsort((narrower - wider, -narrower, -flat[narrower]))
    narrower, wider = narrower[best], wider[best]
    chosen = _spanning(basins[narrower], basins[wider], len(peak_cells))
    narrower, wider = narrower[chosen], wider[chosen]
    return components.ClearanceTree(
        basins.reshape(height, width), flat[peak_cells], peak_cells,
        basins[narrower], basins[wider], flat[narrower], narrower,
    )  # fmt: skip


def _steepest(heights: Integers) -> Integers:
    """Return for each cell the flat index of the largest among itself and four neighbours."""
    height, width = heights.shape
    around = np.pad(heights, 1, constant_values=_CLOSED)
    own = np.arange(heights.size).reshape(height, width)
    best = around[:-2, 1:-1].copy()
    towards: Integers = own - width
    # by rising flat index, so that the last of equal squares wins
    for rows, cols, step in ((1, 0, -1), (1, 1, 0), (1, 2, 1), (2, 1, width)):
        candidate = around[rows : rows + height, cols : cols + width]
        larger = candidate >= best
        best[larger] = candidate[larger]
        towards[larger] = own[larger] + step
    closed = heights == _CLOSED
    towards[closed] = own[closed]
    return towards


def _pairs_of_basins(heights: Integers, basins: Basins, width: int) -> tuple[Integers, Integers]:
    """Return the narrower and the wider cells of neighbours in different basins."""
    own = np.arange(len(basins)).reshape(-1, width)
    firsts = np.concatenate([own[:, :-1].reshape(-1), own[:-1].reshape(-1)])
    seconds = np.concatenate([own[:, 1:].reshape(-1), own[1:].reshape(-1)])
    apart = (basins[firsts] != basins[seconds]) & (basins[firsts] >= 0) & (basins[seconds] >= 0)
    firsts, seconds = firsts[apart], seconds[apart]
    is_narrower = heights[firsts] <= heights[seconds]
    return np.where(is_narrower, firsts, seconds), np.where(is_narrower, seconds, firsts)


def _spanning(firsts: Basins, seconds: Basins, count: int) -> Integers:
    """Return the indices of the pairs in the spanning forest that prefers earlier pairs."""
    # scipy minimises the total weight; with list positions as weights the forest is unique.
    if not len(firsts):
        return np.zeros(0, dtype=np.int64)
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import minimum_spanning_tree

    low, high = np.minimum(firsts, seconds).astype(np.int64), np.maximum(firsts, seconds)
    _, order = np.unique(low * count + high, return_index=True)
    weights = order + 1.0  # scipy reads weight 0 as no edge
    ends = low[order].astype(np.int32), high[order].astype(np.int32)  # older scipy needs int32
    positions = minimum_spanning_tree(coo_array((weights, ends), shape=(count, count)).tocsr()).data
    return np.sort(positions.astype(np.int64)) - 1


def rooted(tree: components.ClearanceTree, root: int) -> components.RootedTree:
    count, edges = len(tree.peaks), len(tree.squares)
    ends = np.concatenate([tree.firsts, tree.seconds])
    beyond = np.concatenate([tree.seconds, tree.firsts])
    # sides of edges by basin, and within a basin in the order of the edges
    sides = np.lexsort((np.arange(2 * edges) % max(edges, 1), ends))
    begins = np.searchsorted(ends[sides], np.arange(count + 1))
    parent_edges = np.full(count, -1, dtype=np.int32)
    bottlenecks = np.full(count, -1, dtype=np.int64)
    bottlenecks[root] = tree.peaks[root]
    generation = np.array([root], dtype=np.int32)
    order = [generation]
    while len(generation):
        whose, places = enumerated(begins[generation], begins[generation + 1])
        chosen, parents = sides[places], generation[whose]
        children = beyond[chosen]
        new = bottlenecks[children] < 0
        chosen, parents, generation = chosen[new] % max(edges, 1), parents[new], children[new]
        parent_edges[generation] = chosen
        bottlenecks[generation] = np.minimum(bottlenecks[parents], tree.squares[chosen])
        order.append(generation)
    return components.RootedTree(np.concatenate(order), parent_edges, bottlenecks)


def widest_metres(
    basins: Basins, squared: SquaredDistances, limits: Integers, resolution: float, metres: Metres
) -> None:
    endless = arrays.unreachable(squared)

    def fill(rows: slice) -> None:  # metres may share the memory of the basins
        widest = np.minimum(squared[rows], limits[basins[rows] + 1])
        metres[rows] = _metres(widest, resolution, endless)

    threads.for_rows(fill, squared.shape)


def clearance_metres(squared: SquaredDistances, resolution: float, metres: Metres) -> None:
    endless = arrays.unreachable(squared)

    def fill(rows: slice) -> None:
        metres[rows] = _metres(squared[rows], resolution, endless)

    threads.for_rows(fill, squared.shape)


def _metres(squared: SquaredDistances, resolution: float, endless: int) -> Floats:
    return np.where(squared == endless, np.inf, np.sqrt(squared.astype(np.float64)) * resolution)


def basin_areas(basins: Basins, squared: SquaredDistances, above: int, count: int) -> Integers:
    return np.bincount(basins[(basins >= 0) & (squared > above)], minlength=count).astype(np.int64)


class OpenPoses:
    def __init__(self, blocked: Layer, footprints: Sequence[Spans], closed: Mask | None) -> None:
        self.shape = blocked.shape
        dilated = [np.asarray(blocked)]
        closed = np.zeros(self.shape, dtype=np.bool_) if closed is None else closed
        opened = (_open_cells(dilated, spans) & ~closed for spans in footprints)
        self._planes = [np.packbits(plane, axis=1) for plane in opened]
        self._all = range(len(footprints))
        self.headings = np.zeros(self.shape, dtype=np.uint8)
        for k in self._all:
            self.headings += self._plane(k)

    def at(self, row: int, col: int) -> Mask:
        return np.array([self._plane(k, slice(row, row + 1))[0, col] for k in self._all])

    def reach(self, seeds: Sequence[Pose], cells: Sequence[Cell]) -> tuple[Bytes, Mask]:
        counts, (here, ahead) = self._joined()
        firsts = np.cumsum([0, *counts])
        least = components.least_joined(here, ahead, int(firsts[-1]))
        labels = [self._labels(heading)[row, col] for heading, row, col in seeds]
        is_reached = np.zeros(len(least), dtype=np.bool_)
        for (heading, _, _), label in zip(seeds, labels, strict=True):
            if label:
                is_reached[least[firsts[heading] + label - 1]] = True
        reachable = np.zeros(self.shape, dtype=np.uint8)
        headings = np.zeros((len(cells), len(self._planes)), dtype=np.bool_)
        rows, cols = np.array(cells, dtype=np.int64).reshape(-1, 2).T
        for k in self._all:
            of_labels = np.append(False, is_reached[least[firsts[k] : firsts[k + 1]]])
            reached = of_labels[self._labels(k)]
            reachable |= reached
            headings[:, k] = reached[rows, cols]
        return reachable, headings

    def _plane(self, heading: int, rows: slice = slice(None)) -> Mask:
        width = self.shape[1]
        return np.unpackbits(self._planes[heading][rows], axis=1, count=width).view(np.bool_)

    def _labels(self, heading: int) -> arrays.Integers32:
        """Return the component, from 1, of each open cell, 0 elsewhere; repeatable."""
        from scipy import ndimage

        return np.asarray(ndimage.label(self._plane(heading))[0])

    def _joined(self) -> tuple[list[int], Integers]:
        """Return the component count of each heading, and pairs that touch in the next heading."""
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


def _open_cells(dilated: list[Mask], spans: Spans) -> Mask:
    """Return the cells around which no cell of spans is blocked."""
    # Item e of `dilated` is set in column j if any of the columns j .. j + 2^e - 1 is blocked; more
    # items are added when they are needed.
    height, width = dilated[0].shape
    rows, cols = spans.places((height, width))
    opened = np.zeros((height, width), dtype=np.bool_)
    inner = opened[rows, cols]
    inner[:] = True
    if inner.size:
        runs = (column.tolist() for column in halves(spans))
        for row, start, exponent in zip(*runs, strict=True):
            while len(dilated) <= exponent:
                step = 1 << (len(dilated) - 1)
                dilated.append(dilated[-1][:, :-step] | dilated[-1][:, step:])
            touched = dilated[exponent][rows.start + row : rows.stop + row]
            inner &= ~touched[:, cols.start + start : cols.stop + start]
    return opened
