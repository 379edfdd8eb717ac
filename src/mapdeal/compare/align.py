"""Where a map lies in the frame of another one.

Candidates are places at which the walls of both fall together; they are judged by how far walls
and free space agree there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.compare.bend import Bend, fitted
from mapdeal.compare.walls import (
    FAR,
    MOST_CELLS_A_SIDE,
    Floats,
    Mask,
    Poses,
    Singles,
    WallMap,
    cells_at,
    moved,
    moved_back,
    pooled,
    slopes,
    some_of,
    walls_of,
)
from mapdeal.errors import ParameterError
from mapdeal.grid.frame import FARTHEST, Transform, turned
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OneLine
from mapdeal.kernels.rotations import hough_spectrum, inverse_matrices, main_direction
from mapdeal.kernels.threads import in_parallel

_DIRECTIONS = 360  # in half a turn: one every half degree
_PEAKS, _DOUBTFUL = 3, 2
"""Peaks of the correlation that are looked at, and how many of them beside the peak, too."""

_BESIDE = math.radians(1.2)
"""Where maps have little in common, their peak may be so far from the turn that brings that
together; and what lies a degree off is not found."""

_STRIP = 0.1
_MOST_COUNTED = 4000


def yaws_by_walls(first: WallMap, second: WallMap) -> Floats:
    """Return the turns that bring the walls of one map into the directions of another's."""
    # S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25,
    # 2008: turns are the peaks of the circular correlation of two Hough spectra.
    width = max(_STRIP, first.resolution, second.resolution)
    here, there = (np.fft.rfft(_spectrum(walls, width)) for walls in (first, second))
    correlation = np.fft.irfft(np.conj(here) * there, _DIRECTIONS)
    before, after = np.roll(correlation, 1), np.roll(correlation, -1)
    smooth = (before + 2 * correlation + after) / 4
    is_peak = (smooth >= np.roll(smooth, 1)) & (smooth > np.roll(smooth, -1))
    peaks = np.flatnonzero(is_peak)
    peaks = peaks[np.argsort(-smooth[peaks], kind="stable")][:_PEAKS]
    turns = np.array([_between(smooth, int(peak)) for peak in peaks]) * math.pi / _DIRECTIONS
    doubtful = turns[:_DOUBTFUL]
    turns = np.concatenate([turns, doubtful - _BESIDE, doubtful + _BESIDE])
    return np.stack([turns, turns + math.pi], axis=-1).ravel()


def _spectrum(walls: WallMap, width: float) -> Floats:
    """Return how much more runs in each direction than in the median one."""
    angles = np.arange(_DIRECTIONS, dtype=np.float64) * (math.pi / _DIRECTIONS)
    faces = walls.some_faces(_MOST_COUNTED)[0].astype(np.float64)
    found = hough_spectrum(faces, angles, width)
    above: Floats = np.maximum(found - np.median(found), 0)
    above -= above.mean()
    return above


def _between(values: Floats, peak: int) -> float:
    """Return where the parabola through a peak and the values beside it is highest."""
    before, at, after = (values[(peak + step) % len(values)] for step in (-1, 0, 1))
    bend = before - 2 * at + after
    return peak + float((before - after) / (2 * bend) if bend < 0 else 0)


_WEIGHTS = ((0.5, 0.12), (2.0, 0.05))
"""What a wall in free space takes off, and what free space in free space adds; a metre of wall on
a wall adds 1 for each cell's side. The first finds maps that are bent or have changed; the second
those that have little in common."""

_FULL = 1.2  # metres of wall, in sides of a cell, that count in one cell: what is more is clutter
_BLOCK = 6  # side of the blocks of shifts, cells, of which each offers its best one only


class Near(NamedTuple):
    """Limits of the search to places near a given one."""

    pose: Poses
    shift: float


class Places(NamedTuple):
    """Places of a first map in a second, the best of each weighing first."""

    poses: Poses
    cell: float


def places_of(
    first: WallMap,
    second: WallMap,
    yaws: Floats,
    *,
    side: int,
    offered: int,
    kept: int,
    near: Near | None = None,
) -> Places:
    # A shift's score is a sum over cells: walls on walls count for it, walls of one map in free
    # space of the other against it. So it is one correlation of the first map's walls, and one of
    # its free space, with weighted sums of those of the second. Both are done by FFT.
    plan = _Plan(first, second, side)
    found: list[list[Any]] = [[] for _ in yaws]

    def some(start: int, end: int) -> None:
        for k in range(start, end):
            found[k] = plan.best(float(yaws[k]), offered, near)

    in_parallel(some, len(yaws))
    poses: list[Poses] = []
    for weighing in range(len(_WEIGHTS)):
        of_all = np.array([one for of_yaw in found for one in of_yaw[weighing]]).reshape(-1, 4)
        ordered = of_all[np.argsort(-of_all[:, 0], kind="stable"), 1:]
        poses += _apart(ordered, first.middle_xy, 2 * plan.cell, kept)
    return Places(np.array(poses).reshape(-1, 3), plan.cell)


