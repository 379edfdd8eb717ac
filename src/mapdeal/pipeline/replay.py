"""Replay of a robot's costmap from the sensor messages and transforms of a bag."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.bags import messages
from mapdeal.bags.bag import Bag, normalised_topic
from mapdeal.bags.messages import Decoder
from mapdeal.command import Stage
from mapdeal.errors import MalformedInputError, ParameterError, emit_warning
from mapdeal.files.source import claim, sha256_of
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Frame, as_float32
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE_SPACE, LETHAL_OBSTACLE, NO_INFORMATION, count_text
from mapdeal.layers.layer import LiveLayer, LivePlace
from mapdeal.layers.observations import Observation, ObservationSource, observed
from mapdeal.layers.obstacle import ObstacleGrid, VoxelGrid, cells_at
from mapdeal.layers.replay import LiveCostmap
from mapdeal.mapping.transforms import FrameOptions, Pose, Quaternion, Rigid
from mapdeal.pipeline.bag_maps import SensorFrames
from mapdeal.pipeline.folder import Filling, OutputFolder, Product
from mapdeal.pipeline.local import GlobalMap
from mapdeal.pipeline.run import RunReport, fill
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import Step
from mapdeal.ros.robot import INJECTED, RobotParameters

Points = NDArray[np.float32]
_PER_CELL = 64  # bytes for each cell, in all layers and the costs
_PER_POINT = 400  # bytes for each point of a cloud: its rays are computed together
_TYPES = {"LaserScan": messages.LASER_SCAN, "PointCloud2": messages.POINT_CLOUD}


@dataclass(frozen=True, eq=False)
class RawCloud:
    """Points of a ``sensor_msgs/PointCloud2``, shape (N, 3), in the sensor's frame."""

    frame: str
    time: int
    points: Points


@dataclass(frozen=True, eq=False)
class RawScan:
    """A ``sensor_msgs/LaserScan`` as it was recorded, its numbers float32."""

    frame: str
    time: int
    geometry: tuple[float, float, float]  # angle_min, angle_max, angle_increment
    limits: tuple[float, float]
    ranges: NDArray[np.float32]


def _raw_scan(message: Any) -> RawScan:
    numbers = (message.angle_min, message.angle_max, message.angle_increment)
    start, end, step = (as_float32(float(number)) for number in numbers)
    limits = as_float32(message.range_min), as_float32(message.range_max)
    ranges = np.array(message.ranges, dtype=np.float32)
    return RawScan(*_header_of(message), (start, end, step), limits, ranges)


def _header_of(message: Any) -> tuple[str, int]:
    return messages.frame_of(message.header), messages.time_of(message.header.stamp)


class ScanProjector:
    """Points of scans, as ``LaserProjection::projectLaser`` of laser_geometry computes them."""

    # It keeps its table of cosines while the number of beams and the first and last angle are
    # equal, even if the step between beams changes.
    def __init__(self) -> None:
        self._key: tuple[float, ...] = ()
        self._cosines = self._sines = np.empty(0)

    def points(self, scan: RawScan, *, inf_is_valid: bool) -> Points:
        """Return the points of all valid readings, shape (N, 3)."""
        start, end, step = scan.geometry
        key = (len(scan.ranges), start, end)
        if key != self._key:
            angles = [start + k * step for k in range(len(scan.ranges))]
            self._cosines = np.array([math.cos(angle) for angle in angles])
            self._sines = np.array([math.sin(angle) for angle in angles])
            self._key = key
        ranges, (least, most) = scan.ranges, scan.limits
        if inf_is_valid:
            longest = np.float32(most) - np.float32(0.0001)
            ranges = np.where(np.isposinf(ranges), longest, ranges)
        with np.errstate(invalid="ignore"):
            valid = (ranges < np.float32(most)) & (ranges >= np.float32(least))
        lengths = ranges[valid].astype(np.float64)
        points = np.zeros((len(lengths), 3), dtype=np.float32)
        points[:, 0], points[:, 1] = lengths * self._cosines[valid], lengths * self._sines[valid]
        return points


