"""Places where one map may lie in another: all shifts at once, for each of some turns."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.alignment.walls import WallMap, pooled
from mapdeal.grid.coordinates import turned
from mapdeal.kernels.threads import in_parallel
from mapdeal.records import dataclass

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
    """Return the places where a map correlates best with another.

    Notes
    -----
    A shift's score is a sum over cells: walls on walls count for it, walls of one map in free
    space of the other against it. So it is one correlation of the first map's walls, and one of
    its free space, with weighted sums of those of the second. Both are done by FFT.
    """
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
        """Return an array of cells with the weights of the points that lie in each."""
        col, row = np.floor(points_xy / self.cell).astype(np.int64).T
        every = np.broadcast_to(np.asarray(weights, dtype=np.float64), row.shape)
        height, width = self._shape
        cells = np.bincount(row * width + col, every, height * width)
        return cells.reshape(self._shape).astype(np.float32)


def _free_blocks(walls: WallMap, cell: float) -> tuple[Floats, Floats]:
    """Return points for the free space of a map: centres of blocks, and how much of a cell each is.

    Blocks are at most half a cell, so that none is missed when they are turned.
    """
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
