"""The planners compared with recorded plans of Nav2's own, on the same costmaps."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

import mapdeal
from mapdeal.commands.plan_changes import grid_of
from mapdeal.planners.navfn import NavfnPlanner
from mapdeal.planners.planner import planner_classes
from mapdeal.planners.smac_2d import Smac2DPlanner
from mapdeal.planners.theta_star import ThetaStarPlanner

pytestmark = pytest.mark.slow


def sha256(array):
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


def recorded_plans(data, folder, plugin, step):
    """Yield the planner, its costmap, the start, the goal and the answer of every n-th pair."""
    parameters = folder / "params.yaml"
    for case in json.loads((data / "expected" / "plans.json").read_text())["cases"]:
        first = int(case["id"][:3])
        if case["planner"] != plugin or -first % step >= len(case["pairs"]):
            continue  # none of its pairs is among these
        parameters.write_text(case["params"])
        robot = mapdeal.read_robot_parameters(parameters)
        grid = grid_of(mapdeal.costmap(data / case["map"], robot), robot)
        assert sha256(grid.costs) == case["costmap_sha256"]
        server = yaml.safe_load(case["params"])["planner_server"]["ros__parameters"]
        values = {name: value for name, value in server["GridBased"].items() if name != "plugin"}
        planner, before = planner_classes()[plugin](values), None
        for index, pair in enumerate(case["pairs"], start=first):
            start, goal = tuple(pair["start"]), tuple(pair["goal"])
            if index % step == 0:
                costs = grid.costs.copy()
                if before is not None and isinstance(planner, ThetaStarPlanner):
                    costs[before] = 0  # Nav2 clears the start of the query before
                yield planner, replace(grid, costs=costs), start, goal, pair
            cells = grid.cell_of(start), grid.cell_of(goal)
            if None not in cells and cells[0] != cells[1] and pair.get("reason") != "GoalOccupied":
                before = cells[0]


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("step", [48, pytest.param(1, marks=pytest.mark.thorough)])
def test_recorded_plans_are_equal_bit_for_bit(real_maps, tmp_path, step):
    counts = {True: 0, False: 0}
    plans = recorded_plans(real_maps, tmp_path, NavfnPlanner.plugin_names[0], step)
    for planner, grid, start, goal, answer in plans:
        plan = planner.plan(grid, start, goal)
        counts[plan.found] += 1
        assert (plan.found, plan.reason) == (answer["found"], answer.get("reason"))
        if "potential_sha256" in answer:
            assert sha256(planner.potential(grid, start, goal)) == answer["potential_sha256"]
        if plan.found:
            assert len(plan.poses) == answer["poses"]
            assert sha256(plan.poses[:, :2]) == answer["path_sha256"]
            assert plan.length == pytest.approx(answer["length"], abs=1e-9)
            turn = (plan.poses[-1, 2] - answer["final_pose"][2]) / (2 * np.pi)
            assert turn == pytest.approx(round(turn), abs=1e-9)
        elif answer.get("goal_potential") is not None:
            assert plan.detail.startswith("the search reached the goal, but ")
    assert min(counts.values()) > 400 / step


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("is_every", [False, pytest.param(True, marks=pytest.mark.thorough)])
@pytest.mark.parametrize(("planner_class", "step", "tolerance"), [
    (Smac2DPlanner, 16, {"rel": 1e-3}), (ThetaStarPlanner, 32, {"rel": 2e-3, "abs": 0.06}),
])  # fmt: skip
def test_recorded_plans_are_equal(real_maps, tmp_path, planner_class, step, tolerance, is_every):
    step, paths = 1 if is_every else step, []
    plans = recorded_plans(real_maps, tmp_path, planner_class.plugin_names[0], step)
    for planner, grid, start, goal, answer in plans:
        plan = planner.plan(grid, start, goal)
        assert (plan.found, plan.reason) == (answer["found"], answer.get("reason"))
        if plan.found:
            assert plan.length == pytest.approx(answer["length"], **tolerance)
            if planner_class is Smac2DPlanner:
                assert len(plan.poses) == answer["poses"]
            if "raw" in answer:
                assert plan.cost == pytest.approx(answer["raw"]["cost"], rel=1e-6)
            paths.append(sha256(plan.poses[:, :2]) == answer["path_sha256"])
    assert len(paths) > 300 / step
    assert np.mean(paths) >= 0.9  # others have the same cost, or nearly
