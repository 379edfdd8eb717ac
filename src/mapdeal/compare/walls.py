"""The walls of a map, their points at poses, distances to them, and bends between two maps.

A bend is a smooth displacement in addition to a rigid transform. Sensor maps drift: if two maps
show the same place, a slight bend makes nearly all walls coincide; if not, it hardly helps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from itertools import product
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid import occupancy, values as codes
from mapdeal.grid.frame import Frame, Transform
from mapdeal.kernels.arrays import Mask
from mapdeal.kernels.distance import beside, dilate_square, squared_distance
from mapdeal.records import dataclass, replace

Floats = NDArray[np.floating[Any]]
Poses = NDArray[np.float64]  # each yaw, x, y along the cells of both maps, shape (K, 3) or (3,)
Singles = NDArray[np.float32]
Scalar = TypeVar("Scalar", bound=np.generic)
MOST_CELLS_A_SIDE = 1000  # larger maps are pooled: walls are found to a fraction of a cell anyway
_MOST_FREE = 25  # occupancy up to which a cell is free: map_server's default threshold of 0.25
_LEAST_FREE = 0.1  # free cells per obstacle cell; maps with fewer show walls only
_REACH = 2  # cells within which free space determines the normal of a wall
_BEYOND = np.float32(1e9)  # metres to walls from outside; finite, because masks are slower
_FEWEST_FACING = 0.25  # share of walls that must face free space; otherwise all edges count


@dataclass(frozen=True, eq=False)
class WallMap:
    """The walls of a map, on its own lattice, cropped to known cells."""

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
        return len(self.faces_xy) * self.resolution

    @property
    def free_area(self) -> float:
        return float(np.count_nonzero(self.free)) * self.resolution**2

    @property
    def middle_xy(self) -> NDArray[np.float64]:
        return np.array(self.frame.size_xy) / 2

    def some_faces(self, most: int) -> tuple[Singles, Singles]:
        return some_of(self.faces_xy, most), some_of(self.normals_xy, most)

    @cached_property
    def padded_distance(self) -> Singles:
        return np.pad(self.distance, 1, constant_values=_BEYOND).ravel()

    @cached_property
    def padded_free(self) -> Mask:
        return np.pad(self.free, 1).ravel()

    @cached_property
    def padded_known(self) -> Mask:
        return np.pad(self.known, 1).ravel()

    def map_from_cells(self) -> Transform:
        return Transform(*self.frame.origin[:2], math.remainder(self.frame.origin[2], 2 * math.pi))


def some_of(values: NDArray[Scalar], most: int) -> NDArray[Scalar]:
    return values if len(values) <= most else values[np.arange(most) * len(values) // most]


def walls_of(grid: occupancy.OccupancyGrid, most: int = MOST_CELLS_A_SIDE) -> WallMap | None:
    # In a map with hardly any free space, such as a drawing, all cells but walls count as free.
    occupied, values = grid.occupied(), grid.occupancy
    free = (values > codes.UNKNOWN) & (values < _MOST_FREE)
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
    rows, cols = (min(factor, side) for side in cells.shape)  # of a block
    height, width = -(-cells.shape[0] // rows), -(-cells.shape[1] // cols)
    padded = np.zeros((height * rows, width * cols), dtype=cells.dtype)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    return np.asarray(padded.reshape(height, rows, width, cols).sum(axis=(1, 3)))


def _faces(occupied: Mask, free: Mask) -> Mask:
    """Return the obstacle cells that a sensor sees: those beside free cells."""
    # The cells behind depend on the mapper. If few walls face free space, all their edges count.
    edges, facing = occupied & beside(~occupied), occupied & dilate_square(free, 1)
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


FAR = 3.0  # scales: walls farther apart than this do not pull


def moved(poses: Poses, points_xy: Floats) -> Floats:
    """Return points, shape (N, 2), moved to each pose (yaw, x, y); shape (K, N, 2)."""
    cos, sin = np.cos(poses[:, :1]), np.sin(poses[:, :1])
    x, y = points_xy[:, 0], points_xy[:, 1]
    # all x before all y: numpy is slow on strided numbers
    result = np.empty((2, len(poses), len(points_xy)), dtype=points_xy.dtype)
    result[0] = cos * x - sin * y + poses[:, 1:2]
    result[1] = sin * x + cos * y + poses[:, 2:3]
    return np.moveaxis(result, 0, -1)


def moved_back(poses: Poses, points_xy: Floats) -> Floats:
    cos, sin = np.cos(poses[:, :1]), np.sin(poses[:, :1])
    x, y = points_xy[:, 0] - poses[:, 1:2], points_xy[:, 1] - poses[:, 2:3]
    result = np.empty((2, *x.shape), dtype=points_xy.dtype)
    result[0], result[1] = cos * x + sin * y, cos * y - sin * x
    return np.moveaxis(result, 0, -1)


def slopes(walls: WallMap, points_xy: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the bilinear distance to a wall, and its slopes along x and y."""
    height, width = walls.frame.shape
    places = points_xy / np.float32(walls.resolution) - np.float32(0.5)
    corner = np.floor(places)
    x, y = np.moveaxis(places - corner, -1, 0)
    with np.errstate(invalid="ignore"):  # far outside
        col, row = np.moveaxis(corner.astype(np.int32), -1, 0)
    inside = (col >= 0) & (row >= 0) & (col < width - 1) & (row < height - 1)
    at = ((row * width + col) * inside).astype(np.intp)
    right, up = (1 if width > 1 else 0), (width if height > 1 else 0)
    values = walls.distance.ravel()
    low, lower = values.take(at), values.take(at + right)
    high, upper = values.take(at + up), values.take(at + up + right)
    south, north = low + (lower - low) * x, high + (upper - high) * x
    found = south + (north - south) * y + _BEYOND * ~inside
    along = (lower - low) * (1 - y) + (upper - high) * y
    return found, along / walls.resolution, (north - south) / walls.resolution


def cells_at(walls: WallMap, points_xy: Floats) -> NDArray[np.intp]:
    height, width = walls.frame.shape
    with np.errstate(invalid="ignore"):  # far outside
        cells = np.floor(points_xy / np.float32(walls.resolution)).astype(np.int32)
    col, row = np.moveaxis(cells, -1, 0)
    at = (np.clip(row, -1, height) + 1) * (width + 2) + np.clip(col, -1, width) + 1
    return np.asarray(at, dtype=np.intp)


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
