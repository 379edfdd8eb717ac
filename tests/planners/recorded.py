"""Plans that Nav2's own planners made, and the costmaps that they made them on."""

import hashlib
import json

import numpy as np
import yaml

import mapdeal
from mapdeal.commands.plan_changes import grid_of
from mapdeal.planners.planner import planner_classes


def sha256(array):
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


def recorded_plans(data, folder, plugin, step):
    """Yield the planner, its costmap, the previous start and the answer of every n-th pair."""
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
                yield planner, grid, before, start, goal, pair
            cells = grid.cell_of(start), grid.cell_of(goal)
            if None not in cells and cells[0] != cells[1] and pair.get("reason") != "GoalOccupied":
                before = cells[0]
