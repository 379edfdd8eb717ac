"""The levels of a building in its point cloud, made of patches connected for a robot.

Thin layers of voxels with room above them become patches, planes over tiles of some cells. Patches
that meet within a step and a slope that the robot can drive make a level, which has one height at
each place. `mapdeal.mapping.cloud_evidence` chooses the floor among the levels.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels import components, polygons
from mapdeal.kernels.arrays import Floats, Integers, Mask
from mapdeal.mapping.voxels import AT_ONCE, Claim, Columns, median

_RUN_GAP = 0.12  # metres between voxels of a column that belong together
_THIN = 0.05  # standard deviation of the heights of a surface within a cell, metres, at most
TILE = 0.25  # metres: side of a tile, about
_SHARE_OF_MOST = 0.2  # least cells of a patch, relative to the largest patch of its tile
_FAR = 1.0  # largest gap in metres between connected patches
_REACH = 3.0  # metres around the floor up to which its height is extrapolated
_SHARE_DENSE = 0.1  # least share of layers with enough points for a typical spread
_FEW = 5  # points or cells for a meaningful spread
_LEAST_THIN, _TIMES_TYPICAL = 0.02, 2.5
Storeys = tuple[float, tuple[float, ...]]  # area below others, square metres, and their heights
_WIDTH = 1 << 32
_MOST_AT_A_RIM = 4  # of the 8 tiles around
_MOST_STOREYS = 16
_LEAST_STOREY = 0.1  # of the patches of the floor
_LEAST_SPLIT = 0.02  # least size of a level to split, relative to the largest level
_ROUNDS = 5
_SAME_PLANE = 0.03  # metres
_LEAST_SPREAD = 1e-3  # least determinant relative to the squared trace: below it is a line
_LEDGE = 1.5  # times the gap between levels: a lower rise is noise or an obstacle
_CONTINUED = 0.5  # metres


class Limits(NamedTuple):
    """Limits of the robot: steps and height in metres, slopes in degrees."""

    climb: float
    robot_height: float
    max_slope: float
    steps: float  # between heights out of a voxel filter; nearly 0 for other clouds

    @property
    def gap(self) -> float:
        """Difference of height between two levels."""
        return max(self.climb, 1.2 * self.steps)


class Patches(NamedTuple):
    row: Integers
    col: Integers
    z: Floats  # in the middle of the tile
    along_x: Floats  # rise over run
    along_y: Floats
    support: Floats  # cells

    def chosen(self, indices: Any) -> Patches:
        return Patches(*(field[indices] for field in self))


def patches_of(columns: Columns, tile: int, limits: Limits) -> Patches:
    row, col, z = _thin_layers(columns, limits)
    if not len(z):
        return Patches(*(np.zeros(0, np.int64),) * 2, *(np.zeros(0),) * 4)
    # whole rows of tiles at a time, so that arrays stay in the cache
    cuts = np.searchsorted(row, row[AT_ONCE::AT_ONCE] // tile * tile).tolist()
    planes = [
        _planes(row[first:end], col[first:end], z[first:end], tile, columns.cell, limits)
        for first, end in pairwise([0, *cuts, len(z)])
        if first < end
    ]
    *parts, spread, good = (np.concatenate(arrays) for arrays in zip(*planes, strict=True))
    patches = Patches(*parts)
    return patches.chosen(good & (spread <= _thin(spread[patches.support >= _FEW], limits.steps)))


def _planes(
    row: Integers, col: Integers, z: Floats, tile: int, cell: float, limits: Limits
) -> tuple[NDArray[Any], ...]:
    """Return the fields of `Patches` from layers, their spreads, and which may be floor."""
    tile_row, tile_col = row // tile, col // tile
    key = (tile_row - tile_row.min()) * (tile_col.max() - tile_col.min() + 1)
    key += tile_col - tile_col.min()
    order = _ordered(np.unique(z, return_inverse=True)[1], key)
    key, z, row, col = key[order], z[order], row[order], col[order]
    # a level ends where the next layer is higher than a robot climbs
    is_new = (np.diff(key, prepend=-1) != 0) | (np.diff(z, prepend=z[0]) > limits.gap)
    whose = np.cumsum(is_new) - 1
    starts = np.flatnonzero(is_new)
    middle = (tile - 1) / 2
    x, y = (col % tile - middle) * cell, (row % tile - middle) * cell

    def total(values: NDArray[Any]) -> Floats:
        return np.bincount(whose, values, len(starts)).astype(np.float64)

    n = np.diff(starts, append=len(z)).astype(np.float64)
    mx, my, mz = total(x) / n, total(y) / n, total(z) / n
    dx, dy, dz = x - mx[whose], y - my[whose], z - mz[whose]
    # pulls planes of few cells towards the horizontal, with the weight of cells half a tile away
    weight = 4.0 * (cell * tile / 4) ** 2
    xx, yy, xy = total(dx * dx) + weight, total(dy * dy) + weight, total(dx * dy)
    xz, yz, zz = total(dx * dz), total(dy * dz), total(dz * dz)
    determinant = xx * yy - xy * xy
    along_x = (xz * yy - yz * xy) / determinant
    along_y = (yz * xx - xz * xy) / determinant
    spread = np.sqrt(np.maximum(zz - along_x * xz - along_y * yz, 0.0) / n)
    steep = np.hypot(along_x, along_y) > math.tan(math.radians(limits.max_slope))
    # few points above or below a surface are noise, but a ceiling may have far more than a floor
    in_tile = np.cumsum(np.diff(key[starts], prepend=-1) != 0) - 1
    is_large = n >= _SHARE_OF_MOST * _most(n, in_tile)
    is_apart = np.diff(mz, prepend=mz[0]) >= limits.robot_height
    storey = np.cumsum((np.diff(in_tile, prepend=-1) != 0) | is_apart) - 1
    is_dense = np.zeros(len(starts), np.bool_)
    is_dense[storey[is_large]] = True
    is_large |= ~is_dense[storey] & (n >= _SHARE_OF_MOST * _most(n, storey))
    good = (n >= 2) & is_large & ~steep
    middle_z = mz - along_x * mx - along_y * my
    return row[starts] // tile, col[starts] // tile, middle_z, along_x, along_y, n, spread, good


def _most(counts: Floats, groups: Integers) -> Floats:
    most = np.zeros(len(counts))
    np.maximum.at(most, groups, counts)
    return np.asarray(most[groups])


def _ordered(*keys: Integers) -> Integers:
    """Return the result of `numpy.lexsort` for keys of at least 0."""
    # numpy sorts 16-bit words by counting, which is fast
    words = [
        (key >> shift).astype(np.uint16)
        for key in keys
        for shift in range(0, max(1, int(key.max()).bit_length()), 16)
    ]
    return np.lexsort(words)


def _thin_layers(columns: Columns, limits: Limits) -> tuple[Integers, Integers, Floats]:
    layers = [_open_layers(part, limits.robot_height) for _, part in columns.parts()]
    row, col, z, weights, variances = map(np.concatenate, zip(*layers, strict=True))
    is_dense = weights >= _FEW
    if np.mean(is_dense) < _SHARE_DENSE:  # only walls are: the cloud was thinned, or is sparse
        is_dense[:] = True
    good = variances <= _thin(np.sqrt(variances[is_dense]), limits.steps) ** 2
    return row[good], col[good], z[good]


def _open_layers(part: Columns, room: float) -> tuple[Integers, Integers, Floats, Floats, Floats]:
    z, n = part.heights, part.counts.astype(np.float64)
    begins = np.zeros(len(z), np.bool_)
    begins[part.starts] = True
    starts = np.flatnonzero(np.append(True, np.diff(z) > _RUN_GAP) | begins)
    weights = np.add.reduceat(n, starts)
    means = np.add.reduceat(n * z, starts) / weights
    deviations = z - np.repeat(means, np.diff(starts, append=len(z)))
    variances = np.add.reduceat(n * deviations**2, starts) / weights
    column = np.cumsum(begins[starts]) - 1
    is_open = np.append((z[starts[1:]] - z[starts[1:] - 1] >= room) | begins[starts[1:]], True)
    column, measures = column[is_open], (means[is_open], weights[is_open], variances[is_open])
    return part.row[column], part.col[column], *measures


def _thin(spreads: Floats, steps: float) -> float:
    """Return the largest spread of heights of a level layer, which excludes faces of low steps."""
    typical = median(spreads) if len(spreads) else _THIN
    return max(0.6 * steps, min(_THIN, max(_LEAST_THIN, _TIMES_TYPICAL * typical)))


def _links_of(patches: Patches, side: float, climb: float) -> tuple[Integers, Integers]:
    far = max(1, round(_FAR / side))
    width = int(patches.col.max() - patches.col.min()) + 1 + 2 * far
    key = (patches.row - patches.row.min()) * width + patches.col - patches.col.min()
    tiles, firsts = np.unique(key, return_index=True)
    stops = np.append(firsts[1:], len(key))

    def pairs(of: Integers, down: int, across: int) -> tuple[Integers, Integers]:
        neighbour_key = key[of] + down * width + across
        pair_lists = np.minimum(np.searchsorted(tiles, neighbour_key), len(tiles) - 1)
        is_there = tiles[pair_lists] == neighbour_key
        of, pair_lists = of[is_there], pair_lists[is_there]
        whose, second_patches = polygons.enumerated(firsts[pair_lists], stops[pair_lists])
        first_patches = of[whose]
        first, second = (
            (patches.along_x[at] * across + patches.along_y[at] * down) * side
            for at in (first_patches, second_patches)
        )
        rise = patches.z[second_patches] - patches.z[first_patches] - (first + second) / 2
        close = np.abs(rise) <= climb
        if max(down, abs(across)) > 1:  # over a gap, the slope of either end must explain the rise
            bend = np.abs(first - second)
            close &= (bend <= climb) & (np.abs(rise) + bend / 2 <= climb)
        return first_patches[close], second_patches[close]

    every = np.arange(len(key))
    pair_lists = [pairs(every, *step) for step in ((0, 1), (1, -1), (1, 0), (1, 1))]
    first_patches, second_patches = (np.concatenate(part) for part in zip(*pair_lists, strict=True))
    # gaps are bridged only from rims, the patches with fewer than 8 neighbours
    link_counts = np.bincount(np.append(first_patches, second_patches), minlength=len(key))
    rim = np.flatnonzero(link_counts < 8)
    pair_lists = [
        pairs(rim, down, across)
        for down in range(far + 1)
        for across in range(-far, far + 1)
        if (down, across) > (0, 0) and 1 < math.hypot(down, across) <= far
        and max(down, abs(across)) > 1
    ]  # fmt: skip
    first_patches = np.concatenate([first_patches, *(a for a, _ in pair_lists)])
    second_patches = np.concatenate([second_patches, *(b for _, b in pair_lists)])
    return first_patches, second_patches


def _lacks_room(patches: Patches, limits: Limits) -> Mask:
    """Return which patches, sorted by tile and height, have less than a robot's height above."""
    # The underside of a slab shows between points on its top. Rims, as at ledges, stay.
    key = (patches.row - patches.row.min()) * _WIDTH + patches.col - patches.col.min()
    rise = np.diff(patches.z, append=np.inf)
    is_below = (np.diff(key, append=-1) == 0) & (rise > limits.gap) & (rise <= limits.robot_height)
    covered, beside = np.append(key[is_below], np.iinfo(np.int64).max), np.zeros(len(key), np.int8)
    for step in (1, _WIDTH - 1, _WIDTH, _WIDTH + 1):
        for neighbour in (key + step, key - step):
            beside += covered[np.searchsorted(covered, neighbour)] == neighbour
    return np.asarray(is_below & (beside >= _MOST_AT_A_RIM))


