"""Costmap parameters of Nav2, as its nodes take them.

References
----------
costmap_2d_ros.cpp and costmap_plugins.xml of nav2_costmap_2d;
``Costmap2DROS::init``, ``getParameters`` and ``setRobotFootprint`` of costmap_2d_ros.cpp;
rclcpp's declaration of parameters, which refuses values of another type.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from mapdeal import errors, records
from mapdeal.grid.frame import as_float32
from mapdeal.grid.values import few_text
from mapdeal.layers.catalogue import NAV2_PLUGINS
from mapdeal.layers.layer import PluginEntry
from mapdeal.layers.stack import CostmapArea
from mapdeal.ros import robot
from mapdeal.ros.robot import CostmapName, Level, ListedLayer, ParameterValue, Problem
from mapdeal.ros.ros2_files import Ros2Node, Ros2Parameters, matches, read_ros2

_ARTICLES = {
    "bool": "a bool", "integer": "an integer", "double": "a double", "string": "a string",
    "string_array": "a list of strings", "integer_array": "a list of integers",
    "double_array": "a list of doubles", "bool_array": "a list of bools",
}  # fmt: skip


class Nav2Values:
    def __init__(
        self, parameters: Mapping[str, ParameterValue], node: str, source: Path, *,
        up_to_kilted: bool,
    ) -> None:  # fmt: skip
        self.parameters, self.node, self.source = parameters, node, source
        self.up_to_kilted = up_to_kilted
        self.problems: list[Problem] = []
        self._known: set[str] = set()

    def flag(self, name: str, default: bool = False) -> bool:
        return bool(self.get(name, "bool", default))

    def get(self, name: str, kind: str, default: Any, *, level: Level = "refused") -> Any:
        # A value of another type is a problem; int and double are converted if that is exact.
        parameter = self.parameters.get(name)
        if parameter is None or parameter.kind == "not set":  # Nav2 never sees the latter
            return default
        if parameter.ignored is not None and name not in self._known:
            self._report_hidden(name, parameter, parameter.ignored)
        if parameter.replaced is not None:
            earlier, is_equal = parameter.replaced, parameter.value == parameter.replaced.value
            self.problem(*robot.repetition(earlier.line, parameter.line, is_equal=is_equal), name)
        if parameter.kind == kind:
            return parameter.value
        if name not in self._known:
            rule = f"must be {_ARTICLES[kind]}"
            if _is_substitution(parameter) and kind != "string":
                hint = robot.hint_on_launch("value")
                self.problem("params.substitution", level, rule, name, hint)
            else:
                text = f"{rule}, is {_ARTICLES[parameter.kind]}; Nav2 does not start"
                self.problem("params.type", level, text, name, _hint(kind, parameter))
        self._known.add(name)
        if kind == "double" and parameter.kind == "integer":
            return float(parameter.value)
        if kind == "integer" and parameter.kind == "double" and parameter.value.is_integer():
            return int(parameter.value)
        return default

    def check_types(self, parameters: Mapping[str, str], prefix: str = "") -> None:
        """Report wrong types of unused parameters, because these stop the node, too."""
        for name, kind in parameters.items():
            if not (self.up_to_kilted and name in _NEWER_PARAMETERS):
                self.get(prefix + name, kind, None)

    def number(self, name: str, default: float, *, least: float = -math.inf) -> float:
        """Return a double; report it and return the default if it is not finite or too small."""
        value = float(self.get(name, "double", default))
        if math.isfinite(value) and value >= least:
            return value
        check, rule = "params.not-positive", f"must not be below {least:g}"
        if not math.isfinite(value):
            check, rule = "params.not-finite", "must be finite"
        text = f"{rule}; the node accepts it, and the costs are meaningless"
        self.problem(check, "refused", text, name)
        return default

    def problem(
        self, check: str, level: Level, text: str, name: str = "", hint: str | None = None
    ) -> None:
        value = self.parameters.get(name)
        problem = Problem(check, level, text, name, self.source, hint=hint)
        if value is not None:
            problem = records.replace(problem, source=value.source, line=value.line, got=value.text)
        if problem not in self.problems:
            self.problems.append(problem)

    def _report_hidden(self, name: str, used: ParameterValue, ignored: ParameterValue) -> None:
        self._known.add(name)
        used_type, ignored_type = _ARTICLES[used.kind], _ARTICLES[ignored.kind]
        in_file = f" of {ignored.source.name}" if ignored.source != used.source else ""
        text = f"{used_type} counts, and not {ignored_type} that is set later, {ignored.text} on "
        text += f"line {ignored.line}{in_file}: ROS 2 selects by type"
        hint = f"remove one of them, or write both as {ignored_type}"
        self.problem("params.hidden", "warning", text, name, hint)


def _is_substitution(parameter: ParameterValue) -> bool:
    text = parameter.value if parameter.kind == "string" else ""
    is_name = text.isidentifier() and text.isupper() and "_" in text  # nav2_bringup's own form
    return "$(" in text or (text.startswith("<") and ">" in text) or is_name


def _hint(kind: str, value: ParameterValue) -> str | None:
    if kind == "double" and value.kind == "integer":
        return f"write {value.value}.0"
    if kind == "integer" and value.kind == "double":
        is_whole = abs(value.value) < 1 << 31 and value.value.is_integer()
        return f"write {int(value.value)}" if is_whole else "write a whole number"
    if kind == "string":
        return f'write "{value.text}"' if '"' not in value.text else "put it in quotes"
    if kind == "bool":
        return "write true or false, without quotes"
    if kind == "string_array" and value.kind == "string":
        return f'write ["{value.value}"]' if '"' not in value.value else "put it in brackets"
    if kind in ("double", "integer") and value.kind == "string":
        return "write a number, without quotes or a unit"
    return None


_PREFIX = "nav2_costmap_2d::"
_STATIC = _PREFIX + "StaticLayer"
_COSTLESS_FILTERS = {
    _PREFIX + "SpeedFilter": "limits the speed, and sets no costs",
    _PREFIX + "BinaryFilter": "switches a topic, and sets no costs",
    _PREFIX + "ZoneParameterFilter": "changes parameters, and sets no costs",
}
_FILTERS = (_PREFIX + "KeepoutFilter", *_COSTLESS_FILTERS)
_KNOWN_CLASSES = (*NAV2_PLUGINS, *_COSTLESS_FILTERS, _PREFIX + "PluginContainerLayer")
_MOST_LAYERS, _MOST_LISTED = 200, 8

# The layers of a costmap without a list of plugins.
_DEFAULTS = {
    "static_layer": _STATIC,
    "obstacle_layer": _PREFIX + "ObstacleLayer",
    "inflation_layer": _PREFIX + "InflationLayer",
}
_NEWER_PARAMETERS = frozenset(
    {"inscribed_obstacle_cost_value", "subscribe_to_stamped_footprint",
     "footprint_clearing_enabled", "restore_cleared_footprint"}
)  # fmt: skip


def _listed_layers(values: Nav2Values, inscribed: float) -> tuple[ListedLayer, ...] | None:
    """Return the layers in the order of the file, then the filters; None if a class is missing."""
    names = tuple(values.get("plugins", "string_array", tuple(_DEFAULTS)))
    filters = tuple(values.get("filters", "string_array", ()))
    defaults = _DEFAULTS if names == tuple(_DEFAULTS) else {}
    if len(names) + len(filters) > _MOST_LAYERS:
        text = f"more than {_MOST_LAYERS} layers and filters"
        values.problem("params.plugins", "refused", text, "plugins")
        return None
    found = [(name, _class_of(values, name, defaults.get(name))) for name in (*names, *filters)]
    kinds = [(name, kind) for name, kind in found if kind is not None]
    if len(kinds) < len(found):
        return None
    layers = tuple(
        records.replace(_layer(values, name, kind, inscribed), is_filter=index >= len(names))
        for index, (name, kind) in enumerate(kinds)
    )
    default_topic = values.get("map_topic", "string", "map")
    statics = [entry.name for entry in layers if entry.plugin == _STATIC and entry.is_enabled]
    parameters = [f"{name}.map_topic" for name in statics]
    topics = [values.get(parameter, "string", "") or default_topic for parameter in parameters]
    named = zip(parameters, (topic.lstrip("/") for topic in topics), strict=True)
    for parameter, text in robot.other_maps(named):
        values.problem("params.other-map", "warning", text, parameter)
    return layers


def _class_of(values: Nav2Values, name: str, default: str | None) -> str | None:
    """Return a plugin's class, corrected if it is misspelt; None if it is missing."""
    parameter = f"{name}.plugin"
    kind: str | None = values.get(parameter, "string", default)
    if kind is None and parameter not in values.parameters:
        text = f"{name} is listed, but has no {parameter}; Nav2 does not start"
        classes = {plugin.removeprefix(_PREFIX).lower(): plugin for plugin in _KNOWN_CLASSES}
        plain_name = name.replace("_", "").lower()[: robot.LONGEST_CLASS_NAME]
        guess = classes[robot.most_alike(plain_name, list(classes), least=0.0) or ""]
        hint = f'write {name}: {{plugin: "{guess}"}}, or take it out of the list'
        place = "filters" if name in values.get("filters", "string_array", ()) else "plugins"
        values.problem("params.plugins", "refused", text, place, hint)
    if kind is None:
        return None
    if (suggested := robot.suggested_class(kind, _KNOWN_CLASSES, _PREFIX)) is not None:
        text = f"unknown class {kind[: robot.LONGEST_CLASS_NAME]}; Nav2 does not start"
        values.problem("params.plugins", "refused", text, parameter, f"did you mean {suggested}?")
    return suggested or kind


