"""Checks of a robot's parameter files.

References
----------
navigation, branch noetic-devel: ``costmap_2d_ros.cpp``, ``static_layer.cpp``,
``inflation_layer.cpp``, ``obstacle_layer.cpp``, ``voxel_layer.cpp`` and the files below ``cfg``;
navigation2, branches humble to main: the same of ``nav2_costmap_2d``.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from mapdeal import errors, records
from mapdeal.checks.facts import FilterFacts, PlannerFacts, RobotFacts, check
from mapdeal.checks.findings import CHECKS, Finding, Remark, declare_checks, findings_on
from mapdeal.checks.plugin_checks import planner_facts
from mapdeal.grid.frame import Frame
from mapdeal.grid.values import NO_INFORMATION, few_text
from mapdeal.layers.catalogue import NAV2_PLUGINS, class_name, layer_named
from mapdeal.layers.inflation import InflationLayer
from mapdeal.ros import filters, load, planners, ros2_files
from mapdeal.ros.robot import INJECTED, CostmapName, Flavour, Problem, RobotParameters

INFLATION_PARAMETERS = {"inflation_radius", "cost_scaling_factor", "inflate_unknown"}
"""Parameters of inflation layers; Nav2's layers do not inherit them from the costmap."""
_OF_MAP_LAYERS = {"enabled", "plugin", "map_subscribe_transient_local", "map_topic"}
LAYER_PARAMETERS = INFLATION_PARAMETERS | _OF_MAP_LAYERS | {"observation_sources"}
"""Parameters that identify a section as a layer."""
IDLE_LAYER_PARAMETERS = _OF_MAP_LAYERS | {"subscribe_to_updates"}
"""Parameters of a layer that may be unlisted without a finding, because it would do nothing."""
_CLASSES = tuple(map(class_name, NAV2_PLUGINS))
_MODELLED = tuple(name for name in _CLASSES if name.endswith(("StaticLayer", "InflationLayer")))
_SHAPE_PARAMETERS = dict.fromkeys(("footprint", "robot_radius", "footprint_padding"), _MODELLED)
COSTMAP_ONLY: dict[Flavour, dict[str, tuple[str, ...]]] = {
    "ros1": _SHAPE_PARAMETERS,
    "nav2": _SHAPE_PARAMETERS
    | {
        parameter: (class_name(plugin),)
        for plugin, layer in NAV2_PLUGINS.items()
        for parameter in layer.costmap_parameters
    },
}
"""Parameters of a costmap that have no effect below layers of these classes."""
OLD_PARAMETERS = ("static_map", "map_type")  # ROS 1 reads them only without a list of plugins
_OTHER_MARKING = ("NonPersistentVoxelLayer", "SpatioTemporalVoxelLayer")
"""Layer classes that write lethal cells and that mapdeal does not model."""


@check("params.layer-after-inflation", "warning")
def layer_after_inflation(facts: RobotFacts) -> Iterator[Remark]:
    """A layer that writes obstacles after the inflation layer: they are not inflated.
    Planners lead the robot's centre right beside these obstacles, so that its sides hit them.
    Example: `plugins: [static_layer, inflation_layer, obstacle_layer]`.
    Fix: List the inflation layer last.
    """
    inflation = None
    for listed in (item for item in facts.robot.layers if item.is_enabled and not item.is_filter):
        name = class_name(listed.plugin)
        layer_class = layer_named(name)
        marks = layer_class.marks_obstacles if layer_class else name in _OTHER_MARKING
        if layer_class is not None and layer_class.spreads:
            inflation = listed.name
        elif inflation is not None and marks:
            overwrites = listed.layer is not None and listed.layer.overwrites_all
            effect = "it overwrites the costs" if overwrites else "its obstacles are not inflated"
            text = f"{listed.name} comes after {inflation}: {effect}; list {inflation} last"
            yield Remark(text, at=facts.value("plugins"))


@check("params.two-inflations", "warning")
def two_inflations(facts: RobotFacts) -> Iterator[Remark]:
    """Two inflation layers that are both switched on.
    Each cell has the higher of two costs, so changing one layer may have no effect on paths.
    Example: `{plugins: [static_layer, inflation_layer, wide], wide: {plugin:
    "nav2_costmap_2d::InflationLayer"}}`.
    Fix: Remove one of them.
    """
    names = [layer.name for layer in facts.robot.inflation_layers]
    if len(set(names)) > 1:
        text = f"{' and '.join(names)} both inflate: a cell gets the higher of their costs"
        yield Remark(text, at=facts.value("plugins"))


