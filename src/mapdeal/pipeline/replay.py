"""Replay of a robot's costmap from the sensor messages and transforms of a bag."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal import command, records
from mapdeal.bags import messages
from mapdeal.bags.bag import Bag, normalised_topic
from mapdeal.errors import MalformedInputError, ParameterError, emit_warning
from mapdeal.files.source import claim, sha256_of
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame, as_float32, turned
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE_SPACE, LETHAL_OBSTACLE, NO_INFORMATION, count_text
from mapdeal.kernels.arrays import Floats, Mask, Metres, SignedBytes
from mapdeal.layers import obstacle
from mapdeal.layers.layer import Bounds, LiveLayer, LivePlace, MasterGrid, Update, Window
from mapdeal.layers.stack import cells_below, covered_cells
from mapdeal.mapping.transforms import FrameOptions, Pose, Quaternion, Rigid
from mapdeal.pipeline import bag_maps, inputs, run
from mapdeal.pipeline.folder import Filling, OutputFolder, Product
from mapdeal.pipeline.local import GlobalMap
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import Step
from mapdeal.ros.robot import INJECTED, RobotParameters

_PER_CELL = 64  # bytes for each cell, in all layers and the costs
_PER_POINT = 400  # bytes for each point of a cloud: its rays are computed together
_TYPES = {"LaserScan": messages.LASER_SCAN, "PointCloud2": messages.POINT_CLOUD}


@records.dataclass(frozen=True, eq=False)
class RawCloud:
    frame: str
    time: int
    points: Metres  # in the sensor's frame, shape (N, 3)


@records.dataclass(frozen=True, eq=False)
class RawScan:
    frame: str
    time: int
    geometry: tuple[float, float, float]  # angle_min, angle_max, angle_increment as float32
    limits: tuple[float, float]
    ranges: Metres


def _raw_scan(message: Any) -> RawScan:
    names = ("angle_min", "angle_max", "angle_increment", "range_min", "range_max")
    start, end, step, least, most = (as_float32(float(getattr(message, name))) for name in names)
    ranges = np.array(message.ranges, dtype=np.float32)
    return RawScan(*_header_of(message), (start, end, step), (least, most), ranges)


def _header_of(message: Any) -> tuple[str, int]:
    return messages.frame_of(message.header), messages.time_of(message.header.stamp)


class ScanProjector:
    """Points of scans, as ``LaserProjection::projectLaser`` of laser_geometry computes them."""

    # It keeps its table of cosines while the number of beams and the first and last angle are
    # equal, even if the step between beams changes.
    def __init__(self) -> None:
        self._key: tuple[float, ...] = ()
        self._directions = np.empty((0, 2))

    def points(self, scan: RawScan, *, inf_is_valid: bool) -> Metres:
        """Return the points of all valid readings, shape (N, 3)."""
        start, end, step = scan.geometry
        if (key := (len(scan.ranges), start, end)) != self._key:
            angles = (start + k * step for k in range(len(scan.ranges)))
            directions = [(math.cos(angle), math.sin(angle)) for angle in angles]
            self._key, self._directions = key, np.reshape(directions, (-1, 2))
        ranges, (least, most) = scan.ranges, map(np.float32, scan.limits)
        if inf_is_valid:
            ranges = np.where(np.isposinf(ranges), most - np.float32(0.0001), ranges)
        with np.errstate(invalid="ignore"):
            valid = (ranges < most) & (ranges >= least)
        points = np.zeros((np.count_nonzero(valid), 3), dtype=np.float32)
        points[:, :2] = ranges[valid, np.newaxis].astype(np.float64) * self._directions[valid]
        return points


def transformed(points: Metres, rigid: Rigid) -> Floats:
    """Return float32 points in another frame, rounded as Eigen rounds them in tf2_sensor_msgs."""
    x, y, z = points.T
    with np.errstate(invalid="ignore", over="ignore"):
        rows = zip(_rotation_matrix(rigid[1]), rigid[0], strict=True)
        axes = [((a * x + b * y) + c * z) + np.float32(move) for (a, b, c), move in rows]
    return np.stack(axes, axis=1).astype(np.float64)


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


class LiveCostmap:
    """A costmap that is updated again and again, as ``LayeredCostmap::updateMap`` does."""

    def __init__(
        self, place: LivePlace, layers: Sequence[LiveLayer], default_cost: int,
        footprint: Footprint, occupancy: SignedBytes | None,
    ) -> None:  # fmt: skip
        self.frame, self.layers = place.frame, layers
        self._place, self._default_cost, self._footprint = place, default_cost, footprint
        self._map = occupancy
        self.costs = np.full(self.frame.shape, default_cost, dtype=np.uint8)
        self.master: MasterGrid | None = None  # the grid of the last update

    def update(self, pose: Pose, time: int, map_to_costmap: Pose | None = None) -> None:
        """Update the costmap around the robot's pose; observations were added to its layers."""
        if self._place.is_rolling:
            self._move(pose)
        corners = turned(np.array(self._footprint.vertices), pose[2])
        footprint = corners[:, 0] + pose[0], corners[:, 1] + pose[1]
        update = Update(time, footprint, Bounds())
        for layer in self.layers:
            layer.update_bounds(update)
        if (window := self._window(update.bounds)) is None:
            return
        self.costs[window] = self._default_cost
        self.master = master = self._master(pose, map_to_costmap)
        for layer in self.layers:
            layer.update_costs(master, window)

    def _move(self, pose: Pose) -> None:
        cell_size, corner = self.frame.resolution, np.array(self.frame.origin[:2])
        sides = np.array(self.frame.shape[::-1]) - self._place.size_margin
        goal = np.array(pose[:2]) - sides * cell_size / 2
        cols, rows = map(int, (goal - corner) / cell_size)
        if rows or cols:
            x, y = (corner + np.array([cols, rows]) * cell_size).tolist()
            self.frame = Frame(*self.frame.shape, cell_size, (x, y, 0.0))
            self.costs = obstacle.shifted(self.costs, rows, cols, self._default_cost)
            for layer in self.layers:
                layer.move(self.frame, rows, cols)

    def _window(self, bounds: Bounds) -> Window | None:
        """Return the rows and columns within bounds, as ``worldToMapEnforceBounds``."""
        sides = []
        corners, counts = self.frame.origin[:2], self.frame.shape[::-1]
        for low, high, corner, cells in zip(bounds.low, bounds.high, corners, counts, strict=True):
            ends = [self._cell(value, corner, cells) for value in (low, high)]
            first, end = max(0, ends[0]), min(cells, ends[1] + 1)
            if end < first:
                return None
            sides.append(slice(first, end))
        return sides[1], sides[0]

    def _cell(self, value: float, corner: float, cells: int) -> int:
        if value < corner:
            return 0
        if value > self.frame.resolution * cells + corner:
            return cells - 1
        return int((value - corner) / self.frame.resolution)

    def _master(self, pose: Pose, map_to_costmap: Pose | None) -> MasterGrid:
        frame, place = self.frame, self._place
        occupancy, in_map = self._map, None
        if occupancy is None or place.map_frame is None:
            occupancy, in_map = np.full(frame.shape, -1, np.int8), np.zeros(frame.shape, np.bool_)
        elif place.is_rolling:
            row, col = cells_below(frame, map_to_costmap, place.map_frame, slice(0, frame.height))
            height, width = occupancy.shape
            in_map = (row >= 0) & (row < height) & (col >= 0) & (col < width)
            occupancy = occupancy[np.clip(row, 0, height - 1), np.clip(col, 0, width - 1)]
        under_robot = covered_cells(self._footprint, pose, frame, frame.resolution)
        return MasterGrid(
            self.costs, slice(0, frame.height), frame.shape, frame.resolution, self._default_cost,
            occupancy, in_map, under_robot=under_robot,
        )  # fmt: skip


