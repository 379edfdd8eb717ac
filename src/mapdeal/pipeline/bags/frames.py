"""Where the sensors of a bag were: by its transforms, its odometry, or a file of poses."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.formats.bags.bag import CAN_BE_READ, Bag, Connection
from mapdeal.formats.bags.decoding import Decoder
from mapdeal.formats.bags.messages import ODOMETRY, TF_TYPES, Stamped, odometry_of, transforms_of
from mapdeal.formats.bags.reader import chosen_connections
from mapdeal.formats.poses import read_trajectory
from mapdeal.kernels.rotations import from_yaw
from mapdeal.mapping.beams import FARTHEST_POSE
from mapdeal.mapping.transforms import Posed, TransformTree
from mapdeal.records import dataclass

FIXED_FRAMES = ("map", "odom")
"""Frames that maps are made in, the best first."""

BASE_FRAMES = ("base_link", "base_footprint")
"""Usual names of the robot's frame, the most common first."""

_TF, _STATIC = "/tf", "/tf_static"
_SEVERAL = 3

Pose = tuple[float, float, float]


@dataclass(frozen=True)
class FrameOptions:
    """Sources of the sensors' poses."""

    fixed_frame: str | None = None
    base_frame: str | None = None
    poses: Path | None = None
    odometry: str | None = None
    mount: Pose | None = None


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
