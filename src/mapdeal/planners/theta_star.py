"""Theta*, Nav2's planner of straight lines between corners.

Nav2 clears the start's cell of the query before, not that of this one. Here each query is the
first, and the start must be free.

References
----------
navigation2, nav2_theta_star_planner/src/theta_star_planner.cpp: ``createPlan``, ``getPlan``,
``linearInterpolation``.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import ClassVar

import numpy as np

from mapdeal.errors import ParameterError
from mapdeal.grid.values import LETHAL_OBSTACLE
from mapdeal.kernels import arrays, searches
from mapdeal.planners.planner import Default, Plan, Planner, PlannerGrid, Pose, no_plan, poses_of


class ThetaStarPlanner(Planner):
    plugin_names = (
        "nav2_theta_star_planner::ThetaStarPlanner", "nav2_theta_star_planner/ThetaStarPlanner"
    )  # fmt: skip
    parameters: ClassVar[Mapping[str, Default]] = {
        "how_many_corners": 8, "w_euc_cost": 1.0, "w_traversal_cost": 2.0, "allow_unknown": True,
        "terminal_checking_interval": 5000, "use_final_approach_orientation": False,
    }  # fmt: skip

    def plan(self, grid: PlannerGrid, start: Pose, goal: Pose) -> Plan:
        for name in ("w_euc_cost", "w_traversal_cost"):
            if not self.values[name] >= 0:  # also NaN
                rule = "must be at least 0; Nav2's search would not end"
                raise ParameterError(rule, place=name, got=self.values[name])
        start_cell, goal_cell = grid.cell_of(start), grid.cell_of(goal)
        if start_cell is None:
            return no_plan("StartOutsideMapBounds")
        if goal_cell is None:
            return no_plan("GoalOutsideMapBounds")
        if grid.costs[goal_cell] == LETHAL_OBSTACLE:
            return no_plan("GoalOccupied")
        approaches = self.values["use_final_approach_orientation"]
        if start_cell == goal_cell:
            return Plan(True, poses=np.array([[*start[:2], (start if approaches else goal)[2]]]))
        weight, allow_unknown = self.values["w_traversal_cost"], self.values["allow_unknown"]
        steps, sights = searches.theta_costs(weight, allow_unknown=allow_unknown)
        if np.isinf([steps[grid.costs[cell]] for cell in (start_cell, goal_cell)]).any():
            return no_plan("PlannerException")
        width = grid.costs.shape[1]
        first, last = (row * width + column for row, column in (start_cell, goal_cell))
        cells = searches.theta_path(
            grid.costs, (steps, sights), first, last,
            corners=4 if self.values["how_many_corners"] == 4 else 8,
            distance_weight=self.values["w_euc_cost"],
        )  # fmt: skip
        if not cells:
            return no_plan("NoValidPathCouldBeFound")
        corners = np.stack([np.array(cells) % width, np.array(cells) // width], axis=1) + 0.5
        points = _interpolated(np.array(grid.origin) + corners * grid.resolution, grid.resolution)
        return Plan(True, poses=poses_of(points, None if approaches else goal[2]))


def _interpolated(corners: arrays.Floats, step: float) -> arrays.Floats:
    """Return points on the lines between corners; the last gap of a line is 1 to 2 steps wide."""
    points = []
    for (x, y), (to_x, to_y) in pairwise(corners.tolist()):
        distance = float(np.hypot(to_x - x, to_y - y))
        cos, sin = (to_x - x) / distance, (to_y - y) / distance
        points.append((x, y))
        points += [(x + k * step * cos, y + k * step * sin) for k in range(1, int(distance / step))]
    return np.array([*points, corners[-1]])
