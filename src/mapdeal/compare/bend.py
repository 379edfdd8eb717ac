"""How far a map is bent against another one: a smooth displacement beside a rigid transform.

Sensor maps drift. Where they are of one place, a slight bend brings nearly all of their walls
together; where they are not, it does not help.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from mapdeal.compare.walls import FAR, Floats, Poses, WallMap, moved, moved_back, slopes

_DEGREE = 3
_POWERS = tuple(p for p in product(range(_DEGREE + 1), repeat=2) if sum(p) <= _DEGREE)
"""Exponents of x and y: the displacement is a polynomial of the place, one for x, one for y."""

_STIFF = 0.005
"""Standard deviation of each coefficient before anything is known, as a share of the diagonal."""

_TURNS_BACK = 2  # steps of the fixed point that undoes a bend: one has hardly any slope


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
    def expected(self) -> float:
        """The standard deviation of a coefficient, metres."""
        return 2 * _STIFF * self.reach

    @property
    def costs(self) -> Floats:
        """How unlikely bends are, as the logarithm of how much less likely than none."""
        costs: Floats = (self.coefficients**2).sum(axis=(1, 2)) / (2 * self.expected**2)
        return costs

    def repeated(self, times: int) -> Bend:
        return Bend(self.middle_xy, self.reach, np.repeat(self.coefficients, times, axis=0))

    def terms(self, points_xy: Floats) -> Floats:
        """Return the terms of the polynomial at points, shape (..., N, M)."""
        # beyond the map, where nothing is known of it, the bend goes on as at its border
        kind = points_xy.dtype.type
        place = (points_xy - self.middle_xy.astype(kind)) / kind(self.reach)
        np.clip(place, -1, 1, out=place)
        powers = [np.ones_like(place), place]
        while len(powers) <= _DEGREE:
            powers.append(powers[-1] * place)
        # one array for each term, of which einsum is many times as fast
        found = np.empty((len(_POWERS), *place.shape[:-1]), dtype=kind)
        for one, (i, j) in zip(found, _POWERS, strict=True):
            np.multiply(powers[i][..., 0], powers[j][..., 1], out=one)
        return np.moveaxis(found, 0, -1)

    def at(self, terms: Floats) -> Floats:
        how = "nm,kcm->knc" if terms.ndim == 2 else "knm,kcm->knc"
        found: Floats = np.einsum(how, terms, self.coefficients.astype(terms.dtype))
        return found

    def moved(self, poses: Poses, points_xy: Floats) -> Floats:
        if not self.coefficients.any():
            return moved(poses, points_xy)
        return moved(poses, points_xy) + self.at(self.terms(points_xy))

    def moved_back(self, poses: Poses, points_xy: Floats) -> Floats:
        own = moved_back(poses, points_xy)
        if not self.coefficients.any():
            return own
        kind = points_xy.dtype.type
        cos, sin = np.cos(poses[:, :1]).astype(kind), np.sin(poses[:, :1]).astype(kind)
        found = own
        for _ in range(_TURNS_BACK):
            x, y = np.moveaxis(self.at(self.terms(found)), -1, 0)
            found = own - np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)
        return found


def fitted(
    first: WallMap,
    second: WallMap,
    poses: Poses,
    *,
    scales: Sequence[float],
    piece: float,
    most: int,
) -> Bend:  # fmt: skip
    """Return the likeliest bends at some places: walls that are apart pull, stiffness holds."""
    # Gauss-Newton steps with the weights of Geman and McClure, as for the places themselves; a
    # piece of wall, metres, is one observation of a distance that is normal with each scale.
    bend = Bend.none(first, len(poses))
    here, there = first.some_faces(most)[0], second.some_faces(most)[0]
    of_here, of_there = (
        walls.wall_length / len(faces) / piece / 2
        for walls, faces in ((first, here), (second, there))
    )
    cos, sin = np.cos(poses[:, :1]), np.sin(poses[:, :1])
    terms = bend.terms(here)
    for scale in scales:
        distance, x, y = slopes(second, bend.moved(poses, here))
        normal, right = _equations(terms, (x, y), distance, scale, of_here)
        points = bend.moved_back(poses, there)
        distance, x, y = slopes(first, points)
        back = (sin * y - cos * x, -sin * x - cos * y)
        more = _equations(bend.terms(points), back, distance, scale, of_there)
        bend = _stepped(bend, normal + more[0], right + more[1])
    return bend


def _equations(
    terms: Floats, by_shift: Sequence[Floats], distance: Floats, scale: float, share: float
) -> tuple[Floats, Floats]:
    """Return the normal equations of distances, shape (K, N), given their slopes along x and y."""
    counts = distance < FAR * scale
    distance = (distance * counts).astype(np.float64)
    weight = counts / (1 + (distance / scale) ** 2) ** 2 * (share / scale**2)
    terms = np.broadcast_to(terms, (len(distance), *terms.shape[-2:]))
    count, unknowns = len(distance), terms.shape[-1]
    normal = np.empty((count, 2, unknowns, 2, unknowns))
    right = np.empty((count, 2, unknowns))
    for i, one in enumerate(by_shift):
        weighted = (weight * one)[..., None] * terms
        right[:, i] = np.einsum("knm,kn->km", weighted, distance)
        for j, other in enumerate(by_shift[: i + 1]):
            found = np.einsum("knm,knl->kml", weighted * other[..., None], terms)
            normal[:, i, :, j] = found
            normal[:, j, :, i] = found.transpose(0, 2, 1)
    return normal.reshape(count, 2 * unknowns, -1), right.reshape(count, -1)


def _stepped(bend: Bend, normal: Floats, right: Floats) -> Bend:
    stiff = 1 / bend.expected**2
    flat = bend.coefficients.reshape(len(right), -1)
    diagonal = np.arange(flat.shape[1])
    normal[:, diagonal, diagonal] += stiff
    step = _solved(normal, right + stiff * flat)
    return Bend(bend.middle_xy, bend.reach, (flat - step).reshape(bend.coefficients.shape))


def _solved(matrices: Floats, right: Floats) -> Floats:
    """Solve positive definite systems, shape (K, M, M), without LAPACK (see `inverse_matrices`)."""
    rows = np.concatenate([matrices, right[..., None]], axis=-1)
    for k in range(rows.shape[1]):
        rows[:, k] /= rows[:, k, k, None]
        others = rows[:, :, k].copy()
        others[:, k] = 0
        rows -= others[..., None] * rows[:, k, None]
    return rows[..., -1]
