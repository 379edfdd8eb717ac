"""Beams in the plane, of sensors that stand anyhow in space."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.rotations import rotated
from mapdeal.records import dataclass

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_LEVEL = 1e-6
"""Radians: of 30 m, 30 micrometres."""

MOST_LEANING = math.radians(10)
"""From here on what a beam hits says too little of what stands at the height of a robot."""


@dataclass(frozen=True, eq=False)
class Stances:
    """Poses and orientations of sensors."""

    poses: Floats
    is_flipped: Flags
    is_level: Flags
    leans: Flags


def stances(translations: Floats, quaternions: Floats) -> Stances:
    """Return the stances of sensors, given their poses in space."""
    ahead = rotated(quaternions, np.array([1.0, 0.0, 0.0]))
    up = rotated(quaternions, np.array([0.0, 0.0, 1.0]))
    aside = np.hypot(up[:, 0], up[:, 1])
    yaws = np.arctan2(ahead[:, 1], ahead[:, 0])
    poses = np.column_stack([translations[:, :2], yaws])
    return Stances(poses, up[:, 2] < 0, aside < _LEVEL, aside > math.sin(MOST_LEANING))


def beams_in_plane(quaternions: Floats, angles: Floats) -> tuple[Floats, Floats]:
    """Return where beams go in the plane, and which part of their length lies in it."""
    beams = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)
    turned = rotated(quaternions, beams)
    shares = np.minimum(np.hypot(turned[:, 0], turned[:, 1]), 1.0)
    return np.arctan2(turned[:, 1], turned[:, 0]), shares
