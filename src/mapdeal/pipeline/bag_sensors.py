"""The clouds of a bag, in the frame of the robot, each with the robot's pose."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mapdeal.bags.bag import CAN_BE_READ, Bag, Connection, Place
from mapdeal.bags.messages import (
    LASER_SCAN,
    ODOMETRY,
    POINT_CLOUD,
    TF_TYPES,
    Decoder,
    LaserScan,
    Stamped,
    laser_scan_of,
    odometry_of,
    points_of,
    points_of_scan,
    transforms_of,
)
from mapdeal.bags.reader import chosen_connections, open_bag
from mapdeal.errors import MalformedInputError, ParameterError, emit_warning
from mapdeal.files.budget import claim
from mapdeal.files.source import FileState, sha256_of, state_of
from mapdeal.kernels.rotations import from_yaw, rotated
from mapdeal.mapping.beams import FARTHEST_POSE, Stances, beams_in_plane, stances
from mapdeal.mapping.transforms import FrameOptions, Pose, Posed, TransformTree
from mapdeal.pipeline.inputs import errors_named
from mapdeal.pipeline.local import Cloud, Points, SummedCloud
from mapdeal.sensors.points import read_trajectory
from mapdeal.sensors.scans import ScanArrays, ScanSource

FIXED_FRAMES = ("map", "odom")
"""Frames that maps are made in, the best first."""

BASE_FRAMES = ("base_link", "base_footprint")
"""Usual names of the robot's frame, the most common first."""

_TF, _STATIC = "/tf", "/tf_static"
_SEVERAL = 3


