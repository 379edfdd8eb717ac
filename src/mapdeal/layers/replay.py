"""A robot's costmap that is updated again and again, as ``LayeredCostmap::updateMap`` does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame, turned
from mapdeal.layers.area import Pose, cells_below, covered_cells
from mapdeal.layers.layer import Bounds, LiveLayer, LivePlace, MasterGrid, Update, Window
from mapdeal.layers.observations import shifted


class LiveCostmap:
    """A costmap that is updated again and again.

    Parameters
    ----------
    place : LivePlace
        Where the costmap is; its frame has the resolution that the robot computes with.
    layers : sequence of LiveLayer
        Layers, the lowest first.
    default_cost : int
        Cost of an empty costmap, 0 or 255.
    footprint : Footprint
        The robot's padded footprint.
    occupancy : numpy.ndarray of int8, shape (H, W), optional
        The map that static layers read, on `place.map_frame`.
    """

    def __init__(
        self, place: LivePlace, layers: Sequence[LiveLayer], default_cost: int,
        footprint: Footprint, occupancy: NDArray[np.int8] | None,
    ) -> None:  # fmt: skip
        self.frame, self.layers = place.frame, layers
        self._place, self._default_cost, self._footprint = place, default_cost, footprint
        self._map = occupancy
        self.costs = np.full(self.frame.shape, default_cost, dtype=np.uint8)
        self.master: MasterGrid | None = None
        """The grid of the last update."""

    @property
    def under_robot(self) -> NDArray[np.bool_] | None:
        return None if self.master is None else self.master.under_robot

    def update(self, pose: Pose, time: int, map_to_costmap: Pose | None = None) -> None:
        """Update the costmap around the robot's pose; observations were added to its layers."""
        if self._place.is_rolling:
            self._move(pose)
        corners = turned(np.array(self._footprint.vertices), pose[2])
        footprint = corners[:, 0] + pose[0], corners[:, 1] + pose[1]
        update = Update(time, footprint, Bounds())
        for layer in self.layers:
            layer.update_bounds(update)
        window = self._window(update.bounds)
        if window is None:
            return
        self.costs[window] = self._default_cost
        self.master = master = self._master(pose, map_to_costmap)
        for layer in self.layers:
            layer.update_costs(master, window)

    def _move(self, pose: Pose) -> None:
        cell_size, margin = self.frame.resolution, self._place.size_margin
        shifts, corner = [], []
        for start, cells, robot in zip(
            self.frame.origin, self.frame.shape[::-1], pose, strict=False
        ):
            goal = robot - (cells - margin) * cell_size / 2
            shifts.append(int((goal - start) / cell_size))
            corner.append(start + shifts[-1] * cell_size)
        cols, rows = shifts
        if rows or cols:
            height, width = self.frame.shape
            self.frame = Frame(height, width, cell_size, (corner[0], corner[1], 0.0))
            self.costs = shifted(self.costs, rows, cols, self._default_cost)
            for layer in self.layers:
                layer.move(self.frame, rows, cols)

    def _window(self, bounds: Bounds) -> Window | None:
        """Return the rows and columns within bounds, as ``worldToMapEnforceBounds``."""
        sides = []
        for low, high, corner, cells in zip(
            bounds.low, bounds.high, self.frame.origin[:2], self.frame.shape[::-1], strict=True
        ):
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
