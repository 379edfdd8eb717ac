"""Beams of laser scans: which hit something, which return nothing, which mean nothing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.coordinates import FARTHEST
from mapdeal.grid.display import OneLine, count_text
from mapdeal.records import dataclass

Floats = NDArray[np.float64]

FARTHEST_POSE = FARTHEST / 10
"""Metres; beams may reach farther."""

_BEAMS_TOGETHER = 1 << 18


@dataclass(frozen=True, eq=False, repr=False)
class Scans(OneLine):
    """Some scans with the same angles.

    Parameters
    ----------
    poses : array_like of float, shape (N, 3)
        x, y (metres) and yaw (radians) of the sensor in the map frame, one for each scan.
    angles : array_like of float, shape (M,)
        Of the beams, radians from the sensor's heading, anticlockwise; in any order.
    ranges : array_like of float, shape (N, M)
        Metres; inf for a beam that returns nothing, nan for one that means nothing.
    sweeps : int, optional
        How many scans they count as, where beams have poses of their own; one each by default.

    Raises
    ------
    ParameterError
        If the shapes do not fit, or poses or angles are not finite.
    """

    poses: Floats
    angles: Floats
    ranges: Floats
    sweeps: int | None = None

    def __post_init__(self) -> None:
        poses, angles, ranges = (
            _floats(getattr(self, name), name) for name in ("poses", "angles", "ranges")
        )
        if poses.ndim != 2 or poses.shape[1] != 3:
            rule = "must be an array of shape (N, 3)"
            raise ParameterError(rule, place="poses", got=poses.shape)
        if angles.ndim != 1:
            raise ParameterError("must be an array of shape (M,)", place="angles", got=angles.shape)
        if ranges.shape != (len(poses), len(angles)):
            rule = f"must be an array of shape {(len(poses), len(angles))}"
            raise ParameterError(rule, place="ranges", got=ranges.shape)
        for name, array in (("poses", poses), ("angles", angles)):
            if not (np.abs(array) <= FARTHEST_POSE).all():  # refuses nan too
                raise ParameterError(f"must be finite and within {FARTHEST_POSE:g}", place=name)
        for name, array in (("poses", poses), ("angles", angles), ("ranges", ranges)):
            object.__setattr__(self, name, array)

    def _told(self) -> Iterator[str]:
        yield count_text(len(self.poses), "scan")
        yield count_text(len(self.angles), "beam") + " each"

    @property
    def count(self) -> int:
        """How many scans they count as."""
        return len(self.poses) if self.sweeps is None else self.sweeps

    def parts(self) -> Iterator[Scans]:
        """Yield the scans some at a time, so that what is made of them stays small."""
        together = max(1, _BEAMS_TOGETHER // max(1, len(self.angles)))
        for first in range(0, len(self.poses), together):
            some = slice(first, first + together)
            sweeps = self.sweeps if first == 0 or self.sweeps is None else 0
            yield Scans(self.poses[some], self.angles, self.ranges[some], sweeps)


@dataclass(frozen=True)
class BeamLimits:
    """Which ranges are hits.

    Parameters
    ----------
    range_min, range_max : float
        A beam hits something if range_min <= range < range_max, metres. Beyond, or at inf, it
        returns nothing; all others mean nothing.
    clear_max : float
        Metres up to which a beam that returns nothing clears its way, but not beyond range_max;
        0 to leave it out.

    Raises
    ------
    ParameterError
        If a number is not finite or negative, or range_max not above range_min.

    References
    ----------
    gmapping's ``maxRange`` (range_max) and ``maxUrange`` (clear_max), where readings at the
    sensor's limit are no obstacles.
    """

    range_min: float = 0.0
    range_max: float = 30.0
    clear_max: float = 0.0

    def __post_init__(self) -> None:
        for name in ("range_min", "range_max", "clear_max"):
            value = as_number(getattr(self, name), name)
            if not 0 <= value <= FARTHEST_POSE:  # refuses nan too
                rule = "must be a finite number, at least 0"
                raise ParameterError(rule, place=name, got=value)
        if self.range_max <= self.range_min:
            rule = f"must be above range_min, {self.range_min:g}"
            raise ParameterError(rule, place="range_max", got=self.range_max)


@dataclass(frozen=True)
class BeamCounts:
    """How many beams there were of each kind.

    Parameters
    ----------
    scans, beams : int
        All of them.
    hits : int
        Those that end at something.
    no_return : int
        Those that return nothing within range_max.
    bad : int
        Those that mean nothing: nan, 0, negative, or nearer than range_min.
    """

    scans: int = 0
    beams: int = 0
    hits: int = 0
    no_return: int = 0
    bad: int = 0

    def __add__(self, other: BeamCounts) -> BeamCounts:
        """Return the counts of both together."""
        return BeamCounts(
            self.scans + other.scans,
            self.beams + other.beams,
            self.hits + other.hits,
            self.no_return + other.no_return,
            self.bad + other.bad,
        )


@dataclass(frozen=True, eq=False)
class Beams:
    """Beams that say something, in the order of their scans.

    Parameters
    ----------
    sensors_xy : numpy.ndarray of float64, shape (K, 2)
        Where each begins, metres in the map frame.
    directions_xy : numpy.ndarray of float64, shape (K, 2)
        Unit vectors.
    ranges : numpy.ndarray of float64, shape (K,)
        Metres to what it hits, or as far as it clears.
    is_hit : numpy.ndarray of bool, shape (K,)
        Whether there is something at its end.
    counts : BeamCounts
        Of these and of those that were left out.
    """

    sensors_xy: Floats
    directions_xy: Floats
    ranges: Floats
    is_hit: NDArray[np.bool_]
    counts: BeamCounts

    @property
    def nbytes(self) -> int:
        """How much memory they take."""
        arrays = self.sensors_xy, self.directions_xy, self.ranges, self.is_hit
        return sum(array.nbytes for array in arrays)

    def chosen(self, which: NDArray[np.bool_]) -> Beams:
        """Return some of the beams, with the counts of all."""
        return Beams(
            self.sensors_xy[which],
            self.directions_xy[which],
            self.ranges[which],
            self.is_hit[which],
            self.counts,
        )

    def ends_xy(self, beyond: float = 0.0) -> Floats:
        """Return where they end, shape (K, 2), hits by some metres farther."""
        reach = self.ranges + np.where(self.is_hit, beyond, 0.0)
        return self.sensors_xy + self.directions_xy * reach[:, np.newaxis]


def as_number(value: object, name: str) -> float:
    """Return a parameter as a float; an error calls it `name`."""
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise ParameterError("must be a number", place=name, got=value) from None


def _floats(array: object, name: str) -> Floats:
    try:
        return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError):
        raise ParameterError("must be an array of numbers", place=name) from None


def beams_of(scans: Scans, limits: BeamLimits) -> Beams:
    """Return the beams of scans that say something.

    Examples
    --------
    >>> scans = Scans([[1.0, 2.0, 0.0]], [0.0, 0.1, 0.2, np.pi / 2], [[3, 40, np.nan, 5]])
    >>> beams = beams_of(scans, BeamLimits())
    >>> beams.ends_xy().round(9).tolist()
    [[4.0, 2.0], [1.0, 7.0]]
    >>> beams.counts
    BeamCounts(scans=1, beams=4, hits=2, no_return=1, bad=1)
    """
    ranges = scans.ranges
    with np.errstate(invalid="ignore"):
        is_hit = (ranges > 0) & (ranges >= limits.range_min) & (ranges < limits.range_max)
        is_open = ranges >= limits.range_max
    used = is_hit | is_open if limits.clear_max > 0 else is_hit
    angle = (scans.poses[:, 2:] + scans.angles)[used]
    hits, no_return = int(np.count_nonzero(is_hit)), int(np.count_nonzero(is_open))
    counts = BeamCounts(scans.count, ranges.size, hits, no_return, ranges.size - hits - no_return)
    hit = is_hit[used]
    directions = np.empty((len(hit), 2))
    directions[:, 0], directions[:, 1] = np.cos(angle), np.sin(angle)
    return Beams(
        np.repeat(scans.poses[:, :2], np.count_nonzero(used, axis=1), axis=0),
        directions,
        np.where(hit, ranges[used], min(limits.clear_max, limits.range_max)),
        hit,
        counts,
    )