def transformed(points: Points, rigid: Rigid) -> NDArray[np.float64]:
    """Return float32 points in another frame, rounded as Eigen rounds them in tf2_sensor_msgs."""
    moves = [np.float32(value) for value in rigid[0]]
    rows = _rotation_matrix(rigid[1])
    x, y, z = points.T
    result = np.empty(points.shape)
    with np.errstate(invalid="ignore", over="ignore"):
        for axis, (a, b, c) in enumerate(rows):
            result[:, axis] = ((a * x + b * y) + c * z) + moves[axis]
    return result


def _rotation_matrix(quaternion: Quaternion) -> list[list[np.float32]]:
    x, y, z, w = (np.float32(part) for part in quaternion)
    unit, tx, ty, tz = np.float32(1), x + x, y + y, z + z
    twx, twy, twz, txx, txy, txz = tx * w, ty * w, tz * w, tx * x, ty * x, tz * x
    tyy, tyz, tzz = ty * y, tz * y, tz * z
    return [
        [unit - (tyy + tzz), txy - twz, txz + twy],
        [txy + twz, unit - (txx + tzz), tyz - twx],
        [txz - twy, tyz + twx, unit - (txx + tyy)],
    ]


def yaw_of(quaternion: Quaternion) -> float:
    """Return the heading as ``tf2::getYaw``."""
    x, y, z, w = quaternion
    sarg = -2 * (x * z - w * y) / (x * x + y * y + z * z + w * w)
    if abs(sarg) >= 0.99999:
        return math.copysign(2, sarg) * math.atan2(y, x)
    return math.atan2(2 * (x * y + w * z), w * w + x * x - y * y - z * z)


@dataclass(frozen=True, eq=False)
class Delivery:
    """A message as one source of one layer takes it."""

    grid: ObstacleGrid
    layer: str
    observation: Observation
    message: RawScan | RawCloud
    rigid: Rigid


@dataclass(frozen=True, eq=False)
class ReplayStep:
    """One update of the costmap: after which message, its time and topic, and its observations."""

    number: int
    time: int
    topic: str
    deliveries: Sequence[Delivery]


