"""Names of parameters that costmaps and their layers read.

References
----------
navigation, branch noetic-devel: ``costmap_2d_ros.cpp``, ``static_layer.cpp``,
``inflation_layer.cpp``, ``obstacle_layer.cpp``, ``voxel_layer.cpp`` and the files below ``cfg``;
navigation2, branches humble to main: the same of ``nav2_costmap_2d``.
"""

from __future__ import annotations

from mapdeal.robot.parameters import Flavour

_COSTMAP = {
    "always_send_full_costmap", "footprint", "footprint_padding", "footprint_topic",
    "global_frame", "height", "lethal_cost_threshold", "map_topic", "origin_x", "origin_y",
    "plugins", "publish_frequency", "published_footprint_topic", "resolution",
    "robot_base_frame", "robot_radius", "rolling_window", "track_unknown_space",
    "transform_tolerance", "unknown_cost_value", "update_frequency", "width",
}  # fmt: skip
_COSTMAP_OF = {
    "ros1": {
        "cost_scaling_factor", "inflation_radius", "map_type", "mark_threshold",
        "max_obstacle_height", "observation_sources", "obstacle_range", "origin_z",
        "publish_voxel_map", "raytrace_range", "static_map", "unknown_threshold", "z_resolution",
        "z_voxels", "min_obstacle_height", "combination_method", "first_map_only", "meter_scoring",
        "inflate_unknown", "trinary_costmap", "use_maximum", "subscribe_to_updates", "enabled",
        "footprint_clearing_enabled", "max_obstacle_range", "obstacle_layer", "static_layer",
    },
    "nav2": {
        "bond_heartbeat_period", "filters", "initial_transform_timeout",
        "inscribed_obstacle_cost_value", "introspection_mode", "map_vis_z", "node_namespace",
        "observation_sources", "plugin_names", "plugin_types", "subscribe_to_stamped_footprint",
        "transform_timeout", "trinary_costmap", "unknown_threshold", "use_maximum",
        "use_sim_time", "use_radius", "autostart_node", "service_introspection_mode",
        "odom_topic", "enable_stamped_cmd_vel", "allow_parameter_qos_overrides",
        "always_reset_initial_pose", "stamped_footprint",
    },
}  # fmt: skip
_STATIC = {
    "enabled", "first_map_only", "footprint_clearing_enabled", "lethal_cost_threshold",
    "map_subscribe_transient_local", "map_topic", "plugin", "restore_cleared_footprint",
    "subscribe_to_updates", "track_unknown_space", "transform_tolerance", "trinary_costmap",
    "unknown_cost_value", "use_maximum", "inscribed_obstacle_cost_value", "resize_master",
}  # fmt: skip
_INFLATION = {
    "cost_scaling_factor", "custom_inscribed_radius", "enabled", "inflate_around_unknown",
    "inflate_unknown", "inflation_radius", "num_threads", "plugin", "robot_radius",
}  # fmt: skip
_ASYMMETRIC = _INFLATION - {"cost_scaling_factor", "custom_inscribed_radius"} | {
    "cost_scaling_factor_left", "cost_scaling_factor_right", "goal_distance_threshold",
    "plan_topic",
}  # fmt: skip
_OBSTACLE = {
    "clearing", "combination_method", "data_type", "enabled", "footprint_clearing_enabled",
    "inf_is_valid", "mark_threshold", "marking", "max_obstacle_height", "max_obstacle_range",
    "min_obstacle_height", "min_obstacle_range", "observation_sources", "obstacle_max_range",
    "obstacle_min_range", "obstacle_range", "origin_z", "plugin", "publish_voxel_map",
    "raytrace_max_range", "raytrace_min_range", "raytrace_range", "tf_filter_tolerance", "topic",
    "track_unknown_space", "transform_tolerance", "unknown_threshold", "z_resolution", "z_voxels",
    "sensor_frame", "observation_persistence", "expected_update_rate", "restore_cleared_footprint",
    "max_obstacle_distance", "restore_outdated_obstacles", "tf_tolerance",
}  # fmt: skip
_BY_CLASS = {
    "StaticLayer": _STATIC, "InflationLayer": _INFLATION, "LegacyInflationLayer": _INFLATION,
    "AsymmetricInflationLayer": _ASYMMETRIC, "ObstacleLayer": _OBSTACLE, "VoxelLayer": _OBSTACLE,
}  # fmt: skip

LOOKS_LIKE_A_LAYER = frozenset(
    {"enabled", "plugin", "inflation_radius", "cost_scaling_factor", "observation_sources",
     "map_subscribe_transient_local", "map_topic", "inflate_unknown"}
)  # fmt: skip
"""A section with one of these is meant to be a layer."""

OF_AN_IDLE_LAYER = frozenset(
    {"enabled", "plugin", "map_subscribe_transient_local", "map_topic", "subscribe_to_updates"}
)
"""A layer of no more than these that is not listed is not missed."""

BELOW_INFLATION = frozenset({"inflation_radius", "cost_scaling_factor", "inflate_unknown"})
"""What an inflation layer reads; Nav2 does not hand it down from the costmap."""

_ALL_LAYERS = (
    "StaticLayer", "InflationLayer", "LegacyInflationLayer", "AsymmetricInflationLayer",
)  # fmt: skip
_OF_COSTMAP: dict[str, tuple[str, ...]] = {
    "footprint": _ALL_LAYERS,
    "robot_radius": _ALL_LAYERS,
    "footprint_padding": _ALL_LAYERS,
}
ABOVE_LAYERS: dict[Flavour, dict[str, tuple[str, ...]]] = {
    "ros1": _OF_COSTMAP,
    "nav2": _OF_COSTMAP
    | dict.fromkeys(
        ("track_unknown_space", "lethal_cost_threshold", "unknown_cost_value", "trinary_costmap",
         "use_maximum", "inscribed_obstacle_cost_value"),
        ("StaticLayer",),
    ),
}  # fmt: skip
"""Parameters of a costmap that have no effect below layers of these classes."""

SECTIONS_OF_OLD = ("static_map", "map_type")
"""What ROS 1 reads where there is no list of plugins."""


def known_names(flavour: Flavour, layer: str) -> frozenset[str]:
    """Return the names that a costmap knows, or a layer of a class; none of other classes."""
    if not layer:
        return frozenset(_COSTMAP | _COSTMAP_OF[flavour])
    return frozenset(_BY_CLASS.get(layer, set()))
