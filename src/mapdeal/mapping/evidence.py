"""Occupancy from the evidence of beams: log-odds, counts, and truncated signed distances."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from itertools import pairwise, product
from operator import add
from typing import Annotated, NamedTuple

import numpy as np

from mapdeal.command import CELLS, Condition, Words
from mapdeal.errors import ParameterError, require
from mapdeal.grid.frame import FARTHEST, Frame, Region, as_numbers
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN, OneLineRepr, count_text
from mapdeal.kernels import components, distance, polygons, rotations, sensing, skeleton
from mapdeal.kernels.arrays import Array, Floats, Integers, Mask, SignedBytes
from mapdeal.records import astuple, dataclass

_LEVEL = 1e-6  # radians: of 30 m, 30 micrometres
MOST_LEANING = math.radians(10)
"""Largest lean of a sensor, radians: beyond, its hits are too far from the robot's height."""
FARTHEST_POSE = FARTHEST / 10  # metres; beams may reach farther
_BEAMS_AT_ONCE = 1 << 18
OFTEN = sensing.MOST_HITS  # least hits of a cell that count: fewer may be noise
LEAST_CELLS = 3  # least cells of a group: fewer may be passers-by
NEAR = 2
"""Cells along both axes within which an occupied cell accounts for a hit."""
Layers = dict[str, Array]
_UNIT = 1 << 16
"""Fixed-point value of an evidence of 1: integer sums are exact in any order."""
_EVEN, _FAR = 50, 1000
_PASSED = Condition("below 0, at least -100", lambda v: -100 * _UNIT <= _fixed_point(v) < 0)
_HIT = Condition("above 0, at most 100", lambda v: 0 < _fixed_point(v) <= 100 * _UNIT)
_LEAST = Condition("at least 0, below 50", lambda v: 0 <= _fixed_point(v) < _EVEN * _UNIT)
_MOST = Condition("above 50, at most 100", lambda v: 50 < _fixed_point(v) / _UNIT <= 100)
_COUNT_UNIT = 1_000_000
_SHARE = Condition("at least 0, below 1", lambda value: 0 <= value < 1)
_FARTHEST = 1000.0  # largest truncation distance, and reach of beams behind hits, in cells
_TRUNCATION = Condition(f"1 to {_FARTHEST:g}", lambda value: 1 <= value <= _FARTHEST)
_Truncation = Annotated[float, _TRUNCATION, CELLS]


@dataclass(frozen=True, eq=False)
class Stances:
    poses: Floats
    is_flipped: Mask
    is_level: Mask
    leans: Mask


def stances(translations: Floats, quaternions: Floats) -> Stances:
    ahead = rotations.rotated(quaternions, np.array([1.0, 0.0, 0.0]))
    up = rotations.rotated(quaternions, np.array([0.0, 0.0, 1.0]))
    aside = np.hypot(up[:, 0], up[:, 1])
    poses = np.column_stack([translations[:, :2], np.arctan2(ahead[:, 1], ahead[:, 0])])
    return Stances(poses, up[:, 2] < 0, aside < _LEVEL, aside > math.sin(MOST_LEANING))


def beams_in_plane(quaternions: Floats, angles: Floats) -> tuple[Floats, Floats]:
    """Return the angles of beams in the plane, and the share of their length in it."""
    beams = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)
    turned = rotations.rotated(quaternions, beams)
    shares = np.minimum(np.hypot(turned[:, 0], turned[:, 1]), 1.0)
    return np.arctan2(turned[:, 1], turned[:, 0]), shares


