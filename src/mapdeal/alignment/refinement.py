"""Places of one map in another, moved to where walls lie on walls."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.alignment.correlation import moved
from mapdeal.alignment.walls import WallMap
from mapdeal.kernels.rotations import inverse_matrices

_FAR = 3.0
"""In scales: walls farther than this from any other do not pull."""

_DAMPING = 1e-3

Floats = NDArray[np.floating[Any]]
Poses = NDArray[np.float64]


def refined(
    first: WallMap, second: WallMap, poses: Poses, scales: Sequence[float], most: int
) -> Poses:
    """Return places at which the walls of both maps lie as near to each other as they can.

    Notes
    -----
    Gauss-Newton steps on the distances of the first map's walls to those of the second and the
    other way round, so that walls that only one map has pull at neither. Weights are those of
    the Geman-McClure estimator.
    """
    poses = poses.copy()
    here, there = first.some_faces(most)[0], second.some_faces(most)[0]
    for scale in scales:
        normal = np.zeros((len(poses), 3, 3))
        right = np.zeros((len(poses), 3))
        cos, sin = np.cos(poses[:, :1]), np.sin(poses[:, :1])
        points = moved(poses, here)
        distance, x, y = _slopes(second, points)
        arm = points - poses[:, None, 1:]
        _add(normal, right, (x, y, y * arm[..., 0] - x * arm[..., 1]), distance, scale)
        points = moved_back(poses, there)
        distance, x, y = _slopes(first, points)
        turn = x * points[..., 1] - y * points[..., 0]
        _add(normal, right, (y * sin - x * cos, -x * sin - y * cos, turn), distance, scale)
        diagonal = np.arange(3)
        normal[:, diagonal, diagonal] *= 1 + _DAMPING
        normal[:, diagonal, diagonal] += _DAMPING
        step = (inverse_matrices(normal) * right[:, np.newaxis]).sum(axis=-1)
        poses -= step[:, [2, 0, 1]]
    return poses


def moved_back(poses: Poses, points_xy: Floats) -> Floats:
    """Return points of the second map in the first, shape (K, N, 2)."""
    cos, sin = np.cos(poses[:, :1]), np.sin(poses[:, :1])
    x, y = points_xy[:, 0] - poses[:, 1:2], points_xy[:, 1] - poses[:, 2:3]
    result = np.empty((*x.shape, 2), dtype=points_xy.dtype)
    result[..., 0] = cos * x + sin * y
    result[..., 1] = cos * y - sin * x
    return result


def _add(
    normal: Floats,
    right: Floats,
    columns: tuple[Floats, Floats, Floats],
    distance: Floats,
    scale: float,
) -> None:
    """Add the normal equations of some distances, given their derivatives by x, y and yaw."""
    counts = distance < _FAR * scale
    distance = np.where(counts, distance, 0)
    weight = counts / (1 + (distance / scale) ** 2) ** 2
    for i, one in enumerate(columns):
        weighted = weight * one
        right[:, i] += (weighted * distance).sum(axis=1)
        for j, other in enumerate(columns[: i + 1]):
            normal[:, i, j] += (weighted * other).sum(axis=1)
            if i != j:
                normal[:, j, i] = normal[:, i, j]


def _slopes(walls: WallMap, points_xy: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the distance to a wall and its slopes along x and y, between the cells' centres.

    Outside of the map the distance is infinite.
    """
    height, width = walls.frame.shape
    places = points_xy / np.float32(walls.resolution) - np.float32(0.5)
    corner = np.floor(places)
    x, y = (places - corner)[..., 0], (places - corner)[..., 1]
    col, row = corner[..., 0].astype(np.int32), corner[..., 1].astype(np.int32)
    inside = (col >= 0) & (row >= 0) & (col < width - 1) & (row < height - 1)
    at = np.where(inside, row * width + col, 0)
    right, up = (1 if width > 1 else 0), (width if height > 1 else 0)
    values = walls.distance.ravel()
    low, lower = values[at], values[at + right]
    high, upper = values[at + up], values[at + up + right]
    south, north = low + (lower - low) * x, high + (upper - high) * x
    found = np.where(inside, south + (north - south) * y, np.inf)
    along = np.where(inside, (lower - low) * (1 - y) + (upper - high) * y, 0)
    across = np.where(inside, north - south, 0)
    return found, along / walls.resolution, across / walls.resolution
