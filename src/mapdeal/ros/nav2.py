"""Costmap parameters of Nav2, as its nodes take them.

References
----------
costmap_2d_ros.cpp, static_layer.cpp, inflation_layer.cpp, legacy_inflation_layer.cpp,
asymmetric_inflation_layer.cpp and costmap_plugins.xml of nav2_costmap_2d;
``Costmap2DROS::init``, ``getParameters`` and ``setRobotFootprint`` of costmap_2d_ros.cpp;
rclcpp's declaration of parameters, which refuses values of another type.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

from mapdeal.errors import MalformedInputError
from mapdeal.grid.costmap import InflationLayer, StaticLayer
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import as_float32
from mapdeal.ros.robot import (
    MOST_CORNERS,
    Corners,
    CostmapName,
    FootprintStringError,
    ListedLayer,
    ParameterFile,
    RobotParameters,
    corners_of_string,
    oddities_of,
    padded_corners,
    radii_of,
    sixteen_corners,
    up_to_millimetres,
)
from mapdeal.ros.ros2_files import Ros2Node, Ros2Parameters, matches, read_ros2
from mapdeal.ros.values import Level, ParameterFileError, ParameterValue, Problem

_ARTICLES = {
    "bool": "a bool", "integer": "an integer", "double": "a double", "string": "a string",
    "string_array": "a list of strings", "integer_array": "a list of integers",
    "double_array": "a list of doubles", "bool_array": "a list of bools",
    "byte_array": "a list of bytes",
}  # fmt: skip


class Nav2Values:
    """The parameters that a node gets, and all problems that were found in them."""

    def __init__(
        self, values: Mapping[str, ParameterValue], node: str, files: Sequence[Path]
    ) -> None:
        self.values, self.node = values, node
        self.source = files[-1]
        self.problems: list[Problem] = []
        self._known: set[str] = set()

    def has(self, name: str) -> bool:
        return name in self.values

    def get(self, name: str, kind: str, default: Any, *, level: Level = "refused") -> Any:
        """Return a declared parameter, or its default."""
        # A value of another type becomes a problem, and what it means is returned if that is clear.
        found = self.values.get(name)
        if found is None or found.kind == "not set":  # Nav2 never sees the latter
            return default
        if found.ignored is not None and name not in self._known:
            self._tell_ignored(name, found, found.ignored)
        if found.kind == kind:
            return found.value
        if name not in self._known:
            self._tell_type(name, kind, found, level)
        self._known.add(name)
        if kind == "double" and found.kind == "integer":
            return float(found.value)
        if kind == "integer" and found.kind == "double" and found.value.is_integer():
            return int(found.value)
        return default

    def number(self, name: str, default: float, *, least: float = -math.inf) -> float:
        """Return a declared double that is finite, and not below what costs are defined for."""
        value = float(self.get(name, "double", default))
        if not math.isfinite(value):
            text = "must be finite; the node accepts it, and the costs are meaningless"
            self.problem("params.not-finite", "refused", text, name)
            return default
        if value < least:
            text = (
                f"must not be below {least:g}; the node accepts it, and the costs are meaningless"
            )
            self.problem("params.not-positive", "refused", text, name)
            return default
        return value

    def problem(
        self, check: str, level: Level, text: str, name: str = "", hint: str | None = None
    ) -> None:
        """Keep a problem, with the place and the text of the parameter that it is about."""
        found = self.values.get(name)
        one = Problem(check, level, text, parameter=name, source=self.source, hint=hint)
        if found is not None:
            one = replace(one, source=found.source, line=found.line, got=found.text)
        if one not in self.problems:
            self.problems.append(one)

    def _tell_type(self, name: str, kind: str, found: ParameterValue, level: Level) -> None:
        wanted, given = _ARTICLES[kind], _ARTICLES[found.kind]
        if _is_substitution(found) and kind != "string":
            hint = "launch files replace it; pass the file that the node gets, or write the value"
            self.problem("params.substitution", level, f"must be {wanted}", name, hint)
            return
        end = "Nav2 does not start" if level == "refused" else "the real node does not start"
        check = "params.type" if level == "refused" else "params.sensor-type"
        text = f"must be {wanted}, is {given}; {end}"
        self.problem(check, level, text, name, _hint(kind, found))

    def _tell_ignored(self, name: str, found: ParameterValue, ignored: ParameterValue) -> None:
        self._known.add(name)
        where = f"line {ignored.line}"
        if ignored.source != found.source:
            where += f" of {ignored.source.name}"
        text = (
            f"{_ARTICLES[found.kind]} counts, and not {_ARTICLES[ignored.kind]} that is set later, "
            f"{ignored.text} on {where}: ROS 2 goes by the type"
        )
        hint = f"remove one of them, or write both as {_ARTICLES[ignored.kind]}"
        self.problem("params.hidden", "warning", text, name, hint)


def _is_substitution(found: ParameterValue) -> bool:
    """Return whether a text is there for launch files to replace it."""
    text = found.value if found.kind == "string" else ""
    is_name = text.isidentifier() and text.isupper() and "_" in text  # nav2_bringup's own form
    return "$(" in text or (text.startswith("<") and ">" in text) or is_name


def _hint(kind: str, found: ParameterValue) -> str | None:
    """Return what to write in place of a value of another type."""
    if kind == "double" and found.kind == "integer":
        return f"write {found.value}.0"
    if kind == "integer" and found.kind == "double":
        is_whole = abs(found.value) < 1 << 31 and found.value.is_integer()
        return f"write {int(found.value)}" if is_whole else "write a whole number"
    if kind == "string":
        return f'write "{found.text}"' if '"' not in found.text else "put it in quotes"
    if kind == "bool":
        return "write true or false, without quotes"
    if kind == "string_array" and found.kind == "string":
        return f'write ["{found.value}"]' if '"' not in found.value else "put it in brackets"
    if kind in ("double", "integer") and found.kind == "string":
        return "write a number, without quotes or a unit"
    return None


_OWN = "nav2_costmap_2d::"
STATIC, INFLATION = _OWN + "StaticLayer", _OWN + "InflationLayer"
_LEGACY, _ASYMMETRIC = _OWN + "LegacyInflationLayer", _OWN + "AsymmetricInflationLayer"
_INFLATIONS = (INFLATION, _LEGACY, _ASYMMETRIC)
_OBSTACLE, _VOXEL, _RANGE = (
    _OWN + name for name in ("ObstacleLayer", "VoxelLayer", "RangeSensorLayer")
)
_CONTAINER = _OWN + "PluginContainerLayer"
_UNMODELLED = {
    _OWN + "DenoiseLayer": "removes small groups of obstacles",
    _CONTAINER: "contains layers of its own",
}
_FILTERS = tuple(
    _OWN + name for name in ("KeepoutFilter", "SpeedFilter", "BinaryFilter", "ZoneParameterFilter")
)
_LAYERS = (STATIC, *_INFLATIONS, _OBSTACLE, _VOXEL, _RANGE, *_UNMODELLED)
_MISSPELT = 0.95
"""As alike as this, a class is misspelt; below it is somebody's own."""