class BagReplay:
    """A robot's costmap, updated with each message of its sensors in a bag that is open.

    Parameters
    ----------
    bag : Bag
        The bag.
    robot : RobotParameters
        The robot, with the layers of the costmap and their sources.
    known : OccupancyGrid, optional
        The map that static layers read.
    """

    def __init__(self, bag: Bag, robot: RobotParameters, known: OccupancyGrid | None) -> None:
        self.bag, self.robot = bag, robot
        if robot.area is None:
            raise ParameterError("the costmap has no usable resolution", place="resolution")
        self.area = robot.area
        self.place = self._placed(known)
        cells = self.place.frame.height * self.place.frame.width
        claim(bag.path, _PER_CELL * cells, what=f"a replay with {cells} cells")
        self.layers: dict[str, LiveLayer] = {}
        for listed in robot.layers:
            if listed.layer is None or not listed.is_enabled or listed.name == INJECTED:
                continue
            layer = listed.layer.live(self.place, listed.sensing)
            if listed.needs and not isinstance(layer, ObstacleGrid):
                emit_warning(f"{listed.name}: has no {listed.needs} in a replay", stacklevel=2)
            self.layers[listed.name] = layer
        if known is None and any(layer.layer.reads_map for layer in self.layers.values()):
            rule = "is required: the costmap lists a static layer, which reads a map"
            raise ParameterError(rule, source="--map")
        default = NO_INFORMATION if robot.track_unknown_space else FREE_SPACE
        occupancy = None if known is None else np.asarray(known.occupancy)
        self.costmap = LiveCostmap(
            self.place, list(self.layers.values()), default, robot.footprint, occupancy
        )
        self._sources = dict(self._sources_by_topic())
        connections = [c for c in bag.connections if c.topic in self._sources]
        self._types = {c.id: c for c in connections}
        self._index = bag.index([c.id for c in connections])
        if not len(self._index):
            raise bag.malformed("holds no messages", ", ".join(self._sources))
        self._decoder = Decoder(bag)
        self._frames = SensorFrames(bag, FrameOptions(), is_exact=True)
        self._projectors = {name: ScanProjector() for name in self.layers}
        self._without_transform = self._updates = self.time = 0
        self._readings: Counter[tuple[str, ObservationSource]] = Counter()
        self._within: Counter[tuple[str, ObservationSource]] = Counter()
        self._steps = self.steps()
        self.advance: Callable[[int], object] = lambda _: None
        self.watch: CellWatch | None = None

    def _placed(self, known: OccupancyGrid | None) -> LivePlace:
        area, map_frame = self.area, None
        if known is not None:
            height, width = known.shape
            x, y, yaw = known.origin
            if yaw:
                emit_warning("costmap_2d ignores the yaw of the map's origin", stacklevel=2)
            map_frame = Frame(height, width, as_float32(known.resolution), (x, y, 0.0))
            self._map_resolution = known.resolution
        if map_frame is not None and self.robot.static_layers and not area.is_rolling:
            frame = map_frame
        else:
            frame = Frame(area.height, area.width, area.resolution, (*area.origin, 0.0))
        is_ros1 = self.robot.flavour == "ros1"
        return LivePlace(frame, map_frame, area.is_rolling, area.size_margin, is_ros1)

    def _sources_by_topic(self) -> Iterator[tuple[str, list[tuple[str, ObservationSource]]]]:
        """Yield the topics in the bag that sources of layers read; warn of all others."""
        types = {connection.topic: connection.type for connection in self.bag.connections}
        # relative names are below the namespace of the robot
        node = self.robot.node.strip("/").split("/")
        space = "/".join(["", *node[: -1 if self.place.is_ros1 else -2]])
        found: dict[str, list[tuple[str, ObservationSource]]] = {}
        for name, layer in self.layers.items():
            for source in layer.sensing.sources if isinstance(layer, ObstacleGrid) else ():
                is_absolute = source.topic.startswith("/") or self.place.is_ros1
                topic = normalised_topic(source.topic if is_absolute else f"{space}/{source.topic}")
                message_type = _TYPES.get(source.data_type)
                if message_type is None:
                    why = f"data_type {source.data_type}: only {' and '.join(_TYPES)} are replayed"
                elif types.get(topic) != message_type:
                    why = f"the bag has no topic {topic} of type {message_type}"
                else:
                    found.setdefault(topic, []).append((name, source))
                    continue
                emit_warning(f"{name}.{source.name}: {why}", stacklevel=3)
        if not found:
            known = sorted({c.topic for c in self.bag.of_types(*_TYPES.values())})
            rule = f"the bag has no messages for the layers of {self.robot.node}"
            hint = f"it has {', '.join(known)}" if known else None
            raise MalformedInputError(rule, source=self.bag.path, hint=hint)
        yield from found.items()

    @property
    def count(self) -> int:
        """Number of messages with which the costmap is updated."""
        return len(self._index)

    @property
    def topics(self) -> tuple[str, ...]:
        return tuple(self._sources)

    def times(self) -> list[int]:
        """Return the stamps of all messages, nanoseconds."""
        return [self._decoder.header(place)[0] for place in self._index]

    def costs(self) -> Costmap:
        """Return the costmap as it is now; on the cells of a map it has the map's resolution."""
        frame = self.costmap.frame
        resolution = self._map_resolution if frame is self.place.map_frame else frame.resolution
        return Costmap(self.costmap.costs.copy(), resolution, frame.origin)

    def steps(self) -> Iterator[ReplayStep]:
        """Update the costmap with one message after the other."""
        self._frames.read_all(lambda _: None)
        for number, place in enumerate(self._index):
            connection = self._types[place.connection]
            is_scan = connection.type == messages.LASER_SCAN
            read: Callable[[Any], RawScan | RawCloud] = _raw_scan if is_scan else self._raw_cloud
            message = self._decoder.read(place, read)
            deliveries = list(self._delivered(connection.topic, message))
            for delivery in deliveries:
                delivery.grid.add(delivery.observation)
            base = self._lookup(self.robot.base_frame, message.time)
            if base is not None:
                (x, y, _), turn = base
                map_to_costmap = self._map_to_costmap(message.time)
                self.costmap.update((x, y, yaw_of(turn)), message.time, map_to_costmap)
            yield ReplayStep(number, message.time, connection.topic, deliveries)

    def _raw_cloud(self, message: Any) -> RawCloud:
        needed = _PER_POINT * int(message.width) * int(message.height)
        claim(self.bag.path, needed, what="the points of a cloud")
        points = messages.points_of(message).astype(np.float32)
        if points.shape[1] < 3:
            raise MalformedInputError("must name x, y and z", place="fields")
        return RawCloud(*_header_of(message), points)

    def warn(self) -> None:
        """Warn of messages that were left out, and of sources whose heights drop all readings."""
        if self._without_transform:
            text = f"{self._without_transform} observations of {self.count} messages are left out: "
            text += "transforms at their times are not known"
            emit_warning(f"{self.bag.path}: {text}", stacklevel=2)
        for (name, source), readings in self._readings.items():
            if readings and not self._within[name, source]:
                text = f"{name}.{source.name}: all {readings} readings are outside of its heights, "
                text += f"{source.min_obstacle_height:g} to {source.max_obstacle_height:g} m"
                emit_warning(text, stacklevel=2)

    def advance_to(self, messages: int) -> None:
        """Update the costmap until it has taken a number of messages."""
        while self._updates < messages:
            step = next(self._steps)
            self._updates, self.time = self._updates + 1, step.time
            self.advance(1)
            if self.watch is not None:
                self.watch.observe(step)

    def _delivered(self, topic: str, message: RawScan | RawCloud) -> Iterator[Delivery]:
        rigid = self._lookup(message.frame, message.time)
        for name, source in self._sources[topic]:
            sensor = rigid
            if source.sensor_frame:
                sensor = self._lookup(source.sensor_frame, message.time)
            grid = self.layers[name]
            if rigid is None or sensor is None or not isinstance(grid, ObstacleGrid):
                self._without_transform += 1
                continue
            if isinstance(message, RawScan):
                projector = self._projectors[name]
                points = projector.points(message, inf_is_valid=source.inf_is_valid)
            else:
                points = message.points
            in_costmap = transformed(points, rigid)
            observation = observed(source, message.time, sensor[0], in_costmap)
            self._readings[name, source] += int(np.isfinite(in_costmap[:, 2]).sum())
            self._within[name, source] += len(observation.points)
            yield Delivery(grid, name, observation, message, rigid)

    def _lookup(self, frame: str, time: int, fixed: str | None = None) -> Rigid | None:
        try:
            return self._frames.tree.tf2_lookup(
                fixed or self.area.global_frame, frame, time, in_seconds=self.place.is_ros1
            )
        except MalformedInputError as error:
            raise error.found_in(self.bag.path) from None

    def _map_to_costmap(self, time: int) -> Pose | None:
        """Return the pose of a rolling costmap's frame on the map, if they differ."""
        if self.place.map_frame is None or self.area.is_in_map_frame or not self.area.is_rolling:
            return None
        rigid = self._lookup(self.area.global_frame, time, "map")
        return None if rigid is None else (*rigid[0][:2], yaw_of(rigid[1]))


