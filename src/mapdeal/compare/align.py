"""Where a map lies in the frame of another one.

Candidates are places at which the walls of both fall together; they are judged by how far walls
and free space agree there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import FARTHEST, Frame, Transform, turned
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import UNKNOWN, OneLine
from mapdeal.kernels.distance import squared_distance
from mapdeal.kernels.rotations import hough_spectrum, inverse_matrices
from mapdeal.kernels.threads import in_parallel

Floats = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]
Poses = NDArray[np.float64]  # each yaw, x, y along the cells of both maps, shape (K, 3) or (3,)
Singles = NDArray[np.float32]
Scalar = TypeVar("Scalar", bound=np.generic)

MOST_CELLS_A_SIDE = 1000
"""Larger maps are aligned on coarser cells: walls are found to a fraction of a cell anyway."""

_MOST_FREE = 25
"""Occupancy up to which a cell counts as free: map_server's default threshold of 0.25."""

_LEAST_FREE = 0.1  # free cells of a map, for each obstacle cell, that is not one of walls alone
_REACH = 2  # cells within which a wall looks for free space to face
_FEWEST_FACING = 0.25
"""Share of the walls that must face free space; else walls that face unknown space count, too."""


@dataclass(frozen=True, eq=False)
class WallMap:
    """The walls of a map, on its own lattice, of which the rows and columns around are cut off."""

    frame: Frame
    free: Mask
    known: Mask
    distance: Singles
    faces_xy: Singles
    normals_xy: Singles

    @property
    def resolution(self) -> float:
        return self.frame.resolution

    @property
    def wall_length(self) -> float:
        """Faces of walls, metres: a cell's side for each."""
        return len(self.faces_xy) * self.resolution

    @property
    def free_area(self) -> float:
        return float(np.count_nonzero(self.free)) * self.resolution**2

    @property
    def middle_xy(self) -> NDArray[np.float64]:
        """The middle of the cells, metres from their corner."""
        return np.array(self.frame.size_xy) / 2

    def some_faces(self, most: int) -> tuple[Singles, Singles]:
        """Return at most so many faces, evenly chosen, and their normals."""
        return _some_of(self.faces_xy, most), _some_of(self.normals_xy, most)

    def map_from_cells(self) -> Transform:
        """Return the transform from metres along the cells' axes to the map frame."""
        return Transform.from_pose(self.frame.origin)