@check("params.layer-disabled", "note")
def layer_disabled(facts: RobotFacts) -> Iterator[Remark]:
    """A listed layer that is switched off.
    What the layer would add, such as obstacles, is not in the costmap: it is not avoided.
    Example: `obstacle_layer: {enabled: false}`.
    Fix: Set enabled: true, or remove it from plugins.
    """
    for listed in facts.robot.layers:
        is_inflation = listed.layer is not None and listed.layer.spreads
        is_last = is_inflation and not facts.robot.inflation_layers
        if not listed.is_enabled and not is_last:  # params.no-inflation reports the last one
            text = f"{listed.name} is switched off and adds no costs; set it to true, or unlist it"
            yield Remark(text, at=facts.value(listed.name, "enabled"))


@check("params.mask-unused", "warning")
def mask_unused(facts: RobotFacts) -> Iterator[Remark]:
    """A keepout filter whose mask has no effect on the costs.
    The robot drives through keepout zones.
    Example: A `KeepoutFilter` listed before a layer that replaces all costs.
    Fix: List the filter last, below filters.
    """
    # params.layer-disabled reports filters that are switched off.
    reason = facts.robot.why_mask_unused
    if reason is not None and facts.robot.has_keepout_filter:
        yield Remark(f"the keepout mask has no effect: {reason}", at=facts.value("plugins"))


@check("params.plugin-twice", "warning")
def plugin_twice(facts: load.ParameterFacts) -> Iterator[Remark]:
    """A layer that is listed twice.
    Nav2 or ROS 1 loads it twice or fails at the second; costs may count an obstacle twice.
    Example: `plugins: [static_layer, inflation_layer, inflation_layer]`.
    Fix: Remove one of the two names.
    """
    for name, count in Counter(name for name, _ in facts.plugins).items():
        if count > 1:
            text = f"{name} is listed {count} times; remove it once"
            yield Remark(text, at=facts.values.get(("plugins",)))


@check("params.unused-section", "note")
def unused_section(facts: load.ParameterFacts) -> Iterator[Remark]:
    """Parameters of a layer that the list of plugins does not name.
    The layer does not exist on the robot: its obstacles are not avoided.
    Example: `obstacle_layers: {plugin: "nav2_costmap_2d::ObstacleLayer", observation_sources:
    scan}`.
    Fix: Add its name to plugins, or remove the section.
    """
    # ROS 1 files may hold layers of both costmaps; Nav2's example has an unused local static layer.
    listed_names = {name for name, _ in facts.plugins} | set(_nested_names(facts))
    for name, section in facts.sections.items():
        names = {path[1] for path in section}
        if name in listed_names or names.isdisjoint(LAYER_PARAMETERS):
            continue
        closest = load.closest_name(name, listed_names)
        if not closest and (facts.flavour == "ros1" or names <= IDLE_LAYER_PARAMETERS):
            continue
        text = f"{name} is not in the list of plugins: its parameters have no effect"
        hint = f"; did you mean {closest}?" if closest else ""
        yield Remark(text + hint, at=next(iter(section.values())))


def _nested_names(facts: load.ParameterFacts) -> Iterator[str]:
    """Yield the names in the lists of container layers and of observation sources."""
    for path, value in facts.values.items():
        if len(path) == 2 and path[1] in ("plugins", "observation_sources"):
            if isinstance(value.value, str):
                yield from value.value.split()
            elif isinstance(value.value, list | tuple):
                yield from (name for name in value.value if isinstance(name, str))


@check("params.misplaced", "warning")
def misplaced(facts: load.ParameterFacts) -> Iterator[Remark]:
    """A parameter at a level where it has no effect.
    The default applies: an inflation radius at the wrong level leaves the robot with 0.55 m.
    Example: `inflation_radius: 0.9`.
    Fix: Move it to where the message says.
    """
    inflations = [name for name, kind in facts.plugins if kind.endswith("InflationLayer")]
    for path, value in facts.values.items():
        if facts.flavour == "nav2" and len(path) == 1 and path[0] in INFLATION_PARAMETERS:
            where = f"it belongs below {inflations[0]}" if inflations else "no layer takes it"
            yield Remark(f"{path[0]} has no effect here: {where}", at=value)
        if len(path) == 2 and path[1] in COSTMAP_ONLY[facts.flavour]:
            classes = COSTMAP_ONLY[facts.flavour][path[1]]
            if any(name == path[0] and class_name(kind) in classes for name, kind in facts.plugins):
                text = f"{facts.label(*path)} has no effect: it is a parameter of the costmap"
                yield Remark(text, at=value)