@dataclass(frozen=True, eq=False, repr=False)
class Scans(OneLineRepr):
    """Laser scans that share the same beam angles.

    Parameters
    ----------
    poses : array_like of float, shape (N, 3)
        x, y (metres) and yaw (radians) of the sensor in the map frame, one pose per scan.
    angles : array_like of float, shape (M,)
        Angles of the beams from the sensor's heading, in any order, anticlockwise, radians.
    ranges : array_like of float, shape (N, M)
        Measured ranges, metres; inf for a beam without return, nan for an invalid beam.
    sweeps : int, optional
        Number of scans to count if every beam has its own pose; one per pose by default.

    Raises
    ------
    ParameterError
        If the shapes differ, or a pose or angle is not finite.
    """

    poses: Floats
    angles: Floats
    ranges: Floats
    sweeps: int | None = None

    def __post_init__(self) -> None:
        names = ("poses", "angles", "ranges")
        poses, angles, ranges = (_floats(getattr(self, name), name) for name in names)
        if poses.ndim != 2 or poses.shape[1] != 3:
            raise ParameterError("must be an array of shape (N, 3)", place="poses", got=poses.shape)
        require(angles.ndim == 1, "must be an array of shape (M,)", "angles", got=angles.shape)
        rule = f"must be an array of shape {(len(poses), len(angles))}"
        require(ranges.shape == (len(poses), len(angles)), rule, "ranges", got=ranges.shape)
        for name, array in (("poses", poses), ("angles", angles), ("ranges", ranges)):
            if name != "ranges" and not (np.abs(array) <= FARTHEST_POSE).all():  # refuses nan too
                raise ParameterError(f"must be finite and within {FARTHEST_POSE:g}", place=name)
            object.__setattr__(self, name, array)

    def _repr_parts(self) -> Iterator[str]:
        yield count_text(len(self.poses), "scan")
        yield count_text(len(self.angles), "beam") + " each"

    @property
    def count(self) -> int:
        """Number of scans."""
        return len(self.poses) if self.sweeps is None else self.sweeps

    def parts(self) -> Iterator[Scans]:
        """Yield the scans in parts, so that arrays made from them stay small."""
        scans_at_once = max(1, _BEAMS_AT_ONCE // max(1, len(self.angles)))
        for first in range(0, len(self.poses), scans_at_once):
            part = slice(first, first + scans_at_once)
            sweeps = self.sweeps if first == 0 or self.sweeps is None else 0
            yield Scans(self.poses[part], self.angles, self.ranges[part], sweeps)


@dataclass(frozen=True)
class BeamLimits:
    """Limits that decide which ranges are hits.

    Parameters
    ----------
    range_min, range_max : float
        A beam is a hit if its range is positive and range_min <= range < range_max, metres. A
        beam of range_max or more, or inf, has no return; all others are invalid.
    clear_max : float
        Distance, at most range_max, up to which a beam without return clears cells, metres.

    Raises
    ------
    ParameterError
        If a number is negative or not finite, or range_max is at most range_min.

    References
    ----------
    gmapping's ``maxRange`` (range_max), at which nothing is hit, and ``maxUrange`` (clear_max).
    """

    range_min: float = 0.0
    range_max: float = 30.0
    clear_max: float = 0.0

    def __post_init__(self) -> None:
        for name in ("range_min", "range_max", "clear_max"):
            numbers = as_numbers([getattr(self, name)])
            require(bool(numbers), "must be a number", name, got=getattr(self, name))
            is_length = 0 <= numbers[0] <= FARTHEST_POSE  # refuses nan too
            require(is_length, "must be a finite number, at least 0", name, got=numbers[0])
            object.__setattr__(self, name, numbers[0])
        rule = f"must be above range_min, {self.range_min:g}"
        require(self.range_max > self.range_min, rule, "range_max", got=self.range_max)


@dataclass(frozen=True)
class BeamCounts:
    scans: int = 0
    beams: int = 0
    hits: int = 0
    no_return: int = 0
    bad: int = 0

    def __add__(self, other: BeamCounts) -> BeamCounts:
        return BeamCounts(*map(add, astuple(self), astuple(other)))


@dataclass(frozen=True, eq=False)
class Beams:
    """Beams that hit something or clear cells, in the order of their scans."""

    sensors_xy: Floats
    directions_xy: Floats
    ranges: Floats
    is_hit: Mask
    counts: BeamCounts

    @property
    def nbytes(self) -> int:
        arrays = self.sensors_xy, self.directions_xy, self.ranges, self.is_hit
        return sum(array.nbytes for array in arrays)

    def chosen(self, mask: Mask) -> Beams:
        places = self.sensors_xy[mask], self.directions_xy[mask], self.ranges[mask]
        return Beams(*places, self.is_hit[mask], self.counts)

    def ends_xy(self, beyond: float = 0.0) -> Floats:
        reach = self.ranges + np.where(self.is_hit, beyond, 0.0)
        return self.sensors_xy + self.directions_xy * reach[:, np.newaxis]


def _floats(array: object, name: str) -> Floats:
    try:
        return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError):
        raise ParameterError("must be an array of numbers", place=name) from None