_LONGEST = 100
"""Characters of a name that are compared with names of classes."""
MOST_LAYERS = 200

_SENSORS = (
    "obstacle", "voxel", "range", "sonar", "cloud", "scan", "laser", "lidar", "camera", "depth",
    "segmentation", "semantic", "observation", "detection", "people", "person", "social",
    "proxemic", "dynamic", "tracking", "radar", "ultrasonic", "bumper", "cliff", "sensor", "ground",
)  # fmt: skip
"""Words in the names of layers that do nothing without live data."""

DEFAULT_PLUGINS = ("static_layer", "obstacle_layer", "inflation_layer")
_DEFAULT_CLASSES = (STATIC, _OBSTACLE, INFLATION)

_SENSOR_PARAMETERS = {
    "enabled": "bool", "footprint_clearing_enabled": "bool", "min_obstacle_height": "double",
    "max_obstacle_height": "double", "combination_method": "integer",
    "observation_sources": "string", "origin_z": "double", "z_resolution": "double",
    "z_voxels": "integer", "unknown_threshold": "integer", "mark_threshold": "integer",
    "publish_voxel_map": "bool",
}  # fmt: skip
_SOURCE_PARAMETERS = {
    "topic": "string", "sensor_frame": "string", "observation_persistence": "double",
    "expected_update_rate": "double", "data_type": "string", "min_obstacle_height": "double",
    "max_obstacle_height": "double", "inf_is_valid": "bool", "marking": "bool",
    "clearing": "bool", "obstacle_max_range": "double", "obstacle_min_range": "double",
    "raytrace_max_range": "double", "raytrace_min_range": "double",
}  # fmt: skip


