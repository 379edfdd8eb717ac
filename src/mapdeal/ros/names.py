"""Names and lengths in a robot's files that ROS accepts, and that are likely to be mistakes."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from difflib import get_close_matches

from mapdeal.layers.catalogue import class_name, layer_named
from mapdeal.ros.nav2 import DECLARED
from mapdeal.ros.robot import Flavour, ParameterValue, Problem, RobotParameters
from mapdeal.ros.ros1 import COSTMAP_PARAMETERS

Name = tuple[str, ...]  # of a parameter in a costmap: ("inflation_layer", "inflation_radius")
Values = Mapping[Name, ParameterValue]
Plugins = tuple[tuple[str, str], ...]  # names and classes

_LEAST_SIMILARITY = 0.85
# Limits of the search for misspelt names, which compares each name with all known ones.
MOST_NAMES, _LONGEST_NAME = 1000, 60

_COSTMAP: dict[Flavour, frozenset[str]] = {
    "ros1": COSTMAP_PARAMETERS | {
        "combination_method", "enabled", "first_map_only", "footprint_clearing_enabled",
        "footprint_topic", "height", "inflate_unknown", "mark_threshold", "max_obstacle_range",
        "meter_scoring", "min_obstacle_height", "obstacle_layer", "origin_x", "origin_y",
        "origin_z", "publish_voxel_map", "published_footprint_topic", "static_layer",
        "subscribe_to_updates", "unknown_threshold", "use_maximum", "width", "z_resolution",
        "z_voxels",
    },
    "nav2": frozenset(DECLARED) | {
        "allow_parameter_qos_overrides", "always_reset_initial_pose", "autostart_node",
        "bond_heartbeat_period", "enable_stamped_cmd_vel", "footprint_topic", "introspection_mode",
        "node_namespace", "observation_sources", "odom_topic", "plugin_names", "plugin_types",
        "published_footprint_topic", "service_introspection_mode", "stamped_footprint",
        "transform_timeout", "unknown_threshold", "use_radius", "use_sim_time",
    },
}  # fmt: skip
"""Parameters of costmaps, and of nodes beside them, that some release reads."""


def listed_plugins(flavour: Flavour, values: Values, robot: RobotParameters | None) -> Plugins:
    if robot is not None:
        return tuple((listed.name, listed.plugin) for listed in robot.layers)

    lists = [values[key,].value for key in ("plugins", "filters") if (key,) in values]
    entries = [entry for items in lists if isinstance(items, list | tuple) for entry in items]
    if flavour == "ros1":
        mappings = [entry for entry in entries if isinstance(entry, dict)]
        return tuple((str(m.get("name", "")), str(m.get("type", ""))) for m in mappings)
    names = [entry for entry in entries if isinstance(entry, str)]
    classes = [values[name, "plugin"].value if (name, "plugin") in values else "" for name in names]
    return tuple(
        (name, kind if isinstance(kind, str) else "")
        for name, kind in zip(names, classes, strict=True)
    )


_UNUSUAL_LENGTHS = {
    "robot_radius": 10.0, "footprint": 10.0, "inflation_radius": 10.0, "footprint_padding": 1.0,
    "resolution": 2.0,
}  # fmt: skip
"""Parameters in metres, and the length from which the unit is doubtful."""


def label_of(flavour: Flavour, name: Name) -> str:
    return ("." if flavour == "nav2" else "/").join(name)


def closest_name(name: str, known: Collection[str]) -> str | None:
    if name in known or len(name) > _LONGEST_NAME:
        return None
    return next(iter(get_close_matches(name, known, n=1, cutoff=_LEAST_SIMILARITY)), None)


def misspelt_names(flavour: Flavour, values: Values, plugins: Plugins) -> Iterator[Problem]:
    """Yield misspelt parameters of a costmap, and of its layers that mapdeal computes."""
    known_names: dict[Name, frozenset[str]] = {(): _COSTMAP[flavour]}
    for name, plugin in plugins:
        if layer := layer_named(class_name(plugin)):
            known_names[name,] = layer.known_parameters(class_name(plugin))
    unknown = 0
    for (*section, name), value in values.items():
        known = known_names.get(tuple(section), frozenset({name}))
        if name in known or (unknown := unknown + 1) > MOST_NAMES:
            continue
        closest = closest_name(name, known)
        if closest and (*section, closest) not in values:
            label = label_of(flavour, (*section, name))
            text = f"no parameter is called {label}: did you mean {closest}?"
            yield Problem("params.misspelt", "warning", text, "", value.source, value.line)


def unusual_lengths(
    flavour: Flavour, values: Values, robot: RobotParameters | None
) -> Iterator[Problem]:
    """Yield lengths of a costmap and its layers that are likely to have another unit."""
    for path, value in values.items():
        limit = _UNUSUAL_LENGTHS.get(path[-1], math.inf) if len(path) <= 2 else math.inf
        length, part = value.value, ""
        if path == ("footprint",) and robot is not None and robot.robot_radius is None:
            length, part = robot.circumscribed_radius, " from the centre to a corner"
        if isinstance(length, int | float) and limit <= length < math.inf:
            unit = "centimetres" if length < 10 * limit else "millimetres"
            text = f"{length:.4g} m{part} is unusual; is it in {unit}?"
            place = label_of(flavour, path), value.source, value.line
            yield Problem("params.units", "warning", text, *place)
