"""Checks of names in Nav2's parameter files: of older releases, and misspelt ones of planners.

References
----------
navigation2, ``ObstacleLayer::onInitialize``: since Galactic, ranges have a minimum and a maximum.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from difflib import get_close_matches
from itertools import islice
from pathlib import Path

from mapdeal.checks.facts import ParameterFacts, PlannerFacts, check
from mapdeal.checks.findings import CHECKS, Finding, Remark
from mapdeal.errors import MalformedInputError
from mapdeal.ros.planners import (
    DEFAULT_PLANNERS,
    PLANNER_PARAMETERS,
    PLANNER_SERVER,
    SERVER_PARAMETERS,
)
from mapdeal.ros.robot import ParameterValue
from mapdeal.ros.ros2_files import read_ros2

_RENAMED = {
    "obstacle_range": ("obstacle_max_range", 2.5), "raytrace_range": ("raytrace_max_range", 3.0)
}  # fmt: skip
"""Names that Nav2 has changed, the new ones, and their defaults, metres."""

_OBSTACLE_LAYERS = ("ObstacleLayer", "VoxelLayer")
_ALIKE = 0.85
_MOST_NAMES, _LONGEST_NAME = 1000, 60
"""Names that are compared with all known ones, and the characters that they may have."""


@check("params.renamed", "warning", "a name that Nav2 has changed, and no longer reads")
def renamed(facts: ParameterFacts) -> Iterator[Remark]:
    """Look in obstacle layers and the costmap: layers of other packages have such names, too."""
    own = {name for name, plugin in facts.plugins if _class_name(plugin) in _OBSTACLE_LAYERS}
    for path, value in facts.values.items() if facts.flavour == "nav2" else ():
        if path[-1] not in _RENAMED or (len(path) > 1 and path[0] not in own):
            continue
        name, default = _RENAMED[path[-1]]
        if (*path[:-1], name) not in facts.values:
            text = f"{facts.shown(*path)} has no effect since Galactic, and {name} is {default:g} m"
            yield Remark(f"{text} by default: write {name}", at=value)


@check("params.planner-misspelt", "warning",
       "a name in a planner's section that is nearly that of a parameter")  # fmt: skip
def planner_misspelt(facts: PlannerFacts) -> Iterator[Remark]:
    classes = _planner_classes(facts.values)
    of_any = {name for known in PLANNER_PARAMETERS.values() for name in known}
    unlisted: dict[str, ParameterValue] = {}
    for name, value in islice(facts.values.items(), _MOST_NAMES):
        section, _, parameter = name.partition(".")
        if parameter and section not in classes:
            unlisted.setdefault(section, value)
            continue
        own = PLANNER_PARAMETERS.get(classes[section], {}) if parameter else SERVER_PARAMETERS
        above, _, last = (parameter or name).rpartition(".")
        known = {one.rpartition(".")[2] for one in own if one.rpartition(".")[0] == above}
        near = None if parameter in of_any else _near(last, known | {"plugin"})
        if near and f"{name.removesuffix(last)}{near}" not in facts.values:
            yield Remark(f"no parameter is called {name}: did you mean {near}?", at=value)
    for section, value in unlisted.items():
        near = _near(section, classes)
        if near:
            yield Remark(f"no planner is called {section}: did you mean {near}?", at=value)


def _near(name: str, known: Collection[str]) -> str | None:
    """Return the known name that a name is nearly; None if it is known, or is like none."""
    if name in known or len(name) > _LONGEST_NAME:
        return None
    return next(iter(get_close_matches(name, known, n=1, cutoff=_ALIKE)), None)


def _planner_classes(values: Mapping[str, ParameterValue]) -> dict[str, str]:
    """Return the class of each planner of a server by the planner's name, without its package."""
    listed = values.get("planner_plugins")
    names = DEFAULT_PLANNERS if listed is None else listed.value
    classes = {}
    for name in names if isinstance(names, Mapping | tuple | list) else ():
        given = values.get(f"{name}.plugin")
        plugin = DEFAULT_PLANNERS.get(name, "") if given is None else str(given.value)
        classes[str(name)] = _class_name(plugin)
    return classes


def _class_name(plugin: str) -> str:
    return plugin.replace("/", "::").rpartition("::")[2]


def planner_findings(paths: Sequence[Path]) -> Iterator[Finding]:
    """Yield what checks find in the sections of planner servers in Nav2's files."""
    try:
        parameters = read_ros2(paths)
    except MalformedInputError:  # reported with the costmaps
        return
    for node in parameters.nodes:
        if node.name.rpartition("/")[2] != PLANNER_SERVER:
            continue
        facts = PlannerFacts(parameters.for_node(node.name))
        for known in CHECKS.values():
            for remark in known.remarks(facts) if known.facts is PlannerFacts else ():
                if remark.at is not None:
                    yield known.finding(remark.at.source, remark.message, remark.at.line)
