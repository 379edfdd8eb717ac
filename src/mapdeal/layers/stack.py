"""The layers of one costmap, in order, and where its cells lie on the map."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import dropwhile
from typing import Annotated, Any

import numpy as np

from mapdeal import command, records
from mapdeal.errors import ParameterError, require
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import MOST_CELLS, Frame, Origin, as_float32, turned
from mapdeal.grid.values import FREE_SPACE, NO_INFORMATION, OCCUPIED, UnknownPolicy
from mapdeal.kernels.arrays import Floats, Integers, Mask
from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.keepout import KeepoutFilter
from mapdeal.layers.layer import CostmapLayer
from mapdeal.layers.static import StaticLayer

Pose = tuple[float, float, float]
Cells = tuple[Integers, Integers]
_EXAMPLE = "{height: 60, width: 60, resolution: 0.05, is_rolling: yes, global_frame: odom}"


@records.dataclass(frozen=True)
class CostmapArea:
    """Size and place of a costmap that are set by parameters instead of a map.

    Parameters
    ----------
    height, width : int
        Number of rows and columns.
    resolution : float
        Side of a cell, metres.
    origin : tuple of float
        Lower left corner before the costmap first moves, metres.
    is_rolling : bool
        Whether the costmap moves with the robot, which stays in its middle.
    size_margin : float
        Cells by which the size in metres is less than all cells: 0.5 in ROS 1 and in Nav2 up to
        Kilted, where it ends in the middle of the last cell.
    global_frame : str
        Frame of reference of the costmap.
    """

    height: Annotated[int, command.ABOVE_0]
    width: Annotated[int, command.ABOVE_0]
    resolution: Annotated[float, command.ABOVE_0]
    origin: tuple[float, float] = (0.0, 0.0)
    is_rolling: bool = True
    size_margin: float = 0.0
    global_frame: str = "map"

    @property
    def is_in_map_frame(self) -> bool:
        return self.global_frame.strip("/") == "map"

    def placed(self, pose: Sequence[float] | None) -> Frame:
        """Return the frame of the costmap around a robot, in `global_frame`."""
        # As updateOrigin and getSizeInMetersX in costmap_2d.cpp.
        x, y = self.origin
        if self.is_rolling and pose is not None:
            x, y = self._moved(x, self.width, pose[0]), self._moved(y, self.height, pose[1])
        return Frame(self.height, self.width, self.resolution, (x, y, 0.0))

    def _moved(self, corner: float, cells: int, robot: float) -> float:
        goal = robot - (cells - self.size_margin) * self.resolution / 2
        for _ in range(3):  # updates move by whole cells; rounding may defer a cell to the next one
            corner += int((goal - corner) / self.resolution) * self.resolution
        return corner


def accept_area(name: str, value: object) -> CostmapArea:
    if isinstance(value, CostmapArea):
        return value
    if not isinstance(value, Mapping) or not {"height", "width", "resolution"} <= set(value):
        raise ParameterError(f"must look like {_EXAMPLE}", place=name, got=value)
    values, known = dict(value), dict(command.parameters_of(CostmapArea))
    del known["global_frame"]  # a text, unlike all others
    global_frame = values.pop("global_frame", "map")
    require(isinstance(global_frame, str), "must be text", f"{name}.global_frame", got=global_frame)
    accepted: dict[str, Any] = command.accept_parameters(known, values, name)
    if accepted["height"] * accepted["width"] > MOST_CELLS:
        raise ParameterError(f"must not have more than {MOST_CELLS} cells", place=name, got=value)
    return CostmapArea(**accepted, global_frame=global_frame)


command.structured(CostmapArea, accept_area)


def cells_below(area: Frame, map_to_area: Pose | None, map_frame: Frame, rows: slice) -> Cells:
    """Return the map's row and column below each cell centre in rows of a costmap."""
    # As updateCosts of a rolling costmap in static_layer.cpp, with tf2's rotation matrix: on edges
    # the last bit decides. `map_to_area` is the costmap's frame of reference in that of the map.
    across = np.arange(area.width, dtype=np.float64)[np.newaxis, :]
    along = np.arange(rows.start, rows.stop, dtype=np.float64)[:, np.newaxis]
    x = area.origin[0] + (across + 0.5) * area.resolution
    y = area.origin[1] + (along + 0.5) * area.resolution
    if map_to_area is not None:
        shift_x, shift_y, yaw = map_to_area
        z, w = math.sin(yaw / 2), math.cos(yaw / 2)
        scaled = z * (2.0 / (z * z + w * w))
        cos, sin = 1.0 - z * scaled, w * scaled
        x, y = cos * x + -sin * y + shift_x, sin * x + cos * y + shift_y
    return _cells_of(x, y, map_frame.origin, as_float32(map_frame.resolution))


def _cells_of(x: Floats, y: Floats, origin: Origin, cell_size: float) -> Cells:
    """Return the cells of points, as costmap_2d's ``worldToMap``."""
    x, y, yaw = x - origin[0], y - origin[1], origin[2]
    if yaw != 0.0:  # costmap_2d ignores the yaw
        cos, sin = math.cos(yaw), math.sin(yaw)
        x, y = x * cos + y * sin, y * cos - x * sin
    return np.floor(y / cell_size).astype(np.int64), np.floor(x / cell_size).astype(np.int64)