def costs_after(replay: BagReplay, *, messages: int) -> Costmap:
    """Return the costmap after some messages of the bag."""
    replay.advance_to(messages)
    replay.warn()
    return replay.costs()


_REPLAY = Stage(
    costs_after, name="replay", product="cost", summary="Replay a robot's costmap from a bag.",
    title=lambda parameters: f"costs after {parameters['messages']} messages", memory=0.0,
)  # fmt: skip


@dataclass(frozen=True, repr=False)
class ReplayReport(RunReport):
    """Report of a replay, with the history of a cell that was asked about."""

    why: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        return {**super().document(), **({"why": list(self.why)} if self.why else {})}

    def found(self) -> Sequence[str]:
        return self.why


Reasons = list[tuple[NDArray[np.bool_] | bool, str]]
"""Which readings a reason applies to, and the reason; the first one that applies counts."""


class CellWatch:
    """What the readings of a replay do to one place: marks, and rays that pass it."""

    def __init__(self, replay: BagReplay, xy: tuple[float, float]) -> None:
        self._replay, self._xy = replay, xy
        self._marked: dict[str, tuple[int, str]] = {}  # by layer: time and text of the last mark
        self._freed: dict[str, str] = {}  # what has freed the cell since
        self._passed: defaultdict[str, Counter[str]] = defaultdict(Counter)  # since the last mark
        self._dropped: defaultdict[str, Counter[str]] = defaultdict(Counter)
        self._time = 0

    def _cell(self) -> tuple[int, int] | None:
        row, col, is_inside = cells_at(self._replay.costmap.frame, *np.array([self._xy]).T)
        return (int(row[0]), int(col[0])) if is_inside[0] else None

    def observe(self, step: ReplayStep) -> None:
        cell, self._time = self._cell(), step.time
        under_robot = self._replay.costmap.under_robot
        for delivery in step.deliveries:
            if cell is None:
                return
            name, grid = delivery.layer, delivery.grid
            is_covered = under_robot is not None and bool(under_robot[cell])
            with np.errstate(all="ignore"):
                self._observe(delivery, cell, step.topic)
            if grid.costs[cell] == LETHAL_OBSTACLE:
                self._freed.pop(name, None)
            elif name in self._marked:
                cause = "the robot's footprint" if is_covered else f"a ray of {step.topic}"
                self._freed.setdefault(name, f"freed at {seconds_text(step.time)} s by {cause}")

    def _observe(self, delivery: Delivery, cell: tuple[int, int], topic: str) -> None:
        grid, observation, name = delivery.grid, delivery.observation, delivery.layer
        points, col, row = grid.marks(observation)
        here = points[(row == cell[0]) & (col == cell[1])]
        if len(here) and observation.source.marking:
            if grid.costs[cell] != LETHAL_OBSTACLE:
                self._dropped[name]["freed by the footprint, or too few voxels"] += len(here)
                return
            point = observation.points[here[0]]
            place = ", ".join(f"{value:.3f}" for value in observation.origin)
            distance = math.dist(point.tolist(), observation.origin)
            text = f"marked at {seconds_text(observation.time)} s by {topic} from {place}"
            text += f" (range {distance:.3f} m, height {point[2]:.3f} m)"
            self._marked[name] = observation.time, text
            self._passed[name].clear()
            return
        source, sensing = observation.source, grid.sensing
        reach, ray = "obstacle_max_range", "raytrace_max_range"
        if grid.place.is_ros1:
            reach, ray = "obstacle_range", "raytrace_range"
        origin, away, lengths, (least, most) = _beams(delivery)
        is_infinite = np.isposinf(lengths)
        if source.inf_is_valid:
            lengths, is_infinite = np.where(is_infinite, most - 1e-4, lengths), is_infinite & False
        (west, south, _), size = grid.frame.origin, grid.frame.resolution
        corner = np.array([west + cell[1] * size, south + cell[0] * size]) - origin[:2]
        borders = np.sort([corner / away[:, :2], (corner + size) / away[:, :2]], axis=0)
        enters, leaves = borders[0].max(axis=1), borders[1].min(axis=1)
        level = np.hypot(away[:, 0], away[:, 1])
        heights = origin[2] + away[:, 2] * lengths
        is_valid = (lengths < most) & (lengths >= least)
        shared: Reasons = [
            (is_infinite, "infinite (inf_is_valid: false)"),
            (~is_valid & ~is_infinite, "invalid, beyond range_min and range_max"),
            (heights > source.max_obstacle_height,
             f"above max_obstacle_height {source.max_obstacle_height:g} of {source.name}"),
            (heights < source.min_obstacle_height,
             f"below min_obstacle_height {source.min_obstacle_height:g} of {source.name}"),
        ]  # fmt: skip
        of_marks: Reasons = [
            (not source.marking, f"marking: false of {source.name}"),
            (heights > sensing.max_obstacle_height,
             f"above max_obstacle_height {sensing.max_obstacle_height:g} of {name}"),
            (heights < sensing.min_obstacle_height,
             f"below min_obstacle_height {sensing.min_obstacle_height:g} of {name}"),
            (lengths * level > source.obstacle_max_range,
             f"beyond {reach} {source.obstacle_max_range:g} m"),
            (lengths * level < source.obstacle_min_range,
             f"nearer than obstacle_min_range {source.obstacle_min_range:g} m"),
        ]  # fmt: skip
        # rays of voxel layers stop two cells before their ends
        columns = grid.columns if isinstance(grid, VoxelGrid) else None
        reaches = lengths if columns is None else lengths - 2 * size
        of_rays: Reasons = [
            (reaches < enters, "ended before it"),
            (not source.clearing, f"clearing: false of {source.name}"),
            (enters * level > source.raytrace_max_range,
             f"beyond {ray} {source.raytrace_max_range:g} m"),
            (leaves * level < source.raytrace_min_range,
             f"nearer than raytrace_min_range {source.raytrace_min_range:g} m"),
        ]  # fmt: skip
        points_there = (enters <= leaves) & (leaves > 0)
        is_end = points_there & (lengths >= enters) & (lengths <= leaves)
        _count(self._dropped[name], is_end, [*shared, *of_marks], "outside of the layer's grid")
        if columns is not None:
            height = (origin[2] + away[:, 2] * enters - sensing.origin_z) / sensing.z_resolution
            is_marked = (int(columns[cell]) >> np.clip(height, 0, 15).astype(np.int64) + 16) & 1
            of_rays.append((is_marked == 0, "at heights without a mark"))
        _count(self._passed[name], points_there & ~is_end, [*shared, *of_rays], "along its edge")

    def lines(self) -> Iterator[str]:
        """Yield why the cell has its cost: a line for each layer that read a map or a sensor."""
        costmap, cell = self._replay.costmap, self._cell()
        head = f"{self._xy[0]:.10g},{self._xy[1]:.10g}"
        if cell is None:
            yield f"{head}: lies outside of the costmap"
            return
        cost = int(costmap.costs[cell])
        head += f": cost {cost}"
        if FREE_SPACE < cost < LETHAL_OBSTACLE and (costmap.costs == LETHAL_OBSTACLE).any():
            rows, cols = np.nonzero(costmap.costs == LETHAL_OBSTACLE)
            nearest = int(np.hypot(rows - cell[0], cols - cell[1]).argmin())
            (x, y), size = costmap.frame.origin[:2], costmap.frame.resolution
            place = f"{x + (cols[nearest] + 0.5) * size:.3f},{y + (rows[nearest] + 0.5) * size:.3f}"
            head += f", inflated from the lethal cell at {place}"
        parts: dict[bool, list[str]] = {True: [], False: []}  # whether the cell is lethal there
        for name, layer in self._replay.layers.items():
            if isinstance(layer, ObstacleGrid):
                own_cost = int(layer.costs[cell])
                text = f"{name}: {self._history(name, own_cost)}"
                parts[own_cost == LETHAL_OBSTACLE].append(text)
            elif layer.layer.reads_map and (master := costmap.master) is not None:
                value = int(master.occupancy[cell])
                if value and (master.in_map is None or master.in_map[cell]):
                    parts[value > 0].append(f"{name}: the map has {value} there")
        for text in parts[True] or parts[False]:
            yield f"{head}: {text}"

    def _history(self, name: str, cost: int) -> str:
        time, text = self._marked.get(name, (0, ""))
        if not text:
            dropped = self._dropped[name]
            if not dropped.total():
                return "no reading ended in it"
            readings = count_text(dropped.total(), "reading")
            return f"{readings} ended in it, and none marked it: {_listed(dropped)}"
        if cost != LETHAL_OBSTACLE:
            return f"{text}; {self._freed.get(name, 'moved out of the costmap')}"
        passed = self._passed[name]
        if time == self._time:
            return f"{text}; no observation since"
        if not passed.total():
            return f"{text}; no ray has pointed at it since"
        readings = count_text(passed.total(), "reading")
        return f"{text}; {readings} pointed at it since, and none cleared it: {_listed(passed)}"


