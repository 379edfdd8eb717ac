import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from mapdeal.errors import ParameterError
from mapdeal.planners.planner import PlannerGrid
from mapdeal.planners.smac_2d import Smac2DPlanner

pytestmark = pytest.mark.slow


COSTS = np.zeros((40, 60), np.uint8)
COSTS[:, 40:50] = 254
COSTS[8, :40] = 255
GRID = PlannerGrid(COSTS, 0.05, (-1.0, 2.0))


@pytest.mark.parametrize(("values", "start", "goal", "reason"), [
    ({}, (-1.1, 3, 0), (0, 3, 0), "StartOutsideMapBounds"),
    ({}, (0, 3, 0), (2.0, 3, 0), "GoalOutsideMapBounds"),
    ({}, (0, 3, 0), (1.26, 3, 0), "GoalOccupied"),
    ({"tolerance": 0.3}, (0, 3, 0), (1.24, 3, 0), None),
    ({"tolerance": 0.3}, (0, 3, 0), (1.76, 3, 0), "NoValidPathCouldBeFound"),
    ({"max_iterations": 30}, (0, 3, 0), (0.5, 2.1, 0), "PlannerTimedOut"),
    ({"max_iterations": 0}, (0, 3, 0), (0.5, 2.1, 0), None),
    ({}, (1.3, 3, 0), (0, 3, 0), "StartOccupied"),
    ({"allow_unknown": False}, (0, 3, 0), (0, 2.1, 0), "NoValidPathCouldBeFound"),
])  # fmt: skip
def test_a_plan_fails_with_the_name_of_nav2s_exception(values, start, goal, reason):
    plan = Smac2DPlanner(values).plan(GRID, start, goal)
    assert (plan.found, plan.reason) == (reason is None, reason)


@pytest.mark.parametrize(
    ("approaches", "goal", "yaw"),
    [(False, (0.01, 3.01, 2), 2), (True, (0.01, 3.01, 2), 1), (False, (0.5, 3, 2), 2),
     (True, (0.5, 3, 2), 0)],
)  # fmt: skip
def test_the_last_pose_has_the_goals_yaw_or_that_of_the_approach(approaches, goal, yaw):
    planner = Smac2DPlanner({"use_final_approach_orientation": approaches})
    plan = planner.plan(GRID, (0.02, 3.02, 1), goal)
    assert plan.poses[-1].tolist() == pytest.approx([*goal[:2], yaw], abs=0.02)


def test_smoothing_shortens_a_path_and_keeps_it_out_of_obstacles():
    costs = np.zeros((40, 60), np.uint8)
    costs[10:30, 20] = 254
    fading = 252 * np.exp(-0.3 * ndimage.distance_transform_edt(costs == 0))
    costs = np.maximum(costs, fading.astype(np.uint8))
    start, goal = (-0.7, 3, 0), (0.7, 3, 0)
    grid = PlannerGrid(costs, 0.05, (-1.0, 2.0))
    planner = Smac2DPlanner({"cost_travel_multiplier": 4.0})
    raw = planner.with_value("smoother.max_iterations", 0).plan(grid, start, goal)
    corners = np.array([[0.09, 0.09], [0.09, -0.09], [-0.09, -0.09], [-0.09, 0.09]])
    for robot in (grid, replace(grid, footprint=corners)):
        smooth = planner.plan(robot, start, goal)
        columns, rows = np.floor((smooth.poses[:, :2] - robot.origin) / 0.05).astype(int).T
        assert not (costs[rows, columns] == 254).any()
        assert smooth.length <= raw.length
        assert math.isclose(smooth.cost, raw.cost)
    assert planner.plan(grid, start, goal).length < raw.length - 0.01


def test_a_downsampled_costmap_is_refused():
    planner = Smac2DPlanner({"downsample_costmap": True, "downsampling_factor": 2})
    with pytest.raises(ParameterError, match="downsampled costmap"):
        planner.plan(GRID, (0, 3, 0), (0.5, 3, 0))
