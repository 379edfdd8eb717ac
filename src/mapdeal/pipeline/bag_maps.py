"""Contents of a bag, and the commands that accept it."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cached_property, reduce
from itertools import compress, groupby, islice
from os import PathLike
from pathlib import Path
from typing import Any, Concatenate, Literal, ParamSpec, TypeVar

import numpy as np

from mapdeal.bags import messages
from mapdeal.bags.bag import Bag, Connection, MessageIndex, MessageSpan, normalised_type
from mapdeal.bags.messages import Decoder, LaserScan
from mapdeal.bags.reader import open_bag, select_connections
from mapdeal.errors import MalformedInputError, ParameterError, emit_warning
from mapdeal.files.source import FileState, claim, sha256_of, state_of
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.arrays import Floats, Integers
from mapdeal.kernels.rotations import from_yaw, rotated
from mapdeal.mapping.evidence import FARTHEST_POSE, Stances, beams_in_plane, stances
from mapdeal.mapping.transforms import FrameOptions, Pose, Posed, TransformTree
from mapdeal.pipeline import inputs, local
from mapdeal.pipeline.settings import ProgressCallback, Settings, report_nothing
from mapdeal.records import dataclass, replace
from mapdeal.sensors.points import read_trajectory
from mapdeal.sensors.scans import ScanArrays, ScanSource

ReadAs = Literal["map", "costs"]
P = ParamSpec("P")
T = TypeVar("T")
_OF_COSTS = "costmap"  # word in the names of topics on which Nav2 and move_base publish costs


def _index_of(bag: Bag, connections: Sequence[Connection]) -> MessageIndex:
    index = bag.index([connection.id for connection in connections])
    if not len(index):
        topics = dict.fromkeys(connection.topic for connection in connections)
        raise bag.malformed("holds no messages", ", ".join(topics))
    return index


def _number_in(index: MessageIndex, number: int, topic: str, **where: str) -> int:
    count = len(index)
    if not -count <= number < count:
        rule = f"{topic} has {count} messages: 0 to {count - 1}, or -1 to {-count}"
        raise ParameterError(rule, got=number, **where)
    return number % count


class GridTopic:
    def __init__(self, bag: Bag, topic: str | None, read_as: ReadAs | None = None) -> None:
        named = [] if topic is None else [topic]
        connections = select_connections(bag, named, messages.GRID_TYPES, "maps and costmaps")
        self._types = {connection.id: connection.type for connection in connections}
        self._index, self._decoder = _index_of(bag, connections), Decoder(bag)
        self.files, self.topic = bag.files, connections[0].topic
        self._is_costs = _OF_COSTS in self.topic.lower() if read_as is None else read_as == "costs"

    def __len__(self) -> int:
        return len(self._index)

    def read(self, number: int) -> OccupancyGrid | Costmap:
        place = self._index[_number_in(self._index, number, self.topic, place="index")]
        name, is_costs = self._types[place.connection], self._is_costs
        return self._decoder.read(place, lambda m: messages.grid_of(m, name, is_costs=is_costs))


@contextmanager
def from_bag(
    path: Path, reader: Callable[Concatenate[Bag, P], T], *args: P.args, **options: P.kwargs
) -> Iterator[T]:
    with open_bag(path) as bag:
        yield reader(bag, *args, **options)


def read_map_from_bag(
    path: str | PathLike[str], topic: str | None = None, *, index: int = -1,
    read_as: ReadAs | None = None, max_memory: int | None = None,
) -> OccupancyGrid | Costmap:  # fmt: skip
    """Read a map or costmap from a bag, like ``mapdeal convert BAG``.

    Parameters
    ----------
    path : path or str
        A ROS 1 ``.bag``, a folder with a ROS 2 bag, or a ``.db3`` or ``.mcap`` file.
    topic : str, optional
        Topic of type nav_msgs/OccupancyGrid or nav2_msgs/Costmap. It can be omitted if the bag
        has only one.
    index : int
        Index of the message in recording order; negative values count from the last.
    read_as : {'map', 'costs'}, optional
        Meaning of the values of an OccupancyGrid. By default they are costs if the topic name
        contains ``costmap``, otherwise a map.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory.

    Returns
    -------
    OccupancyGrid or Costmap
        The map, or the costs on the scale of the message.

    Raises
    ------
    ParameterError
        If the extra ``bags`` is not installed, or `index` is out of range.
    FileAccessError, MalformedInputError
        If the bag cannot be read, or has no such topic.

    Warns
    -----
    MapdealWarning
        If the bag is damaged; the intact part is read.
    """
    settings = Settings(max_memory=max_memory)
    with settings.reading(), from_bag(Path(path), GridTopic, topic, read_as) as found:
        return found.read(index)


_TYPES = (*messages.CLOUD_TYPES, messages.LASER_SCAN)
_COMMANDS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(messages.GRID_TYPES, ("convert",)),
    **dict.fromkeys((*_TYPES, *messages.TF_TYPES), ("build", "local")),
    messages.ODOMETRY: ("build",),
}


def describe_bag(path: Path, *, progress: ProgressCallback | None = None) -> dict[str, Any]:
    with open_bag(path) as bag:
        spans, decoder = bag.summary(), Decoder(bag)
        topics = list(_topics(bag, spans, decoder))
        edges: list[dict[str, Any]] = []
        try:
            edges = _edges(bag, decoder, progress or report_nothing)
        except ParameterError as error:  # lz4 is not installed
            bag.warn_once(f"{error.rule} for frames and transforms")
        span = reduce(MessageSpan.joined, spans.values(), MessageSpan())
        if not span.count:
            bag.warn_once("holds no messages")
        return {
            "file": str(path),
            "kind": "bag",
            "is": bag.form,
            "messages": span.count,
            "start_ns": span.first if span.count else None,
            "end_ns": span.last if span.count else None,
            "duration_s": (span.last - span.first) * 1e-9 if span.count else None,
            "topics": topics,
            "transforms": edges,
            "use": list(_uses(path, topics)),
        }


def _topics(bag: Bag, spans: dict[int, MessageSpan], decoder: Decoder) -> Iterator[dict[str, Any]]:
    groups: dict[tuple[str, str], list[Connection]] = {}
    for connection in bag.connections:
        groups.setdefault((connection.topic, connection.type), []).append(connection)
    for (topic, name), connections in sorted(groups.items()):
        of_topic = (spans[connection.id] for connection in connections)
        span = reduce(MessageSpan.joined, of_topic, MessageSpan())
        is_readable = connections[0].encoding and span.count
        commands = list(_COMMANDS.get(name, ())) if is_readable else []
        has_frame = commands and name not in messages.TF_TYPES
        yield {
            "topic": topic,
            "type": connections[0].spelled,
            "count": span.count,
            "first_ns": span.first if span.count else None,
            "last_ns": span.last if span.count else None,
            "frame": _frame(bag, connections, decoder) if has_frame else None,
            "commands": commands,
        }


def _frame(bag: Bag, connections: list[Connection], decoder: Decoder) -> str | None:
    pieces = (places for connection in connections for places in bag.pieces([connection.id]))
    for places in filter(len, pieces):
        with suppress(MalformedInputError, ParameterError):
            return decoder.header(places[0])[1]
    return None


def _edges(bag: Bag, decoder: Decoder, progress: ProgressCallback) -> list[dict[str, Any]]:
    types = (*messages.TF_TYPES, messages.ODOMETRY)
    readable = [each for each in bag.of_types(*types) if each.encoding]
    by_id = {connection.id: connection for connection in readable}
    index = bag.index(by_id) if by_id else ()
    found: Counter[tuple[str, str, str]] = Counter()
    with progress(len(index)) as advance:
        for place in index:
            connection = by_id[place.connection]
            if connection.type == messages.ODOMETRY:
                stamped = [decoder.read(place, messages.odometry_of)]
            else:
                stamped = decoder.read(place, messages.transforms_of)
            found.update((connection.topic, item.parent, item.child) for item in stamped)
            advance(1)
    return [
        {"topic": topic, "parent": parent, "child": child, "count": count}
        for (topic, parent, child), count in sorted(found.items())
    ]


def _uses(path: Path, topics: list[dict[str, Any]]) -> Iterator[str]:
    name = shlex.quote(str(path))
    lines = (
        (messages.GRID_TYPES, f"mapdeal convert {name} --topic {{}} -o OUT.yaml"),
        ((messages.LASER_SCAN,), f"mapdeal build {name} --topic {{}} -o OUT.yaml"),
        (messages.CLOUD_TYPES, f"mapdeal build --cloud {name} --topic {{}} -o OUT.yaml"),
        (messages.CLOUD_TYPES, f"mapdeal local --cloud {name} --topic {{}} -o DIR"),
    )
    recorded = [row for row in topics if row["count"]]
    for names, line in lines:
        fitting = (row["topic"] for row in recorded if normalised_type(row["type"]) in names)
        yield from (line.format(shlex.quote(topic)) for topic in islice(fitting, 1))


FIXED_FRAMES = ("map", "odom")  # frames that maps are made in, the best first
BASE_FRAMES = ("base_link", "base_footprint")  # usual names of the robot's frame
_TF, _STATIC = "/tf", "/tf_static"
_SEVERAL = 3


class SensorFrames:
    def __init__(self, bag: Bag, options: FrameOptions, *, is_exact: bool = False) -> None:
        self._bag, self._options, self._decoder = bag, options, Decoder(bag)
        self.tree = TransformTree(is_exact=is_exact)
        self._fixed = FIXED_FRAMES[0]
        # A robot with a namespace may have its own topics in place of /tf and /tf_static.
        readable = [tf for tf in bag.of_types(*messages.TF_TYPES) if tf.encoding]
        readable = [tf for tf in readable if tf.topic in (_TF, _STATIC)] or readable
        self._static = [tf.id for tf in readable if tf.topic.endswith(_STATIC)]
        moving = [tf.id for tf in readable if tf.id not in self._static]
        listed = self._static if options.poses is not None else [*moving, *self._static]
        self._index = bag.index(listed)
        self.count = len(self._index)
        self.files = () if options.poses is None else (options.poses,)

    def read(self, of_sensors: set[str], advance: Callable[[int], object]) -> None:
        sensors = sorted(of_sensors)
        self.read_all(advance)
        if self._options.poses is not None:
            self._take_poses(self._options.poses, sensors)
        else:
            self.add_mount(sensors)
            self._fixed = self._fixed_for(sensors)
        if self.tree.bad:
            self._bag.warn_once(f"{self.tree.bad} invalid transforms are ignored")
        for parent, child in self.tree.of_both_kinds[:_SEVERAL]:
            text = f"{parent} -> {child} is both static and dynamic"
            self._bag.warn_once(f"{text}: the more frequent kind is used")
        for child, (chosen, *unused) in sorted(self.tree.several_parents.items())[:_SEVERAL]:
            text = f"frame {child} has several parents: {chosen}, the most frequent, is used"
            self._bag.warn_once(f"{text}, and not {', '.join(unused)}")

    def at_each(self, frames: Sequence[str], times: Sequence[Integers]) -> Posed:
        """Return where each frame was at its own times, one frame behind the other."""
        counts, every = [len(own) for own in times], np.concatenate(times)
        found = Posed(np.empty((len(every), 3)), np.empty((len(every), 4)), every < 0)
        for frame in dict.fromkeys(frames):  # each asked for its poses once
            ours = np.repeat([own == frame for own in frames], counts)
            with inputs.errors_named(self._bag.path):
                posed = self.tree.lookup(self._fixed, frame, every[ours])
                if (np.abs(posed.translations[posed.known]) > FARTHEST_POSE).any():
                    rule = f"{frame} is farther than {FARTHEST_POSE:g} m from {self._fixed}"
                    raise MalformedInputError(rule)
            found.translations[ours] = posed.translations
            found.quaternions[ours] = posed.quaternions
            found.known[ours] = posed.known
        return found

    def span_text(self, frame: str) -> str:
        span = self.tree.span(self._fixed, frame)
        return f"from {span[0] / 1e9:.3f} to {span[1] / 1e9:.3f} s" if span else "at no time"

    def base_frame(self) -> str | None:
        named = self._options.base_frame
        names = BASE_FRAMES if named is None else (named.lstrip("/"),)
        return next((name for name in names if name in self.tree.frames), None)

    def read_all(self, advance: Callable[[int], object]) -> None:
        static = set(self._static)
        for place in self._index:
            for transform in self._decoder.read(place, messages.transforms_of):
                self._add(transform, is_static=place.connection in static)
            advance(1)

    def _add(self, transform: messages.Stamped, *, is_static: bool) -> None:
        pose = transform.time, transform.translation, transform.quaternion
        self.tree.add(transform.parent, transform.child, *pose, is_static=is_static)

    def add_mount(self, sensors: list[str]) -> None:
        if self._options.mount is None:
            return
        if len(sensors) > 1:
            rule = f"applies to one sensor, and there are {', '.join(sensors)}"
            raise ParameterError(rule, source="--mount", hint="--topic names one")
        x, y, yaw = self._options.mount
        base = self.base_frame() or self._options.base_frame or BASE_FRAMES[0]
        for sensor in sensors:
            if self.tree.leads(base, sensor):
                rule = f"transforms already give the pose of {sensor} on {base}"
                raise MalformedInputError(rule, source=self._bag.path, place="--mount")
            self.tree.add(base, sensor, 0, (x, y, 0.0), from_yaw(yaw).tolist(), is_static=True)

    def _take_poses(self, path: Path, sensors: list[str]) -> None:
        self._fixed = fixed = (self._options.fixed_frame or FIXED_FRAMES[0]).lstrip("/")
        self.add_mount(sensors)
        base = self.base_frame()
        frames = [base] if base is not None else sensors
        base_name = self._options.base_frame or BASE_FRAMES[0]
        if base is None and len(sensors) > 1:
            leads = f"no transforms lead from {base_name} to {', '.join(sensors)}"
            hint = "--topic names one; --mount gives its pose on the robot"
            raise MalformedInputError(f"{leads}: whose poses are they?", source=path, hint=hint)
        if base is None:
            text = f"{path} is taken for the poses of {sensors[0]}: no transform leads there from"
            hint = "--mount gives the pose of a sensor on the robot"
            self._bag.warn_once(f"{text} {base_name}; {hint}")
        for pose in zip(*(part.tolist() for part in read_trajectory(path)), strict=True):
            for frame in frames:
                self.tree.add(fixed, frame, *pose, is_static=False)
        if not self._leads(fixed, sensors):
            raise self._no_way(fixed, sensors)

    def _fixed_for(self, sensors: list[str]) -> str:
        named = self._options.fixed_frame
        names = FIXED_FRAMES if named is None else (named.lstrip("/"),)
        found = next((name for name in names if self._leads(name, sensors)), None)
        if found is None:
            self._take_odometry(sensors)
            found = next((name for name in names if self._leads(name, sensors)), None)
        if found is None and named is None:
            root = self.tree.root_of(sensors[0])
            if self._leads(root, sensors) and self.tree.is_moving(root, sensors[0]):
                found = root
        if found is None:
            raise self._no_way(names[0], sensors)
        if named is None and found != FIXED_FRAMES[0]:
            text = f"no transforms lead to {FIXED_FRAMES[0]}: the map is made in {found}"
            drift = ", with whatever its odometry drifts" if found == FIXED_FRAMES[1] else ""
            self._bag.warn_once(text + drift)
        return found

    def _leads(self, fixed: str, sensors: list[str]) -> bool:
        return all(self.tree.leads(fixed, sensor) for sensor in sensors)

    def _no_way(self, fixed: str, sensors: list[str]) -> MalformedInputError:
        sensor = next((name for name in sensors if not self.tree.leads(fixed, name)), sensors[0])
        error = self.tree.no_chain(fixed, sensor).found_in(self._bag.path)
        error.hint = "--poses FILE gives the robot's poses, t x y z qx qy qz qw a line"
        if len(self.tree.frames) > 1:
            error.hint = "--fixed-frame names another frame, --mount gives the pose of a sensor on "
            error.hint += "the robot, --poses FILE gives its poses"
        return error

    def _take_odometry(self, sensors: list[str]) -> None:
        named = [] if self._options.odometry is None else [self._options.odometry]
        if not named and not self._bag.of_types(messages.ODOMETRY):
            return
        connections = select_connections(self._bag, named, (messages.ODOMETRY,), "odometry")
        for place in self._bag.index([connection.id for connection in connections]):
            self._add(self._decoder.read(place, messages.odometry_of), is_static=False)
        self.add_mount([name for name in sensors if name not in self.tree.frames])


_POINTS_TOGETHER = 1 << 18
_BYTES = 80  # bytes for each point that are there at the same time, at most


class BagClouds:
    def __init__(
        self, bag: Bag, topics: Sequence[str], options: FrameOptions, *,
        has_poses: bool, is_raw: bool = False,
    ) -> None:  # fmt: skip
        connections = select_connections(bag, topics, _TYPES, "points and laser scans")
        if len({connection.topic for connection in connections}) > 1:
            raise ParameterError("one topic of clouds is taken", source="--topic")
        self.bag, self.topic = bag, connections[0].topic
        self._connections = {connection.id: connection for connection in connections}
        self._index, self._decoder = _index_of(bag, connections), Decoder(bag)
        self._options, self._has_poses, self._is_raw = options, has_poses, is_raw
        self._frames = SensorFrames(bag, options)
        self._base: str | None = None
        self.preparation = self._frames.count
        self.files = (*bag.files, *self._frames.files)

    def __len__(self) -> int:
        return len(self._index)

    def prepare(self, advance: Callable[[int], object] = lambda _: None) -> None:
        _, sensor = self._decoder.header(self._index[0])
        if self._has_poses:
            self._frames.read_all(advance)
            self._frames.add_mount([sensor])
        else:
            self._frames.read({sensor}, advance)
        self._base = base = self._frames.base_frame()
        if base is not None and self._frames.tree.leads(base, sensor):
            return
        text = f"no transforms lead from {BASE_FRAMES[0]} to {sensor}"
        if not self._has_poses:
            self.bag.warn_once(f"{text}: the robot's pose is that of {sensor}")
        elif self._is_raw:
            return
        elif sensor in FIXED_FRAMES:
            rule = f"the points of {self.topic} are in frame {sensor}"
            raise ParameterError(rule, source="--frame", hint="--frame map takes them so")
        elif sensor not in BASE_FRAMES:
            text += ": its points are taken for the robot's own"
            self.bag.warn_once(f"{text}; --mount gives the pose of the sensor")
        self._base = None

    def number(self, index: int | None) -> int:
        return _number_in(self._index, -1 if index is None else index, self.topic, source="--index")

    def poses(self, numbers: Sequence[int]) -> list[Pose | None]:
        headers = [self._header(number) for number in numbers]
        frames = [self._base or sensor for _, sensor in headers]
        posed = self._frames.at_each(frames, [np.array([time], np.int64) for time, _ in headers])
        for frame, count in Counter(compress(frames, ~posed.known)).items():
            text = f"{self.bag.path}: {count} of {len(numbers)} clouds are left out: where {frame}"
            emit_warning(f"{text} was is known {self._frames.span_text(frame)}")
        poses = stances(posed.translations, posed.quaternions).poses.tolist()
        found = zip(poses, posed.known, strict=True)
        return [(x, y, yaw) if is_known else None for (x, y, yaw), is_known in found]

    def sensors(self) -> Posed:
        headers = [self._header(number) for number in range(len(self))]
        times = [np.array([time], np.int64) for time, _ in headers]
        return self._frames.at_each([frame for _, frame in headers], times)

    def pose(self, number: int) -> Pose:
        (pose,) = self.poses([number])
        if pose is None:
            rule = f"where the robot was at message {number} is not known"
            hint = "--pose X,Y,YAW gives its pose"
            raise MalformedInputError(rule, source=self.bag.path, place=self.topic, hint=hint)
        return pose

    def cloud(self, number: int) -> BagCloud:
        path = Path(f"{self.bag.path}, message {number}")
        return BagCloud(path, f"{path.name} of {self.topic}", self.files, self, number)

    def points(self, number: int) -> Floats:
        place = self._index[number]
        connection = self._connections[place.connection]
        if connection.type in messages.LIVOX_TYPES:
            points = self._points_of_livox(self.bag.read_message(place), connection)
        else:
            is_cloud = connection.type == messages.POINT_CLOUD
            points_of = self._points_of if is_cloud else messages.points_of_scan
            points = self._decoder.read(place, points_of)
        if self._is_raw or self._base is None:
            return points
        time, sensor = self._header(number)
        moves, turns = self._mount(sensor, time)
        if points.shape[1] == 2:
            points = np.column_stack([points, np.zeros(len(points))])
        with np.errstate(invalid="ignore"):
            return np.asarray(rotated(turns, points) + moves)

    def _points_of_livox(self, data: bytes, connection: Connection) -> Floats:
        claim(self.bag.path, 2 * len(data), what="the points of a cloud")
        try:
            return messages.points_of_livox(data, connection.encoding)
        except MalformedInputError as error:
            error.place = error.place or connection.topic
            raise error.found_in(self.bag.path) from None

    def _points_of(self, message: Any) -> Floats:
        count = int(message.width) * int(message.height)
        claim(self.bag.path, _BYTES * count, what="the points of a cloud")
        return messages.points_of(message)

    @cached_property
    def sums(self) -> dict[str, str]:
        return {path.name: sha256_of(path) for path in self.files}

    @cached_property
    def states(self) -> dict[Path, FileState]:
        return {path: state_of(path) for path in self.files}

    @property
    def topic_and_mount(self) -> dict[str, str]:
        mount = self._options.mount
        mounted = {} if mount is None else {"mount": ",".join(map(repr, mount))}
        return {"topic": self.topic, "base_frame": self._base or "none", **mounted}

    def _header(self, number: int) -> tuple[int, str]:
        place = self._index[number]
        time, frame = self._decoder.header(place)
        return time or place.time, frame

    def _mount(self, sensor: str, time: int) -> tuple[Floats, Floats]:
        times = np.array([time], np.int64)
        base = self._base or sensor
        with inputs.errors_named(self.bag.path):
            posed = self._frames.tree.lookup(base, sensor, times)
        if not posed.known.all():
            rule = f"where {sensor} stands on {base} is not known at {time} ns"
            raise MalformedInputError(rule, source=self.bag.path, place=self.topic)
        return posed.translations[0], posed.quaternions[0]


@dataclass(frozen=True, eq=False)
class BagCloud(local.Cloud):
    source: BagClouds
    number: int

    def summed(self) -> local.SummedCloud:
        options = {**self.source.topic_and_mount, "message": str(self.number)}
        return local.SummedCloud(self, self.source.sums, options, self.source.states)

    def chunks(self) -> Iterator[Floats]:
        points = self.source.points(self.number)
        for first in range(0, len(points), _POINTS_TOGETHER):
            yield points[first : first + _POINTS_TOGETHER]


def sequence_of_bag(
    source: BagClouds, poses_file: Path | None, output: Path
) -> list[local.LocalJob]:
    count = len(source)
    found: Sequence[Pose | None]
    found = source.poses(range(count)) if poses_file is None else local.poses_for(count, poses_file)
    known = {number: pose for number, pose in enumerate(found) if pose is not None}
    if not known:
        rule = "of no cloud it is known where the robot was"
        raise MalformedInputError(rule, source=source.bag.path)
    return local.numbered_jobs(list(map(source.cloud, known)), list(known.values()), output)


_SCANS_TOGETHER, _READINGS_TOGETHER = 512, 1 << 18
_OF_READING = 140  # bytes of a reading, in all that is made of it


class BagScans(ScanSource):
    # Scans come in the order of their recording times. Those outside of the times of the transforms
    # are left out and counted, as are those of a sensor that leans by more than 10 degrees.

    def __init__(
        self, bag: Bag, topics: Sequence[str], options: FrameOptions, *, deskew: bool = False
    ) -> None:
        connections = select_connections(bag, topics, (messages.LASER_SCAN,), "laser scans")
        self._index, self._decoder = _index_of(bag, connections), Decoder(bag)
        self._bag, self._deskew = bag, deskew
        self._frames = SensorFrames(bag, options)
        self._is_prepared = self._has_steps = False
        self._outside: dict[str, int] = {}
        self._leaning = self._unstamped = 0
        self.files, self.named = (*bag.files, *self._frames.files), bag.path
        self.count, self.preparation = len(self._index), self._frames.count

    def prepare(self, advance: Callable[[int], object] = lambda _: None) -> None:
        if not self._is_prepared:
            # of all topics, by the first message of each connection
            _, firsts = np.unique(self._index.connections, return_index=True)
            sensors = {self._decoder.header(self._index[int(first)])[1] for first in firsts}
            self._frames.read(sensors, advance)
            self._is_prepared = True

    def scans(self) -> Iterator[ScanArrays]:
        self.prepare()
        self._outside = {}
        self._leaning = self._unstamped = 0
        together: list[LaserScan] = []
        readings = 0
        for place in self._index:
            scan = self._decoder.read(place, messages.laser_scan_of)
            self._unstamped += scan.time == 0
            together.append(scan if scan.time else replace(scan, time=place.time))
            count = len(scan.ranges)
            claim(self._bag.path, _OF_READING * count, what=f"the {count} readings of a scan")
            readings += count
            if len(together) == _SCANS_TOGETHER or readings > _READINGS_TOGETHER:
                yield from self._placed(together)
                together, readings = [], 0
        if together:
            yield from self._placed(together)

    def warn(self) -> None:
        texts = []
        fate = f"of {self.count} scans are left out"
        for frame, count in sorted(self._outside.items()):
            span = self._frames.span_text(frame)
            texts.append(f"{count} {fate}: where {frame} was is known {span}")
        if self._leaning:
            texts.append(f"{self._leaning} {fate}: their sensor leans by more than 10 degrees")
        if self._unstamped:
            texts.append(f"{self._unstamped} scans have no time: that of their recording is taken")
        if self._deskew and not self._has_steps:
            texts.append("no scan has a time between beams: --deskew has no effect")
        for text in texts:
            emit_warning(f"{self._bag.path}: {text}")

    def _placed(self, scans: list[LaserScan]) -> Iterator[ScanArrays]:
        if self._deskew and any(scan.between for scan in scans):
            self._has_steps = True
            yield from self._deskewed(scans)
            return
        for run in self._runs(scans, [np.array([scan.time], np.int64) for scan in scans]):
            yield from _as_arrays(*run)

    def _runs(
        self, scans: list[LaserScan], times: list[Integers]
    ) -> Iterator[tuple[list[LaserScan], Posed, Stances]]:
        """Yield scans of the same geometry that follow each other, without those left out."""
        # The poses are those of all times of a scan, one scan behind the other.
        counts = [len(stamps) for stamps in times]
        posed = self._frames.at_each([scan.frame for scan in scans], times)
        stance = stances(posed.translations, posed.quaternions)
        placed: list[tuple[LaserScan, Integers]] = []
        rows_of_scans = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
        for scan, rows in zip(scans, rows_of_scans, strict=True):
            if not posed.known[rows].all():
                self._outside[scan.frame] = self._outside.get(scan.frame, 0) + 1
            elif stance.leans[rows].any():
                self._leaning += 1
            else:
                placed.append((scan, rows))

        def kind(placed_scan: tuple[LaserScan, Integers]) -> tuple[object, ...]:
            scan, rows = placed_scan
            return (*scan.geometry, stance.is_level[rows].all(), stance.is_flipped[rows[0]])

        for _, group in groupby(placed, kind):
            run, parts = zip(*group, strict=True)
            rows = np.concatenate(parts)
            own = Posed(posed.translations[rows], posed.quaternions[rows], posed.known[rows])
            fields = (getattr(stance, name)[rows] for name in Stances.__annotations__)
            yield list(run), own, Stances(*fields)

    def _deskewed(self, scans: list[LaserScan]) -> Iterator[ScanArrays]:
        for run, posed, stance in self._runs(scans, [scan.beam_times() for scan in scans]):
            angles = np.concatenate([scan.angles for scan in run])
            headings, shares = beams_in_plane(posed.quaternions, angles)
            ranges = np.concatenate([scan.ranges for scan in run])
            ranges = np.where(stance.is_level, ranges, ranges * shares)
            poses = np.column_stack([posed.translations[:, :2], headings])
            yield ScanArrays(poses, np.zeros(1), ranges[:, np.newaxis], len(run))


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