@records.dataclass(frozen=True, eq=False)
class Delivery:
    grid: obstacle.ObstacleGrid
    layer: str
    observation: obstacle.Observation
    message: RawScan | RawCloud
    rigid: Rigid


@records.dataclass(frozen=True, eq=False)
class ReplayStep:
    time: int
    topic: str
    deliveries: Sequence[Delivery]


class BagReplay:
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
            if listed.needs and not isinstance(layer, obstacle.ObstacleGrid):
                emit_warning(f"{listed.name}: has no {listed.needs} in a replay")
            self.layers[listed.name] = layer
        if known is None and any(layer.layer.reads_map for layer in self.layers.values()):
            rule = "is required: the costmap lists a static layer, which reads a map"
            raise ParameterError(rule, source="--map")
        default = NO_INFORMATION if robot.track_unknown_space else FREE_SPACE
        occupancy = None if known is None else np.asarray(known.occupancy)
        layers = list(self.layers.values())
        self.costmap = LiveCostmap(self.place, layers, default, robot.footprint, occupancy)
        self.sources = self._sources_by_topic()
        self._types = {c.id: c for c in bag.connections if c.topic in self.sources}
        self._index = bag.index(list(self._types))
        if not len(self._index):
            raise bag.malformed("holds no messages", ", ".join(self.sources))
        self._decoder = messages.Decoder(bag)
        self._frames = bag_maps.SensorFrames(bag, FrameOptions(), is_exact=True)
        self._projectors = {name: ScanProjector() for name in self.layers}
        self._without_transform = self._updates = self.time = 0
        self._readings: Counter[tuple[str, obstacle.ObservationSource]] = Counter()
        self._within = self._readings.copy()  # those within the heights of their source
        self._steps = self.steps()
        self.advance: Callable[[int], object] = lambda _: None
        self.watch: CellWatch | None = None

    def _placed(self, known: OccupancyGrid | None) -> LivePlace:
        area, map_frame = self.area, None
        if known is not None:
            x, y, yaw = known.origin
            if yaw:
                emit_warning("costmap_2d ignores the yaw of the map's origin")
            map_frame = Frame(*known.shape, as_float32(known.resolution), (x, y, 0.0))
            self._map_resolution = known.resolution
        if map_frame is not None and self.robot.static_layers and not area.is_rolling:
            frame = map_frame
        else:
            frame = Frame(area.height, area.width, area.resolution, (*area.origin, 0.0))
        is_ros1 = self.robot.flavour == "ros1"
        return LivePlace(frame, map_frame, area.is_rolling, area.size_margin, is_ros1)

    def _sources_by_topic(self) -> dict[str, list[tuple[str, obstacle.ObservationSource]]]:
        types = {connection.topic: connection.type for connection in self.bag.connections}
        # relative names are below the namespace of the robot
        node = self.robot.node.strip("/").split("/")
        space = "/".join(["", *node[: -1 if self.place.is_ros1 else -2]])
        found: dict[str, list[tuple[str, obstacle.ObservationSource]]] = {}
        for name, layer in self.layers.items():
            for source in layer.sensing.sources if isinstance(layer, obstacle.ObstacleGrid) else ():
                is_absolute = source.topic.startswith("/") or self.place.is_ros1
                topic = normalised_topic(source.topic if is_absolute else f"{space}/{source.topic}")
                kind, message_type = source.data_type, _TYPES.get(source.data_type)
                if message_type is not None and types.get(topic) == message_type:
                    found.setdefault(topic, []).append((name, source))
                    continue
                why = f"the bag has no topic {topic} of type {message_type}"
                if message_type is None:
                    why = f"data_type {kind}: only {' and '.join(_TYPES)} are replayed"
                emit_warning(f"{name}.{source.name}: {why}")
        if not found:
            known = ", ".join(sorted({c.topic for c in self.bag.of_types(*_TYPES.values())}))
            rule = f"the bag has no messages for the layers of {self.robot.node}"
            hint = f"it has {known}" if known else None
            raise MalformedInputError(rule, source=self.bag.path, hint=hint)
        return found

    def times(self) -> list[int]:
        """Return the stamps of all messages, nanoseconds."""
        return [self._decoder.header(place)[0] for place in self._index]

    def costs(self) -> Costmap:
        """Return the costmap as it is now; on the cells of a map it has the map's resolution."""
        frame = self.costmap.frame
        resolution = self._map_resolution if frame is self.place.map_frame else frame.resolution
        return Costmap(self.costmap.costs.copy(), resolution, frame.origin)

    def steps(self) -> Iterator[ReplayStep]:
        self._frames.read_all(lambda _: None)
        for place in self._index:
            connection = self._types[place.connection]
            is_scan = connection.type == messages.LASER_SCAN
            read: Callable[[Any], RawScan | RawCloud] = _raw_scan if is_scan else self._raw_cloud
            message = self._decoder.read(place, read)
            deliveries = list(self._delivered(connection.topic, message))
            for delivery in deliveries:
                delivery.grid.add(delivery.observation)
            if (base := self._lookup(self.robot.base_frame, message.time)) is not None:
                (x, y, _), turn = base
                map_to_costmap = self._map_to_costmap(message.time)
                self.costmap.update((x, y, yaw_of(turn)), message.time, map_to_costmap)
            yield ReplayStep(message.time, connection.topic, deliveries)

    def _raw_cloud(self, message: Any) -> RawCloud:
        needed = _PER_POINT * int(message.width) * int(message.height)
        claim(self.bag.path, needed, what="the points of a cloud")
        points = messages.points_of(message).astype(np.float32)
        if points.shape[1] < 3:
            raise MalformedInputError("must name x, y and z", place="fields")
        return RawCloud(*_header_of(message), points)

    def warn(self) -> None:
        if self._without_transform:
            text = f"{self._without_transform} observations of {len(self._index)} messages are left"
            emit_warning(f"{self.bag.path}: {text} out: transforms at their times are not known")
        for (name, source), count in self._readings.items():
            if count and not self._within[name, source]:
                heights = f"{source.min_obstacle_height:g} to {source.max_obstacle_height:g} m"
                text = f"{name}.{source.name}: all {count} readings are outside of its heights"
                emit_warning(f"{text}, {heights}")

    def advance_to(self, messages: int) -> None:
        while self._updates < messages:
            step = next(self._steps)
            self._updates, self.time = self._updates + 1, step.time
            self.advance(1)
            if self.watch is not None:
                self.watch.observe(step)

    def _delivered(self, topic: str, message: RawScan | RawCloud) -> Iterator[Delivery]:
        rigid = self._lookup(message.frame, message.time)
        for name, source in self.sources[topic]:
            frame, grid = source.sensor_frame, self.layers[name]
            sensor = self._lookup(frame, message.time) if frame else rigid
            if rigid is None or sensor is None or not isinstance(grid, obstacle.ObstacleGrid):
                self._without_transform += 1
                continue
            if isinstance(message, RawScan):
                points = self._projectors[name].points(message, inf_is_valid=source.inf_is_valid)
            else:
                points = message.points
            points_xyz = transformed(points, rigid)
            z = points_xyz[:, 2]
            is_within = (z <= source.max_obstacle_height) & (z >= source.min_obstacle_height)
            self._readings[name, source] += int(np.isfinite(z).sum())
            self._within[name, source] += int(is_within.sum())
            points_xyz = points_xyz[is_within]
            observation = obstacle.Observation(source, message.time, sensor[0], points_xyz)
            yield Delivery(grid, name, observation, message, rigid)

    def _lookup(self, frame: str, time: int, fixed: str | None = None) -> Rigid | None:
        fixed = fixed or self.area.global_frame
        with inputs.errors_named(self.bag.path):
            return self._frames.tree.tf2_lookup(fixed, frame, time, in_seconds=self.place.is_ros1)

    def _map_to_costmap(self, time: int) -> Pose | None:
        """Return the pose of a rolling costmap's frame on the map, if they differ."""
        if self.place.map_frame is None or self.area.is_in_map_frame or not self.area.is_rolling:
            return None
        rigid = self._lookup(self.area.global_frame, time, "map")
        return None if rigid is None else (*rigid[0][:2], yaw_of(rigid[1]))


