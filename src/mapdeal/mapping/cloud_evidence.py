"""Choice of the floor among the levels of a cloud, by the evidence for and against each level.

A floor is the lowest level that covers a fair share of the area, has things standing on it, and has
only noise below it. A cloud without such a level is refused: the tops of walls, and ceilings, must
not become floors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from mapdeal.errors import MalformedInputError
from mapdeal.grid.values import decimal_text
from mapdeal.kernels.arrays import Floats, Integers, Integers32, Mask
from mapdeal.mapping.cloud_floor import Levels, Limits, Patches, Tiles, patches_of, tilt_of
from mapdeal.mapping.voxels import Claim, Columns, median, starts_of

_HINT = (
    "--floor Z gives the height of a floor that was filtered out; --up -z or --up y turns a cloud "
    "whose z does not point up"
)
_LEAST_STANDING = 0.15  # m2
_STANDING_PER_SIDE = 0.05  # m2 for each metre of a square as large as the level
_SHARE_BELOW, _SHARE_TOUCHING, _SHARE_OF_STANDING = 0.4, 0.2, 0.5
_SHARE_ABOVE = 0.4  # of a level, below which there are points
_TILES_CLOSED = 1.5
_SHARE_INNER, _SHARE_INNER_BARE = 0.6, 0.9  # the latter of a yard, on which nothing stands
_LARGEST_SCAN, _LARGEST_OF_SCAN = 8.0, 2.5  # m2 of single scans, whose floors are scattered
_SHARE_ALONE = 0.8  # of a place without anything on it
_SHARE_OF_AREA, _SHARE_OF_ELSEWHERE, _SHARE_OF_SMALL = 0.12, 0.08, 0.035
_SHARE_SUNKEN, _SHARE_OF_FLOOR = 0.4, 0.8  # the latter of the area: mirroring floors cover more
_LEAST_HANGING, _TIMES_RESTING = 0.2, 0.6  # m2, and times what rests: in rooms it is 0.2
_NEAR, _FEET = 0.05, 0.25  # metres above the clearance: of noise, and of feet that touch
_BESIDE = 0.5  # metres from a level within which things stand on it
_LEVEL_SLOPE = 0.05  # rise over run, against most of a level
_LEAST_VOXELS = 3  # of a tile; fewer are noise
_SAMPLED = 1 << 19  # voxels
_MOST_LEVELS = 6  # levels that are tested
_SHARE_OF_CHOSEN, _STOREY = 0.3, 2.0  # of the chosen level's area; metres
_SHARE_BESIDE, _SHARE_OVER = 0.1, 0.5  # of a level, below which there are points
_SHARE_USED = 0.05  # of a level, on which things stand
_LARGE = 0.1  # of the area of the largest level
_OVER_OTHERS = 0.1  # share of a level that may lie above another level
_TILES_AROUND = 4
_ABOVE = 0.3  # metres of the floor above a pose, which may be that of the robot's base
_BELOW = 3.0  # largest height of a sensor above its floor, metres
_LOWEST_CEILING = 1.5  # metres


class Floor(NamedTuple):
    tiles: Tiles
    spacing: float  # metres between points on it
    tilt: float = 0.0  # radians
    overlaid_m2: float = 0.0  # area with other storeys above it
    storeys: tuple[float, ...] = ()  # heights of other storeys, metres
    may_be_ceiling: bool = False
    is_above_others: bool = False
    is_stated: bool = False  # by the user, so it may lack points


class Evidence(NamedTuple):
    """Evidence about a level: its height, and areas in square metres."""

    height: float
    level: float
    inner: float  # area inside its rim relative to that of a square; tops of walls have none
    standing: float  # with obstacles above the level
    touching: float  # with obstacles that reach down to the level
    below: float  # with points below the level
    hanging: float  # with points just below a ceiling and no point just above the level
    resting: float  # with points just above the level and no point just below a ceiling
    sunken: float  # share of the things around that start well below the level

    @property
    def may_be_ceiling(self) -> bool:
        return self.hanging > max(_LEAST_HANGING, _TIMES_RESTING * self.resting)

    @property
    def is_above_others(self) -> bool:
        return self.below > _SHARE_ABOVE * self.level

    def contradiction(self, area: float) -> str | None:
        """Return the reason why the level cannot be the floor of a cloud of an area, if any."""
        least = max(_LEAST_STANDING, _STANDING_PER_SIDE * math.sqrt(self.level))
        standing = decimal_text(self.standing, 3)
        under = f"{decimal_text(self.below, 3)} m2 of it have points below" if self.below else ""
        is_open = self.inner > _SHARE_INNER and self.level > _SHARE_ALONE * area
        is_open &= self.hanging == 0
        if self.standing < least:
            lacks = f"{under + ' and ' if under else ''}nothing stands on it"
            return None if is_open and self.inner > _SHARE_INNER_BARE and not under else lacks
        least_below = _SHARE_BELOW * self.standing if self.is_above_others else self.standing
        if self.below > least_below:
            return f"{under}, while things stand on {standing} m2"
        if is_open:
            return None
        if self.sunken > _SHARE_SUNKEN and self.level < _SHARE_OF_FLOOR * area:
            share = f"{self.sunken:.0%}"
            return f"{share} of what stands there starts below it; --at X,Y,Z on it takes it"
        is_scan = area <= _LARGEST_SCAN and self.level <= _LARGEST_OF_SCAN
        if self.inner < _SHARE_INNER and not is_scan:
            return "most of it is as narrow as walls"
        if self.touching < _SHARE_TOUCHING * self.standing:
            touching = decimal_text(self.touching, 3)
            return f"only {touching} of {standing} m2 above it reach down to it"
        if self.level < max(_SHARE_OF_STANDING * self.standing, _SHARE_OF_AREA * area):
            points = decimal_text(area, 3)
            return f"things stand on {standing} m2 of it; {points} m2 have points in all"
        # a small level is a floor only if a large share of the other points stands on it
        of_small = 0.0 if is_scan else _SHARE_OF_SMALL * area / self.level
        if self.standing < max(_SHARE_OF_ELSEWHERE, of_small) * (area - self.level):
            elsewhere = decimal_text(area - self.level, 3)
            return f"only {standing} m2 of {elsewhere} m2 elsewhere stand on it"
        return None


def floor_in(
    columns: Columns, tile: int, limits: Limits, places: Floats, at: Floats | None, claim: Claim
) -> Floor:
    patches = patches_of(columns, tile, limits)
    if not len(patches.z):
        rule = "no floor found: no level surface has room above it"
        raise MalformedInputError(rule, hint=f"{_HINT}; --level turns a tilted one")
    claim(400 * len(patches.z), f"{len(patches.z)} patches of surfaces")
    levels = Levels(patches, tile, columns.cell, limits)
    every = math.ceil(len(columns.heights) / _SAMPLED)  # of rows of tiles
    sample = columns.chosen(columns.row // tile % every == 0)
    tiles_with_points = starts_of(np.sort((sample.row // tile << 32) + sample.col // tile))
    area = len(tiles_with_points) * every * levels.side**2
    named = _level_under(levels, places if at is None else at[np.newaxis])
    if at is not None and named is None:
        rule = f"no level is at or below {at[2]:g} m there"
        raise MalformedInputError(rule, place="--at", got=",".join(f"{number:g}" for number in at))
    refusals = []
    for level in _in_order(levels, named):
        tiles, own, above = levels.floor_from(level, claim)
        evidence, spacing = _evidence_of(sample, every, tiles, own, limits)
        known = evidence._replace(below=0.0) if at is not None or level == named else evidence
        reason = None if at is not None else known.contradiction(area)
        if reason is None:
            tilt = tilt_of(own, levels.side)
            overlaid, storeys = above
            floors = _other_floors(levels, level, sample, every, claim, evidence.height)
            return Floor(
                tiles, spacing, tilt, overlaid, (*storeys, *floors), evidence.may_be_ceiling,
                evidence.is_above_others,
            )  # fmt: skip
        size = decimal_text(evidence.level, 3)
        refusals.append(f"the level at {evidence.height:.2f} m has {size} m2, {reason}")
    raise MalformedInputError(f"no floor found: {'; '.join(refusals[:2])}", hint=_HINT)


def _other_floors(
    levels: Levels, chosen: int, sample: Columns, every: int, claim: Claim, height: float
) -> Iterator[float]:
    """Yield the heights of large levels, not joined to the chosen one, that things stand on."""
    area = levels.area()
    for level in _in_order(levels, None):
        if area[level] < _SHARE_OF_CHOSEN * area[chosen] or levels.are_joined(level, chosen):
            continue
        tiles, own, _ = levels.floor_from(level, claim)
        evidence, _ = _evidence_of(sample, every, tiles, own, levels.limits)
        if abs(evidence.height - height) > _STOREY:  # its own walls start on the storey below
            evidence = evidence._replace(sunken=0.0)
        is_beside = evidence.below < _SHARE_BESIDE * evidence.level
        is_over = evidence.below > _SHARE_OVER * evidence.level  # between them are ceilings
        evidence = evidence._replace(below=0.0)
        is_large = evidence.level > _LARGEST_SCAN
        is_used = evidence.standing > _SHARE_USED * evidence.level
        is_floor = is_large and is_used and evidence.contradiction(evidence.level) is None
        if is_floor and (is_beside or is_over):
            yield evidence.height


def stated_floor(columns: Columns, tile: int, height: float, claim: Claim) -> Floor:
    row, col = columns.row // tile, columns.col // tile
    shape = int(row.max() - row.min()) + 1, int(col.max() - col.min()) + 1
    claim(60 * shape[0] * shape[1], f"a floor of {shape[1]} x {shape[0]} tiles")
    level, unknown = np.zeros(shape), np.full(shape, np.nan)
    at = tile, columns.cell, int(row.min()), int(col.min())
    return Floor(Tiles(*at, level + height, level, level, unknown, level), 0.0, is_stated=True)


def _in_order(levels: Levels, named: int | None) -> Iterator[int]:
    if named is not None:
        yield named
    area = levels.area()
    # ceilings, and upper storeys, have a large level below them; patches are in order of height
    large = np.flatnonzero((area >= _LARGE * area.max())[levels.label])
    is_new = np.diff(levels.tile[large], prepend=-1) != 0
    lowest = levels.label[large][np.flatnonzero(is_new)][np.cumsum(is_new) - 1]
    upper = large[lowest != levels.label[large]]
    above = np.bincount(levels.label[upper], minlength=len(area)) * levels.side**2
    is_ground = above <= _OVER_OTHERS * area
    likely = np.flatnonzero(area >= _LARGE * area.max())
    order = likely[np.lexsort((-area[likely], ~is_ground[likely]))].tolist()
    yield from (level for level in order[:_MOST_LEVELS] if level != named)


def _level_under(levels: Levels, places: Floats) -> int | None:
    patches, area, votes = levels.patches, levels.area(), np.zeros(len(levels.label))
    for x, y, z in places.tolist():
        near = np.abs(patches.row + 0.5 - y / levels.side) <= _TILES_AROUND
        near &= np.abs(patches.col + 0.5 - x / levels.side) <= _TILES_AROUND
        near &= (patches.z <= z + _ABOVE) & (patches.z >= z - _BELOW)
        under = np.flatnonzero(near)
        if len(under):  # of large levels alone, without tables
            under = under[area[levels.label[under]] >= _LARGE * area[levels.label[under]].max()]
            votes[levels.label[under[patches.z[under].argmax()]]] += 1
    return int(votes.argmax()) if votes.any() else None


def _evidence_of(
    sample: Columns, every: int, tiles: Tiles, own: Patches, limits: Limits
) -> tuple[Evidence, float]:
    """Measure a level, and the distance between points on it in metres."""
    row, col, inside = tiles.at(sample.row, sample.col)
    sunken = _sunken(sample.chosen(inside), tiles, limits)
    near = inside & (tiles.away[row, col] <= _BESIDE)
    sample, whose = sample.chosen(near), (row * tiles.z.shape[1] + col)[near]
    floor = tiles.heights(sample.row, sample.col, limits.climb)
    heights, count = sample.above(floor), tiles.z.size

    def count_in(chosen: Mask, weights: Integers32 | None = None) -> Floats:
        found = chosen if weights is None else chosen * weights
        if not len(sample.starts):
            return np.zeros(count)
        sums = np.add.reduceat(found, sample.starts, dtype=np.int64)
        return np.asarray(np.bincount(whose, sums, count), dtype=np.float64)

    low, side = limits.gap + _NEAR, tiles.side * tiles.cell
    is_high = (heights > low) & (heights <= limits.robot_height)
    standing = count_in(is_high) >= _LEAST_VOXELS
    touching = standing & (count_in(is_high & (heights <= low + _FEET + limits.steps)) > 0)
    # closes gaps of a sparse floor and excludes its rim
    is_near = np.pad(tiles.away <= _TILES_CLOSED * side, 2)
    closed = np.lib.stride_tricks.sliding_window_view(is_near, (5, 5))
    tile_count = len(starts_of(np.sort((own.row << 32) + own.col)))
    inner = closed.all(axis=(2, 3)).sum() / max(1.0, math.sqrt(tile_count) - 2) ** 2
    is_own = tiles.away == 0
    if inner >= _SHARE_INNER:  # ramps of a floor may lie above it
        along = tiles.along_x - median(own.along_x), tiles.along_y - median(own.along_y)
        is_own &= np.hypot(*along) < _LEVEL_SLOPE
    below = (count_in(heights < -low) >= _LEAST_VOXELS) & is_own.ravel()
    hanging, resting = _hanging(sample, whose, heights, count_in, low, limits.robot_height)
    found = (standing, touching, below, hanging, resting)
    areas = [int(np.count_nonzero(tiles_with)) * every * side**2 for tiles_with in found]
    is_open = (tiles.away.ravel() <= _BESIDE) & ~standing
    on_level = count_in(np.abs(heights) <= low, sample.counts)[is_open].sum()
    spacing = side * math.sqrt(is_open.sum() / every / max(on_level, 1.0))
    measures = median(own.z), tile_count * side**2, float(inner), *areas, sunken
    return Evidence(*measures), spacing


def _sunken(columns: Columns, tiles: Tiles, limits: Limits) -> float:
    """Return the share of columns with things at a robot's height that start below the level."""
    floor = tiles.heights(columns.row, columns.col, limits.climb)
    heights, low = columns.above(floor), limits.gap + _NEAR
    is_high = (heights > low) & (heights <= limits.robot_height)
    if not is_high.any():
        return 0.0
    is_tall = np.logical_or.reduceat(is_high, columns.starts)
    return float(np.mean(heights[columns.starts][is_tall] < -low - _NEAR))


