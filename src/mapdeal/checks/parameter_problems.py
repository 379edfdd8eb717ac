"""The checks whose findings come up while a robot's parameter files are read."""

from __future__ import annotations

from mapdeal.checks.finding import CHECKS, Finding, Severity, declare_check
from mapdeal.formats.ros_parameters.problem import Problem

_SEVERITIES: dict[str, Severity] = {"refused": "error", "warning": "warning", "note": "note"}

declare_check("params.syntax", "error", "a parameter file that ROS cannot read")
declare_check("params.other-kind", "error", "a file of another kind, such as a map or a recipe")
declare_check("params.empty", "error", "a parameter without a value, at which roslaunch ends")
declare_check("params.name", "error", "a name that is not text")
declare_check("params.type", "error", "a value of a type that ROS refuses")
declare_check(
    "params.silent-default",
    "warning",
    "a value of a wrong type in ROS 1, which silently takes its default, or rounds a number",
)
declare_check(
    "params.sensor-type", "warning", "a value of a layer of sensors, of a type that Nav2 refuses"
)
declare_check("params.not-finite", "error", "a number that is not finite")
declare_check("params.not-positive", "error", "a number that must be above 0, or not below it")
declare_check(
    "params.range",
    "warning",
    "a number out of its range, which ROS moves into it, or takes as it is",
)
declare_check("params.substitution", "error", "a value that a launch file would fill in")
declare_check("params.namespace", "error", "no costmap of the name that is asked for, or several")
declare_check(
    "params.other-costmap", "warning", "a file of ROS 1 that is left out, as one of another costmap"
)
declare_check("params.footprint", "error", "a footprint that ROS refuses")
declare_check("params.footprint-unused", "warning", "a footprint that ROS passes over")
declare_check(
    "params.outline", "warning", "a footprint that crosses itself, or is not around (0, 0)"
)
declare_check("params.no-shape", "warning", "neither a footprint nor a radius")
declare_check("params.too-large", "error", "a footprint that reaches farther than a kilometre")
declare_check("params.plugins", "error", "layers that cannot be loaded")
declare_check(
    "params.not-modelled", "warning", "a layer that mapdeal does not know, and leaves out"
)
declare_check(
    "params.footprint-clearing", "note", "a static layer that frees the cells below the robot"
)
declare_check(
    "params.inflation-radius", "error", "an inflation radius below the robot's inscribed radius"
)
declare_check(
    "params.custom-inscribed-radius", "warning", "an inscribed radius that is not the footprint's"
)
declare_check(
    "params.asymmetric", "note", "inflation that depends on the path, which a map does not have"
)
declare_check(
    "params.no-static-layer", "warning", "a global costmap whose layers do not read the map"
)
declare_check(
    "params.other-map", "warning", "static layers that read different maps: all get the one here"
)
declare_check("params.only-namespace", "warning", "a robot in a namespace that was not asked for")
declare_check("params.no-node", "error", "a Nav2 file that says nothing of the costmap")
declare_check(
    "params.one-level",
    "error",
    "a costmap of Nav2 that is not nested twice, and so applies to no node",
)
declare_check("params.hidden", "warning", "a later value that ROS 2 ignores for its type")
declare_check("params.overridden", "warning", "a value that another one takes the place of")
declare_check("params.twice", "warning", "a key given twice, with different values")
declare_check("params.repeated", "note", "a key given twice, with one value")


def finding_of(problem: Problem, file: str) -> Finding:
    """Return a problem of a robot's parameters as a finding."""
    message = f"{problem.parameter}: {problem.text}" if problem.parameter else problem.text
    if problem.got is not None:
        message += f", got {_short(problem.got)}"
    if problem.hint is not None:
        message += f"; {problem.hint}"
    source = file if problem.source is None else str(problem.source)
    known = CHECKS.get(problem.check)
    severity = _SEVERITIES[problem.level] if known is None else known.severity
    return Finding(problem.check, severity, source, message, problem.line)


def _short(text: str, limit: int = 60) -> str:
    one = " ".join(text.split())
    return one if len(one) <= limit else one[: limit - 3] + "..."
