"""Costmap layers ``obstacle`` and ``voxel``, their sensors, and the grids that observations update.

References
----------
``observation_buffer.cpp``, ``obstacle_layer.cpp``, ``voxel_layer.cpp``, ``voxel_grid.hpp`` and
``raytraceLine`` in ``costmap_2d.hpp``, of nav2_costmap_2d and of costmap_2d in ROS 1. Positions are
computed in double, in the order of the real code: the last bit decides which cell a point is in.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import takewhile
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame
from mapdeal.grid.values import FREE_SPACE, LETHAL_OBSTACLE, NO_INFORMATION
from mapdeal.kernels.arrays import Array, Bytes, Floats, Integers, Mask
from mapdeal.kernels.sensing import VOXEL, CellRays, clear_rays
from mapdeal.layers import layer as base

OVERWRITE, MAXIMUM, KEEP_UNKNOWN = range(3)  # combination methods
_MOST_VOXELS = 16
_UNKNOWN_COLUMN = 0x0000FFFF
_WORLD_EPSILON = 1e-5


@dataclass(frozen=True)
class ObservationSource:
    """One of a layer's ``observation_sources``; lengths in metres, times in seconds."""

    name: str
    topic: str = ""
    data_type: str = "LaserScan"
    sensor_frame: str = ""
    observation_persistence: float = 0.0
    expected_update_rate: float = 0.0
    min_obstacle_height: float = 0.0
    max_obstacle_height: float = 0.0
    inf_is_valid: bool = False
    marking: bool = True
    clearing: bool = False
    obstacle_max_range: float = 2.5
    obstacle_min_range: float = 0.0
    raytrace_max_range: float = 3.0
    raytrace_min_range: float = 0.0


@dataclass(frozen=True)
class Sensing:
    """Parameters of an obstacle or voxel layer that have an effect only with observations."""

    sources: tuple[ObservationSource, ...] = ()
    min_obstacle_height: float = 0.0
    max_obstacle_height: float = 2.0
    origin_z: float = 0.0
    z_resolution: float = 0.2
    z_voxels: int = 10
    unknown_threshold: int = 15
    mark_threshold: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "z_voxels", min(max(self.z_voxels, 0), 16))  # bits of a column


@dataclass(frozen=True, eq=False)
class Observation:
    """A message's points of shape (N, 3), rounded to float32, and its sensor's place, metres."""

    source: ObservationSource
    time: int
    origin: tuple[float, float, float]
    points: Floats


class ObservationBuffer:
    """Observations of one source, the newest first."""

    def __init__(self, source: ObservationSource, *, is_ros1: bool) -> None:
        self.source, self._is_ros1 = source, is_ros1
        self._persistence = round(source.observation_persistence * 10**9)
        self._observations: list[Observation] = []
        self._last_time = 0

    def add(self, observation: Observation) -> None:
        self._observations.insert(0, observation)
        self._last_time = observation.time
        self.read(observation.time)

    def read(self, now: int) -> list[Observation]:
        """Return the observations that are not too old, and forget the others."""
        if self._persistence == 0:
            del self._observations[1:]
            return self._observations
        reference = self._last_time if self._is_ros1 else now
        select = takewhile if self._is_ros1 else filter  # ROS 1 forgets all behind an old one
        oldest = reference - self._persistence
        self._observations = list(select(lambda entry: entry.time >= oldest, self._observations))
        return self._observations


def shifted(grid: NDArray[Any], rows: int, cols: int, default: int) -> NDArray[Any]:
    """Return the cells of a grid whose origin moves by rows and columns; new ones are empty."""
    moved = np.full_like(grid, default)
    height, width = grid.shape
    if abs(rows) < height and abs(cols) < width:
        source = grid[max(rows, 0) : height + min(rows, 0), max(cols, 0) : width + min(cols, 0)]
        moved[max(-rows, 0) : height - max(rows, 0), max(-cols, 0) : width - max(cols, 0)] = source
    return moved


def cells_to(distance: float, resolution: float) -> float:
    return min(max(0.0, float(np.ceil(distance / resolution))), float(1 << 31))


def _typed(declared: Any) -> dict[str, str]:
    return {field.name: base.TYPES[type(field.default)] for field in fields(declared)[1:]}