class Levels:
    def __init__(self, patches: Patches, tile: int, cell: float, limits: Limits) -> None:
        patches = patches.chosen(np.lexsort((patches.z, patches.col, patches.row)))
        self.patches = patches.chosen(~_lacks_room(patches, limits))
        self.tile_cells, self.cell, self.side, self.limits = tile, cell, tile * cell, limits
        self._links = _links_of(self.patches, self.side, max(limits.climb, 0.7 * limits.steps))
        row, col, z = self.patches[:3]
        is_new = (np.diff(row, prepend=-1) != 0) | (np.diff(col, prepend=-1) != 0)
        is_new[0] = True
        self.tile = np.cumsum(is_new) - 1
        self._connected = components.least_joined(*self._links, len(z))
        self.label = self._connected.copy()
        self._split()

    def area(self) -> Floats:
        return np.asarray(np.bincount(self.label) * self.side**2)

    def are_joined(self, first: int, second: int) -> bool:
        return bool(self._connected[first] == self._connected[second])

    def _split(self) -> None:
        """Split levels that overlap themselves, such as two storeys joined by a ramp."""
        sizes = np.bincount(self.label)
        is_open = sizes[self.label] >= _LEAST_SPLIT * sizes.max()
        for _ in range(_MOST_STOREYS):
            is_open &= np.isin(self.label, self.label[self._is_above_own(is_open)])
            if not is_open.any():
                return
            lowest = is_open & ~self._is_above_own(is_open, 0.0)
            groups = self._joined(lowest)
            sizes = np.bincount(groups[lowest], minlength=len(groups))
            for label in np.unique(self.label[is_open]).tolist():
                of_label = is_open & (self.label == label)
                largest = int(np.where(of_label, sizes[: len(of_label)], -1).argmax())
                sheet = self._grown(lowest & (groups == largest), of_label)
                remaining = of_label & ~sheet
                self.label[sheet] = int(np.flatnonzero(sheet)[0])
                self.label[remaining] = self._joined(remaining)[remaining]
                is_open &= ~sheet

    def _is_above_own(self, chosen: Mask, room: float | None = None) -> Mask:
        """Return which patches lie more than `room` above another patch of their level."""
        room = self.limits.robot_height if room is None else room
        order = np.flatnonzero(chosen)
        order = order[np.lexsort((self.patches.z[order], self.tile[order], self.label[order]))]
        tile, label, z = self.tile[order], self.label[order], self.patches.z[order]
        is_new = (np.diff(tile, prepend=-1) != 0) | (np.diff(label, prepend=-1) != 0)
        first = np.flatnonzero(is_new)[np.cumsum(is_new) - 1]
        found = np.zeros(len(chosen), np.bool_)
        found[order] = (first != np.arange(len(order))) & (z - z[first] > room)
        return found

    def _joined(self, chosen: Mask) -> Integers:
        first, second = self._links
        both = chosen[first] & chosen[second]
        return components.least_joined(first[both], second[both], len(chosen))

    def _grown(self, seeds: Mask, allowed: Mask) -> Mask:
        """Return the patches that are connected to seeds, one level per tile."""
        first, second = self._links
        both = allowed[first] & allowed[second]
        first, second = np.append(first[both], second[both]), np.append(second[both], first[both])
        order = np.argsort(first, kind="stable")
        first, second = first[order], second[order]
        claimed = np.full(int(self.tile[-1]) + 1, np.nan)
        grown = np.zeros(len(seeds), np.bool_)
        edge = np.flatnonzero(seeds)
        while len(edge):
            unclaimed = edge[np.isnan(claimed[self.tile[edge]])][::-1]  # the lowest of a tile last
            claimed[self.tile[unclaimed]] = self.patches.z[unclaimed]
            edge = edge[np.abs(self.patches.z[edge] - claimed[self.tile[edge]]) <= self.limits.gap]
            grown[edge] = True
            starts, stops = (np.searchsorted(first, edge, side) for side in ("left", "right"))
            edge = np.unique(second[polygons.enumerated(starts, stops)[1]])
            edge = edge[~grown[edge]]
        return grown

    def floor_from(self, level: int, claim: Claim) -> tuple[Tiles, Patches, Storeys]:
        """Return the floor that continues a level, its patches, and its other storeys."""
        seeds = self.label == level
        allowed = self._connected == self._connected[level]
        main = seeds if (seeds == allowed).all() else self._grown(seeds, allowed)
        elsewhere, patches = np.flatnonzero(allowed & ~main), self.patches
        overlaid = len(np.unique(self.tile[elsewhere])) * self.side**2
        z, labels = patches.z[elsewhere], self.label[elsewhere]
        large = np.flatnonzero(np.bincount(labels) > _LEAST_STOREY * np.count_nonzero(main))
        heights = sorted(median(z[labels == first]) for first in large)
        apart = np.diff(heights, append=np.inf) > self.limits.robot_height  # a slab has two sides
        storeys = tuple(np.array(heights)[apart].tolist())
        for _ in range(_ROUNDS):
            tiles = _raster(patches.chosen(main), self.tile_cells, self.cell, self.limits, claim)
            at = patches.row - tiles.first_row, patches.col - tiles.first_col
            inside = ~main & (at[0] >= 0) & (at[1] >= 0)
            inside &= (at[0] < tiles.z.shape[0]) & (at[1] < tiles.z.shape[1])
            candidates = np.flatnonzero(inside)
            rise = np.abs(patches.z[candidates] - tiles.z[at[0][candidates], at[1][candidates]])
            added = candidates[rise <= self.limits.climb]
            if not len(added):
                break
            main[added] = True
        return tiles, patches.chosen(main), (overlaid, storeys)