def listed_layers(
    values: Nav2Values, inscribed_radius: float, *, older: bool
) -> tuple[ListedLayer, ...] | None:
    """Return all layers in their order, then the filters; None where one has no class."""
    names = tuple(values.get("plugins", "string_array", DEFAULT_PLUGINS))
    filters = tuple(values.get("filters", "string_array", ()))
    defaults = (
        dict(zip(DEFAULT_PLUGINS, _DEFAULT_CLASSES, strict=True))
        if names == DEFAULT_PLUGINS
        else {}
    )
    if len(names) + len(filters) > MOST_LAYERS:
        text = f"more than {MOST_LAYERS} layers and filters"
        values.problem("params.plugins", "refused", text, "plugins")
        return None
    classes = [_class_of(values, name, defaults.get(name)) for name in (*names, *filters)]
    if None in classes:
        return None
    found = []
    for index, (name, kind) in enumerate(zip((*names, *filters), classes, strict=True)):
        if index >= len(names):
            found.append(_filter(values, name, kind or ""))
        else:
            found.append(_layer(values, name, kind or "", inscribed_radius, older=older))
    _tell_topics(values, found)
    return tuple(found)


def _tell_topics(values: Nav2Values, layers: list[ListedLayer]) -> None:
    """Warn where static layers read different maps: there is one map, and all of them get it."""
    own_map = values.get("map_topic", "string", "map")
    first: str | None = None
    for one in layers:
        if not (isinstance(one.layer, StaticLayer) and one.is_enabled):
            continue
        parameter = f"{one.name}.map_topic"
        topic = (values.get(parameter, "string", "") or own_map).lstrip("/")
        if first is not None and topic != first:
            text = f"reads {topic}, another map than {first}; here it gets the same map"
            values.problem("params.other-map", "warning", text, parameter)
        first = first or topic


def static_layer(values: Nav2Values, name: str, *, older: bool) -> StaticLayer:
    lethal = values.get("lethal_cost_threshold", "integer", 100)
    clamped = max(min(lethal, 100), 0)
    if clamped != lethal:
        text = f"must be 0 .. 100; the static layer takes it for {clamped}"
        values.problem("params.range", "warning", text, "lethal_cost_threshold")
    inscribed = None
    if not older:
        inscribed = values.get("inscribed_obstacle_cost_value", "integer", 99) % 256
    return StaticLayer(
        name=name,
        track_unknown_space=values.get("track_unknown_space", "bool", False),
        lethal_cost_threshold=clamped,
        trinary_costmap=values.get("trinary_costmap", "bool", True),
        unknown_cost_value=values.get("unknown_cost_value", "integer", 255) % 256,
        inscribed_obstacle_cost_value=inscribed,
        use_maximum=values.get("use_maximum", "bool", False),
    )


def _class_of(values: Nav2Values, name: str, default: str | None) -> str | None:
    """Return the class of a layer or filter, or the one that is meant; None if none is given."""
    parameter = f"{name}.plugin"
    kind: str | None = values.get(parameter, "string", default)
    if kind is None:
        if not values.has(parameter):
            text = f"{name} is listed, but has no {parameter}; Nav2 does not start"
            hint = f'write {name}: {{plugin: "{_guess(name)}"}}, or take it out of the list'
            values.problem("params.plugins", "refused", text, _list_of(values, name), hint)
        return None
    meant = _meant_by(kind)
    if meant is not None:
        text = f"unknown class {kind[:_LONGEST]}; Nav2 does not start"
        values.problem("params.plugins", "refused", text, parameter, f"did you mean {meant}?")
    return meant or kind


def _list_of(values: Nav2Values, name: str) -> str:
    filters = values.get("filters", "string_array", ())
    return "filters" if name in filters else "plugins"


