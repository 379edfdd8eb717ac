import numpy as np
import pytest

from mapdeal.planners.navfn import NavfnPlanner
from mapdeal.planners.planner import PlannerGrid

pytestmark = pytest.mark.slow


GRID = PlannerGrid(np.zeros((40, 60), np.uint8), 0.05, (-1.0, 2.0))


@pytest.mark.parametrize(("values", "start", "goal", "reason"), [
    ({}, (-1.1, 3, 0), (0, 3, 0), "StartOutsideMapBounds"),
    ({}, (0, 3, 0), (2.0, 3, 0), "GoalOutsideMapBounds"),
    ({"tolerance": 0.0}, (0, 3, 0), (1.01, 3, 0), "GoalOccupied"),
    ({"tolerance": 0.1}, (0, 3, 0), (1.26, 3.01, 0), "NoValidPathCouldBeFound"),
    ({"tolerance": 0.3}, (0, 3, 0), (1.26, 3.01, 0), None),
    ({"tolerance": 0.1, "allow_unknown": False}, (0, 3, 0), (0, 2.3, 0), "NoValidPathCouldBeFound"),
    ({"tolerance": 0.1}, (0, 3, 0), (0, 2.3, 0), None),
    ({"max_cycles_factor": 1}, (-0.9, 3, 0), (0.9, 3, 0), "NoValidPathCouldBeFound"),
    ({"max_cycles_factor": 0}, (0, 3, 0), (0.9, 3, 0), "NoValidPathCouldBeFound"),
    ({"max_cycles_factor": 10**9}, (0, 3, 0), (0.9, 3, 0), None),
    ({"tolerance": 900.0}, (0, 3, 0), (1.26, 3.01, 0), None),
    ({"tolerance": -1.0}, (0, 3, 0), (1.26, 3.01, 0), "NoValidPathCouldBeFound"),
    ({}, (1.99, 3.99, 0), (0, 3, 0), "NoValidPathCouldBeFound"),
])  # fmt: skip
def test_a_plan_fails_with_the_name_of_nav2s_exception(values, start, goal, reason):
    costs = GRID.costs.copy()
    costs[:, 40:50] = 254
    costs[8] = 255
    plan = NavfnPlanner(values).plan(PlannerGrid(costs, 0.05, (-1.0, 2.0)), start, goal)
    assert (plan.found, plan.reason) == (reason is None, reason)


@pytest.mark.parametrize(
    ("approaches", "start", "goal", "yaw"),
    [(False, (0, 3, 1), (0, 3, 2), 2), (True, (0, 3, 1), (0, 3, 2), 1),
     (False, (0, 3, 1), (1, 3, 2), 2), (True, (0, 3, 1), (1, 3, 2), 0)],
)  # fmt: skip
def test_the_last_pose_has_the_goals_yaw_or_that_of_the_approach(approaches, start, goal, yaw):
    planner = NavfnPlanner({}).with_value("use_final_approach_orientation", approaches)
    plan = planner.plan(GRID, start, goal)
    assert plan.poses[-1].tolist() == pytest.approx([*goal[:2], yaw], abs=1e-6)