def _layer(values: Nav2Values, name: str, kind: str, inscribed: float) -> ListedLayer:
    layer_class = NAV2_PLUGINS.get(kind)
    # in nav2_bringup's file, "enabled" of a filter is a name that launch files substitute
    if layer_class is not None and kind not in _FILTERS:
        is_enabled = values.flag(f"{name}.enabled", True)
    else:
        found = values.parameters.get(f"{name}.enabled")
        is_enabled = found is None or found.value is not False
    if layer_class is not None:
        layer = layer_class.from_nav2(values, PluginEntry(name, kind, inscribed))
        sensing = layer_class.sensing_from_nav2(values, name)
        return ListedLayer(name, kind, layer, is_enabled, sensing=sensing)
    if is_enabled and kind not in _COSTLESS_FILTERS:
        text = f"{kind} is not modelled: its costs are left out"
        hint = None if kind in _KNOWN_CLASSES else robot.hint_on_class(kind, _PREFIX)
        values.problem("params.not-modelled", "warning", text, f"{name}.plugin", hint)
    why = _COSTLESS_FILTERS.get(kind, robot.NOT_MODELLED)
    return ListedLayer(name, kind, None, is_enabled, why_ignored=why)


_LARGEST = 1000.0  # metres from the centre to a corner; the limit of all footprints in mapdeal
DECLARED = {
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
# Parameters of costmaps that other nodes of Nav2 declare, too.
_SHARED = ("global_frame", "map_topic", "resolution", "robot_base_frame", "transform_tolerance")
_LONGEST_NAMESPACE = 245  # characters of a node's namespace in ROS 2, including the slash


def nav2_robot(
    paths: Sequence[Path], *, costmap: CostmapName = "global", namespace: str | None = None,
    up_to_kilted: bool = False,
) -> tuple[robot.RobotParameters | None, tuple[Problem, ...]]:  # fmt: skip
    try:
        parameters = read_ros2(paths)
    except errors.MalformedInputError as error:
        return None, (robot.syntax_problem(error, Path(error.source or paths[0])),)
    return robot_in(parameters, costmap=costmap, namespace=namespace, up_to_kilted=up_to_kilted)


def robot_in(
    parameters: Ros2Parameters, *, costmap: CostmapName = "global", namespace: str | None = None,
    up_to_kilted: bool = False, overrides: Mapping[str, ParameterValue] | None = None,
) -> tuple[robot.RobotParameters | None, tuple[Problem, ...]]:  # fmt: skip
    node, problems = _node_of(parameters, costmap, namespace)
    if node is None:
        return None, problems
    own_values = {**parameters.for_node(node), **(overrides or {})}
    values = Nav2Values(own_values, node, parameters.files[-1].path, up_to_kilted=up_to_kilted)
    values.problems += (*problems, *_single_level_nodes(parameters, node, "warning"))
    rule = "ROS 2 does not support aliases"
    text = f"{rule}; nav2_bringup's launch files write the value in its place"
    hint = "other launch files need the value itself"
    values.problems += [
        Problem("params.alias", "warning", text, "", *alias, hint) for alias in parameters.aliases
    ]
    _warn_of_old_plugins(values)
    for name, value in parameters.unset_for(node):
        text = "has no value, and every node that it is for exits"
        hint = "an empty list has no type in ROS 2; take the parameter out"
        place = value.source, value.line, value.text
        values.problems.append(Problem("params.empty", "refused", text, name, *place, hint))
    return _resolved(values, parameters, costmap), tuple(values.problems)


def _warn_of_old_plugins(values: Nav2Values) -> None:
    for listed, effect in (
        ("plugins", f"the default layers run, {', '.join(_DEFAULTS)}"),
        ("filters", "no filter runs"),
    ):
        mappings = [name for name in values.parameters if name.startswith(f"{listed}.")]
        pairs = [name for name in ("plugin_names", "plugin_types") if name in values.parameters]
        if listed in values.parameters or not (mappings or (pairs and listed == "plugins")):
            continue
        form = f"{listed}, a list of mappings as in ROS 1" if mappings else " and ".join(pairs)
        found = values.parameters[(mappings or pairs)[0]]
        text = f"Nav2 does not read {form}: {effect}"
        place = found.source, found.line
        hint = f'write {listed}: ["NAME", ...], and NAME: {{plugin: "CLASS"}} for each'
        problem = Problem("params.old-plugins", "warning", text, "", *place, hint=hint)
        values.problems.append(problem)


def _resolved(
    values: Nav2Values, parameters: Ros2Parameters, costmap: CostmapName
) -> robot.RobotParameters | None:
    values.check_types(DECLARED)
    # Sizes with which the node fails to configure are reported even if a map overrides them.
    for name in ("width", "height"):
        if values.get(name, "integer", 5) <= 0:
            text = "must be above 0; Nav2 does not start"
            values.problem("params.not-positive", "refused", text, name)
    resolution = values.get("resolution", "double", 0.1)
    has_cells = math.isfinite(resolution) and resolution > 0
    if not (values.up_to_kilted or has_cells):
        text = "must be a finite number above 0; Nav2 does not start"
        values.problem("params.not-positive", "refused", text, "resolution")
    padding = as_float32(values.number("footprint_padding", 0.01))
    radius, corners = _outline(values)
    padded = robot.padded_corners(corners, padding)
    if not max(abs(v) for corner in padded for v in corner) <= _LARGEST:
        name = "footprint" if radius is None else "robot_radius"
        text = f"must be within {_LARGEST:g} m of the robot's centre, padding included"
        values.problem("params.too-large", "refused", text, name)
        return None
    shape = robot.shape_of(corners, padding, radius, partial(values.problem, name="footprint"))
    layers = None if shape is None else _listed_layers(values, shape.inscribed_radius)
    if shape is None or layers is None:
        return None
    for name, text in robot.erasing_layers(layers):
        values.problem("params.erases-map", "warning", text, f"{name}.combination_method")
    layers = _with_static(values, layers, costmap)
    area = _area(values, resolution) if has_cells else None
    return robot.RobotParameters(
        **vars(shape), flavour="nav2", costmap=costmap, node=values.node, layers=layers,
        files=parameters.files, track_unknown_space=values.flag("track_unknown_space"),
        area=area, rolling_window=area is not None and area.is_rolling,
        base_frame=values.get("robot_base_frame", "string", "base_link").lstrip("/"),
    )  # fmt: skip


def _area(values: Nav2Values, resolution: float) -> CostmapArea:
    sides = [values.get(side, "integer", 5) for side in ("height", "width")]
    height, width = (int(side / resolution) for side in sides)
    return CostmapArea(
        height, width, resolution,
        (values.number("origin_x", 0.0), values.number("origin_y", 0.0)),
        is_rolling=values.flag("rolling_window"),
        size_margin=0.5 if values.up_to_kilted else 0.0,
        global_frame=values.get("global_frame", "string", "map"),
    )  # fmt: skip


def _outline(values: Nav2Values) -> tuple[float | None, robot.Corners]:
    text = values.get("footprint", "string", "[]")
    if text not in ("", "[]"):
        try:
            return None, robot.corners_of_string(text)
        except robot.FootprintStringError as error:
            if "$(" in text or text.startswith("<"):
                rule, hint = "must be a list of points", robot.hint_on_launch("points")
                values.problem("params.substitution", "refused", rule, "footprint", hint)
            else:
                name = "robot_radius" if "robot_radius" in values.parameters else "a radius"
                used = f"{name} of {values.get('robot_radius', 'double', 0.1):g} m"
                rule = f"{error}; Nav2 uses {used} in its place"
                hint = 'write "[[x1, y1], [x2, y2], [x3, y3], ...]", metres'
                values.problem("params.footprint-unused", "warning", rule, "footprint", hint)
    elif "robot_radius" not in values.parameters:
        rule = "neither footprint nor robot_radius is set; Nav2 uses a radius of 0.1 m"
        values.problem("params.no-shape", "warning", rule, hint="set one of them")
    radius = values.number("robot_radius", 0.1)
    if radius <= 0:
        effect = "accepts it, and the robot has no size" if radius == 0 else f"uses {-radius:g} m"
        values.problem("params.range", "warning", f"must be above 0; Nav2 {effect}", "robot_radius")
    return radius, robot.sixteen_corners(radius)


def _with_static(
    values: Nav2Values, layers: tuple[ListedLayer, ...], costmap: CostmapName
) -> tuple[ListedLayer, ...]:
    statics = [listed for listed in layers if listed.plugin == _STATIC]
    if not statics and costmap == "local":
        static = NAV2_PLUGINS[_STATIC].from_nav2(values, PluginEntry(robot.INJECTED, _STATIC, 0.0))
        return (ListedLayer(robot.INJECTED, _STATIC, static), *layers)
    if not any(listed.is_enabled for listed in statics):
        value = "255, unknown" if values.flag("track_unknown_space") else "0, free"
        reason = "the static layer is switched off" if statics else "no static layer"
        text = f"{reason}: the costmap does not read the map, and all cells are {value}"
        name = f"{statics[0].name}.enabled" if statics else "plugins"
        hint = f'add a layer with plugin: "{_STATIC}"' if not statics else None
        values.problem("params.no-static-layer", "warning", text, name, hint)
    return layers


def _node_of(
    parameters: Ros2Parameters, costmap: CostmapName, namespace: str | None
) -> tuple[str | None, tuple[Problem, ...]]:
    costmap_node = f"{costmap}_costmap/{costmap}_costmap"
    source = parameters.files[-1].path
    spaces = _namespaces(parameters, costmap_node)
    requested = [part for part in (namespace or "").split("/") if part]
    node = "/".join(["", *requested, costmap_node])
    robots = [space for space in spaces if space]
    sibling = "local" if costmap == "global" else "global"
    sibling_spaces = _namespaces(parameters, f"{sibling}_costmap/{sibling}_costmap")
    matching = [entry.name for entry in parameters.nodes if _is_meant_for(entry, node)]
    # A wildcard applies to the robots that the file names. It defines neither another robot nor,
    # without the costmap's name, another costmap.
    is_only_wildcard = all("*" in name for name in matching)
    if is_only_wildcard and any(f"{costmap}_costmap" in name for name in matching):
        robots = robots or [space for space in sibling_spaces if space]
    if matching and (
        namespace is not None or not is_only_wildcard or not {*robots, *sibling_spaces} - {"", "*"}
    ):
        return node, ()
    check = "params.namespace"
    if namespace == "/":
        text = f"no parameters of {node}: it has Nav2's defaults"
        hint = f"--namespace {robots[0]} takes a robot of the file" if robots else None
        return node, (Problem("params.defaults", "warning", text, source=source, hint=hint),)
    if namespace is not None:
        known = few_text([space or "none" for space in spaces], _MOST_LISTED) or "none"
        text = f"no parameters of {node}; namespaces with such a node: {known}"
        hint = f"--namespace {spaces[0]}" if spaces and spaces[0] else None
        if spaces == [""]:
            hint = "omit --namespace: the file's nodes have none"
    elif len(robots) == 1:
        text = f"uses the namespace {robots[0]}, the only one with such a node"
        hint = f"--namespace {robots[0]} avoids this warning"
        problem = Problem("params.only-namespace", "warning", text, source=source, hint=hint)
        return f"/{robots[0]}/{costmap_node}", (problem,)
    elif robots:
        text = f"holds several robots, in the namespaces {few_text(robots, _MOST_LISTED)}"
        hint = f"choose one with --namespace {robots[0]}"
    else:
        if single_level := tuple(_single_level_nodes(parameters, node, "refused")):
            return None, single_level
        check = "params.no-node"
        names = few_text([entry.name for entry in parameters.nodes], _MOST_LISTED)
        text = f"holds no parameter of {node}; it has {names}"
        hint = f"pass the file that has {costmap}_costmap: {costmap}_costmap: ros__parameters:"
        if sibling_spaces:
            hint = f"--costmap {sibling} selects the costmap that the files have"
    return None, (Problem(check, "refused", text, source=source, hint=hint),)


def _single_level_nodes(parameters: Ros2Parameters, node: str, level: Level) -> Iterator[Problem]:
    """Yield a problem for each costmap that is not nested twice, as Nav2 names its node."""
    name = node.rpartition("/")[2]
    for entry in parameters.nodes:
        parent, _, last = entry.name.rpartition("/")
        if last == name and parent.rpartition("/")[2] not in (name, "*", "**"):
            text = f"applies to no node: Nav2's costmap is {node}, not {entry.name}"
            hint = f"nest the name twice: {name}: {name}: ros__parameters:"
            yield Problem("params.one-level", level, text, "", entry.source, entry.line, None, hint)


def _is_meant_for(entry: Ros2Node, node: str) -> bool:
    """Return whether an entry is for the node by its name, or by parameters of costmaps only."""
    is_named = node.rpartition("/")[2] in entry.name.split("/")
    parameters = (name for name, _ in entry.entries)
    return matches(entry.name, node) and (is_named or any(map(_is_only_of_costmaps, parameters)))


def _is_only_of_costmaps(name: str) -> bool:
    first, dot, _ = name.partition(".")
    return first in _DEFAULTS if dot else name in DECLARED and name not in _SHARED


def _namespaces(parameters: Ros2Parameters, costmap_node: str) -> list[str]:
    """Return the namespaces in which files name the node, in file order; * is a wildcard."""
    found: dict[str, None] = {}
    for entry in parameters.nodes:
        parts = entry.name.split("/")[1:]
        end = parts.index("**") if "**" in parts else len(parts)
        for count in range(max(end - 2, 0), end + 1):  # the node's own name has two parts
            space = "/".join(parts[:count])
            node = f"{space and '/'}{space}/{costmap_node}"
            if len(space) < _LONGEST_NAMESPACE and _is_meant_for(entry, node):
                found[space] = None
    return list(found)
