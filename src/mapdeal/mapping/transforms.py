"""Poses, and transforms between frames."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np

from mapdeal.command import Words
from mapdeal.errors import MalformedInputError, require
from mapdeal.grid.frame import FARTHEST, are_near, as_numbers, warn_of_degrees
from mapdeal.grid.values import few_text
from mapdeal.kernels import rotations, sensing
from mapdeal.kernels.arrays import Floats, Integers, Mask
from mapdeal.records import dataclass

Pose = tuple[float, float, float]
_TURN = 2 * math.pi
_BINS = 1 << 14  # of CoveredAngles
Topics = Annotated[Sequence[str], Words("TOPIC", name="topic")]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Rigid = tuple[Vector, Quaternion]
_Link = tuple[str, str]  # parent and child
_MOST_NAMED = 12
_TIME_TOLERANCE = 1000
"""Nanoseconds: times converted from float64 seconds are off by up to 250."""


def wrapped(angle: float) -> float:
    inside = math.remainder(angle, _TURN)
    return math.pi if inside <= -math.pi else inside


def check_pose(pose: Sequence[float], name: str = "pose") -> Pose:
    values, rule = as_numbers(pose), "must be three numbers x, y, yaw"
    require(len(values) == 3, rule, name, got=pose)
    require(are_near(values), f"{rule} within {FARTHEST:g}", name, got=values)
    x, y, yaw = values
    warn_of_degrees(yaw, name)
    return x, y, wrapped(yaw)


@dataclass(frozen=True, kw_only=True)
class FrameOptions:
    """Sources of the sensors' poses; commands that read bags have these as options.

    Parameters
    ----------
    fixed_frame : str, optional
        Frame of the map.  [default: map, or else odom]
    base_frame : str, optional
        Frame of the robot.  [default: base_link, or else base_footprint]
    odometry : str, optional
        Odometry topic, for bags without transforms to the robot.
    mount : tuple of float, optional
        Pose of the sensor on the robot, metres and radians, if no transform gives it.
    poses : path, optional
        File of the robot's poses, which replaces transforms: ``t x y z qx qy qz qw`` a line.
    """

    fixed_frame: Annotated[str | None, Words("FRAME")] = None
    base_frame: Annotated[str | None, Words("FRAME")] = None
    odometry: Annotated[str | None, Words("TOPIC")] = None
    mount: Annotated[Pose | None, Words("X,Y,YAW")] = None
    poses: Annotated[Path | None, Words("FILE")] = None


class CoveredAngles:
    """The smallest arc that contains all added angles: the circle without the largest gap."""

    # Memory is bounded: only the first and last angle of each of 16,384 bins are stored. The arc is
    # exact if the gap is longer than a bin, 0.0004 rad.

    def __init__(self) -> None:
        self._first, self._last = np.full(_BINS, np.inf), np.full(_BINS, -np.inf)

    def add(self, angles: Floats) -> None:
        sensing.cover_angles(angles, self._first, self._last)

    def arc(self) -> tuple[float, float] | None:
        """Return the arc's ends, -pi < first <= pi, first <= last < first + 2 pi; None if empty."""
        used = self._last >= self._first
        first, last = self._first[used], self._last[used]
        if not len(first):
            return None
        # the gap before each bin; of equal gaps the one across pi comes first
        gaps = first - np.roll(last, 1)
        gaps[0] += _TURN
        start = int(np.argmax(gaps))
        return float(first[start]), float(last[start - 1]) + (_TURN if start else 0.0)


@dataclass(frozen=True, eq=False)
class Posed:
    translations: Floats
    quaternions: Floats
    known: Mask


@dataclass(frozen=True)
class Edge:
    parent: str
    child: str
    count: int
    first: int
    last: int
    is_static: bool


def _seconds(time: int) -> float:
    return time // 10**9 + 1e-9 * (time % 10**9)  # as ros::Duration::toSec


