"""Parameters that Nav2's planner server and its planners declare, with their defaults.

A parameter's default also gives its type: ROS 2 refuses values of another type.

References
----------
navigation2, branches humble to main: nav2_planner, nav2_navfn_planner, nav2_smac_planner (with
``SmootherParams`` of smoother.hpp) and nav2_theta_star_planner. Defaults are those of main.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mapdeal.planners.planner import Default, Planner, planner_classes
from mapdeal.planners.smac_2d import SMAC
from mapdeal.records import dataclass, field
from mapdeal.ros import nav2, ros2_files
from mapdeal.ros.robot import ParameterValue, Problem, RobotParameters

PLANNER_SERVER = "planner_server"

SERVER_PARAMETERS: Mapping[str, Default] = {
    "planner_plugins": ("GridBased",), "expected_planner_frequency": 1.0,
    "costmap_update_timeout": 1.0, "allow_partial_planning": False,
    "action_server_result_timeout": 10.0, "introspection_mode": "disabled",
    "bond_heartbeat_period": 0.25, "use_sim_time": False,
}  # fmt: skip
# Names and classes of the planners of a server without ``planner_plugins``.
DEFAULT_PLANNERS: Mapping[str, str] = {"GridBased": "nav2_navfn_planner::NavfnPlanner"}
_SMAC_WITH_HEADINGS: Mapping[str, Default] = {
    **SMAC,
    "smooth_path": True, "cache_obstacle_heuristic": False, "reverse_penalty": 2.0,
    "change_penalty": 0.0, "non_straight_penalty": 1.2, "cost_penalty": 2.0,
    "retrospective_penalty": 0.015, "analytic_expansion_ratio": 3.5,
    "analytic_expansion_max_cost": 200.0, "analytic_expansion_max_cost_override": False,
    "analytic_expansion_max_length": 3.0, "lookup_table_size": 20.0,
    "debug_visualizations": False, "goal_heading_mode": "DEFAULT", "coarse_search_resolution": 1,
    "use_quadratic_cost_penalty": False, "downsample_obstacle_heuristic": True,
}  # fmt: skip


def full_name(plugin: str) -> str:
    """Return the name of a plugin's class as C++ writes it."""
    return plugin.replace("/", "::")


# Parameters below a planner's name. ``lattice_filepath`` has a file of Nav2 as its default.
PLANNER_PARAMETERS: Mapping[str, Mapping[str, Default]] = {
    "nav2_smac_planner::SmacPlannerHybrid": {
        **_SMAC_WITH_HEADINGS, "downsample_costmap": False, "downsampling_factor": 1,
        "angle_quantization_bins": 72, "minimum_turning_radius": 0.4,
        "motion_model_for_search": "DUBIN", "allow_primitive_interpolation": True,
    },
    "nav2_smac_planner::SmacPlannerLattice": {
        **_SMAC_WITH_HEADINGS, "change_penalty": 0.05, "non_straight_penalty": 1.05,
        "rotation_penalty": 5.0, "allow_reverse_expansion": False, "lattice_filepath": "",
    },
    **{full_name(plugin): planner.parameters for plugin, planner in planner_classes().items()},
}  # fmt: skip
# Names that some release declares and that paths of main do not depend on.
OTHER_NAMES: Mapping[str, frozenset[str]] = {
    PLANNER_SERVER: frozenset({
        "allow_parameter_qos_overrides", "autostart_node", "service_introspection_mode",
        "start_type_description_service",
    }),
    "nav2_smac_planner::SmacPlanner2D": frozenset({"motion_model_for_search"}),
    "nav2_smac_planner::SmacPlannerHybrid": frozenset({"viz_expansions"}),
    "nav2_smac_planner::SmacPlannerLattice": frozenset({"viz_expansions"}),
    "nav2_theta_star_planner::ThetaStarPlanner": frozenset({"w_heuristic_cost"}),
}  # fmt: skip
_KINDS = {bool: "bool", int: "integer", float: "double", str: "string", tuple: "string_array"}


@dataclass(frozen=True)
class ListedPlanner:
    """A planner in a server's list; without a model if mapdeal does not compute its plans."""

    name: str
    plugin: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    planner: Planner | None = None


def plugins_in(values: Mapping[str, ParameterValue]) -> dict[str, str]:
    """Return the class of each planner in the parameters of a server, empty if it has none."""
    listed = values.get("planner_plugins")
    names = tuple(DEFAULT_PLANNERS) if listed is None else listed.value
    classes = {name: values.get(f"{name}.plugin") for name in names if isinstance(names, tuple)}
    return {
        str(name): DEFAULT_PLANNERS.get(name, "") if plugin is None else str(plugin.value)
        for name, plugin in classes.items()
    }


def has_server(parameters: ros2_files.Ros2Parameters) -> bool:
    return any(node.name.endswith(f"/{PLANNER_SERVER}") for node in parameters.nodes)


def planners_of(
    robot: RobotParameters, parameters: ros2_files.Ros2Parameters | None = None
) -> tuple[tuple[ListedPlanner, ...], tuple[Problem, ...]]:
    parameters = parameters or ros2_files.read_ros2(robot.paths)
    node = f"{robot.node.removesuffix('/global_costmap/global_costmap')}/{PLANNER_SERVER}"
    values = nav2.Nav2Values(parameters.for_node(node), node, robot.paths[-1], up_to_kilted=False)
    for name, default in SERVER_PARAMETERS.items():
        values.get(name, _KINDS[type(default)], default)
    plugins = plugins_in(values.parameters).items()
    listed = tuple(_listed_planner(values, name, plugin) for name, plugin in plugins)
    return listed, tuple(values.problems)


def _listed_planner(values: nav2.Nav2Values, name: str, plugin: str) -> ListedPlanner:
    if not plugin:
        text = f"{name} is listed, but has no {name}.plugin; Nav2 does not start"
        values.problem("params.plugins", "refused", text, "planner_plugins")
    planner_class = planner_classes().get(plugin)
    settings = {
        key: values.number(f"{name}.{key}", default)
        if isinstance(default, float)
        else values.get(f"{name}.{key}", _KINDS[type(default)], default)
        for key, default in PLANNER_PARAMETERS.get(full_name(plugin), {}).items()
    }
    planner = None if planner_class is None else planner_class(settings)
    return ListedPlanner(name, plugin, settings, planner)