class Tiles(NamedTuple):
    """The floor as a plane for each tile of a box; nan where it is unknown."""

    side: int  # of a tile, cells
    cell: float  # metres
    first_row: int
    first_col: int
    z: Floats
    along_x: Floats
    along_y: Floats
    upper: Floats  # height of a second floor within the robot's height, at a ledge; else nan
    away: Floats  # metres to the nearest tile with a patch; inf beyond `_REACH`

    def box(self) -> tuple[int, int, int, int]:
        """Return the first row and column of the cells, and the end row and column."""
        height, width = self.z.shape
        row, col = self.first_row * self.side, self.first_col * self.side
        return row, col, row + height * self.side, col + width * self.side

    def heights(self, rows: Integers, cols: Integers, climb: float) -> Floats:
        height, width = self.z.shape
        own_r, own_c, inside = self.at(rows, cols)
        own = self._plane(rows, cols, own_r, own_c)
        own[~inside] = np.nan
        up, right = (
            (cells - first * self.side) - own * self.side - (self.side - 1) / 2
            for cells, first, own in ((rows, self.first_row, own_r), (cols, self.first_col, own_c))
        )
        down, across = np.where(up >= 0, 1, -1), np.where(right >= 0, 1, -1)
        share_r, share_c = np.abs(up) / self.side, np.abs(right) / self.side
        weights = (1 - share_r) * (1 - share_c)
        total = own * (1 - share_r) * (1 - share_c)
        for step_r, step_c, weight in (
            (down, 0, share_r * (1 - share_c)),
            (0, across, (1 - share_r) * share_c),
            (down, across, share_r * share_c),
        ):
            r, c = np.clip(own_r + step_r, 0, height - 1), np.clip(own_c + step_c, 0, width - 1)
            beside = self._plane(rows, cols, r, c)
            agrees = np.abs(beside - own) <= climb
            total += np.where(agrees, weight * beside, 0.0)
            weights += np.where(agrees, weight, 0.0)
        return np.asarray(total / weights)

    def uppers(self, rows: Integers, cols: Integers) -> Floats:
        """Return the height of the upper floor at ledges, nan elsewhere."""
        r, c, inside = self.at(rows, cols)
        upper = np.where(inside, self.upper[r, c], np.nan)
        at = np.flatnonzero(np.isfinite(upper))
        r, c = r[at], c[at]
        upper[at] += self._plane(rows[at], cols[at], r, c)
        upper[at] -= self.z[r, c]
        return upper

    def slopes(self, rows: Integers, cols: Integers) -> NDArray[np.float32]:
        r, c, inside = self.at(rows, cols)
        rise = np.hypot(self.along_x, self.along_y).astype(np.float32)
        return np.where(inside, rise[r, c], np.float32(np.nan))

    def at(self, rows: Integers, cols: Integers) -> tuple[Integers, Integers, Mask]:
        r, c = rows // self.side - self.first_row, cols // self.side - self.first_col
        height, width = self.z.shape
        inside = (r >= 0) & (r < height) & (c >= 0) & (c < width)
        return np.clip(r, 0, height - 1), np.clip(c, 0, width - 1), inside

    def _plane(self, rows: Integers, cols: Integers, r: Integers, c: Integers) -> Floats:
        middle = (self.side - 1) / 2
        y = (rows - (r + self.first_row) * self.side - middle) * self.cell
        x = (cols - (c + self.first_col) * self.side - middle) * self.cell
        return np.asarray(self.z[r, c] + self.along_x[r, c] * x + self.along_y[r, c] * y)