class SensorFrames:
    """Where the sensors of a bag were."""

    def __init__(self, bag: Bag, options: FrameOptions) -> None:
        self._bag = bag
        self._options = options
        self._decoder = Decoder(bag)
        self._tree = TransformTree()
        self._fixed: str | None = None
        self._moving, self._static = _of_tf(bag)
        wanted = self._static if options.poses is not None else [*self._moving, *self._static]
        self._index = bag.index([one.id for one in wanted])

    @property
    def count(self) -> int:
        return len(self._index)

    @property
    def files(self) -> tuple[Path, ...]:
        return () if self._options.poses is None else (self._options.poses,)

    @property
    def fixed_frame(self) -> str:
        return self._fixed or FIXED_FRAMES[0]

    def read(self, sensors: Iterable[str], advance: Callable[[int], object]) -> None:
        """Read all transforms, and find the way to some sensors."""
        sensors = sorted(set(sensors))
        self._read_all(advance)
        if self._options.poses is not None:
            self._take_poses(self._options.poses, sensors)
        else:
            self._take_mount(sensors)
            self._fixed = self._fixed_for(sensors)
        if self._tree.bad:
            self._bag.remark(f"{self._tree.bad} invalid transforms are ignored")
        for parent, child in self._tree.of_both_kinds[:_SEVERAL]:
            text = f"{parent} -> {child} is both static and dynamic"
            self._bag.remark(f"{text}: the more frequent kind is used")
        for child, (chosen, *others) in sorted(self._tree.several_parents.items())[:_SEVERAL]:
            text = f"frame {child} has several parents: {chosen}, the most frequent, is used"
            self._bag.remark(f"{text}, and not {', '.join(others)}")

    def read_alone(self, sensor: str, advance: Callable[[int], object]) -> None:
        """Read all transforms, where only the place of a sensor on the robot is asked for."""
        self._read_all(advance)
        self._take_mount([sensor])

    def leads(self, base: str, frame: str) -> bool:
        return self._tree.leads(base, frame)

    def between(self, base: str, frame: str, times: NDArray[np.int64]) -> Posed:
        return self._tree.lookup(base, frame, times)

    def at(self, frame: str, times: NDArray[np.int64]) -> Posed:
        found = self._tree.lookup(self.fixed_frame, frame, times)
        if (np.abs(found.translations[found.known]) > FARTHEST_POSE).any():
            rule = f"{frame} is farther than {FARTHEST_POSE:g} m from {self.fixed_frame}"
            raise MalformedInputError(rule, source=self._bag.path)
        return found

    def told_span(self, frame: str) -> str:
        span = self._tree.span(self.fixed_frame, frame)
        if span is None:
            return "at no time"
        return f"from {span[0] / 1e9:.3f} to {span[1] / 1e9:.3f} s"

    def base_frame(self) -> str | None:
        named = self._options.base_frame
        names = BASE_FRAMES if named is None else (named.lstrip("/"),)
        return next((name for name in names if name in self._tree.frames), None)

    def _read_all(self, advance: Callable[[int], object]) -> None:
        static = {one.id for one in self._static}
        for place in self._index:
            for one in self._decoder.read(place, transforms_of):
                self._add(one, is_static=place.connection in static)
            advance(1)

    def _add(self, one: Stamped, *, is_static: bool) -> None:
        self._tree.add(
            one.parent, one.child, one.time, one.translation, one.quaternion, is_static=is_static
        )

    def _take_mount(self, sensors: list[str]) -> None:
        """Place sensors where the user says, on a robot whose frame is known or not yet."""
        if self._options.mount is None:
            return
        if len(sensors) > 1:
            rule = f"applies to one sensor, and there are {', '.join(sensors)}"
            raise ParameterError(rule, source="--mount", hint="--topic names one")
        x, y, yaw = self._options.mount
        base = self.base_frame() or self._options.base_frame or BASE_FRAMES[0]
        for sensor in sensors:
            if self._tree.leads(base, sensor):
                rule = f"transforms already give the pose of {sensor} on {base}"
                raise MalformedInputError(rule, source=self._bag.path, place="--mount")
            self._tree.add(base, sensor, 0, (x, y, 0.0), from_yaw(yaw).tolist(), is_static=True)

    def _take_poses(self, path: Path, sensors: list[str]) -> None:
        self._fixed = fixed = (self._options.fixed_frame or FIXED_FRAMES[0]).lstrip("/")
        self._take_mount(sensors)
        base = self.base_frame()
        frames = [base] if base is not None else sensors
        wanted = self._options.base_frame or BASE_FRAMES[0]
        if base is None and len(sensors) > 1:
            rule = (
                f"no transforms lead from {wanted} to {', '.join(sensors)}: whose poses are they?"
            )
            hint = "--topic names one; --mount gives its pose on the robot"
            raise MalformedInputError(rule, source=path, hint=hint)
        if base is None:
            text = f"{path} is taken for the poses of {sensors[0]}: no transform leads there from"
            self._bag.remark(f"{text} {wanted}; --mount gives the pose of a sensor on the robot")
        trajectory = read_trajectory(path)
        rows = zip(*(part.tolist() for part in trajectory), strict=True)
        for time, translation, quaternion in rows:
            for frame in frames:
                self._tree.add(fixed, frame, time, translation, quaternion, is_static=False)
        self._check(fixed, sensors)

    def _fixed_for(self, sensors: list[str]) -> str:
        named = self._options.fixed_frame
        if named is not None:
            named = named.lstrip("/")
            if not self._leads(named, sensors):
                self._take_odometry(sensors)
            self._check(named, sensors)
            return named
        found = next((name for name in FIXED_FRAMES if self._leads(name, sensors)), None)
        if found is None:
            self._take_odometry(sensors)
            found = next((name for name in FIXED_FRAMES if self._leads(name, sensors)), None)
        if found is None:
            found = self._root_of(sensors)
        if found != FIXED_FRAMES[0]:
            text = f"no transforms lead to {FIXED_FRAMES[0]}: the map is made in {found}"
            drift = ", with whatever its odometry drifts" if found == FIXED_FRAMES[1] else ""
            self._bag.remark(text + drift)
        return found

    def _leads(self, fixed: str, sensors: list[str]) -> bool:
        return all(self._tree.leads(fixed, sensor) for sensor in sensors)

    def _root_of(self, sensors: list[str]) -> str:
        root = self._tree.root_of(sensors[0])
        if self._leads(root, sensors) and self._tree.is_moving(root, sensors[0]):
            return root
        raise self._no_way(FIXED_FRAMES[0], sensors)

    def _check(self, fixed: str, sensors: list[str]) -> None:
        if not self._leads(fixed, sensors):
            raise self._no_way(fixed, sensors)

    def _no_way(self, fixed: str, sensors: list[str]) -> MalformedInputError:
        sensor = next((one for one in sensors if not self._tree.leads(fixed, one)), sensors[0])
        error = self._tree.no_way(fixed, sensor).found_in(self._bag.path)
        hint = "--poses FILE gives the robot's poses, t x y z qx qy qz qw a line"
        if len(self._tree.frames) > 1:
            hint = "--fixed-frame names another frame, --mount gives the pose of a sensor on the "
            hint += "robot, --poses FILE gives its poses"
        error.hint = hint
        return error

    def _take_odometry(self, sensors: list[str]) -> None:
        named = [] if self._options.odometry is None else [self._options.odometry]
        if not named and not self._bag.of_types(ODOMETRY):
            return
        connections = chosen_connections(self._bag, named, (ODOMETRY,), "odometry")
        for place in self._bag.index([one.id for one in connections]):
            self._add(self._decoder.read(place, odometry_of), is_static=False)
        self._take_mount([one for one in sensors if one not in self._tree.frames])


