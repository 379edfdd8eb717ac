"""Transforms at which the walls of two maps fall together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame, Transform, turned
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels.distance import squared_distance
from mapdeal.kernels.rotations import hough_spectrum, inverse_matrices
from mapdeal.kernels.threads import in_parallel

MOST_CELLS_A_SIDE = 1000
"""Larger maps are aligned on coarser cells: walls are found to a fraction of a cell anyway."""

_MOST_FREE = 25
"""Occupancy up to which a cell counts as free: map_server's default threshold of 0.25."""

_LEAST_FREE = 0.1
"""Free cells of a map, for each obstacle cell, that is not one of walls alone."""

_REACH = 2
"""Cells within which a wall looks for free space to face."""

_FEWEST_FACING = 0.25
"""Share of the walls that must face free space; else walls that face unknown space count, too."""

Mask = NDArray[np.bool_]
Singles = NDArray[np.float32]


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
        """Side of a cell, metres."""
        return self.frame.resolution

    @property
    def wall_length(self) -> float:
        """Faces of walls, metres: a cell's side for each."""
        return len(self.faces_xy) * self.resolution

    @property
    def free_area(self) -> float:
        """Square metres that are free."""
        return float(np.count_nonzero(self.free)) * self.resolution**2

    @property
    def middle_xy(self) -> NDArray[np.float64]:
        """The middle of the cells, metres from their corner."""
        return np.array(self.frame.size_xy) / 2

    def some_faces(self, most: int) -> tuple[Singles, Singles]:
        """Return at most so many faces, evenly chosen, and their normals."""
        if len(self.faces_xy) <= most:
            return self.faces_xy, self.normals_xy
        which = np.arange(most) * len(self.faces_xy) // most
        return self.faces_xy[which], self.normals_xy[which]

    def map_from_cells(self) -> Transform:
        """Return the transform from metres along the cells' axes to the map frame."""
        return Transform.from_pose(self.frame.origin)


def walls_of(grid: OccupancyGrid, most: int = MOST_CELLS_A_SIDE) -> WallMap | None:
    """Return the walls of a map; None if it has no obstacle."""
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
    return _of_masks(frame, occupied, free)


def pooled(cells: Mask, factor: int) -> NDArray[np.int64]:
    height, width = (-(-side // factor) for side in cells.shape)
    padded = np.zeros((height * factor, width * factor), dtype=cells.dtype)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    counts: NDArray[np.int64] = padded.reshape(height, factor, width, factor).sum(axis=(1, 3))
    return counts


def _of_masks(frame: Frame, occupied: Mask, free: Mask) -> WallMap:
    faces = _faces(occupied, free)
    cells = np.argwhere(faces)
    squares = squared_distance(faces)
    distance = np.sqrt(squares, dtype=np.float32) * np.float32(frame.resolution)
    centres = (cells[:, ::-1] + 0.5) * frame.resolution
    return WallMap(
        frame, free, occupied | free, distance, centres.astype(np.float32), _normals(cells, free)
    )


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


_DIRECTIONS = 360
"""In half a turn: one every half degree."""

_PEAKS, _DOUBTFUL = 3, 2
"""Peaks of the correlation that are looked at, and how many of them beside the peak, too."""

_BESIDE = math.radians(1.2)
"""Where maps have little in common, their peak may be so far from the turn that brings that
together; and what lies a degree off is not found."""

_STRIP = 0.1
_MOST_FACES = 4000

Angles = NDArray[np.floating[Any]]


def yaws_by_walls(first: WallMap, second: WallMap) -> Angles:
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
    both: Angles = np.stack([turns, turns + math.pi], axis=-1).ravel()
    return both


def _spectrum(walls: WallMap, width: float) -> Angles:
    """Return how much more runs in each direction than in the median one."""
    angles = np.arange(_DIRECTIONS) * (math.pi / _DIRECTIONS)
    faces = walls.some_faces(_MOST_FACES)[0].astype(np.float64)
    found = hough_spectrum(faces, angles, width)
    above = np.maximum(found - np.median(found), 0)
    centred: Angles = above - above.mean()
    return centred


def _between(values: Angles, peak: int) -> float:
    """Return where the parabola through a peak and the values beside it is highest."""
    before, at, after = (values[(peak + step) % len(values)] for step in (-1, 0, 1))
    bend = before - 2 * at + after
    return peak + float((before - after) / (2 * bend) if bend < 0 else 0)


_WEIGHTS = ((0.5, 0.12), (2.0, 0.05))
"""What a wall in free space takes off, and what free space in free space adds; a metre of wall on
a wall adds 1 for each cell's side. The first finds maps that are bent or have changed; the second
those that have little in common."""

_FULL = 1.2
"""Metres of wall, in sides of a cell, that count in one cell: what is more is clutter."""

_BLOCK = 6
"""Side of the blocks of shifts, cells, of which each offers its best one only."""

Floats = NDArray[np.floating[Any]]
Poses = NDArray[np.float64]


@dataclass(frozen=True)
class Near:
    """Limits of the search to places near a given one."""

    pose: Poses
    shift: float


@dataclass(frozen=True, eq=False)
class Places:
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
        """Return shifts x, y in cells: those beyond the second map are negative."""
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
        is_near: NDArray[np.bool_] = np.hypot(off[:, 0], off[:, 1]) <= near.shift + self.cell
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
    """Return the first poses, of those that are much the same the first alone."""
    kept: list[Poses] = []
    middles = moved(poses, middle_xy[None])[:, 0] if len(poses) else poses
    places: list[Floats] = []
    for pose, place in zip(poses, middles, strict=True):
        if len(kept) == most:
            break
        if not any(
            math.hypot(*(place - other)) < distance and _turn(pose[0] - one[0]) < _SAME_TURN
            for one, other in zip(kept, places, strict=True)
        ):
            kept.append(pose)
            places.append(place)
    return kept


_SAME_TURN = math.radians(5)


def _turn(angle: float) -> float:
    return abs(math.remainder(angle, 2 * math.pi))


def _quick_size(least: int) -> int:
    """Return the next size whose only prime factors are 2, 3 and 5."""
    size = least
    while True:
        rest = size
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return size
        size += 1


_FAR = 3.0
"""In scales: walls farther than this from any other do not pull."""

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