class _Plan:
    """Shared data of all turns: the size of the arrays, and the second map's transforms."""

    def __init__(self, first: WallMap, second: WallMap, side: int) -> None:
        self._diagonal = math.hypot(*first.frame.size_xy)
        self._size = np.array(second.frame.size_xy)
        finest = max(first.resolution, second.resolution)
        self.cell = max((self._diagonal + float(self._size.max())) / side, finest)
        sides = (self._diagonal + self._size) / self.cell + 4
        width, height = np.maximum(sides, _BLOCK).astype(int)
        self._shape = _quick_size(int(height)), _quick_size(int(width))
        self._middle = first.middle_xy
        walls, free = (
            self._splat(points / self.cell, weights) for points, weights in self._points(second)
        )
        # single precision, and all x before all y: many points are turned many times
        self._turning = [
            (np.asfortranarray((points - self._middle) / self.cell, dtype=np.float32), weights)
            for points, weights in self._points(first)
        ]
        walls = np.minimum(walls, np.float32(_FULL))
        near = walls
        for axis in (0, 1):  # what is a cell off counts half
            near = (np.roll(near, 1, axis) + 2 * near + np.roll(near, -1, axis)) / 4
        near = 2 * near
        clear = np.maximum(free - near, 0)
        self._spectra = [
            (_spectrum_of(near - against * clear), _spectrum_of(both_free * free - against * walls))
            for against, both_free in np.array(_WEIGHTS, dtype=np.float32)
        ]

    def best(self, yaw: float, offered: int, near: Near | None) -> list[list[list[float]]]:
        """Return of each weighing the best shifts of a turn, each as score, yaw, x, y."""
        half = self._diagonal / 2 + self.cell
        walls, free = (
            self._splat(turned(points, yaw) + half / self.cell, weights)
            for points, weights in self._turning
        )
        walls = np.minimum(walls, np.float32(_FULL))
        free = np.maximum(free - walls, 0)
        spectra = np.conj(_spectrum_of(walls)), np.conj(_spectrum_of(free))
        # the corner of the array that the first map is in, less its middle, turned
        base = half - turned(self._middle[np.newaxis], yaw)[0]
        found = []
        for of_walls, of_free in self._spectra:
            scores = np.fft.irfft2(spectra[0] * of_walls + spectra[1] * of_free, s=self._shape)
            if near is not None:
                scores = np.where(self._is_near(yaw, base, near), scores, -np.inf)
            row, col, score = _best_of_blocks(scores, offered)
            shift = self._wrapped(row, col) * self.cell + base
            found.append([[s, yaw, x, y] for s, (x, y) in zip(score, shift, strict=True)])
        return found

    def _wrapped(self, row: NDArray[np.int64], col: NDArray[np.int64]) -> Floats:
        width, height = self._size / self.cell
        x = np.where(col <= width, col, col - self._shape[1])
        y = np.where(row <= height, row, row - self._shape[0])
        return np.stack([x, y], axis=-1).astype(np.float64)

    def _is_near(self, yaw: float, base: Floats, near: Near) -> NDArray[np.bool_]:
        """Return which shifts bring the first map's middle near to where it may lie."""
        to = moved(near.pose[None], self._middle[None])[0, 0]
        own = moved(np.array([[yaw, *base]]), self._middle[None])[0, 0]
        row, col = np.indices(self._shape).reshape(2, -1)
        off = self._wrapped(row, col) * self.cell + (own - to)
        is_near: Mask = np.hypot(off[:, 0], off[:, 1]) <= near.shift + self.cell
        return is_near.reshape(self._shape)

    def _points(self, walls: WallMap) -> Iterator[tuple[Floats, Floats | float]]:
        """Yield the points of a map's walls, and of its free space, and how much each counts."""
        yield walls.faces_xy, walls.resolution / self.cell
        yield _free_blocks(walls, self.cell)

    def _splat(self, places: Floats, weights: Floats | float) -> Floats:
        col, row = places.astype(np.int32).T
        every = np.broadcast_to(np.asarray(weights, dtype=np.float64), row.shape)
        height, width = self._shape
        cells = np.bincount(row * width + col, every, height * width)
        return cells.reshape(self._shape).astype(np.float32)


def _spectrum_of(cells: Floats) -> NDArray[np.complexfloating[Any, Any]]:
    # Without a scale numpy works in double precision, four times as long. All scores are scaled.
    return np.fft.rfft2(cells, norm="ortho")