class _Samples:
    """The samples of one transform, 64 bytes each."""

    def __init__(self, *, is_static: bool) -> None:
        self.is_static, self.count = is_static, 0
        self._times, self._numbers = array("q"), array("d")
        self._is_in_time = True

    def add(self, time: int, numbers: Sequence[float]) -> None:
        if self.is_static:
            del self._times[:], self._numbers[:]
            self.count = 0
        elif self._times and time <= self._times[-1]:
            self._is_in_time = False
        self.count += 1
        self._times.append(time)
        self._numbers.extend(numbers)

    def in_time(self) -> tuple[Integers, Floats]:
        """Return increasing times and their values; of equal times the last sample counts."""
        # These are views: `add` fails while one exists.
        self._sort()
        return self._views()

    def _views(self) -> tuple[Integers, Floats]:
        times = np.frombuffer(self._times, dtype=np.int64)
        return times, np.frombuffer(self._numbers, dtype=np.float64).reshape(-1, 7)

    def _sort(self) -> None:
        """Sort in place, column by column, because a recording may have millions of samples."""
        if self._is_in_time:
            return
        times, numbers = self._views()
        order = np.argsort(times, kind="stable")
        in_order = times[order]
        order = order[np.append(in_order[1:] != in_order[:-1], True)]
        count = len(order)
        times[:count] = times[order]
        for column in numbers.T:
            column[:count] = column[order]
        del times, numbers, column  # an array with views cannot be shortened
        del self._times[count:], self._numbers[7 * count :]
        self._is_in_time = True

    def tf2_at(self, time: int, in_seconds: bool) -> Rigid | None:
        """Return the sample that ``TimeCache::getData`` finds or interpolates."""
        self._sort()
        times, after = self._times, bisect_right(self._times, time)
        if self.is_static or (after and times[after - 1] == time and after in (1, len(times))):
            return self._rigid(len(times) - 1 if self.is_static else after - 1)
        if not 0 < after < len(times):
            return None
        (first, turn), (second, later_turn) = self._rigid(after - 1), self._rigid(after)
        start, end = times[after - 1], times[after]
        share = (time - start) / (end - start)
        if in_seconds:
            share = _seconds(time - start) / _seconds(end - start)
        x, y, z = ((1.0 - share) * a + share * b for a, b in zip(first, second, strict=True))
        return (x, y, z), _tf2_slerp(turn, later_turn, share)

    def _rigid(self, index: int) -> Rigid:
        x, y, z, qx, qy, qz, qw = self._numbers[7 * index : 7 * index + 7]
        return (x, y, z), (qx, qy, qz, qw)

    def at(self, times: Integers) -> tuple[Floats, Floats, Mask]:
        if self.is_static:
            numbers = np.broadcast_to(np.array(self._numbers[-7:]), (len(times), 7))
            return numbers[:, :3], numbers[:, 3:], np.ones(len(times), dtype=np.bool_)
        known_times, numbers = self.in_time()
        known = times >= known_times[0] - _TIME_TOLERANCE
        known &= times <= known_times[-1] + _TIME_TOLERANCE
        after = np.clip(np.searchsorted(known_times, times), 0, len(known_times) - 1)
        before = np.where(known_times[after] == times, after, np.maximum(after - 1, 0))
        span = known_times[after] - known_times[before]
        # integer differences: float64 has steps of 256 ns at times of this century
        share = (times - known_times[before]) / np.maximum(span, 1)
        share = np.clip(np.where(known, share, 0.0), 0.0, 1.0)
        earlier, later = numbers[before], numbers[after]
        moves = earlier[:, :3] + share[:, np.newaxis] * (later[:, :3] - earlier[:, :3])
        return moves, rotations.slerp(earlier[:, 3:], later[:, 3:], share), known


# Products and slerp in the order of tf2's LinearMath: their last bits decide whether a ray clipped
# at a border ends within it.


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _tf2_inverse(q: Quaternion) -> Quaternion:
    return -q[0], -q[1], -q[2], q[3]


