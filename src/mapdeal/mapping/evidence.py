"""Occupancy from the evidence of beams: log-odds, and counts of hits and misses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import Bound, Words
from mapdeal.grid.display import OneLine, count_text
from mapdeal.grid.frame import Frame, Region
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.kernels.components import touching_groups
from mapdeal.kernels.polygons import FARTHEST_CELL
from mapdeal.kernels.rays import A_HIT, MOST_HITS, SEEN, Odds, count_rays, weigh_rays
from mapdeal.mapping.beams import Beams

Cells = NDArray[np.int64]
Mask = NDArray[np.bool_]

OFTEN = MOST_HITS
"""Hits from which on a cell counts: fewer may be noise."""

LEAST_CELLS = 3
"""Cells of a group: fewer may be people who walk by."""

NEAR = 2
"""Cells, along both axes, within which an occupied one stands for what was hit."""


@dataclass(frozen=True, eq=False, repr=False)
class HitGroups(OneLine):
    """Groups of touching cells, the largest first."""

    cells: Cells
    sizes: Cells

    @classmethod
    def none(cls) -> HitGroups:
        return cls(np.empty((0, 2), dtype=np.int64), np.empty(0, dtype=np.int64))

    def _told(self) -> Iterator[str]:
        yield count_text(len(self), "group")
        yield count_text(len(self.cells), "cell")

    def __len__(self) -> int:
        return len(self.sizes)

    @property
    def starts(self) -> Cells:
        """Index in `cells` at which each group begins, shape (M,)."""
        return np.cumsum(self.sizes) - self.sizes

    def middles_xy(self, frame: Frame) -> NDArray[np.float64]:
        """Return the mean cell centre of each group in the map frame, shape (M, 2), metres."""
        if not len(self):
            return np.empty((0, 2))
        means = np.add.reduceat(self.cells, self.starts, axis=0) / self.sizes[:, np.newaxis]
        return frame.xy_from_continuous_rowcol(means + 0.5)


def hit_groups(often_hit: Mask) -> HitGroups:
    """Return the groups of `LEAST_CELLS` cells and more that were hit often."""
    return _chosen(*touching_groups(often_hit))


def vanished_groups(often_hit: Mask, occupied: Mask) -> HitGroups:
    # the cells in question are few: they are listed, and looked around from one by one
    at = np.flatnonzero(often_hit & ~occupied)
    candidates = np.stack(np.divmod(at, occupied.shape[1]), axis=1)
    lost = np.zeros(occupied.shape, dtype=np.bool_)
    lost.reshape(-1)[at[~_has_within(occupied, candidates, NEAR)]] = True
    cells, groups = touching_groups(lost)
    is_kept = np.zeros(len(cells), dtype=np.bool_)  # by group: it goes on in cells not lost
    is_kept[groups[_has_within(often_hit & ~lost, cells, 1)]] = True
    left = ~is_kept[groups]
    return _chosen(cells[left], groups[left])


def _has_within(marked: Mask, cells: Cells, reach: int) -> Mask:
    """Return for each cell whether a marked one lies within a reach along both axes."""
    found = np.zeros(len(cells), dtype=np.bool_)
    steps = range(-reach, reach + 1)
    rows = [np.clip(cells[:, 0] + step, 0, marked.shape[0] - 1) for step in steps]
    cols = [np.clip(cells[:, 1] + step, 0, marked.shape[1] - 1) for step in steps]
    for row in rows:
        for col in cols:
            found |= marked[row, col]
    return found


def _chosen(cells: Cells, groups: Cells) -> HitGroups:
    """Return the groups that are large enough, of cells row by row."""
    sizes = np.bincount(groups)
    numbers = np.flatnonzero(sizes >= LEAST_CELLS)
    numbers = numbers[np.argsort(-sizes[numbers], kind="stable")]
    place = np.full(len(sizes), len(sizes))
    place[numbers] = np.arange(len(numbers))
    order = np.argsort(place[groups], kind="stable")[: sizes[numbers].sum()]
    return HitGroups(cells[order], sizes[numbers])


Layers = dict[str, NDArray[Any]]


class Evidence(ABC):
    """Evidence for and against obstacles, gathered cell by cell."""

    reach_behind = 0.0
    """Distance behind hits up to which beams have an effect, cells."""

    def __init__(self, frame: Frame) -> None:
        self.frame = frame

    @property
    def bytes_per_cell(self) -> int:
        """Memory that the evidence takes per cell, bytes."""
        return sum(v.itemsize for v in vars(self).values() if isinstance(v, np.ndarray))

    @abstractmethod
    def add(self, beams: Beams) -> None:
        """Add the evidence of beams, in order; beams that leave the grid count inside it."""

    @abstractmethod
    def occupancy(self) -> NDArray[np.int8]:
        """Return the map of the evidence so far, shape (H, W): -1, 0..100."""

    @abstractmethod
    def often_hit(self) -> NDArray[np.bool_]:
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
        """Return the map of the evidence so far."""
        return OccupancyGrid(self.occupancy(), self.frame.resolution, self.frame.origin)

    def cells_of(self, beams: Beams, beyond: float = 0.0) -> tuple[Beams, Cells, Cells]:
        """Return beams with the cells, shape (K, 2), that they begin and end in.

        Cells may lie outside of the grid; beams more than 2^30 cells away, which cannot be
        followed in whole numbers of 64 bits and come nowhere near it, are left out.
        """
        starts = self.frame.unbounded_rowcol_from_xy(beams.sensors_xy)
        ends = self.frame.unbounded_rowcol_from_xy(beams.ends_xy(beyond))
        near = (np.abs(starts) <= FARTHEST_CELL) & (np.abs(ends) <= FARTHEST_CELL)
        kept = near[:, 0] & near[:, 1]
        if kept.all():
            return beams, starts, ends
        return beams.chosen(kept), starts[kept], ends[kept]


_UNIT = 1 << 16
"""What an evidence of 1 is: in whole numbers sums are exact, in whatever order they are made."""

_EVEN, _FAR = 50, 1000


def _whole(value: float) -> int:
    return round(max(-_FAR, min(value, _FAR)) * _UNIT)


_PASSED = Bound("below 0, at least -100", lambda v: -100 * _UNIT <= _whole(v) < 0)
_HIT = Bound("above 0, at most 100", lambda v: 0 < _whole(v) <= 100 * _UNIT)
_LEAST = Bound("at least 0, below 50", lambda v: 0 <= _whole(v) < _EVEN * _UNIT)
_MOST = Bound("above 50, at most 100", lambda v: 50 < _whole(v) / _UNIT <= 100)


class LogOdds(Evidence):
    """Evidence as one number per cell, which starts at 50.

    Parameters
    ----------
    frame : Frame
        Geometry of the map.
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

    Examples
    --------
    >>> from mapdeal.mapping.beams import BeamLimits, Scans, beams_of
    >>> evidence = LogOdds(Frame(1, 5, 1.0))
    >>> evidence.add(beams_of(Scans([[0.5, 0.5, 0.0]], [0.0], [[3.0]]), BeamLimits()))
    >>> evidence.occupancy().tolist()
    [[0, 0, 0, 100, -1]]
    """

    def __init__(
        self,
        frame: Frame,
        *,
        log_free: Annotated[float, _PASSED, Words("V")] = -1.0,
        log_occ: Annotated[float, _HIT, Words("V")] = 2.0,
        log_min: Annotated[float, _LEAST, Words("V")] = 0.0,
        log_max: Annotated[float, _MOST, Words("V")] = 100.0,
        values: bool = False,
    ) -> None:
        super().__init__(frame)
        self._odds = Odds(*map(_whole, (log_free, log_occ, log_min, log_max)))
        self._publish_values = values
        self._values = np.full(frame.shape, _EVEN * _UNIT, dtype=np.int32)
        self._seen = np.zeros(frame.shape, dtype=np.uint8)

    def add(self, beams: Beams) -> None:
        beams, starts, ends = self.cells_of(beams)
        weigh_rays(starts, ends, beams.is_hit, self._odds, self._values, self._seen)

    def occupancy(self) -> NDArray[np.int8]:
        if self._publish_values:
            rounded = np.rint(self._values / _UNIT).astype(np.int8)
        else:
            rounded = np.full(self.frame.shape, UNKNOWN, dtype=np.int8)
            rounded[self._values < _EVEN * _UNIT] = FREE
            rounded[self._values > _EVEN * _UNIT] = OCCUPIED
        rounded[self._seen == 0] = UNKNOWN
        return rounded

    def often_hit(self) -> NDArray[np.bool_]:
        return self._seen >= SEEN + OFTEN * A_HIT

    def vanished_from(self, grid: OccupancyGrid) -> HitGroups:
        """Return the groups that have vanished; none if the map contains values."""
        return HitGroups.none() if self._publish_values else super().vanished_from(grid)

    def advice(self, vanished: HitGroups) -> str:
        now = self._odds.on_hit / _UNIT
        more, all_ = ("may keep it", "its") if len(vanished) == 1 else ("keeps more", "their")
        return f"--log-occ above {now:g} {more}, --values keeps {all_} evidence"

    def layers(self) -> Layers:
        """Return ``log_odds``: the numbers, float64, nan where no beam has passed or hit."""
        return {"log_odds": np.where(self._seen > 0, self._values / _UNIT, np.nan)}


_COUNT_UNIT = 1_000_000
_SHARE = Bound("at least 0, below 1", lambda value: 0 <= value < 1)


class Counting(Evidence):
    """Evidence as counts of the beams that hit each cell and of those that pass it.

    Parameters
    ----------
    frame : Frame
        Geometry of the map.
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
        count_rays(starts, ends, beams.is_hit, self._hits, self._misses)

    def occupancy(self) -> NDArray[np.int8]:
        visits = self._hits + self._misses
        # in whole numbers, so that no rounding lifts a share above itself
        occupied = self._hits.astype(np.int64) * _COUNT_UNIT > visits.astype(np.int64) * self._ratio
        values = np.where(occupied, np.int8(OCCUPIED), np.int8(FREE))
        values[visits == 0] = UNKNOWN
        return values

    def often_hit(self) -> NDArray[np.bool_]:
        return self._hits >= OFTEN

    def advice(self, vanished: HitGroups) -> str:
        at = tuple(vanished.cells.T)
        hits = self._hits[at].astype(np.int64)
        # of each cell the largest number of percent below its share of hits
        percent = (100 * hits - 1) // (hits + self._misses[at])
        most = np.maximum.reduceat(percent, vanished.starts).min()
        which = "it" if len(vanished) == 1 else "all of them"
        return f"--ratio {most / 100:g} keeps {which}"

    def layers(self) -> Layers:
        """Return ``hits`` and ``misses``, int32."""
        return {"hits": self._hits, "misses": self._misses}