@check("params.without-effect", "note")
def without_effect(facts: load.ParameterFacts) -> Iterator[Remark]:
    """ROS 1 parameters without effect beside a list of plugins.
    The layers are those of plugins: `static_map: true` does not add the map to the costmap.
    Example: ROS 1: `static_map: true`.
    Fix: Remove it, and list the layer in plugins.
    """
    has_list = facts.flavour == "ros1" and ("plugins",) in facts.values
    for name in OLD_PARAMETERS if has_list else ():
        if value := facts.values.get((name,)):
            yield Remark(f"{name} has no effect: the layers are those of plugins", at=value)


declare_checks(
    """
    params.syntax (error)
        A parameter file that ROS cannot read.
        The node does not start, and the robot stays where it is.
        Example: A tab before a key.
        Fix: Correct the line that the message names.
    params.alias (warning)
        An alias in a Nav2 file, which only nav2_bringup's launch files replace.
        Nodes that get the file from another launch file do not start.
        Example: `{robot_radius: &r 0.2, footprint_padding: *r}`.
        Fix: Write the value in the place of the alias.
    params.other-kind (error)
        A file of another kind, such as a map or a recipe.
        It holds no parameters, so nothing about the robot was checked.
        Example: `mapdeal lint --params-file office.yaml`.
        Fix: Name the robot's parameter file.
    params.empty (error)
        A parameter without a value: roslaunch exits.
        The launch ends with an error and the robot does not start.
        Example: ROS 1: `robot_radius: `.
        Fix: Write a value, or remove the line.
    params.name (error)
        A name that is not text.
        roslaunch cannot send it and exits.
        Example: ROS 1: `1: 0.3`.
        Fix: Put the name in quotes.
    params.type (error)
        A value of a type that ROS refuses.
        The node throws an exception at start, and the robot has no costmap.
        Example: `inflation_layer: {inflation_radius: 1}`.
        Fix: Write the type that the message names: 1.0.
    params.silent-default (warning)
        A value of a wrong type: ROS 1 silently takes the default, or rounds a number.
        The robot runs with another value than the file shows.
        Example: ROS 1: `robot_radius: "0.3"`.
        Fix: Write the type that the message names.
    params.not-finite (error)
        A number that is not finite.
        Costs become meaningless: walls may not be inflated at all.
        Example: `inflation_layer: {inflation_radius: .inf}`.
        Fix: Write a finite number.
    params.not-positive (error)
        A number that must be positive, or not negative.
        The node does not start, or computes meaningless costs.
        Example: `resolution: -0.05`.
        Fix: Write a positive number.
    params.range (warning)
        A number out of range, which ROS clamps or accepts.
        The robot runs with another value than the file shows, such as a robot without a size.
        Example: `robot_radius: 0.0`.
        Fix: Write a number within the range.
    params.substitution (error)
        A value that a launch file would substitute.
        Without that launch file the node does not start; costs here cannot be computed.
        Example: `footprint: $(arg footprint)`.
        Fix: Pass the file that the node gets.
    params.namespace (error)
        No costmap of the requested name, or several.
        It is not clear which robot to check, so none was.
        Example: `mapdeal lint fleet.yaml` with robots r1 and r2.
        Fix: Choose one with --namespace.
    params.other-costmap (warning)
        A ROS 1 file that is ignored, as it belongs to another costmap.
        Its values are not part of what was checked.
        Example: `local_costmap.yaml` with `--costmap global`.
        Fix: Leave the file out, or check its costmap.
    params.footprint (error)
        A footprint that ROS refuses.
        move_base exits at start.
        Example: ROS 1: `footprint: [[0.3, 0.2], [0.3]]`.
        Fix: Write three points or more, [x, y] in metres.
    params.footprint-unused (warning)
        A footprint that ROS ignores.
        The robot plans with robot_radius, often smaller than its body, and its corners hit walls.
        Example: `footprint: "[[0.3, 0.2], [0.3, -0.2]]"`.
        Fix: Write three points or more.
    params.outline (warning)
        A footprint that crosses itself, or does not contain (0, 0).
        Inscribed and circumscribed radius are wrong: paths pass too close to obstacles.
        Example: `footprint: "[[0.1, 0.1], [0.5, 0.1], [0.5, 0.4], [0.1, 0.4]]"`.
        Fix: List corners in order, around the robot's centre.
    params.no-shape (warning)
        Neither a footprint nor a radius.
        ROS assumes 0.1 m (Nav2) or 0.46 m (ROS 1): larger robots hit walls, smaller miss doors.
        Example: `robot_radius: null`.
        Fix: Set robot_radius or footprint.
    params.too-large (error)
        A footprint with points farther than a kilometre, or with too many points.
        The unit is wrong: such a robot fits nowhere.
        Example: `robot_radius: 2000.0`.
        Fix: Write metres.
    params.units (warning)
        A length that is unusual for a robot, such as a radius of 10 m.
        The unit is likely to be wrong: the robot fits nowhere, or all cells have costs.
        Example: `robot_radius: 20.0`, centimetres written as metres.
        Fix: Write metres.
    params.plugins (error)
        Layers that cannot be loaded.
        The costmap node does not start, and the robot does not move.
        Example: `plugins: [static_layer, obstacles, inflation_layer]`.
        Fix: Set the plugin of each listed name to a class that exists.
    params.old-plugins (warning)
        A list of layers in the form of ROS 1 or Eloquent, which Nav2 does not read.
        Nav2 runs its default layers instead of those in the file.
        Example: `{plugins: null, plugin_names: [static_layer]}`.
        Fix: List names in plugins, with a plugin for each.
    params.not-modelled (warning)
        A layer that mapdeal does not model, and leaves out.
        The robot has obstacles or costs that mapdeal's results lack; paths on the robot may differ.
        Example: `obstacle_layer: {plugin: "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer"}`.
        Fix: Nothing on the robot; --strict refuses such files.
    params.erases-map (warning)
        An obstacle layer that replaces the map by free space.
        The map's walls are gone until a sensor sees them: the robot plans through them.
        Example: `{track_unknown_space: false, obstacle_layer: {combination_method: 0}}`.
        Fix: Set combination_method: 1, the maximum.
    params.footprint-clearing (note, on request)
        A static layer that frees the cells below the robot.
        It helps a robot off a map's stray obstacle. In mapdeal only cost --pose does so.
        Example: `static_layer: {footprint_clearing_enabled: true}`.
        Fix: Nothing, unless the map has obstacles at starts.
    params.inflation-radius (error)
        An inflation radius below the robot's inscribed radius.
        Cells where the robot collides have cost 0, and planners lead through them.
        Example: `inflation_layer: {inflation_radius: 0.1}`.
        Fix: Raise it above the circumscribed radius.
    params.custom-inscribed-radius (warning)
        An inscribed radius that is not the footprint's.
        Cost 253 then no longer means a collision: too small a radius lets the robot scrape walls.
        Example: `inflation_layer: {custom_inscribed_radius: 0.1}`.
        Fix: Remove it, unless all readers of costs expect it.
    params.asymmetric (note)
        Inflation that depends on the path, which a map does not contain.
        On the robot one side of its path is cheaper; results here are the symmetric ones.
        Example: `inflation_layer: {plugin: "nav2_costmap_2d::AsymmetricInflationLayer",
        cost_scaling_factor: null, cost_scaling_factor_left: 5.0}`.
        Fix: Compare with the robot before you trust a cost.
    params.no-static-layer (warning)
        A global costmap whose layers do not read the map.
        All cells are free until a sensor sees them: planners lead through walls of the map.
        Example: `plugins: [obstacle_layer, inflation_layer]`.
        Fix: Add a StaticLayer in front.
    params.other-map (warning)
        Static layers that read different maps; mapdeal uses one for all.
        Results here miss the obstacles of the second map.
        Example: `{plugins: [static_layer, rooms, inflation_layer], static_layer: {map_topic: /a},
        rooms: {plugin: "nav2_costmap_2d::StaticLayer", map_topic: /b}}`.
        Fix: Check once with each map.
    params.only-namespace (warning)
        A robot in a namespace that was not requested.
        The only robot of the file was checked. Nodes without this namespace run with defaults.
        Example: A file whose nodes are below `robot1:`.
        Fix: Pass its --namespace.
    params.defaults (warning)
        No parameters for the node in /: Nav2's defaults apply.
        The robot runs with a radius of 0.1 m and default layers.
        Example: `--namespace /` for a file of robot1.
        Fix: Pass --namespace robot1, or add the node's parameters.
    params.no-node (error)
        A Nav2 file without parameters of the costmap.
        The costmap runs with defaults, such as a radius of 0.1 m.
        Example: A file with `controller_server` only.
        Fix: Pass the file that has global_costmap.
    params.one-level (error)
        A Nav2 costmap that is not nested twice: it applies to no node.
        None of its values has an effect: the robot runs with defaults.
        Example: `global_costmap: {ros__parameters: {robot_radius: 0.2}}`.
        Fix: Nest the name twice.
    params.misspelt (warning)
        A misspelt parameter.
        ROS silently ignores it and uses the default: the robot behaves otherwise than was set.
        Example: `inflation_layer: {inflate_unknowns: true}`.
        Fix: Write the name that the message proposes.
    params.hidden (warning)
        A later value that ROS 2 ignores because of its type.
        The robot runs with the earlier value, although the later one was meant to replace it.
        Example: `robot_radius: 0.2` and later `robot_radius: 1`.
        Fix: Write both values with one type.
    params.overridden (warning)
        A layer's value that the costmap's value overrides.
        The layer's line has no effect on the robot.
        Example: ROS 1: `{track_unknown_space: true, static_layer: {track_unknown_space: false}}`.
        Fix: Remove one of the two.
    params.twice (warning)
        A repeated key with different values.
        The later value counts, and the line that is read first is not what the robot does.
        Example: `robot_radius: 0.2` and below it `robot_radius: 0.3`.
        Fix: Remove the wrong line.
    params.repeated (note, on request)
        A repeated key with equal values.
        The robot is not affected. A change of one of the lines only may have no effect.
        Example: `robot_radius: 0.2` twice.
        Fix: Remove one of the lines.
    """
)


