"""Nav2's parameter files as nav2_costmap_2d's main branch resolves them.

References
----------
``Costmap2DROS::init``, ``getParameters`` and ``setRobotFootprint`` of costmap_2d_ros.cpp;
rclcpp's declaration of parameters, which refuses values of another type.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from mapdeal.errors import MalformedInputError
from mapdeal.formats.ros_parameters.problem import Level, Problem
from mapdeal.formats.ros_parameters.ros2 import Ros2Node, Ros2Parameters, matches, read_ros2
from mapdeal.formats.ros_parameters.value import ParameterFileError
from mapdeal.grid.coordinates import as_float32
from mapdeal.grid.costmap_layers import StaticLayer
from mapdeal.grid.footprint import Footprint
from mapdeal.robot.footprints import (
    MOST_CORNERS,
    Corners,
    FootprintStringError,
    corners_of_string,
    oddities_of,
    padded_corners,
    radii_of,
    sixteen_corners,
)
from mapdeal.robot.nav2_layers import DEFAULT_PLUGINS, STATIC, listed_layers, static_layer
from mapdeal.robot.nav2_values import Nav2Values
from mapdeal.robot.parameters import CostmapName, ListedLayer, ParameterFile, RobotParameters

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