def costs_after(replay: BagReplay, *, messages: int) -> Costmap:
    replay.advance_to(messages)
    replay.warn()
    return replay.costs()


_REPLAY = command.Stage(
    costs_after, name="replay", product="cost", summary="Replay a robot's costmap from a bag.",
    title=lambda parameters: f"costs after {parameters['messages']} messages", memory=0.0,
)  # fmt: skip


@records.dataclass(frozen=True, repr=False)
class ReplayReport(run.RunReport):
    why: tuple[str, ...] = ()  # the history of a cell

    def document(self) -> dict[str, Any]:
        return {**super().document(), **({"why": list(self.why)} if self.why else {})}

    def found(self) -> Sequence[str]:
        return self.why


Reasons = Iterable[tuple[Mask | bool, str]]
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
        row, col, is_inside = obstacle.cells_at(self._replay.costmap.frame, *np.array([self._xy]).T)
        return (int(row[0]), int(col[0])) if is_inside[0] else None

    def observe(self, step: ReplayStep) -> None:
        cell, self._time = self._cell(), step.time
        master = self._replay.costmap.master
        under_robot = None if master is None else master.under_robot
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
            text = f"marked at {seconds_text(observation.time)} s by {topic} from {place} (range "
            text += f"{distance:.3f} m, height {point[2]:.3f} m)"
            self._marked[name] = observation.time, text
            self._passed[name].clear()
            return
        source, size = observation.source, grid.frame.resolution
        reach, ray = "obstacle_max_range", "raytrace_max_range"
        if grid.place.is_ros1:
            reach, ray = "obstacle_range", "raytrace_range"
        origin, away, lengths, (least, most) = _beams(delivery)
        is_infinite = np.isposinf(lengths)
        if source.inf_is_valid:
            lengths, is_infinite = np.where(is_infinite, most - 1e-4, lengths), is_infinite & False
        corner = np.array(grid.frame.origin[:2]) + np.array(cell[::-1]) * size - origin[:2]
        borders = np.sort([corner / away[:, :2], (corner + size) / away[:, :2]], axis=0)
        enters, leaves = borders[0].max(axis=1), borders[1].min(axis=1)
        level, heights = np.hypot(away[:, 0], away[:, 1]), origin[2] + away[:, 2] * lengths

        def beyond(limits: obstacle.ObservationSource | obstacle.Sensing, owner: str) -> Reasons:
            high, low = limits.max_obstacle_height, limits.min_obstacle_height
            yield heights > high, f"above max_obstacle_height {high:g} of {owner}"
            yield heights < low, f"below min_obstacle_height {low:g} of {owner}"

        shared = [
            (is_infinite, "infinite (inf_is_valid: false)"),
            (~is_infinite & ~((lengths < most) & (lengths >= least)),
             "invalid, beyond range_min and range_max"),
            *beyond(source, source.name),
        ]  # fmt: skip
        of_marks = [
            (not source.marking, f"marking: false of {source.name}"), *beyond(grid.sensing, name),
            (lengths * level > source.obstacle_max_range,
             f"beyond {reach} {source.obstacle_max_range:g} m"),
            (lengths * level < source.obstacle_min_range,
             f"nearer than obstacle_min_range {source.obstacle_min_range:g} m"),
        ]  # fmt: skip
        # rays of voxel layers stop two cells before their ends
        columns = grid.columns if isinstance(grid, obstacle.VoxelGrid) else None
        of_rays = [
            ((lengths if columns is None else lengths - 2 * size) < enters, "ended before it"),
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
            height = origin[2] + away[:, 2] * enters - grid.sensing.origin_z
            bits = np.clip(height / grid.sensing.z_resolution, 0, 15).astype(np.int64) + 16
            of_rays.append(((int(columns[cell]) >> bits) & 1 == 0, "at heights without a mark"))
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
            if isinstance(layer, obstacle.ObstacleGrid):
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
        counts = self._passed[name] if text else self._dropped[name]
        readings = count_text(counts.total(), "reading")
        listed = ", ".join(f"{count} {reason}" for reason, count in counts.most_common() if count)
        if not text:
            dropped = f"{readings} ended in it, and none marked it: {listed}"
            return dropped if counts.total() else "no reading ended in it"
        if cost != LETHAL_OBSTACLE:
            return f"{text}; {self._freed.get(name, 'moved out of the costmap')}"
        if time == self._time:
            return f"{text}; no observation since"
        if not counts.total():
            return f"{text}; no ray has pointed at it since"
        return f"{text}; {readings} pointed at it since, and none cleared it: {listed}"


def _count(counter: Counter[str], selected: Mask, reasons: Reasons, no_reason: str) -> None:
    for applies, reason in reasons:
        counter[reason] += int(np.count_nonzero(selected & applies))
        selected = selected & np.logical_not(applies)
    counter[no_reason] += int(np.count_nonzero(selected))


def _beams(delivery: Delivery) -> tuple[Floats, Floats, Floats, tuple[float, float]]:
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


def message_counts(replay: BagReplay, *, until: int | None, every: int | None) -> list[int]:
    """Return the numbers of messages after which costmaps are written, one each `every` ns."""
    times = replay.times()
    if until is not None:
        first, times = times[0], list(takewhile(lambda time: time <= until, times))
        if not times:
            rule = f"is before the first message, at {seconds_text(first)} s"
            raise ParameterError(rule, source="--until", got=seconds_text(until))
    turns = [(time - times[0]) // (every or 1) for time in times]
    last = [k for k, (turn, following) in enumerate(pairwise(turns), start=1) if following > turn]
    return [*(last if every else ()), len(times)]


def write_replay(
    replay: BagReplay, folder: Path, messages: int, known: GlobalMap | None, settings: Settings
) -> ReplayReport:
    bag, robot = replay.bag, replay.robot
    sums = {path.name: sha256_of(path) for path in bag.files} | dict(known.sums if known else {})
    step = Step(_REPLAY, {"messages": messages})
    options = {"topics": list(replay.sources), "dialect": settings.dialect}
    options |= settings.picture_options
    target = OutputFolder(folder, (step,), sums, options, settings, robot.described())

    def products() -> Iterator[Product]:
        yield Product(step, costs_after(replay, messages=messages), {"time": replay.time / 1e9})

    files = (*bag.files, *robot.paths, *(known.files if known else ()))
    warnings = (*robot.remarks, *(known.warnings if known else ()))
    filling = Filling(target, products(), bag.path.stem, files, bag.path, warnings=warnings)
    report = run.fill(bag.path, [filling], settings, skip=False)[0]
    why = () if replay.watch is None else tuple(replay.watch.lines())
    return ReplayReport(report.folder, report.status, report.figures, report.source, why=why)
