"""The points of a cloud into the cells of a window, in one pass."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name

Floats = NDArray[np.float64]

_TURN = 2 * math.pi


class CloudRule(NamedTuple):
    """How points become cells: numbers in the order in which the compiled code takes them.

    Parameters
    ----------
    x, y : float
        The robot in the map frame, metres.
    cos, sin : float
        Of its yaw; of minus its yaw if points come in the map frame.
    offset_x, offset_y : float
        What is subtracted from points in the map frame, metres.
    least_height, most_height, least_range, most_range : float
        Limits, metres; infinite for none.
    corner_x, corner_y : float
        The corner of the window at its first cell.
    frame_cos, frame_sin : float
        Of minus the window's yaw.
    resolution : float
        Metres a cell.
    farthest : float
        Coordinates in the map frame beyond it are outside of any window.
    rounding, tolerance : float
        Cells that a place may be off by rounding: a share of its largest coordinate, at least the
        second one.
    """

    x: float
    y: float
    cos: float
    sin: float
    offset_x: float
    offset_y: float
    least_height: float
    most_height: float
    least_range: float
    most_range: float
    corner_x: float
    corner_y: float
    frame_cos: float
    frame_sin: float
    resolution: float
    farthest: float
    rounding: float
    tolerance: float


def marks_clouds() -> bool:
    """Return whether `mark_cloud` is there: without a compiler it is not."""
    return engine_name() == "compiled"


def mark_cloud(
    points: Floats, rule: CloudRule, hit: NDArray[np.bool_], *, is_placed: bool
) -> tuple[NDArray[np.int64], Floats]:
    """Mark, in place, the cells with a point.

    Parameters
    ----------
    points : numpy.ndarray of float64, shape (N, 2 or more)
        x, y and z, metres.
    rule : CloudRule
        Which count, and where they lie.
    hit : numpy.ndarray of bool, shape (H, W)
        Row 0 in the south.
    is_placed : bool
        Whether points come in the map frame, not in the robot's.

    Returns
    -------
    counts : numpy.ndarray of int64, shape (6,)
        All points, and what became of them: not finite, beyond heights, beyond ranges, outside,
        marking.
    seen : numpy.ndarray of float64, shape (M, 2)
        The points within the limits that lie in some direction from the robot, in its frame.
    """
    from mapdeal.kernels import _clouds

    counts = np.zeros(6, dtype=np.int64)
    counts[0] = len(points)
    if not len(points):
        return counts, np.empty((0, 2))
    seen = np.empty((len(points), 2))
    bytes_ = hit.view(np.uint8)
    found = _clouds.mark(np.ascontiguousarray(points), rule, is_placed, bytes_, seen, counts)
    return counts, seen[:found]


def cover_angles(angles: Floats, first: Floats, last: Floats) -> None:
    """Put angles into equal bins of a turn, from -pi, each of which keeps its first and last one.

    Parameters
    ----------
    angles : numpy.ndarray of float64, shape (N,)
        Radians, finite.
    first, last : numpy.ndarray of float64, shape (B,)
        The least and the largest angle of each bin, -pi < angle <= pi; changed in place.
    """
    if engine_name() == "compiled":
        from mapdeal.kernels import _clouds

        _clouds.cover(np.ascontiguousarray(angles), _TURN, math.pi, first, last)
        return
    angles = angles - _TURN * np.ceil((angles - math.pi) / _TURN)
    angles = np.minimum(angles, math.pi)  # rounding may have passed it
    bins = ((angles + math.pi) * (len(first) / _TURN)).astype(np.int64)
    np.clip(bins, 0, len(first) - 1, out=bins)
    np.minimum.at(first, bins, angles)
    np.maximum.at(last, bins, angles)