def _count(
    counter: Counter[str], selected: NDArray[np.bool_], reasons: Reasons, no_reason: str
) -> None:  # fmt: skip
    for applies, reason in reasons:
        counter[reason] += int(np.count_nonzero(selected & applies))
        selected = selected & np.logical_not(applies)
    counter[no_reason] += int(np.count_nonzero(selected))


def _listed(counter: Counter[str]) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in counter.most_common() if count)


def _beams(
    delivery: Delivery,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], tuple[float, float]]:
    """Return the sensor's place, directions and lengths of all readings, and their limits."""
    message, origin = delivery.message, np.array(delivery.rigid[0])
    matrix = np.array(_rotation_matrix(delivery.rigid[1]), dtype=np.float64)
    if isinstance(message, RawScan):
        start, _, step = message.geometry
        angles = start + step * np.arange(len(message.ranges))
        vectors = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])
        lengths, limits = message.ranges.astype(np.float64), message.limits
    else:
        vectors = message.points[np.isfinite(message.points).all(axis=1)].astype(np.float64)
        lengths, limits = np.sqrt((vectors * vectors).sum(axis=1)), (0.0, math.inf)
        vectors /= lengths[:, np.newaxis]
    away = [(vectors * row).sum(axis=1) for row in matrix]
    return origin, np.stack(away, axis=1), lengths, limits


