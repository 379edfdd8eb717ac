"""In which directions walls run: the Hough spectrum of a map."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.threads import in_parallel

_STEPS = (math.radians(0.5), math.radians(0.1), math.radians(0.02))
"""Of the search for the main direction, radians: each looks around what the one before found."""

_MOST_POINTS = 20_000
_SPREAD = (0.7548776662466927, 0.5698402909980532)
"""Multiples of these, less their whole part, fill a square evenly: Roberts' R2 sequence."""

_WIDTH = 2.0
"""Of the strips that are counted for the main direction, cells."""
_DISTINCT = 1.1
"""How much more than in the median direction must be found in the main one. In noise, and in
circles, it is 1.08 times as much."""

Floats = NDArray[np.floating[Any]]


def hough_spectrum(points_xy: Floats, angles: Floats, width: float) -> Floats:
    """Return how much of a map's walls runs in each of some directions.

    References
    ----------
    S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25,
    2008: the Hough spectrum, there from the Hough transform of all pixels.
    """
    points = points_xy - points_xy.mean(axis=0)
    middle = math.ceil(float(np.hypot(*points.T).max()) / width) + 1
    found = np.empty(len(angles))

    def some(first: int, end: int) -> None:
        for k in range(first, end):
            across = points[:, 1] * math.cos(angles[k]) - points[:, 0] * math.sin(angles[k])
            places = across / width + middle
            strips = places.astype(np.int64)
            share = places - strips
            counts = np.bincount(strips, 1 - share, 2 * middle + 2)
            counts += np.bincount(strips + 1, share, 2 * middle + 2)
            found[k] = counts @ counts

    in_parallel(some, len(angles))
    return found


def main_direction(occupied: NDArray[np.bool_]) -> float | None:
    """Return the direction that most walls run along, or across."""
    points = _spread_out(edge_points(occupied))
    if len(points) < 2:
        return None
    quarter = np.arange(-math.pi / 4, math.pi / 4, _STEPS[0])
    energies = _along_or_across(points, quarter)
    best = float(quarter[energies.argmax()])
    if energies.max() < _DISTINCT * np.median(energies):
        return None
    for before, step in pairwise(_STEPS):
        around: Floats = best + np.arange(-round(before / step), round(before / step) + 1) * step
        best = float(around[_along_or_across(points, around).argmax()])
    best = math.remainder(best, math.pi / 2)
    return 0.0 if abs(best) * math.hypot(*occupied.shape) / 2 <= 1 else best


def edge_points(occupied: NDArray[np.bool_]) -> Floats:
    """Return the centres, x and y in cells, of obstacle cells with a side to one that is none.

    Beyond the grid everything is as at its border.
    """
    padded = np.pad(occupied, 1, mode="edge")
    inside = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return np.argwhere(occupied & ~inside)[:, ::-1] + 0.5


def _spread_out(points: Floats) -> Floats:
    """Return some of the points, each at another place of its cell.

    Centres of cells fall onto the middles of strips in the directions of the lattice, and only
    there: these would seem to have more walls.
    """
    if len(points) > _MOST_POINTS:
        points = points[np.arange(_MOST_POINTS) * len(points) // _MOST_POINTS]
    spread: Floats = points + (np.arange(len(points))[:, None] * np.array(_SPREAD)) % 1.0 - 0.5
    return spread


def _along_or_across(points: Floats, angles: Floats) -> Floats:
    along, across = hough_spectrum(points, np.append(angles, angles + math.pi / 2), _WIDTH).reshape(
        2, -1
    )
    return along + across