def _guess(name: str) -> str:
    wanted = name.replace("_", "").lower()
    likeness = {
        one: SequenceMatcher(None, one.removeprefix(_OWN).lower(), wanted[:_LONGEST]).ratio()
        for one in (STATIC, INFLATION, _OBSTACLE, _VOXEL, *_FILTERS)
    }
    return max(likeness, key=likeness.__getitem__)


def _meant_by(kind: str) -> str | None:
    """Return the class that is meant by one that pluginlib cannot load; None if it may."""
    known = (*_LAYERS, *_FILTERS)
    if kind in known:
        return None
    package, _, plain = kind.replace("::", "/").rpartition("/")
    own = _OWN + plain
    if own in known and package in ("nav2_costmap_2d", "costmap_2d", ""):
        return own  # a slash, ROS 1's package, or none
    likeness = {one: SequenceMatcher(None, one, kind[:_LONGEST]).ratio() for one in known}
    near = max(known, key=likeness.__getitem__)
    return near if likeness[near] >= _MISSPELT else None


def _layer(
    values: Nav2Values, name: str, kind: str, inscribed_radius: float, *, older: bool
) -> ListedLayer:
    if kind == STATIC:
        return _static(values, name, older=older)
    if kind in _INFLATIONS:
        layer = _inflation(values, name, kind, inscribed_radius, older=older or kind == _LEGACY)
        return ListedLayer(name, kind, layer, values.get(f"{name}.enabled", "bool", True))
    if kind in (_OBSTACLE, _VOXEL, _RANGE):
        is_enabled = _sensor(values, name)
        return ListedLayer(name, kind, None, is_enabled, why_ignored="reads sensors")
    return _foreign(values, name, kind)


def _static(values: Nav2Values, name: str, *, older: bool) -> ListedLayer:
    is_enabled = values.get(f"{name}.enabled", "bool", True)
    for parameter, kind in (
        ("subscribe_to_updates", "bool"), ("map_subscribe_transient_local", "bool"),
        ("footprint_clearing_enabled", "bool"), ("restore_cleared_footprint", "bool"),
        ("map_topic", "string"), ("transform_tolerance", "double"),
    ):  # fmt: skip
        if older and parameter in ("footprint_clearing_enabled", "restore_cleared_footprint"):
            continue
        values.get(f"{name}.{parameter}", kind, None)
    if not older and values.get(f"{name}.footprint_clearing_enabled", "bool", False):
        text = "frees the cells below the robot; that depends on where it is, and is left out"
        parameter = f"{name}.footprint_clearing_enabled"
        values.problem("params.footprint-clearing", "note", text, parameter)
    return ListedLayer(name, STATIC, static_layer(values, name, older=older), is_enabled)


def _inflation(
    values: Nav2Values, name: str, kind: str, inscribed_radius: float, *, older: bool
) -> InflationLayer:
    is_asymmetric = kind == _ASYMMETRIC
    radius = values.number(f"{name}.inflation_radius", 2.0 if is_asymmetric else 0.55)
    if is_asymmetric:
        factor = _factor_without_path(values, name)
    else:
        factor = values.number(f"{name}.cost_scaling_factor", 10.0, least=0.0)
    if not older:
        values.get(f"{name}.num_threads", "integer", -1)
    if not (older or is_asymmetric):
        custom = values.number(f"{name}.custom_inscribed_radius", -1.0)
        if custom >= 0.0:
            text = (
                f"takes the place of the footprint's own inscribed radius, {inscribed_radius:.4g} m"
            )
            hint = "unsafe unless all that reads the costmap is made for it; remove it"
            parameter = f"{name}.custom_inscribed_radius"
            values.problem("params.custom-inscribed-radius", "warning", text, parameter, hint)
            inscribed_radius = custom
    if radius < inscribed_radius:
        text = f"{radius:g} m is less than the inscribed radius, {inscribed_radius:.4g} m"
        hint = f"set it to {up_to_millimetres(inscribed_radius)} or more"
        values.problem("params.inflation-radius", "warning", text, f"{name}.inflation_radius", hint)
    return InflationLayer(
        name=name,
        inscribed_radius=inscribed_radius,
        inflation_radius=max(radius, 0.0),
        cost_scaling_factor=factor,
        inflate_unknown=values.get(f"{name}.inflate_unknown", "bool", False),
        inflate_around_unknown=values.get(f"{name}.inflate_around_unknown", "bool", False),
        lookup="exact" if older else "nav2",
    )