def finding_of(problem: Problem, file: str) -> Finding:
    message = f"{problem.parameter}: {problem.text}" if problem.parameter else problem.text
    if problem.got is not None:
        got = " ".join(problem.got.split())
        message += f", got {got if len(got) <= 60 else got[:57] + '...'}"
    if problem.hint is not None:
        message += f"; {problem.hint}"
    return CHECKS[problem.check].finding(problem.source or file, message, problem.line)


_INSCRIBED_COST = 252
_LEAST_FADING_SHARE = 0.5
_LEAST_CLIFF_COST = 128
_SAME_RADIUS = 1e-6
_SCALING = ("cost_scaling_factor", "inflation_radius")


def _widest_inflation(facts: RobotFacts) -> InflationLayer | None:
    layers = [layer for layer in facts.robot.inflation_layers if layer.inflation_radius > 0]
    return max(layers, key=lambda layer: layer.inflation_radius, default=None)


@check("params.inflation-below-circumscribed", "warning")
def inflation_below_circumscribed(facts: RobotFacts) -> Iterator[Remark]:
    """An inflation radius between the footprint's inscribed and circumscribed radius.
    Planners check headings only where costs are above 0, so corners of the robot may hit obstacles.
    Example: `{robot_radius: null, footprint: "[[0.5, 0.2], [0.5, -0.2], [-0.5, -0.2], [-0.5,
    0.2]]", inflation_layer: {inflation_radius: 0.4}}`.
    Fix: Raise inflation_radius to the circumscribed radius.
    """
    layer, robot = _widest_inflation(facts), facts.robot
    if layer is None or robot.robot_radius is not None:
        return  # a round robot fits in all headings or in none
    outer = robot.circumscribed_radius
    if robot.inscribed_radius <= layer.inflation_radius < outer:
        text = f"{_reach(layer)} is below the circumscribed radius, {outer:.4g} m: cost 0 does not "
        text += f"mean that every heading is free; write {_rounded_up(outer):g}"
        yield Remark(text, at=facts.of_layer(layer.name, "inflation_radius"))


