"""Round shapes of cells: discs, and lines with a thickness."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.spans import Spans

_TOLERANCE = 1e-9
"""In cells: centres exactly on the rim belong to the shape, whatever rounding says."""

_LEVEL = 1e-12
"""In cells: a side that rises less lies within a single row's centre line."""

Position = tuple[float, float]


def capsule_spans(
    start: Position, stop: Position, radius: float, shape: tuple[int, int]
) -> Spans:  # fmt: skip
    """Return the cells whose centre lies within a distance of the segment between two points."""
    reach = radius + _TOLERANCE
    bottom = math.ceil(max(min(start[0], stop[0]) - reach - 0.5, 0))
    top = math.floor(min(max(start[0], stop[0]) + reach - 0.5, shape[0] - 1))
    rows = np.arange(bottom, top + 1, dtype=np.int64)
    if rows.size == 0:
        return Spans(rows, rows, rows)
    y: NDArray[np.float64] = rows.astype(np.float64) + 0.5
    # The shape is convex, so that it meets each row in one run: from the leftmost to the
    # rightmost of its parts.
    ends = [_disc(start, reach, y), _disc(stop, reach, y), *_rim(start, stop, reach, y)]
    left = np.min([end[0] for end in ends], axis=0)
    right = np.max([end[1] for end in ends], axis=0)
    first = np.ceil(np.clip(left - 0.5, -1, shape[1] + 1))
    last = np.floor(np.clip(right - 0.5, -1, shape[1] + 1))
    return Spans(rows, first.astype(np.int64), last.astype(np.int64) + 1).clipped(shape[1])


_Ends = tuple[NDArray[np.float64], NDArray[np.float64]]


def _disc(centre: Position, radius: float, y: NDArray[np.float64]) -> _Ends:
    """Return where a disc begins and ends in each row; inf, -inf where it has no part."""
    squared = radius**2 - (y - centre[0]) ** 2
    half = np.sqrt(np.maximum(squared, 0.0))
    within = squared >= 0
    return (
        np.where(within, centre[1] - half, np.inf),
        np.where(within, centre[1] + half, -np.inf),
    )


def _rim(start: Position, stop: Position, radius: float, y: NDArray[np.float64]) -> list[_Ends]:
    """Return the same of the two long sides of the rectangle around the segment."""
    (y0, x0), (y1, x1) = start, stop
    length = math.hypot(y1 - y0, x1 - x0)
    if length == 0.0:
        return []
    across_y, across_x = radius * (x1 - x0) / length, -radius * (y1 - y0) / length
    sides = []
    for sign in (-1, 1):
        a_y, a_x = y0 + sign * across_y, x0 + sign * across_x
        b_y, b_x = y1 + sign * across_y, x1 + sign * across_x
        if abs(b_y - a_y) < _LEVEL:
            continue  # along a row: the discs at its ends reach as far
        share = (y - a_y) / (b_y - a_y)
        x = a_x + share * (b_x - a_x)
        within = (share >= 0) & (share <= 1)
        sides.append((np.where(within, x, np.inf), np.where(within, x, -np.inf)))
    return sides