def _factor_without_path(values: Nav2Values, name: str) -> float:
    """Return the factor of both sides where there is no path: the larger one counts."""
    for parameter, kind, least in (
        (f"{name}.inflation_radius", "double", 0), (f"{name}.num_threads", "integer", -1),
        (f"{name}.cost_scaling_factor_left", "double", 0),
        (f"{name}.cost_scaling_factor_right", "double", 0),
        (f"{name}.goal_distance_threshold", "double", 0), ("transform_tolerance", "double", 0),
    ):  # fmt: skip
        if values.get(parameter, kind, least) < least:
            text = f"must not be below {least}; Nav2 does not start"
            values.problem("params.not-positive", "refused", text, parameter)
    values.get(f"{name}.plan_topic", "string", None)
    sides = {side: f"{name}.cost_scaling_factor_{side}" for side in ("left", "right")}
    factors = {side: values.number(parameter, 4.0) for side, parameter in sides.items()}
    wider = min(factors, key=factors.__getitem__)
    factor = max(factors.values())
    if factors[wider] < factor:
        text = (
            f"raises costs {wider} of the robot's path; here there is no path, and {factor:g} "
            "counts on both sides"
        )
        place = next(one for one in (sides[wider], *sides.values()) if values.has(one))
        values.problem("params.asymmetric", "note", text, place)
    return factor


def _sensor(values: Nav2Values, name: str) -> bool:
    """Return whether a layer of sensors is on; other types in it end the node all the same."""
    sources = set(values.get(f"{name}.observation_sources", "string", "", level="warning").split())
    for parameter in values.values:
        prefix, _, own = parameter.removeprefix(f"{name}.").rpartition(".")
        kinds = _SOURCE_PARAMETERS if prefix in sources else {} if prefix else _SENSOR_PARAMETERS
        if own in kinds and parameter.startswith(f"{name}."):
            values.get(parameter, kinds[own], None, level="warning")
    return bool(values.get(f"{name}.enabled", "bool", True, level="warning"))


def _foreign(values: Nav2Values, name: str, kind: str) -> ListedLayer:
    """Return a layer that is not modelled, and warn unless it needs live data."""
    is_enabled = _enabled_of_any(values, name)
    plain = kind.replace("::", "/").rpartition("/")[2].lower()
    if kind in _FILTERS:
        return _filter(values, name, kind, is_filter=False)
    if kind not in _UNMODELLED and any(word in plain for word in _SENSORS):
        return ListedLayer(name, kind, None, is_enabled, why_ignored="reads sensors")
    what = _UNMODELLED.get(kind, "a custom class")
    if kind == _CONTAINER and is_enabled:
        _tell_contents(values, name)
    if is_enabled:
        text = f"{kind} is not modelled, which changes the costs: {what}"
        values.problem("params.not-modelled", "warning", text, f"{name}.plugin")
    return ListedLayer(name, kind, None, is_enabled, why_ignored=f"not modelled: {what}")


def _tell_contents(values: Nav2Values, name: str) -> None:
    """Refuse a container whose layers make the costs: without them, hardly any are left."""
    for one in values.get(f"{name}.plugins", "string_array", ()):
        parameter = f"{name}.{one}.plugin"
        if values.get(parameter, "string", "") in (STATIC, *_INFLATIONS):
            text = f"stands in {name}, whose layers are not modelled; the costs are meaningless"
            hint = f"list {one} in plugins itself"
            values.problem("params.plugins", "refused", text, parameter, hint)


def _filter(values: Nav2Values, name: str, kind: str, *, is_filter: bool = True) -> ListedLayer:
    is_enabled = _enabled_of_any(values, name)
    why = "a filter without its mask"
    return ListedLayer(name, kind, None, is_enabled, is_filter=is_filter, why_ignored=why)


def _enabled_of_any(values: Nav2Values, name: str) -> bool:
    """Return whether a layer is on; nav2_bringup's own file leaves that of filters to launch."""
    found = values.values.get(f"{name}.enabled")
    return found is None or found.value is not False