def _tf2_product(a: Quaternion, b: Quaternion) -> Quaternion:
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by + ay * bw + az * bx - ax * bz,
        aw * bz + az * bw + ax * by - ay * bx,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _tf2_rotated(q: Quaternion, v: Vector) -> Vector:
    x, y, z, w = q
    vx, vy, vz = v
    turned = (
        w * vx + y * vz - z * vy, w * vy + z * vx - x * vz, w * vz + x * vy - y * vx,
        -x * vx - y * vy - z * vz,
    )  # fmt: skip
    return _tf2_product(turned, _tf2_inverse(q))[:3]


def _tf2_slerp(a: Quaternion, b: Quaternion, share: float) -> Quaternion:
    def dot(p: Quaternion, q: Quaternion) -> float:
        return p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]

    sign = -1.0 if dot(a, b) < 0 else 1.0
    cosine = sign * dot(a, b) / math.sqrt(dot(a, a) * dot(b, b))
    theta = math.acos(max(-1.0, min(1.0, cosine))) * 2.0 / 2.0
    if theta == 0.0:
        return a
    d = 1.0 / math.sin(theta)
    s0, s1 = math.sin((1.0 - share) * theta), math.sin(share * theta)
    x, y, z, w = ((p * s0 + sign * q * s1) * d for p, q in zip(a, b, strict=True))
    return x, y, z, w


def _tf2_chain(chain: Sequence[Rigid | None]) -> Rigid | None:
    move, turn = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    for rigid in chain:
        if rigid is None:
            return None
        move, turn = _sum(_tf2_rotated(rigid[1], move), rigid[0]), _tf2_product(rigid[1], turn)
    return move, turn


