"""NavFn, Nav2's default planner.

References
----------
navigation2, nav2_navfn_planner/src/navfn_planner.cpp: ``createPlan``, ``makePlan``,
``getPlanFromPotential``, ``smoothApproachToGoal``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from mapdeal import errors, records
from mapdeal.grid.frame import Point
from mapdeal.grid.values import LETHAL_OBSTACLE
from mapdeal.kernels.arrays import Floats, Mask, Metres
from mapdeal.kernels.searches import UNREACHED, Cell, potentials, traced_path
from mapdeal.planners.planner import Default, Plan, Planner, PlannerGrid, Pose, no_plan

_MOST_CYCLES = 1000  # max_cycles_factor: by then the trace goes in circles
_MOST_STEPS = 100_000  # of a tolerance
_SAME = 1e-4  # metres between two last poses that count as equal
_NEAR = 1e-6  # square metres between the path's end and the goal


class NavfnPlanner(Planner):
    plugin_names = ("nav2_navfn_planner::NavfnPlanner", "nav2_navfn_planner/NavfnPlanner")
    parameters: ClassVar[Mapping[str, Default]] = {
        "tolerance": 0.5, "use_astar": False, "allow_unknown": True, "max_cycles_factor": 4,
        "use_final_approach_orientation": False,
    }  # fmt: skip
    moves_diagonally = False

    def plan(self, grid: PlannerGrid, start: Pose, goal: Pose) -> Plan:
        goal_cell = grid.cell_of(goal)
        if grid.cell_of(start) is None:
            return no_plan("StartOutsideMapBounds")
        if goal_cell is None:
            return no_plan("GoalOutsideMapBounds")
        if self.values["tolerance"] == 0 and grid.costs[goal_cell] == LETHAL_OBSTACLE:
            return no_plan("GoalOccupied")
        approaches = self.values["use_final_approach_orientation"]
        if start[:2] == goal[:2]:
            return Plan(True, poses=np.array([[*start[:2], (start if approaches else goal)[2]]]))
        potential = self.potential(grid, start, goal)
        if potential is None:
            return no_plan("NoValidPathCouldBeFound", "the start lies in the last half cell")
        end = self._reached_point(grid, potential, goal)
        if end is None:
            return no_plan("NoValidPathCouldBeFound")
        turns = min(self.values["max_cycles_factor"], _MOST_CYCLES) * max(grid.costs.shape)
        if turns < 1:
            plan = no_plan("NoValidPathCouldBeFound", "max_cycles_factor leaves no turns")
            return records.replace(plan, is_reached=True)
        ends = _rounded(grid, start[:2]), _rounded(grid, end)
        points, outcome = traced_path(potential, *ends, turns=turns)
        if outcome != "found":
            detail = _failure(grid, points, outcome, turns)
            return records.replace(no_plan("NoValidPathCouldBeFound", detail), is_reached=True)
        xy = np.array(grid.origin) + points[::-1].astype(np.float64) * grid.resolution
        poses = np.pad(_with_end(xy, end), ((0, 0), (0, 1)))
        step = poses[-1] - poses[-2]
        if len(poses) > 2 and (np.abs(step) < _SAME).all():
            step = poses[-1] - poses[-3]
        poses[-1, 2] = math.atan2(step[1], step[0]) if approaches else goal[2]
        return Plan(True, poses=poses)

    def potential(self, grid: PlannerGrid, start: Pose, goal: Pose) -> Metres | None:
        """Return the potentials of the cells, 1e10 where the search did not come."""
        # None if the start's cell lies behind the last one, where Nav2 writes beyond its arrays.
        x, y = _rounded(grid, start[:2])
        rows, columns = grid.costs.shape
        if y * columns + x >= rows * columns:
            return None
        return potentials(
            grid.costs, (x, y), _rounded(grid, goal[:2]),
            allow_unknown=self.values["allow_unknown"], is_astar=self.values["use_astar"],
        )  # fmt: skip

    def _reached_point(self, grid: PlannerGrid, potential: Metres, goal: Pose) -> Point | None:
        """Return the goal, or else the nearest point within the tolerance that was reached."""

        def are_reached(x: Floats, y: Floats) -> Mask:
            (west, south), (rows, columns) = grid.origin, potential.shape
            column, row = (np.floor((at - first) / grid.resolution + 0.5).astype(np.int64)
                           for at, first in ((x, west), (y, south)))  # fmt: skip
            inside = (x >= west) & (y >= south) & (row < rows) & (column < columns)
            cells = potential[np.where(inside, row, 0), np.where(inside, column, 0)]
            return np.asarray(inside & (cells < np.float32(UNREACHED)))

        if are_reached(*np.array(goal[:2])[:, np.newaxis]).any():
            return goal[:2]
        y, x = np.meshgrid(*(self._steps(grid, goal[axis], axis) for axis in (1, 0)), indexing="ij")
        squares = (x - goal[0]) * (x - goal[0]) + (y - goal[1]) * (y - goal[1])
        squares[~are_reached(x, y)] = math.inf
        if not (squares < math.inf).any():
            return None
        nearest = int(np.argmin(squares))
        return float(x.flat[nearest]), float(y.flat[nearest])

    def _steps(self, grid: PlannerGrid, middle: float, axis: int) -> list[float]:
        """Return the coordinates within the tolerance along an axis, those on the map."""
        tolerance, first = self.values["tolerance"], grid.origin[axis]
        rule = f"must be at most {_MOST_STEPS} cells; Nav2 tries all points within it"
        errors.require(tolerance <= _MOST_STEPS * grid.resolution, rule, "tolerance", got=tolerance)
        steps = [middle - tolerance]
        while steps[-1] <= middle + tolerance:
            steps.append(steps[-1] + grid.resolution)
        last = first + grid.costs.shape[1 - axis] * grid.resolution
        return [step for step in steps[:-1] if first <= step <= last]


def _rounded(grid: PlannerGrid, point: Point) -> Cell:
    """Return column and row of the nearest corner of cells; halves are rounded up."""
    x, y = grid.place_of(point)
    return math.floor(x + 0.5), math.floor(y + 0.5)


def _with_end(path_xy: Floats, end: Point) -> Floats:
    """Return the path to the goal: its last point is replaced if the goal is nearer, or near it."""
    if len(path_xy) >= 2:
        last, before = path_xy[-2:][::-1]
        gaps = (last - end, before - end, last - before)
        from_last, from_before, step = (float((gap**2).sum()) for gap in gaps)
        if step > from_before or from_last < _NEAR:
            return np.vstack([path_xy[:-1], end])
    return np.vstack([path_xy, end])


def _failure(grid: PlannerGrid, points: Metres, outcome: str, turns: int) -> str:
    text = "the search reached the goal, but "
    x, y = np.array(grid.origin) + points[-1].astype(np.float64) * grid.resolution
    is_circle = (points[:-1] == points[-1]).all(axis=1).any()
    if outcome == "no turns" and not is_circle:
        return f"{text}its path is longer than the {turns} half cells that max_cycles_factor allows"
    action = "goes in circles" if outcome == "no turns" else "ends"
    return f"{text}the trace of the path {action} at {x:.3f},{y:.3f}"
