"""Paths over a grid: the cheapest, the widest, and those of a footprint that turns.

The widest paths between all pairs of cells are found at once, over edges of traversable cells. The
bottleneck of a path is its least squared distance (`mapdeal.kernels.distance.squared_distance`).
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from mapdeal.kernels.arrays import Bytes, Floats, Integers, Mask, Metres, SquaredDistances
from mapdeal.kernels.blocks import Layer
from mapdeal.kernels.components import ClearanceTree, RootedTree
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.polygons import Cell, Pose, Spans

UNIT = float(1 << 24)
"""Weight 1 on the scale of path sums. Weights and diagonals are rounded to whole numbers on this
scale, so that sums are exact and paths of equal cost compare equal."""

ROOT_OF_2 = math.sqrt(2.0)
_ROUNDING = float(1 << 52)
_STEPS = tuple((row, col) for row in (-1, 0, 1) for col in (-1, 0, 1) if row or col)


@dataclass(frozen=True, eq=False)
class FoundPath:
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
    # and could expand cells many times. Each cell is expanded at most once, and a path is found if
    # one exists.
    ends = np.array([start, goal])
    is_inside = ((ends >= 0) & (ends < weights.shape)).all()
    if not (is_inside and (weights[tuple(ends.T)] > 0).all()):
        raise ValueError("start and goal must be open cells")
    scaled = np.rint(np.multiply(weights, UNIT, dtype=np.float64))
    np.maximum(scaled, 1.0, out=scaled)
    scaled[weights <= 0] = 0.0
    if surcharges is not None and surcharges.shape != weights.shape:
        raise ValueError("surcharges must have the shape of the weights")
    if scaled.max() > UNIT * (1 << 27):
        raise ValueError("weights must not be above 2^27")
    least = float(scaled.min(where=scaled > 0, initial=math.inf))
    more = None if surcharges is None else np.rint(np.multiply(surcharges, UNIT, dtype=np.float64))
    if engine_name() == "compiled":
        from mapdeal.kernels import _compiled

        found = _compiled.cheapest_path(scaled, start, goal, least, more)
    else:
        found = _cheapest_path(scaled, start, goal, least, more)
    cells, cost, expanded = found
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
                remaining = estimate(row + rows, col + cols)
                heapq.heappush(heap, (total + remaining, turn, following))
    return np.empty(0, dtype=np.int64), math.inf, expanded


def _diagonal(weight: float) -> float:
    return (weight * ROOT_OF_2 + _ROUNDING) - _ROUNDING


def clearance_tree(squared: SquaredDistances, is_traversable: Mask) -> ClearanceTree:
    if squared.ndim != 2 or squared.dtype not in (np.int32, np.int64):
        rule = f"squares must be an integer array with two axes, not {squared.ndim} of"
        raise ValueError(f"{rule} {squared.dtype}")
    if is_traversable.dtype != np.bool_ or is_traversable.shape != squared.shape:
        raise ValueError("the mask of traversable cells must be bool, of the shape of the squares")
    return _engine(squared).clearance_tree(squared, is_traversable)  # type: ignore[no-any-return]


def rooted(tree: ClearanceTree, root: int) -> RootedTree:
    if not 0 <= root < len(tree.peaks):
        raise IndexError(f"the tree has no basin {root}")
    return _engine(tree.basins).rooted(tree, root)  # type: ignore[no-any-return]


def widest_metres(
    tree: ClearanceTree, squared: SquaredDistances, start: Cell, resolution: float,
    *, rooted_tree: RootedTree | None = None, in_place: bool = False,
) -> Metres:  # fmt: skip
    basin = int(tree.basins[start])
    if basin < 0:
        raise ValueError("the start must be a traversable cell")
    if rooted_tree is None:
        rooted_tree = rooted(tree, basin)
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


MOST_HEADINGS = 255  # a byte counts them


@dataclass(frozen=True, eq=False)
class Reached:
    reachable: Bytes
    headings: Mask


class ConfigurationSpace:
    """The open poses of a footprint: inside the grid and clear of blocked cells."""

    # An open pose connects to the open poses of the previous and the next heading at the same cell,
    # headings being a circle, and to those of the same heading at the four adjacent cells.
    # Each pose is one bit in the plane of its heading. A flood clears the bits of reached poses
    # instead of storing a second set; the planes are computed again for the next call.

    def __init__(
        self, blocked: Layer, footprints: Sequence[Spans], *, closed: Mask | None = None
    ) -> None:
        # poses centred on `closed` cells are closed
        if not 1 <= len(footprints) <= MOST_HEADINGS:
            raise ValueError(f"there must be 1 to {MOST_HEADINGS} headings")
        if not all(len(spans.rows) and (spans.starts < spans.stops).all() for spans in footprints):
            raise ValueError("a footprint without cells, or with an empty run")
        self.shape = blocked.shape
        self._count = len(footprints)
        self._poses = _engine().OpenPoses(blocked, footprints, closed)
        self.headings: Bytes = self._poses.headings
        """Number of open headings of each cell, shape (H, W)."""

    def open_headings(self, row: int, col: int) -> Mask:
        self._check(row, col)
        return self._poses.at(row, col)  # type: ignore[no-any-return]

    def reach(self, seeds: Sequence[Pose], cells: Sequence[Cell] = ()) -> Reached:
        """Return the cells reachable from poses, and the reachable headings of some cells."""
        for heading, row, col in seeds:
            self._check(row, col, heading)
        for row, col in cells:
            self._check(row, col)
        return Reached(*self._poses.reach(seeds, cells))

    def _check(self, row: int, col: int, heading: int = 0) -> None:
        height, width = self.shape
        if not (0 <= row < height and 0 <= col < width and 0 <= heading < self._count):
            raise IndexError("no such cell, or no such heading")
