"""The gap between obstacles that a narrowest cell lies in."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.squares import SquaredDistances

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
    """Return the two ends of the gap that a saddle lies in.

    Notes
    -----
    In a wall of some thickness all cells in the middle of the door are equally narrow, and any of
    them may be the saddle. From it the ridge is followed over cells that are as wide, as long as
    none beside them is wider: so it ends where rooms begin, and does not run along their walls.
    """
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
    """Return the cells of a layer around one, which is in the middle, and what is beyond edges."""
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
