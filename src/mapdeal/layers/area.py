"""The area of a costmap: where its cells lie on the map, and which ones the robot covers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np

from mapdeal.command import ABOVE_0, accept_parameters, parameters_of, structured
from mapdeal.errors import ParameterError, require
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import MOST_CELLS, Frame, Origin, as_float32, turned
from mapdeal.kernels.arrays import Floats, Integers, Mask
from mapdeal.records import dataclass

Pose = tuple[float, float, float]
Cells = tuple[Integers, Integers]
_EXAMPLE = "{height: 60, width: 60, resolution: 0.05, is_rolling: yes, global_frame: odom}"


@dataclass(frozen=True)
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

    height: Annotated[int, ABOVE_0]
    width: Annotated[int, ABOVE_0]
    resolution: Annotated[float, ABOVE_0]
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
    values, known = dict(value), dict(parameters_of(CostmapArea))
    del known["global_frame"]  # a text, unlike all others
    global_frame = values.pop("global_frame", "map")
    is_text = isinstance(global_frame, str)
    require(is_text, "must be text", f"{name}.global_frame", got=global_frame)
    accepted: dict[str, Any] = accept_parameters(known, values, name)
    if accepted["height"] * accepted["width"] > MOST_CELLS:
        raise ParameterError(f"must not have more than {MOST_CELLS} cells", place=name, got=value)
    return CostmapArea(**accepted, global_frame=global_frame)


structured(CostmapArea, accept_area)


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