def tilt_of(patches: Patches, side: float) -> float:
    # A single patch looks level if heights are coarse, so a plane is fitted to all: by least
    # trimmed squares, which ignore ramps, from several start heights, so that one of two levels
    # wins. P. Rousseeuw, "Least median of squares regression", JASA 79, 1984.
    best, tilt = -1, 0.0
    for share in (0.25, 0.5, 0.75):
        along_x, along_y = median(patches.along_x), median(patches.along_y)
        off = _above(patches, along_x, along_y, side)
        off -= np.quantile(off, share)
        for _ in range(_ROUNDS):
            chosen = np.abs(off) <= median(np.abs(off))
            places = (patches.col, patches.row, patches.z)
            x, y, z = (values[chosen] - values[chosen].mean() for values in places)
            xx, xy, yy = (x * x).sum(), (x * y).sum(), (y * y).sum()
            determinant = xx * yy - xy * xy
            if determinant <= _LEAST_SPREAD * (xx + yy) ** 2:
                break  # collinear
            xz, yz = (x * z).sum(), (y * z).sum()
            along_x = float((xz * yy - yz * xy) / determinant / side)
            along_y = float((yz * xx - xz * xy) / determinant / side)
            off = _above(patches, along_x, along_y, side)
            off -= off[chosen].mean()
        count = int(np.count_nonzero(np.abs(off) <= _SAME_PLANE))
        if count > best:
            best, tilt = count, math.atan(math.hypot(along_x, along_y))
    return tilt


