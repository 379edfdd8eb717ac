"""Bend of a map against another: a smooth displacement in addition to a rigid transform.

Sensor maps drift. If two maps show the same place, a slight bend makes nearly all walls coincide;
if not, it hardly helps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import numpy as np

from mapdeal.compare.walls import FAR, Floats, Poses, WallMap, moved, moved_back, slopes
from mapdeal.records import dataclass, replace

_DEGREE = 3
_POWERS = tuple(p for p in product(range(_DEGREE + 1), repeat=2) if sum(p) <= _DEGREE)
"""Exponents of x and y: both coordinates of the displacement are polynomials of the place."""
_STIFFNESS = 0.005  # prior standard deviation of a coefficient, as a share of the diagonal
_INVERSE_STEPS = 2  # fixed-point steps that invert a bend: enough, since its slope is small


@dataclass(frozen=True, eq=False)
class Bend:
    """Displacements of a first map's points at K places, metres along the second map's axes."""

    middle_xy: Floats
    reach: float
    coefficients: Floats  # shape (K, 2, M)

    @classmethod
    def none(cls, first: WallMap, count: int) -> Bend:
        reach = max(math.hypot(*first.frame.size_xy) / 2, first.resolution)
        return cls(first.middle_xy, reach, np.zeros((count, 2, len(_POWERS))))

    @property
    def deviation(self) -> float:
        return 2 * _STIFFNESS * self.reach

    @property
    def costs(self) -> Floats:
        """The negative logarithm of the likelihood of each bend, relative to no bend."""
        return np.asarray((self.coefficients**2).sum(axis=(1, 2)) / (2 * self.deviation**2))

    def terms(self, points_xy: Floats) -> Floats:
        """Return the terms of the polynomial at points, shape (..., N, M)."""
        # outside the map, the bend is that of the nearest border
        kind = points_xy.dtype.type
        place = (points_xy - self.middle_xy.astype(kind)) / kind(self.reach)
        np.clip(place, -1, 1, out=place)
        powers = [np.ones_like(place), place]
        while len(powers) <= _DEGREE:
            powers.append(powers[-1] * place)
        # each term is contiguous, which makes einsum many times as fast
        terms = np.empty((len(_POWERS), *place.shape[:-1]), dtype=kind)
        for term, (i, j) in zip(terms, _POWERS, strict=True):
            np.multiply(powers[i][..., 0], powers[j][..., 1], out=term)
        return np.moveaxis(terms, 0, -1)

    def at(self, terms: Floats) -> Floats:
        axes = "nm,kcm->knc" if terms.ndim == 2 else "knm,kcm->knc"
        return np.asarray(np.einsum(axes, terms, self.coefficients.astype(terms.dtype)))

    def moved(self, poses: Poses, points_xy: Floats) -> Floats:
        if not self.coefficients.any():
            return moved(poses, points_xy)
        return moved(poses, points_xy) + self.at(self.terms(points_xy))

    def moved_back(self, poses: Poses, points_xy: Floats) -> Floats:
        rigid = moved_back(poses, points_xy)
        if not self.coefficients.any():
            return rigid
        kind = points_xy.dtype.type
        cos, sin = np.cos(poses[:, :1]).astype(kind), np.sin(poses[:, :1]).astype(kind)
        points = rigid
        for _ in range(_INVERSE_STEPS):
            x, y = np.moveaxis(self.at(self.terms(points)), -1, 0)
            points = rigid - np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)
        return points


def fitted(
    first: WallMap, second: WallMap, poses: Poses, *, scales: Sequence[float], piece: float,
    most: int,
) -> Bend:  # fmt: skip
    """Return the likeliest bends at some poses, given distances of walls and the stiffness."""
    # Gauss-Newton steps with Geman-McClure weights, as for the poses. Each `piece` of wall, metres,
    # is one observation of a distance that is normally distributed with the scale.
    bend = Bend.none(first, len(poses))
    first_faces, second_faces = first.some_faces(most)[0], second.some_faces(most)[0]
    first_share = first.wall_length / len(first_faces) / piece / 2  # observations per face
    second_share = second.wall_length / len(second_faces) / piece / 2
    cos, sin = np.cos(poses[:, :1]), np.sin(poses[:, :1])
    terms = bend.terms(first_faces)
    stiffness = 1 / bend.deviation**2
    for scale in scales:
        distance, x, y = slopes(second, bend.moved(poses, first_faces))
        normal, right = _equations(terms, (x, y), distance, scale, first_share)
        points = bend.moved_back(poses, second_faces)
        distance, x, y = slopes(first, points)
        turned_back = (sin * y - cos * x, -sin * x - cos * y)
        reverse = _equations(bend.terms(points), turned_back, distance, scale, second_share)
        flat = bend.coefficients.reshape(len(poses), -1)
        normal = normal + reverse[0] + stiffness * np.eye(flat.shape[1])
        flat = flat - _solved(normal, right + reverse[1] + stiffness * flat)
        bend = replace(bend, coefficients=flat.reshape(bend.coefficients.shape))
    return bend


def _equations(
    terms: Floats, slopes_xy: Sequence[Floats], distance: Floats, scale: float, share: float
) -> tuple[Floats, Floats]:
    """Return the normal equations of distances, shape (K, N), with their slopes along x and y."""
    counts = distance < FAR * scale
    distance = (distance * counts).astype(np.float64)
    weight = counts / (1 + (distance / scale) ** 2) ** 2 * (share / scale**2)
    terms = np.broadcast_to(terms, (len(distance), *terms.shape[-2:]))
    count, unknowns = len(distance), terms.shape[-1]
    normal, right = np.empty((count, 2, unknowns, 2, unknowns)), np.empty((count, 2, unknowns))
    for i, slope in enumerate(slopes_xy):
        weighted = (weight * slope)[..., None] * terms
        right[:, i] = np.einsum("knm,kn->km", weighted, distance)
        for j, earlier in enumerate(slopes_xy[: i + 1]):
            block = np.einsum("knm,knl->kml", weighted * earlier[..., None], terms)
            normal[:, i, :, j], normal[:, j, :, i] = block, block.transpose(0, 2, 1)
    return normal.reshape(count, 2 * unknowns, -1), right.reshape(count, -1)


def _solved(matrices: Floats, right: Floats) -> Floats:
    """Solve positive definite systems, shape (K, M, M), without LAPACK (see `inverse_matrices`)."""
    rows = np.concatenate([matrices, right[..., None]], axis=-1)
    for k in range(rows.shape[1]):
        rows[:, k] /= rows[:, k, k, None]
        factors = rows[:, :, k].copy()
        factors[:, k] = 0
        rows -= factors[..., None] * rows[:, k, None]
    return rows[..., -1]