def seconds_text(time: int) -> str:
    return f"{time // 10**9}.{time % 10**9:09}"


def messages_until(replay: BagReplay, until: int | None) -> int:
    """Return the number of messages up to a time, nanoseconds."""
    if until is None:
        return replay.count
    times = replay.times()
    later = (number for number, time in enumerate(times) if time > until)
    count = next(later, len(times))
    if not count:
        rule = f"is before the first message, at {seconds_text(times[0])} s"
        raise ParameterError(rule, source="--until", got=seconds_text(until))
    return count


def snapshots(replay: BagReplay, every: int) -> list[int]:
    """Return the numbers of messages after which costmaps are written, one each `every` ns."""
    times = replay.times()
    turns = [(time - times[0]) // every for time in times]
    last = [k + 1 for k in range(len(times) - 1) if turns[k + 1] > turns[k]]
    return [*last, len(times)]


def write_replay(
    replay: BagReplay, folder: Path, messages: int, known: GlobalMap | None, settings: Settings
) -> ReplayReport:
    """Write the costmap after some messages into a folder, with the history of a cell."""
    bag, robot = replay.bag, replay.robot
    sums = {path.name: sha256_of(path) for path in bag.files} | dict(known.sums if known else {})
    step = Step(_REPLAY, {"messages": messages})
    options = {"topics": list(replay.topics), "dialect": settings.dialect}
    options |= settings.picture_options
    target = OutputFolder(folder, (step,), sums, options, settings, robot.described())

    def products() -> Iterator[Product]:
        costs = costs_after(replay, messages=messages)
        yield Product(step, costs, {"time": replay.time / 1e9})

    files = (*bag.files, *robot.paths, *(known.files if known else ()))
    warnings = (*robot.remarks, *(known.warnings if known else ()))
    filling = Filling(
        target, products(), bag.path.stem, files, bag.path, warnings=warnings
    )  # fmt: skip
    report = fill(bag.path, [filling], settings, skip=False)[0]
    why = () if replay.watch is None else tuple(replay.watch.lines())
    return ReplayReport(report.folder, report.status, report.figures, report.source, why=why)