def _above(own: Patches, along_x: float, along_y: float, side: float) -> Floats:
    return np.asarray(own.z - side * (along_x * own.col + along_y * own.row))


def _raster(patches: Patches, tile: int, cell: float, limits: Limits, claim: Claim) -> Tiles:
    side = tile * cell
    margin = math.ceil(_REACH / side)
    first_row, first_col = int(patches.row.min()) - margin, int(patches.col.min()) - margin
    height = int(patches.row.max()) + margin + 1 - first_row
    width = int(patches.col.max()) + margin + 1 - first_col
    claim(120 * height * width, f"a floor of {width * side:.0f} x {height * side:.0f} m")
    r, c = patches.row - first_row, patches.col - first_col
    layers = np.full((4, height, width), np.nan)
    # the lowest patch of a tile is written last and counts
    for layer, values in zip(layers, (patches.z, patches.along_x, patches.along_y), strict=False):
        layer[r[::-1], c[::-1]] = values[::-1]
    above = patches.z - layers[0][r, c]
    ledge = (above > limits.gap) & (above <= limits.robot_height)
    layers[3][r[ledge], c[ledge]] = patches.z[ledge]
    lowest, highest = _around(layers, side)
    unknown = np.isnan(layers[0])
    away, near_r, near_c = _nearest(~unknown, margin)
    rows, cols = np.indices((height, width))
    z, along_x, along_y = (layer[near_r, near_c] for layer in layers[:3])
    # planes continue for `_CONTINUED` metres, then horizontally
    share = np.minimum(1.0, _CONTINUED / np.maximum(away * side, _CONTINUED)) * side
    z = z + (along_x * (cols - near_c) + along_y * (rows - near_r)) * share
    z[away * side > _REACH] = np.nan
    flat = away * side > _CONTINUED
    along_x[flat] = along_y[flat] = 0.0
    between = unknown & np.isfinite(lowest)
    z[between] = lowest[between]
    # the upper floor of a ledge extends into neighbouring tiles
    upper = np.fmax(layers[3], highest)
    with np.errstate(invalid="ignore"):
        is_ledge = (upper - z > _LEDGE * limits.gap) & (upper - z <= limits.robot_height)
    upper[~is_ledge] = np.nan
    return Tiles(tile, cell, first_row, first_col, z, along_x, along_y, upper, away * side)