def _of_tf(bag: Bag) -> tuple[list[Connection], list[Connection]]:
    """Return the connections with transforms: those that move, and those that are static."""
    # Those of /tf and /tf_static; of a robot with a namespace, if there are no others, its own.
    ours = [one for one in bag.of_types(*TF_TYPES) if one.encoding in CAN_BE_READ]
    plain = [one for one in ours if one.topic in (_TF, _STATIC)]
    ours = plain or ours
    static = [one for one in ours if one.topic.endswith(_STATIC)]
    return [one for one in ours if one not in static], static


_POINTS_TOGETHER = 1 << 18
_BYTES = 80
"""Bytes for each point that are there at the same time, at most."""

_TYPES = (POINT_CLOUD, LASER_SCAN)


class BagClouds:
    """The clouds of one topic of a bag that is open: point clouds, or laser scans."""

    def __init__(
        self,
        bag: Bag,
        topics: Sequence[str],
        options: FrameOptions,
        *,
        has_poses: bool,
        is_raw: bool = False,
    ) -> None:
        connections = chosen_connections(bag, topics, _TYPES, "points and laser scans")
        if len({one.topic for one in connections}) > 1:
            raise ParameterError("one topic of clouds is taken", source="--topic")
        self.bag = bag
        self.topic = connections[0].topic
        self._types = {one.id: one.type for one in connections}
        self._index = bag.index(self._types)
        if not len(self._index):
            raise bag.malformed("holds no messages", self.topic)
        self._decoder = Decoder(bag)
        self._options = options
        self._has_poses = has_poses
        self._is_raw = is_raw
        self._frames = SensorFrames(bag, options)
        self._base: str | None = None

    def __len__(self) -> int:
        return len(self._index)

    @property
    def preparation(self) -> int:
        """How many steps `prepare` has."""
        return self._frames.count

    @property
    def files(self) -> tuple[Path, ...]:
        return (*self.bag.files, *self._frames.files)

    def prepare(self, advance: Callable[[int], object] = lambda _: None) -> None:
        """Read transforms; find those from the sensor to the robot and the fixed frame."""
        _, sensor = self._decoder.header(self._index[0])
        if self._has_poses:
            self._frames.read_alone(sensor, advance)
        else:
            self._frames.read([sensor], advance)
        self._base = self._frames.base_frame()
        if not self._has_poses:
            if self._base is None or not self._frames.leads(self._base, sensor):
                self._base = None
                text = f"no transforms lead from {BASE_FRAMES[0]} to {sensor}: the robot's pose is "
                self.bag.remark(f"{text}that of {sensor}")
            return
        if self._is_raw or (self._base is not None and self._frames.leads(self._base, sensor)):
            return
        self._base = None
        if sensor in FIXED_FRAMES:
            rule = f"the points of {self.topic} are in frame {sensor}"
            raise ParameterError(rule, source="--frame", hint="--frame map takes them so")
        if sensor not in BASE_FRAMES:
            text = f"no transforms lead from {BASE_FRAMES[0]} to {sensor}: its points are taken for"
            self.bag.remark(f"{text} the robot's own; --mount gives the pose of the sensor")

    def number(self, index: int | None) -> int:
        """Return the number of a message, counted from 0 on, or from the last, -1, back."""
        count = len(self)
        index = -1 if index is None else index
        if not -count <= index < count:
            rule = f"{self.topic} has {count} messages: 0 to {count - 1}, or -1 to {-count}"
            raise ParameterError(rule, source="--index", got=index)
        return index % count

    def poses(self, numbers: Sequence[int]) -> list[Pose | None]:
        """Return where the robot was at each of some clouds; None where it is not known."""
        headers = [self._header(number) for number in numbers]
        found: list[Pose | None] = [None] * len(numbers)
        for frame in {self._base or frame for _, frame in headers}:
            ours = [k for k, (_, one) in enumerate(headers) if (self._base or one) == frame]
            times = np.array([headers[k][0] for k in ours], np.int64)
            with errors_named(self.bag.path):
                posed = self._frames.at(frame, times)
            stance = stances(posed.translations, posed.quaternions)
            for k, pose, known in zip(ours, stance.poses.tolist(), posed.known, strict=True):
                found[k] = (pose[0], pose[1], pose[2]) if known else None
            missing = int(np.count_nonzero(~posed.known))
            if missing:
                text = (
                    f"{missing} of {len(numbers)} clouds are left out: where {frame} was is known"
                )
                text += f" {self._frames.told_span(frame)}"
                emit_warning(f"{self.bag.path}: {text}", stacklevel=2)
        return found

    def pose(self, number: int) -> Pose:
        (pose,) = self.poses([number])
        if pose is None:
            rule = f"where the robot was at message {number} is not known"
            hint = "--pose X,Y,YAW gives its pose"
            raise MalformedInputError(rule, source=self.bag.path, place=self.topic, hint=hint)
        return pose

    def cloud(self, number: int) -> BagCloud:
        return BagCloud(self, number)

    def points(self, number: int) -> Points:
        """Return the points of a cloud, shape (N, 3), as the robot sees them."""
        place = self._index[number]
        is_cloud = self._types[place.connection] == POINT_CLOUD
        points = self._decoder.read(place, self._points_of if is_cloud else _points_of_scan)
        if self._is_raw or self._base is None:
            return points
        time, sensor = self._header(number)
        moves, turns = self._mount(sensor, time)
        if points.shape[1] == 2:
            points = np.column_stack([points, np.zeros(len(points))])
        with np.errstate(invalid="ignore"):
            return np.asarray(rotated(turns, points) + moves)

    def _points_of(self, message: Any) -> Points:
        count = int(message.width) * int(message.height)
        claim(self.bag.path, _BYTES * count, what="the points of a cloud")
        return points_of(message)

    @cached_property
    def sums(self) -> dict[str, str]:
        """The sha256 of all files: each is read once for all clouds."""
        return {path.name: sha256_of(path) for path in self.files}

    @cached_property
    def states(self) -> dict[Path, FileState]:
        return {path: state_of(path) for path in self.files}

    @property
    def topic_and_mount(self) -> dict[str, str]:
        """What else shapes the points."""
        mount = self._options.mount
        told = {"topic": self.topic, "base_frame": self._base or "none"}
        return told if mount is None else told | {"mount": ",".join(map(repr, mount))}

    def _header(self, number: int) -> tuple[int, str]:
        place: Place = self._index[number]
        time, frame = self._decoder.header(place)
        return time or place.time, frame

    def _mount(self, sensor: str, time: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return where a sensor stands on the robot: straight, or by way of the fixed frame."""
        times = np.array([time], np.int64)
        base = self._base or sensor
        with errors_named(self.bag.path):
            posed = self._frames.between(base, sensor, times)
        if not posed.known.all():
            rule = f"where {sensor} stands on {base} is not known at {time} ns"
            raise MalformedInputError(rule, source=self.bag.path, place=self.topic)
        return posed.translations[0], posed.quaternions[0]


def _points_of_scan(message: Any) -> Points:
    return points_of_scan(laser_scan_of(message))


@dataclass(frozen=True, eq=False)
class BagCloud(Cloud):
    """A message of a bag."""

    source: BagClouds
    number: int

    @property
    def path(self) -> Path:
        """What errors and pictures name: no file, but the bag and the message."""
        return Path(f"{self.source.bag.path}, message {self.number}")

    @property
    def files(self) -> tuple[Path, ...]:
        return self.source.files

    @property
    def name(self) -> str:
        """The bag, the topic and the number."""
        return f"{self.path.name} of {self.source.topic}"

    def summed(self) -> SummedCloud:
        """Return the cloud with the checksums of its bag; see `Cloud`."""
        states = self.source.states
        options = {**self.source.topic_and_mount, "message": str(self.number)}
        return SummedCloud(self, self.source.sums, options, states)

    def chunks(self) -> Iterator[Points]:
        """Yield the points; see `Cloud`."""
        points = self.source.points(self.number)
        for first in range(0, len(points), _POINTS_TOGETHER):
            yield points[first : first + _POINTS_TOGETHER]


@contextmanager
def clouds_of_bag(
    path: Path,
    topics: Sequence[str],
    options: FrameOptions,
    *,
    has_poses: bool,
    is_raw: bool = False,
) -> Iterator[BagClouds]:
    """Open the clouds of a bag within a ``with`` block; see `BagClouds`."""
    with open_bag(path) as bag:
        yield BagClouds(bag, topics, options, has_poses=has_poses, is_raw=is_raw)


T = TypeVar("T", Posed, Stances)

_SCANS_TOGETHER = 512
_READINGS_TOGETHER = 1 << 18
_OF_READING = 140
"""Bytes of a reading, in all that is made of it."""


class BagScans(ScanSource):
    """The laser scans of a bag that is open."""

    # Scans come in the order of their recording times. Those outside of the times of the transforms
    # are left out and counted, as are those of a sensor that leans by more than 10 degrees.

    def __init__(
        self, bag: Bag, topics: Sequence[str], options: FrameOptions, *, deskew: bool = False
    ) -> None:
        connections = chosen_connections(bag, topics, (LASER_SCAN,), "laser scans")
        self._index = bag.index([one.id for one in connections])
        if not len(self._index):
            raise bag.malformed("holds no messages", ", ".join({c.topic for c in connections}))
        self._bag = bag
        self._decoder = Decoder(bag)
        self._deskew = deskew
        self._frames = SensorFrames(bag, options)
        self._is_prepared = False
        self._outside: dict[str, int] = {}
        self._leaning = self._unstamped = 0
        self._has_steps = False
        self.files = (*bag.files, *self._frames.files)

    @property
    def named(self) -> Path:
        return self._bag.path

    @property
    def count(self) -> int:
        return len(self._index)

    @property
    def preparation(self) -> int:
        """How many transforms are read before; see `ScanSource`."""
        return self._frames.count

    def prepare(self, advance: Callable[[int], object] = lambda _: None) -> None:
        """Read all transforms; see `ScanSource`."""
        if not self._is_prepared:
            self._frames.read(self._sensors(), advance)
            self._is_prepared = True

    def scans(self) -> Iterator[ScanArrays]:
        """Yield all scans in their order, some at a time; see `ScanSource.scans`."""
        self.prepare()
        self._outside = {}
        self._leaning = self._unstamped = 0
        together: list[LaserScan] = []
        readings = 0
        for place in self._index:
            scan = self._decoder.read(place, laser_scan_of)
            if scan.time == 0:
                self._unstamped += 1
                scan = scan.at(place.time)
            together.append(scan)
            count = len(scan.ranges)
            claim(self._bag.path, _OF_READING * count, what=f"the {count} readings of a scan")
            readings += count
            if len(together) == _SCANS_TOGETHER or readings > _READINGS_TOGETHER:
                yield from self._placed(together)
                together, readings = [], 0
        yield from self._placed(together)

    def warn(self) -> None:
        for frame, count in sorted(self._outside.items()):
            text = f"{self._bag.path}: {count} of {self.count} scans are left out: where {frame} "
            text += f"was is known {self._frames.told_span(frame)}"
            emit_warning(text, stacklevel=2)
        if self._leaning:
            text = f"{self._leaning} of {self.count} scans are left out: their sensor leans by more"
            emit_warning(f"{self._bag.path}: {text} than 10 degrees", stacklevel=2)
        if self._unstamped:
            text = f"{self._unstamped} scans have no time: that of their recording is taken"
            emit_warning(f"{self._bag.path}: {text}", stacklevel=2)
        if self._deskew and not self._has_steps:
            text = "no scan has a time between beams: --deskew has no effect"
            emit_warning(f"{self._bag.path}: {text}", stacklevel=2)

    def _sensors(self) -> set[str]:
        """Return the frames of all topics, by the first message of each connection."""
        _, firsts = np.unique(self._index.connections, return_index=True)
        return {self._decoder.header(self._index[int(first)])[1] for first in firsts}

    def _placed(self, scans: list[LaserScan]) -> Iterator[ScanArrays]:
        """Yield scans with the poses of their sensors, those of one kind together."""
        if self._deskew and any(scan.between for scan in scans):
            self._has_steps = True
            yield from self._deskewed(scans)
            return
        for run in self._runs(scans, [np.array([scan.time], np.int64) for scan in scans]):
            yield from _as_arrays(*run)

    def _runs(
        self, scans: list[LaserScan], times: list[NDArray[np.int64]]
    ) -> Iterator[tuple[list[LaserScan], Posed, Stances]]:
        """Yield scans of the same geometry that follow each other, without those left out."""
        # The poses are those of all times of a scan, one scan behind the other.
        found = self._looked_up(scans, times)
        kept: list[tuple[LaserScan, Posed, Stances]] = []
        for scan, (posed, stance) in zip(scans, found, strict=True):
            if not posed.known.all():
                self._outside[scan.frame] = self._outside.get(scan.frame, 0) + 1
            elif stance.leans.any():
                self._leaning += 1
            else:
                kept.append((scan, posed, stance))
        for _, some in groupby(kept, lambda one: (*one[0].geometry, *_kind(one[2]))):
            run = list(some)
            yield (
                [scan for scan, _, _ in run],
                _joined([posed for _, posed, _ in run]),
                _joined([stance for _, _, stance in run]),
            )

    def _looked_up(
        self, scans: list[LaserScan], times: list[NDArray[np.int64]]
    ) -> list[tuple[Posed, Stances]]:
        """Return where the sensor of each scan was at its times: asked for by frame, at once."""
        found: list[tuple[Posed, Stances] | None] = [None] * len(scans)
        for frame in {scan.frame for scan in scans}:
            numbers = [k for k, scan in enumerate(scans) if scan.frame == frame]
            with errors_named(self._bag.path):
                posed = self._frames.at(frame, np.concatenate([times[k] for k in numbers]))
            stance = stances(posed.translations, posed.quaternions)
            start = 0
            for k in numbers:
                some = slice(start, start + len(times[k]))
                start = some.stop
                found[k] = (
                    Posed(posed.translations[some], posed.quaternions[some], posed.known[some]),
                    Stances(*(getattr(stance, name)[some] for name in Stances.__annotations__)),
                )
        return [one for one in found if one is not None]

    def _deskewed(self, scans: list[LaserScan]) -> Iterator[ScanArrays]:
        times = [scan.beam_times() for scan in scans]
        for run, posed, stance in self._runs(scans, times):
            angles = np.concatenate([scan.angles for scan in run])
            headings, shares = beams_in_plane(posed.quaternions, angles)
            ranges = np.concatenate([scan.ranges for scan in run])
            ranges = np.where(stance.is_level, ranges, ranges * shares)
            poses = np.column_stack([posed.translations[:, :2], headings])
            yield ScanArrays(poses, np.zeros(1), ranges[:, np.newaxis], len(run))


def _kind(stance: Stances) -> tuple[bool, bool]:
    return bool(stance.is_level.all()), bool(stance.is_flipped[0])


def _as_arrays(scans: list[LaserScan], posed: Posed, stance: Stances) -> Iterator[ScanArrays]:
    angles = scans[0].angles
    if stance.is_level.all():
        if stance.is_flipped[0]:
            angles = -angles
        yield ScanArrays(stance.poses, angles, np.stack([scan.ranges for scan in scans]))
        return
    for k, scan in enumerate(scans):
        quaternions = np.broadcast_to(posed.quaternions[k], (len(angles), 4))
        headings, shares = beams_in_plane(quaternions, angles)
        pose = np.array([[*posed.translations[k, :2], 0.0]])
        yield ScanArrays(pose, headings, (scan.ranges * shares)[np.newaxis])


def _joined(parts: list[T]) -> T:
    names = type(parts[0]).__annotations__
    arrays = (np.concatenate([getattr(one, name) for one in parts]) for name in names)
    return type(parts[0])(*arrays)


@contextmanager
def scans_of_bag(
    path: Path, topics: Sequence[str], options: FrameOptions, *, deskew: bool = False
) -> Iterator[BagScans]:
    """Open the laser scans of a bag within a ``with`` block; see `BagScans`."""
    with open_bag(path) as bag:
        yield BagScans(bag, topics, options, deskew=deskew)