def _some_of(values: NDArray[Scalar], most: int) -> NDArray[Scalar]:
    if len(values) <= most:
        return values
    return values[np.arange(most) * len(values) // most]


def walls_of(grid: OccupancyGrid, most: int = MOST_CELLS_A_SIDE) -> WallMap | None:
    # A map that knows hardly any free space is one of walls alone, such as a drawing: all that is
    # no obstacle counts as free.
    occupied = grid.occupied()
    values = grid.occupancy
    free = (values > UNKNOWN) & (values < _MOST_FREE)
    rows, cols = (np.flatnonzero((occupied | free).any(axis=axis)) for axis in (1, 0))
    if not occupied.any():
        return None
    part = np.s_[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    occupied, free = occupied[part], free[part]
    if np.count_nonzero(free) < _LEAST_FREE * np.count_nonzero(occupied):
        free = ~occupied
    frame = grid.frame.window(int(rows[0]), int(cols[0]), *occupied.shape)
    factor = math.ceil(max(frame.shape) / most)
    if factor > 1:
        occupied = pooled(occupied, factor) > 0
        free = (pooled(free, factor) >= factor * factor / 2) & ~occupied
        height, width = occupied.shape
        frame = Frame(height, width, grid.resolution * factor, frame.origin)
    faces = _faces(occupied, free)
    cells = np.argwhere(faces)
    distance = np.sqrt(squared_distance(faces), dtype=np.float32) * np.float32(frame.resolution)
    centres = ((cells[:, ::-1] + 0.5) * frame.resolution).astype(np.float32)
    return WallMap(frame, free, occupied | free, distance, centres, _normals(cells, free))


def pooled(cells: Mask, factor: int) -> NDArray[np.int64]:
    height, width = (-(-side // factor) for side in cells.shape)
    padded = np.zeros((height * factor, width * factor), dtype=cells.dtype)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    counts: NDArray[np.int64] = padded.reshape(height, factor, width, factor).sum(axis=(1, 3))
    return counts


def _faces(occupied: Mask, free: Mask) -> Mask:
    """Return the obstacle cells that a sensor sees: those beside free ones."""
    # What is behind them depends on how a map was made. Maps that know little free space, as those
    # of walls alone, have their walls counted from all sides.
    sides = np.pad(occupied, 1, mode="edge")
    inside = sides[:-2, 1:-1] & sides[2:, 1:-1] & sides[1:-1, :-2] & sides[1:-1, 2:]
    edges = occupied & ~inside
    padded = np.pad(free, 1)
    across = padded[:, :-2] | padded[:, 1:-1] | padded[:, 2:]
    facing: Mask = occupied & (across[:-2] | across[1:-1] | across[2:])
    if np.count_nonzero(facing) >= _FEWEST_FACING * np.count_nonzero(edges) and facing.any():
        return facing
    return edges if edges.any() else occupied


def _normals(cells: NDArray[np.int64], free: Mask) -> Singles:
    padded = np.pad(free, _REACH)
    total = np.zeros((len(cells), 2), dtype=np.float32)
    around = range(-_REACH, _REACH + 1)
    for row, col in product(around, around):
        if row or col:
            is_free = padded[cells[:, 0] + _REACH + row, cells[:, 1] + _REACH + col]
            total += is_free[:, None] * (np.array([col, row], np.float32) / math.hypot(row, col))
    length = np.hypot(total[:, 0], total[:, 1])[:, None]
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0.5)


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
    """Return the places where a map correlates best with another."""
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


def moved(poses: Poses, points_xy: Floats) -> Floats:
    """Return points, shape (N, 2), at each of some poses yaw, x, y: shape (K, N, 2)."""
    cos, sin = np.cos(poses[:, :1]), np.sin(poses[:, :1])
    x, y = points_xy[:, 0], points_xy[:, 1]
    result = np.empty((len(poses), len(points_xy), 2), dtype=points_xy.dtype)
    result[..., 0] = cos * x - sin * y + poses[:, 1:2]
    result[..., 1] = sin * x + cos * y + poses[:, 2:3]
    return result


class _Plan:
    """Shared data of all turns: the size of the arrays, and the second map's transforms."""

    def __init__(self, first: WallMap, second: WallMap, side: int) -> None:
        self._diagonal = math.hypot(*first.frame.size_xy)
        self._size = np.array(second.frame.size_xy)
        finest = max(first.resolution, second.resolution)
        self.cell = max((self._diagonal + float(self._size.max())) / side, finest)
        width, height = ((self._diagonal + self._size) / self.cell + 4).astype(int)
        self._shape = _quick_size(int(height)), _quick_size(int(width))
        self._middle = first.middle_xy
        self._walls = first.faces_xy - self._middle, first.resolution / self.cell
        centres, weights = _free_blocks(first, self.cell)
        self._free = centres - self._middle, weights
        walls = self._splat(second.faces_xy, second.resolution / self.cell)
        free = self._splat(*_free_blocks(second, self.cell))
        walls = np.minimum(walls, np.float32(_FULL))
        near = walls
        for axis in (0, 1):  # what is a cell off counts half
            near = (np.roll(near, 1, axis) + 2 * near + np.roll(near, -1, axis)) / 4
        near = 2 * near
        clear = np.maximum(free - near, 0)
        self._spectra = [
            (np.fft.rfft2(near - against * clear), np.fft.rfft2(both_free * free - against * walls))
            for against, both_free in np.array(_WEIGHTS, dtype=np.float32)
        ]

    def best(self, yaw: float, offered: int, near: Near | None) -> list[list[list[float]]]:
        """Return of each weighing the best shifts of a turn, each as score, yaw, x, y."""
        half = self._diagonal / 2 + self.cell
        points, weight = self._walls
        walls = np.minimum(self._splat(turned(points, yaw) + half, weight), np.float32(_FULL))
        points, weights = self._free
        free = np.maximum(self._splat(turned(points, yaw) + half, weights) - walls, 0)
        spectra = np.conj(np.fft.rfft2(walls)), np.conj(np.fft.rfft2(free))
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

    def _splat(self, points_xy: Floats, weights: Floats | float) -> Floats:
        col, row = np.floor(points_xy / self.cell).astype(np.int64).T
        every = np.broadcast_to(np.asarray(weights, dtype=np.float64), row.shape)
        height, width = self._shape
        cells = np.bincount(row * width + col, every, height * width)
        return cells.reshape(self._shape).astype(np.float32)


def _free_blocks(walls: WallMap, cell: float) -> tuple[Floats, Floats]:
    """Return the centres of blocks of a map's free space, and how much of a cell each is."""
    # blocks are at most half a cell, so that none is missed when they are turned
    factor = max(1, int(cell / 2 / walls.resolution))
    counts = pooled(walls.free, factor)
    cells = np.argwhere(counts)
    centres = (cells[:, ::-1] + 0.5) * (factor * walls.resolution)
    return centres, counts[counts > 0] * (walls.resolution / cell) ** 2


def _best_of_blocks(
    scores: Floats, most: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], list[float]]:
    """Return row, column and score of the best cells, of each block one at most."""
    height, width = (side // _BLOCK for side in scores.shape)
    whole = scores[: height * _BLOCK, : width * _BLOCK]
    # down the rows first, which is one pass over whole rows
    best = whole.reshape(height, _BLOCK, -1).max(axis=1).reshape(-1, _BLOCK).max(axis=1)
    blocks = whole.reshape(height, _BLOCK, width, _BLOCK)
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
    """Return how far angles are from a whole turn, radians, 0..pi."""
    turns: NDArray[np.float64] = np.abs(np.mod(angles + math.pi, 2 * math.pi) - math.pi)
    return turns


def _quick_size(least: int) -> int:
    """Return the next size whose only prime factors are 2, 3 and 5."""
    size = least
    while 30**32 % size:  # a multiple of all such numbers that have 32 bits
        size += 1
    return size


_FAR = 3.0  # in scales: walls farther than this from any other do not pull
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
    normal: Floats, right: Floats, columns: Sequence[Floats], distance: Floats, scale: float
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
    """Return the distance to a wall and its slopes along x and y, between the cells' centres."""
    # Outside of the map the distance is infinite.
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

    def quality(self, chance: Floats) -> Floats:
        """Return the same for each piece of wall, shape (K,): how well what is common agrees."""
        quality: Floats = _divergence(self.shares, chance).mean(axis=1)
        return quality


def agreement_at(first: WallMap, second: WallMap, poses: Poses, most: int) -> Agreement:
    agreeing = np.zeros((len(poses), len(TOLERANCES)))
    contradicting = np.zeros_like(agreeing)
    known = np.zeros(len(poses))
    cell = max(first.resolution, second.resolution)
    tolerances = [max(one, 1.01 * cell) for one in TOLERANCES]  # a cell, and what rounding adds
    both: tuple[Moves, Moves] = (first, second, moved), (second, first, moved_back)
    for own, other, move in both:
        faces, normals = own.some_faces(most)
        metres = own.wall_length / len(faces) / 2
        distance, is_free, _ = _looked_up(other, move(poses, faces))
        is_thin = ~normals.any(axis=1)
        for k, tolerance in enumerate(tolerances):
            beside = faces + normals * np.float32(tolerance + cell)
            open_there = _looked_up(other, move(poses, beside))[1] | is_thin
            agreeing[:, k] += metres * ((distance <= tolerance) & open_there).sum(axis=1)
            contradicting[:, k] += metres * ((distance > tolerance) & is_free).sum(axis=1)
        row, col = np.divmod(_some_of(np.flatnonzero(own.free), most), own.frame.width)
        points = ((np.stack([col, row], axis=-1) + 0.5) * own.resolution).astype(np.float32)
        if len(points):
            shared = _looked_up(other, move(poses, points))[2].mean(axis=1)
            known += shared * own.free_area / 2
    longest = max(first.wall_length, second.wall_length)
    smaller = max(min(first.free_area, second.free_area), 1e-12)
    overlap = np.minimum(known / smaller, 1)
    return Agreement(agreeing, contradicting, overlap, min(_PIECE, _OF_WALLS * longest))


def _looked_up(walls: WallMap, points_xy: Floats) -> tuple[Floats, Mask, Mask]:
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
MOST_RUNNER_UP = 0.75  # of the score: a place that fits nearly as well may be the right one
_AS_GOOD, _MOST_AS_GOOD = 0.9, 0.35
"""A place where what is common agrees so well, relative to the best, may be the right one with
less of a score: the maps have less in common there, and need not have more."""

_SHOWN = TOLERANCES.index(0.25)

_PRIOR_TURN = math.radians(30)
_PRIOR_SHIFT = 5.0
_ROTATION_OFF = math.radians(3)  # tolerance of a given rotation: maps are rarely turned exactly
_ALL_AROUND = 100  # turns that are looked at on coarse cells, whatever the directions of the walls
_COARSE, _FINE = 200, 500
"""Cells of a side of what is correlated: at all turns, and at those that the walls suggest."""

_MOST_FACES, _MOST_CHECKED, _MOST_POLISHED = 400, 2000, 4000
"""Faces of walls that move a candidate, that judge it, and that move the best one at the end."""

_LEAST_SCALE = 1.5  # cells: the smallest scale at which the best candidate is moved
_SAME_TURN, _SAME_PLACE = math.radians(5), 1.2
"""Radians and metres within which two candidates are one place: drift bends maps so far."""

_LEFT = 1.2  # of a prior's limits: places are moved a little after they were found


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
    if rotations is not None:
        if len(rotations) == 0:
            raise ParameterError("must have at least one turn", place="rotations", got=rotations)
        if not all(abs(value) <= FARTHEST for value in rotations):  # refuses nan too
            raise ParameterError("must be finite numbers", place="rotations", got=rotations)
    here, there = walls_of(first), walls_of(second)
    if here is None or there is None:
        which = "first" if here is None else "second"
        return _nowhere(f"the {which} map has no obstacle", prior)
    poses = _candidates(here, there, prior, rotations)
    if not len(poses):
        return _nowhere("no place within the given limits", prior)
    return _judged(here, there, poses)


def _nowhere(reason: str, prior: Transform | None) -> Placement:
    return Placement(prior or Transform(), reason, 0.0, 0.0, None, 0.0, 0.0)


def _candidates(
    first: WallMap, second: WallMap, prior: Transform | None, rotations: Sequence[float] | None
) -> Poses:
    """Return places of one map in another, moved to where walls lie on walls."""
    around: Floats = np.arange(_ALL_AROUND) * (2 * math.pi / _ALL_AROUND)
    walls = yaws_by_walls(first, second)
    yaws = near = None
    if rotations is not None:
        lattices = second.frame.origin[2] - first.frame.origin[2]
        yaws = np.array(rotations, dtype=np.float64) - lattices
        around = walls = np.unique(np.mod(yaws, 2 * math.pi))
    if prior is not None:
        diagonals = [math.hypot(*one.frame.size_xy) for one in (first, second)]
        along = second.map_from_cells().inverse().after(prior).after(first.map_from_cells())
        pose = np.array([along.yaw, along.x, along.y])
        near = Near(pose, max(_PRIOR_SHIFT, min(diagonals) / 10))
        around = around[_turns(around - near.pose[0]) <= _PRIOR_TURN]
        walls = walls[_turns(walls - near.pose[0]) <= _PRIOR_TURN]
        if yaws is None and not len(walls):
            walls = near.pose[:1]
    fine = places_of(first, second, walls, side=_FINE, offered=8, kept=16, near=near)
    coarse = places_of(first, second, around, side=_COARSE, offered=4, kept=16, near=near)
    poses = np.concatenate([fine.poses, coarse.poses])
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


def _judged(first: WallMap, second: WallMap, poses: Poses) -> Placement:
    found = agreement_at(first, second, poses, _MOST_CHECKED)
    likely = int(found.evidence(found.by_chance()).argmax())
    chance = found.by_chance(_is_elsewhere(first, poses, likely))
    scores, qualities = found.evidence(chance), found.quality(chance)
    order = np.argsort(-scores, kind="stable")
    best = int(order[0])
    elsewhere = order[_is_elsewhere(first, poses, best)[order]]
    other = int(elsewhere[0]) if len(elsewhere) else None
    overlap = float(found.overlap[best])
    # Faces of one wall lie up to a cell apart: at a smaller scale, some pull without the others.
    least = _LEAST_SCALE * max(first.resolution, second.resolution)
    narrow = _narrow(first, second)
    scales = [max(narrow, least)] * 3 + [max(narrow / 2, least)] * 5
    polished = refined(first, second, poses[best : best + 1], scales, _MOST_POLISHED)[0]
    return Placement(
        transform=_transform_of(first, second, polished),
        reason=_reason(float(scores[best]), _rival(scores, qualities, best, elsewhere), overlap),
        score=float(scores[best]),
        runner_up=0.0 if other is None else float(scores[other]),
        runner_up_transform=None if other is None else _transform_of(first, second, poses[other]),
        overlap=overlap,
        agreement=float(found.shares[best, _SHOWN]),
    )


def _rival(
    scores: Floats, qualities: Floats, best: int, elsewhere: NDArray[np.int64]
) -> float | None:
    """Return the score of the best place elsewhere that may be the right one; None without any."""
    others = scores[elsewhere]
    limit = np.where(qualities[elsewhere] >= _AS_GOOD * qualities[best], _MOST_AS_GOOD, 1.0)
    limit = np.minimum(limit, MOST_RUNNER_UP) * scores[best]
    rivals = others[(others > limit) | (scores[best] - others < LEAST_LEAD)]
    return float(rivals.max()) if len(rivals) else None


def _reason(score: float, rival: float | None, overlap: float) -> str | None:
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
    elsewhere: Mask = np.hypot(off[:, 0], off[:, 1]) > _SAME_PLACE
    elsewhere |= _turns(poses[:, 0] - poses[best, 0]) > _SAME_TURN
    return elsewhere


def _narrow(first: WallMap, second: WallMap) -> float:
    return max(0.15, first.resolution, second.resolution)


def _transform_of(first: WallMap, second: WallMap, pose: Poses) -> Transform:
    yaw, x, y = pose.tolist()
    along = Transform(x, y, yaw)
    return second.map_from_cells().after(along).after(first.map_from_cells().inverse())
