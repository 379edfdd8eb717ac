"""Checks of names in Nav2's parameter files: of older releases, and parameters of planners.

References
----------
navigation2, ``ObstacleLayer::onInitialize``: since Galactic, ranges have a minimum and a maximum.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from difflib import get_close_matches
from itertools import islice

from mapdeal.checks.facts import ParameterFacts, PlannerFacts, check
from mapdeal.checks.findings import Remark
from mapdeal.ros.planners import (
    PLANNER_PARAMETERS,
    PLANNER_SERVER,
    SERVER_PARAMETERS,
    class_of,
    plugins_in,
)
from mapdeal.ros.robot import ParameterValue
from mapdeal.ros.ros2_files import Ros2Parameters

_RENAMED = {
    "obstacle_range": ("obstacle_max_range", 2.5), "raytrace_range": ("raytrace_max_range", 3.0)
}  # fmt: skip
"""Renamed parameters of Nav2: the old names, the new ones and their defaults, metres."""

_OBSTACLE_LAYERS = ("ObstacleLayer", "VoxelLayer")
_LEAST_SIMILARITY = 0.85
_MOST_NAMES, _LONGEST_NAME = 1000, 60
"""Limits of the search for misspelt names, which compares each name with all known ones."""


@check("params.renamed", "warning")
def renamed(facts: ParameterFacts) -> Iterator[Remark]:
    """A parameter that Nav2 has renamed.

    Nav2 ignores the old name and uses the default: the robot sees obstacles later or earlier than
    set.
    Example: `obstacle_layer: {obstacle_range: 5.0}`.
    Fix: Write the new name.
    """
    layers = {name for name, plugin in facts.plugins if class_of(plugin) in _OBSTACLE_LAYERS}
    for path, value in facts.values.items() if facts.flavour == "nav2" else ():
        if path[-1] not in _RENAMED or (len(path) > 1 and path[0] not in layers):
            continue
        name, default = _RENAMED[path[-1]]
        if (*path[:-1], name) not in facts.values:
            text = f"{facts.label(*path)} has no effect since Galactic, and {name} is {default:g} m"
            yield Remark(f"{text} by default: write {name}", at=value)


@check("params.planner-misspelt", "warning")
def planner_misspelt(facts: PlannerFacts) -> Iterator[Remark]:
    """A misspelt parameter of a planner.

    Nav2 ignores it and plans with the default.
    Example: `planner_server: {ros__parameters: {planner_plugins: [GridBased], GridBased: {plugin:
    "nav2_navfn_planner::NavfnPlanner", tolerances: 0.5}}}`.
    Fix: Write the name that the message proposes.
    """
    plugins = plugins_in(facts.values)
    classes = {name: class_of(plugin) for name, plugin in plugins.items()}
    of_any_planner = set().union(*PLANNER_PARAMETERS.values())
    unlisted: dict[str, ParameterValue] = {}
    for name, value in islice(facts.values.items(), _MOST_NAMES):
        section, _, parameter = name.partition(".")
        if parameter and section not in classes:
            unlisted.setdefault(section, value)
            continue
        declared = PLANNER_PARAMETERS.get(classes[section], {}) if parameter else SERVER_PARAMETERS
        parent, _, last = (parameter or name).rpartition(".")
        paths = [declared_name.rpartition(".") for declared_name in declared]
        siblings = {"plugin", *(path[2] for path in paths if path[0] == parent)}
        closest = None if parameter in of_any_planner else _misspelt_name(last, siblings)
        if closest and f"{name.removesuffix(last)}{closest}" not in facts.values:
            yield Remark(f"no parameter is called {name}: did you mean {closest}?", at=value)
    for section, value in unlisted.items():
        closest = _misspelt_name(section, classes)
        if closest:
            yield Remark(f"no planner is called {section}: did you mean {closest}?", at=value)


@check("params.planner-without-effect", "warning")
def planner_without_effect(facts: PlannerFacts) -> Iterator[Remark]:
    """A parameter that only planners of another class declare.

    Nav2 ignores it: the robot plans as if the line were missing.
    Example: `planner_server: {ros__parameters: {planner_plugins: [GridBased], GridBased: {plugin:
    "nav2_navfn_planner::NavfnPlanner", minimum_turning_radius: 0.4}}}`.
    Fix: Remove the line, or choose a planner that declares it.
    """
    for section, plugin in plugins_in(facts.values).items():
        declared = PLANNER_PARAMETERS.get(class_of(plugin))
        for name, value in facts.values.items() if declared is not None else ():
            parameter = name.removeprefix(f"{section}.")
            owners = [kind for kind, names in PLANNER_PARAMETERS.items() if parameter in names]
            if name != parameter and owners and parameter not in (declared or ()):
                text = f"{class_of(plugin)} does not declare {parameter}: it has no effect"
                yield Remark(f"{text}; {' and '.join(owners)} would read it", at=value)


@check("params.planner-tolerance", "warning")
def planner_tolerance(facts: PlannerFacts) -> Iterator[Remark]:
    """A planner's tolerance above 0 that is less than a cell.

    A goal in an obstacle fails as it does with a tolerance of 0.
    Example: `planner_server: {ros__parameters: {planner_plugins: [GridBased], GridBased: {plugin:
    "nav2_navfn_planner::NavfnPlanner", tolerance: 0.01}}}`.
    Fix: Write at least the side of a cell, or 0.0.
    """
    for section in plugins_in(facts.values):
        value = facts.values.get(f"{section}.tolerance")
        if value is not None and value.kind == "double" and 0 < value.value < facts.resolution:
            text = f"less than a cell of {facts.resolution:g} m: it allows no other place than the "
            yield Remark(f"{text}goal's; write {facts.resolution:g} or more, or 0.0", at=value)


def _misspelt_name(name: str, known: Collection[str]) -> str | None:
    if name in known or len(name) > _LONGEST_NAME:
        return None
    return next(iter(get_close_matches(name, known, n=1, cutoff=_LEAST_SIMILARITY)), None)


def planner_facts(parameters: Ros2Parameters, resolution: float) -> Iterator[PlannerFacts]:
    for node in parameters.nodes:
        if node.name.rpartition("/")[2] == PLANNER_SERVER:
            yield PlannerFacts(parameters.for_node(node.name), resolution)
