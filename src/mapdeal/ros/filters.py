"""Costmap filters in parameter files of Nav2: write them for masks, read them for checks.

A filter needs three nodes that agree: a map_server for the mask, a ``costmap_filter_info_server``
that publishes the mask's type and scale, and a lifecycle manager that activates both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mapdeal.grid.filters import FilterInfo, FilterKind
from mapdeal.records import dataclass
from mapdeal.ros import robot, ros2_files

_EXTRA_PARAMETERS: dict[FilterKind, str] = {
    "keepout": "",
    "speed": '        speed_limit_topic: "/speed_limit"\n',
    "binary": "        default_state: false\n"
    '        binary_state_topic: "/binary_state"\n'
    "        flip_threshold: 50.0\n",
}
MANAGER = "lifecycle_manager_costmap_filters"


def servers_of(kind: FilterKind) -> tuple[str, str]:
    return f"{kind}_filter_mask_server", f"{kind}_costmap_filter_info_server"


def filter_parameters(infos: Sequence[FilterInfo]) -> str:
    # Topics are absolute: Humble resolves relative topics in the costmap's namespace, newer
    # releases in the namespace above it.
    kinds = [info.kind for info in infos]
    nodes = [node for kind in kinds for node in servers_of(kind)]
    parts = ["# The servers of the masks. The launch file beside this one adds yaml_filename.\n"]
    for info in infos:
        mask_server, info_server = servers_of(info.kind)
        parts.append(f"""\
{mask_server}:
  ros__parameters:
    topic_name: "/{info.kind}_filter_mask"

{info_server}:
  ros__parameters:
    type: {info.type}
    filter_info_topic: "/{info.kind}_costmap_filter_info"
    mask_topic: "/{info.kind}_filter_mask"
    base: {float(info.base)!r}
    multiplier: {float(info.multiplier)!r}
""")
    node_names = ", ".join(f'"{node}"' for node in nodes)
    parts.append(f"{MANAGER}:\n  ros__parameters:\n    autostart: true\n")
    parts[-1] += f"    node_names: [{node_names}]\n"
    parts.append("# The filters, for the costmaps of the robot's own parameter file.\n")
    for costmap in ("global", "local"):
        costmap_kinds = [kind for kind in kinds if costmap == "global" or kind == "keepout"]
        if costmap_kinds:
            parts.append(_costmap(costmap, costmap_kinds))
    return "\n".join(parts)


def _costmap(costmap: str, kinds: Sequence[FilterKind]) -> str:
    listed = ", ".join(f'"{kind}_filter"' for kind in kinds)
    text = f"{costmap}_costmap:\n  {costmap}_costmap:\n    ros__parameters:\n"
    text += f"      filters: [{listed}]\n"
    for kind in kinds:
        text += f"""\
      {kind}_filter:
        plugin: "nav2_costmap_2d::{kind.capitalize()}Filter"
        enabled: true
        filter_info_topic: "/{kind}_costmap_filter_info"
        transform_tolerance: 0.1
{_EXTRA_PARAMETERS[kind]}"""
    return text


def filter_launch(kinds: Sequence[FilterKind], parameters: str, masks: Sequence[str]) -> str:
    """Return a launch file for the servers; parameters and masks are file names beside it."""
    nodes = ""
    for kind, mask in zip(kinds, masks, strict=True):
        mask_server, info_server = servers_of(kind)
        nodes += f"""\
            Node(
                package="nav2_map_server",
                executable="map_server",
                name="{mask_server}",
                parameters=[parameters, clock, {{"yaml_filename": str(FOLDER / "{mask}")}}],
                output="screen",
            ),
            Node(
                package="nav2_map_server",
                executable="costmap_filter_info_server",
                name="{info_server}",
                parameters=[parameters, clock],
                output="screen",
            ),
"""
    return f'''\
"""Start the servers of the costmap filters."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

FOLDER = Path(__file__).parent


def generate_launch_description():
    parameters = str(FOLDER / "{parameters}")
    clock = {{"use_sim_time": LaunchConfiguration("use_sim_time")}}
    return LaunchDescription(
        [
            DeclareLaunchArgument("use_sim_time", default_value="false"),
{nodes}\
            Node(
                package="nav2_lifecycle_manager",
                executable="lifecycle_manager",
                name="{MANAGER}",
                parameters=[parameters, clock],
                output="screen",
            ),
        ]
    )
'''


@dataclass(frozen=True)
class InfoServer:
    name: str
    values: Mapping[str, robot.ParameterValue]

    def get(self, name: str, default: object = None) -> object:
        parameter = self.values.get(name)
        return default if parameter is None else parameter.value

    @property
    def info_topic(self) -> object:
        return self.get("filter_info_topic", "costmap_filter_info")

    @property
    def first(self) -> robot.ParameterValue:
        """The value whose line stands for the whole node in findings."""
        return next(iter(self.values.values()))


@dataclass(frozen=True)
class FilterServers:  # as parameter files list them
    info: tuple[InfoServer, ...]
    mask_topics: tuple[str, ...]
    managed: tuple[str, ...]  # names of the nodes that lifecycle managers in the files activate


def filter_servers(parameters: ros2_files.Ros2Parameters) -> FilterServers:
    names = [node.name for node in parameters.nodes if "*" not in node.name]
    nodes = [InfoServer(name, parameters.for_node(name)) for name in names]
    info = tuple(node for node in nodes if "mask_topic" in node.values)
    topics = tuple(str(node.get("topic_name")) for node in nodes if "topic_name" in node.values)
    managed = [node.get("node_names") for node in nodes]
    managed_names = (name for names in managed if isinstance(names, tuple) for name in names)
    return FilterServers(info, topics, tuple(map(str, managed_names)))


def topic_of(text: object) -> str:
    """Return a topic without outer slashes: relative topics are compared as absolute ones."""
    return str(text).strip("/")
