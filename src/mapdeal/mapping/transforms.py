"""Poses, and transforms between frames."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np

from mapdeal.command import Words
from mapdeal.errors import MalformedInputError, ParameterError, emit_warning
from mapdeal.grid.frame import FARTHEST
from mapdeal.kernels.arrays import Floats, Integers, Mask
from mapdeal.kernels.rotations import composed, normalised, slerp, undone
from mapdeal.kernels.sensing import cover_angles

Pose = tuple[float, float, float]

_TURN = 2 * math.pi
_BINS = 1 << 14


def wrapped(angle: float) -> float:
    inside = math.remainder(angle, _TURN)
    return math.pi if inside <= -math.pi else inside


def check_pose(pose: Sequence[float], name: str = "pose") -> Pose:
    """Return a pose as x, y (metres) and a yaw of -pi < yaw <= pi; errors call it `name`."""
    try:
        x, y, yaw = (float(value) for value in pose)
    except (TypeError, ValueError):
        rule = "must be three numbers x, y, yaw"
        raise ParameterError(rule, place=name, got=pose) from None
    if not (abs(x) <= FARTHEST and abs(y) <= FARTHEST and abs(yaw) <= FARTHEST):  # nan too
        rule = f"must be three numbers x, y, yaw within {FARTHEST:g}"
        raise ParameterError(rule, place=name, got=(x, y, yaw))
    if abs(yaw) > _TURN:
        text = f"{name}: a yaw of {yaw:.6g} rad is more than a turn; is it in degrees?"
        emit_warning(text, stacklevel=2)
    return x, y, wrapped(yaw)


Topics = Annotated[Sequence[str], Words("TOPIC", name="topic")]


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
    """The smallest arc that holds all of many angles: it leaves out the largest gap."""

    # Kept are the first and the last angle of each of 16,384 bins, so that memory is bounded
    # whatever is added. The arc is exact as soon as the gap is longer than a bin, 0.0004 rad.

    def __init__(self) -> None:
        self._first = np.full(_BINS, np.inf)
        self._last = np.full(_BINS, -np.inf)

    def add(self, angles: Floats) -> None:
        cover_angles(angles, self._first, self._last)

    def arc(self) -> tuple[float, float] | None:
        """Return the arc's ends, -pi < first <= pi, first <= last < first + 2 pi; None if empty."""
        used = self._last >= self._first
        first, last = self._first[used], self._last[used]
        if not len(first):
            return None
        # The gap before each bin; of equal ones that across pi comes first.
        gaps = first - np.roll(last, 1)
        gaps[0] += _TURN
        start = int(np.argmax(gaps))
        end = float(last[start - 1]) + (_TURN if start else 0.0)
        return float(first[start]), end


_Link = tuple[str, str]  # parent and child
_NAMED = 12
_SLACK = 1000
"""Nanoseconds: times that came through a float64 of seconds are off by a quarter of that."""


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


class _Samples:
    """The samples of one transform: 64 bytes each."""

    def __init__(self, *, is_static: bool) -> None:
        self.is_static = is_static
        self.count = 0
        self._times = array("q")
        self._numbers = array("d")
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
        """Return times that increase, and the numbers of each; of equal times the last counts."""
        # They are views: `add` fails while one is kept.
        if not self._is_in_time:
            self._sort()
        return self._views()

    def _views(self) -> tuple[Integers, Floats]:
        times = np.frombuffer(self._times, dtype=np.int64)
        return times, np.frombuffer(self._numbers, dtype=np.float64).reshape(-1, 7)

    def _sort(self) -> None:
        """Sort in place, column by column: a recording may hold millions of samples."""
        times, numbers = self._views()
        order = np.argsort(times, kind="stable")
        in_order = times[order]
        order = order[np.append(in_order[1:] != in_order[:-1], True)]
        count = len(order)
        times[:count] = times[order]
        for column in numbers.T:
            column[:count] = column[order]
        del times, numbers, column  # arrays with views cannot be cut
        del self._times[count:], self._numbers[7 * count :]
        self._is_in_time = True

    def at(self, times: Integers) -> tuple[Floats, Floats, Mask]:
        if self.is_static:
            numbers = np.broadcast_to(np.array(self._numbers[-7:]), (len(times), 7))
            return numbers[:, :3], numbers[:, 3:], np.ones(len(times), dtype=np.bool_)
        known_times, numbers = self.in_time()
        known = (times >= known_times[0] - _SLACK) & (times <= known_times[-1] + _SLACK)
        after = np.clip(np.searchsorted(known_times, times), 0, len(known_times) - 1)
        is_exact = known_times[after] == times
        before = np.where(is_exact, after, np.maximum(after - 1, 0))
        span = known_times[after] - known_times[before]
        # differences of whole numbers: as floats, times of this century are 256 ns apart
        share = (times - known_times[before]) / np.maximum(span, 1)
        share = np.clip(np.where(known, share, 0.0), 0.0, 1.0)
        one, other = numbers[before], numbers[after]
        moves = one[:, :3] + share[:, np.newaxis] * (other[:, :3] - one[:, :3])
        return moves, slerp(one[:, 3:], other[:, 3:], share), known


