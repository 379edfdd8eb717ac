import numpy as np
import pytest

from mapdeal.errors import ParameterError
from mapdeal.planners.planner import PlannerGrid
from mapdeal.planners.theta_star import ThetaStarPlanner

pytestmark = pytest.mark.slow


COSTS = np.zeros((40, 60), np.uint8)
COSTS[5:35, 30] = 254
COSTS[:, 50] = 255
COSTS[38, 3] = 253
GRID = PlannerGrid(COSTS, 0.05, (-1.0, 2.0))


@pytest.mark.parametrize(("values", "start", "goal", "reason"), [
    ({}, (-1.1, 3, 0), (0, 3, 0), "StartOutsideMapBounds"),
    ({}, (0, 3, 0), (2.0, 3, 0), "GoalOutsideMapBounds"),
    ({}, (0, 3, 0), (0.51, 3, 0), "GoalOccupied"),
    ({}, (0, 3, 0), (-0.83, 3.92, 0), "PlannerException"),
    ({}, (0.51, 3, 0), (0, 3, 0), "PlannerException"),
    ({}, (0, 3, 0), (1.8, 3, 0), None),
    ({"allow_unknown": False}, (0, 3, 0), (1.8, 3, 0), "NoValidPathCouldBeFound"),
    ({"how_many_corners": 4}, (0, 3, 0), (0.9, 3, 0), None),
])  # fmt: skip
def test_a_plan_fails_with_the_name_of_nav2s_exception(values, start, goal, reason):
    plan = ThetaStarPlanner(values).plan(GRID, start, goal)
    assert (plan.found, plan.reason) == (reason is None, reason)


def test_weights_with_which_the_search_would_not_end_are_refused():
    with pytest.raises(ParameterError, match=r"w_euc_cost: must be at least 0.*-1"):
        ThetaStarPlanner({"w_euc_cost": -1.0}).plan(GRID, (0, 3, 0), (0.4, 3, 0))


def test_a_path_joins_the_centres_of_cells_by_points_a_cell_apart():
    plan = ThetaStarPlanner().plan(GRID, (-0.99, 2.01, 1), (-0.39, 2.01, 2))
    assert plan.poses[[0, -1], 0] == pytest.approx([-0.975, -0.375])
    assert plan.poses[:, 1] == pytest.approx(2.025)
    steps = np.diff(plan.poses[:, 0])
    assert 0.05 - 1e-9 < steps.min() <= steps.max() < 0.1 + 1e-9
    assert plan.poses[:, 2].tolist() == [0] * len(steps) + [2]


@pytest.mark.parametrize(
    ("approaches", "goal", "yaw"),
    [(False, (0.01, 3.01, 2), 2), (True, (0.01, 3.01, 2), 1), (False, (0.4, 3.02, 2), 2),
     (True, (0.4, 3.02, 2), 0)],
)  # fmt: skip
def test_the_last_pose_has_the_goals_yaw_or_that_of_the_approach(approaches, goal, yaw):
    planner = ThetaStarPlanner({"use_final_approach_orientation": approaches})
    assert planner.plan(GRID, (0.02, 3.02, 1), goal).poses[-1, 2] == pytest.approx(yaw)


@pytest.mark.parametrize(("corners", "is_found"), [(4, False), (8, True)])
@pytest.mark.parametrize(("start", "goal"), [((1, 1, 0), (7, 7, 0)), ((1, 7, 0), (7, 1, 0))])
def test_four_corners_lead_between_no_obstacles_that_touch(corners, is_found, start, goal):
    wall = np.where(np.eye(9), 254, 0).astype(np.uint8)
    grid = PlannerGrid(wall if start[1] == 7 else wall[::-1].copy(), 1.0, (0.0, 0.0))
    for ends in ((start, goal), (goal, start)):
        assert ThetaStarPlanner({"how_many_corners": corners}).plan(grid, *ends).found == is_found