_INJECTED = "injected_static"
_LARGEST = 1000.0
"""Metres that a corner may be away from the centre, as everywhere in mapdeal."""

_DECLARED = {
    "always_send_full_costmap": "bool", "map_vis_z": "double", "footprint": "string",
    "footprint_padding": "double", "global_frame": "string", "height": "integer",
    "width": "integer", "lethal_cost_threshold": "integer",
    "inscribed_obstacle_cost_value": "integer", "unknown_cost_value": "integer",
    "map_topic": "string", "origin_x": "double", "origin_y": "double",
    "plugins": "string_array", "filters": "string_array", "publish_frequency": "double",
    "resolution": "double", "robot_base_frame": "string", "robot_radius": "double",
    "rolling_window": "bool", "track_unknown_space": "bool", "transform_tolerance": "double",
    "initial_transform_timeout": "double", "trinary_costmap": "bool",
    "update_frequency": "double", "use_maximum": "bool",
    "subscribe_to_stamped_footprint": "bool",
}  # fmt: skip
_NEWER = frozenset({"inscribed_obstacle_cost_value", "subscribe_to_stamped_footprint"})
_OF_ANY_NODE = frozenset(
    {"global_frame", "map_topic", "resolution", "robot_base_frame", "transform_tolerance"}
)
"""Parameters of costmaps that other nodes of Nav2 declare, too."""
_LONGEST_NAMESPACE = 245
"""Characters with its slash that ROS 2 allows in the namespace of a node."""
_LIKE_THIS = 'write "[[x1, y1], [x2, y2], [x3, y3], ...]", metres'


def nav2_robot(
    paths: Sequence[Path],
    *,
    costmap: CostmapName = "global",
    namespace: str | None = None,
    older: bool = False,
) -> tuple[RobotParameters | None, tuple[Problem, ...]]:
    """Return what Nav2's parameter files say of a robot and one of its costmaps."""
    try:
        parameters = read_ros2(paths)
    except MalformedInputError as error:
        return None, (_of_error(error),)
    node, problems = _node_of(parameters, costmap, namespace)
    if node is None:
        return None, problems
    values = Nav2Values(parameters.for_node(node), node, paths)
    values.problems += (*problems, *_one_level(parameters, node, "warning"))
    _tell_unset(values, parameters)
    robot = _resolved(values, parameters, costmap, older=older)
    return robot, tuple(values.problems)


def _of_error(error: MalformedInputError) -> Problem:
    """Return the problem that a file's own parser has with it."""
    source = error.source if isinstance(error.source, Path) else None
    if isinstance(error, ParameterFileError):
        return Problem("params.syntax", "refused", error.rule, "", source, error.line, error.found,
                       error.hint)  # fmt: skip
    text = error.rule if error.place is None else f"{error.rule} ({error.place})"
    return Problem("params.syntax", "refused", text, source=source, hint=error.hint)


def _tell_unset(values: Nav2Values, parameters: Ros2Parameters) -> None:
    for name, value in parameters.unset_for(values.node):
        text = "has no value, and every node that it is for exits"
        hint = "an empty list has no type in ROS 2; take the parameter out"
        one = Problem(
            "params.empty", "refused", text, name, value.source, value.line, value.text, hint
        )
        values.problems.append(one)