def covered_cells(footprint: Footprint, pose: Pose, area: Frame, cell_size: float) -> Mask | None:
    """Return the cells of a costmap that a footprint covers; None if a corner lies outside."""
    from mapdeal.kernels.sensing import CellRays  # slow to import

    # As transformFootprint in footprint.cpp, and setConvexPolygonCost in costmap_2d.cpp, which
    # fills each column from the lowest to the highest cell of the outline.
    x, y = (turned(footprint.corners, pose[2]) + pose[:2]).T
    row, col = _cells_of(x, y, area.origin, cell_size)
    if not ((row >= 0) & (row < area.height) & (col >= 0) & (col < area.width)).all():
        return None
    starts = np.array([col, row])
    deltas = np.roll(starts, -1, axis=1) - starts
    outline = CellRays(starts, deltas, np.abs(deltas).max(axis=0))
    across, along = np.concatenate(list(outline.cells()), axis=1)
    first, bottom = int(col.min()), int(row.min())
    box = slice(bottom, int(row.max()) + 1), slice(first, int(col.max()) + 1)
    covered = np.zeros(area.shape, dtype=np.bool_)
    inside = covered[box]
    lowest, highest = np.full((2, inside.shape[1]), [[area.height], [-1]])
    np.minimum.at(lowest, across - first, along)
    np.maximum.at(highest, across - first, along)
    rows = np.arange(box[0].start, box[0].stop)[:, np.newaxis]
    inside[:] = (rows >= lowest) & (rows <= highest)
    return covered


@records.dataclass(frozen=True)
class CostmapLayers:
    """The enabled layers that turn a map into a costmap, from the first to the last."""

    layers: tuple[CostmapLayer, ...]
    default_cost: int = FREE_SPACE  # of an empty costmap, 0 or 255
    circumscribed_radius: float | None = None  # of the robot, metres
    area: CostmapArea | None = None  # if the map does not give size and place
    footprint: Footprint | None = None  # padded, if the robot's pose matters

    @property
    def effective(self) -> tuple[CostmapLayer, ...]:
        """Layers that change a cost, for a robot that stands outside of the map."""
        effective: list[CostmapLayer] = []
        has_unknown = self.default_cost == NO_INFORMATION
        for layer in self.layers:
            if layer.why_idle(has_unknown):
                continue
            if layer.overwrites_all:
                effective.clear()
            effective.append(layer)
            has_unknown = layer.may_leave_unknown(has_unknown)
        return tuple(effective)

    @property
    def static_layers(self) -> tuple[StaticLayer, ...]:
        return tuple(layer for layer in self.layers if isinstance(layer, StaticLayer))

    @property
    def inflation_layers(self) -> tuple[InflationLayer, ...]:
        return tuple(layer for layer in self.layers if isinstance(layer, InflationLayer))

    @property
    def keeps_unknown(self) -> bool:
        """Whether cells that the map does not know are unknown in the costmap."""
        is_unknown = self.default_cost == NO_INFORMATION
        for layer in self.layers:
            is_unknown = layer.unknown_after(is_unknown)
        return is_unknown

    @property
    def has_keepout(self) -> bool:
        return any(map(_is_keepout, self.layers))

    @property
    def inflates_keepout(self) -> bool:
        """Whether an inflation layer sees the lethal cells of a keepout mask."""
        above = dropwhile(lambda layer: not _is_keepout(layer), self.effective)
        return any(layer.spreads for layer in above)

    @property
    def loses_keepout(self) -> bool:
        """Whether a later layer overwrites all that a keepout mask has written."""
        return self.has_keepout and not any(map(_is_keepout, self.effective))

    def with_mask_last(self) -> CostmapLayers:
        """Return the layers without keepout filters where it makes no difference."""
        # A mask over the finished costs has the same effect as filters after all layers.
        without_filters = tuple(layer for layer in self.layers if not _is_keepout(layer))
        is_last = self.layers[: len(without_filters)] == without_filters
        return records.replace(self, layers=without_filters) if is_last else self

    @property
    def static_and_inflation(self) -> tuple[StaticLayer, InflationLayer | None] | None:
        """One static layer, and at most one inflation layer above it; None for other layers."""
        # Includes static layers that only raise costs, because no layer lies below them.
        match self.effective:
            case (StaticLayer() as static,):
                return static, None
            case (StaticLayer() as static, InflationLayer() as inflation):
                return static, inflation
        return None

    @property
    def inflations_above_map(self) -> tuple[InflationLayer, ...] | None:
        above = tuple(dropwhile(lambda layer: not isinstance(layer, StaticLayer), self.effective))
        inflations = tuple(layer for layer in above if isinstance(layer, InflationLayer))
        return inflations if above else None

    @property
    def obstacle_rule(self) -> tuple[int, UnknownPolicy] | None:
        """Least occupancy of an obstacle, and the policy for unknown cells, of the first map."""
        statics = [layer for layer in self.effective if isinstance(layer, StaticLayer)]
        # A static layer sees -1 as byte 255. Behind a field whose obstacles include unknown cells,
        # layers get 100 for them, so that no layer may treat the two values differently.
        special = {layer.inscribed_obstacle_cost_value for layer in statics}
        special |= {layer.unknown_cost_value for layer in statics}
        for layer in statics:
            if layer.lethal_cost_threshold > 0:  # with a threshold of 0 every cell is an obstacle
                is_lethal = special.isdisjoint({NO_INFORMATION, OCCUPIED})
                return layer.lethal_cost_threshold, "occupied" if is_lethal else "free"
        return None


def _is_keepout(layer: CostmapLayer) -> bool:
    return isinstance(layer, KeepoutFilter)
