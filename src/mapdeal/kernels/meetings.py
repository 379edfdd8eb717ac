"""Where ways of two regions meet, and the gaps there."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.components import least_joined
from mapdeal.kernels.distance import SquaredDistances
from mapdeal.kernels.threads import for_rows

_STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))
_MOST_CELLS = 20_000
"""Of a ridge: more are not followed."""
_MOST_ENDS = 400
_OPPOSITE, _ROUGHLY_OPPOSITE = -0.7, -0.3
"""Cosines of the angle at which two obstacles are seen from between them."""

RowCol = tuple[float, float]


def gap_at(
    squared: SquaredDistances, basins: NDArray[np.int32], cell: tuple[int, int]
) -> tuple[RowCol, RowCol]:
    """Return the two ends of the gap that a saddle lies in."""
    # In a wall of some thickness all cells in the middle of the door are equally narrow, and any of
    # them may be the saddle. From it the ridge is followed over cells that are as wide, as long as
    # none beside them is wider: so it ends where rooms begin, and does not run along their walls.
    square = int(squared[cell])
    middle = _middle_of(_ridge(squared, basins, cell))
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


def _ridge(
    squared: SquaredDistances, basins: NDArray[np.int32], cell: tuple[int, int]
) -> NDArray[np.int64]:
    height, width = squared.shape
    square = squared[cell]
    ridge = {cell}
    waiting = [cell]
    while waiting and len(ridge) < _MOST_CELLS:
        row, col = waiting.pop()
        beside = [(row + down, col + along) for down, along in _STEPS]
        beside = [
            (r, c) for r, c in beside if 0 <= r < height and 0 <= c < width and basins[r, c] >= 0
        ]
        is_end = any(squared[place] > square for place in beside)
        if is_end and (row, col) != cell:
            continue
        for place in beside:
            if squared[place] == square and place not in ridge:
                ridge.add(place)
                waiting.append(place)
    return np.array(sorted(ridge))


def _middle_of(cells: NDArray[np.int64]) -> tuple[int, int]:
    """Return the cell nearest to the middle of all."""
    away = ((cells - cells.mean(axis=0)) ** 2).sum(axis=1)
    row, col = cells[np.argmin(np.round(away, 6))].tolist()
    return row, col


def _around(
    layer: NDArray[Any], middle: tuple[int, int], reach: float, *, beyond: int
) -> NDArray[Any]:
    half = math.ceil(reach)
    around = np.full((2 * half + 1, 2 * half + 1), beyond, dtype=layer.dtype)
    top, left = middle[0] - half, middle[1] - half
    inside = layer[max(top, 0) : top + len(around), max(left, 0) : left + len(around)]
    row, col = max(-top, 0), max(-left, 0)
    around[row : row + inside.shape[0], col : col + inside.shape[1]] = inside
    return around


def _nearest(around: NDArray[np.bool_], reach: float) -> NDArray[np.int64]:
    """Return the marked cells from the middle, the nearest first."""
    offsets = np.argwhere(around) - len(around) // 2
    away = (offsets**2).sum(axis=1)
    order = np.lexsort((offsets[:, 1], offsets[:, 0], away))
    nearest: NDArray[np.int64] = offsets[order[away[order] <= reach * reach]]
    return nearest[:_MOST_ENDS]


def _opposite_pair(
    sides: NDArray[np.int64], across: NDArray[np.int64], square: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """Return the closest pair of cells, given from the middle, that lie on opposite sides."""
    if not len(sides) or not len(across):
        return None
    away, away_across = (sides**2).sum(axis=1), (across**2).sum(axis=1)
    near = away <= (math.sqrt(square) + 1) ** 2
    sides, away = sides[near], away[near]
    lengths = np.sqrt(away[:, np.newaxis] * away_across)
    cosine = (sides @ across.T) / np.maximum(lengths, 1)
    apart = ((sides[:, np.newaxis] - across) ** 2).sum(axis=2)
    for limit in (_OPPOSITE, _ROUGHLY_OPPOSITE):
        is_opposite = cosine <= limit
        if is_opposite.any():
            score = np.where(is_opposite, apart, np.inf)
            best = score == score.min()
            nearer = np.where(best, away[:, np.newaxis] + away_across, np.inf)
            i, j = np.unravel_index(np.argmin(nearer), nearer.shape)
            return sides[i], across[j]
    return None


def joined(
    count: int,
    one: NDArray[np.integer],
    other: NDArray[np.integer],
    is_large: NDArray[np.bool_] | None = None,
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Join nodes over edges, but never two large ones."""
    # The edges are taken one after the other, as Kruskal does: each joins what it links, unless a
    # large node is part of both already.
    # A node that is not large is alone until its first edge comes. That edge joins it whatever else
    # has been joined by then, so all such nodes can be joined over their first edge at once; as in
    # Boruvka's algorithm, a few such rounds are enough.
    into = np.arange(count)
    edges = np.arange(len(one))
    ends = np.stack([one, other], axis=1).astype(np.intp, copy=False)
    may_move = np.ones(count, dtype=np.bool_) if is_large is None else ~is_large
    while len(edges):
        moving = ends[may_move[ends]]
        if not len(moving):
            break
        _join_over_first_edge(into, ends, moving, may_move)
        ends = into[ends]
        is_left = ends[:, 0] != ends[:, 1]
        edges, ends = edges[is_left], ends[is_left]
    _follow(into, np.arange(count))
    return into, edges