def _resolved(
    values: Nav2Values, parameters: Ros2Parameters, costmap: CostmapName, *, older: bool
) -> RobotParameters | None:
    for name, kind in _DECLARED.items():
        if not (older and name in _NEWER):
            values.get(name, kind, None)
    _check_sizes(values, older=older)
    padding = as_float32(values.number("footprint_padding", 0.01))
    radius, corners = _shape(values)
    padded = padded_corners(corners, padding)
    if not max(abs(v) for corner in padded for v in corner) <= _LARGEST:
        name = "footprint" if radius is None else "robot_radius"
        text = f"must be within {_LARGEST:g} m of the robot's centre, padding included"
        values.problem("params.too-large", "refused", text, name)
        return None
    if len(padded) > MOST_CORNERS:
        text = f"must not have more than {MOST_CORNERS} points"
        values.problem("params.too-large", "refused", text, "footprint")
        return None
    for text in oddities_of(padded) if radius is None else ():
        values.problem(
            "params.outline", "warning", f"{text}; its radii are meaningless", "footprint"
        )
    inscribed, circumscribed = radii_of(padded)
    layers = listed_layers(values, inscribed, older=older)
    if layers is None:
        return None
    layers = _with_static(values, layers, costmap, older=older)
    track = values.get("track_unknown_space", "bool", False)
    return RobotParameters(
        flavour="nav2",
        costmap=costmap,
        node=values.node,
        footprint=Footprint(vertices=padded),
        footprint_padding=padding,
        robot_radius=radius,
        track_unknown_space=track,
        rolling_window=values.get("rolling_window", "bool", False),
        layers=layers,
        files=tuple(ParameterFile(path, sha256) for path, sha256 in parameters.files),
        inscribed_radius=inscribed,
        circumscribed_radius=circumscribed,
    )


def _check_sizes(values: Nav2Values, *, older: bool) -> None:
    """Report sizes with which the node does not configure; a map that is a file has its own."""
    for name in ("width", "height"):
        if values.get(name, "integer", 5) <= 0:
            text = "must be above 0; Nav2 does not start"
            values.problem("params.not-positive", "refused", text, name)
    resolution = values.get("resolution", "double", 0.1)
    if not older and not (math.isfinite(resolution) and resolution > 0):
        text = "must be a finite number above 0; Nav2 does not start"
        values.problem("params.not-positive", "refused", text, "resolution")


def _shape(values: Nav2Values) -> tuple[float | None, Corners]:
    """Return the radius, if it counts, and the corners: a valid footprint wins over a radius."""
    text = values.get("footprint", "string", "[]")
    if text not in ("", "[]"):
        try:
            corners = corners_of_string(text)
        except FootprintStringError as error:
            _tell_footprint(values, text, str(error))
        else:
            return None, corners
    elif not values.has("robot_radius"):
        rule = "neither footprint nor robot_radius is set; Nav2 uses a radius of 0.1 m"
        values.problem("params.no-shape", "warning", rule, hint="set one of them")
    radius = values.number("robot_radius", 0.1)
    if radius <= 0:
        rule = "must be above 0; Nav2 accepts it, and the robot has no size"
        if radius < 0:
            rule = f"must be above 0; Nav2 uses {-radius:g} m"
        values.problem("params.range", "warning", rule, "robot_radius")
    return radius, sixteen_corners(radius)


def _tell_footprint(values: Nav2Values, text: str, reason: str) -> None:
    if "$(" in text or text.startswith("<"):
        hint = "launch files replace it; pass the file that the node gets, or write the points"
        values.problem("params.substitution", "refused", "must be a list of points", "footprint",
                       hint)  # fmt: skip
        return
    radius = values.get("robot_radius", "double", 0.1)
    taken = "robot_radius" if values.has("robot_radius") else "a radius"
    rule = f"{reason}; Nav2 uses {taken} of {radius:g} m in its place"
    values.problem("params.footprint-unused", "warning", rule, "footprint", _LIKE_THIS)


def _with_static(
    values: Nav2Values, layers: tuple[ListedLayer, ...], costmap: CostmapName, *, older: bool
) -> tuple[ListedLayer, ...]:
    """Return the layers with one that reads the map in front, if a local costmap has none."""
    statics = [one for one in layers if isinstance(one.layer, StaticLayer)]
    if not statics and costmap == "local":
        injected = static_layer(values, _INJECTED, older=older)
        return (ListedLayer(_INJECTED, STATIC, injected), *layers)
    if not any(one.is_enabled for one in statics):
        value = "255, unknown" if values.get("track_unknown_space", "bool", False) else "0, free"
        what = "the static layer is switched off" if statics else "no static layer"
        text = f"{what}: the costmap does not read the map, and all cells are {value}"
        name = f"{statics[0].name}.enabled" if statics else "plugins"
        hint = f'add a layer with plugin: "{STATIC}"' if not statics else None
        values.problem("params.no-static-layer", "warning", text, name, hint)
    return layers


