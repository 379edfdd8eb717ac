"""Costmap layers ``obstacle`` and ``voxel`` before their first observation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.values import FREE_SPACE, NO_INFORMATION
from mapdeal.layers.layer import CostmapLayer, MasterGrid, Nav2Values, PluginEntry, Ros1Values

_OVERWRITE: Final = 0
_MAXIMUM: Final = 1
_KEEP_UNKNOWN: Final = 2

_SOURCE_PARAMETERS = {
    "topic": "string", "sensor_frame": "string", "observation_persistence": "double",
    "expected_update_rate": "double", "data_type": "string", "min_obstacle_height": "double",
    "max_obstacle_height": "double", "inf_is_valid": "bool", "marking": "bool",
    "clearing": "bool", "obstacle_max_range": "double", "obstacle_min_range": "double",
    "raytrace_max_range": "double", "raytrace_min_range": "double",
}  # fmt: skip


@dataclass(frozen=True, repr=False)
class ObstacleLayer(CostmapLayer):
    """Settings of costmap_2d's obstacle layer, without observations.

    Parameters
    ----------
    name : str
        Name in the list of plugins.
    track_unknown_space : bool
        Whether cells without observations are unknown, and so without effect, instead of free.
    combination_method : int
        0 replaces all costs below by known ones, 1 takes the maximum, where unknown costs are
        replaced, and 2 does so but for unknown costs, which stay.
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
    combination_method: int = _MAXIMUM
    footprint_clearing_enabled: bool = True

    key: ClassVar[str] = "obstacle"
    nav2_plugins: ClassVar[tuple[str, ...]] = ("nav2_costmap_2d::ObstacleLayer",)
    ros1_plugins: ClassVar[tuple[str, ...]] = ("costmap_2d::ObstacleLayer",)
    about: ClassVar[str] = (
        "without observations: frees unknown cells, or all, unless it tracks them"
    )
    marks_obstacles: ClassVar[bool] = True
    needs: ClassVar[str] = "observations"
    nav2_parameters: ClassVar[Mapping[str, str]] = {
        "enabled": "bool", "footprint_clearing_enabled": "bool", "min_obstacle_height": "double",
        "max_obstacle_height": "double", "combination_method": "integer",
        "observation_sources": "string", "origin_z": "double", "z_resolution": "double",
        "z_voxels": "integer", "unknown_threshold": "integer", "mark_threshold": "integer",
        "publish_voxel_map": "bool",
    }  # fmt: skip
    other_parameters: ClassVar[frozenset[str]] = frozenset(
        {*_SOURCE_PARAMETERS, "max_obstacle_range", "min_obstacle_range", "obstacle_range",
         "raytrace_range", "tf_filter_tolerance", "transform_tolerance",
         "restore_cleared_footprint", "max_obstacle_distance", "restore_outdated_obstacles",
         "tf_tolerance"}
    )  # fmt: skip

    ros1_costmap_parameters: ClassVar[tuple[str, ...]] = (
        "max_obstacle_height", "raytrace_range", "obstacle_range", "track_unknown_space",
    )  # fmt: skip

    @property
    def overwrites_all(self) -> bool:
        return self.combination_method == _OVERWRITE and not self.track_unknown_space

    def why_idle(self, has_unknown: bool) -> str | None:
        if self.combination_method == _KEEP_UNKNOWN or self.track_unknown_space:
            return "no observations"
        if self.combination_method == _MAXIMUM and not has_unknown:
            return "no observations, and no unknown cells to free"
        return None

    def unknown_after(self, is_unknown: bool) -> bool:
        return is_unknown and self.why_idle(is_unknown) is not None

    def apply(self, master: MasterGrid) -> None:
        if self.combination_method == _KEEP_UNKNOWN:
            return
        free: NDArray[np.bool_] | None = np.ones((1, 1), dtype=np.bool_)  # broadcasts to all cells
        if self.track_unknown_space:
            free = master.under_robot if self.footprint_clearing_enabled else None
        if free is not None and self.combination_method == _MAXIMUM:
            free = free & (master.costs == NO_INFORMATION)
        if free is not None:
            np.copyto(master.costs, FREE_SPACE, where=free)

    def effect(self) -> str:
        cells = "unknown cells" if self.combination_method == _MAXIMUM else "all cells"
        return f"no observations: {cells} become free"

    @classmethod
    def from_nav2(cls, values: Nav2Values, entry: PluginEntry) -> ObstacleLayer:
        name = entry.name
        sources = set(values.get(f"{name}.observation_sources", "string", "").split())
        for parameter in values.parameters:
            prefix, _, plain_name = parameter.removeprefix(f"{name}.").rpartition(".")
            source_types = _SOURCE_PARAMETERS if prefix in sources else {}
            types = source_types if prefix else cls.nav2_parameters
            if plain_name in types and parameter.startswith(f"{name}."):
                values.get(parameter, types[plain_name], None)
        method = values.get(f"{name}.combination_method", "integer", _MAXIMUM)
        return cls(
            name=name,
            track_unknown_space=values.flag("track_unknown_space"),
            combination_method=method if method in (_OVERWRITE, _KEEP_UNKNOWN) else _MAXIMUM,
            footprint_clearing_enabled=values.flag(f"{name}.footprint_clearing_enabled", True),
        )

    @classmethod
    def from_ros1(cls, server: Ros1Values, entry: PluginEntry) -> ObstacleLayer:
        name = entry.name
        costmap_tracks = server.boolean(False, "track_unknown_space")
        path = (name, "track_unknown_space")
        is_overridden = "track_unknown_space" in cls.ros1_costmap_parameters
        place = server.place(*path) if is_overridden else path
        method = cls._ros1_method(server.integer(_MAXIMUM, name, "combination_method"))
        return cls(
            name=name,
            track_unknown_space=server.boolean(costmap_tracks, *place),
            combination_method=method if method in (_OVERWRITE, _MAXIMUM) else _KEEP_UNKNOWN,
            footprint_clearing_enabled=server.boolean(True, name, "footprint_clearing_enabled"),
        )

    @staticmethod
    def _ros1_method(method: int) -> int:
        return method


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

    @staticmethod
    def _ros1_method(method: int) -> int:
        return min(max(method, _OVERWRITE), _KEEP_UNKNOWN)  # dynamic_reconfigure has limits here
