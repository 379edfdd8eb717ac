"""Paths over a grid: the cheapest, the widest, those of a footprint that turns, costs to a goal.

The widest paths between all pairs of cells are found at once, over edges of traversable cells. The
bottleneck of a path is its least squared distance (`mapdeal.kernels.distance.squared_distance`).

Costs to a goal over a plane of cells solve the eikonal equation. A cell gets its cost across one of
the eight triangles of its centre, that of a cell beside it and that of a diagonal one: costs are
linear between the two others, which is of first order, and a way goes straight through a triangle.
Along the eight directions of a grid the costs are exact, between them they are too high. The centre
of a triangle's diagonal touches a fourth cell, which may be closed; so a way never passes between
two closed cells that touch.

The cost of a cell is at least 1 / sqrt(2) of its weight above those that it follows from. So all
cells whose costs differ by less are final at once, in any order, and the lists of cells by costs
need no order of their own (J. Tsitsiklis, "Efficient Algorithms for Globally Optimal Trajectories",
1995).
"""

from __future__ import annotations

import heapq
import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
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
_LEAST_RISE = 0.7  # of a cell's weight, below 1 / sqrt(2) by more than rounding
Place = tuple[float, float]
# Cells around a goal whose lengths are exact where a straight line leads to it: there the costs of
# the eikonal equation would be up to 4 % too high.
_EXACT_WITHIN = 10


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
    resolution: float,
) -> Metres:  # fmt: skip
    """Return the metres of the widest path to each cell, which overwrite the basins."""
    # The bottleneck from each basin's peak to the start, 0 without a path. The entry before them is
    # for cells outside of all basins (-1).
    limits = np.zeros(len(tree.peaks) + 1, dtype=np.int64)
    np.clip(rooted_tree.bottlenecks, 0, int(squared[start]), out=limits[1:])
    metres = _floats_over(tree.basins)
    _engine(squared).widest_metres(tree.basins, squared, limits, resolution, metres)
    return metres


def clearance_metres(squared: SquaredDistances, resolution: float) -> Metres:
    metres = _floats_over(squared)
    _engine(squared).clearance_metres(squared, resolution, metres)
    return metres


def basin_areas(tree: ClearanceTree, squared: SquaredDistances, above: int = 0) -> Integers:
    basins, count = tree.basins, len(tree.peaks)
    return _engine(squared).basin_areas(basins, squared, above, count)  # type: ignore[no-any-return]


def _floats_over(cells: SquaredDistances) -> Metres:
    if cells.dtype == np.int32 and cells.flags.c_contiguous and cells.flags.writeable:
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


def open_poses(blocked: Layer, footprints: Sequence[Spans], closed: Mask | None) -> OpenPoses:
    """Return the poses of a footprint in up to 255 headings, none centred on a closed cell."""
    return _engine().OpenPoses(blocked, footprints, closed)  # type: ignore[no-any-return]


def costs_to_go(classes: Bytes, weights: Floats, sources: Integers, starts: Floats) -> Floats:
    """Return the lowest cost from each cell to a source, inf if none; sources have costs, too."""
    # A way of one cell's length costs the weight of the cell's class, 0 if it is closed. Sources
    # are open cells, shape (N, 2).
    used = weights[np.unique(classes)]
    used = used[used > 0]
    if not len(used):
        return np.full(classes.shape, math.inf)
    table = np.zeros(256)
    table[: len(weights)] = weights
    padded = np.pad(classes, 1, constant_values=int(np.argmin(table)))
    costs = np.full(padded.shape, math.inf)
    cells = np.ravel_multi_index(tuple(sources.T + 1), padded.shape)
    lists_per_cost = 1 / (_LEAST_RISE * float(used.min()))
    longest = max(ROOT_OF_2 * float(used.max()), float(starts.max(initial=0.0)))
    count = int(longest * lists_per_cost) + 3
    if engine_name() == "compiled":
        from mapdeal.kernels import _compiled

        _compiled.costs_to_go(padded, table, cells, starts, lists_per_cost, count, costs)
    else:
        _costs_to_go(padded, table, cells, starts, lists_per_cost, costs)
    return costs[1:-1, 1:-1]


