"""The cheapest path from cell to cell."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class FoundPath:
    """What a search has found."""

    cells: NDArray[np.int64]
    cost: float
    expanded: int


def cheapest_path(
    weights: NDArray[np.float64],
    start: Cell,
    goal: Cell,
    *,
    surcharges: NDArray[np.float64] | None = None,
) -> FoundPath:
    """Return the cheapest path over the eight neighbours of cells, by A*."""
    # Diagonal steps between two closed cells are not allowed: where walls touch at a corner there
    # is no gap. What remains to the goal is estimated by the octile distance times the lowest
    # weight, which is never more than it takes; so the answer is the optimum. Of several, the one
    # is returned that is found if of equal estimates the latest is followed first.
    # Surcharges make the estimate inconsistent: a cell may be expanded before the cheapest path to
    # it is known. A cell that was expanded is not opened again: to correct its path afterwards
    # would undo what the surcharges are for, and could expand cells many times. So each cell is
    # expanded once at most, and a path is found if there is one.
    if not all(_holds(weights, cell) and weights[cell] > 0 for cell in (start, goal)):
        raise ValueError("start and goal must be open cells")
    scaled = np.rint(weights * UNIT)
    np.maximum(scaled, 1.0, out=scaled)
    scaled[weights <= 0] = 0.0
    if surcharges is not None and surcharges.shape != weights.shape:
        raise ValueError("surcharges must have the shape of the weights")
    if scaled.max() > UNIT * (1 << 27):
        raise ValueError("weights must not be above 2^27")
    least = float(scaled.min(where=scaled > 0, initial=math.inf))
    more = None if surcharges is None else np.rint(surcharges * UNIT)
    if engine_name() == "compiled":
        from mapdeal.kernels import _compiled

        found = _compiled.cheapest_path(scaled, start, goal, least, more)
    else:
        found = _cheapest_path(scaled, start, goal, least, more)
    cells, cost, expanded = found
    return FoundPath(np.stack(np.divmod(cells, weights.shape[1]), axis=1), cost / UNIT, expanded)


def _holds(weights: NDArray[np.float64], cell: Sequence[int]) -> bool:
    return all(0 <= index < length for index, length in zip(cell, weights.shape, strict=True))


def _cheapest_path(
    weights: NDArray[np.float64],
    start: Cell,
    goal: Cell,
    least: float,
    surcharges: NDArray[np.float64] | None,
) -> tuple[NDArray[np.int64], float, int]:
    """Do as search.h does, step by step."""
    height, width = weights.shape
    weight_of = weights.reshape(-1).data
    surcharge_of = None if surcharges is None else surcharges.reshape(-1).data
    goal_row, goal_col = goal
    first, last = start[0] * width + start[1], goal_row * width + goal_col
    diagonal_least = _diagonal(least)

    def estimate(row: int, col: int) -> float:
        rows, cols = abs(row - goal_row), abs(col - goal_col)
        diagonal = min(rows, cols)
        octile = least * (rows + cols - 2 * diagonal) + diagonal_least * diagonal
        return octile if surcharge_of is None else octile + surcharge_of[row * width + col]

    costs, before = {first: 0.0}, {first: first}
    closed: set[int] = set()
    turn = expanded = 0
    heap = [(estimate(*start), turn, first)]
    while heap:
        estimated, _, cell = heapq.heappop(heap)
        if cell == last:
            return _traced(before, first, last), costs[last], expanded
        row, col = divmod(cell, width)
        cost = costs[cell]
        if estimated > cost + estimate(row, col):
            continue
        expanded += 1
        if surcharge_of is not None:
            closed.add(cell)
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
            if total < costs.get(following, math.inf) and following not in closed:
                costs[following], before[following] = total, cell
                turn -= 1
                remaining = estimate(row + rows, col + cols)
                heapq.heappush(heap, (total + remaining, turn, following))
    return np.empty(0, dtype=np.int64), math.inf, expanded


def _diagonal(weight: float) -> float:
    return (weight * ROOT_OF_2 + _ROUNDING) - _ROUNDING


def _traced(before: dict[int, int], first: int, last: int) -> NDArray[np.int64]:
    cells = [last]
    while cells[-1] != first:
        cells.append(before[cells[-1]])
    return np.array(cells[::-1], dtype=np.int64)
