"""Parameters that Nav2's planner server and its planners declare, with their defaults.

A parameter's default also gives its type: ROS 2 refuses values of another type.

References
----------
navigation2, branches humble to main: nav2_planner, nav2_navfn_planner, nav2_smac_planner (with
``SmootherParams`` of smoother.hpp) and nav2_theta_star_planner. Defaults are those of main.
"""

from __future__ import annotations

from collections.abc import Mapping

Default = bool | int | float | str | tuple[str, ...]

PLANNER_SERVER = "planner_server"

SERVER_PARAMETERS: Mapping[str, Default] = {
    "planner_plugins": ("GridBased",), "expected_planner_frequency": 1.0,
    "costmap_update_timeout": 1.0, "allow_partial_planning": False,
    "action_server_result_timeout": 10.0, "introspection_mode": "disabled",
    "bond_heartbeat_period": 0.25, "use_sim_time": False,
}  # fmt: skip
DEFAULT_PLANNERS: Mapping[str, str] = {"GridBased": "nav2_navfn_planner::NavfnPlanner"}
"""Names and classes of the planners of a server without ``planner_plugins``."""

_SMOOTHER: Mapping[str, Default] = {
    "smoother.max_iterations": 1000, "smoother.w_smooth": 0.3, "smoother.w_data": 0.2,
    "smoother.tolerance": 1e-10, "smoother.do_refinement": True, "smoother.refinement_num": 2,
}  # fmt: skip
_SMAC: Mapping[str, Default] = {
    "tolerance": 0.25, "allow_unknown": True, "max_iterations": 1_000_000,
    "max_on_approach_iterations": 1000, "terminal_checking_interval": 5000,
    "max_planning_time": 5.0,
}  # fmt: skip
_SMAC_WITH_HEADINGS: Mapping[str, Default] = {
    **_SMAC, **_SMOOTHER,
    "smooth_path": True, "cache_obstacle_heuristic": False, "reverse_penalty": 2.0,
    "change_penalty": 0.0, "non_straight_penalty": 1.2, "cost_penalty": 2.0,
    "retrospective_penalty": 0.015, "analytic_expansion_ratio": 3.5,
    "analytic_expansion_max_cost": 200.0, "analytic_expansion_max_cost_override": False,
    "analytic_expansion_max_length": 3.0, "lookup_table_size": 20.0,
    "debug_visualizations": False, "goal_heading_mode": "DEFAULT", "coarse_search_resolution": 1,
    "use_quadratic_cost_penalty": False, "downsample_obstacle_heuristic": True,
}  # fmt: skip

PLANNER_PARAMETERS: Mapping[str, Mapping[str, Default]] = {
    "NavfnPlanner": {
        "tolerance": 0.5, "use_astar": False, "allow_unknown": True,
        "use_final_approach_orientation": False,
    },
    "SmacPlanner2D": {
        **_SMAC, "tolerance": 0.125, "max_planning_time": 2.0, "downsample_costmap": False,
        "downsampling_factor": 1, "cost_travel_multiplier": 1.0,
        "use_final_approach_orientation": False,
    },
    "SmacPlannerHybrid": {
        **_SMAC_WITH_HEADINGS, "downsample_costmap": False, "downsampling_factor": 1,
        "angle_quantization_bins": 72, "minimum_turning_radius": 0.4,
        "motion_model_for_search": "DUBIN", "allow_primitive_interpolation": True,
    },
    "SmacPlannerLattice": {
        **_SMAC_WITH_HEADINGS, "change_penalty": 0.05, "non_straight_penalty": 1.05,
        "rotation_penalty": 5.0, "allow_reverse_expansion": False, "lattice_filepath": "",
    },
    "ThetaStarPlanner": {
        "how_many_corners": 8, "w_euc_cost": 1.0, "w_traversal_cost": 2.0, "allow_unknown": True,
        "terminal_checking_interval": 5000, "use_final_approach_orientation": False,
    },
}  # fmt: skip
"""Parameters below a planner's name, by the name of its class without the package.

``lattice_filepath`` defaults to a file of nav2_smac_planner.
"""
