"""Smac 2D, Nav2's A* over the eight neighbours of cells, and its smoother.

References
----------
navigation2, nav2_smac_planner/src: ``smac_planner_2d.cpp``, ``a_star.cpp``, ``goal_manager.cpp``
and ``smoother.cpp``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Point
from mapdeal.kernels.arrays import Floats, Mask
from mapdeal.kernels.polygons import Lattice, costs_at_poses
from mapdeal.kernels.searches import grid_path, grid_step_costs, smooth_once
from mapdeal.planners.planner import Default, Plan, Planner, PlannerGrid, Pose, no_plan, poses_of

_ENDLESS = 2**31 - 1  # iterations without a limit
_FEWEST = 12  # poses of a path that is smoothed
_SAME = 1e-4  # metres in x and in y between poses at one place

SMAC: Mapping[str, Default] = {
    "tolerance": 0.25, "allow_unknown": True, "max_iterations": 1_000_000,
    "max_on_approach_iterations": 1000, "terminal_checking_interval": 5000,
    "max_planning_time": 5.0,
    "smoother.max_iterations": 1000, "smoother.w_smooth": 0.3, "smoother.w_data": 0.2,
    "smoother.tolerance": 1e-10, "smoother.do_refinement": True, "smoother.refinement_num": 2,
}  # fmt: skip
"""Parameters of all Smac planners. ``max_planning_time`` is taken as never used up."""


class Smac2DPlanner(Planner):
    plugin_names = ("nav2_smac_planner::SmacPlanner2D", "nav2_smac_planner/SmacPlanner2D")
    parameters: ClassVar[Mapping[str, Default]] = {
        **SMAC, "tolerance": 0.125, "max_planning_time": 2.0, "cost_travel_multiplier": 1.0,
        "downsample_costmap": False, "downsampling_factor": 1,
        "use_final_approach_orientation": False,
    }  # fmt: skip

    def plan(self, grid: PlannerGrid, start: Pose, goal: Pose) -> Plan:
        if self.values["downsample_costmap"] and self.values["downsampling_factor"] > 1:
            rule = "paths on a downsampled costmap are not modelled"
            hint = "set downsample_costmap to false"
            raise ParameterError(rule, place="downsample_costmap", got=True, hint=hint)
        start_xy, goal_xy = _continuous_cell(grid, start), _continuous_cell(grid, goal)
        if start_xy is None:
            return no_plan("StartOutsideMapBounds")
        if goal_xy is None:
            return no_plan("GoalOutsideMapBounds")
        approaches = self.values["use_final_approach_orientation"]
        width = grid.costs.shape[1]
        first, last = (int(y) * width + int(x) for x, y in (start_xy, goal_xy))
        if first == last:
            return Plan(True, poses=np.array([[*goal[:2], (start if approaches else goal)[2]]]))
        multiplier = self.values["cost_travel_multiplier"]
        step_costs = grid_step_costs(multiplier, allow_unknown=self.values["allow_unknown"])
        tolerance = float(np.float32(self.values["tolerance"]) / np.float32(grid.resolution))
        if not _is_zone_open(np.isfinite(step_costs[0]), grid, goal_xy, tolerance):
            return no_plan("GoalOccupied")
        limits = [self.values[name] for name in ("max_iterations", "max_on_approach_iterations")]
        limit, most_near_goal = (count if count > 0 else _ENDLESS for count in limits)
        cells, iterations = grid_path(
            grid.costs, step_costs, first, last, goal_xy, tolerance=tolerance,
            most_iterations=limit, most_near_goal=most_near_goal,
        )  # fmt: skip
        if len(cells) < 2:
            if iterations == 1:  # the start has no free neighbour
                return no_plan("StartOccupied")
            return no_plan("NoValidPathCouldBeFound" if iterations < limit else "PlannerTimedOut")
        rows, columns = np.divmod(cells, width)
        is_diagonal = (np.diff(rows) != 0) & (np.diff(columns) != 0)
        costs = 1 + multiplier * (grid.costs[rows[1:], columns[1:]] / 252)
        corners = np.stack([columns, rows], axis=1) * grid.resolution
        poses = self._smoothed(grid, np.array(grid.origin, np.float32).astype(np.float64) + corners)
        if cells[-1] == last:
            poses[-1, :2] = goal[:2]
        poses = poses_of(poses, None if approaches else goal[2])
        cost = float((np.where(is_diagonal, math.sqrt(2), 1) * costs).sum())
        return Plan(True, poses=poses, cost=cost)

    def _smoothed(self, grid: PlannerGrid, path: Floats) -> Floats:
        """Return the smoothed poses, with the directions of their steps."""
        limit = self.values["smoother.max_iterations"]
        if limit == 0:
            return path
        refinements = self.values["smoother.do_refinement"] * self.values["smoother.refinement_num"]
        for _ in range(1 + refinements if len(path) >= _FEWEST else 0):
            path, has_converged = self._smooth(grid, path, limit)
            if not has_converged:
                break
        return _with_directions(path)

    def _smooth(self, grid: PlannerGrid, raw: Floats, limit: int) -> tuple[Floats, bool]:
        """Return the path of the last sweep without a collision, and whether sweeps converged."""
        weights = self.values["smoother.w_data"], self.values["smoother.w_smooth"]
        path = raw.copy()
        for _ in range(limit - 1):
            before = path.copy()
            change = smooth_once(raw, path, *weights)
            if _is_blocked(grid, path):
                return before, False
            if change < self.values["smoother.tolerance"]:
                return path, True
        return path, False


def _continuous_cell(grid: PlannerGrid, pose: Pose) -> tuple[float, float] | None:
    """Return a place in cells, x and y rounded to float32; None outside of the costmap."""
    x, y = (float(np.float32(at)) for at in grid.place_of(pose))
    rows, columns = grid.costs.shape
    is_inside = pose[0] >= grid.origin[0] and pose[1] >= grid.origin[1] and x < columns and y < rows
    return (x, y) if is_inside else None


def _is_zone_open(open_costs: Mask, grid: PlannerGrid, goal_xy: Point, tolerance: float) -> bool:
    """Return whether the goal's cell or a cell within a tolerance of at least 1 cell is open."""
    x, y = goal_xy
    if open_costs[grid.costs[int(y), int(x)]] or tolerance < 1:
        return bool(open_costs[grid.costs[int(y), int(x)]])
    reach = math.ceil(tolerance) + 1
    rows, columns = (
        np.arange(max(int(at) - reach, 0), min(int(at) + reach + 1, size))
        for at, size in zip((y, x), grid.costs.shape, strict=True)
    )
    squares = (columns - x) ** 2 + ((rows - y) ** 2)[:, np.newaxis]
    near = grid.costs[np.ix_(rows, columns)][squares <= tolerance**2]
    return bool(open_costs[near].any())


def _with_directions(path: Floats) -> Floats:
    """Return poses that look to the next one; those at one place with it do not turn."""
    poses, steps = np.zeros((len(path), 3)), np.diff(path, axis=0)
    poses[:, :2] = path
    is_same = (np.abs(steps) < _SAME).all(axis=1)
    poses[:-1, 2] = np.where(is_same, 0.0, np.arctan2(steps[:, 1], steps[:, 0]))
    return poses


def _is_blocked(grid: PlannerGrid, path: Floats) -> bool:
    if grid.footprint is None:
        columns, rows = np.floor((path[1:-1] - grid.origin) / grid.resolution).astype(int).T
        costs = grid.costs[rows, columns]
    else:
        lattice = Lattice(grid.resolution, *grid.origin, 0.0)
        poses = _with_directions(path)[1:-1]
        costs, _ = costs_at_poses(grid.costs, lattice, grid.footprint, poses, filled=False)
    return bool(((costs > 252) & (costs != 255)).any())
