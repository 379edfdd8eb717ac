"""Where a map lies in the frame of another one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.compare.correlation import (
    MOST_CELLS_A_SIDE,
    Near,
    WallMap,
    moved,
    moved_back,
    places_of,
    refined,
    walls_of,
    yaws_by_walls,
)
from mapdeal.errors import ParameterError
from mapdeal.grid.display import OneLine
from mapdeal.grid.frame import FARTHEST, Transform
from mapdeal.grid.occupancy import OccupancyGrid

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
        """Return how much more of the walls agrees than by chance, shape (K,)."""
        # The divergence of the share that agrees from the share by chance, times the pieces of
        # wall; the mean over the tolerances. Where maps hardly overlap, it is less in proportion: a
        # few walls always agree somewhere.
        pieces = (self.agreeing + self.contradicting) / self.piece
        evidence: Floats = (pieces * _divergence(self.shares, chance)).mean(axis=1)
        evidence *= np.minimum(self.overlap / _FULL_OVERLAP, 1)
        return evidence

    def quality(self, chance: Floats) -> Floats:
        """Return the same for each piece of wall, shape (K,): how well what is common agrees."""
        quality: Floats = _divergence(self.shares, chance).mean(axis=1)
        return quality


def agreement_at(first: WallMap, second: WallMap, poses: Poses, most: int) -> Agreement:
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


_PER_CELL = 6
"""Bytes for each cell of a map while it is put on the cells that are looked at, one at a time."""

_PER_LOOKED_AT, _LOOKED_AT = 40, 2 * MOST_CELLS_A_SIDE**2
"""Bytes for each of those cells, and how many there are at most of both maps."""


def bytes_to_align(cells: Sequence[int]) -> int:
    """Return the bytes that aligning two maps takes, besides the maps."""
    return _PER_CELL * max(cells) + _PER_LOOKED_AT * min(sum(cells), _LOOKED_AT)


LEAST_SCORE, LEAST_LEAD = 3.0, 2.0
"""A score, and what it has more than the runner-up. Of some 300 pairs of maps of different places
the largest lead was 2.8, of maps without free space, else 1.9."""

LEAST_OVERLAP = 0.1
MOST_RUNNER_UP = 0.75
"""Of the score: a place that fits nearly as well may be the right one."""

_AS_GOOD, _MOST_AS_GOOD = 0.9, 0.35
"""A place where what is common agrees so well, relative to the best, may be the right one with
less of a score: the maps have less in common there, and need not have more."""

_SHOWN = TOLERANCES.index(0.25)

_PRIOR_TURN = math.radians(30)
_PRIOR_SHIFT = 5.0
_ROTATION_OFF = math.radians(3)
"""Tolerance of a given rotation: maps are rarely turned exactly."""

_ALL_AROUND = 100
"""Turns that are looked at on coarse cells, whatever the directions of the walls."""

_COARSE, _FINE = 200, 500
"""Cells of a side of what is correlated: at all turns, and at those that the walls suggest."""

_MOST_FACES, _MOST_CHECKED, _MOST_POLISHED = 400, 2000, 4000
"""Faces of walls that move a candidate, that judge it, and that move the best one at the end."""

_LEAST_SCALE = 1.5
"""Cells: the smallest scale at which the best candidate is moved."""

_SAME_TURN, _SAME_PLACE = math.radians(5), 1.2
"""Radians and metres within which two candidates are one place: drift bends maps so far."""

_LEFT = 1.2
"""Of a prior's limits: places are moved a little after they were found."""


@dataclass(frozen=True, repr=False)
class Placement(OneLine):
    """Placement of a first map in the frame of a second, see `mapdeal.Alignment`."""

    transform: Transform
    reason: str | None
    score: float
    runner_up: float
    runner_up_transform: Transform | None
    overlap: float
    agreement: float

    @property
    def same_place(self) -> bool:
        """Whether the maps certainly show the same place, placed as in `transform`."""
        return self.reason is None

    def _told(self) -> Iterator[str]:
        yield "the same place" if self.same_place else f"not sure: {self.reason}"
        x, y, yaw = self.transform.pose
        yield f"x {x:.3f} m, y {y:.3f} m, yaw {yaw:.4f} rad"
        yield f"score {self.score:.2f}, runner-up {self.runner_up:.2f}"