def _nearest(known: Mask, reach: int) -> tuple[Floats, Integers, Integers]:
    # scipy.ndimage could do this, but takes long to import
    height, width = known.shape
    rows, far = np.arange(height)[:, np.newaxis], height + width
    below = np.maximum.accumulate(np.where(known, rows, -far))
    above = np.minimum.accumulate(np.where(known, rows, 2 * far)[::-1])[::-1]
    in_column = np.where(rows - below <= above - rows, below, above)
    squares = (in_column - rows) ** 2
    least, near_c = np.full(known.shape, reach * reach + 1), np.zeros(known.shape, np.int64)
    for across in range(-reach, reach + 1):
        first, last = max(0, -across), width - max(0, across)
        beside = squares[:, first + across : last + across] + across * across
        is_nearer = beside < least[:, first:last]
        np.copyto(least[:, first:last], beside, where=is_nearer)
        np.copyto(near_c[:, first:last], np.arange(first, last) + across, where=is_nearer)
    away = np.where(least <= reach * reach, np.sqrt(least), np.inf)
    return away, np.where(least <= reach * reach, in_column[rows, near_c], 0), near_c


def _around(layers: Floats, side: float) -> tuple[Floats, Floats]:
    """Return the lowest and highest height at each tile's middle by all planes around it."""
    height, width = layers[0].shape
    padded = np.pad(layers[:3], ((0, 0), (1, 1), (1, 1)), constant_values=np.nan)
    lowest, highest = layers[0].copy(), layers[0].copy()
    for down in (-1, 0, 1):
        for across in (-1, 0, 1):
            rows, cols = slice(1 + down, 1 + down + height), slice(1 + across, 1 + across + width)
            z, along_x, along_y = padded[:, rows, cols]
            z = z - (along_x * across + along_y * down) * side
            lowest, highest = np.fmin(lowest, z), np.fmax(highest, z)
    return lowest, highest
