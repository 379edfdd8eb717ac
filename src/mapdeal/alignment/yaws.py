"""Turns by which the walls of one map run as those of another."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.alignment.walls import WallMap
from mapdeal.kernels.wall_directions import hough_spectrum

_DIRECTIONS = 360
"""In half a turn: one every half degree."""

_APART = 4
"""Steps between turns that are looked at; what is nearer is refined to the same."""

_STRIP = 0.1
_MOST_FACES = 4000

Floats = NDArray[np.floating[Any]]


def yaws_by_walls(first: WallMap, second: WallMap, most: int) -> Floats:
    """Return the turns that bring the walls of one map into the directions of another's.

    Parameters
    ----------
    first, second : WallMap
        The maps.
    most : int
        How many turns; each is followed by the one that is half a turn from it, since walls
        have no beginning and no end.

    Returns
    -------
    numpy.ndarray of float64, shape (most,)
        Radians, that which fits best first.

    References
    ----------
    S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25,
    2008: turns are the peaks of the circular correlation of two Hough spectra.
    """
    width = max(_STRIP, first.resolution, second.resolution)
    here, there = (np.fft.rfft(_spectrum(walls, width)) for walls in (first, second))
    correlation = np.fft.irfft(np.conj(here) * there, _DIRECTIONS)
    peaks: list[int] = []
    for step in np.argsort(-correlation, kind="stable").tolist():
        apart = ((step - peak) % _DIRECTIONS for peak in peaks)
        if all(_APART < steps < _DIRECTIONS - _APART for steps in apart):
            peaks.append(step)
        if 2 * len(peaks) >= most:
            break
    turns = np.array([_between(correlation, peak) for peak in peaks]) * math.pi / _DIRECTIONS
    both: Floats = np.stack([turns, turns + math.pi], axis=-1).ravel()
    return both[:most]


def _spectrum(walls: WallMap, width: float) -> Floats:
    """Return how much more runs in each direction than in the median one."""
    angles = np.arange(_DIRECTIONS) * (math.pi / _DIRECTIONS)
    faces = walls.some_faces(_MOST_FACES)[0].astype(np.float64)
    found = hough_spectrum(faces, angles, width)
    above = np.maximum(found - np.median(found), 0)
    centred: Floats = above - above.mean()
    return centred


def _between(values: Floats, peak: int) -> float:
    """Return where the parabola through a peak and the values beside it is highest."""
    before, at, after = (values[(peak + step) % len(values)] for step in (-1, 0, 1))
    bend = before - 2 * at + after
    return peak + float((before - after) / (2 * bend) if bend < 0 else 0)
