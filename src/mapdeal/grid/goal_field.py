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


def lengths_to(is_open: NDArray[np.bool_], place: Place) -> NDArray[np.float64]:
    """Return the length in cells of the shortest way from each centre to a place; inf if none."""
    weights = np.zeros(256)
    weights[1] = 1.0
    return weighted_lengths_to(is_open.view(np.uint8), weights, place)


def weighted_lengths_to(
    classes: NDArray[np.uint8], weights: NDArray[np.float64], place: Place
) -> NDArray[np.float64]:
    """Return the lowest cost from each centre to a place, at a weight for each class of cells.

    A length of one cell costs the weight; cells of weight 0 are closed.
    """
    goal = (math.floor(place[0]), math.floor(place[1]))
    is_open = opens((weights > 0)[classes])
    if not is_open(goal):
        return np.full(classes.shape, math.inf)
    reach = _EXACT_WITHIN if weights[weights > 0].min() == weights.max() else 1
    rows, cols = (range(index - reach, index + reach + 1) for index in goal)
    centres = [(row + 0.5, col + 0.5) for row in rows for col in cols if is_open((row, col))]
    visible = [centre for centre in centres if is_line_clear(is_open, centre, place)]
    sources = np.array(visible).astype(np.int64)
    starts = np.hypot(*(np.array(visible) - place).T)
    starts *= weights[classes[tuple(sources.T)]]
    return costs_to_go(classes, weights, sources, starts)


def opens(mask: NDArray[np.bool_]) -> Callable[[Cell], bool]:
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
        yield (
            math.floor(start[0] + middle * extent[0]), math.floor(start[1] + middle * extent[1])
        )  # fmt: skip