class TransformTree:
    """The transforms of a recording, to be asked where one frame was in another."""

    # As in tf2 (``BufferCore``, ``TimeCache``), a transform between two frames is interpolated
    # along a line and an arc between the samples before and after a time, each transform of a chain
    # on its own, and never continued beyond its samples. A frame has one parent: where several
    # come, the one that comes most often. A transform that comes both as static and as moving is
    # what it comes as most often; a static one counts once, since it replaces what came before.
    # (tf2 would keep to what came first, which in a recording may be either.)

    def __init__(self) -> None:
        self._samples: dict[_Link, _Samples] = {}
        self._others: dict[_Link, _Samples] = {}
        self.bad = 0
        """Transforms that were left out: not finite, or without a rotation."""

    def add(
        self, parent: str, child: str, time: int, translation: Sequence[float],
        quaternion: Sequence[float], *, is_static: bool,
    ) -> None:  # fmt: skip
        parent, child = parent.lstrip("/"), child.lstrip("/")
        length = math.hypot(*quaternion)
        is_near = all(abs(value) <= FARTHEST for value in translation)  # refuses nan, too
        if not (is_near and math.isfinite(length) and length > 0) or parent == child:
            self.bad += 1
            return
        edge, numbers = (parent, child), (*translation, *(part / length for part in quaternion))
        chosen = self._samples.get(edge)
        if chosen is None:
            chosen = self._samples[edge] = _Samples(is_static=is_static)
        if chosen.is_static == is_static:
            chosen.add(time, numbers)
            return
        other = self._others.get(edge)  # of the kind that did not count so far
        if other is None:
            other = self._others[edge] = _Samples(is_static=is_static)
        other.add(time, numbers)
        if (other.count, other.is_static) > (chosen.count, chosen.is_static):
            self._samples[edge], self._others[edge] = other, chosen

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
        """Frames that come with several parents: that which counts, and then the others."""
        found: dict[str, list[str]] = {}
        for child, parent in self._chosen_parents().items():
            others = sorted(p for p, c in self._samples if c == child and p != parent)
            if others:
                found[child] = [parent, *others]
        return found

    @property
    def of_both_kinds(self) -> list[_Link]:
        return sorted(self._others)

    def leads(self, fixed: str, frame: str) -> bool:
        return self._way(fixed.lstrip("/"), frame.lstrip("/")) is not None

    def root_of(self, frame: str) -> str:
        return self._above(frame.lstrip("/"))[-1]

    def is_moving(self, fixed: str, frame: str) -> bool:
        return bool(self._moving(fixed, frame))

    def _moving(self, fixed: str, frame: str) -> list[_Samples]:
        way = self._way(fixed.lstrip("/"), frame.lstrip("/")) or ([], [])
        samples = [self._samples[edge] for part in way for edge in part]
        return [one for one in samples if not one.is_static]

    def lookup(self, fixed: str, frame: str, times: Integers) -> Posed:
        fixed, frame = fixed.lstrip("/"), frame.lstrip("/")
        way = self._way(fixed, frame)
        if way is None:
            raise self.no_way(fixed, frame)
        times = np.asarray(times, dtype=np.int64)
        known = np.ones(len(times), dtype=np.bool_)
        chains = []
        for part in way:
            chain = np.zeros((len(times), 3)), np.tile([0.0, 0.0, 0.0, 1.0], (len(times), 1))
            for edge in part:
                moves, turns, is_known = self._samples[edge].at(times)
                chain = composed((moves, turns), chain)
                known &= is_known
            chains.append(chain)
        down, up = chains
        moves, turns = composed(undone(down), up) if way[0] else up
        moves, turns = np.array(moves), normalised(turns)
        moves[~known] = np.nan
        turns[~known] = np.nan
        return Posed(moves, turns, known)

    def no_way(self, fixed: str, frame: str) -> MalformedInputError:
        names = self.frames
        more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        there = f"frames are {', '.join(names[:_NAMED])}{more}" if names else "there are none"
        return MalformedInputError(f"no transforms lead from {fixed!r} to {frame!r}: {there}")

    def span(self, fixed: str, frame: str) -> tuple[int, int] | None:
        """Return the first and last time at which all transforms of a chain are known, if any."""
        moving = [samples.in_time()[0] for samples in self._moving(fixed, frame)]
        if not moving:
            return None
        first, last = max(int(one[0]) for one in moving), min(int(one[-1]) for one in moving)
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

    def _way(self, fixed: str, frame: str) -> tuple[list[_Link], list[_Link]] | None:
        first, second = self._above(fixed), self._above(frame)
        meeting = next((name for name in second if name in first), None)
        if meeting is None or (fixed != frame and not {fixed, frame} <= set(self.frames)):
            return None
        ways = (chain[: chain.index(meeting) + 1] for chain in (first, second))
        down, up = ([(p, c) for c, p in pairwise(way)] for way in ways)
        return down, up