def _node_of(
    parameters: Ros2Parameters, costmap: CostmapName, namespace: str | None
) -> tuple[str | None, tuple[Problem, ...]]:
    """Return the full name of the node that is meant, and what there is to say of the choice."""
    own = f"{costmap}_costmap/{costmap}_costmap"
    source = parameters.files[-1][0]
    held = _namespaces(parameters, own)
    if namespace is not None:
        prefix = "/".join(part for part in namespace.split("/") if part)
        node = f"/{prefix}/{own}" if prefix else f"/{own}"
        if _is_meant(parameters, node):
            return node, ()
        names = _listed(held) or "none"
        text = f"no parameters of {node}; namespaces with such a node: {names}"
        hint = f"--namespace {held[0]}" if held and held[0] else None
        if held == [""]:
            hint = "leave --namespace out: the file's nodes are in none"
        return None, (Problem("params.namespace", "refused", text, source=source, hint=hint),)
    node = f"/{own}"
    if _is_meant(parameters, node):
        return node, ()
    others = [one for one in held if one]
    if len(others) == 1:
        text = f"its nodes are in the namespace {others[0]}, which is taken"
        hint = f"--namespace {others[0]} says so"
        one = Problem("params.only-namespace", "warning", text, source=source, hint=hint)
        return f"/{others[0]}/{own}", (one,)
    if others:
        text = f"holds several robots, in the namespaces {_listed(others)}"
        hint = f"choose one with --namespace {others[0]}"
        return None, (Problem("params.namespace", "refused", text, source=source, hint=hint),)
    flat = tuple(_one_level(parameters, node, "refused"))
    return None, flat or (_no_node(parameters, node, costmap, source),)


def _no_node(parameters: Ros2Parameters, node: str, costmap: CostmapName, source: Path) -> Problem:
    names = _listed(one.name for one in parameters.nodes)
    text = f"holds no parameter of {node}; it has {names}"
    other = "local" if costmap == "global" else "global"
    hint = f"pass the file that has {costmap}_costmap: {costmap}_costmap: ros__parameters:"
    if _namespaces(parameters, f"{other}_costmap/{other}_costmap"):
        hint = f"--costmap {other} takes the one that it has"
    return Problem("params.no-node", "refused", text, source=source, hint=hint)


def _one_level(parameters: Ros2Parameters, node: str, level: Level) -> Iterator[Problem]:
    """Yield a problem for each costmap outside of the namespace of its name, where Nav2 has it."""
    name = node.rpartition("/")[2]
    for one in parameters.nodes:
        above, _, last = one.name.rpartition("/")
        if last == name and above.rpartition("/")[2] not in (name, "*", "**"):
            text = f"applies to no node: Nav2's costmap is {node}, not {one.name}"
            hint = f"nest the name twice: {name}: {name}: ros__parameters:"
            yield Problem("params.one-level", level, text, "", one.source, one.line, None, hint)


def _is_meant(parameters: Ros2Parameters, node: str) -> bool:
    """Return whether files name a node, or set parameters of costmaps for any."""
    return any(_means(one, node) for one in parameters.nodes)


def _means(one: Ros2Node, node: str) -> bool:
    if not matches(one.name, node):
        return False
    is_named = node.rpartition("/")[2] in one.name.split("/")
    return is_named or any(_of_costmap(name) for name, _ in one.entries)


def _of_costmap(name: str) -> bool:
    """Return whether a parameter that is set for any node can only be meant for a costmap."""
    first, dot, _ = name.partition(".")
    return first in DEFAULT_PLUGINS if dot else name in _DECLARED and name not in _OF_ANY_NODE


def _namespaces(parameters: Ros2Parameters, own: str) -> list[str]:
    """Return the namespaces in which files have the node, in their order; a * stands for any."""
    found: dict[str, None] = {}
    for one in parameters.nodes:
        parts = one.name.split("/")[1:]
        end = parts.index("**") if "**" in parts else len(parts)
        for count in range(max(end - 2, 0), end + 1):  # the node's own name has two parts
            space = "/".join(parts[:count])
            if len(space) < _LONGEST_NAMESPACE and _means(one, f"{space and '/'}{space}/{own}"):
                found[space] = None
    return list(found)


def _listed(names: Iterable[str], most: int = 8) -> str:
    names = [name or "none" for name in names]
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