def _ros1_source(server: base.Ros1Values, source: str, below: tuple[str, ...]) -> ObservationSource:
    place = (*below, source)

    def text(parameter: str, default: str) -> str:
        found = server.find(*place, parameter)
        return str(found.value) if found is not None else default

    def searched(parameter: str, default: float) -> float:  # also above the source
        for depth in range(len(place), 0, -1):
            if server.find(*place[:depth], parameter) is not None:
                return server.double(default, *place[:depth], parameter)
        found: Any = (server.search(parameter) or (None, None))[1]
        return float(found.value) if getattr(found, "kind", "") in ("int", "double") else default

    return ObservationSource(
        source, text("topic", source), text("data_type", "PointCloud"),
        text("sensor_frame", ""),
        server.double(0.0, *place, "observation_persistence"),
        server.double(0.0, *place, "expected_update_rate"),
        server.double(0.0, *place, "min_obstacle_height"),
        server.double(2.0, *place, "max_obstacle_height"),
        server.boolean(False, *place, "inf_is_valid"),
        server.boolean(True, *place, "marking"), server.boolean(False, *place, "clearing"),
        searched("obstacle_range", 2.5), 0.0, searched("raytrace_range", 3.0), 0.0,
    )  # fmt: skip


@dataclass(frozen=True, repr=False)
class ObstacleLayer(base.CostmapLayer):
    """Settings of costmap_2d's obstacle layer, without observations.

    Parameters
    ----------
    name : str
        Name in the list of plugins.
    track_unknown_space : bool
        Whether cells without observations are unknown, and so without effect, instead of free.
    combination_method : int
        0: known costs replace those below; 1: the maximum, and known costs replace unknown ones;
        2: the maximum, and unknown costs stay.
    footprint_clearing_enabled : bool
        Whether the cells below the robot are free, if its pose is known.

    Notes
    -----
    With `combination_method` 0 or 1 and without `track_unknown_space` the layer changes the map
    even if no sensor is connected: 0 frees every cell, 1 frees every unknown cell.

    References
    ----------
    ``matchSize`` and ``updateCosts`` in ``obstacle_layer.cpp``; ``costmap_layer.cpp``.
    """

    name: str = "obstacle_layer"
    track_unknown_space: bool = False
    combination_method: int = MAXIMUM
    footprint_clearing_enabled: bool = True
    key: ClassVar[str] = "obstacle"
    nav2_plugins: ClassVar[tuple[str, ...]] = ("nav2_costmap_2d::ObstacleLayer",)
    ros1_plugins: ClassVar[tuple[str, ...]] = ("costmap_2d::ObstacleLayer",)
    about: ClassVar[str] = (
        "without observations: frees unknown (or all) cells unless it tracks unknown space"
    )
    marks_obstacles: ClassVar[bool] = True
    needs: ClassVar[str] = "observations"
    nav2_parameters: ClassVar[Mapping[str, str]] = {
        "enabled": "bool", "footprint_clearing_enabled": "bool", "combination_method": "integer",
        "observation_sources": "string", "publish_voxel_map": "bool",
        **_typed(Sensing),
    }  # fmt: skip
    other_parameters: ClassVar[frozenset[str]] = frozenset(
        {*_typed(ObservationSource), "max_obstacle_range", "min_obstacle_range", "obstacle_range",
         "raytrace_range", "tf_filter_tolerance", "transform_tolerance",
         "restore_cleared_footprint", "max_obstacle_distance", "restore_outdated_obstacles",
         "tf_tolerance"}
    )  # fmt: skip
    ros1_costmap_parameters: ClassVar[tuple[str, ...]] = (
        "max_obstacle_height", "raytrace_range", "obstacle_range", "track_unknown_space",
    )  # fmt: skip

    @property
    def overwrites_all(self) -> bool:
        return self.combination_method == OVERWRITE and not self.track_unknown_space

    def why_idle(self, has_unknown: bool) -> str | None:
        if self.combination_method == KEEP_UNKNOWN or self.track_unknown_space:
            return "no observations"
        if self.combination_method == MAXIMUM and not has_unknown:
            return "no observations, and no unknown cells to free"
        return None

    def unknown_after(self, is_unknown: bool) -> bool:
        return is_unknown and self.why_idle(is_unknown) is not None

    def apply(self, master: base.MasterGrid) -> None:
        if self.combination_method == KEEP_UNKNOWN:
            return
        free: Mask | None = np.ones((1, 1), dtype=np.bool_)  # broadcasts to all cells
        if self.track_unknown_space:
            free = master.under_robot if self.footprint_clearing_enabled else None
        if free is not None and self.combination_method == MAXIMUM:
            free = free & (master.costs == NO_INFORMATION)
        if free is not None:
            np.copyto(master.costs, FREE_SPACE, where=free)

    def effect(self) -> str:
        cells = "unknown cells" if self.combination_method == MAXIMUM else "all cells"
        return f"no observations: {cells} become free"

    @classmethod
    def from_nav2(cls, values: base.Nav2Values, entry: base.PluginEntry) -> ObstacleLayer:
        name = entry.name
        values.check_types(cls.nav2_parameters, f"{name}.")
        method = values.get(f"{name}.combination_method", "integer", MAXIMUM)
        method = method if method in (OVERWRITE, KEEP_UNKNOWN) else MAXIMUM
        tracks = values.flag("track_unknown_space")
        return cls(name, tracks, method, values.flag(f"{name}.footprint_clearing_enabled", True))

    @classmethod
    def from_ros1(cls, server: base.Ros1Values, entry: base.PluginEntry) -> ObstacleLayer:
        name = entry.name
        costmap_tracks = server.boolean(False, "track_unknown_space")
        path = (name, "track_unknown_space")
        is_overridden = "track_unknown_space" in cls.ros1_costmap_parameters
        place = server.place(*path) if is_overridden else path
        method = server.integer(MAXIMUM, name, "combination_method")
        if cls.key == "voxel":  # dynamic_reconfigure has limits here
            method = min(max(method, OVERWRITE), KEEP_UNKNOWN)
        method = method if method in (OVERWRITE, MAXIMUM) else KEEP_UNKNOWN
        tracks = server.boolean(costmap_tracks, *place)
        return cls(name, tracks, method, server.boolean(True, name, "footprint_clearing_enabled"))

    def live(self, place: base.LivePlace, sensing: Sensing) -> ObstacleGrid:
        return ObstacleGrid(self, place, sensing)

    @classmethod
    def sensing_from_nav2(cls, values: base.Nav2Values, name: str) -> Sensing:
        def read(declared: Any, below: str) -> dict[str, Any]:
            return {
                field: values.get(f"{name}.{below}{field}", kind, getattr(declared, field))
                for field, kind in _typed(declared).items()
            }

        sources = []
        for source in values.get(f"{name}.observation_sources", "string", "").split():
            settings = read(ObservationSource, f"{source}.")
            settings["topic"] = settings["topic"] or source
            sources.append(ObservationSource(source, **settings))
        return Sensing(tuple(sources), **read(Sensing, ""))

    @classmethod
    def sensing_from_ros1(cls, server: base.Ros1Values, name: str) -> Sensing:
        # Without a list of plugins, the sources stand beside the costmap's own parameters.
        listed = server.find(name, "observation_sources")
        below = () if listed is None else (name,)
        listed = server.find("observation_sources") if listed is None else listed
        names = str(listed.value).split() if listed is not None else []
        sources = tuple(_ros1_source(server, source, below) for source in names)
        height = server.double(2.0, *server.place(name, "max_obstacle_height"))
        counts = [server.integer(getattr(Sensing, field), *server.place(name, field))
                  for field in ("z_voxels", "unknown_threshold", "mark_threshold")]  # fmt: skip
        return Sensing(
            sources, 0.0, height, server.double(0.0, *server.place(name, "origin_z")),
            server.double(0.2, *server.place(name, "z_resolution")), *counts,
        )  # fmt: skip


