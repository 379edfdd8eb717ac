"""Costs of the cheapest ways to a goal over a plane of cells: the eikonal equation.

A cell gets its cost across one of the eight triangles of its centre, that of a cell beside it and
that of a diagonal one: costs are linear between the two others, which is of first order, and a way
goes straight through a triangle. Along the eight directions of a grid the costs are exact, between
them they are too high. The centre of a triangle's diagonal touches a fourth cell, which may be
closed; so a way never passes between two closed cells that touch.

The cost of a cell is at least 1 / sqrt(2) of its weight above those that it follows from. So all
cells whose costs differ by less are final at once, in any order, and the lists of cells by costs
need no order of their own (J. Tsitsiklis, "Efficient Algorithms for Globally Optimal Trajectories",
1995).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from mapdeal.kernels.arrays import Bytes, Floats, Integers, Mask
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.paths import ROOT_OF_2
from mapdeal.kernels.polygons import Cell

_LEAST_RISE = 0.7  # of a cell's weight, below 1 / sqrt(2) by more than rounding
Place = tuple[float, float]
# Cells around a goal whose lengths are exact where a straight line leads to it: there the costs of
# the eikonal equation would be up to 4 % too high.
_EXACT_WITHIN = 10


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
