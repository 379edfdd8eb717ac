"""Parts of ``mapdeal plan``: a robot's planner on a map, and the changes that make a path exist.

A change is proposed only after the planner has found a path with it, and none one step before.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import capture_warnings
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Frame, as_float32
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import Goal
from mapdeal.grid.reaching import Ground, reach_on, squares_to
from mapdeal.grid.values import (
    FREE,
    INSCRIBED_INFLATED_OBSTACLE,
    LETHAL_OBSTACLE,
    NO_INFORMATION,
    OCCUPIED,
    UNKNOWN,
)
from mapdeal.kernels.navfn import UNREACHED
from mapdeal.pipeline.folder import rounded_place
from mapdeal.pipeline.inputs import KeepoutMask, MapInput
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.planners.planner import Plan, Planner, PlannerGrid, Pose, no_plan
from mapdeal.ros.nav2 import robot_in
from mapdeal.ros.planners import ListedPlanner
from mapdeal.ros.robot import ParameterValue, RobotParameters, corners_of_string
from mapdeal.ros.ros2_files import Ros2Parameters

_STEP = 0.01  # of parameters, in their unit
_FARTHEST_TOLERANCE = 10.0  # metres
_MOST_CYCLES = 64  # largest max_cycles_factor that is tried
_STEPS_BEYOND = 25  # tried where the goal can be reached, but the planner fails
_STEPS_AFTER = 4  # tried beyond a value with a path, to see whether the path stays
_WIDEST_PASSAGE = 3.0  # metres by which a passage is widened, or a radius grows, at most
_LARGEST_VALUE = 1000.0  # that is tried
_LARGEST_SCALE = 4.0  # of a footprint
_MOST_OBSTACLES, _LARGEST_OBSTACLE = 20, 5.0  # number of those tried, and square metres of each
_CLOSED = {
    INSCRIBED_INFLATED_OBSTACLE: "nearer to an obstacle than the inscribed radius",
    LETHAL_OBSTACLE: "in an obstacle", NO_INFORMATION: "in unknown space",
}  # fmt: skip
_BYTES = 1 << 26  # of the costmaps that are kept

Override = tuple[str, str, Any]  # name, type and value of a costmap's parameter
Change = dict[str, Any]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class PlannerOnMap:
    """A robot's planner, and the costmaps that it has of a map."""

    source: MapInput
    robot: RobotParameters
    parameters: Ros2Parameters
    listed: ListedPlanner
    mask: KeepoutMask | None = None
    is_older: bool = False  # whether the inflation layer is that of Humble to Kilted

    @property
    def planner(self) -> Planner:
        return cast("Planner", self.listed.planner)

    @cached_property
    def costmap(self) -> Costmap:
        return self.costmap_on(self.robot, self.source.occupancy)

    def costmap_on(self, robot: RobotParameters, grid: OccupancyGrid) -> Costmap:
        """Return the costmap that a robot has of a map."""
        mask = self.mask if robot.why_mask_unused is None else None
        costs: Any = grid
        for step in load_recipe(None, robot=robot).steps:
            if mask is not None and step.accepts_mask:
                costs, mask = step.apply(costs, self.source.path, mask=mask.grid), None
            else:
                costs = step.apply(costs, self.source.path)
        if not isinstance(costs, Costmap):
            raise TypeError("the layers of a robot must end in costs")
        return costs if mask is None else mask.over(costs)

    @cached_property
    def grid(self) -> PlannerGrid:
        return grid_of(self.costmap, self.robot)

    @cached_property
    def _grids(self) -> Callable[[Override], PlannerGrid | None]:
        count = max(1, _BYTES // max(self.source.occupancy.occupancy.size, 1))
        return lru_cache(maxsize=count)(self._grid_with)

    def _grid_with(self, override: Override) -> PlannerGrid | None:
        name, kind, value = override
        values = {name: ParameterValue(value, kind, self.robot.paths[-1], 0, str(value))}
        space, older = self.robot.namespace, self.is_older
        with capture_warnings():
            where: Any = {"namespace": space, "older": older}
            robot, problems = robot_in(self.parameters, overrides=values, **where)
            if robot is None or any(problem.level == "refused" for problem in problems):
                return None
            return grid_of(self.costmap_on(robot, self.source.occupancy), robot)

    def plan_with(self, start: Pose, goal: Pose, override: Override) -> Plan:
        """Return the plan with another value of a parameter of the costmap."""
        if (grid := self._grids(override)) is None:
            return no_plan("PlannerException")
        return plan_quickly(self.listed, grid, start, goal)

    @cached_property
    def _clearances(self) -> NDArray[np.float64]:
        squares = squares_to(self.grid.costs == LETHAL_OBSTACLE)
        return np.asarray(np.sqrt(squares) * self.grid.resolution)

    def least_clearance(self, plan: Plan) -> tuple[float, tuple[float, float]]:
        """Return the least distance of a plan's poses to a lethal cell, and where that is."""
        cells = [self.grid.cell_of((x, y, 0.0)) for x, y, _ in plan.poses.tolist()]
        metres = [math.inf if cell is None else self._clearances[cell] for cell in cells]
        least = int(np.argmin(metres))
        x, y = plan.poses[least, :2].tolist()
        return float(metres[least]), (round(x, 6), round(y, 6))

    def stop_of(self, start: Pose, goal: Pose) -> tuple[tuple[float, float] | None, str | None]:
        """Return the place nearest to a goal that a search reaches, and which ends are closed."""
        cells = {"start": self.grid.cell_of(start), "goal": self.grid.cell_of(goal)}
        if None in cells.values():
            return None, None
        reached = _reached_cells(self.listed, self.grid, start)
        if search := getattr(self.listed.planner, "potential", None):
            if (potential := search(self.grid, start, goal)) is None:
                return None, None  # the start lies in the last half cell
            reached = potential < UNREACHED
        rows, cols = np.nonzero(reached)
        x, y = _centres(self, rows, cols)
        nearest = int(np.argmin((x - goal[0]) ** 2 + (y - goal[1]) ** 2))
        is_unknown_open = self.listed.settings.get("allow_unknown", True)
        closed = _CLOSED.keys() - ({NO_INFORMATION} if is_unknown_open else set())
        ends = {end: int(self.grid.costs[cell]) for end, cell in cells.items()
                if end == "goal" or len(rows) == 1}  # fmt: skip
        texts = [f"the {end} lies {_CLOSED[cost]}" for end, cost in ends.items() if cost in closed]
        place = round(float(x[nearest]), 6), round(float(y[nearest]), 6)
        return place, " and ".join(texts) or None

    def plan_without(self, start: Pose, goal: Pose, cleared: Mask) -> Plan:
        """Return the plan on the map with some cells made free."""
        grid = self.source.occupancy
        cells = np.where(cleared, np.int8(FREE), np.asarray(grid.occupancy))
        with capture_warnings():
            costs = self.costmap_on(self.robot, OccupancyGrid(cells, grid.resolution, grid.origin))
            return plan_quickly(self.listed, grid_of(costs, self.robot), start, goal)


def grid_of(costs: Costmap, robot: RobotParameters) -> PlannerGrid:
    """Return a costmap as planners see it."""
    is_round = robot.robot_radius is not None
    return PlannerGrid(
        np.ascontiguousarray(costs.cost),
        as_float32(costs.resolution),
        (float(costs.origin[0]), float(costs.origin[1])),
        None if is_round else np.array(robot.footprint.vertices, dtype=np.float64),
    )


def _open_cells(values: Mapping[str, Any], grid: PlannerGrid, start: Pose, size: int) -> Mask:
    """Return the cells that a robot's centre may be in, and a square of them at its start."""
    is_open = grid.costs < INSCRIBED_INFLATED_OBSTACLE
    if values.get("allow_unknown", True):
        is_open |= grid.costs == NO_INFORMATION
    row, col = grid.cell_of(start) or (0, 0)
    is_open[row : row + size, col : col + size] = True
    return is_open


def _cells_near(values: Mapping[str, Any], grid: PlannerGrid, goal: Pose) -> Mask:
    """Return the cells within the planner's tolerance of a goal, in a square."""
    near = np.zeros(grid.costs.shape, bool)
    cells = min(values.get("tolerance", 0.0) / grid.resolution, max(near.shape))
    margin = max(math.ceil(cells), 0) + 1
    cell = grid.cell_of(goal) or (0, 0)
    near[tuple(slice(max(at - margin, 0), at + margin + 1) for at in cell)] = True
    return near


def _regions(listed: ListedPlanner, grid: PlannerGrid, start: Pose) -> NDArray[np.int32]:
    """Return the number of each open cell's connected region, 0 for closed cells."""
    from scipy import ndimage  # slow to import

    is_diagonal = listed.planner is None or listed.planner.moves_diagonally
    size = 1 if listed.planner is not None and is_diagonal else 2  # NavFn rounds the start up
    around, is_open = np.ones((3, 3), bool), _open_cells(listed.settings, grid, start, size)
    if listed.planner is None:
        # planners with headings check poses that are up to three cells apart
        is_open = ndimage.binary_dilation(is_open, around, iterations=2)
    return np.asarray(ndimage.label(is_open, around if is_diagonal else None)[0])


def _reached_cells(listed: ListedPlanner, grid: PlannerGrid, start: Pose) -> Mask:
    """Return the cells that open cells connect with the start."""
    regions = _regions(listed, grid, start)
    return np.asarray(regions == regions[grid.cell_of(start)])


def is_cut_off(listed: ListedPlanner, grid: PlannerGrid, start: Pose, goal: Pose) -> bool:
    """Return whether closed cells separate start and goal, so that no search gets there."""
    if grid.cell_of(start) is None or grid.cell_of(goal) is None:
        return True
    near = _cells_near(listed.settings, grid, goal)
    return not (near & _reached_cells(listed, grid, start)).any()


def plan_quickly(listed: ListedPlanner, grid: PlannerGrid, start: Pose, goal: Pose) -> Plan:
    """Return the planner's plan; without a search, and without its reason, if it is cut off."""
    if listed.planner is None or is_cut_off(listed, grid, start, goal):
        return no_plan("NoValidPathCouldBeFound")
    return listed.planner.plan(grid, start, goal)


@dataclass(frozen=True)
class Adjustment:
    """A parameter, its value, and values to try in its place, those nearest to it first."""

    name: str
    value: Any
    candidates: Sequence[Any]
    plan: Callable[[Any], Plan]
    scales: Sequence[float] = ()  # of a footprint, for each candidate
    inscribed_radius: float = 0.0

    def planned(self, index: int) -> Plan:
        return self.plan(self.candidates[index])

    def change(self, index: int, *, is_monotonic: bool = True) -> Change:
        """Return the change to a candidate; -1 stands for the value itself."""
        value, radius = self.value if index < 0 else self.candidates[index], self.inscribed_radius
        found: Change = {"parameter": self.name, "from": self.value, "to": value}
        if radius > 0 and value < radius:
            note = f"less than the inscribed radius {radius:.4g} m, so that the robot"
            found["note"] = f"{note} may touch obstacles"
        if self.scales:
            found["scale"] = 1.0 if index < 0 else self.scales[index]
        return found if is_monotonic else {**found, "monotonic": False}


def first_success(count: int, plan: Callable[[int], Plan], *, now: Plan) -> tuple[int, bool] | None:
    """Return the first of `count` candidates with a path, and whether paths stay beyond it.

    Whether the goal is reached is taken as monotonic, whether the path is found is not: the trace
    of a path may fail here and there.
    """
    plans: dict[int, Plan] = {}

    def planned(index: int) -> Plan:
        if index not in plans:
            plans[index] = plan(index)
        return plans[index]

    def reaches(index: int) -> bool:
        return planned(index).found or planned(index).is_reached

    if count < 1 or not (now.is_reached or reaches(count - 1)):
        return None
    first = 0 if now.is_reached else bisect_left(range(count - 1), True, key=reaches)
    for index in range(first, min(first + _STEPS_BEYOND, count)):
        if planned(index).found:
            after = range(index, min(index + _STEPS_AFTER + 1, count))
            stays = all(planned(number).found for number in after)
            return index, stays and all(p.found for number, p in plans.items() if number > index)
    return None


def changes_for(work: PlannerOnMap, start: Pose, goal: Pose, plan: Plan) -> list[Change] | None:
    """Return the smallest single changes that make the planner, if modelled, find a path."""
    if work.listed.planner is None:
        return None
    if plan.reason in ("StartOutsideMapBounds", "GoalOutsideMapBounds"):
        return []
    adjustments = _Query(work, start, goal).adjustments(plan)
    found = [
        adjusted.change(success[0], is_monotonic=success[1])
        for adjusted in adjustments
        if (success := first_success(len(adjusted.candidates), adjusted.planned, now=plan))
    ]
    if not plan.is_reached:
        lethal = work.grid.costs == LETHAL_OBSTACLE
        occupied = lethal & (np.asarray(work.source.occupancy.occupancy) > FREE)
        found += _wider_passage(work, start, goal, plan, occupied)
        found += _obstacle_in_the_way(work, start, goal, occupied)
    return found


def margins_of(work: PlannerOnMap, start: Pose, goal: Pose) -> list[Change]:
    """Return the last value of each parameter with which the planner still finds the path."""
    found = []
    for adjustment in _Query(work, start, goal).margins():
        candidates, plan = adjustment.candidates, adjustment.plan
        first_loss = bisect_left(candidates, True, key=lambda value: not plan(value).found)
        if first_loss < len(candidates):
            found.append(adjustment.change(first_loss - 1))
    return found


def _down(value: float, least: float) -> list[float]:
    """Return the multiples of a step below a value, the largest first."""
    first = math.ceil(min(value, _LARGEST_VALUE) / _STEP - 1e-6) - 1
    return [k / 100 for k in range(first, math.ceil(least / _STEP - 1e-6) - 1, -1)]


def _up(value: float, most: float) -> list[float]:
    first = math.floor(value / _STEP + 1e-6) + 1
    return [k / 100 for k in range(first, math.floor(most / _STEP + 1e-6) + 1)]


@dataclass(frozen=True)
class _Query:
    work: PlannerOnMap
    start: Pose
    goal: Pose

    def of_costmap(
        self, name: str, kind: str, value: Any, candidates: Sequence[Any], **more: Any
    ) -> Adjustment:
        def plan_with(candidate: Any) -> Plan:
            return self.work.plan_with(self.start, self.goal, (name, kind, candidate))

        return Adjustment(name, value, candidates, plan_with, **more)

    def of_planner(self, name: str, candidates: Sequence[Any]) -> Adjustment:
        work = self.work

        def plan_with(candidate: Any) -> Plan:
            planner = work.planner.with_value(name, candidate)
            listed = replace(work.listed, planner=planner, settings=planner.values)
            return plan_quickly(listed, work.grid, self.start, self.goal)

        value = work.planner.values[name]
        return Adjustment(f"{work.listed.name}.{name}", value, candidates, plan_with)

    def of_size(self, radii: Sequence[float], scales: Sequence[float]) -> Adjustment:
        """Return the adjustment of the robot's radius, or of its footprint by some factors."""
        radius = self.work.robot.robot_radius
        if radius is not None:
            return self.of_costmap("robot_radius", "double", radius, radii)
        text = self.work.parameters.for_node(self.work.robot.node)["footprint"].value
        corners = corners_of_string(text)

        def scaled(scale: float) -> str:
            points = (", ".join(f"{round(v * scale, 4):g}" for v in corner) for corner in corners)
            return f"[{', '.join(f'[{point}]' for point in points)}]"

        return self.of_costmap("footprint", "string", text, [*map(scaled, scales)], scales=scales)

    def adjustments(self, plan: Plan) -> Iterator[Adjustment]:
        """Yield the adjustments that may make a path exist."""
        work, robot, values = self.work, self.work.robot, self.work.planner.values
        for layer in robot.inflation_layers:
            name, radius = f"{layer.name}.inflation_radius", layer.inflation_radius
            inscribed, radii = layer.inscribed_radius, _down(radius, 0.0)
            yield self.of_costmap(name, "double", radius, radii, inscribed_radius=inscribed)
        yield self.of_size(_down(robot.robot_radius or 0.0, _STEP), _down(1.0, 0.05))
        padding = round(robot.footprint_padding, 6)  # a float32
        yield self.of_costmap("footprint_padding", "double", padding, _down(padding, 0.0))
        for layer in robot.inflation_layers if plan.is_reached else ():
            # costs below the inscribed one close no cell, but they lead the trace
            name, factor = f"{layer.name}.cost_scaling_factor", layer.cost_scaling_factor
            for sign in (1, -1):
                steps = (round(factor + sign * k / 10, 6) for k in range(1, _STEPS_BEYOND + 1))
                yield self.of_costmap(name, "double", factor, [step for step in steps if step > 0])
        if work.mask is not None and robot.has_keepout_filter and robot.why_mask_unused is None:
            for listed in robot.layers:
                if listed.needs == "mask":
                    yield self.of_costmap(f"{listed.name}.enabled", "bool", True, [False])
        if "tolerance" in values:
            yield self.of_planner("tolerance", _up(values["tolerance"], _FARTHEST_TOLERANCE))
        if values.get("allow_unknown") is False:
            yield self.of_planner("allow_unknown", [True])
        if "use_astar" in values:
            yield self.of_planner("use_astar", [not values["use_astar"]])
        if "max_cycles_factor" in values and plan.is_reached:
            factors = range(values["max_cycles_factor"] + 1, _MOST_CYCLES + 1)
            yield self.of_planner("max_cycles_factor", factors)

    def margins(self) -> Iterator[Adjustment]:
        """Yield the adjustments that may lose a path."""
        radius, values = self.work.robot.robot_radius or 0.0, self.work.planner.values
        yield self.of_size(_up(radius, radius + _WIDEST_PASSAGE), _up(1.0, _LARGEST_SCALE))
        if "tolerance" in values:
            yield self.of_planner("tolerance", _down(values["tolerance"], 0.0))
        if values.get("allow_unknown"):
            yield self.of_planner("allow_unknown", [False])


def _wider_passage(
    work: PlannerOnMap, start: Pose, goal: Pose, plan: Plan, occupied: Mask
) -> Iterator[Change]:
    costs, grid = work.grid.costs, work.grid
    (height, width), origin = costs.shape, (*grid.origin, 0.0)  # planners ignore the yaw
    frame = Frame(height, width, grid.resolution, origin)
    cells = np.where(costs == NO_INFORMATION, np.int8(UNKNOWN), np.int8(FREE))
    cells[costs == LETHAL_OBSTACLE] = OCCUPIED
    ground = Ground(cells, frame, work.planner.flag("allow_unknown"))
    if ground.blocked[grid.cell_of(start)]:
        return
    # Points on the map's border may lie outside by the last bit: the middles of their cells do not.
    start_xy, goal_xy = (_centres(work, *(grid.cell_of(pose) or (0, 0))) for pose in (start, goal))
    with capture_warnings():
        reach = reach_on(
            ground, None, start=start_xy, goals=[Goal(*goal_xy)], headings=4, margin=0.0,
            min_area=math.inf,
        )  # fmt: skip
    limit = reach.goals[0].limited_by
    if limit is None:
        return
    x, y = _centres(work, np.arange(height)[:, np.newaxis], np.arange(width))
    # Moved a little, so that hardly any centre of a cell lies on a circle of whole centimetres.
    place = rounded_place(limit.x + 0.0031, limit.y + 0.0017)
    squares = (x - place["x"]) ** 2 + (y - place["y"]) ** 2
    widths = _up(limit.width - 2 * _STEP, limit.width + _WIDEST_PASSAGE)

    def plan_with(index: int) -> Plan:
        cleared = occupied & (squares <= (widths[index] / 2) ** 2)
        return work.plan_without(start, goal, cleared)

    if found := first_success(len(widths), plan_with, now=plan):
        passage = {"map": "passage", **place, "from": round(limit.width, 6)}
        yield {**passage, "width": widths[found[0]], **({} if found[1] else {"monotonic": False})}


def _centres(work: PlannerOnMap, rows: Any, cols: Any) -> tuple[Any, Any]:
    """Return x and y of the centres of cells."""
    (x, y), resolution = work.grid.origin, work.grid.resolution
    return x + (cols + 0.5) * resolution, y + (rows + 0.5) * resolution


def _obstacle_in_the_way(
    work: PlannerOnMap, start: Pose, goal: Pose, occupied: Mask
) -> Iterator[Change]:
    from scipy import ndimage  # slow to import

    grid = work.grid
    if not occupied.any():
        return
    around = np.ones((3, 3), bool)
    labels, _ = ndimage.label(occupied, around)
    regions, near = _regions(work.listed, grid, start), _cells_near(work.planner.values, grid, goal)
    # The first and the last closed cell on the new way are closed by the obstacle alone.
    places = ndimage.distance_transform_edt(~occupied, return_distances=False, return_indices=True)
    nearest = labels[tuple(places)]

    def closing(region: Mask) -> set[int]:
        is_beside = ndimage.binary_dilation(region, around) & (regions == 0)
        return set(np.unique(nearest[is_beside]).tolist())

    of_goal = np.isin(regions, np.setdiff1d(regions[near], [0]))
    at_goal = set(np.unique(nearest[near & (regions == 0)]).tolist())
    in_the_way = closing(regions == regions[grid.cell_of(start)]) & (closing(of_goal) | at_goal)
    sizes = np.bincount(labels.ravel())
    most = _LARGEST_OBSTACLE / grid.resolution**2
    by_size = sorted((int(sizes[label]), label) for label in in_the_way if sizes[label] <= most)
    for size, label in by_size[:_MOST_OBSTACLES]:
        if work.plan_without(start, goal, labels == label).found:
            rows, cols = np.nonzero(labels == label)
            middle = np.argmin((rows - rows.mean()) ** 2 + (cols - cols.mean()) ** 2)
            x, y = _centres(work, rows[middle], cols[middle])
            area = size * grid.resolution**2
            yield {"map": "obstacle", **rounded_place(float(x), float(y)), "area": round(area, 6)}
            return