@dataclass(frozen=True, repr=False)
class VoxelLayer(ObstacleLayer):
    """Settings of costmap_2d's voxel layer, without observations; those of `ObstacleLayer`."""

    name: str = "voxel_layer"
    key: ClassVar[str] = "voxel"
    nav2_plugins: ClassVar[tuple[str, ...]] = ("nav2_costmap_2d::VoxelLayer",)
    ros1_plugins: ClassVar[tuple[str, ...]] = ("costmap_2d::VoxelLayer",)
    ros1_costmap_parameters: ClassVar[tuple[str, ...]] = (
        "origin_z", "z_resolution", "z_voxels", "mark_threshold", "unknown_threshold",
        "publish_voxel_map",
    )  # fmt: skip

    def live(self, place: base.LivePlace, sensing: Sensing) -> VoxelGrid:
        return VoxelGrid(self, place, sensing)


def _places(frame: Frame, x: Floats, y: Floats) -> tuple[Floats, Floats, Mask]:
    """Return fractional row and column of points, and which points lie in the grid."""
    west, south, _ = frame.origin
    col, row = (x - west) / frame.resolution, (y - south) / frame.resolution
    return row, col, (x >= west) & (y >= south) & (col < frame.width) & (row < frame.height)


def cells_at(frame: Frame, x: Floats, y: Floats) -> tuple[Integers, Integers, Mask]:
    """Return row and column of points, and which points lie in the grid: ``worldToMap``."""
    row, col, inside = _places(frame, x, y)
    row, col = np.where(inside, row, 0.0), np.where(inside, col, 0.0)
    return row.astype(np.int64), col.astype(np.int64), inside