def _free_blocks(walls: WallMap, cell: float) -> tuple[Floats, Floats]:
    # blocks are at most half a cell, so that none is missed when they are turned
    factor = max(1, int(cell / 2 / walls.resolution))
    counts = pooled(walls.free, factor)
    cells = np.argwhere(counts)
    centres = (cells[:, ::-1] + 0.5) * (factor * walls.resolution)
    return centres, counts[counts > 0] * (walls.resolution / cell) ** 2


def _best_of_blocks(
    scores: Floats, most: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], list[float]]:
    height, width = (side // _BLOCK for side in scores.shape)
    whole = scores[: height * _BLOCK, : width * _BLOCK]
    blocks = whole.reshape(height, _BLOCK, width, _BLOCK)
    of_rows = whole.reshape(height, _BLOCK, -1).max(axis=1).ravel()
    best = np.maximum.reduce([of_rows[k::_BLOCK] for k in range(_BLOCK)])
    top = np.argpartition(best, -min(most, len(best)))[-most:]
    top = top[np.isfinite(best[top])]
    down, right = np.divmod(top, width)
    inside = blocks[down, :, right, :].reshape(len(top), _BLOCK * _BLOCK).argmax(axis=1)
    row, col = down * _BLOCK + inside // _BLOCK, right * _BLOCK + inside % _BLOCK
    return row, col, scores[row, col].tolist()


def _apart(poses: Poses, middle_xy: Floats, distance: float, most: int) -> list[Poses]:
    kept: list[Poses] = []
    middles = moved(poses, middle_xy[None])[:, 0]
    while len(poses) and len(kept) < most:
        kept.append(poses[0])
        off = middles - middles[0]
        is_apart = np.hypot(off[:, 0], off[:, 1]) >= distance
        is_apart |= _turns(poses[:, 0] - poses[0, 0]) >= _SAME_TURN
        poses, middles = poses[is_apart], middles[is_apart]
    return kept


def _turns(angles: Floats) -> NDArray[np.float64]:
    turns: NDArray[np.float64] = np.abs(np.mod(angles + math.pi, 2 * math.pi) - math.pi)
    return turns


def _quick_size(least: int) -> int:
    """Return the next size whose only prime factors are 2, 3 and 5."""
    size = least
    while 30**32 % size:  # a multiple of all such numbers that have 32 bits
        size += 1
    return size


_DAMPING = 1e-3


def refined(
    first: WallMap, second: WallMap, poses: Poses, scales: Sequence[float], most: int
) -> Poses:
    """Return places at which the walls of both maps lie as near to each other as they can."""
    # Gauss-Newton steps on the distances of the first map's walls to those of the second and the
    # other way round, so that walls that only one map has pull at neither. Weights are those of the
    # Geman-McClure estimator.
    poses = poses.copy()
    here, there = first.some_faces(most)[0], second.some_faces(most)[0]
    for scale in scales:
        normal = np.zeros((len(poses), 3, 3))
        right = np.zeros((len(poses), 3))
        cos, sin = np.cos(poses[:, :1]), np.sin(poses[:, :1])
        points = moved(poses, here)
        distance, x, y = slopes(second, points)
        arm = points - poses[:, None, 1:]
        _add(normal, right, (x, y, y * arm[..., 0] - x * arm[..., 1]), distance, scale)
        points = moved_back(poses, there)
        distance, x, y = slopes(first, points)
        turn = x * points[..., 1] - y * points[..., 0]
        _add(normal, right, (y * sin - x * cos, -x * sin - y * cos, turn), distance, scale)
        diagonal = np.arange(3)
        normal[:, diagonal, diagonal] *= 1 + _DAMPING
        normal[:, diagonal, diagonal] += _DAMPING
        step = (inverse_matrices(normal) * right[:, np.newaxis]).sum(axis=-1)
        poses -= step[:, [2, 0, 1]]
    return poses


def _add(
    normal: Floats, right: Floats, columns: Sequence[Floats], distance: Floats, scale: float
) -> None:
    """Add the normal equations of some distances, given their derivatives by x, y and yaw."""
    counts = distance < FAR * scale
    distance = distance * counts
    weight = counts / (1 + (distance / scale) ** 2) ** 2
    for i, one in enumerate(columns):
        weighted = weight * one
        right[:, i] += (weighted * distance).sum(axis=1)
        for j, other in enumerate(columns[: i + 1]):
            normal[:, i, j] += (weighted * other).sum(axis=1)
            if i != j:
                normal[:, j, i] = normal[:, i, j]


TOLERANCES = (0.06, 0.12, 0.25, 0.5)
"""Metres within which a wall lies on a wall, but at least a cell: maps are exact, or bent."""

_SMALL, _LARGE_SIZE = 20.0, 60.0
"""Metres of the smaller map's diagonal below which tolerances are smaller in proportion, down to
three quarters of them, and above which they are larger, up to twice of it."""

_BY_CHANCE = (0.28, 0.36, 0.5, 0.66)
"""Least share of the walls that lie on walls where maps that are not the same place lie best."""

_PIECE, _OF_WALLS = 2.0, 0.015
"""Metres of wall of which it is one piece of evidence that they agree; of small maps less, as a
share of the walls of the map that has more: there are fewer places to choose from."""

_FULL_OVERLAP = 0.2
_LARGE = 0.25
"""Part of the longest walls in common, from which on a place says what is found by chance."""

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
        return np.divide(self.agreeing, seen, out=np.zeros_like(seen), where=seen > 0)

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


def agreement_at(
    first: WallMap, second: WallMap, poses: Poses, most: int, bend: Bend | None = None,
    weights: tuple[Singles, Singles] | None = None,
) -> Agreement:  # fmt: skip
    bend = bend or Bend.none(first, len(poses))
    agreeing = np.zeros((len(poses), len(TOLERANCES)))
    contradicting = np.zeros_like(agreeing)
    known = np.zeros(len(poses))
    cell = max(first.resolution, second.resolution)
    size = min(math.hypot(*walls.frame.size_xy) for walls in (first, second))
    factor = min(max(size / _SMALL, 0.75), 1.0) * min(max(size / _LARGE_SIZE, 1.0), 2.0)
    # a cell, and what rounding adds
    tolerances = [max(one * factor, 1.01 * cell) for one in TOLERANCES]
    both: tuple[Moves, Moves] = (first, second, bend.moved), (second, first, bend.moved_back)
    for number, (own, other, move) in enumerate(both):
        faces, normals = own.some_faces(most)
        metres = np.full(len(faces), own.wall_length / len(faces) / 2)
        if weights is not None:
            metres *= some_of(weights[number], most)
        at = cells_at(other, move(poses, faces))
        distance, is_free = other.padded_distance.take(at), other.padded_free.take(at)
        is_thin = ~normals.any(axis=1)
        for k, tolerance in enumerate(tolerances):
            beside = faces + normals * np.float32(tolerance + cell)
            at = cells_at(other, move(poses, beside))
            open_there = other.padded_free.take(at) | is_thin
            agreeing[:, k] += (((distance <= tolerance) & open_there) * metres).sum(axis=1)
            contradicting[:, k] += (((distance > tolerance) & is_free) * metres).sum(axis=1)
        row, col = np.divmod(some_of(np.flatnonzero(own.free), most), own.frame.width)
        points = ((np.stack([col, row], axis=-1) + 0.5) * own.resolution).astype(np.float32)
        if len(points):
            shared = other.padded_known.take(cells_at(other, move(poses, points))).mean(axis=1)
            known += shared * own.free_area / 2
    longest = max(first.wall_length, second.wall_length)
    smaller = max(min(first.free_area, second.free_area), 1e-12)
    overlap = np.minimum(known / smaller, 1)
    return Agreement(agreeing, contradicting, overlap, min(_PIECE, _OF_WALLS * longest))


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
    return _PER_CELL * max(cells) + _PER_LOOKED_AT * min(sum(cells), _LOOKED_AT)


LEAST_SCORE = LEAST_LEAD = 4.5
"""A score, and what it has more than the runner-up. Of some 350 pairs of maps of different places,
half of them with corridors or rows of equal rooms, the largest lead without a rival was 3.2."""

LEAST_SCORE_OF_MOST = 2.2
_MOST_SPACE, _MOST_AGREEING, _MOST_WALLS, _METRES_OF_WALLS = 0.66, 0.75, 0.45, 25.0
"""The same where the maps show mostly the same space: least overlap, share of walls that agree,
walls compared as a share of those of the smaller map, and their length. Drift lowers the scores of
such maps. Of 170 pairs of different places none met the four limits with a lead above 0.3; of 113
mirrored maps, whose rooms have the same sizes, the largest lead was 1.7."""

LEAST_OVERLAP = 0.1
MOST_RUNNER_UP = 0.62  # of the score: a place that fits nearly as well may be the right one

LEAST_SCORE_THERE, LEAST_AGREEMENT_THERE = 5.8, 0.75
"""A score against chance, and the share of walls, where it is given that it is the same place."""

_JUDGED, _MOST_BENT = 5, 500
"""Places that are judged as bent, and faces of walls that bend them."""

_SHIFTS, _MOST_SHIFTED = (1.0, 1.8, 3.0), 400
"""Metres by which a place is shifted along the walls, both ways, to see what that changes."""

_MOST_OF_LINE, _LINE_WIDTH, _FACING = 4.0, 0.1, 0.9
"""Metres that a straight line of walls counts at most, width of one, and the cosine of the angle
that its faces have to it at most."""

_SLIDE, _SLIDE_STEP, _MOST_SLID = 12.0, 0.2, 200
"""Metres along the walls within which rivals of the best place are looked for, in such steps."""

_WIDEST, _OF_DIAGONAL = 1.0, 0.012
"""The largest scale at which places are bent, metres, and as a share of the smaller diagonal."""

_SHOWN = TOLERANCES.index(0.25)

_PRIOR_TURN = math.radians(30)
_PRIOR_SHIFT = 5.0
_OF_LIMIT = 2.5
_ROTATION_OFF = math.radians(3)  # tolerance of a given rotation: maps are rarely turned exactly
_ALL_AROUND = 100  # turns that are looked at on coarse cells, whatever the directions of the walls
_COARSE, _FINE = 200, 500
"""Cells of a side of what is correlated: at all turns, and at those that the walls suggest."""

_MOST_FACES, _MOST_CHECKED, _MOST_POLISHED = 400, 2000, 4000
"""Faces of walls that move a candidate, that judge it, and that move the best one at the end."""

_LEAST_SCALE = 1.5  # cells: the smallest scale at which the best candidate is moved
_SAME_TURN, _SAME_PLACE = math.radians(5), 1.2
"""Radians and metres within which two candidates are one place: drift bends maps so far."""

_OF_SIZE = 0.05  # of a small map's diagonal: places that are farther apart are not one

_LEFT = 1.2  # of a prior's limits: places are moved a little after they were found


_CANDIDATES = 3


class Candidate(NamedTuple):
    """A place of a first map in the frame of a second, among the best three.

    `contradicting` is the length of walls that lie in free space of the other map, metres; the
    other figures are those of `mapdeal.Alignment`.
    """

    transform: Transform
    score: float
    overlap: float
    agreement: float
    contradicting: float


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
    bend: float
    bend_xy: tuple[float, float] | None
    candidates: tuple[Candidate, ...]

    @property
    def same_place(self) -> bool:
        """Whether the maps certainly show the same place, placed as in `transform`."""
        return self.reason is None

    def _repr_parts(self) -> Iterator[str]:
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
    if rotations is not None:
        if len(rotations) == 0:
            raise ParameterError("must have at least one turn", place="rotations", got=rotations)
        if not all(abs(value) <= FARTHEST for value in rotations):  # refuses nan too
            raise ParameterError("must be finite numbers", place="rotations", got=rotations)
    here, there = walls_of(first), walls_of(second)
    if here is None or there is None:
        which = "first" if here is None else "second"
        return _nowhere(f"the {which} map has no obstacle", prior)
    near = None if prior is None else _near(here, there, prior)
    poses = _candidates(here, there, near, rotations)
    if not len(poses):
        return _nowhere("no place within the given limits", prior)
    return _judged(here, there, poses, near)


def _nowhere(reason: str, prior: Transform | None) -> Placement:
    return Placement(prior or Transform(), reason, 0.0, 0.0, None, 0.0, 0.0, 0.0, None, ())


def _candidates(
    first: WallMap, second: WallMap, near: Near | None, rotations: Sequence[float] | None
) -> Poses:
    around: Floats = np.arange(_ALL_AROUND) * (2 * math.pi / _ALL_AROUND)
    walls = yaws_by_walls(first, second)
    yaws = None
    if rotations is not None:
        lattices = second.frame.origin[2] - first.frame.origin[2]
        yaws = np.array(rotations, dtype=np.float64) - lattices
        around = walls = np.unique(np.mod(yaws, 2 * math.pi))
    if near is not None:
        around = around[_turns(around - near.pose[0]) <= _PRIOR_TURN]
        walls = walls[_turns(walls - near.pose[0]) <= _PRIOR_TURN]
        if yaws is None and not len(walls):
            walls = near.pose[:1]
    fine = places_of(first, second, walls, side=_FINE, offered=8, kept=16, near=near)
    coarse = places_of(first, second, around, side=_COARSE, offered=4, kept=16, near=near)
    given = np.zeros((0, 3)) if near is None else near.pose[None]
    poses = np.concatenate([fine.poses, coarse.poses, given])
    if not len(poses):
        return poses
    wide, narrow = max(coarse.cell, 0.3), _narrow(first, second)
    scales = [wide] * 4 + [wide / 2] * 4 + [narrow] * 4
    poses = refined(first, second, poses, scales, _MOST_FACES)
    # moved a little, a place may be beyond what is known of it
    allowed: Mask = np.all(np.isfinite(poses), axis=1)
    if yaws is not None:
        allowed &= _turns(poses[:, :1] - yaws[None]).min(axis=1) <= _ROTATION_OFF
    if near is not None:
        middle = first.middle_xy[None]
        shift = moved(poses, middle)[:, 0] - moved(near.pose[None], middle)[:, 0]
        allowed &= np.hypot(shift[:, 0], shift[:, 1]) <= _LEFT * near.shift
        allowed &= _turns(poses[:, 0] - near.pose[0]) <= _LEFT * _PRIOR_TURN
    return poses[allowed]


def _near(first: WallMap, second: WallMap, prior: Transform) -> Near:
    diagonals = [math.hypot(*one.frame.size_xy) for one in (first, second)]
    along = second.map_from_cells().inverse().after(prior).after(first.map_from_cells())
    pose = np.array([along.yaw, along.x, along.y])
    return Near(pose, max(_PRIOR_SHIFT, min(diagonals) / 10))


def _far_from(first: WallMap, poses: Poses, near: Near) -> Floats:
    """Return how unlikely places are by a prior, as the logarithm of how much less likely."""
    # the limit of the shift is two and a half standard deviations
    middle = first.middle_xy[None]
    off = moved(poses, middle)[:, 0] - moved(near.pose[None], middle)[:, 0]
    return (_OF_LIMIT * np.hypot(off[:, 0], off[:, 1]) / near.shift) ** 2 / 2


def _judged(first: WallMap, second: WallMap, poses: Poses, near: Near | None = None) -> Placement:
    axes = _axes(second)
    weights = None
    if near is None:
        weights = _weights(first, _axes(first)), _weights(second, axes)
    found = agreement_at(first, second, poses, _MOST_CHECKED, weights=weights)
    likely = int(found.evidence(found.by_chance()).argmax())
    chance = found.by_chance(_is_elsewhere(first, poses, likely))
    poses = poses[
        _best_places(found.evidence(chance), _JUDGED, partial(_is_elsewhere, first, poses))
    ]
    poses = np.concatenate([poses, _slid(first, second, poses[0], axes)])
    bend = _bends(first, second, poses, found.piece)
    found = agreement_at(first, second, poses, _MOST_CHECKED, bend, weights)
    least = found.by_chance()
    if weights is not None:
        least = np.maximum(least, _shares_beside(first, second, poses, bend, axes, weights))
    costs = bend.costs if near is None else bend.costs + _far_from(first, poses, near)
    scores = np.maximum(found.evidence(least) - costs, 0)
    best = int(scores.argmax())
    others = np.flatnonzero(_are_elsewhere(first, poses, bend, best))
    other = int(others[scores[others].argmax()]) if len(others) else None
    score, overlap = float(scores[best]), float(found.overlap[best])
    shown = float(found.shares[best, _SHOWN])
    if near is not None:
        agrees = score >= LEAST_SCORE_THERE and shown >= LEAST_AGREEMENT_THERE
        figures = f"{shown:.0%} of those in common, score {_down(score)}"
        reason = None if agrees else f"the walls do not agree near the given place ({figures})"
    else:
        compared = float((found.agreeing + found.contradicting)[best, _SHOWN])
        walls = min(first.wall_length, second.wall_length)
        are_mostly_shared = overlap >= _MOST_SPACE and shown >= _MOST_AGREEING
        are_mostly_shared &= compared >= max(_METRES_OF_WALLS, _MOST_WALLS * walls)
        least_score = LEAST_SCORE_OF_MOST if are_mostly_shared else LEAST_SCORE
        rivals = scores[others]
        is_near = (rivals > MOST_RUNNER_UP * scores[best]) | (scores[best] - rivals < least_score)
        rival = float(rivals[is_near].max()) if is_near.any() else None
        reason = _reason(score, rival, overlap, least_score)
    polished, bent, bent_xy = _polished(first, second, poses[best : best + 1], found.piece)
    transform = _transform_of(first, second, polished)
    candidates = []
    is_elsewhere = partial(_are_elsewhere, first, poses, bend)
    for k in [] if reason is None else _best_places(scores, _CANDIDATES, is_elsewhere):
        at = transform if k == best else _transform_of(first, second, poses[k])
        shares = (found.overlap[k], found.shares[k, _SHOWN], found.contradicting[k, _SHOWN])
        candidates.append(Candidate(at, float(scores[k]), *map(float, shares)))
    return Placement(
        transform=transform,
        reason=reason,
        score=score,
        runner_up=0.0 if other is None else float(scores[other]),
        runner_up_transform=None if other is None else _transform_of(first, second, poses[other]),
        overlap=overlap,
        agreement=shown,
        bend=bent,
        bend_xy=bent_xy,
        candidates=tuple(candidates),
    )


def _best_places(scores: Floats, most: int, elsewhere: Callable[[int], Mask]) -> list[int]:
    """Return the indices of the best places of which none is another one, found once more."""
    chosen: list[int] = []
    is_free = np.ones(len(scores), dtype=np.bool_)
    for k in np.argsort(-scores, kind="stable").tolist():
        if is_free[k] and len(chosen) < most:
            chosen.append(k)
            is_free &= elsewhere(k)
    return chosen


def _axes(second: WallMap) -> Floats:
    """Return the two directions that most walls of a map run in, shape (2, 2)."""
    direction = main_direction(second.known & ~second.free) or 0.0
    along = np.array([math.cos(direction), math.sin(direction)])
    return np.stack([along, (-along[1], along[0])])


def _weights(walls: WallMap, axes: Floats) -> Singles:
    # That a wall lies on a wall at one place says that it does so all along: a line is one piece of
    # evidence, however long it is, with its ends and doors as others.
    weights = np.ones(len(walls.faces_xy), dtype=np.float32)
    width = max(_LINE_WIDTH, walls.resolution)
    for across in axes:
        # sums, not products of matrices, for which OpenBLAS would map memory in each thread
        side = (walls.normals_xy * across.astype(np.float32)).sum(axis=1)
        for sign in (1, -1):
            faces = np.flatnonzero(sign * side > _FACING)
            if not len(faces):
                continue
            strips = np.floor((walls.faces_xy[faces] * across).sum(axis=1) / width).astype(np.int64)
            strips -= strips.min() - 1
            counts = np.bincount(strips, minlength=int(strips.max()) + 2)
            lengths = (counts[strips - 1] + counts[strips] + counts[strips + 1]) * walls.resolution
            weights[faces] = np.minimum(1, _MOST_OF_LINE / lengths)
    return weights


def _slid(first: WallMap, second: WallMap, pose: Poses, axes: Floats) -> Poses:
    """Return the places along the walls, both ways, at which a map would fit best instead."""
    # In rows of equal rooms the next room but one may not be among the candidates.
    step = max(_SLIDE_STEP, first.resolution, second.resolution)
    shifts = np.arange(_SAME_PLACE, _SLIDE, step)
    shifts = np.concatenate([-shifts[::-1], shifts])
    found = []
    for axis in axes:
        beside = np.repeat(pose[None], len(shifts), axis=0)
        beside[:, 1:] += shifts[:, None] * axis
        agreeing = np.zeros(len(shifts))
        both = (first, second, moved), (second, first, moved_back)
        for own, other, move in both:
            faces = own.some_faces(_MOST_SLID)[0]
            distance = other.padded_distance.take(cells_at(other, move(beside, faces)))
            agreeing += (distance <= step).mean(axis=1) * own.wall_length
        order = np.argsort(-agreeing, kind="stable")
        best = order[0]
        next_best = order[np.abs(shifts[order] - shifts[best]) > _SAME_PLACE][:1]
        found += [beside[best], *beside[next_best]]
    narrow = _narrow(first, second)
    return refined(first, second, np.array(found), [2 * narrow] * 2 + [narrow] * 3, _MOST_FACES)


def _bends(first: WallMap, second: WallMap, poses: Poses, piece: float) -> Bend:
    diagonal = min(math.hypot(*one.frame.size_xy) for one in (first, second))
    narrow = _narrow(first, second)
    wide = max(narrow, min(_WIDEST, _OF_DIAGONAL * diagonal))
    scales = [wide] * 3 + [(wide + narrow) / 2] * 2 + [narrow] * 3
    return fitted(first, second, poses, scales=scales, piece=piece, most=_MOST_BENT)


def _shares_beside(
    first: WallMap, second: WallMap, poses: Poses, bend: Bend, axes: Floats,
    weights: tuple[Singles, Singles],
) -> Floats:  # fmt: skip
    """Return which share agrees as well where places are shifted along the walls, shape (K, T)."""
    # A corridor agrees with any other of its width, over its whole length: what a shift along the
    # walls does not change is no evidence. Of both directions the one that changes less counts.
    along, across = axes
    steps = np.array([side * shift for shift in _SHIFTS for side in (1, -1)])
    shifts = np.stack([steps[:, None] * along, steps[:, None] * across]).reshape(-1, 2)
    beside = np.repeat(poses, len(shifts), axis=0)
    beside[:, 1:] += np.tile(shifts, (len(poses), 1))
    bends = bend.repeated(len(shifts))
    found = agreement_at(first, second, beside, _MOST_SHIFTED, bends, weights)
    shares = found.shares.reshape(len(poses), 2, len(steps), -1).mean(axis=2).max(axis=1)
    return np.asarray(shares)


def _polished(
    first: WallMap, second: WallMap, poses: Poses, piece: float
) -> tuple[Poses, float, tuple[float, float] | None]:
    """Return a place moved to where it fits best, and how far walls are bent there, and where."""
    # Faces of one wall lie up to a cell apart: at a smaller scale, some pull without the others.
    least = _LEAST_SCALE * max(first.resolution, second.resolution)
    narrow = _narrow(first, second)
    # where maps are bent, all of their walls are to pull, not those alone that happen to lie well
    bent = _most_bent(first, second, poses, _bends(first, second, poses, piece))[0]
    wide = max(narrow, least, 2 * bent)
    scales = [wide] * 3 + [max(wide / 2, least)] * 5
    poses = refined(first, second, poses, scales, _MOST_POLISHED)
    return poses[0], *_most_bent(first, second, poses, _bends(first, second, poses, piece))


class BendBetween(NamedTuple):
    """How far a map is bent against another where it lies, metres, and where that is most."""

    metres: float
    point_xy: tuple[float, float]
    share: float
    share_bent: float


def bend_between(first: OccupancyGrid, second: OccupancyGrid) -> BendBetween:
    """Return the bend of two maps of one frame, and the share of walls that agree without and with.

    The shares are those of the smallest tolerance but one.
    """
    here, there = walls_of(first), walls_of(second)
    if here is None or there is None:
        return BendBetween(0.0, (0.0, 0.0), 0.0, 0.0)
    along = there.map_from_cells().inverse().after(here.map_from_cells())
    poses = np.array([[along.yaw, along.x, along.y]])
    rigid = agreement_at(here, there, poses, _MOST_POLISHED)
    bend = _bends(here, there, poses, rigid.piece)
    bent = agreement_at(here, there, poses, _MOST_POLISHED, bend)
    most, where = _most_bent(here, there, poses, bend)
    shares = (float(one.shares[0, 1]) for one in (rigid, bent))
    return BendBetween(most, where or (0.0, 0.0), *shares)


def _most_bent(
    first: WallMap, second: WallMap, poses: Poses, bend: Bend
) -> tuple[float, tuple[float, float] | None]:
    """Return how far walls that meet are displaced at most, but for a twentieth, and where."""
    faces = first.some_faces(_MOST_POLISHED)[0]
    points = bend.moved(poses, faces)[0]
    near = 2 * max(_narrow(first, second), _LEAST_SCALE * max(first.resolution, second.resolution))
    meets = second.padded_distance.take(cells_at(second, points)) <= near
    if not meets.any():
        return 0.0, None
    by = np.hypot(*bend.at(bend.terms(faces))[0].T)[meets]
    most = float(np.percentile(by, 95))
    point = points[meets][by >= most].mean(axis=0, dtype=np.float64)
    x, y = second.map_from_cells().points(point[None])[0]
    return most, (float(x), float(y))


def _reason(score: float, rival: float | None, overlap: float, least: float) -> str | None:
    if score < least:
        figures = f"score {_down(score)}, of {least:g} at least"
        return f"the walls agree hardly better than those of different places do ({figures})"
    if overlap < LEAST_OVERLAP:
        return f"the maps have too little in common there ({overlap:.0%} of their free space)"
    if rival is not None:
        return f"another place fits nearly as well (scores {score:.2f} and {rival:.2f})"
    return None


def _down(score: float) -> str:
    """Return a score so that one that is too small is never shown as large enough."""
    return f"{math.floor(100 * score) / 100:g}"


def _is_elsewhere(first: WallMap, poses: Poses, best: int) -> Mask:
    """Return which places are not the best one, found once more."""
    middles = moved(poses, first.middle_xy[None])[:, 0]
    off = middles - middles[best]
    elsewhere: Mask = np.hypot(off[:, 0], off[:, 1]) > _SAME_PLACE
    elsewhere |= _turns(poses[:, 0] - poses[best, 0]) > _SAME_TURN
    return elsewhere


def _are_elsewhere(first: WallMap, poses: Poses, bend: Bend, best: int) -> Mask:
    """Return which places bring walls elsewhere once bent; two may be bent to the same one."""
    points = bend.moved(poses, first.some_faces(_MOST_SLID)[0])
    off = points - points[best]
    least = min(_SAME_PLACE / 2, _OF_SIZE * math.hypot(*first.frame.size_xy))
    elsewhere: Mask = np.median(np.hypot(off[..., 0], off[..., 1]), axis=1) > least
    return elsewhere


def _narrow(first: WallMap, second: WallMap) -> float:
    return max(0.15, first.resolution, second.resolution)


def _transform_of(first: WallMap, second: WallMap, pose: Poses) -> Transform:
    yaw, x, y = pose.tolist()
    along = Transform(x, y, yaw)
    return second.map_from_cells().after(along).after(first.map_from_cells().inverse())
