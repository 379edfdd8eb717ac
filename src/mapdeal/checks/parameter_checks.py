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
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from mapdeal.checks.facts import FilterFacts, ParameterFacts, PlannerFacts, RobotFacts, check
from mapdeal.checks.findings import CHECKS, Finding, Remark, Severity, declare_check
from mapdeal.checks.nav2_names import planner_facts
from mapdeal.errors import MalformedInputError, MapdealError
from mapdeal.grid.values import NO_INFORMATION
from mapdeal.layers.catalogue import NAV2_PLUGINS, class_name, layer_named
from mapdeal.layers.inflation import InflationLayer
from mapdeal.ros.filters import filter_servers
from mapdeal.ros.load import Name, costmap_values, costmaps_in, flavour_of, load_robot
from mapdeal.ros.robot import (
    INJECTED,
    CostmapName,
    Flavour,
    ParameterValue,
    Problem,
    RobotParameters,
)
from mapdeal.ros.ros2_files import read_ros2

_COSTMAP = {
    "always_send_full_costmap", "footprint", "footprint_padding", "footprint_topic",
    "global_frame", "height", "lethal_cost_threshold", "map_topic", "origin_x", "origin_y",
    "plugins", "publish_frequency", "published_footprint_topic", "resolution",
    "robot_base_frame", "robot_radius", "rolling_window", "track_unknown_space",
    "transform_tolerance", "unknown_cost_value", "update_frequency", "width",
}  # fmt: skip
_COSTMAP_BY_FLAVOUR = {
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
LAYER_PARAMETERS = frozenset(
    {"enabled", "plugin", "inflation_radius", "cost_scaling_factor", "observation_sources",
     "map_subscribe_transient_local", "map_topic", "inflate_unknown"}
)  # fmt: skip
"""Parameters that identify a section as a layer."""

IDLE_LAYER_PARAMETERS = frozenset(
    {"enabled", "plugin", "map_subscribe_transient_local", "map_topic", "subscribe_to_updates"}
)
"""Parameters of a layer that may be unlisted without a finding, because it would do nothing."""

INFLATION_PARAMETERS = frozenset({"inflation_radius", "cost_scaling_factor", "inflate_unknown"})
"""Parameters of inflation layers; Nav2's layers do not inherit them from the costmap."""

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


def known_names(flavour: Flavour, layer: str) -> frozenset[str]:
    """Return the parameters of a layer's class, or of the costmap if `layer` is empty."""
    if not layer:
        return frozenset(_COSTMAP | _COSTMAP_BY_FLAVOUR[flavour])
    layer_class = layer_named(layer)
    return frozenset() if layer_class is None else layer_class.known_parameters(layer)


_LEAST_SIMILARITY = 0.85
_MOST, _LONGEST = 1000, 60
"""Limits of the search for misspelt names, which compares each unknown name with all known."""
_OTHER_MARKING = ("NonPersistentVoxelLayer", "SpatioTemporalVoxelLayer")
"""Layer classes that write lethal cells and that mapdeal does not model."""


@check(
    "params.layer-after-inflation",
    "warning",
    "a layer that writes obstacles after the inflation layer: they are not inflated",
)
def layer_after_inflation(facts: RobotFacts) -> Iterator[Remark]:
    inflation = None
    for listed in facts.robot.layers:
        if not listed.is_enabled or listed.is_filter:
            continue
        name = class_name(listed.plugin)
        layer_class = layer_named(name)
        if layer_class is not None and layer_class.spreads:
            inflation = listed.name
        elif inflation is not None and (
            name in _OTHER_MARKING or (layer_class is not None and layer_class.marks_obstacles)
        ):
            overwrites = listed.layer is not None and listed.layer.overwrites_all
            effect = "it overwrites the costs" if overwrites else "its obstacles are not inflated"
            text = f"{listed.name} comes after {inflation}: {effect}"
            yield Remark(text, at=facts.value("plugins"))


@check("params.two-inflations", "warning", "two inflation layers that are both switched on")
def two_inflations(facts: RobotFacts) -> Iterator[Remark]:
    names = [layer.name for layer in facts.robot.inflation_layers]
    if len(set(names)) > 1:
        text = f"{' and '.join(names)} both inflate: a cell gets the higher of their costs"
        yield Remark(text, at=facts.value("plugins"))


@check("params.layer-disabled", "note", "a listed layer that is switched off")
def layer_disabled(facts: RobotFacts) -> Iterator[Remark]:
    for listed in facts.robot.layers:
        is_inflation = listed.layer is not None and listed.layer.spreads
        is_last = is_inflation and not facts.robot.inflation_layers
        if not listed.is_enabled and not is_last:  # params.no-inflation reports the last one
            yield Remark(f"{listed.name} is switched off", at=facts.value(listed.name, "enabled"))


@check("params.mask-unused", "warning", "a keepout filter whose mask has no effect on the costs")
def mask_unused(facts: RobotFacts) -> Iterator[Remark]:
    # params.layer-disabled reports filters that are switched off.
    reason = facts.robot.why_mask_unused
    if reason is not None and facts.robot.has_keepout_filter:
        yield Remark(f"the keepout mask has no effect: {reason}", at=facts.value("plugins"))


@check("params.plugin-twice", "warning", "a layer that is listed twice")
def plugin_twice(facts: ParameterFacts) -> Iterator[Remark]:
    for name, count in Counter(name for name, _ in facts.plugins).items():
        if count > 1:
            text = f"{name} is listed {count} times"
            yield Remark(text, at=facts.values.get(("plugins",)))


@check("params.unused-section", "note",
       "parameters of a layer that the list of plugins does not name")  # fmt: skip
def unused_section(facts: ParameterFacts) -> Iterator[Remark]:
    # ROS 1 files that both costmaps load contain the layers of both. Many Nav2 files have an unused
    # static layer in the local costmap, as Nav2's example has.
    listed_names = {name for name, _ in facts.plugins} | set(_nested_names(facts))
    for name, section in facts.sections.items():
        names = {path[1] for path in section}
        if name in listed_names or names.isdisjoint(LAYER_PARAMETERS):
            continue
        close = get_close_matches(name, listed_names, n=1, cutoff=_LEAST_SIMILARITY)
        if not close and (facts.flavour == "ros1" or names <= IDLE_LAYER_PARAMETERS):
            continue
        text = f"{name} is not in the list of plugins: its parameters have no effect"
        hint = f"; did you mean {close[0]}?" if close else ""
        yield Remark(text + hint, at=next(iter(section.values())))


def _nested_names(facts: ParameterFacts) -> Iterator[str]:
    """Yield the names in the lists of container layers and of observation sources."""
    for path, value in facts.values.items():
        if len(path) == 2 and path[1] in ("plugins", "observation_sources"):
            if isinstance(value.value, str):
                yield from value.value.split()
            elif isinstance(value.value, list | tuple):
                yield from (name for name in value.value if isinstance(name, str))


@check("params.misspelt", "warning", "a misspelt parameter")
def misspelt(facts: ParameterFacts) -> Iterator[Remark]:
    unknown = 0
    for section, known in _scopes(facts):
        for path, value in section.items():
            name = path[-1]
            if name in known or len(name) > _LONGEST or (unknown := unknown + 1) > _MOST:
                continue
            close = get_close_matches(name, known, n=1, cutoff=_LEAST_SIMILARITY)
            if close and (*path[:-1], close[0]) not in facts.values:
                text = f"no parameter is called {facts.label(*path)}: did you mean {close[0]}?"
                yield Remark(text, at=value)


def _scopes(facts: ParameterFacts) -> Iterator[tuple[dict[Name, ParameterValue], frozenset[str]]]:
    """Yield the parameters of the costmap and of each layer, with the names known there."""
    costmap_values: dict[Name, ParameterValue] = {}
    costmap_values |= {path: value for path, value in facts.values.items() if len(path) == 1}
    yield costmap_values, known_names(facts.flavour, "")
    for name, plugin in dict(facts.plugins).items():
        known = known_names(facts.flavour, class_name(plugin))
        if known:
            section = facts.sections.get(name, {})
            yield {path: value for path, value in section.items() if len(path) == 2}, known


@check("params.misplaced", "warning", "a parameter at a level where it has no effect")
def misplaced(facts: ParameterFacts) -> Iterator[Remark]:
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


@check("params.without-effect", "note", "ROS 1 parameters without effect beside a list of plugins")
def without_effect(facts: ParameterFacts) -> Iterator[Remark]:
    """Report parameters of costmaps before Hydro, as ``warnForOldParameters``."""
    if facts.flavour != "ros1" or ("plugins",) not in facts.values:
        return
    for name in OLD_PARAMETERS:
        value = facts.values.get((name,))
        if value is not None:
            yield Remark(f"{name} has no effect: the layers are those of plugins", at=value)


_SEVERITIES: dict[str, Severity] = {"refused": "error", "warning": "warning", "note": "note"}

_DECLARED: tuple[tuple[str, Severity, str], ...] = (
    ("syntax", "error", "a parameter file that ROS cannot read"),
    ("alias", "warning", "an alias in a Nav2 file, which only nav2_bringup's launch files replace"),
    ("other-kind", "error", "a file of another kind, such as a map or a recipe"),
    ("empty", "error", "a parameter without a value: roslaunch exits"),
    ("name", "error", "a name that is not text"),
    ("type", "error", "a value of a type that ROS refuses"),
    ("silent-default", "warning",
     "a value of a wrong type in ROS 1, which silently takes its default, or rounds a number"),
    ("not-finite", "error", "a number that is not finite"),
    ("not-positive", "error", "a number that must be positive, or not negative"),
    ("range", "warning", "a number out of range, which ROS clamps or accepts"),
    ("substitution", "error", "a value that a launch file would substitute"),
    ("namespace", "error", "no costmap of the requested name, or several"),
    ("other-costmap", "warning", "a ROS 1 file that is ignored, as it belongs to another costmap"),
    ("footprint", "error", "a footprint that ROS refuses"),
    ("footprint-unused", "warning", "a footprint that ROS ignores"),
    ("outline", "warning", "a footprint that crosses itself, or does not contain (0, 0)"),
    ("no-shape", "warning", "neither a footprint nor a radius"),
    ("too-large", "error", "a footprint with points farther than a kilometre"),
    ("plugins", "error", "layers that cannot be loaded"),
    ("old-plugins", "warning",
     "a list of layers in the form of ROS 1 or Eloquent, which Nav2 does not read"),
    ("not-modelled", "warning", "a layer that mapdeal does not model, and leaves out"),
    ("erases-map", "warning", "an obstacle layer that replaces the map by free space"),
    ("footprint-clearing", "note", "a static layer that frees the cells below the robot"),
    ("inflation-radius", "error", "an inflation radius below the robot's inscribed radius"),
    ("custom-inscribed-radius", "warning", "an inscribed radius that is not the footprint's"),
    ("asymmetric", "note", "inflation that depends on the path, which a map does not have"),
    ("no-static-layer", "warning", "a global costmap whose layers do not read the map"),
    ("other-map", "warning", "static layers that read different maps: all get the one here"),
    ("only-namespace", "warning", "a robot in a namespace that was not requested"),
    ("defaults", "warning", "a root node without parameters in the files: Nav2's defaults apply"),
    ("no-node", "error", "a Nav2 file without parameters of the costmap"),
    ("one-level", "error", "a Nav2 costmap that is not nested twice: it applies to no node"),
    ("hidden", "warning", "a later value that ROS 2 ignores because of its type"),
    ("overridden", "warning", "a layer's value that the costmap's own overrides"),
    ("twice", "warning", "a repeated key with different values"),
    ("repeated", "note", "a repeated key with equal values"),
)  # fmt: skip
for _name, _severity, _about in _DECLARED:
    declare_check(f"params.{_name}", _severity, _about)


def finding_of(problem: Problem, file: str) -> Finding:
    message = f"{problem.parameter}: {problem.text}" if problem.parameter else problem.text
    if problem.got is not None:
        got = " ".join(problem.got.split())
        message += f", got {got if len(got) <= 60 else got[:57] + '...'}"
    if problem.hint is not None:
        message += f"; {problem.hint}"
    source = file if problem.source is None else str(problem.source)
    known = CHECKS.get(problem.check)
    severity = _SEVERITIES[problem.level] if known is None else known.severity
    return Finding(problem.check, severity, source, message, problem.line)


_INSCRIBED_COST = 252
_LEAST_FADING_SHARE = 0.5
_LEAST_CLIFF_COST = 128
_SAME_RADIUS = 1e-6
_SUFFIXES = ("", "_left", "_right")
"""Suffixes of cost_scaling_factor: an AsymmetricInflationLayer has one factor for each side."""


def _widest_inflation(facts: RobotFacts) -> InflationLayer | None:
    layers = [layer for layer in facts.robot.inflation_layers if layer.inflation_radius > 0]
    return max(layers, key=lambda layer: layer.inflation_radius, default=None)


@check(
    "params.inflation-below-circumscribed",
    "warning",
    "an inflation radius between the footprint's inscribed and circumscribed radius",
)
def inflation_below_circumscribed(facts: RobotFacts) -> Iterator[Remark]:
    """Compare the radii: planners check the footprint's heading only at costs above 0."""
    layer, robot = _widest_inflation(facts), facts.robot
    if layer is None or robot.robot_radius is not None:
        return  # a round robot fits in all headings or in none
    if robot.inscribed_radius <= layer.inflation_radius < robot.circumscribed_radius:
        yield Remark(
            f"{_reach(layer)} is below the circumscribed radius, "
            f"{robot.circumscribed_radius:.4g} m: cost 0 does not mean that every heading is free",
            at=facts.of_layer(layer.name, "inflation_radius"),
        )


@check("params.no-inflation", "warning", "a costmap in which no inflation layer has an effect")
def no_inflation(facts: RobotFacts) -> Iterator[Remark]:
    robot = facts.robot
    if _widest_inflation(facts) is not None:
        return
    if robot.flavour == "nav2" and robot.inflation_layers:
        return  # params.inflation-radius reports radius 0
    layers = [entry for entry in robot.layers if entry.layer is not None and entry.layer.spreads]
    why = "no inflation layer is listed" if not layers else f"{layers[0].name} is switched off"
    at = facts.value("plugins")
    if layers and layers[0].is_enabled:
        why = f"{layers[0].name}'s inflation_radius is 0"
        at = facts.of_layer(layers[0].name, "inflation_radius")
    elif layers:
        at = facts.value(layers[0].name, "enabled")
    yield Remark(
        f"{why}: cells beside obstacles cost 0, although the robot collides there "
        f"(inscribed radius {robot.inscribed_radius:.4g} m)",
        at=at,
    )


@check("params.cost-cliff", "note", "costs that are still high where inflation ends")
def cost_cliff(facts: RobotFacts) -> Iterator[Remark]:
    layer = _widest_inflation(facts)
    if layer is None or layer.inflation_radius <= layer.inscribed_radius:
        return
    beyond = layer.inflation_radius - layer.inscribed_radius
    cost = math.floor(_INSCRIBED_COST * math.exp(-layer.cost_scaling_factor * beyond))
    if cost >= _LEAST_CLIFF_COST:
        fading = "cost_scaling_factor is 0"
        if layer.cost_scaling_factor > 0:
            radius = layer.inscribed_radius + math.log(_INSCRIBED_COST) / layer.cost_scaling_factor
            fading = f"cost_scaling_factor {layer.cost_scaling_factor:g} lets them fade out at "
            fading += f"{radius:.3g} m"
        yield Remark(
            f"costs drop from {cost} to 0 at {_reach(layer)}; {fading}",
            at=facts.of_layer(layer.name, "cost_scaling_factor")
            or facts.of_layer(layer.name, "inflation_radius"),
        )


@check("params.cost-ends-early", "note", "costs that are 0 long before inflation ends")
def cost_ends_early(facts: RobotFacts) -> Iterator[Remark]:
    layer = _widest_inflation(facts)
    if layer is None or layer.cost_scaling_factor <= 0:
        return
    beyond = layer.inflation_radius - layer.inscribed_radius
    width = math.log(_INSCRIBED_COST) / layer.cost_scaling_factor
    if width < _LEAST_FADING_SHARE * beyond:
        yield Remark(
            f"costs are 0 from {layer.inscribed_radius + width:.3g} m on: with cost_scaling_factor "
            f"{layer.cost_scaling_factor:g} the rest of {_reach(layer)} has none",
            at=facts.of_layer(layer.name, "cost_scaling_factor")
            or facts.of_layer(layer.name, "inflation_radius"),
        )


@check("params.inflation-defaults", "note", "an inflation layer with ROS's default values")
def inflation_defaults(facts: RobotFacts) -> Iterator[Remark]:
    for layer in facts.robot.inflation_layers:
        defaults = [
            f"{name} is {value:g}{unit}"
            for name, value, unit in (
                ("inflation_radius", layer.inflation_radius, " m"),
                ("cost_scaling_factor", layer.cost_scaling_factor, ""),
            )
            if not any(facts.of_layer(layer.name, f"{name}{side}") for side in _SUFFIXES)
        ]
        if defaults:
            section = facts.parameters.sections.get(layer.name, {})
            at = next(iter(section.values()), facts.value("plugins"))
            yield Remark(f"{layer.name}: not set, and so {' and '.join(defaults)}", at=at)


@check("params.radius-and-footprint", "warning",
       "a robot_radius without effect beside a footprint")  # fmt: skip
def radius_and_footprint(facts: RobotFacts) -> Iterator[Remark]:
    """Report a radius beside a polygon: ``setRobotFootprint`` uses the polygon."""
    radius = facts.value("robot_radius")
    if facts.robot.robot_radius is None and radius is not None:
        footprint = facts.value("footprint")
        where = f", on line {footprint.line}" if footprint is not None else ""
        yield Remark(f"robot_radius has no effect: the footprint counts{where}", at=radius)


@check("params.unknown-is-free", "warning",
       "unknown space is free, because track_unknown_space is not set")  # fmt: skip
def unknown_is_free(facts: RobotFacts) -> Iterator[Remark]:
    layers = [layer for layer in facts.robot.static_layers if layer.name != INJECTED]
    free = [layer for layer in layers if not layer.track_unknown_space]
    name = "track_unknown_space"
    if free and not facts.value(name) and not facts.of_layer(free[0].name, name):
        text = "track_unknown_space is not set, so false: the map's unknown cells cost 0"
        yield Remark(text, at=facts.value("plugins"))


@check("params.unknown-cost-value", "warning",
       "an unknown_cost_value other than 255, which makes unknown cells lethal")  # fmt: skip
def unknown_cost_value(facts: RobotFacts) -> Iterator[Remark]:
    """Check the value that the static layer compares with cells, 255 for unknown ones."""
    for layer in facts.robot.static_layers:
        value = layer.unknown_cost_value
        if value == NO_INFORMATION or layer.name == INJECTED:
            continue
        cells = {0: "free cells", 100: "occupied cells"}.get(value, f"cells of occupancy {value}")
        becomes = "unknown" if layer.track_unknown_space else "free"
        text = (
            f"{cells} become {becomes}, and unknown ones lethal"
            if value <= 100
            else ("unknown cells become lethal")
        )
        at = facts.value("unknown_cost_value") or facts.of_layer(layer.name, "unknown_cost_value")
        yield Remark(f"unknown_cost_value {value}: {text}; write 255", at=at)


@check("params.costmaps-differ", "note",
       "a global and a local costmap with different robot shapes")  # fmt: skip
def costmaps_differ(facts: RobotFacts) -> Iterator[Remark]:
    robot, sibling = facts.robot, facts.sibling
    if sibling is None:
        return
    radii = [(r.inscribed_radius, r.circumscribed_radius) for r in (robot, sibling)]
    if all(abs(a - b) <= _SAME_RADIUS for a, b in zip(*radii, strict=True)):
        return
    shapes = " and ".join(
        f"in the {r.costmap} one {r.inscribed_radius:.4g} m and {r.circumscribed_radius:.4g} m"
        for r in (robot, sibling)
    )
    yield Remark(
        f"the robot differs between the costmaps: inscribed and circumscribed radius are {shapes}",
        at=facts.value("footprint") or facts.value("robot_radius"),
    )


@check("params.resolution", "note",
       "a resolution of the global costmap that differs from the map's")  # fmt: skip
def resolution(facts: RobotFacts) -> Iterator[Remark]:
    """Compare the resolution with the map's, which the static layer sets for the costmap."""
    value = facts.value("resolution")
    if value is None or facts.robot.rolling_window or not facts.robot.static_layers:
        return
    if not isinstance(value.value, int | float) or isinstance(value.value, bool):
        return
    maps: dict[float, list[str]] = {}
    for name, cell in facts.map_resolutions:
        maps.setdefault(cell, []).append(name)
    for cell, names in maps.items():
        if not math.isclose(value.value, cell, rel_tol=1e-6):
            map_names = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
            text = f"has no effect: the static layer takes the map's, {cell:g} m ({map_names})"
            yield Remark(f"resolution {value.value:g} m {text}", at=value)


def _reach(layer: InflationLayer) -> str:
    return f"inflation_radius {layer.inflation_radius:g} m"


_ONE_LEVEL = "params.one-level"
_ABSENT = ("params.namespace", "params.no-node", _ONE_LEVEL)
_OTHER_KIND = "params.other-kind"
_OTHER_COSTMAP = "params.other-costmap"
"""Omitted if both costmaps are checked: the file belongs to the other one."""
_ABOUT_FILES = ("params.syntax", _OTHER_KIND, *_ABSENT)
"""Findings about a whole file, or with the costmap's node in their text."""


@dataclass(frozen=True)
class _Costmap:
    """One costmap of the files: the robot, None if unusable, and the problems found."""

    name: CostmapName
    robot: RobotParameters | None
    problems: tuple[Problem, ...]

    @property
    def is_absent(self) -> bool:
        return any(p.check in _ABSENT and p.level == "refused" for p in self.problems)

    @property
    def is_misplaced(self) -> bool:
        """Whether the files have its parameters at a wrong level of nesting."""
        return any(problem.check == _ONE_LEVEL for problem in self.problems)


def lint_parameters(
    paths: Sequence[Path], *, costmap: CostmapName | None = None, namespace: str | None = None,
    map_resolutions: Sequence[tuple[str, float]] = (),
) -> dict[Path, list[Finding]]:  # fmt: skip
    """Return the findings of all checks in a robot's parameter files, by file, sorted by line."""
    flavour = flavour_of(paths)
    names = costmaps_in(paths, flavour, namespace) if costmap is None else (costmap,)
    costmaps = [_Costmap(n, *load_robot(paths, costmap=n, namespace=namespace)) for n in names]
    present = [item for item in costmaps if not item.is_absent or item.is_misplaced]
    present = present or costmaps[:1]
    by_costmap: dict[CostmapName, list[Finding]] = {}
    last = str(paths[-1])
    for index, item in enumerate(present):
        sibling = present[1].robot if index == 0 and len(present) > 1 else None
        problems = [p for p in item.problems if len(present) == 1 or p.check != _OTHER_COSTMAP]
        by_costmap[item.name] = [finding_of(problem, last) for problem in problems]
        by_costmap[item.name] += _check(paths, item, flavour, namespace, sibling, map_resolutions)
    findings = list(_with_costmap(by_costmap))
    with suppress(MalformedInputError):  # reported with the costmaps
        for facts in planner_facts(read_ros2(paths)) if flavour == "nav2" else ():
            findings += _findings_on({PlannerFacts: facts}, last)
    by_file: dict[Path, list[Finding]] = {path: [] for path in paths}
    for found in dict.fromkeys(findings):
        by_file.setdefault(Path(found.file), []).append(found)
    return {path: sorted(found, key=lambda f: f.line or 0) for path, found in by_file.items()}


def _with_costmap(by_costmap: Mapping[CostmapName, Sequence[Finding]]) -> Iterator[Finding]:
    """Yield findings with the costmap's name where file and line do not identify the costmap."""
    for name, findings in by_costmap.items():
        twins = {found for key in by_costmap if key != name for found in by_costmap[key]}
        texts = {(found.check, found.message) for found in twins}
        for found in findings:
            is_twice = (found.check, found.message) in texts
            is_placed = found.line is not None or len(by_costmap) == 1
            if found.check in _ABOUT_FILES or (found in twins and is_placed):
                yield found
            elif name == "local" or is_twice or not is_placed:
                yield replace(found, message=f"{name} costmap: {found.message}")
            else:
                yield found


def first_robot(
    paths: Sequence[Path], *, costmap: CostmapName | None = None, namespace: str | None = None
) -> RobotParameters | None:
    names: tuple[CostmapName, ...] = ("global", "local") if costmap is None else (costmap,)
    for name in names:
        with suppress(MapdealError):
            candidate = _Costmap(name, *load_robot(paths, costmap=name, namespace=namespace))
            if candidate.robot is not None and not candidate.is_absent:
                return candidate.robot
    return None


def _check(
    paths: Sequence[Path], costmap: _Costmap, flavour: Flavour, namespace: str | None,
    sibling: RobotParameters | None, map_resolutions: Sequence[tuple[str, float]],
) -> Iterator[Finding]:  # fmt: skip
    if any(problem.check == _OTHER_KIND for problem in costmap.problems):
        return
    values = costmap_values(paths, flavour, costmap.name, _node_of(costmap, namespace), namespace)
    facts: dict[type, Any] = {
        ParameterFacts: ParameterFacts(
            flavour, costmap.name, values, _plugins(flavour, values, costmap.robot)
        )
    }
    if costmap.robot is not None and not costmap.is_absent:
        facts[RobotFacts] = RobotFacts(
            costmap.robot, facts[ParameterFacts], sibling, tuple(map_resolutions)
        )
        if flavour == "nav2":
            servers = filter_servers(read_ros2(paths))
            facts[FilterFacts] = FilterFacts(facts[RobotFacts], servers)
    yield from _findings_on(facts, str(paths[-1]))


def _findings_on(facts: Mapping[type, Any], file: str) -> Iterator[Finding]:
    """Yield the findings of all checks on facts; remarks without a place belong to `file`."""
    for item in CHECKS.values():
        item_facts = None if item.facts is None else facts.get(item.facts)
        for remark in () if item_facts is None else item.remarks(item_facts):
            if remark.at is None:
                yield item.finding(file, remark.message)
            else:
                yield item.finding(remark.at.source, remark.message, remark.at.line)


def _node_of(costmap: _Costmap, namespace: str | None) -> str:
    """Return the node's name of a Nav2 costmap, even if its robot is unusable."""
    if costmap.robot is not None:
        return costmap.robot.node
    name = f"{costmap.name}_costmap"
    return "/".join(["", *(part for part in (namespace or "").split("/") if part), name, name])


def _plugins(
    flavour: Flavour, values: Mapping[Name, ParameterValue], robot: RobotParameters | None
) -> tuple[tuple[str, str], ...]:
    """Return names and classes of the layers and filters, even if the robot is unusable."""
    if robot is not None:
        return tuple((listed.name, listed.plugin) for listed in robot.layers)

    def entries(key: str) -> Sequence[Any]:
        parameter = values.get((key,))
        is_list = parameter is not None and isinstance(parameter.value, list | tuple)
        return parameter.value if parameter is not None and is_list else ()

    if flavour == "ros1":
        mappings = [entry for entry in entries("plugins") if isinstance(entry, dict)]
        return tuple((str(m.get("name", "")), str(m.get("type", ""))) for m in mappings)
    names = [n for n in (*entries("plugins"), *entries("filters")) if isinstance(n, str)]
    classes = [values.get((name, "plugin")) for name in names]
    return tuple(
        (name, kind.value if kind is not None and isinstance(kind.value, str) else "")
        for name, kind in zip(names, classes, strict=True)
    )
