"""Paths over a grid: the cheapest, the widest, and those of a footprint that turns.

The widest paths between all pairs of cells are found at once, over edges of traversable cells. The
bottleneck of a path is its least squared distance (`mapdeal.kernels.distance.squared_distance`).
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from types import ModuleType
from typing import NamedTuple, Protocol

import numpy as np

from mapdeal.kernels.arrays import Bytes, Floats, Integers, Mask, Metres, SquaredDistances
from mapdeal.kernels.blocks import Layer
from mapdeal.kernels.components import ClearanceTree, RootedTree
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.polygons import Cell, Pose, Spans

# Weight 1 on the scale of path sums. Weights and diagonals are rounded to whole numbers on this
# scale, so that sums are exact and paths of equal cost compare equal.
UNIT = float(1 << 24)
ROOT_OF_2 = math.sqrt(2.0)
_ROUNDING = float(1 << 52)
_STEPS = tuple((row, col) for row in (-1, 0, 1) for col in (-1, 0, 1) if row or col)


class FoundPath(NamedTuple):
    cells: Integers
    cost: float
    expanded: int


def cheapest_path(
    weights: Floats, start: Cell, goal: Cell, *, surcharges: Floats | None = None
) -> FoundPath:
    # Diagonal steps between two closed cells are forbidden: walls that touch at a corner leave no
    # gap. The estimate, octile distance times the lowest weight, never exceeds the remaining cost,
    # so the path is optimal. Among equal estimates the latest cell is expanded first; this selects
    # one of several optimal paths.
    # Surcharges make the estimate inconsistent: a cell may be expanded before the cheapest path to
    # it is known. It is not opened again, as a correction would undo the effect of the surcharges
    # and could expand cells many times. Start and goal must be open, and weights at most 2^27.
    scaled = np.rint(np.multiply(weights, UNIT, dtype=np.float64))
    np.maximum(scaled, 1.0, out=scaled)
    scaled[weights <= 0] = 0.0
    least = float(scaled.min(where=scaled > 0, initial=math.inf))
    more = None if surcharges is None else np.rint(np.multiply(surcharges, UNIT, dtype=np.float64))
    if engine_name() == "compiled":
        from mapdeal.kernels import _compiled

        cells, cost, expanded = _compiled.cheapest_path(scaled, start, goal, least, more)
    else:
        cells, cost, expanded = _cheapest_path(scaled, start, goal, least, more)
    return FoundPath(np.stack(np.divmod(cells, weights.shape[1]), axis=1), cost / UNIT, expanded)


def _cheapest_path(
    weights: Floats, start: Cell, goal: Cell, least: float, surcharges: Floats | None
) -> tuple[Integers, float, int]:
    """Find the path that search.h finds, with the same steps."""
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
            cells = [last]
            while cells[-1] != first:
                cells.append(before[cells[-1]])
            return np.array(cells[::-1], dtype=np.int64), costs[last], expanded
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
                heapq.heappush(heap, (total + estimate(row + rows, col + cols), turn, following))
    return np.empty(0, dtype=np.int64), math.inf, expanded


def _diagonal(weight: float) -> float:
    return (weight * ROOT_OF_2 + _ROUNDING) - _ROUNDING


def clearance_tree(squared: SquaredDistances, is_traversable: Mask) -> ClearanceTree:
    return _engine(squared).clearance_tree(squared, is_traversable)  # type: ignore[no-any-return]


def rooted(tree: ClearanceTree, root: int) -> RootedTree:
    return _engine(tree.basins).rooted(tree, root)  # type: ignore[no-any-return]


def widest_metres(
    tree: ClearanceTree, rooted_tree: RootedTree, squared: SquaredDistances, start: Cell,
    resolution: float, *, in_place: bool = False,
) -> Metres:  # fmt: skip
    # The bottleneck from each basin's peak to the start, 0 without a path. The entry before them is
    # for cells outside of all basins (-1).
    limits = np.zeros(len(tree.peaks) + 1, dtype=np.int64)
    np.clip(rooted_tree.bottlenecks, 0, int(squared[start]), out=limits[1:])
    metres = _floats_over(tree.basins, in_place=in_place)
    _engine(squared).widest_metres(tree.basins, squared, limits, resolution, metres)
    return metres


def clearance_metres(
    squared: SquaredDistances, resolution: float, *, in_place: bool = False
) -> Metres:
    metres = _floats_over(squared, in_place=in_place)
    _engine(squared).clearance_metres(squared, resolution, metres)
    return metres


def basin_areas(tree: ClearanceTree, squared: SquaredDistances, above: int = 0) -> Integers:
    basins, count = tree.basins, len(tree.peaks)
    return _engine(squared).basin_areas(basins, squared, above, count)  # type: ignore[no-any-return]


def _floats_over(cells: SquaredDistances, *, in_place: bool) -> Metres:
    if in_place and cells.dtype == np.int32 and cells.flags.c_contiguous and cells.flags.writeable:
        return cells.view(np.float32)
    return np.empty(cells.shape, np.float32)


def _engine(squared: SquaredDistances | None = None) -> ModuleType:
    if engine_name() == "compiled":
        from mapdeal.kernels import compiled

        if squared is None or compiled.fits(squared):
            return compiled
    from mapdeal.kernels import scipy_twins

    return scipy_twins


class OpenPoses(Protocol):
    """The open poses of a footprint: inside the grid and clear of blocked cells."""

    # An open pose connects to the open poses of the previous and the next heading at the same cell,
    # headings being a circle, and to those of the same heading at the four adjacent cells.

    headings: Bytes  # number of open headings of each cell, shape (H, W)

    def at(self, row: int, col: int) -> Mask:
        """Return which headings are open at a cell."""

    def reach(self, seeds: Sequence[Pose], cells: Sequence[Cell]) -> tuple[Bytes, Mask]:
        """Return the cells reachable from poses, and the reachable headings of some cells."""


def open_poses(
    blocked: Layer, footprints: Sequence[Spans], closed: Mask | None = None
) -> OpenPoses:
    """Return the poses of a footprint in up to 255 headings, none centred on a closed cell."""
    return _engine().OpenPoses(blocked, footprints, closed)  # type: ignore[no-any-return]