def beams_of(scans: Scans, limits: BeamLimits) -> Beams:
    ranges = scans.ranges
    with np.errstate(invalid="ignore"):
        is_hit = (ranges > 0) & (ranges >= limits.range_min) & (ranges < limits.range_max)
        is_open = ranges >= limits.range_max
    used = is_hit | is_open if limits.clear_max > 0 else is_hit
    angle = (scans.poses[:, 2:] + scans.angles)[used]
    hits, no_return = int(np.count_nonzero(is_hit)), int(np.count_nonzero(is_open))
    counts = BeamCounts(scans.count, ranges.size, hits, no_return, ranges.size - hits - no_return)
    hit, directions = is_hit[used], np.empty((len(angle), 2))
    directions[:, 0], directions[:, 1] = np.cos(angle), np.sin(angle)
    sensors = np.repeat(scans.poses[:, :2], np.count_nonzero(used, axis=1), axis=0)
    reach = np.where(hit, ranges[used], min(limits.clear_max, limits.range_max))
    return Beams(sensors, directions, reach, hit, counts)


@dataclass(frozen=True, eq=False, repr=False)
class HitGroups(OneLineRepr):
    """Groups of touching cells, the largest first."""

    cells: Integers
    sizes: Integers

    def _repr_parts(self) -> Iterator[str]:
        yield count_text(len(self), "group")
        yield count_text(len(self.cells), "cell")

    def __len__(self) -> int:
        return len(self.sizes)

    @property
    def starts(self) -> Integers:
        return np.cumsum(self.sizes) - self.sizes

    def middles_xy(self, frame: Frame) -> Floats:
        """Return the mean cell centre of each group in the map frame, shape (M, 2), metres."""
        if not len(self):
            return np.empty((0, 2))
        means = np.add.reduceat(self.cells, self.starts, axis=0) / self.sizes[:, np.newaxis]
        return frame.xy_from_continuous_rowcol(means + 0.5)


def hit_groups(often_hit: Mask) -> HitGroups:
    return _largest_groups(*components.touching_groups(often_hit))


def vanished_groups(often_hit: Mask, occupied: Mask) -> HitGroups:
    # such cells are few, so their neighbourhoods are tested one by one
    candidates_flat = np.flatnonzero(often_hit & ~occupied)
    candidates = np.stack(np.divmod(candidates_flat, occupied.shape[1]), axis=1)
    lost = np.zeros(occupied.shape, dtype=np.bool_)
    lost.reshape(-1)[candidates_flat[~_has_within(occupied, candidates, NEAR)]] = True
    cells, groups = components.touching_groups(lost)
    is_kept = np.zeros(len(cells), dtype=np.bool_)  # groups that continue in cells of the map
    is_kept[groups[_has_within(often_hit & ~lost, cells, 1)]] = True
    is_lost = ~is_kept[groups]
    return _largest_groups(cells[is_lost], groups[is_lost])


def _has_within(marked: Mask, cells: Integers, reach: int) -> Mask:
    found = np.zeros(len(cells), dtype=np.bool_)
    for step in product(range(-reach, reach + 1), repeat=2):
        found |= marked[tuple(np.clip(cells + step, 0, np.array(marked.shape) - 1).T)]
    return found


def _largest_groups(cells: Integers, groups: Integers) -> HitGroups:
    sizes = np.bincount(groups)
    numbers = np.flatnonzero(sizes >= LEAST_CELLS)
    numbers = numbers[np.argsort(-sizes[numbers], kind="stable")]
    place = np.full(len(sizes), len(sizes))
    place[numbers] = np.arange(len(numbers))
    order = np.argsort(place[groups], kind="stable")[: sizes[numbers].sum()]
    return HitGroups(cells[order], sizes[numbers])


