"""Reading a robot's parameters, whichever ROS they are of."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from mapdeal.errors import MalformedInputError, MapdealError, ParameterError, emit_warning
from mapdeal.files.source import exists, is_folder, read_file
from mapdeal.ros.nav2 import nav2_robot
from mapdeal.ros.robot import CostmapName, Flavour, ParameterValue, Problem, RobotParameters
from mapdeal.ros.ros1 import Ros1Namespace, costmaps_named, load_server, ros1_robot
from mapdeal.ros.ros2_files import read_ros2

_KEY = b"ros__parameters"
_LARGEST = 1 << 24
_OF_COSTS = frozenset(
    {"params.custom-inscribed-radius", "params.inflation-radius", "params.no-static-layer",
     "params.not-modelled", "params.old-plugins", "params.other-map", "params.erases-map"}
)  # fmt: skip
"""Warnings that matter to a robot's costs alone."""


def read_robot(
    paths: Sequence[Path], *, costmap: CostmapName = "global", namespace: str | None = None,
    older: bool = False, is_shape: bool = False,
) -> RobotParameters:  # fmt: skip
    robot, problems = found_in(paths, costmap=costmap, namespace=namespace, older=older)
    for one in problems:
        if one.level == "refused":
            raise _error_of(one, paths)
    if robot is None:
        raise MalformedInputError("holds no robot", source=paths[-1])
    warnings = [one for one in problems if one.level == "warning"]
    own = [one for one in warnings if not (is_shape and one.check in _OF_COSTS)]
    texts = tuple(_line_of(one, paths) for one in own)
    for text in texts:
        emit_warning(text, stacklevel=2)
    return replace(robot, remarks=texts)


def found_in(
    paths: Sequence[Path], *, costmap: CostmapName = "global", namespace: str | None = None,
    older: bool = False,
) -> tuple[RobotParameters | None, tuple[Problem, ...]]:  # fmt: skip
    """Return a robot, as far as its files allow, and all that there is to say of them."""
    if not paths:
        raise ParameterError("takes at least one file", place="params_files")
    of_ros2 = [path for path in paths if is_ros2(path)]
    if of_ros2 and len(of_ros2) < len(paths):
        other = next(path for path in paths if path not in of_ros2)
        rule = f"contains no parameters of ROS 2, but {of_ros2[0].name} does"
        raise ParameterError(rule, source=other, hint="pass the files of one robot")
    if of_ros2:
        return nav2_robot(paths, costmap=costmap, namespace=namespace, older=older)
    other_kind = next(filter(None, map(_other_kind, paths)), None)
    if other_kind is not None:
        return None, (other_kind,)
    return ros1_robot(paths, costmap=costmap, namespace=namespace)


def is_ros2(path: Path) -> bool:
    data = read_file(path, limit=_LARGEST)
    return any(_KEY in line.partition(b"#")[0] for line in data.splitlines())


def flavour_of_file(path: Path) -> Flavour | None:
    """Return the stack whose parameters a file holds; None for any other path."""
    from mapdeal.inputs.kinds import PARAMETERS, kind_of

    with suppress(MapdealError):
        kind = kind_of(path) if exists(path) and not is_folder(path) else None
        if kind is not None and kind.name == PARAMETERS:
            return "nav2" if is_ros2(path) else "ros1"
    return None


def _other_kind(path: Path) -> Problem | None:
    """Return the problem of a map, a recipe or the like, whose keys ROS 1 would take, too."""
    from mapdeal.inputs.kinds import PARAMETERS, kind_of, other_kind  # ROS 1's files alone need it

    kind = None
    with suppress(MapdealError):
        kind = kind_of(path)
    if kind is None or kind.name == PARAMETERS:
        return None
    error = other_kind(path, kind, "a file of ROS parameters")
    return Problem("params.other-kind", "refused", error.rule, source=path, hint=error.hint)


def _error_of(one: Problem, paths: Sequence[Path]) -> MalformedInputError:
    place = f"line {one.line}" if one.line is not None else None
    if one.parameter:
        place = f"{one.parameter} ({place})" if place else one.parameter
    extra = {} if one.got is None else {"got": one.got}
    return MalformedInputError(
        one.text, source=one.source or paths[-1], place=place, hint=one.hint, **extra
    )


def _line_of(one: Problem, paths: Sequence[Path]) -> str:
    text = str(one.source or paths[-1])
    if one.line is not None:
        text += f":{one.line}"
    text += f": {one.parameter}: {one.text}" if one.parameter else f": {one.text}"
    return f"{text}; {one.hint}" if one.hint else text


Name = tuple[str, ...]
"""A parameter's name below its costmap, in parts: ``("inflation_layer", "inflation_radius")``."""


def flavour_of(paths: Sequence[Path]) -> Flavour:
    return "nav2" if any(is_ros2(path) for path in paths) else "ros1"


def costmaps_in(
    paths: Sequence[Path], flavour: Flavour, namespace: str | None
) -> tuple[CostmapName, ...]:
    """Return the costmaps to look at: those of ROS 1 that files are of, and of Nav2 both."""
    if flavour == "nav2":
        return ("global", "local")
    server, _ = load_server(paths, "global", namespace)
    return costmaps_named(server.files) or ("global",)


def costmap_values(
    paths: Sequence[Path], flavour: Flavour, costmap: CostmapName, node: str, namespace: str | None
) -> dict[Name, ParameterValue]:
    # Footprint and radius of ROS 1 are those that are found in the namespaces above, too.
    if flavour == "nav2":
        try:
            found = read_ros2(paths).for_node(node)
        except MalformedInputError:  # which the robot's problems tell
            return {}
        return {tuple(name.split(".")): value for name, value in found.items()}
    server, _ = load_server(paths, costmap, namespace)
    own = server.root.get(server.path)
    values = dict(own.values()) if isinstance(own, Ros1Namespace) else {}
    for name in ("footprint", "robot_radius"):
        above = server.search(name)
        if above is not None and isinstance(above[1], ParameterValue):
            values[(name,)] = above[1]
    return values