class Sightings:
    """Cells of a lattice in which clouds leave obstacles, and through which beams clear.

    Notes
    -----
    A cell is what the last cloud says that has an end of a beam in it, an obstacle, or a beam
    through it, free; where a cloud has both it is an obstacle, as in costmap_2d, which clears
    first and marks then. So one number a cell is enough: which cloud it was, and what it said.

    Examples
    --------
    >>> seen = Sightings(Region(0, 0, 1, 4), keep=2)
    >>> sensor, wall, beyond = np.array([0, 0]), np.array([[0, 2]]), np.array([[0, 3]])
    >>> seen.add(sensor, wall, wall)
    >>> seen.evidence(Region(0, 0, 1, 4)).tolist()
    [[0, 0, 100, -1]]
    >>> seen.add(sensor, beyond, beyond)
    >>> seen.evidence(Region(0, 1, 1, 4)).tolist()
    [[0, 0, 100, -1]]
    """

    def __init__(self, region: Region, keep: int | None = None) -> None:
        self._region = region
        self._keep = keep
        self._count = 0
        # 2 k where the k-th cloud was the last to say something, one more if that was an obstacle
        self._words = np.zeros((region.height, region.width), dtype=np.int32)

    def move(self, region: Region) -> None:
        """Remember the cells of another region from now on; those of both are kept.

        Nothing moves if they are among those that are remembered.

        References
        ----------
        costmap_2d's ``updateOrigin``: the origin moves by whole cells, so that none blurs.
        """
        rows, cols = _place_in(self._region, region).shared_with(self._words.shape)
        if rows.stop - rows.start == region.height and cols.stop - cols.start == region.width:
            return
        words = np.zeros((region.height, region.width), dtype=np.int32)
        _copy(self._words, self._region, words, region)
        self._region, self._words = region, words

    def skip(self) -> None:
        """Take the turn of a cloud that says nothing."""
        self._count += 1

    def add(self, sensor: Cells, ends: Cells, marks: Cells) -> None:
        """Clear along beams, then mark obstacles."""
        self._count += 1
        corner = np.array(self._region[:2])
        start = sensor - corner
        ends = ends - corner
        if (np.abs(start) <= FARTHEST_CELL).all():
            ends = ends[(np.abs(ends) <= FARTHEST_CELL).all(axis=1)]
            starts = np.broadcast_to(start, ends.shape)
            # what is added reaches the upper bound from anywhere: each cell becomes just that
            word = Odds(2 * self._count, 1, 0, 2 * self._count)
            is_hit, seen = np.zeros(len(ends), np.bool_), np.zeros(self._words.shape, np.uint8)
            weigh_rays(starts, ends, is_hit, word, self._words, seen)
        marks = marks - corner
        marks = marks[((marks >= 0) & (marks < self._words.shape)).all(axis=1)]
        self._words[marks[:, 0], marks[:, 1]] = 2 * self._count + 1

    def evidence(self, region: Region) -> NDArray[np.int8]:
        """Return what the clouds that count say of the cells of a region: -1, 0 or 100.

        Cells that are not remembered are unknown.
        """
        words = self._words_in(region)
        values = np.full(words.shape, UNKNOWN, dtype=np.int8)
        counts = words >= 2 * self._oldest
        values[counts & (words % 2 == 0)] = FREE
        values[counts & (words % 2 == 1)] = OCCUPIED
        return values

    def count_earlier(self, region: Region) -> int:
        """Return how many cells of a region are obstacles by a cloud before the newest."""
        words = self._words_in(region)
        earlier = (words >= 2 * self._oldest) & (words < 2 * self._count) & (words % 2 == 1)
        return int(np.count_nonzero(earlier))

    @property
    def _oldest(self) -> int:
        return 1 if self._keep is None else max(1, self._count - self._keep + 1)

    def _words_in(self, region: Region) -> NDArray[np.int32]:
        words = np.zeros((region.height, region.width), dtype=np.int32)
        _copy(self._words, self._region, words, region)
        return words


def _copy(
    source: NDArray[np.int32], place: Region, target: NDArray[np.int32], other: Region
) -> None:
    """Copy the cells that two regions share from an array of the first into one of the second."""
    region = _place_in(place, other)
    rows, cols = region.shared_with(source.shape)
    if rows.start < rows.stop and cols.start < cols.stop:
        target[region.place_of(rows, cols)] = source[rows, cols]


def _place_in(place: Region, other: Region) -> Region:
    """Return the second region, its corner counted from that of the first."""
    return Region(other.row - place.row, other.col - place.col, other.height, other.width)