class Evidence(ABC):
    reach_behind = 0.0  # distance behind hits up to which beams have an effect, cells

    def __init__(self, frame: Frame) -> None:
        self.frame = frame

    @property
    def bytes_per_cell(self) -> int:
        return sum(v.itemsize for v in vars(self).values() if isinstance(v, np.ndarray))

    @abstractmethod
    def add(self, beams: Beams) -> None:
        """Add the evidence of beams, in order; beams that leave the grid count inside it."""

    @abstractmethod
    def occupancy(self) -> SignedBytes:
        """Return the map of the evidence so far, shape (H, W): -1, 0..100."""

    @abstractmethod
    def often_hit(self) -> Mask:
        """Return which cells `OFTEN` or more beams have hit, shape (H, W); see `hit_groups`."""

    @abstractmethod
    def layers(self) -> Layers:
        """Return the layers of evidence by their keys in an npz."""

    @abstractmethod
    def advice(self, vanished: HitGroups) -> str:
        """Return advice on how to keep the vanished groups of hits on the map."""

    def vanished_from(self, grid: OccupancyGrid) -> HitGroups:
        return vanished_groups(self.often_hit(), grid.occupancy == OCCUPIED)

    def grid(self) -> OccupancyGrid:
        return OccupancyGrid(self.occupancy(), self.frame.resolution, self.frame.origin)

    def cells_of(self, beams: Beams, beyond: float = 0.0) -> tuple[Beams, Integers, Integers]:
        """Return beams with the cells, shape (K, 2), that they begin and end in."""
        # The cells may lie outside of the grid. Beams more than 2^30 cells away are left out: they
        # cannot reach it, and would overflow 64-bit integers.
        starts = self.frame.unbounded_rowcol_from_xy(beams.sensors_xy)
        ends = self.frame.unbounded_rowcol_from_xy(beams.ends_xy(beyond))
        near = (np.abs(starts) <= polygons.FARTHEST_CELL) & (np.abs(ends) <= polygons.FARTHEST_CELL)
        is_near = near[:, 0] & near[:, 1]
        if is_near.all():
            return beams, starts, ends
        return beams.chosen(is_near), starts[is_near], ends[is_near]


def _fixed_point(value: float) -> int:
    return round(max(-_FAR, min(value, _FAR)) * _UNIT)