@check("params.no-inflation", "warning")
def no_inflation(facts: RobotFacts) -> Iterator[Remark]:
    """A costmap in which no inflation layer has an effect.
    Cells beside walls cost 0, although the robot collides there.
    Example: `plugins: [static_layer, obstacle_layer]`.
    Fix: List an InflationLayer last, switched on, with a radius.
    """
    robot = facts.robot
    if _widest_inflation(facts) is not None:
        return
    if robot.flavour == "nav2" and robot.inflation_layers:
        return  # params.inflation-radius reports radius 0
    unlisted = {path[0] for path in facts.parameters.values if path[1:] == ("inflation_radius",)}
    unlisted -= {entry.name for entry in robot.layers}
    why, at = "no inflation layer is listed", facts.value("plugins")
    advice = f"list {min(unlisted, default='an InflationLayer')} last in plugins"
    for listed in (entry for entry in robot.layers if entry.layer and entry.layer.spreads):
        why, at = f"{listed.name} is switched off", facts.value(listed.name, "enabled")
        advice = "set enabled to true"
        if listed.is_enabled:
            why = f"{listed.name}'s inflation_radius is 0"
            at = facts.of_layer(listed.name, "inflation_radius")
            advice = "write an inflation radius above it"
        break
    text = f"{why}: cells beside obstacles cost 0, although the robot collides there (inscribed "
    text += f"radius {robot.inscribed_radius:.4g} m); {advice}"
    yield Remark(text, at=at)