def placed(
    first: OccupancyGrid,
    second: OccupancyGrid,
    *,
    prior: Transform | None = None,
    rotations: Sequence[float] | None = None,
) -> Placement:
    """Return the best placement of a map in the frame of another, certain or not."""
    _check(rotations)
    here, there = walls_of(first), walls_of(second)
    if here is None or there is None:
        which = "first" if here is None else "second"
        return _nowhere(f"the {which} map has no obstacle", prior)
    search = _Search(here, there, prior, rotations)
    poses = search.places()
    if not len(poses):
        return _nowhere("no place within the given limits", prior)
    return _judged(here, there, poses)


class _Search:
    """Candidates for the place of one map in another, within what is known of it."""

    def __init__(
        self,
        first: WallMap,
        second: WallMap,
        prior: Transform | None,
        rotations: Sequence[float] | None,
    ) -> None:
        self._maps = first, second
        lattices = second.frame.origin[2] - first.frame.origin[2]
        self._yaws = None if rotations is None else np.array(rotations, dtype=np.float64) - lattices
        self._near: Near | None = None
        if prior is not None:
            pose = _pose_of(first, second, prior)
            diagonals = [math.hypot(*walls.frame.size_xy) for walls in self._maps]
            self._near = Near(pose, max(_PRIOR_SHIFT, min(diagonals) / 10))

    def places(self) -> Poses:
        """Return the candidates, yaw, x, y, moved to where walls lie on walls."""
        first, second = self._maps
        around = np.arange(_ALL_AROUND) * (2 * math.pi / _ALL_AROUND)
        walls = yaws_by_walls(first, second)
        if self._yaws is not None:
            around = walls = np.unique(np.mod(self._yaws, 2 * math.pi))
        around, walls = self._within(around), self._within(walls)
        if self._near is not None and self._yaws is None and not len(walls):
            walls = self._near.pose[:1]
        fine = places_of(first, second, walls, side=_FINE, offered=8, kept=16, near=self._near)
        coarse = places_of(first, second, around, side=_COARSE, offered=4, kept=16, near=self._near)
        poses = np.concatenate([fine.poses, coarse.poses])
        if not len(poses):
            return poses
        wide, narrow = max(coarse.cell, 0.3), _narrow(first, second)
        scales = [wide] * 4 + [wide / 2] * 4 + [narrow] * 4
        poses = refined(first, second, poses, scales, _MOST_FACES)
        return poses[self._is_allowed(poses)]

    def _within(self, yaws: NDArray[Any]) -> NDArray[Any]:
        if self._near is None:
            return yaws
        off = _turns(yaws - self._near.pose[0])
        return yaws[off <= _PRIOR_TURN]

    def _is_allowed(self, poses: Poses) -> Mask:
        """Return which places are still within what is known after they were moved."""
        allowed: Mask = np.all(np.isfinite(poses), axis=1)
        if self._yaws is not None:
            off = _turns(poses[:, :1] - self._yaws[None])
            allowed &= off.min(axis=1) <= _ROTATION_OFF
        if self._near is not None:
            middle = self._maps[0].middle_xy[None]
            shift = moved(poses, middle)[:, 0] - moved(self._near.pose[None], middle)[:, 0]
            allowed &= np.hypot(shift[:, 0], shift[:, 1]) <= _LEFT * self._near.shift
            allowed &= _turns(poses[:, 0] - self._near.pose[0]) <= _LEFT * _PRIOR_TURN
        return allowed


def _judged(first: WallMap, second: WallMap, poses: Poses) -> Placement:
    """Return the best of some places, and whether it is sure."""
    found = agreement_at(first, second, poses, _MOST_CHECKED)
    likely = int(found.evidence(found.by_chance()).argmax())
    chance = found.by_chance(_is_elsewhere(first, poses, likely))
    scores, qualities = found.evidence(chance), found.quality(chance)
    order = np.argsort(-scores, kind="stable")
    best = int(order[0])
    elsewhere = order[_is_elsewhere(first, poses, best)[order]]
    other = int(elsewhere[0]) if len(elsewhere) else None
    runner_up = 0.0 if other is None else float(scores[other])
    polished = _polished(first, second, poses[best : best + 1])
    overlap = float(found.overlap[best])
    return Placement(
        transform=_transform_of(first, second, polished),
        reason=_reason(float(scores[best]), _rival(scores, qualities, best, elsewhere), overlap),
        score=float(scores[best]),
        runner_up=runner_up,
        runner_up_transform=None if other is None else _transform_of(first, second, poses[other]),
        overlap=overlap,
        agreement=float(found.shares[best, _SHOWN]),
    )


