"""Rotations and rigid transforms in space, many at a time.

Quaternions are arrays (..., 4) of x, y, z, w, as ROS has them; a transform is a translation
(..., 3) and a quaternion, and takes a point p to q p + t.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

_NEARLY_EQUAL = 1.0 - 1e-9
"""The cosine of half an angle from which on a straight line serves as well as an arc."""


def normalised(quaternions: ArrayLike) -> Floats:
    """Return quaternions of length 1."""
    found = np.asarray(quaternions, dtype=np.float64)
    return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))


def from_yaw(yaw: ArrayLike) -> Floats:
    """Return rotations around z, radians."""
    half = np.asarray(yaw, dtype=np.float64) / 2
    zero = np.zeros_like(half)
    return np.stack([zero, zero, np.sin(half), np.cos(half)], axis=-1)


def multiplied(first: Floats, second: Floats) -> Floats:
    """Return the rotations that turn by `second`, and then by `first`."""
    ax, ay, az, aw = np.moveaxis(first, -1, 0)
    bx, by, bz, bw = np.moveaxis(second, -1, 0)
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=-1,
    )


def inverted(quaternions: Floats) -> Floats:
    """Return the rotations back."""
    return np.asarray(quaternions * np.array([-1.0, -1.0, -1.0, 1.0]))


def rotated(quaternions: Floats, vectors: Floats) -> Floats:
    """Return vectors, shape (..., 3), turned by rotations."""
    axis, w = quaternions[..., :3], quaternions[..., 3:]
    twice = 2 * np.cross(axis, vectors)
    return np.asarray(vectors + w * twice + np.cross(axis, twice))


def inverse_matrices(matrices: Floats) -> Floats:
    """Return the inverses of matrices, shape (..., 3, 3).

    Computed from cross products. LAPACK and BLAS reserve 32 MB per thread; if the system refuses,
    OpenBLAS exits the process or tries again for ever.
    """
    a, b, c = np.moveaxis(matrices, -2, 0)
    adjugate = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)
    return np.asarray(adjugate / (a * np.cross(b, c)).sum(axis=-1)[..., np.newaxis, np.newaxis])


def slerp(first: Floats, second: Floats, share: Floats) -> Floats:
    """Return rotations on the shorter arc between two, at a share of it from 0 to 1.

    References
    ----------
    Shoemake, "Animating rotation with quaternion curves", 1985; as tf2's ``Quaternion::slerp``.
    """
    cosine = np.sum(first * second, axis=-1)
    second = np.where(cosine[..., np.newaxis] < 0, -second, second)
    cosine = np.minimum(np.abs(cosine), 1.0)
    angle = np.arccos(cosine)
    sine = np.sin(angle)
    is_line = cosine > _NEARLY_EQUAL
    safe = np.where(is_line, 1.0, sine)
    of_first = np.where(is_line, 1 - share, np.sin((1 - share) * angle) / safe)
    of_second = np.where(is_line, share, np.sin(share * angle) / safe)
    mixed = of_first[..., np.newaxis] * first + of_second[..., np.newaxis] * second
    return normalised(mixed)


def composed(first: tuple[Floats, Floats], second: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """Return the transforms that do `second`, and then `first`: translations and quaternions."""
    (a, p), (b, q) = first, second
    return a + rotated(p, b), multiplied(p, q)


def undone(transforms: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """Return the transforms back."""
    move, turn = transforms
    back = inverted(turn)
    return -rotated(back, move), back
