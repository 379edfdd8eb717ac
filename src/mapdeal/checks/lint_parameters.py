"""All checks on a robot's parameter files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from mapdeal.checks import layer_checks, robot_checks  # noqa: F401
from mapdeal.checks.finding import CHECKS, Check, Finding, Remark
from mapdeal.checks.parameter_facts import ParameterFacts, RobotFacts
from mapdeal.checks.parameter_problems import finding_of
from mapdeal.errors import MapdealError
from mapdeal.formats.ros_parameters.problem import Problem
from mapdeal.formats.ros_parameters.value import ParameterValue

# The modules of checks: importing one adds its checks to the list.
from mapdeal.records import dataclass
from mapdeal.robot.load import found_in
from mapdeal.robot.parameters import CostmapName, Flavour, RobotParameters
from mapdeal.robot.values import Name, costmap_values, costmaps_in, flavour_of

_ONE_LEVEL = "params.one-level"
_NOT_THERE = ("params.namespace", "params.no-node", _ONE_LEVEL)
_OTHER_KIND = "params.other-kind"
"""A file of which no name and no value is a parameter."""
_OF_THE_OTHER = "params.other-costmap"
"""A file that one costmap leaves out is one of the other's, if both are looked at."""


@dataclass(frozen=True)
class _Costmap:
    """One costmap of the files: the robot, if it resolves, and all that was found while reading."""

    name: CostmapName
    robot: RobotParameters | None
    problems: tuple[Problem, ...]


def lint_parameters(
    paths: Sequence[Path],
    *,
    costmap: CostmapName | None = None,
    namespace: str | None = None,
    map_resolutions: Sequence[tuple[str, float]] = (),
) -> dict[Path, list[Finding]]:
    """Return what all checks find in a robot's parameter files, by file, line by line."""
    flavour = flavour_of(paths)
    names = costmaps_in(paths, flavour, namespace) if costmap is None else (costmap,)
    looked_at = [_resolve(paths, one, namespace) for one in names]
    present = [one for one in looked_at if not _is_absent(one) or _is_misplaced(one)]
    present = present or looked_at[:1]
    findings: list[Finding] = []
    last = str(paths[-1])
    for index, one in enumerate(present):
        other = present[1].robot if index == 0 and len(present) > 1 else None
        told = [one for one in one.problems if len(present) == 1 or one.check != _OF_THE_OTHER]
        own = [finding_of(problem, last) for problem in told]
        own += _checked(paths, one, flavour, namespace, other, map_resolutions)
        findings += [_named(found, one, len(present)) for found in own]
    by_file: dict[Path, list[Finding]] = {path: [] for path in paths}
    for found in dict.fromkeys(findings):
        by_file.setdefault(Path(found.file), []).append(found)
    return {path: sorted(found, key=lambda f: f.line or 0) for path, found in by_file.items()}


def robot_in(
    paths: Sequence[Path], *, costmap: CostmapName | None = None, namespace: str | None = None
) -> RobotParameters | None:
    """Return the robot of parameter files, as its global costmap has it if there are both."""
    names: tuple[CostmapName, ...] = ("global", "local") if costmap is None else (costmap,)
    for name in names:
        with suppress(MapdealError):
            one = _resolve(paths, name, namespace)
            if one.robot is not None and not _is_absent(one):
                return one.robot
    return None


def _resolve(paths: Sequence[Path], costmap: CostmapName, namespace: str | None) -> _Costmap:
    robot, problems = found_in(paths, costmap=costmap, namespace=namespace)
    return _Costmap(costmap, robot, problems)


def _is_absent(one: _Costmap) -> bool:
    """Return whether the files say nothing of a costmap."""
    return any(p.check in _NOT_THERE and p.level == "refused" for p in one.problems)


def _is_misplaced(one: _Costmap) -> bool:
    """Return whether the files mean to say something of a costmap, at the wrong level."""
    return any(problem.check == _ONE_LEVEL for problem in one.problems)


def _named(found: Finding, one: _Costmap, count: int) -> Finding:
    """Return a finding that names its costmap, where a line does not and there are two."""
    if found.line is not None or count == 1:
        return found
    return replace(found, message=f"{one.name} costmap: {found.message}")


def _checked(
    paths: Sequence[Path],
    one: _Costmap,
    flavour: Flavour,
    namespace: str | None,
    other: RobotParameters | None,
    map_resolutions: Sequence[tuple[str, float]],
) -> Iterator[Finding]:
    """Yield what the checks find that look at values and robots."""
    if any(problem.check == _OTHER_KIND for problem in one.problems):
        return
    values = costmap_values(paths, flavour, one.name, _node_of(one, namespace), namespace)
    facts: dict[type, Any] = {
        ParameterFacts: ParameterFacts(
            flavour, one.name, values, _plugins(flavour, values, one.robot)
        )
    }
    if one.robot is not None and not _is_absent(one):
        facts[RobotFacts] = RobotFacts(
            one.robot, facts[ParameterFacts], other, tuple(map_resolutions)
        )
    for check in CHECKS.values():
        if check.facts in facts:
            yield from _findings_of(check, facts[check.facts], str(paths[-1]))


def _node_of(one: _Costmap, namespace: str | None) -> str:
    """Return the name of the node of a costmap of Nav2, also of one that does not resolve."""
    if one.robot is not None:
        return one.robot.node
    name = f"{one.name}_costmap"
    return "/".join(["", *(part for part in (namespace or "").split("/") if part), name, name])


def _findings_of(check: Check, facts: Any, file: str) -> Iterator[Finding]:
    for found in check.run(facts) if check.run is not None else ():
        remark = found if isinstance(found, Remark) else Remark(found)
        source, line = (
            (file, None) if remark.at is None else (str(remark.at.source), remark.at.line)
        )
        yield Finding(check.name, check.severity, source, remark.message, line)


def _plugins(
    flavour: Flavour, values: Mapping[Name, ParameterValue], robot: RobotParameters | None
) -> tuple[tuple[str, str], ...]:
    """Return names and classes of the layers and filters, of a robot that does not resolve, too."""
    if robot is not None:
        return tuple((one.name, one.plugin) for one in robot.layers)
    listed = values.get(("plugins",))
    entries = listed.value if listed is not None and isinstance(listed.value, list | tuple) else ()
    if flavour == "ros1":
        return tuple(
            (str(one.get("name", "")), str(one.get("type", "")))
            for one in entries
            if isinstance(one, dict)
        )
    filters = values.get(("filters",))
    more = filters.value if filters is not None and isinstance(filters.value, tuple) else ()
    names = [one for one in (*entries, *more) if isinstance(one, str)]
    return tuple((name, _class_in(values, name)) for name in names)


def _class_in(values: Mapping[Name, ParameterValue], name: str) -> str:
    plugin = values.get((name, "plugin"))
    return plugin.value if plugin is not None and isinstance(plugin.value, str) else ""