def _rival(
    scores: NDArray[Any], qualities: NDArray[Any], best: int, elsewhere: NDArray[np.int64]
) -> float | None:
    """Return the score of the best place elsewhere that may be the right one; None without any."""
    others = scores[elsewhere]
    limit = np.where(qualities[elsewhere] >= _AS_GOOD * qualities[best], _MOST_AS_GOOD, 1.0)
    limit = np.minimum(limit, MOST_RUNNER_UP) * scores[best]
    rivals = others[(others > limit) | (scores[best] - others < LEAST_LEAD)]
    return float(rivals.max()) if len(rivals) else None


def _reason(score: float, rival: float | None, overlap: float) -> str | None:
    """Return why a place is not sure; None if it is."""
    if score < LEAST_SCORE:
        # one that is too small is never shown as large enough
        shown = math.floor(100 * score) / 100
        told = f"score {shown:g}, of {LEAST_SCORE:g} at least"
        return f"the walls agree hardly better than those of different places do ({told})"
    if overlap < LEAST_OVERLAP:
        return f"the maps have too little in common there ({overlap:.0%} of their free space)"
    if rival is not None:
        return f"another place fits nearly as well (scores {score:.2f} and {rival:.2f})"
    return None


def _is_elsewhere(first: WallMap, poses: Poses, best: int) -> Mask:
    """Return which places are not the best one, found once more."""
    middles = moved(poses, first.middle_xy[None])[:, 0]
    off = middles - middles[best]
    is_turned = _turns(poses[:, 0] - poses[best, 0]) > _SAME_TURN
    elsewhere: Mask = is_turned | (np.hypot(off[:, 0], off[:, 1]) > _SAME_PLACE)
    return elsewhere


def _polished(first: WallMap, second: WallMap, poses: Poses) -> NDArray[np.float64]:
    narrow = _narrow(first, second)
    # Faces of one wall lie up to a cell apart: at a smaller scale, some pull without the others.
    least = _LEAST_SCALE * max(first.resolution, second.resolution)
    scales = [max(narrow, least)] * 3 + [max(narrow / 2, least)] * 5
    moved_to: Poses = refined(first, second, poses, scales, _MOST_POLISHED)[0]
    return moved_to


def _narrow(first: WallMap, second: WallMap) -> float:
    return max(0.15, first.resolution, second.resolution)


def _turns(angles: NDArray[Any]) -> NDArray[np.float64]:
    """Return how far angles are from a whole turn, radians, 0..pi."""
    turns: NDArray[np.float64] = np.abs(np.mod(angles + math.pi, 2 * math.pi) - math.pi)
    return turns


def _transform_of(first: WallMap, second: WallMap, pose: Poses) -> Transform:
    """Return a place, along the cells of both maps, as a transform between their frames."""
    yaw, x, y = pose.tolist()
    lattices = Transform(x, y, yaw)
    return second.map_from_cells().after(lattices).after(first.map_from_cells().inverse())


def _pose_of(first: WallMap, second: WallMap, transform: Transform) -> Poses:
    """Return a transform between two maps' frames as a place along their cells."""
    lattices = second.map_from_cells().inverse().after(transform).after(first.map_from_cells())
    return np.array([lattices.yaw, lattices.x, lattices.y])


def _nowhere(reason: str, prior: Transform | None) -> Placement:
    return Placement(prior or Transform(), reason, 0.0, 0.0, None, 0.0, 0.0)


def _check(rotations: Sequence[float] | None) -> None:
    if rotations is None:
        return
    if len(rotations) == 0:
        raise ParameterError("must have at least one turn", place="rotations", got=rotations)
    for value in rotations:
        if not abs(value) <= FARTHEST:  # refuses nan too
            raise ParameterError("must be finite numbers", place="rotations", got=rotations)
