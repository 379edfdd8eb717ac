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

    Parameters
    ----------
    points_xy : numpy.ndarray of float64, shape (N, 2)
        Points on walls, any unit; N is at least 1.
    angles : numpy.ndarray of float64, shape (K,)
        Directions of walls, radians, anticlockwise from the x axis; a direction and the
        opposite one are the same.
    width : float
        Width of the strips that are counted, in the unit of the points.

    Returns
    -------
    numpy.ndarray of float64, shape (K,)
        For each direction, the sum of the squares of how many points lie in each strip along
        it. Each point is shared out between the two strips whose middles it lies between.

    References
    ----------
    S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25,
    2008: the Hough spectrum, there from the Hough transform of all pixels.

    Examples
    --------
    >>> wall = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])
    >>> hough_spectrum(wall, np.radians([45.0, 135.0]), 2**-0.5).round(9).tolist()
    [9.0, 3.0]
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
    """Return the direction that most walls run along, or across.

    Parameters
    ----------
    occupied : numpy.ndarray of bool, shape (H, W)
        The obstacle cells; row 0 is the south.

    Returns
    -------
    float or None
        Radians, anticlockwise from the columns' axis, within -pi/4..pi/4: a map turned by minus
        this has its walls along its rows and columns. Exactly 0 if turning by it would move no
        cell by more than a cell. None if there are no walls, or no direction stands out.

    Examples
    --------
    >>> wall = np.zeros((9, 40), dtype=bool)
    >>> wall[3, 2:38] = True
    >>> main_direction(wall)
    0.0
    """
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
