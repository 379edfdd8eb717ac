"""Beams of laser scans, at the poses where they were taken."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.display import OneLine, count_text
from mapdeal.grid.frame import FARTHEST
from mapdeal.kernels.rotations import rotated

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_LEVEL = 1e-6
"""Radians: of 30 m, 30 micrometres."""

MOST_LEANING = math.radians(10)
"""From here on what a beam hits says too little of what stands at the height of a robot."""


@dataclass(frozen=True, eq=False)
class Stances:
    """Poses and orientations of sensors."""

    poses: Floats
    is_flipped: Flags
    is_level: Flags
    leans: Flags


def stances(translations: Floats, quaternions: Floats) -> Stances:
    ahead = rotated(quaternions, np.array([1.0, 0.0, 0.0]))
    up = rotated(quaternions, np.array([0.0, 0.0, 1.0]))
    aside = np.hypot(up[:, 0], up[:, 1])
    yaws = np.arctan2(ahead[:, 1], ahead[:, 0])
    poses = np.column_stack([translations[:, :2], yaws])
    return Stances(poses, up[:, 2] < 0, aside < _LEVEL, aside > math.sin(MOST_LEANING))


def beams_in_plane(quaternions: Floats, angles: Floats) -> tuple[Floats, Floats]:
    """Return where beams go in the plane, and which part of their length lies in it."""
    beams = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)
    turned = rotated(quaternions, beams)
    shares = np.minimum(np.hypot(turned[:, 0], turned[:, 1]), 1.0)
    return np.arctan2(turned[:, 1], turned[:, 0]), shares


FARTHEST_POSE = FARTHEST / 10
"""Metres; beams may reach farther."""

_BEAMS_TOGETHER = 1 << 18


@dataclass(frozen=True, eq=False, repr=False)
class Scans(OneLine):
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
        If the shapes do not match, or poses or angles are not finite.
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
        """Number of scans."""
        return len(self.poses) if self.sweeps is None else self.sweeps

    def parts(self) -> Iterator[Scans]:
        """Yield the scans in parts, so that arrays made from them stay small."""
        together = max(1, _BEAMS_TOGETHER // max(1, len(self.angles)))
        for first in range(0, len(self.poses), together):
            some = slice(first, first + together)
            sweeps = self.sweeps if first == 0 or self.sweeps is None else 0
            yield Scans(self.poses[some], self.angles, self.ranges[some], sweeps)


@dataclass(frozen=True)
class BeamLimits:
    """Limits that decide which ranges are hits.

    Parameters
    ----------
    range_min, range_max : float
        A beam is a hit if its range is positive and range_min <= range < range_max, metres. A
        beam of range_max or more, or inf, has no return; all others are invalid.
    clear_max : float
        Distance up to which a beam without return clears cells, at most range_max, metres; 0 to
        ignore such beams.

    Raises
    ------
    ParameterError
        If a number is negative or not finite, or range_max is not above range_min.

    References
    ----------
    gmapping's ``maxRange`` (range_max) and ``maxUrange`` (clear_max); there, too, readings at the
    sensor's limit are not obstacles.
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
    """Number of beams of each kind."""

    scans: int = 0
    beams: int = 0
    hits: int = 0
    no_return: int = 0
    bad: int = 0

    def __add__(self, other: BeamCounts) -> BeamCounts:
        return BeamCounts(
            self.scans + other.scans,
            self.beams + other.beams,
            self.hits + other.hits,
            self.no_return + other.no_return,
            self.bad + other.bad,
        )


@dataclass(frozen=True, eq=False)
class Beams:
    """Beams that hit something or clear cells, in the order of their scans."""

    sensors_xy: Floats
    directions_xy: Floats
    ranges: Floats
    is_hit: NDArray[np.bool_]
    counts: BeamCounts

    @property
    def nbytes(self) -> int:
        """Memory of the arrays, bytes."""
        arrays = self.sensors_xy, self.directions_xy, self.ranges, self.is_hit
        return sum(array.nbytes for array in arrays)

    def chosen(self, which: NDArray[np.bool_]) -> Beams:
        return Beams(
            self.sensors_xy[which],
            self.directions_xy[which],
            self.ranges[which],
            self.is_hit[which],
            self.counts,
        )

    def ends_xy(self, beyond: float = 0.0) -> Floats:
        """Return the ends of the beams, shape (K, 2); hits end `beyond` metres farther."""
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
    """Return the beams of scans that hit something or clear cells."""
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
