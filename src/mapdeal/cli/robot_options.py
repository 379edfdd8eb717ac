"""What options say of a robot: its shape, or its own parameter files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mapdeal.cli import terminal
from mapdeal.errors import ParameterError
from mapdeal.grid.footprint import Footprint
from mapdeal.maps.map_yaml import Dialect
from mapdeal.ros.robot import INJECTED, CostmapName, RobotParameters


def robot_shape(
    *,
    footprint: str | None,
    robot_radius: float | None,
    footprint_padding: float,
    robot_16_gon: bool | None = None,
) -> Footprint | None:
    """Return the robot's shape that the options describe, if they do.

    A command that has no option for it takes a round robot as a polygon of 16 corners, always.
    """
    if robot_16_gon and robot_radius is None:
        raise ParameterError("needs --robot-radius", source="--robot-16-gon")
    if footprint is not None and robot_radius is not None:
        rule = "cannot be given together with --robot-radius"
        raise ParameterError(rule, source="--footprint")
    if footprint is not None:
        return Footprint.parse(footprint).padded(footprint_padding)
    if robot_radius is not None:
        make = Footprint.circle if robot_16_gon is False else Footprint.sixteen_gon
        return make(robot_radius).padded(footprint_padding)
    if footprint_padding:
        rule = "needs --footprint or --robot-radius"
        raise ParameterError(rule, source="--footprint-padding")
    return None


def robot_parameters(
    *,
    params_file: Sequence[Path] | None,
    costmap: CostmapName | None,
    namespace: str | None,
    dialect: Dialect,
    is_shape: bool = False,
) -> RobotParameters | None:
    """Return the robot that parameter files describe, if there are any, and say what is ignored.

    Readers older than today's Nav2 stand for its older costmap, too. Nothing is said of layers to
    those who want no more than the shape.
    """
    if not params_file:
        for option, value in (("--costmap", costmap), ("--namespace", namespace)):
            if value is not None:
                raise ParameterError("needs --params-file", source=option)
        return None
    from mapdeal.ros.load import read_robot  # few commands read one

    robot = read_robot(
        params_file,
        costmap=costmap or "global",
        namespace=namespace,
        older=dialect != "nav2",
        is_shape=is_shape,
    )
    terminal.detail(f"robot: {robot!r}")
    if not is_shape and any(one.name == INJECTED for one in robot.layers):
        text = "the local costmap has no static layer; the map is put in front of its layers"
        terminal.remark([f"{params_file[-1]}: {text}"])
    ignored = [f"{one.name} ({one.why_ignored})" for one in robot.ignored]
    if ignored and not is_shape:
        terminal.remark([f"{params_file[-1]}: ignored: {', '.join(ignored)}"])
    return robot