def _costs_to_go(
    classes: Bytes, table: Floats, sources: Integers, starts: Floats, per_cost: float, costs: Floats
) -> None:
    """Do as eikonal.h does, with all cells of a list at once."""
    width = classes.shape[1]
    weights, flat = table[classes.reshape(-1)], costs.reshape(-1)
    lists: dict[int, list[Integers]] = defaultdict(list)

    def lower(cells: Integers, lowered: Floats) -> None:
        is_lower = lowered < flat[cells]
        cells, lowered = cells[is_lower], lowered[is_lower]
        np.minimum.at(flat, cells, lowered)
        places = (lowered * per_cost).astype(np.int64)
        for place in np.unique(places).tolist():
            lists[place].append(cells[places == place])

    lower(sources, starts)
    while lists:
        place = min(lists)
        cells = np.unique(np.concatenate(lists.pop(place)))
        cells = cells[(flat[cells] * per_cost).astype(np.int64) == place]
        for step, side in ((-width, 1), (-1, width), (1, width), (width, 1)):
            beside = cells + step
            is_open = weights[beside] > 0
            cell, beside = cells[is_open], beside[is_open]
            cost, weight = flat[cell], weights[beside]
            drop = cost - np.minimum(flat[cell - side], flat[cell + side])
            square = weight * weight - drop * drop
            lower(beside, np.where(drop <= 0, cost + weight, math.inf))
            across = (drop > 0) & (square > drop * drop)
            lower(beside[across], cost[across] + np.sqrt(square[across]))
            for turn in (-side, side):
                beyond = weights[beside + turn] * ROOT_OF_2
                lower((beside + turn)[beyond > 0], (cost + beyond)[beyond > 0])


def lengths_to(is_open: Mask, place: Place) -> Floats:
    """Return the length in cells of the shortest way from each centre to a place; inf if none."""
    weights = np.zeros(256)
    weights[1] = 1.0
    return weighted_lengths_to(is_open.view(np.uint8), weights, place)


def weighted_lengths_to(classes: Bytes, weights: Floats, place: Place) -> Floats:
    """Return the lowest cost from each centre to a place, at a weight per class; 0 closes cells."""
    goal = (math.floor(place[0]), math.floor(place[1]))
    is_open = opens((weights > 0)[classes])
    if not is_open(goal):
        return np.full(classes.shape, math.inf)
    used = weights[np.unique(classes)]
    reach = _EXACT_WITHIN if used.min(where=used > 0, initial=math.inf) == used.max() else 1
    rows, cols = (range(index - reach, index + reach + 1) for index in goal)
    centres = [(row + 0.5, col + 0.5) for row in rows for col in cols if is_open((row, col))]
    visible = [centre for centre in centres if is_line_clear(is_open, centre, place)]
    sources = np.array(visible).astype(np.int64)
    starts = np.hypot(*(np.array(visible) - place).T)
    starts *= weights[classes[tuple(sources.T)]]
    return costs_to_go(classes, weights, sources, starts)


def opens(mask: Mask) -> Callable[[Cell], bool]:
    """Return a function of cells: whether a cell is within the mask, and set there."""
    height, width = mask.shape
    return lambda cell: 0 <= cell[0] < height and 0 <= cell[1] < width and bool(mask[cell])


def is_line_clear(is_open: Callable[[Cell], bool], *line: Place) -> bool:
    """Return whether a line through places is in open cells, never between two at one corner."""
    cells = [cell for ends in pairwise(line) for cell in _cells_on(*ends)]
    return is_open(cells[0]) and all(
        is_open(following) and (is_open((row, following[1])) or is_open((following[0], col)))
        for (row, col), following in pairwise(cells)
    )


def _cells_on(start: Place, end: Place) -> Iterator[Cell]:
    extent = (end[0] - start[0], end[1] - start[1])
    shares = {0.0, 1.0}
    for first, length in zip(start, extent, strict=True):
        if length:
            low, high = sorted((first, first + length))
            edges = range(math.ceil(low), math.floor(high) + 1)
            shares |= {(edge - first) / length for edge in edges}
    for before, after in pairwise(sorted(share for share in shares if 0 <= share <= 1)):
        middle = (before + after) / 2
        yield (math.floor(start[0] + middle * extent[0]), math.floor(start[1] + middle * extent[1]))