class ObstacleGrid(base.LiveLayer):
    def __init__(self, layer: ObstacleLayer, place: base.LivePlace, sensing: Sensing) -> None:
        super().__init__(layer, place)
        self.settings, self.sensing = layer, sensing
        self._default = NO_INFORMATION if layer.track_unknown_space else FREE_SPACE
        self.costs: Bytes = np.full(self.frame.shape, self._default, dtype=np.uint8)
        self._buffers = [ObservationBuffer(s, is_ros1=place.is_ros1) for s in sensing.sources]

    def add(self, observation: Observation) -> None:
        for buffer in self._buffers:
            if buffer.source is observation.source:
                buffer.add(observation)

    def move(self, frame: Frame, rows: int, cols: int) -> None:
        super().move(frame, rows, cols)
        self.costs = shifted(self.costs, rows, cols, self._default)

    def update_bounds(self, update: base.Update) -> None:
        buffered = [(buffer.source, buffer.read(update.time)) for buffer in self._buffers]
        with np.errstate(divide="ignore", invalid="ignore"):
            for source, observations in buffered:
                for observation in observations if source.clearing else ():
                    self._clear(observation, update.bounds)
            for source, observations in buffered:
                for observation in observations if source.marking else ():
                    self._mark(observation, update.bounds)
        if self.settings.footprint_clearing_enabled:
            update.bounds.touch(*update.footprint)

    def update_costs(self, master: base.MasterGrid, window: base.Window) -> None:
        if self.settings.footprint_clearing_enabled and master.under_robot is not None:
            self.costs[master.under_robot] = FREE_SPACE
        below, own = master.costs[window], self.costs[window]
        method = self.settings.combination_method
        if method == OVERWRITE:
            np.copyto(below, own, where=own != NO_INFORMATION)
        elif method == MAXIMUM:
            master.part(window).raise_to(own)
        elif not self.place.is_ros1:
            is_raised = (own != NO_INFORMATION) & (below != NO_INFORMATION) & (own > below)
            np.copyto(below, own, where=is_raised)

    def marks(self, observation: Observation) -> tuple[Integers, Integers, Integers]:
        """Return which points of an observation mark a cell, and the cells' columns and rows."""
        source, sensing, (ox, oy, oz) = observation.source, self.sensing, observation.origin
        most, least = source.obstacle_max_range, source.obstacle_min_range
        x, y, z = observation.points.T
        row, col, marks = cells_at(self.frame, x, y)
        marks &= z <= sensing.max_obstacle_height
        squares = (x - ox) * (x - ox) + (y - oy) * (y - oy)
        if self.place.is_ros1 or isinstance(self, VoxelGrid):
            squares += (z - oz) * (z - oz)
            marks &= squares < most * most
        else:
            start_row, start_col, is_inside = cells_at(self.frame, *np.array([[ox], [oy]]))
            cells = np.trunc(np.hypot(col - start_col, row - start_row))
            nearest, farthest = (cells_to(end, self.frame.resolution) for end in (least, most))
            marks &= is_inside & (squares <= most * most) & (cells >= nearest) & (cells <= farthest)
        if not self.place.is_ros1:
            marks &= (z >= sensing.min_obstacle_height) & (squares >= least * least)
        return np.flatnonzero(marks), col[marks], row[marks]

    def _mark(self, observation: Observation, bounds: base.Bounds) -> None:
        points, col, row = self.marks(observation)
        self.costs[row, col] = LETHAL_OBSTACLE
        bounds.touch(observation.points[points, 0], observation.points[points, 1])

    def _rays(self, observation: Observation) -> tuple[CellRays, Floats] | None:
        """Return the rays that clear cells and all ends; None if the sensor is outside."""
        (west, south, _), cell_size = self.frame.origin, self.frame.resolution
        ox, oy, _ = observation.origin
        start_row, start_col, is_inside = cells_at(self.frame, *np.array([[ox], [oy]]))
        if not is_inside[0]:
            return None
        ends = list(observation.points[:, :2].T)
        away = ends[0] - ox, ends[1] - oy
        east, north = west + self.frame.width * cell_size, south + self.frame.height * cell_size
        # Each border is applied to the ray that the borders before it cut, always along
        # the direction of the whole ray.
        for axis, border, last, is_beyond in (
            (0, west, west, np.less), (1, south, south, np.less),
            (0, east, east - 0.001, np.greater), (1, north, north - 0.001, np.greater),
        ):  # fmt: skip
            cut, across = is_beyond(ends[axis], border), 1 - axis
            share = (border - observation.origin[axis]) / away[axis]
            crossing = observation.origin[across] + away[across] * share
            ends[across] = np.where(cut, crossing, ends[across])
            ends[axis] = np.where(cut, last, ends[axis])
        row, col, is_inside = cells_at(self.frame, *ends)
        start, cells = np.array([start_col, start_row]), np.array([col, row])[:, is_inside]
        return self._traced(start, cells, observation.source), np.array(ends)[:, is_inside]

    def _traced(self, start: Array, ends: Array, source: ObservationSource) -> CellRays:
        """Return rays without the part that is too near, cut to the length of rays in cells."""
        most = cells_to(source.raytrace_max_range, self.frame.resolution)
        least = cells_to(self._least_range(source), self.frame.resolution)
        away = (ends - start).astype(np.float64)
        lengths = np.sqrt(sum(away * away)) if len(away) > 2 else np.hypot(*away)
        begin = np.where(lengths > 0, start + away / lengths * least, start).astype(np.int64)
        deltas = ends.astype(np.int64) - begin
        longest = np.abs(deltas).max(axis=0, initial=0)
        scale = np.where(lengths > 0, np.minimum(1.0, most / lengths), 1.0)
        steps = np.minimum((scale * longest).astype(np.int64), longest)
        is_long = lengths >= least
        return CellRays(begin[:, is_long], deltas[:, is_long], steps[is_long])

    def _least_range(self, source: ObservationSource) -> float:
        return 0.0 if self.place.is_ros1 else source.raytrace_min_range

    def _clear(self, observation: Observation, bounds: base.Bounds) -> None:
        if (found := self._rays(observation)) is not None:
            bounds.touch(*np.array(observation.origin[:2])[:, np.newaxis])
            clear_rays(found[0], self.costs)
            self._touch_rays(observation, found[1], bounds)

    def _touch_rays(self, observation: Observation, ends: Floats, bounds: base.Bounds) -> None:
        start = np.array(observation.origin[:2])[:, np.newaxis]
        away = ends - start
        distance = np.hypot(*away)
        scale = np.fmin(1.0, observation.source.raytrace_max_range / distance)
        bounds.touch(*(start + away * scale)[:, distance >= self._least_range(observation.source)])


