"""Where a robot stands and looks, and the angles that it sees."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError, emit_warning
from mapdeal.grid.coordinates import FARTHEST
from mapdeal.kernels.clouds import cover_angles

Pose = tuple[float, float, float]

_TURN = 2 * math.pi
_BINS = 1 << 14


def wrapped(angle: float) -> float:
    """Return an angle as one of -pi < angle <= pi."""
    inside = math.remainder(angle, _TURN)
    return math.pi if inside <= -math.pi else inside


def check_pose(pose: Sequence[float], name: str = "pose") -> Pose:
    """Return a pose as x, y (metres) and a yaw of -pi < yaw <= pi; errors call it `name`."""
    try:
        x, y, yaw = (float(value) for value in pose)
    except (TypeError, ValueError):
        rule = "must be three numbers x, y, yaw"
        raise ParameterError(rule, place=name, got=pose) from None
    if not (abs(x) <= FARTHEST and abs(y) <= FARTHEST and abs(yaw) <= FARTHEST):  # nan too
        rule = f"must be three numbers x, y, yaw within {FARTHEST:g}"
        raise ParameterError(rule, place=name, got=(x, y, yaw))
    if abs(yaw) > _TURN:
        text = f"{name}: a yaw of {yaw:.6g} rad is more than a turn; is it in degrees?"
        emit_warning(text, stacklevel=2)
    return x, y, wrapped(yaw)


class CoveredAngles:
    """The smallest arc that holds all of many angles: it leaves out the largest gap.

    Kept are the first and the last angle of each of 16,384 bins, so that memory is bounded
    whatever is added. The arc is exact as soon as the gap is longer than a bin, 0.0004 rad.
    """

    def __init__(self) -> None:
        self._first = np.full(_BINS, np.inf)
        self._last = np.full(_BINS, -np.inf)

    def add(self, angles: NDArray[np.float64]) -> None:
        """Add angles, radians, each at most some turns from 0."""
        cover_angles(angles, self._first, self._last)

    def arc(self) -> tuple[float, float] | None:
        """Return the arc's ends, -pi < first <= pi and first <= last < first + 2 pi.

        None if nothing was added.
        """
        used = self._last >= self._first
        first, last = self._first[used], self._last[used]
        if not len(first):
            return None
        # The gap before each bin; of equal ones that across pi comes first.
        gaps = first - np.roll(last, 1)
        gaps[0] += _TURN
        start = int(np.argmax(gaps))
        end = float(last[start - 1]) + (_TURN if start else 0.0)
        return float(first[start]), end
