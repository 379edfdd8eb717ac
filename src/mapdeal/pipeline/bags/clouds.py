"""The clouds of a bag, in the frame of the robot, each with the robot's pose."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, ParameterError, emit_warning
from mapdeal.formats.bags.bag import Bag, Place
from mapdeal.formats.bags.decoding import Decoder
from mapdeal.formats.bags.messages import (
    LASER_SCAN,
    POINT_CLOUD,
    laser_scan_of,
    points_of,
    points_of_scan,
)
from mapdeal.formats.bags.reader import chosen_connections, open_bag
from mapdeal.formats.budget import claim
from mapdeal.formats.source import FileState, sha256_of, state_of
from mapdeal.kernels.rotations import rotated
from mapdeal.mapping.beams import stances
from mapdeal.pipeline.bags.frames import BASE_FRAMES, FIXED_FRAMES, FrameOptions, SensorFrames
from mapdeal.pipeline.files import errors_named
from mapdeal.pipeline.local import Cloud, Points, SummedCloud
from mapdeal.records import dataclass

Pose = tuple[float, float, float]

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
