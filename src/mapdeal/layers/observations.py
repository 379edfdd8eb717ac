"""Observations of sensors, and the grids that obstacle and voxel layers make of them.

References
----------
``observation_buffer.cpp``, ``obstacle_layer.cpp``, ``voxel_layer.cpp``, ``voxel_grid.hpp`` and
``raytraceLine`` in ``costmap_2d.hpp``, of nav2_costmap_2d and of costmap_2d in ROS 1. Positions are
computed in double, in the order of the real code: the last bit decides which cell a point is in.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SECOND = 10**9
_LARGEST_LENGTH = float(1 << 31)  # of rays, cells


@dataclass(frozen=True)
class ObservationSource:
    """One of a layer's ``observation_sources``; lengths in metres, times in seconds."""

    name: str
    topic: str
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
    """Points of one message between the source's heights, and the sensor's place.

    Both are in the costmap's frame, metres. The points, shape (N, 3), are rounded to float32.
    """

    source: ObservationSource
    time: int
    origin: tuple[float, float, float]
    points: Floats


def observed(
    source: ObservationSource, time: int, origin: tuple[float, float, float], points: Floats,
) -> Observation:  # fmt: skip
    """Return the observation that a buffer stores: the points between the source's heights."""
    z = points[:, 2]
    is_within = (z <= source.max_obstacle_height) & (z >= source.min_obstacle_height)
    return Observation(source, time, origin, points[is_within])


class ObservationBuffer:
    """Observations of one source, the newest first."""

    def __init__(self, source: ObservationSource, *, is_ros1: bool) -> None:
        self.source, self._is_ros1 = source, is_ros1
        self._persistence = round(source.observation_persistence * _SECOND)
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
        is_old = [reference - entry.time > self._persistence for entry in self._observations]
        if self._is_ros1 and any(is_old):  # the first that is too old takes all behind it along
            del self._observations[is_old.index(True) :]
        else:
            pairs = zip(self._observations, is_old, strict=True)
            self._observations = [entry for entry, old in pairs if not old]
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
    return min(max(0.0, float(np.ceil(distance / resolution))), _LARGEST_LENGTH)