@check("params.cost-cliff", "note")
def cost_cliff(facts: RobotFacts) -> Iterator[Remark]:
    """Costs that are still high where inflation ends.
    Behind the cliff cells cost nothing: paths run along that line instead of the middle.
    Example: `inflation_layer: {inflation_radius: 0.3, cost_scaling_factor: 1.0}`.
    Fix: Write one of the values in the message.
    """
    layer = _widest_inflation(facts)
    if layer is None or layer.inflation_radius <= layer.inscribed_radius:
        return
    beyond = layer.inflation_radius - layer.inscribed_radius
    cost = math.floor(_INSCRIBED_COST * math.exp(-layer.cost_scaling_factor * beyond))
    if cost >= _LEAST_CLIFF_COST:
        decay = math.log(_INSCRIBED_COST / (_LEAST_CLIFF_COST - 1))
        advice = f"cost_scaling_factor to {_rounded_up(decay / beyond):g}"
        if layer.cost_scaling_factor > 0:
            radius = layer.inscribed_radius + decay / layer.cost_scaling_factor
            advice += f" or inflation_radius to {_rounded_up(radius):g} m"
        text = f"costs drop from {cost} to 0 at {_reach(layer)}, and paths run along that line"
        yield Remark(f"{text}; raise {advice}", at=facts.of_layer(layer.name, *_SCALING))


@check("params.cost-ends-early", "note")
def cost_ends_early(facts: RobotFacts) -> Iterator[Remark]:
    """Costs that are 0 long before inflation ends.
    Most of the inflation radius has no effect on paths, and computing it takes time.
    Example: `inflation_layer: {inflation_radius: 2.0, cost_scaling_factor: 20.0}`.
    Fix: Lower cost_scaling_factor, or the inflation radius.
    """
    layer = _widest_inflation(facts)
    if layer is None or layer.cost_scaling_factor <= 0:
        return
    beyond = layer.inflation_radius - layer.inscribed_radius
    width = math.log(_INSCRIBED_COST) / layer.cost_scaling_factor
    if width < _LEAST_FADING_SHARE * beyond:
        factor = f"cost_scaling_factor {layer.cost_scaling_factor:g}"
        text = f"costs are 0 beyond {layer.inscribed_radius + width:.3g} m: with {factor}, the "
        text += f"rest of {_reach(layer)} has no effect; lower one of the two"
        yield Remark(text, at=facts.of_layer(layer.name, *_SCALING))


@check("params.radius-and-footprint", "warning")
def radius_and_footprint(facts: RobotFacts) -> Iterator[Remark]:
    """A robot_radius without effect beside a footprint.
    The robot plans with the footprint, and changing the radius changes nothing.
    Example: `footprint: "[[0.2, 0.2], [0.2, -0.2], [-0.2, -0.2], [-0.2, 0.2]]"` beside
    robot_radius.
    Fix: Remove the one that is not meant.
    """
    radius, footprint = facts.value("robot_radius"), facts.value("footprint")
    if facts.robot.robot_radius is None and radius is not None:
        where = f" on line {footprint.line}" if footprint is not None else ""
        text = f"robot_radius has no effect: the footprint{where} overrides it; remove one"
        yield Remark(text, at=radius)


