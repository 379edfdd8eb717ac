"""The values of a costmap in a robot's parameter files, before anything is made of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mapdeal.errors import MalformedInputError
from mapdeal.formats.ros_parameters.ros1 import Ros1Namespace
from mapdeal.formats.ros_parameters.ros2 import read_ros2
from mapdeal.formats.ros_parameters.value import ParameterValue
from mapdeal.robot.load import is_ros2
from mapdeal.robot.parameters import CostmapName, Flavour
from mapdeal.robot.ros1_server import costmaps_named, load_server

Name = tuple[str, ...]
"""A parameter's name below its costmap, in parts: ``("inflation_layer", "inflation_radius")``."""


def flavour_of(paths: Sequence[Path]) -> Flavour:
    """Return whose parameters files hold."""
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
    """Return the parameters of a costmap by their names in parts; none of files that have none.

    Footprint and radius of ROS 1 are those that are found in the namespaces above, too.
    """
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
