"""Points of clouds counted in voxels, and the direction that is up."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mapdeal.errors import MalformedInputError
from mapdeal.grid.values import decimal_text
from mapdeal.kernels.arrays import Array, Floats, Integers, Integers32, Mask

Claim = Callable[[int, str], object]
"""Called with the bytes of an allocation and a description; it may raise an error."""
FINEST = 0.05  # default side of a cell, metres
_COARSEST = 16  # times FINEST: largest default, for sparse clouds
_SORTED_AT_ONCE = 1 << 20  # points
AT_ONCE = 1 << 14  # points or voxels whose arrays stay in the cache
_TO_PLACE = 1 << 16  # points from which the lattice of cells is chosen
_X_BITS, _Z_BITS = 24, 16
_FARTHEST_INDEX = 1 << 22  # cells
_HIGHEST_INDEX = 1 << (_Z_BITS - 1)
_FARTHEST_ANCHOR = 1 << 53
_PER_VOXEL = 64  # most bytes while voxels are merged
_TALLEST = 200.0  # largest height of a cloud, metres
_WIDEST = 20_000.0
_SMALLEST = 1.0
_SAMPLED, _COARSE = 1 << 17, 0.25  # most voxels that are tested, and their side in metres
_LARGER, _ROOM = 1.3, 1.9  # least ratio of areas, least height of a room in metres
_FILLED = 0.45  # share of the cells of a surface that have points
_STOREY, _CUTS = 1.0, 10  # height of a slab in metres, possible cuts
_FITTED_TO = 1 << 17  # most voxels that are tested
_FULL = 0.9  # share of cells with points, of a surface without gaps
_WIDENED, _TOLERANCE = 1.1, 0.45  # corrects pairs of points; cells
_LEVELS = 4  # least heights of a lattice
_LARGEST_STEP = 0.6  # metres
_REFINEMENTS, _SAME_LEVEL, _LEAST_PLACES = 8, 0.15, 10
_MOST_SAMPLED = 400_000
_WINDOWS = (40.0, 20.0, 10.0, 5.0, 3.0, 2.0)  # degrees around the best direction so far
_CLEAN = 0.01  # metres of noise up to which a plane has full weight
_FLAT = 0.05  # largest standard deviation from a plane, metres
_SAMPLE_VOXEL, _CUBE, _LEAST_IN_CUBE = 0.05, 0.5, 8
_FARTHEST_SAMPLE = 1e5
_AXES = {
    "z": ((0, 1, 2), (1, 1, 1)), "-z": ((0, 1, 2), (1, -1, -1)),
    "y": ((0, 2, 1), (1, -1, 1)), "-y": ((0, 2, 1), (1, 1, -1)),
    "x": ((2, 1, 0), (-1, 1, 1)), "-x": ((2, 1, 0), (1, 1, -1)),
}  # fmt: skip
"""By the axis that points up: the axes that become x, y and z, and their signs."""


class Voxels:
    """Counts of points in voxels: columns of square cells, cut into steps of height."""

    def __init__(
        self, cell: float, step: float, corner: tuple[float, float] | None = None,
        claim: Claim | None = None,
    ) -> None:  # fmt: skip
        self.cell, self.step = cell, step
        self.corner = np.zeros(2) if corner is None else np.array(corner)
        self.points = self.not_finite = self.beyond = 0
        self._is_placed = corner is not None
        self._anchor: Integers | None = None
        self._waiting: list[Integers] = []
        self._count = 0
        self._parts: list[tuple[Integers, Integers32]] = []
        self._claim = claim or (lambda *_: None)

    def add(self, points: Floats) -> None:
        self.points += len(points)
        if self._anchor is None:
            finite = points[np.isfinite(points[:, :3]).all(axis=1)]
            if not len(finite):
                self.not_finite += len(points)
                return
            self._anchor = self._place(finite[:_TO_PLACE])
        for first in range(0, len(points), AT_ONCE):
            self._waiting.append(self._keys(points[first : first + AT_ONCE], self._anchor))
        self._count += len(points)
        if self._count >= _SORTED_AT_ONCE:
            self._sort()

    def _keys(self, points: Floats, anchor: Integers) -> Integers:
        near = np.ones(len(points), np.bool_)
        key = np.zeros(len(points), np.int64)
        x0, y0 = self.corner.tolist()
        for axis, low, size, most, bits in (
            (1, y0, self.cell, _FARTHEST_INDEX, _X_BITS),
            (0, x0, self.cell, _FARTHEST_INDEX, _Z_BITS),
            (2, 0.0, self.step, _HIGHEST_INDEX, 0),
        ):
            with np.errstate(over="ignore", invalid="ignore"):
                place = points[:, axis] - low
                place /= size
                place += 1e-9
                np.floor(place, out=place)
                place -= anchor[axis] - most
                near &= (place > 0) & (place < 2 * most)
                key += place.astype(np.int64)
            key <<= bits
        if not near.all():
            is_far = np.isfinite(points[~near, :3]).all(axis=1)
            self.beyond += int(np.count_nonzero(is_far))
            self.not_finite += int(np.count_nonzero(~is_far))
            key = key[near]
        return key

    def _place(self, points: Floats) -> Integers:
        """Choose the lattice of cells; return the voxel with index 0."""
        # Points out of a voxel filter lie on a lattice. If it coincides with the edges of cells,
        # rounding would put points on either side, so the cells are shifted by half a cell.
        if not self._is_placed:
            for axis in (0, 1):
                with np.errstate(over="ignore", invalid="ignore"):
                    turns = 2 * math.pi * (points[:, axis] / self.cell % 1.0)
                if math.hypot(np.cos(turns).mean(), np.sin(turns).mean()) > 0.9:
                    phase = math.atan2(np.sin(turns).mean(), np.cos(turns).mean()) / (2 * math.pi)
                    self.corner[axis] = (round((phase + 0.5) % 1.0, 3) % 1.0) * self.cell
        low = np.array([*self.corner, 0.0])
        sizes = np.array([self.cell, self.cell, self.step])
        with np.errstate(over="ignore", invalid="ignore"):
            middle = np.array([median(coordinates) for coordinates in points[:, :3].T])
            place = np.floor((middle - low) / sizes)
        return np.asarray(place.clip(-_FARTHEST_ANCHOR, _FARTHEST_ANCHOR), dtype=np.int64)

    def _sort(self) -> None:
        keys = np.sort(np.concatenate(self._waiting))
        self._waiting, self._count = [], 0
        starts = starts_of(keys)
        self._parts.append((keys[starts], np.diff(starts, append=len(keys)).astype(np.int32)))
        first, *later = (len(keys) for keys, _ in self._parts)
        if later and sum(later) >= first:
            self._merge()

    def _merge(self) -> None:
        total = sum(len(array) for array, _ in self._parts)
        self._claim(_PER_VOXEL * total, f"{total} voxels of the cloud")
        cuts = self._parts[0][0][AT_ONCE::AT_ONCE]
        split = [
            zip(*(np.split(array, np.searchsorted(part[0], cuts)) for array in part), strict=True)
            for part in self._parts
        ]
        merged = []
        for parts in zip(*split, strict=True):
            keys, counts = (np.concatenate(array) for array in zip(*parts, strict=True))
            order = np.argsort(keys, kind="stable")
            keys, counts = keys[order], counts[order]
            starts = starts_of(keys)
            merged.append((keys[starts], np.add.reduceat(counts, starts, dtype=np.int32)))
        keys, counts = (np.concatenate(array) for array in zip(*merged, strict=True))
        self._parts = [(keys, counts)]

    def columns(self) -> Columns | None:
        """Return all voxels in order, if there are any, and release them here."""
        if self._waiting:
            self._sort()
        if self._anchor is None or not any(len(keys) for keys, _ in self._parts):
            return None
        if len(self._parts) > 1:
            self._merge()
        ((keys, counts),) = self._parts
        self._parts = []
        self._claim(_PER_VOXEL * len(keys), f"{len(keys)} voxels of the cloud")
        heights = (keys & ((1 << _Z_BITS) - 1)).astype(np.float64)
        heights += self._anchor[2] - _HIGHEST_INDEX + 0.5
        heights *= self.step
        keys >>= _Z_BITS
        starts = starts_of(keys)
        of_column = keys[starts]
        col = (of_column & ((1 << _X_BITS) - 1)) - _FARTHEST_INDEX + self._anchor[0]
        row = (of_column >> _X_BITS) - _FARTHEST_INDEX + self._anchor[1]
        return Columns(row, col, starts, heights, counts, self.cell, self.corner)


class Columns(NamedTuple):
    """Columns of voxels, ordered by row and column, and within each by height."""

    row: Integers
    col: Integers
    starts: Integers  # of each column, the number of its first voxel
    heights: Floats
    counts: Integers32
    cell: float
    corner: Floats

    def chosen(self, mask: Mask) -> Columns:
        if mask.all():
            return self
        lengths, voxels = self.lengths(), np.repeat(mask, self.lengths())
        return self._replace(
            row=self.row[mask], col=self.col[mask], heights=self.heights[voxels],
            starts=np.cumsum(lengths[mask]) - lengths[mask], counts=self.counts[voxels],
        )  # fmt: skip

    def parts(self) -> Iterator[tuple[slice, Columns]]:
        ends = np.searchsorted(self.starts, np.arange(AT_ONCE, len(self.heights), AT_ONCE)).tolist()
        for first, end in pairwise([0, *ends, len(self.starts)]):
            if first < end:
                which, starts = slice(first, end), self.starts[first:end]
                last = self.starts[end] if end < len(self.starts) else len(self.heights)
                voxel_slice = slice(starts[0], last)
                yield which, self._replace(
                    row=self.row[which], col=self.col[which], starts=starts - starts[0],
                    heights=self.heights[voxel_slice], counts=self.counts[voxel_slice],
                )  # fmt: skip

    def above(self, floor: Floats) -> Floats:
        return self.heights - np.repeat(floor, self.lengths())

    def of_voxels(self) -> Integers:
        return np.repeat(np.arange(len(self.starts)), self.lengths())

    def lengths(self) -> Integers:
        return np.diff(self.starts, append=len(self.heights))

    def coarser(self, times: int) -> Columns:
        row, col = self.row // times, self.col // times
        first_row, first_col = row.min(), col.min()
        levels, level = np.unique(self.heights, return_inverse=True)
        keys = (((row - first_row) << _X_BITS) + col - first_col)[self.of_voxels()]
        keys = (keys << _Z_BITS) + level
        order = np.argsort(keys)
        keys = keys[order]
        at = starts_of(keys)
        counts = np.add.reduceat(self.counts[order], at, dtype=np.int32)
        heights, keys = levels[keys[at] & ((1 << _Z_BITS) - 1)], keys[at] >> _Z_BITS
        starts = starts_of(keys)
        row, col = keys[starts] >> _X_BITS, keys[starts] & ((1 << _X_BITS) - 1)
        places = row + first_row, col + first_col
        return Columns(*places, starts, heights, counts, self.cell * times, self.corner)


def starts_of(keys: Array) -> Integers:
    """Return the index of each first occurrence in a sorted array."""
    is_new = np.ones(len(keys), np.bool_)
    np.not_equal(keys[1:], keys[:-1], out=is_new[1:])
    return np.flatnonzero(is_new)


def check_extent(columns: Columns) -> None:
    order = np.sort(columns.heights)
    if order[0] == order[-1]:
        rule = f"all points lie at one height, {order[0]:.2f} m: it has no walls"
        raise MalformedInputError(rule, hint="a scan of a plane is no cloud of a building")
    low, high = ends = [int(share * (len(order) - 1)) for share in (0.01, 0.99)]
    tall, sides = float(order[high] - order[low]), []
    for indices in (columns.col, columns.row):
        along = np.argsort(indices)
        voxels = np.cumsum(columns.lengths()[along])
        first, last = indices[along][np.searchsorted(voxels, ends, side="right")]
        sides.append(float(last - first + 1) * columns.cell)
    size = f"{sides[0]:.3g} x {sides[1]:.3g} x {tall:.3g} m"
    if tall > _TALLEST or max(sides) > _WIDEST:
        rule = f"extends over {size}: are its coordinates in millimetres?"
        raise MalformedInputError(rule, hint="they must be metres")
    if max(sides) < _SMALLEST:
        raise MalformedInputError(f"extends over {size} only: are its coordinates in metres?")


def check_upright(columns: Columns) -> None:
    """Refuse a cloud in which the axis x or y shows a larger, lower floor than z."""
    every = -(-len(columns.heights) // _SAMPLED)
    whose = columns.of_voxels()[::every]
    row, col = columns.row[whose], columns.col[whose]
    x, y, z = col * columns.cell, row * columns.cell, columns.heights[::every]
    side = max(_COARSE, columns.cell)
    voxels = np.floor(np.stack([x, y, z], axis=1) / side).astype(np.int64)
    ends = np.sort(voxels, axis=0)[[len(voxels) // 100, -1 - len(voxels) // 100]]
    sizes = ((ends[1] - ends[0] + 1) * side).tolist()
    for axis, name in ((1, "y"), (0, "x")):
        if not _ROOM <= sizes[axis] < sizes[2]:
            continue
        area, z_area = (  # of a sparse floor, larger voxels find more
            max(_lowest_level(turned // n) * (n * side) ** 2 for n in (1, 2))
            for turned in (np.roll(voxels, 2 - k, axis=1) for k in (axis, 2))
        )
        if area > _LARGER * z_area:
            areas = decimal_text(z_area, 3), decimal_text(area, 3)
            rule = f"z does not seem to point up: the lowest level along z has {areas[0]} m2 in a "
            rule += f"cloud {sizes[2]:.3g} m high, that along {name} {areas[1]} m2 in "
            hint = f"--up {name} or --up -{name} turns the cloud; --up z if z does point up"
            raise MalformedInputError(f"{rule}{sizes[axis]:.3g} m", hint=hint)


def _lowest_level(voxels: Integers) -> int:
    """Return the number of columns along the last axis whose lowest voxels are level."""
    first, second, along = (voxels - voxels.min(axis=0)).T
    width = int(second.max()) + 2
    order = np.lexsort((along, first * width + second))
    key = (first * width + second)[order]
    at = starts_of(key)
    key, lowest = key[at], along[order][at]
    is_level = np.ones(len(key), np.bool_)
    for step in (1, width):
        beside = np.minimum(np.searchsorted(key, key + step), len(key) - 1)
        is_level &= (key[beside] == key + step) & (np.abs(lowest[beside] - lowest) <= 1)
    return int(is_level.sum())


def fitting(columns: Columns) -> Columns:
    """Return columns with cells large enough that most cells of a surface have points."""
    every = -(-len(columns.heights) // _FITTED_TO)
    sample = columns.chosen(columns.row // (2 * _COARSEST) % every == 0)
    # slabs are cut at heights with few voxels, so floors and ceilings stay in one slab
    tenth = np.floor(sample.heights * (_CUTS / _STOREY)).astype(np.int64)
    voxel_counts = np.bincount(tenth % _CUTS, minlength=_CUTS)
    slab = (tenth - int((voxel_counts + np.roll(voxel_counts, 1)).argmin())) // _CUTS
    whose = sample.of_voxels()
    cells = np.stack([sample.row[whose], sample.col[whose], slab])
    cells -= cells.min(axis=1, keepdims=True)
    keys, spacing, chosen, times = _cell_keys(cells, 1), 0.0, 1, 1
    # a filter may split a surface into two layers with pairs of points: two sizes must be filled
    while times < _COARSEST and times <= 2 * chosen:
        coarser = _cell_keys(cells, 2 * times)
        if len(keys) < _FILLED * 4 * len(coarser):
            chosen = 2 * times
        if times <= chosen > 1:
            spacing = max(spacing, _spacing(keys, coarser, times))
        keys, times = coarser, 2 * times
    if chosen == 1:
        return columns
    return columns.coarser(max(2, math.ceil(_WIDENED * spacing - _TOLERANCE)))


def _cell_keys(cells: Integers, times: int) -> Integers:
    row, col, slab = cells
    keys = np.sort((row // times << 40) + (col // times << 16) + slab)
    return keys[starts_of(keys)]


def _spacing(keys: Integers, coarser: Integers, times: int) -> float:
    """Return the distance of points within surfaces in cells, estimated from two cell sizes."""
    rim = np.zeros(len(coarser), np.bool_)
    for step in ((1 << 40) + (1 << 16), (1 << 40) - (1 << 16), 1 << 40, 1 << 16):
        for beside in (coarser - step, coarser + step):
            at = np.minimum(np.searchsorted(coarser, beside), len(coarser) - 1)
            rim |= coarser[at] != beside
    row, col = keys >> 41, (keys >> 16 & 0xFFFFFF) >> 1
    inner = ~rim[np.searchsorted(coarser, (row << 40) + (col << 16) + (keys & 0xFFFF))]
    share = inner.sum() / max(1, 4 * int((~rim).sum()))
    return times / math.sqrt(share) if share and share < _FULL else 0.0


def steps_of(columns: Columns) -> float:
    heights = np.sort(columns.heights)
    levels = heights[starts_of(heights)]
    levels = levels[len(levels) // 20 : len(levels) - len(levels) // 20]
    return 0.0 if len(levels) < _LEVELS else min(median(np.diff(levels)), _LARGEST_STEP)


def median(values: Floats) -> float:
    # numpy.median imports masked arrays, which takes a tenth of the start-up time
    middle = np.sort(values)[(len(values) - 1) // 2 : len(values) // 2 + 1]
    return float(middle.mean())


class Tilt:
    """Estimator of the up direction of a cloud that is added in parts."""

    # Planes are fitted to cubes of half a metre. Most normals agree with that of the floor, because
    # ceilings and tables are parallel to it.

    def __init__(self) -> None:
        self._samples: list[Floats] = []
        self._every = 1
        self._point_count = self._count = 0

    def add(self, points: Floats) -> None:
        points = points[np.isfinite(points).all(axis=1)]
        first = -self._point_count % self._every
        self._point_count += len(points)
        self._samples.append(points[first :: self._every, :3].copy())
        self._count += len(self._samples[-1])
        while self._count > _MOST_SAMPLED:
            thinned = np.concatenate(self._samples)[::2]
            self._samples, self._count, self._every = [thinned], len(thinned), 2 * self._every

    def up(self) -> Floats:
        best = np.array([0.0, 0.0, 1.0])
        if not self._count:
            return best
        points = np.concatenate(self._samples)
        points = points[(np.abs(points) < _FARTHEST_SAMPLE).all(axis=1)]
        cells = np.floor(points / _SAMPLE_VOXEL).astype(np.int64)
        _, first = np.unique(cells, axis=0, return_index=True)
        points = points[np.sort(first)]
        _, whose = np.unique(np.floor(points / _CUBE).astype(np.int64), axis=0, return_inverse=True)
        whose = whose.ravel()
        n = np.bincount(whose).astype(np.float64)
        sums = np.stack([np.bincount(whose, values) for values in points.T], axis=1)
        means = sums / n[:, np.newaxis]
        x, y, z = (points - means[whose]).T
        products = (x * x, x * y, y * y, x * z, y * z, z * z)
        xx, xy, yy, xz, yz, zz = (np.bincount(whose, values) for values in products)
        with np.errstate(divide="ignore", invalid="ignore"):
            determinant = xx * yy - xy * xy
            a, b = (xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant
            residual = (zz - a * xz - b * yz) / n
        good = (n >= _LEAST_IN_CUBE) & (determinant > 1e-6 * n**2) & (residual < _FLAT**2)
        if not good.any():
            return best
        a, b, weights = a[good], b[good], n[good] / (residual[good] + _CLEAN**2)
        length = np.sqrt(a * a + b * b + 1)
        normals = np.stack([-a, -b, np.ones(len(a))], axis=1) / length[:, np.newaxis]
        for degrees in np.repeat(_WINDOWS, 4).tolist():
            near = (normals * best).sum(axis=1) > math.cos(math.radians(degrees))
            if not near.any():
                break
            mean = (normals[near] * weights[near, np.newaxis]).sum(axis=0)
            best = mean / math.sqrt(float((mean * mean).sum()))
        near = (normals * best).sum(axis=1) > math.cos(math.radians(_WINDOWS[-2]))
        return _refined(best, means[good][near], n[good][near]) if near.any() else best


def _refined(up: Floats, places: Floats, weights: Floats) -> Floats:
    """Return the normal of the plane through the places at the most frequent height."""
    for _ in range(_REFINEMENTS):
        x, y, z = levelled(places, up).T
        bins = np.floor((z - z.min()) / _SAME_LEVEL).astype(np.int64)
        peak = z.min() + (int(np.bincount(bins, weights).argmax()) + 0.5) * _SAME_LEVEL
        near = np.abs(z - peak) < _SAME_LEVEL
        w = weights[near] / weights[near].sum()
        x, y, z = (coordinates[near] - (w * coordinates[near]).sum() for coordinates in (x, y, z))
        xx, xy, yy = (w * x * x).sum(), (w * x * y).sum(), (w * y * y).sum()
        determinant = xx * yy - xy * xy
        if np.count_nonzero(near) < _LEAST_PLACES or determinant < _CUBE**4:
            break
        xz, yz = (w * x * z).sum(), (w * y * z).sum()
        a, b = (xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant
        normal = np.array([[-a, -b, 1.0]]) / math.sqrt(a * a + b * b + 1)
        up = levelled(normal, up * np.array([-1.0, -1.0, 1.0]))[0]  # turned back
    return up


def upright(points: Floats, up: str | None) -> Floats:
    """Rotate points by quarter turns so that the axis `up` becomes z."""
    if up in (None, "z"):
        return points
    axes, signs = _AXES[up]
    return np.asarray(points[:, axes] * np.array(signs, dtype=np.float64))


def away_from_sensor(points: Floats, range_min: float = 0.0) -> Floats:
    """Remove points at the sensor, where drivers put beams without return."""
    if range_min > 0:
        with np.errstate(over="ignore"):
            return np.asarray(points[~(np.einsum("ij,ij->i", points, points) < range_min**2)])
    at_x = np.flatnonzero(points[:, 0] == 0)
    return np.delete(points, at_x[~points[at_x].any(axis=1)], axis=0) if len(at_x) else points


def levelled(points: Floats, up: Floats) -> Floats:
    """Rotate points about the origin by the smallest angle that moves `up` to z."""
    x, y, z = up.tolist()
    share = 1.0 / (1.0 + z)
    px, py, pz = points[:, 0], points[:, 1], points[:, 2]
    turned = np.empty((len(points), 3))
    with np.errstate(over="ignore", invalid="ignore"):
        turned[:, 0] = px * (1 - x * x * share) - py * (x * y * share) - pz * x
        turned[:, 1] = py * (1 - y * y * share) - px * (x * y * share) - pz * y
        turned[:, 2] = px * x + py * y + pz * z
    return turned