@check("params.unknown-is-free", "warning")
def unknown_is_free(facts: RobotFacts) -> Iterator[Remark]:
    """Unknown space is free, because track_unknown_space is not set.
    Planners lead the robot through unexplored space, where walls and stairs may be.
    Example: `track_unknown_space: null`.
    Fix: Set track_unknown_space: true.
    """
    layers = [layer for layer in facts.robot.static_layers if layer.name != INJECTED]
    free = [layer for layer in layers if not layer.track_unknown_space]
    name = "track_unknown_space"
    if free and not facts.value(name) and not facts.of_layer(free[0].name, name):
        text = f"{name} is not set, so false: the map's unknown cells cost 0; set it to true"
        yield Remark(text, at=facts.value("plugins"))


@check("params.unknown-cost-value", "warning")
def unknown_cost_value(facts: RobotFacts) -> Iterator[Remark]:
    """An unknown_cost_value other than 255, which makes unknown cells lethal.
    Unknown cells become obstacles, and cells of the value become unknown or free.
    Example: `unknown_cost_value: 0`.
    Fix: Write 255, or remove it.
    """
    for layer in facts.robot.static_layers:
        value = layer.unknown_cost_value
        if value == NO_INFORMATION or layer.name == INJECTED:
            continue
        cells = {0: "free cells", 100: "occupied cells"}.get(value, f"cells of occupancy {value}")
        becomes = "unknown" if layer.track_unknown_space else "free"
        text = f"{cells} become {becomes}, and unknown ones lethal"
        text = text if value <= 100 else "unknown cells become lethal"
        at = facts.value("unknown_cost_value") or facts.of_layer(layer.name, "unknown_cost_value")
        yield Remark(f"unknown_cost_value {value}: {text}; write 255", at=at)


@check("params.costmaps-differ", "note")
def costmaps_differ(facts: RobotFacts) -> Iterator[Remark]:
    """A global and a local costmap with different robot shapes.
    The planner finds paths that the controller cannot follow, or misses paths that it could follow.
    Example: A radius of 0.2 m in one and 0.3 m in the other.
    Fix: Set the same shape in both.
    """
    robots = [robot for robot in (facts.robot, facts.sibling) if robot is not None]
    radii = [(robot.inscribed_radius, robot.circumscribed_radius) for robot in robots]
    if any(max(both) - min(both) > _SAME_RADIUS for both in zip(*radii, strict=True)):
        shapes = " and ".join(
            f"in the {robot.costmap} one {inner:.4g} m and {outer:.4g} m"
            for robot, (inner, outer) in zip(robots, radii, strict=True)
        )
        text = "the robot differs between the costmaps: inscribed and circumscribed radius are "
        text += f"{shapes}; plans may not be drivable: write one shape in both"
        yield Remark(text, at=facts.value("footprint") or facts.value("robot_radius"))


@check("params.resolution", "note")
def resolution(facts: RobotFacts) -> Iterator[Remark]:
    """A resolution of the global costmap that differs from the map's.
    The static layer sets the map's resolution: cells, memory and times are not those of the file.
    Example: `resolution: 0.1` with a map of 0.05 m.
    Fix: Remove it, or resample the map.
    """
    value = facts.value("resolution")
    if value is None or facts.robot.rolling_window or not facts.robot.static_layers:
        return
    if not isinstance(value.value, int | float) or isinstance(value.value, bool):
        return
    maps: dict[float, list[str]] = {}
    for name, frame in facts.map_frames:
        maps.setdefault(frame.resolution, []).append(name)
    for cell, names in maps.items():
        if not math.isclose(value.value, cell, rel_tol=1e-6):
            map_names = few_text(names, 1)
            text = f"has no effect: the static layer takes the map's, {cell:g} m ({map_names})"
            yield Remark(f"resolution {value.value:g} m {text}; remove it", at=value)


def _rounded_up(value: float) -> float:
    return math.ceil(100 * value - _SAME_RADIUS) / 100


def _reach(layer: InflationLayer) -> str:
    return f"inflation_radius {layer.inflation_radius:g} m"


_ABSENT = ("params.namespace", "params.no-node")
_OTHER_KIND = "params.other-kind"
_OTHER_COSTMAP = "params.other-costmap"  # omitted if both costmaps are checked
_LENGTHS = {"params.inflation-below-circumscribed", "params.cost-cliff", "params.cost-ends-early"}
"""Omitted if the unit of a length is doubtful."""
_ABOUT_FILES = ("params.syntax", "params.one-level", _OTHER_KIND, *_ABSENT)
"""Findings about a whole file, or with the costmap's node in their text."""


