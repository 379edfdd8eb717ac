"""The cheapest path from cell to cell."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name

UNIT = float(1 << 24)
"""What a weight of 1 is on the scale that paths are summed on. Weights and their diagonals are
rounded to whole numbers there, so that sums are exact, and equal costs of different paths equal."""

ROOT_OF_2 = math.sqrt(2.0)
_ROUNDING = float(1 << 52)
_STEPS = tuple((row, col) for row in (-1, 0, 1) for col in (-1, 0, 1) if row or col)

Cell = tuple[int, int]


def cheapest_path(
    weights: NDArray[np.float64], start: Cell, goal: Cell
) -> tuple[NDArray[np.int64], float] | None:
    """Return the cheapest path over the eight neighbours of cells, by A*.

    Parameters
    ----------
    weights : numpy.ndarray of float64, shape (H, W)
        Cost of a step into each cell per cell of its length, at most 2^27; 0 or less if the
        cell is closed. Rounded to multiples of 2^-24.
    start, goal : tuple of int
        Row and column of two open cells.

    Returns
    -------
    cells : numpy.ndarray of int64, shape (N, 2)
        Rows and columns, the start first, the goal last.
    cost : float
        Sum over all steps of length, 1 or the root of 2, times the weight of the cell stepped
        into. No path has a lower one.

    None if there is no path.

    Notes
    -----
    Diagonal steps between two closed cells are not allowed: where walls touch at a corner
    there is no gap. What remains to the goal is estimated by the octile distance times the
    lowest weight, which is never more than it takes; so the answer is the optimum. Of several,
    the one is returned that is found if of equal estimates the latest is followed first.

    Examples
    --------
    >>> weights = np.array([[1.0, 0.0, 1.0], [1.0, 1.0, 1.0]])
    >>> cells, cost = cheapest_path(weights, (0, 0), (0, 2))
    >>> cells.tolist(), round(cost, 6)
    ([[0, 0], [1, 1], [0, 2]], 2.828427)
    """
    if not all(_holds(weights, cell) and weights[cell] > 0 for cell in (start, goal)):
        raise ValueError("start and goal must be open cells")
    scaled = np.rint(weights * UNIT)
    np.maximum(scaled, 1.0, out=scaled)
    scaled[weights <= 0] = 0.0
    if scaled.max() > UNIT * (1 << 27):
        raise ValueError("weights must not be above 2^27")
    least = float(scaled.min(where=scaled > 0, initial=math.inf))
    if engine_name() == "compiled":
        from mapdeal.kernels import _compiled

        found = _compiled.cheapest_path(scaled, start, goal, least)
    else:
        found = _cheapest_path(scaled, start, goal, least)
    if found is None:
        return None
    cells, cost = found
    return np.stack(np.divmod(cells, weights.shape[1]), axis=1), cost / UNIT


def _holds(weights: NDArray[np.float64], cell: Sequence[int]) -> bool:
    return all(0 <= index < length for index, length in zip(cell, weights.shape, strict=True))


def _cheapest_path(
    weights: NDArray[np.float64], start: Cell, goal: Cell, least: float
) -> tuple[NDArray[np.int64], float] | None:
    """Do as search.h does, step by step."""
    height, width = weights.shape
    weight_of = weights.reshape(-1).data
    goal_row, goal_col = goal
    first, last = start[0] * width + start[1], goal_row * width + goal_col
    diagonal_least = _diagonal(least)

    def estimate(row: int, col: int) -> float:
        rows, cols = abs(row - goal_row), abs(col - goal_col)
        diagonal = min(rows, cols)
        return least * (rows + cols - 2 * diagonal) + diagonal_least * diagonal

    costs, before = {first: 0.0}, {first: first}
    turn = 0
    heap = [(estimate(*start), turn, first)]
    while heap:
        estimated, _, cell = heapq.heappop(heap)
        if cell == last:
            return _traced(before, first, last), costs[last]
        row, col = divmod(cell, width)
        cost = costs[cell]
        if estimated > cost + estimate(row, col):
            continue
        for rows, cols in _STEPS:
            if not (0 <= row + rows < height and 0 <= col + cols < width):
                continue
            following = cell + rows * width + cols
            weight = weight_of[following]
            if weight <= 0:
                continue
            if rows and cols:
                if weight_of[cell + rows * width] <= 0 and weight_of[cell + cols] <= 0:
                    continue
                weight = _diagonal(weight)
            total = cost + weight
            if total < costs.get(following, math.inf):
                costs[following], before[following] = total, cell
                turn -= 1
                remaining = estimate(row + rows, col + cols)
                heapq.heappush(heap, (total + remaining, turn, following))
    return None


def _diagonal(weight: float) -> float:
    return (weight * ROOT_OF_2 + _ROUNDING) - _ROUNDING


def _traced(before: dict[int, int], first: int, last: int) -> NDArray[np.int64]:
    cells = [last]
    while cells[-1] != first:
        cells.append(before[cells[-1]])
    return np.array(cells[::-1], dtype=np.int64)