def _hanging(
    sample: Columns, whose: Integers, heights: Floats, count_in: Callable[[Mask], Floats],
    low: float, room: float,
) -> tuple[Mask, Mask]:  # fmt: skip
    """Return which tiles have things at the ceiling alone, and on the level alone."""
    # in an upside-down cloud, furniture seems to hang from the ceiling
    tops = np.full(len(count_in(heights > 0)), -np.inf)
    if len(sample.starts):
        np.maximum.at(tops, whose, heights[sample.starts + sample.lengths() - 1])
    there = tops[np.isfinite(tops)]
    ceiling = median(there) if len(there) else 0.0
    if ceiling < _LOWEST_CEILING or np.mean(np.abs(there - ceiling) < _FEET) < 0.5:
        nowhere = np.zeros(len(tops), np.bool_)
        return nowhere, nowhere
    room = min(room, ceiling / 2)
    own = tops[whose]
    own[(own < ceiling - room) | (own >= ceiling + _FEET)] = np.inf  # of other storeys
    down = np.repeat(own, sample.lengths()) - heights  # from the ceiling at that place

    def touches_alone(gaps: Floats, opposite: Floats) -> Mask:
        near: Mask = count_in((gaps > low) & (gaps <= low + _FEET)) >= _LEAST_VOXELS
        return np.asarray(near & (count_in((opposite > low) & (opposite <= room / 2)) == 0))

    return touches_alone(down, heights), touches_alone(heights, down)