@records.dataclass(frozen=True)
class _Costmap:
    name: CostmapName
    robot: RobotParameters | None  # None if the files are unusable
    problems: tuple[Problem, ...]
    parameters: load.ParameterFacts

    @property
    def is_absent(self) -> bool:
        return any(p.check in _ABSENT and p.level == "refused" for p in self.problems)


def lint_parameters(
    paths: Sequence[Path], costmap: CostmapName | None = None, namespace: str | None = None,
    map_frames: Sequence[tuple[str, Frame]] = (),
) -> dict[Path, list[Finding]]:  # fmt: skip
    names = load.costmaps_in(paths, namespace) if costmap is None else (costmap,)
    costmaps = [_Costmap(n, *load.load_robot(paths, costmap=n, namespace=namespace)) for n in names]
    present = [item for item in costmaps if not item.is_absent] or costmaps[:1]
    by_costmap: dict[CostmapName, list[Finding]] = {}
    default_file = str(paths[-1])
    for index, item in enumerate(present):
        sibling = present[1].robot if index == 0 and len(present) > 1 else None
        problems = [p for p in item.problems if len(present) == 1 or p.check != _OTHER_COSTMAP]
        by_costmap[item.name] = [finding_of(problem, default_file) for problem in problems]
        by_costmap[item.name] += _check(paths, item, sibling, map_frames)
    findings = list(_with_costmap_names(by_costmap))
    if any(map(load.is_ros2, paths)):
        robot = next((item.robot for item in present if item.name == "global"), None)
        findings += _planner_findings(paths, robot, map_frames)
    by_file: dict[Path, list[Finding]] = {path: [] for path in paths}
    for finding in dict.fromkeys(findings):
        by_file.setdefault(Path(finding.file), []).append(finding)
    return {path: sorted(group, key=lambda f: f.line or 0) for path, group in by_file.items()}


def _planner_findings(
    paths: Sequence[Path], robot: RobotParameters | None, map_frames: Sequence[tuple[str, Frame]]
) -> Iterator[Finding]:
    default_file = str(paths[-1])
    for problem in planners.planners_of(robot)[1] if robot is not None else ():
        yield finding_of(problem, default_file)
    with suppress(errors.MalformedInputError):  # reported with the costmaps
        for facts in planner_facts(ros2_files.read_ros2(paths), map_frames):
            yield from findings_on({PlannerFacts: facts}, default_file)


def _with_costmap_names(by_costmap: Mapping[CostmapName, Sequence[Finding]]) -> Iterator[Finding]:
    """Yield findings with the costmap's name where file and line do not identify the costmap."""
    for name, findings in by_costmap.items():
        other_findings = {f for key in by_costmap if key != name for f in by_costmap[key]}
        other_messages = {(finding.check, finding.message) for finding in other_findings}
        for finding in findings:
            is_placed = finding.line is not None or len(by_costmap) == 1
            is_shared = is_placed and finding in other_findings
            is_ambiguous = not is_placed or (finding.check, finding.message) in other_messages
            is_clear = finding.check in _ABOUT_FILES or is_shared
            if is_clear or not (name == "local" or is_ambiguous):
                yield finding
            else:
                yield records.replace(finding, message=f"{name} costmap: {finding.message}")


def first_robot(
    paths: Sequence[Path], *, costmap: CostmapName | None = None, namespace: str | None = None
) -> RobotParameters | None:
    names: Sequence[CostmapName] = ("global", "local") if costmap is None else (costmap,)
    for name in names:
        with suppress(errors.MapdealError):
            robot, *_ = load.load_robot(paths, costmap=name, namespace=namespace)
            if robot is not None:
                return robot
    return None


def _check(
    paths: Sequence[Path], costmap: _Costmap, sibling: RobotParameters | None,
    map_frames: Sequence[tuple[str, Frame]],
) -> Iterator[Finding]:  # fmt: skip
    checks = {problem.check for problem in costmap.problems}
    if _OTHER_KIND in checks:
        return
    facts: dict[type, Any] = {load.ParameterFacts: costmap.parameters}
    if costmap.robot is not None:
        robot = RobotFacts(costmap.robot, costmap.parameters, sibling, tuple(map_frames))
        facts[RobotFacts] = robot
        if robot.robot.flavour == "nav2":
            servers = filters.filter_servers(ros2_files.read_ros2(paths))
            facts[FilterFacts] = FilterFacts(robot, servers)
    for finding in findings_on(facts, str(paths[-1])):
        if not ("params.units" in checks and finding.check in _LENGTHS):
            yield finding
