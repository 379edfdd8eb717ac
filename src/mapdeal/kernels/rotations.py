"""Rotations of sets of points, and directions of walls.

Quaternions are arrays (..., 4) of x, y, z, w, as in ROS. A transform is a translation t of shape
(..., 3) and a quaternion q, and moves a point p to q p + t.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from mapdeal.kernels import distance, threads
from mapdeal.kernels.arrays import Floats, Integers, Mask

_NEARLY_EQUAL = 1.0 - 1e-9  # cosine of half an angle; above, slerp takes a straight line
_STEPS = (math.radians(0.5), math.radians(0.1), math.radians(0.02))
"""Steps of the search for the main direction, radians: each refines the previous result."""
_MOST_POINTS = 20_000
_SPREAD = (0.7548776662466927, 0.5698402909980532)  # Roberts' R2 sequence fills a square evenly
_WIDTH = 2.0  # of the strips in the Hough spectrum for the main direction, cells
_DISTINCT = 1.1  # least ratio of the best direction to the median; 1.08 in noise


def normalised(quaternions: ArrayLike) -> Floats:
    found = np.asarray(quaternions, dtype=np.float64)
    return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))


def from_yaw(yaw: ArrayLike) -> Floats:
    half = np.asarray(yaw, dtype=np.float64) / 2
    zero = np.zeros_like(half)
    return np.stack([zero, zero, np.sin(half), np.cos(half)], axis=-1)


def multiplied(first: Floats, second: Floats) -> Floats:
    ax, ay, az, aw = np.moveaxis(first, -1, 0)
    bx, by, bz, bw = np.moveaxis(second, -1, 0)
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    w = aw * bw - ax * bx - ay * by - az * bz
    return np.stack([x, y, z, w], axis=-1)


def rotated(quaternions: Floats, vectors: Floats) -> Floats:
    axis, w = quaternions[..., :3], quaternions[..., 3:]
    twice = 2 * np.cross(axis, vectors)
    return np.asarray(vectors + w * twice + np.cross(axis, twice))


def inverse_matrices(matrices: Floats) -> Floats:
    # Computed from cross products. LAPACK and BLAS reserve 32 MB per thread; if the system
    # refuses, OpenBLAS exits the process or tries again for ever.
    a, b, c = np.moveaxis(matrices, -2, 0)
    adjugate = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)
    return np.asarray(adjugate / (a * np.cross(b, c)).sum(axis=-1)[..., np.newaxis, np.newaxis])


def product(first: Floats, second: Floats) -> Floats:
    """Return the product of small matrices, without BLAS."""
    return np.asarray((first[..., np.newaxis] * second).sum(axis=-2))


def slerp(first: Floats, second: Floats, share: Floats) -> Floats:
    # From Shoemake, "Animating rotation with quaternion curves", 1985; as tf2's
    # ``Quaternion::slerp``.
    cosine = np.sum(first * second, axis=-1)
    second = np.where(cosine[..., np.newaxis] < 0, -second, second)
    cosine = np.minimum(np.abs(cosine), 1.0)
    angle = np.arccos(cosine)
    sine = np.sin(angle)
    is_line = cosine > _NEARLY_EQUAL
    safe = np.where(is_line, 1.0, sine)
    of_first = np.where(is_line, 1 - share, np.sin((1 - share) * angle) / safe)
    of_second = np.where(is_line, share, np.sin(share * angle) / safe)
    return normalised(of_first[..., np.newaxis] * first + of_second[..., np.newaxis] * second)


def composed(first: tuple[Floats, Floats], second: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    (a, p), (b, q) = first, second
    return a + rotated(p, b), multiplied(p, q)


def undone(transforms: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    move, turn = transforms
    back: Floats = turn * np.array([-1.0, -1.0, -1.0, 1.0])
    return -rotated(back, move), back


def hough_spectrum(points_xy: Floats, angles: Floats, width: float) -> Floats:
    # From S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25,
    # 2008, who compute the Hough spectrum from the Hough transform of all pixels.
    x, y = np.ascontiguousarray((points_xy - points_xy.mean(axis=0)).T / width)
    middle = math.ceil(float(np.hypot(x, y).max())) + 1
    found = np.empty(len(angles))

    def count(first: int, end: int) -> None:
        for k in range(first, end):
            places = y * math.cos(angles[k]) - x * math.sin(angles[k]) + middle
            strips = places.astype(np.int64)
            beyond = np.bincount(strips, places - strips, 2 * middle + 2)
            counts = np.bincount(strips, minlength=2 * middle + 2) - beyond
            counts[1:] += beyond[:-1]
            found[k] = counts @ counts

    threads.in_parallel(count, len(angles))
    return found


def main_direction(occupied: Mask) -> float | None:
    """Return the direction along or across which most walls run, if one prevails."""
    edges = occupied & distance.beside(~occupied)  # the border cells continue beyond the grid
    points = _spread_out(np.argwhere(edges)[:, ::-1].astype(np.float64) + 0.5)
    if len(points) < 2:
        return None
    quarter = np.arange(-math.pi / 4, math.pi / 4, _STEPS[0])
    energies = _along_or_across(points, quarter)
    best = float(quarter[energies.argmax()])
    if energies.max() < _DISTINCT * np.median(energies):
        return None
    for before, step in pairwise(_STEPS):
        reach = round(before / step)
        around = best + np.arange(-reach, reach + 1, dtype=np.float64) * step
        best = float(around[_along_or_across(points, around).argmax()])
    best = math.remainder(best, math.pi / 2)
    return 0.0 if abs(best) * math.hypot(*occupied.shape) / 2 <= 1 else best


def _spread_out(points: Floats) -> Floats:
    """Return a sample of the points, each moved within its cell."""
    # Cell centres would line up with the strips only in the directions of the lattice, which would
    # then seem to have more walls.
    if len(points) > _MOST_POINTS:
        points = points[np.arange(_MOST_POINTS) * len(points) // _MOST_POINTS]
    return np.asarray(points + (np.arange(len(points))[:, None] * np.array(_SPREAD)) % 1.0 - 0.5)


def _along_or_across(points: Floats, angles: Floats) -> Floats:
    both = np.append(angles, angles + math.pi / 2)
    along, across = hough_spectrum(points, both, _WIDTH).reshape(2, -1)
    return along + across


def _enlarged(cells: Mask, steps: int) -> Mask:
    for _ in range(steps):
        cells = cells | distance.beside(cells)
    return cells


def _placed(layer: Mask, corner: Integers, size: Integers) -> Mask:
    cells = np.zeros(size, dtype=np.bool_)
    row, col = corner.tolist()
    cells[row : row + layer.shape[0], col : col + layer.shape[1]] = layer
    return cells


def coincidences(walls: Mask, free: Mask, tolerance: int) -> list[tuple[float, float]]:
    """Return how far a map coincides with itself turned by 90, 180 and 270 degrees."""
    # Each turn is placed where the walls correlate best. The shares are of walls within a
    # tolerance, in cells, of a wall of the other, and of free cells that are free in it.
    found = []
    for turns in (1, 2, 3):
        turned_walls, turned_free = np.rot90(walls, turns), np.rot90(free, turns)
        shape = [a + b for a, b in zip(walls.shape, turned_walls.shape, strict=True)]
        near = _enlarged(walls, tolerance) + walls.astype(np.float32)
        spectra = (np.fft.rfft2(layer, shape) for layer in (near, turned_walls))
        scores = np.fft.irfft2(next(spectra) * np.conj(next(spectra)), shape)
        shift = np.array(np.unravel_index(scores.argmax(), scores.shape))
        shift -= np.where(shift >= walls.shape, shape, 0)
        corner = np.maximum(-shift, 0)  # of the map on the cells of both
        size = np.maximum(corner + walls.shape, corner + shift + turned_walls.shape)
        own, turned_own = _placed(walls, corner, size), _placed(turned_walls, corner + shift, size)
        pairs = ((own, turned_own), (turned_own, own))
        agreeing = min(float((cells & _enlarged(near, tolerance)).sum()) for cells, near in pairs)
        clear = _placed(free, corner, size) & _placed(turned_free, corner + shift, size)
        found.append((agreeing / max(walls.sum(), 1), float(clear.sum()) / max(free.sum(), 1)))
    return found