class VoxelGrid(ObstacleGrid):
    """Grid of a voxel layer: a column of up to 16 voxels for each cell, see `VOXEL`."""

    def __init__(self, layer: ObstacleLayer, place: base.LivePlace, sensing: Sensing) -> None:
        super().__init__(layer, place, sensing)
        self.columns = np.full(self.frame.shape, _UNKNOWN_COLUMN, dtype=np.uint32)
        self._unknown_threshold = sensing.unknown_threshold + (_MOST_VOXELS - sensing.z_voxels)

    def move(self, frame: Frame, rows: int, cols: int) -> None:
        super().move(frame, rows, cols)
        self.columns = shifted(self.columns, rows, cols, _UNKNOWN_COLUMN)

    def _levels(self, z: Floats) -> tuple[Floats, Mask]:
        levels = (z - self.sensing.origin_z) / self.sensing.z_resolution
        return levels, (z >= self.sensing.origin_z) & (levels < self.sensing.z_voxels)

    def marks(self, observation: Observation) -> tuple[Integers, Integers, Integers]:
        points, col, row = super().marks(observation)
        _, is_level = self._levels(np.maximum(observation.points[points, 2], self.sensing.origin_z))
        return points[is_level], col[is_level], row[is_level]

    def _mark(self, observation: Observation, bounds: base.Bounds) -> None:
        points, col, row = self.marks(observation)
        z = np.maximum(observation.points[points, 2], self.sensing.origin_z)
        level = self._levels(z)[0].astype(np.uint32)
        columns, column = self.columns.reshape(-1), row * self.frame.width + col
        first = self._first_lethal(columns, column, level)
        np.bitwise_or.at(columns, column, VOXEL << level)
        is_lethal = np.arange(len(column)) >= first
        self.costs[row[is_lethal], col[is_lethal]] = LETHAL_OBSTACLE
        x, y, _ = observation.points[points[is_lethal]].T
        bounds.touch(x, y)

    def _first_lethal(
        self, columns: NDArray[np.uint32], column: Integers, level: NDArray[np.uint32]
    ) -> Integers:
        """Return for each point the first point from which its column has enough marks."""
        # Points are marked one by one: only from that point on, they touch the bounds.
        enough = self.sensing.mark_threshold + 1
        if enough <= 1:
            return np.zeros(len(column), dtype=np.int64)
        first: dict[int, int] = {}
        marks: dict[int, int] = {}
        for point, (index, height) in enumerate(zip(column.tolist(), level.tolist(), strict=True)):
            marks[index] = marks.get(index, int(columns[index]) >> _MOST_VOXELS) | 1 << height
            if marks[index].bit_count() >= enough:
                first.setdefault(index, point)
        return np.array([first.get(index, len(column)) for index in column.tolist()], np.int64)

    def _rays(self, observation: Observation) -> tuple[CellRays, Floats] | None:
        sensing = self.sensing
        (west, south, _), cell_size = self.frame.origin, self.frame.resolution
        ox, oy, oz = observation.origin
        origin = np.array(observation.origin)[:, np.newaxis]
        start, is_inside = self._voxels_at(origin)
        if not is_inside[0]:
            return None
        east = west + (self.frame.width - self.place.size_margin) * cell_size
        north = south + (self.frame.height - self.place.size_margin) * cell_size
        ceiling = sensing.origin_z + sensing.z_voxels * sensing.z_resolution
        if self.place.is_ros1:
            ceiling = sensing.max_obstacle_height
        away = observation.points.T - origin
        distance = np.sqrt(sum(away * away))
        share = np.maximum(np.fmin(1.0, (distance - 2 * cell_size) / distance), 0.0)
        x, y, z = ends = share * away + origin
        a, b, c = away = ends - origin
        t = np.ones_like(x)
        is_high, is_low = z > ceiling, z < sensing.origin_z
        t = np.where(is_high, np.maximum(0.0, np.fmin(t, (ceiling - 0.01 - oz) / c)), t)
        t = np.where(is_low, np.fmin(t, (sensing.origin_z - oz) / c), t)
        is_cut = is_high | is_low
        for cut, border in (
            (x < west, (west - ox) / a), (y < south, (south - oy) / b),
            (x > east, (east - ox) / a), (y > north, (north - oy) / b),
        ):  # fmt: skip
            t = np.where(cut, np.fmin(t, border), t)
            is_cut |= cut
        if not self.place.is_ros1:
            t = np.where(is_cut, t - np.sign(t) * _WORLD_EPSILON, t)
        ends = origin + away * t
        places, is_inside = self._voxels_at(ends)
        return self._traced(start, places[:, is_inside], observation.source), ends[:2, is_inside]

    def _voxels_at(self, points: Floats) -> tuple[Floats, Mask]:
        """Return fractional column, row and level, and which points lie in the voxels' grid."""
        row, col, inside = _places(self.frame, points[0], points[1])
        level, is_between = self._levels(points[2])
        return np.array([col, row, level]), inside & is_between

    def _clear(self, observation: Observation, bounds: base.Bounds) -> None:
        if (found := self._rays(observation)) is not None:
            clear_rays(
                found[0], self.costs, self.columns, mark_threshold=self.sensing.mark_threshold,
                unknown_threshold=self._unknown_threshold,
            )  # fmt: skip
            self._touch_rays(observation, found[1], bounds)
