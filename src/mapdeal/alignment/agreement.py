"""Agreement of two maps at places of one in the other."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.alignment.correlation import moved
from mapdeal.alignment.refinement import moved_back
from mapdeal.alignment.walls import WallMap
from mapdeal.records import dataclass

TOLERANCES = (0.06, 0.12, 0.25, 0.5)
"""Metres within which a wall lies on a wall, but at least a cell: maps are exact, or bent."""

_BY_CHANCE = (0.28, 0.36, 0.5, 0.66)
"""Least share of the walls that lie on walls where maps that are not the same place lie best."""

_PIECE, _OF_WALLS = 2.0, 0.015
"""Metres of wall of which it is one piece of evidence that they agree; of small maps less, as a
share of the walls of the map that has more: there are fewer places to choose from."""

_FULL_OVERLAP = 0.2
_LARGE = 0.25
"""Part of the longest walls in common, from which on a place says what is found by chance."""

Floats = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]
Poses = NDArray[np.float64]
Moves = tuple[WallMap, WallMap, Any]


@dataclass(frozen=True, eq=False)
class Agreement:
    """Agreement of two maps at K places."""

    agreeing: Floats
    contradicting: Floats
    overlap: Floats
    piece: float

    @property
    def shares(self) -> Floats:
        """The share of walls that agree, of those that agree or contradict; shape (K, T)."""
        seen = self.agreeing + self.contradicting
        shares: Floats = np.divide(self.agreeing, seen, out=np.zeros_like(seen), where=seen > 0)
        return shares

    def by_chance(self, is_wrong: Mask | None = None) -> Floats:
        """Return which share agrees where maps only happen to lie well, shape (T,)."""
        if is_wrong is None or not is_wrong.any():
            return np.array(_BY_CHANCE)
        seen = (self.agreeing + self.contradicting)[is_wrong]
        counted = np.where(seen >= _LARGE * seen.max(axis=0), seen, 0)
        total = counted.sum(axis=0)
        mean = np.divide(
            (counted * self.shares[is_wrong]).sum(axis=0), total, where=total > 0, out=total * 0
        )
        chance: Floats = np.maximum(mean, _BY_CHANCE)
        return chance

    def evidence(self, chance: Floats) -> Floats:
        """Return how much more of the walls agrees than by chance, shape (K,).

        The divergence of the share that agrees from the share by chance, times the pieces of
        wall; the mean over the tolerances. Where maps hardly overlap, it is less in proportion:
        a few walls always agree somewhere.
        """
        pieces = (self.agreeing + self.contradicting) / self.piece
        evidence: Floats = (pieces * self._divergences(chance)).mean(axis=1)
        evidence *= np.minimum(self.overlap / _FULL_OVERLAP, 1)
        return evidence

    def quality(self, chance: Floats) -> Floats:
        """Return the same for each piece of wall, shape (K,): how well what is common agrees."""
        quality: Floats = self._divergences(chance).mean(axis=1)
        return quality

    def _divergences(self, chance: Floats) -> Floats:
        """Return the divergences (Kullback and Leibler) from shares by chance, shape (K, T)."""
        return _divergence(self.shares, chance)


def agreement_at(first: WallMap, second: WallMap, poses: Poses, most: int) -> Agreement:
    """Return the agreement of two maps at some places."""
    agreeing = np.zeros((len(poses), len(TOLERANCES)))
    contradicting = np.zeros_like(agreeing)
    known = np.zeros(len(poses))
    both: tuple[Moves, Moves] = (first, second, moved), (second, first, moved_back)
    for own, other, move in both:
        faces, normals = own.some_faces(most)
        metres = own.wall_length / len(faces) / 2
        distance, is_free, _ = _looked_up(other, move(poses, faces))
        is_thin = ~normals.any(axis=1)
        for k, tolerance in enumerate(_tolerances(first, second)):
            beside = faces + normals * np.float32(tolerance + _cell(first, second))
            open_there = _looked_up(other, move(poses, beside))[1] | is_thin
            agreeing[:, k] += metres * ((distance <= tolerance) & open_there).sum(axis=1)
            contradicting[:, k] += metres * ((distance > tolerance) & is_free).sum(axis=1)
        points = _some_free(own, most)
        if len(points):
            shared = _looked_up(other, move(poses, points))[2].mean(axis=1)
            known += shared * own.free_area / 2
    longest = max(first.wall_length, second.wall_length)
    smaller = max(min(first.free_area, second.free_area), 1e-12)
    overlap = np.minimum(known / smaller, 1)
    return Agreement(agreeing, contradicting, overlap, min(_PIECE, _OF_WALLS * longest))


def _cell(first: WallMap, second: WallMap) -> float:
    return max(first.resolution, second.resolution)


def _tolerances(first: WallMap, second: WallMap) -> list[float]:
    least = 1.01 * _cell(first, second)  # a cell, and what rounding adds
    return [max(tolerance, least) for tolerance in TOLERANCES]


def _some_free(walls: WallMap, most: int) -> Floats:
    """Return the centres of some free cells, evenly chosen, metres from the corner."""
    cells = np.flatnonzero(walls.free)
    if len(cells) > most:
        cells = cells[np.arange(most) * len(cells) // most]
    row, col = np.divmod(cells, walls.frame.width)
    centres = (np.stack([col, row], axis=-1) + 0.5) * walls.resolution
    return centres.astype(np.float32)


def _looked_up(walls: WallMap, points_xy: Floats) -> tuple[Floats, Mask, Mask]:
    """Return the distance to a wall, and whether cells are free and known, at some points."""
    height, width = walls.frame.shape
    cells = np.floor(points_xy / np.float32(walls.resolution)).astype(np.int32)
    col, row = cells[..., 0], cells[..., 1]
    inside = (col >= 0) & (row >= 0) & (col < width) & (row < height)
    at = np.where(inside, row * width + col, 0)
    distance = np.where(inside, walls.distance.ravel()[at], np.inf)
    return distance, inside & walls.free.ravel()[at], inside & walls.known.ravel()[at]


def _divergence(share: Floats, chance: Floats) -> Floats:
    """Return the divergence of shares from smaller shares by chance; 0 of those that are not."""
    least, most = np.clip(share, 1e-9, 1 - 1e-9), np.clip(chance, 0.02, 0.98)
    found = least * np.log(least / most) + (1 - least) * np.log((1 - least) / (1 - most))
    return np.where(share > chance, found, 0.0)