class TransformTree:
    """The transforms of a recording, for lookups of one frame in another.

    `is_exact` keeps quaternions as they were recorded, for `tf2_lookup`.
    """

    # As in tf2 (``BufferCore``, ``TimeCache``), each transform of a chain is interpolated alone,
    # between the samples before and after a time, never extrapolated. The most frequent parent of a
    # frame is used; so is the more frequent of static and moving samples, of which static ones
    # count as one. (tf2 uses the first one, which in a recording is random.)

    def __init__(self, *, is_exact: bool = False) -> None:
        self._is_exact = is_exact
        self._samples: dict[_Link, _Samples] = {}
        self._minority: dict[_Link, _Samples] = {}
        self.bad = 0
        """Number of transforms left out: not finite, or with a zero quaternion."""

    def add(
        self, parent: str, child: str, time: int, translation: Sequence[float],
        quaternion: Sequence[float], *, is_static: bool,
    ) -> None:  # fmt: skip
        parent, child = parent.lstrip("/"), child.lstrip("/")
        length = math.hypot(*quaternion)
        if not (are_near(translation) and math.isfinite(length) and length > 0) or parent == child:
            self.bad += 1
            return
        if not self._is_exact:
            quaternion = [part / length for part in quaternion]
        edge, numbers = (parent, child), (*translation, *quaternion)
        chosen = self._samples.get(edge)
        if chosen is None:
            chosen = self._samples[edge] = _Samples(is_static=is_static)
        if chosen.is_static == is_static:
            chosen.add(time, numbers)
            return
        # samples of the less frequent kind
        minority = self._minority.setdefault(edge, _Samples(is_static=is_static))
        minority.add(time, numbers)
        if (minority.count, minority.is_static) > (chosen.count, chosen.is_static):
            self._samples[edge], self._minority[edge] = minority, chosen

    @property
    def frames(self) -> list[str]:
        return sorted({name for edge in self._samples for name in edge})

    def edges(self) -> list[Edge]:
        found = []
        for (parent, child), samples in sorted(self._samples.items()):
            times, _ = samples.in_time()
            first, last = int(times[0]), int(times[-1])
            found.append(Edge(parent, child, samples.count, first, last, samples.is_static))
        return found

    @property
    def several_parents(self) -> dict[str, list[str]]:
        """Frames with several parents: the parent that is used, then the others."""
        parents = {
            child: [parent, *sorted(p for p, c in self._samples if c == child and p != parent)]
            for child, parent in self._chosen_parents().items()
        }
        return {child: names for child, names in parents.items() if len(names) > 1}

    @property
    def of_both_kinds(self) -> list[_Link]:
        return sorted(self._minority)

    def leads(self, fixed: str, frame: str) -> bool:
        return self._chains_between(fixed.lstrip("/"), frame.lstrip("/")) is not None

    def root_of(self, frame: str) -> str:
        return self._above(frame.lstrip("/"))[-1]

    def is_moving(self, fixed: str, frame: str) -> bool:
        return bool(self._moving(fixed, frame))

    def _moving(self, fixed: str, frame: str) -> list[_Samples]:
        chains = self._chains_between(fixed.lstrip("/"), frame.lstrip("/")) or ([], [])
        samples = [self._samples[edge] for part in chains for edge in part]
        return [sample_set for sample_set in samples if not sample_set.is_static]

    def lookup(self, fixed: str, frame: str, times: Integers) -> Posed:
        fixed, frame = fixed.lstrip("/"), frame.lstrip("/")
        links = self._chains_between(fixed, frame)
        if links is None:
            raise self.no_chain(fixed, frame)
        times = np.asarray(times, dtype=np.int64)
        known = np.ones(len(times), dtype=np.bool_)
        chains = []
        for part in links:
            chain = np.zeros((len(times), 3)), np.tile([0.0, 0.0, 0.0, 1.0], (len(times), 1))
            for edge in part:
                moves, turns, is_known = self._samples[edge].at(times)
                chain = rotations.composed((moves, turns), chain)
                known &= is_known
            chains.append(chain)
        down, up = chains
        moves, turns = rotations.composed(rotations.undone(down), up) if links[0] else up
        moves, turns = np.array(moves), rotations.normalised(turns)
        moves[~known] = np.nan
        turns[~known] = np.nan
        return Posed(moves, turns, known)

    def tf2_lookup(self, fixed: str, frame: str, time: int, *, in_seconds: bool) -> Rigid | None:
        """Return the transform, bit for bit as tf2 does; None at unknown times."""
        # `in_seconds` interpolates between float64 seconds, as in ROS 1.
        links = self._chains_between(fixed.lstrip("/"), frame.lstrip("/"))
        if links is None:
            raise self.no_chain(fixed, frame)
        chains = [_tf2_chain([self._samples[e].tf2_at(time, in_seconds) for e in c]) for c in links]
        below, above = chains
        if below is None or above is None or not links[0]:
            return below and above
        inverse = _tf2_inverse(below[1])
        x, y, z = below[0]
        shift = _tf2_rotated(inverse, (-x, -y, -z))
        return _sum(_tf2_rotated(inverse, above[0]), shift), _tf2_product(inverse, above[1])

    def no_chain(self, fixed: str, frame: str) -> MalformedInputError:
        names = self.frames
        frames = f"frames are {few_text(names, _MOST_NAMED)}" if names else "there are none"
        return MalformedInputError(f"no transforms lead from {fixed!r} to {frame!r}: {frames}")

    def span(self, fixed: str, frame: str) -> tuple[int, int] | None:
        """Return the first and last time at which all moving transforms of a chain are known."""
        moving = [samples.in_time()[0] for samples in self._moving(fixed, frame)]
        if not moving:
            return None
        first = max(int(times[0]) for times in moving)
        last = min(int(times[-1]) for times in moving)
        return (first, last) if first <= last else None

    def _chosen_parents(self) -> dict[str, str]:
        found: dict[str, str] = {}
        for (parent, child), samples in self._samples.items():
            chosen = found.get(child)
            if chosen is None or samples.count > self._samples[chosen, child].count:
                found[child] = parent
        return found

    def _above(self, frame: str) -> list[str]:
        parents, found = self._chosen_parents(), [frame]
        while (parent := parents.get(found[-1])) is not None and parent not in found:
            found.append(parent)
        return found

    def _chains_between(self, fixed: str, frame: str) -> tuple[list[_Link], list[_Link]] | None:
        first, second = self._above(fixed), self._above(frame)
        meeting = next((name for name in second if name in first), None)
        if meeting is None:
            return None
        chains = (chain[: chain.index(meeting) + 1] for chain in (first, second))
        down, up = ([(p, c) for c, p in pairwise(chain)] for chain in chains)
        return down, up
