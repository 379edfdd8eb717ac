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

_PEAKS, _DOUBTFUL = 3, 2
"""Peaks of the correlation that are looked at, and how many of them beside the peak, too."""

_BESIDE = math.radians(1.2)
"""Where maps have little in common, their peak may be so far from the turn that brings that
together; and what lies a degree off is not found."""

_STRIP = 0.1
_MOST_FACES = 4000

Floats = NDArray[np.floating[Any]]


def yaws_by_walls(first: WallMap, second: WallMap) -> Floats:
    """Return the turns that bring the walls of one map into the directions of another's.

    References
    ----------
    S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25,
    2008: turns are the peaks of the circular correlation of two Hough spectra.
    """
    width = max(_STRIP, first.resolution, second.resolution)
    here, there = (np.fft.rfft(_spectrum(walls, width)) for walls in (first, second))
    correlation = np.fft.irfft(np.conj(here) * there, _DIRECTIONS)
    before, after = np.roll(correlation, 1), np.roll(correlation, -1)
    smooth = (before + 2 * correlation + after) / 4
    is_peak = (smooth >= np.roll(smooth, 1)) & (smooth > np.roll(smooth, -1))
    peaks = np.flatnonzero(is_peak)
    peaks = peaks[np.argsort(-smooth[peaks], kind="stable")][:_PEAKS]
    turns = np.array([_between(smooth, int(peak)) for peak in peaks]) * math.pi / _DIRECTIONS
    doubtful = turns[:_DOUBTFUL]
    turns = np.concatenate([turns, doubtful - _BESIDE, doubtful + _BESIDE])
    both: Floats = np.stack([turns, turns + math.pi], axis=-1).ravel()
    return both


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