class LogOdds(Evidence):
    """Evidence as one number per cell, which starts at 50.

    Parameters
    ----------
    log_free : float
        Added where a beam passes.
    log_occ : float
        Added where a beam ends.
    log_min : float
        Lower bound.
    log_max : float
        Upper bound.
    values : bool
        Write the values instead of free and occupied.

    References
    ----------
    H. Moravec and A. Elfes, "High Resolution Maps from Wide Angle Sonar", 1985, which sums
    logarithms of odds. Here, a beam does not pass the cell that it hits.
    """

    def __init__(
        self, frame: Frame, *, log_free: Annotated[float, _PASSED, Words("V")] = -1.0,
        log_occ: Annotated[float, _HIT, Words("V")] = 2.0,
        log_min: Annotated[float, _LEAST, Words("V")] = 0.0,
        log_max: Annotated[float, _MOST, Words("V")] = 100.0, values: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(frame)
        self._odds = sensing.Odds(*map(_fixed_point, (log_free, log_occ, log_min, log_max)))
        self._publish_values = values
        self._values = np.full(frame.shape, _EVEN * _UNIT, dtype=np.int32)
        self._beam_marks = np.zeros(frame.shape, dtype=np.uint8)

    def add(self, beams: Beams) -> None:
        beams, starts, ends = self.cells_of(beams)
        sensing.weigh_rays(starts, ends, beams.is_hit, self._odds, self._values, self._beam_marks)

    def occupancy(self) -> SignedBytes:
        if self._publish_values:
            rounded = np.rint(self._values / _UNIT).astype(np.int8)
        else:
            rounded = np.full(self.frame.shape, UNKNOWN, dtype=np.int8)
            rounded[self._values < _EVEN * _UNIT] = FREE
            rounded[self._values > _EVEN * _UNIT] = OCCUPIED
        rounded[self._beam_marks == 0] = UNKNOWN
        return rounded

    def often_hit(self) -> Mask:
        return self._beam_marks >= sensing.OBSERVED + OFTEN * sensing.A_HIT

    def vanished_from(self, grid: OccupancyGrid) -> HitGroups:
        if self._publish_values:
            return HitGroups(np.empty((0, 2), dtype=np.int64), np.empty(0, dtype=np.int64))
        return super().vanished_from(grid)

    def advice(self, vanished: HitGroups) -> str:
        now = self._odds.on_hit / _UNIT
        more, all_ = ("may keep it", "its") if len(vanished) == 1 else ("keeps more", "their")
        return f"--log-occ above {now:g} {more}, --values keeps {all_} evidence"

    def layers(self) -> Layers:
        return {"log_odds": np.where(self._beam_marks > 0, self._values / _UNIT, np.nan)}


class Counting(Evidence):
    """Evidence as counts of hits and passes of each cell.

    Parameters
    ----------
    ratio : float
        Share of hits above which a cell is occupied.

    References
    ----------
    gmapping's ``PointAccumulator``. As there, a cell that beams have reached is either occupied or
    free.
    """

    def __init__(self, frame: Frame, *, ratio: Annotated[float, _SHARE, Words("R")] = 0.3) -> None:
        super().__init__(frame)
        self._ratio = round(ratio * _COUNT_UNIT)
        self._hits, self._misses = np.zeros((2, *frame.shape), dtype=np.int32)

    def add(self, beams: Beams) -> None:
        beams, starts, ends = self.cells_of(beams)
        sensing.count_rays(starts, ends, beams.is_hit, self._hits, self._misses)

    def occupancy(self) -> SignedBytes:
        values = np.where(self._is_mostly_hit(), np.int8(OCCUPIED), np.int8(FREE))
        values[self._hits + self._misses == 0] = UNKNOWN
        return values

    def _is_mostly_hit(self) -> Mask:
        # in integers, because rounding could lift a share above the ratio
        hits = self._hits.astype(np.int64)
        return hits * _COUNT_UNIT > (hits + self._misses) * self._ratio

    def often_hit(self) -> Mask:
        return self._hits >= OFTEN

    def advice(self, vanished: HitGroups) -> str:
        at = tuple(vanished.cells.T)
        hits = self._hits[at].astype(np.int64)
        # the largest whole percentage below each cell's share of hits
        percent = (100 * hits - 1) // (hits + self._misses[at])
        most = np.maximum.reduceat(percent, vanished.starts).min()
        which = "it" if len(vanished) == 1 else "all of them"
        return f"--ratio {most / 100:g} keeps {which}"

    def layers(self) -> Layers:
        return {"hits": self._hits, "misses": self._misses}


class Crossings(NamedTuple):
    """Neighbours with different signs, as flat indices, and cells that are exactly zero."""

    first: Integers
    second: Integers
    at_zero: Mask
    field: Floats

    def places(self) -> Floats:
        """Return the zeros of the field, linear between centres, as rows and columns, (N, 2)."""
        near, far = (self.field.reshape(-1)[cells] for cells in (self.first, self.second))
        pairs = np.unravel_index([self.first, self.second], self.field.shape)
        first, second = np.stack(pairs, axis=-1)
        back = near / (near - far) - 1.0  # from the second cell's centre
        between = second + 0.5 + (second - first) * back[:, np.newaxis]
        return np.concatenate([np.argwhere(self.at_zero) + 0.5, between])


def crossings_of(field: Floats) -> Crossings:
    with np.errstate(invalid="ignore"):
        positive, negative = field > 0, field < 0
    width, pairs = field.shape[1], []
    for step, first, second in (1, np.s_[:, :-1], np.s_[:, 1:]), (width, np.s_[:-1], np.s_[1:]):
        changes = positive[first] & negative[second] | negative[first] & positive[second]
        cells = np.ravel_multi_index(np.nonzero(changes), field.shape)
        pairs.append([cells, cells + step])
    first_cells, second_cells = np.concatenate(pairs, axis=1)
    return Crossings(first_cells, second_cells, field == 0, field)


def thin_surface(field: Floats, crossings: Crossings) -> Mask:
    """Return a thin wall of cells without gaps between positive and negative cells."""
    # At each sign change at least one cell of the pair is chosen: the one nearer to zero. A cell is
    # spare if all its partners are chosen, too; spare cells are removed, the farthest from zero
    # first.
    first, second = crossings.first, crossings.second
    size, chosen = np.abs(field), crossings.at_zero.copy()
    sizes, is_chosen = size.reshape(-1), chosen.reshape(-1)
    # of equal cells the one behind the surface, so that free space stays
    is_behind = (sizes[first] == sizes[second]) & (field.reshape(-1)[first] < 0)
    is_chosen[np.where((sizes[first] < sizes[second]) | is_behind, first, second)] = True
    cells, partners = np.append(first, second), np.append(second, first)
    is_needed = np.zeros_like(is_chosen)  # whether a partner is not chosen
    is_needed[cells[~is_chosen[partners]]] = True
    pairs = np.flatnonzero(is_chosen[cells] & ~is_needed[cells])
    pairs = pairs[np.lexsort((cells[pairs], -sizes[cells[pairs]]))]
    spare, beside = cells[pairs], partners[pairs].tolist()
    bounds = [*np.flatnonzero(np.diff(spare, prepend=-1)).tolist(), len(spare)]
    for begin, end in pairwise(bounds):
        if all(map(is_chosen.item, beside[begin:end])):
            is_chosen[spare[begin]] = False
    thin_blocks(chosen, size)
    return chosen


def thin_blocks(chosen: Mask, size: Floats) -> None:
    """Remove, in place, cells of 2 x 2 blocks that the wall's connectivity does not need."""
    # Noise makes such blocks where the sign alternates. Cells far from zero are removed first.
    padded = np.pad(chosen, 1)
    blocks = padded[1:, 1:] & padded[1:, :-1] & padded[:-1, 1:] & padded[:-1, :-1]
    cells = np.argwhere(blocks[1:, 1:] | blocks[1:, :-1] | blocks[:-1, 1:] | blocks[:-1, :-1])
    for index in np.argsort(-size[tuple(cells.T)], kind="stable").tolist():
        row, col = cells[index].tolist()
        # A cell's neighbours stay 8-connected without it if Yokoi's connectivity number is 1. The
        # cell is in a block if three consecutive neighbours, the middle one diagonal, are set.
        ring = [bool(padded[row + 1 + y, col + 1 + x]) for y, x in skeleton.RING]
        corners = [(ring[k], ring[k + 1], ring[(k + 2) % 8]) for k in (0, 2, 4, 6)]
        number = sum(not first and (middle or last) for first, middle, last in corners)
        if number == 1 and any(map(all, corners)):
            padded[row + 1, col + 1] = chosen[row, col] = False


class Tsdf(Counting):
    """Evidence as the mean signed distance of each cell to the hits along the beams.

    Parameters
    ----------
    truncation : float
        Truncation distance, cells.
    truncation_behind : float
        How far beams continue behind a hit, in truncation distances.

    Notes
    -----
    The distance is the range of the beam minus the distance from the sensor to the cell's centre:
    positive in front of a hit. All beams weigh the same. Cells more than a truncation behind a hit
    count as -1: the space behind a thinner wall becomes solid, unless beams from there outweigh it.
    A cell is occupied if the field changes sign between it and a neighbour in its row or column,
    beams have reached both, and it is the one nearer to zero; such walls are thinned to one cell.
    Other cells are free where the field is positive, and unknown elsewhere.

    Around an obstacle thinner than about a cell that is seen from several sides, each side pushes
    its free space through it, and the field is positive. So free cells that more than three in ten
    of their beams hit are occupied as well, unless a neighbouring cell belongs to the surface.

    References
    ----------
    B. Curless and M. Levoy, "A Volumetric Method for Building Complex Models from Range Images",
    1996.
    """

    def __init__(
        self, frame: Frame, *, truncation: _Truncation = 2.0,
        truncation_behind: Annotated[float, Words("N")] = 1.0,
    ) -> None:  # fmt: skip
        super().__init__(frame)
        self._truncation, self._behind = truncation, truncation_behind
        self.reach_behind = truncation * truncation_behind
        least = 1 / truncation
        most = _FARTHEST / truncation
        rule = f"must be {least:.6g} to {most:.6g} truncations: 1 to {_FARTHEST:g} cells"
        is_cells = 1 <= self.reach_behind <= _FARTHEST
        require(is_cells, rule, "truncation_behind", got=truncation_behind)
        self._sums: Array = np.zeros(frame.shape, dtype=np.int64)
        self._weights = np.zeros(frame.shape, dtype=np.int32)

    def add(self, beams: Beams) -> None:
        near, starts, ends = self.cells_of(beams)
        sensing.count_rays(starts, ends, near.is_hit, self._hits, self._misses)
        near, starts, ends = self.cells_of(beams, self.reach_behind * self.frame.resolution)
        sensors = self.frame.continuous_rowcol_from_xy(near.sensors_xy)
        ranges = np.where(near.is_hit, near.ranges / self.frame.resolution, np.inf)
        limits = self._truncation, self._behind
        sensing.measure_rays(starts, ends, sensors, ranges, *limits, self._sums, self._weights)

    def occupancy(self) -> SignedBytes:
        values = np.full(self.frame.shape, UNKNOWN, dtype=np.int8)
        values[self._sums > 0] = FREE
        field = self._field()
        surface = thin_surface(field, crossings_of(field))
        values[surface] = OCCUPIED
        thin = (values == FREE) & self._is_mostly_hit() & ~distance.dilate_square(surface, 1)
        thin_blocks(thin, field)
        values[thin] = OCCUPIED
        return values

    def advice(self, vanished: HitGroups) -> str:
        which = "it" if len(vanished) == 1 else "them"
        return f"--method counting with a small --ratio keeps {which}"

    def layers(self) -> Layers:
        # ``tsdf``: shares of the truncation, -1..1, nan where no beam has been; ``surface``: x and
        # y in the map frame where the field, interpolated between two neighbours, is zero
        field = self._field()
        surface = self.frame.xy_from_continuous_rowcol(crossings_of(field).places())
        return {"tsdf": field.astype(np.float32), "weight": self._weights, "surface": surface}

    def _field(self) -> Floats:
        with np.errstate(invalid="ignore"):
            field: Floats = self._sums / (self._weights * float(sensing.DISTANCE_UNIT))
        return field


class TsdfAsWritten(Tsdf):
    """`Tsdf` with the rules of design document 004, to compare maps with its author's.

    Notes
    -----
    The distance is the range of the beam minus the distance from the centre of the sensor's cell to
    that of the cell, and counts all along the beam; the last cell of the line does not count. Hits
    outside the grid are left out, and beams that would end outside end at their hit. Of two
    neighbours of different sign the one nearer to zero is occupied, and everything else is unknown.
    The document's search from cell (0, 0) compares each cell with the one it was reached from: the
    one below it, or in row 0 that to its left. Where the sign changes along another row, there is
    no wall.
    """

    def __init__(
        self, frame: Frame, *, truncation: _Truncation = 2.0, truncation_behind: float = 3.0
    ) -> None:
        super().__init__(frame, truncation=truncation, truncation_behind=truncation_behind)
        self._sums = np.zeros(frame.shape)  # means

    def add(self, beams: Beams) -> None:
        resolution = self.frame.resolution
        near, starts, ends = self.cells_of(beams)
        region = Region(0, 0, *self.frame.shape)
        is_used = region.holds(ends) | ~near.is_hit
        near, starts, ends = near.chosen(is_used), starts[is_used], ends[is_used]
        sensing.count_rays(starts, ends, near.is_hit, self._hits, self._misses)
        far = self.frame.unbounded_rowcol_from_xy(near.ends_xy(self.reach_behind * resolution))
        ends = np.where(region.holds(far)[:, np.newaxis], far, ends)
        ranges = np.where(near.is_hit, near.ranges, np.inf)
        sensors = starts.astype(np.float64) + 0.5
        sensing.measure_rays(
            starts, ends, sensors, ranges, self._truncation * resolution, np.inf,
            self._sums, self._weights, resolution,
        )  # fmt: skip

    def occupancy(self) -> SignedBytes:
        field, walls = self._sums, np.full(self.frame.shape, UNKNOWN, dtype=np.int8)
        pairs = [np.s_[1:, :], np.s_[:-1, :]], [np.s_[:1, 1:], np.s_[:1, :-1]]
        # the search returns to the first cell, which is unmarked, from the next cell of its row
        back = [np.s_[:1, :1], np.s_[:1, 1:2] if self.frame.width > 1 else np.s_[1:2, :1]]
        for reached, source in (*pairs, back):
            if not field[source].size:  # a map of one cell
                continue
            changes = field[reached] * field[source] < 0  # 0 where no beam has been
            is_nearer = np.abs(field[reached]) < np.abs(field[source])
            walls[reached][changes & is_nearer] = OCCUPIED
            walls[source][changes & ~is_nearer] = OCCUPIED
        return walls

    def _field(self) -> Floats:
        return np.where(self._weights > 0, self._sums, np.nan)
