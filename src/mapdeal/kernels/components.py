"""Connected components of marked cells, and passages between basins.

The marked cells of a row form runs. Touching runs of neighbouring rows are joined, so only
components that reach the last row can still grow. For each size some components are recorded by a
cell: the middle of their longest run, which usually lies well inside.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels import polygons, threads
from mapdeal.kernels.arrays import Array, Basins, Floats, Integers, Mask, SquaredDistances
from mapdeal.records import dataclass

_LABELS_TOGETHER = 1 << 20
MOST_PLACES = 20  # components of a size that are recorded by a cell
_CELLS_TOGETHER = 1 << 15
_NOWHERE = np.iinfo(np.int64).max
_STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))
_MOST_CELLS = 20_000  # of a ridge; the others are ignored
_MOST_ENDS = 400
_OPPOSITE, _ROUGHLY_OPPOSITE = -0.7, -0.3  # cosines of the angle between both sides of a gap
RowCol = tuple[float, float]
BYTES_OF_BASIN, BYTES_OF_EDGE = 100, 16  # in all tables of a clearance tree


def drop_small_groups(marked: Mask, min_cells: int, *, corners: bool = True) -> Mask:
    """Return `marked` without its groups of fewer than `min_cells` cells, 8- or 4-connected."""
    if min_cells <= 1:
        return marked
    groups = labelled(marked, corners=corners)
    return groups.cells_of(groups.sizes >= min_cells)  # unmarked cells have label 0, of size 0


@dataclass(frozen=True, eq=False)
class Labels:
    cells: NDArray[np.int32]
    sizes: Integers

    def touched_by(self, marked: Mask) -> Mask:
        touched = np.zeros(len(self.sizes), dtype=np.bool_)
        touched[self.cells[marked]] = True
        touched[0] = False
        return touched

    def cells_of(self, chosen: Mask) -> Mask:
        found = np.empty(self.cells.shape, dtype=np.bool_)
        for rows in _bands(self.cells.shape):
            np.take(chosen, self.cells[rows], out=found[rows])
        return found


def labelled(marked: Mask, *, corners: bool) -> Labels:
    from scipy import ndimage

    cells, count = ndimage.label(marked, structure=np.ones((3, 3)) if corners else None)
    sizes = np.zeros(count + 1, dtype=np.int64)
    for rows in _bands(cells.shape):
        labels = cells[rows][marked[rows]]
        if len(labels):  # labels rise with the rows, so those of a band are close
            first = labels.min()
            counts = np.bincount(labels - first)
            sizes[first : first + len(counts)] += counts
    return Labels(cells, sizes)


def _bands(shape: tuple[int, int]) -> list[slice]:
    """Return slices of rows with as many cells as fit into the processor's caches."""
    height, width = shape
    step = max(1, _LABELS_TOGETHER // width)
    return [slice(row, row + step) for row in range(0, height, step)]


def touching_groups(marked: Mask) -> tuple[Integers, Integers]:
    width = marked.shape[1]
    flat = np.flatnonzero(marked)
    cells = np.stack([flat // width, flat % width], axis=1)
    pairs = [_neighbour_pairs(flat, cells, s, width) for s in ((0, 1), (1, -1), (1, 0), (1, 1))]
    first, second = np.concatenate(pairs, axis=1)
    return cells, np.unique(least_joined(first, second, len(flat)), return_inverse=True)[1]


def least_joined(first: Integers, second: Integers, count: int) -> Integers:
    """Return for each of `count` nodes the least node of its component; edges join nodes."""
    least = np.arange(count)
    while True:
        ends = np.stack([least[first], least[second]])
        apart = ends[0] != ends[1]
        if not apart.any():
            return least
        first, second, ends = first[apart], second[apart], ends[:, apart]
        np.minimum.at(least, ends.max(axis=0), ends.min(axis=0))
        while not np.array_equal(nearer := least[least], least):
            least = nearer


def _neighbour_pairs(flat: Integers, cells: Integers, step: polygons.Cell, width: int) -> Integers:
    """Return pairs of marked cells a step apart, shape (2, M), as positions in the list."""
    col = cells[:, 1] + step[1]
    inside = np.flatnonzero((col >= 0) & (col < width))
    neighbours = flat[inside] + step[0] * width + step[1]
    found = np.minimum(np.searchsorted(flat, neighbours), len(flat) - 1)
    is_marked = flat[found] == neighbours
    return np.stack([inside[is_marked], found[is_marked]])


def thickness_of(marked: Mask) -> Integers:
    # The thickness at a cell is its shorter run along rows or columns. So slanted walls one cell
    # wide are one cell thick, and cells where two walls cross are thick.
    height, width = marked.shape
    by_columns = np.flatnonzero(marked.T)
    order = np.argsort(by_columns % height * width + by_columns // height, kind="stable")
    return np.minimum(_lengths_along(marked), _lengths_along(marked.T)[order])


def _lengths_along(marked: Mask) -> Integers:
    starts, stops = _runs(marked)
    return np.repeat(stops - starts, stops - starts)


class _Front(NamedTuple):
    """The runs of the last row, shape (N,), and their components, shape (K,)."""

    starts: Integers
    stops: Integers
    components: Integers  # of each run, 0 .. K - 1
    sizes: Integers  # cells so far of each component
    longest: Integers  # the longest run so far of each component, cells
    middles: Integers  # the cell in the middle of the longest run


class Components:
    """Measures 8-connected components of marked cells, which are added band by band."""

    def __init__(self, last_row: int | None = None) -> None:
        self._front = _Front(*(np.zeros(0, dtype=np.int64) for _ in _Front._fields))
        self._closed: Counter[int] = Counter()
        self._places: dict[int, list[int]] = {}
        self._row, self._step = (0, 1) if last_row is None else (last_row, -1)

    def add(self, marked: Mask) -> None:
        height, width = marked.shape
        step = max(1, _CELLS_TOGETHER // width)
        for first in range(0, height, step):
            self._add_band(marked[first : first + step])

    def sizes(self) -> tuple[Integers, Integers]:
        found = self._closed + Counter(self._front.sizes.tolist())
        sizes, counts = np.array(sorted(found.items()), dtype=np.int64).reshape(-1, 2).T
        return sizes, counts

    def places(self) -> dict[int, list[int]]:
        """Return the lowest recorded cells of each size, at most `MOST_PLACES`."""
        found = {size: list(listed) for size, listed in self._places.items()}
        growing = zip(self._front.sizes.tolist(), self._front.middles.tolist(), strict=True)
        for size, middle in growing:
            found.setdefault(size, []).append(middle)
        return {size: sorted(found[size])[:MOST_PLACES] for size in sorted(found)}

    def _add_band(self, marked: Mask) -> None:
        height, width = marked.shape
        front, stride = self._front, width + 1
        starts, stops = _runs(marked)
        # row 0 is the last row of the previous band
        before, live = len(front.starts), len(front.sizes)
        all_starts = np.concatenate([front.starts, starts + stride])
        all_stops = np.concatenate([front.stops, stops + stride])
        nodes = np.concatenate([front.components, live + np.arange(len(starts))])
        # each run's range of runs in the row above that share an edge or a corner
        first = np.searchsorted(all_stops, all_starts + stride)
        behind = np.searchsorted(all_starts, all_stops + stride, side="right")
        run, touching = polygons.enumerated(first, behind)
        least = least_joined(nodes[run], nodes[touching], live + len(starts))
        lengths = stops - starts
        cells = np.concatenate([front.sizes, lengths])
        sizes = np.zeros(len(cells), dtype=np.int64)
        np.add.at(sizes, least, cells)
        middles_of_runs = np.append(front.middles, self._middles_of(starts, lengths, marked.shape))
        runs = np.append(front.longest, lengths)
        longest = np.zeros(len(cells), dtype=np.int64)
        np.maximum.at(longest, least, runs)
        is_longest = runs == longest[least]
        middles = np.full(len(cells), _NOWHERE)
        np.minimum.at(middles, least[is_longest], middles_of_runs[is_longest])
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

    def _middles_of(self, starts: Integers, lengths: Integers, shape: tuple[int, int]) -> Integers:
        height, width = shape
        rows = np.arange(height)
        bounds = np.searchsorted(starts, np.append(rows, height) * (width + 1))
        in_map = (self._row + self._step * rows) * width
        shifts = np.repeat(in_map - rows * (width + 1), np.diff(bounds))
        return starts + shifts + ((lengths - 1) >> 1)

    def _close(self, sizes: Integers, middles: Integers) -> None:
        if not len(sizes):
            return
        short = sizes.astype(np.uint16) if sizes.max() < 1 << 16 else sizes  # 16 bits: a radix sort
        order = np.argsort(short, kind="stable")
        sizes, middles = sizes[order], middles[order]
        firsts = np.flatnonzero(np.diff(sizes, prepend=0))
        stops = np.append(firsts[1:], len(sizes))
        ranges = zip(sizes[firsts].tolist(), firsts.tolist(), stops.tolist(), strict=True)
        for size, first, stop in ranges:
            self._closed[size] += stop - first
            lowest = middles[first:stop]
            if len(lowest) > MOST_PLACES:
                lowest = np.partition(lowest, MOST_PLACES)[:MOST_PLACES]
            self._places[size] = sorted(self._places.get(size, []) + lowest.tolist())[:MOST_PLACES]


def _runs(marked: Mask) -> tuple[Integers, Integers]:
    # For the indices, rows are one cell wider, so that runs of different rows never touch.
    height, width = marked.shape
    edges = np.empty((height, width + 1), dtype=np.bool_)
    edges[:, 0], edges[:, -1] = marked[:, 0], marked[:, -1]
    np.not_equal(marked[:, 1:], marked[:, :-1], out=edges[:, 1:-1])
    ends = np.flatnonzero(edges)
    return ends[::2], ends[1::2]


def gap_at(squared: SquaredDistances, basins: Basins, cell: polygons.Cell) -> tuple[RowCol, RowCol]:
    # In a thick wall all cells in the middle of a door are equally narrow, and any of them may be
    # the saddle. They are the ridge, up to cells with a wider neighbour, where the rooms begin.
    square = int(squared[cell])
    ridge = _ridge(squared, basins, cell)
    away = ((ridge - ridge.mean(axis=0)) ** 2).sum(axis=1)
    row, col = ridge[np.argmin(np.round(away, 6))].tolist()
    middle = row, col
    reach = 1.5 * math.sqrt(square) + 2
    obstacles = _nearest(_around(squared, middle, reach, beyond=0) == 0, reach)
    pair = _opposite_pair(obstacles, obstacles, square)
    if pair is None and len(obstacles):
        closed = _nearest(_around(basins, middle, reach, beyond=-1) < 0, reach)
        pair = _opposite_pair(obstacles, closed, square) or (obstacles[0], -obstacles[0])
    if pair is None:
        return middle, middle
    first, second = sorted((end + middle).tolist() for end in pair)
    return (first[0], first[1]), (second[0], second[1])


def _ridge(squared: SquaredDistances, basins: Basins, cell: tuple[int, int]) -> Integers:
    height, width = squared.shape
    square = squared[cell]
    ridge = {cell}
    waiting = [cell]
    while waiting and len(ridge) < _MOST_CELLS:
        row, col = waiting.pop()
        around = [(row + down, col + along) for down, along in _STEPS]
        inside = [(r, c) for r, c in around if 0 <= r < height and 0 <= c < width]
        beside = [place for place in inside if basins[place] >= 0]
        if any(squared[place] > square for place in beside) and (row, col) != cell:
            continue
        for place in beside:
            if squared[place] == square and place not in ridge:
                ridge.add(place)
                waiting.append(place)
    return np.array(sorted(ridge))


def _around(layer: Array, middle: tuple[int, int], reach: float, *, beyond: int) -> Array:
    half, (height, width) = math.ceil(reach), layer.shape
    rows, cols = (index + np.arange(-half, half + 1) for index in middle)
    around: Array = layer[np.ix_(rows.clip(0, height - 1), cols.clip(0, width - 1))]
    around[(rows < 0) | (rows >= height)] = beyond
    around[:, (cols < 0) | (cols >= width)] = beyond
    return around


def _nearest(around: Mask, reach: float) -> Integers:
    offsets = np.argwhere(around) - len(around) // 2
    away = (offsets**2).sum(axis=1)
    order = np.lexsort((offsets[:, 1], offsets[:, 0], away))
    nearest: Integers = offsets[order[away[order] <= reach * reach]]
    return nearest[:_MOST_ENDS]


def _opposite_pair(
    sides: Integers, across: Integers, square: int
) -> tuple[Integers, Integers] | None:
    if not len(sides) or not len(across):
        return None
    away, away_across = (sides**2).sum(axis=1), (across**2).sum(axis=1)
    near = away <= (math.sqrt(square) + 1) ** 2
    sides, away = sides[near], away[near]
    cosine = (sides @ across.T) / np.maximum(np.sqrt(away[:, np.newaxis] * away_across), 1)
    apart = ((sides[:, np.newaxis] - across) ** 2).sum(axis=2)
    for limit in (_OPPOSITE, _ROUGHLY_OPPOSITE):
        is_opposite = cosine <= limit
        if is_opposite.any():
            score = np.where(is_opposite, apart, np.inf)
            nearer = np.where(score == score.min(), away[:, np.newaxis] + away_across, np.inf)
            i, j = np.unravel_index(np.argmin(nearer), nearer.shape)
            return sides[i], across[j]
    return None


def joined(
    count: int, first: NDArray[np.integer], second: NDArray[np.integer],
    is_large: Mask | None = None,
) -> tuple[Integers, Integers]:  # fmt: skip
    """Join nodes over edges in order, as Kruskal does, but never two groups with a large node."""
    # A small node is always joined over its first edge. So each round joins all small nodes at
    # once; as in Boruvka's algorithm, a few rounds are enough.
    into = np.arange(count)
    edges = np.arange(len(first))
    ends = np.stack([first, second], axis=1).astype(np.intp, copy=False)
    may_move = np.ones(count, dtype=np.bool_) if is_large is None else ~is_large
    while len(edges):
        moving = ends[may_move[ends]]  # may repeat a node
        if not len(moving):
            break
        # Of several values numpy stores the last: in reverse order, that of the first edge.
        backwards = ends[::-1]
        into[backwards.ravel()] = backwards[:, ::-1].ravel()
        staying = ends[~may_move[ends]]
        into[staying] = staying
        is_mutual = (into[into[moving]] == moving) & (moving < into[moving])
        into[moving[is_mutual]] = moving[is_mutual]
        _follow(into, moving)
        ends = into[ends]
        apart = ends[:, 0] != ends[:, 1]
        edges, ends = edges[apart], ends[apart]
    _follow(into, np.arange(count))
    return into, edges


def _follow(into: Integers, nodes: Integers) -> None:
    """Replace the target of each node by the end of its chain of targets, in place."""
    nearer = into[nodes]
    while True:
        farther = into[nearer]
        if np.array_equal(farther, nearer):
            return
        into[nodes] = nearer = farther


def sums_behind(
    first: Integers, second: Integers, root: int, values: Floats
) -> tuple[Floats, Integers, Integers]:
    edges_at: dict[int, list[int]] = {}
    for edge, pair in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        for node in pair:
            edges_at.setdefault(node, []).append(edge)
    near, far = np.full(len(first), -1), np.full(len(first), -1)
    order: list[int] = []
    waiting = [root]
    while waiting:
        node = waiting.pop()
        for edge in edges_at.get(node, ()):
            if near[edge] < 0:
                near[edge], far[edge] = node, first[edge] + second[edge] - node
                order.append(edge)
                waiting.append(int(far[edge]))
    sums = values.astype(np.float64, copy=True)
    for edge in reversed(order):
        sums[near[edge]] += sums[far[edge]]
    behind = sums[far]
    behind[far < 0] = np.nan
    return behind, near, far


def saddles_between(squared: SquaredDistances, basins: Basins, labels: Integers) -> Integers:
    """Return the doors between regions of a grid: the widest cells of their borders."""
    first, second = _borders(basins, np.append(labels, -1).astype(np.int32))
    square, beyond = squared.reshape(-1)[first], squared.reshape(-1)[second]
    is_narrower = square <= beyond
    narrower, wider = np.where(is_narrower, first, second), np.where(is_narrower, second, first)
    least = np.minimum(square, beyond).astype(np.int64)
    # edges of cells along a border that share a corner belong to one door
    width = squared.shape[1]
    corner = second + second // width
    is_beside = first // width == second // width
    ends = np.stack([corner, corner + np.where(is_beside, width + 1, 1)])
    corners, ends = np.unique(ends, return_inverse=True)
    ends = ends.reshape(2, -1)
    doors = least_joined(ends[0], ends[1], len(corners))[ends[0]]
    order = np.lexsort((-wider, -narrower, -least))  # as `ClearanceTree` orders its edges
    by_basin = labels[basins.reshape(-1)[np.stack([first, second])]]
    keys = np.stack([doors, by_basin.min(axis=0), by_basin.max(axis=0)])[:, order]
    best = np.sort(np.unique(keys, axis=1, return_index=True)[1])
    joined_to: dict[tuple[int, int], tuple[int, int]] = {}  # (door, region) to the same
    found = []
    for door, *pair, cell in zip(*keys[:, best].tolist(), narrower[order][best], strict=True):
        sides = [(door, label) for label in pair]
        for index in (0, 1):
            while sides[index] in joined_to:
                sides[index] = joined_to[sides[index]]
        if sides[0] != sides[1]:
            joined_to[sides[0]] = sides[1]
            found.append((cell, *pair))
    return np.array(found, dtype=np.int64).reshape(-1, 3)


def _borders(basins: Basins, labels: Basins) -> tuple[Integers, Integers]:
    """Return the pairs of neighbouring cells of different regions; basin -1 has the last label."""
    width = basins.shape[1]
    found: dict[int, list[Integers]] = {}

    def compare(rows: slice) -> None:
        part = labels[basins[rows.start : rows.stop + 1]]
        own = part[: rows.stop - rows.start]
        for step, here, there in ((1, own[:, :-1], own[:, 1:]), (width, part[:-1], part[1:])):
            row, col = np.divmod(np.flatnonzero(here != there), max(here.shape[1], 1))
            are_regions = np.minimum(here[row, col], there[row, col]) >= 0
            first = (row[are_regions] + rows.start) * width + col[are_regions]
            found.setdefault(rows.start, []).append(np.stack([first, first + step]))

    threads.for_rows(compare, basins.shape)
    pairs = np.concatenate([part for start in sorted(found) for part in found[start]], axis=1)
    return pairs[0], pairs[1]


@dataclass(frozen=True, eq=False)
class ClearanceTree:
    """Basins of clearance, and the widest passages between them."""

    # Cells are ordered by square, then by flat index. Each cell points to the largest of its four
    # neighbours if that is larger than itself. So a path leads from each cell to the peak of its
    # basin along which squares never fall, and the bottleneck between two cells is the least of
    # their own squares and of the edges between their basins in the forest.

    basins: Basins
    peaks: Integers
    peak_cells: Integers
    firsts: Basins  # basins at both ends of each edge
    seconds: Basins
    squares: Integers
    cells: Integers


@dataclass(frozen=True, eq=False)
class RootedTree:
    order: Basins
    parent_edges: Basins
    bottlenecks: Integers