def _join_over_first_edge(
    into: NDArray[np.intp], ends: NDArray[np.intp], moving: NDArray[np.intp],
    may_move: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Let nodes point to what they become, in place."""
    # Of all nodes in `ends` those in `moving` may; both may name a node more than once.
    backwards = ends[::-1]
    first, second = backwards[:, 1], backwards[:, 0]
    # Of several values for one place the last one stays: that of the first edge.
    into[backwards.ravel()] = np.stack([first, second], axis=1).ravel()
    staying = ends[~may_move[ends]]
    into[staying] = staying
    is_mutual = (into[into[moving]] == moving) & (moving < into[moving])
    into[moving[is_mutual]] = moving[is_mutual]
    _follow(into, moving)


def _follow(into: NDArray[np.intp], nodes: NDArray[np.intp]) -> None:
    """Let nodes point to where the ways from them end, in place."""
    nearer = into[nodes]
    while True:
        farther = into[nearer]
        if np.array_equal(farther, nearer):
            return
        into[nodes] = nearer = farther


def sums_behind(
    one: NDArray[np.intp], other: NDArray[np.intp], root: int, values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]:  # fmt: skip
    """Return what lies behind each edge of a forest, seen from a node."""
    edges_at: dict[int, list[int]] = {}
    for edge, pair in enumerate(zip(one.tolist(), other.tolist(), strict=True)):
        for node in pair:
            edges_at.setdefault(node, []).append(edge)
    near, far = np.full(len(one), -1), np.full(len(one), -1)
    order: list[int] = []
    waiting = [root]
    while waiting:
        node = waiting.pop()
        for edge in edges_at.get(node, ()):
            if near[edge] < 0:
                near[edge], far[edge] = node, one[edge] + other[edge] - node
                order.append(edge)
                waiting.append(int(far[edge]))
    sums = values.astype(np.float64, copy=True)
    for edge in reversed(order):
        sums[near[edge]] += sums[far[edge]]
    behind = sums[far]
    behind[far < 0] = np.nan
    return behind, near, far


def saddles_between(
    squared: SquaredDistances, basins: NDArray[np.int32], labels: NDArray[np.intp]
) -> NDArray[np.int64]:
    """Return the doors between regions of a grid: the widest places of the borders between them."""
    first, second = _borders(basins, np.append(labels, -1).astype(np.int32))
    square, beyond = squared.reshape(-1)[first], squared.reshape(-1)[second]
    is_narrower = square <= beyond
    narrower, wider = np.where(is_narrower, first, second), np.where(is_narrower, second, first)
    least = np.minimum(square, beyond).astype(np.int64)
    # the corners of cells that a border runs along: those of one door are linked
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
    joined_to: dict[tuple[int, int], tuple[int, int]] = {}  # regions at a door
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


def _borders(
    basins: NDArray[np.int32], labels: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the pairs of neighbouring cells of different regions; the last label is of -1."""
    width = basins.shape[1]
    found: dict[int, list[NDArray[np.int64]]] = {}

    def some(rows: slice) -> None:
        part = labels[basins[rows.start : rows.stop + 1]]
        own = part[: rows.stop - rows.start]
        for step, one, other in ((1, own[:, :-1], own[:, 1:]), (width, part[:-1], part[1:])):
            row, col = np.divmod(np.flatnonzero(one != other), max(one.shape[1], 1))
            are_regions = np.minimum(one[row, col], other[row, col]) >= 0
            first = (row[are_regions] + rows.start) * width + col[are_regions]
            found.setdefault(rows.start, []).append(np.stack([first, first + step]))

    for_rows(some, basins.shape)
    pairs = np.concatenate([one for start in sorted(found) for one in found[start]], axis=1)
    return pairs[0], pairs[1]
