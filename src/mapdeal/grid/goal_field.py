"""Lengths of the shortest ways around closed cells to a goal, and the lines within open cells."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.eikonal import costs_to_go
from mapdeal.kernels.polygons import Cell

Place = tuple[float, float]

_EXACT_WITHIN = 10
"""Cells around a goal whose lengths are exact where a straight line leads to it: there the costs of
the eikonal equation would be up to 4 % too high."""

SEEN_WITHIN = math.hypot(_EXACT_WITHIN + 1, _EXACT_WITHIN + 1)
"""Cells from a goal beyond which no length is that of a straight line alone."""


def lengths_to(is_open: NDArray[np.bool_], place: Place) -> NDArray[np.float64]:
    """Return the length in cells of the shortest way from each centre to a place; inf if none."""
    weights = np.zeros(256)
    weights[1] = 1.0
    return weighted_lengths_to(is_open.view(np.uint8), weights, place)


def weighted_lengths_to(
    classes: NDArray[np.uint8], weights: NDArray[np.float64], place: Place
) -> NDArray[np.float64]:
    """Return the lowest cost from each centre to a place, where a cell's length costs a weight.

    Cells are closed if the weight of their class is 0.
    """
    height, width = classes.shape
    goal = (math.floor(place[0]), math.floor(place[1]))

    def is_open(cell: Cell) -> bool:
        is_inside = 0 <= cell[0] < height and 0 <= cell[1] < width
        return is_inside and bool(weights[classes[cell]] > 0)

    if not is_open(goal):
        return np.full(classes.shape, math.inf)
    least, most = weights[weights > 0].min(), weights.max()
    reach = _EXACT_WITHIN if least == most else 1
    rows, cols = (range(index - reach, index + reach + 1) for index in goal)
    centres = [(row + 0.5, col + 0.5) for row in rows for col in cols if is_open((row, col))]
    visible = [centre for centre in centres if is_line_clear(is_open, centre, place)]
    sources = np.array(visible).astype(np.int64)
    starts = np.hypot(*(np.array(visible) - place).T)
    starts *= weights[classes[sources[:, 0], sources[:, 1]]]
    return costs_to_go(classes, weights, sources, starts)


def is_line_clear(is_open: Callable[[Cell], bool], start: Place, end: Place) -> bool:
    """Return whether a straight line is in open cells, never between two closed at a corner."""
    cells = list(_cells_on(start, end))
    return is_open(cells[0]) and all(
        may_step(is_open, cell, following) for cell, following in pairwise(cells)
    )


def may_step(is_open: Callable[[Cell], bool], cell: Cell, following: Cell) -> bool:
    """Return whether a neighbour is open, and not diagonally between two closed cells."""
    beside = ((cell[0], following[1]), (following[0], cell[1]))
    return is_open(following) and any(map(is_open, beside))


def _cells_on(start: Place, end: Place) -> Iterator[Cell]:
    """Yield the cells that a straight piece of way passes, one after the other."""
    extent = (end[0] - start[0], end[1] - start[1])
    shares = {0.0, 1.0}
    for from_, along in zip(start, extent, strict=True):
        if along:
            low, high = sorted((from_, from_ + along))
            shares |= {
                (edge - from_) / along for edge in range(math.ceil(low), math.floor(high) + 1)
            }
    last = None
    for before, after in pairwise(sorted(share for share in shares if 0 <= share <= 1)):
        middle = (before + after) / 2
        cell = (
            math.floor(start[0] + middle * extent[0]),
            math.floor(start[1] + middle * extent[1]),
        )
        if cell != last:
            yield cell
        last = cell
