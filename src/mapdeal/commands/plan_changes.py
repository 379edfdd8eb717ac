"""Parts of ``mapdeal plan``: a robot's planner on a map, and the changes that make a path exist.

A change is proposed only if the planner finds a path with it, but not with the next smaller change.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any, cast

import numpy as np

from mapdeal import errors, records
from mapdeal.grid import reaching, values as codes
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Frame, as_float32
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import Bottleneck, Goal
from mapdeal.kernels.arrays import Floats, Integers32, Mask
from mapdeal.kernels.searches import UNREACHED
from mapdeal.pipeline import inputs, recipe
from mapdeal.pipeline.folder import rounded_place
from mapdeal.planners.planner import Plan, Planner, PlannerGrid, Pose, no_plan
from mapdeal.ros import nav2, ros2_files
from mapdeal.ros.planners import ListedPlanner
from mapdeal.ros.robot import ParameterValue, RobotParameters, corners_of_string

_STEP = 0.01  # between the values of a parameter that are tried, in its unit
_LARGEST_VALUE = 1000.0
_LARGEST_TOLERANCE = 10.0  # metres
_LARGEST_CYCLES_FACTOR = 64
_LARGEST_SCALE = 4.0  # of a footprint
_LARGEST_INCREASE = 3.0  # metres by which a passage is widened, or a radius grows
_STEPS_BEYOND = 25  # tried where the goal can be reached, but the planner fails
_STEPS_AFTER = 4  # tried beyond a value with a path, to see whether the path stays
_MOST_OBSTACLES = 20  # that are removed one at a time
_LARGEST_OBSTACLE = 5.0  # square metres
_WHY_CLOSED = {codes.INSCRIBED_INFLATED_OBSTACLE: "nearer to an obstacle than the inscribed radius",
               codes.LETHAL_OBSTACLE: "in an obstacle",
               codes.NO_INFORMATION: "in unknown space"}  # fmt: skip
_EIGHT_NEIGHBOURS = np.ones((3, 3), bool)
_CACHED_BYTES = 1 << 26  # of costmaps

Override = tuple[str, str, Any]  # name, type and value of a costmap's parameter
Change = dict[str, Any]


@records.dataclass(frozen=True, eq=False)
class PlannerOnMap:
    source: inputs.MapInput
    robot: RobotParameters
    parameters: ros2_files.Ros2Parameters
    listed: ListedPlanner
    mask: inputs.KeepoutMask | None = None
    up_to_kilted: bool = False  # later releases have another inflation layer

    @property
    def planner(self) -> Planner:
        return cast("Planner", self.listed.planner)

    @cached_property
    def costmap(self) -> Costmap:
        return self.costmap_on(self.robot, self.source.occupancy)

    def costmap_on(self, robot: RobotParameters, grid: OccupancyGrid) -> Costmap:
        mask = self.mask if robot.why_mask_unused is None else None
        costs: Any = grid
        for step in recipe.load_recipe(None, robot=robot).steps:
            if mask is not None and step.accepts_mask:
                costs, mask = step.apply(costs, self.source.path, mask=mask.grid), None
            else:
                costs = step.apply(costs, self.source.path)
        return cast("Costmap", costs if mask is None else mask.over(costs))

    @cached_property
    def grid(self) -> PlannerGrid:
        return grid_of(self.costmap, self.robot)

    @cached_property
    def _grids(self) -> Callable[[Override], PlannerGrid | None]:
        count = max(1, _CACHED_BYTES // max(self.source.occupancy.occupancy.size, 1))
        return lru_cache(maxsize=count)(self._grid_with)

    def _grid_with(self, override: Override) -> PlannerGrid | None:
        name, kind, value = override
        values = {name: ParameterValue(value, kind, self.robot.paths[-1], 0, str(value))}
        with errors.capture_warnings():
            robot, problems = nav2.robot_in(
                self.parameters, namespace=self.robot.namespace, up_to_kilted=self.up_to_kilted,
                overrides=values)  # fmt: skip
            if robot is None or any(problem.level == "refused" for problem in problems):
                return None
            return grid_of(self.costmap_on(robot, self.source.occupancy), robot)

    def plan_with(self, start: Pose, goal: Pose, override: Override) -> Plan:
        if (grid := self._grids(override)) is None:
            return no_plan("PlannerException")
        return plan_quickly(self.listed, grid, start, goal)

    @cached_property
    def _clearances(self) -> Floats:
        squares = reaching.squares_to(self.grid.costs == codes.LETHAL_OBSTACLE)
        return np.asarray(np.sqrt(squares) * self.grid.resolution)

    def least_clearance(self, plan: Plan) -> tuple[float, tuple[float, float]]:
        """Return the least distance of a plan's poses to a lethal cell, and where that is."""
        cells = [self.grid.cell_of((x, y, 0.0)) for x, y, _ in plan.poses.tolist()]
        metres = [math.inf if cell is None else self._clearances[cell] for cell in cells]
        least = int(np.argmin(metres))
        x, y = plan.poses[least, :2].tolist()
        return float(metres[least]), (round(x, 6), round(y, 6))

    def stop_of(self, start: Pose, goal: Pose) -> tuple[tuple[float, float] | None, str | None]:
        """Return the place nearest to a goal that a search reaches, and why an end is closed."""
        cells = {"start": self.grid.cell_of(start), "goal": self.grid.cell_of(goal)}
        if None in cells.values():
            return None, None
        reached = _reached_cells(self.listed, self.grid, start)
        if compute_potential := getattr(self.listed.planner, "potential", None):
            if (potential := compute_potential(self.grid, start, goal)) is None:
                return None, None  # the start lies in the last half cell
            reached = potential < UNREACHED
        rows, cols = np.nonzero(reached)
        x, y = _centres(self, rows, cols)
        nearest = int(np.argmin((x - goal[0]) ** 2 + (y - goal[1]) ** 2))
        is_unknown_open = self.listed.settings.get("allow_unknown", True)
        closed_costs = _WHY_CLOSED.keys() - ({codes.NO_INFORMATION} if is_unknown_open else set())
        texts = []
        for end, cell in cells.items():
            cost = int(self.grid.costs[cell])
            if cost in closed_costs and (end == "goal" or len(rows) == 1):
                texts.append(f"the {end} lies {_WHY_CLOSED[cost]}")
        place = round(float(x[nearest]), 6), round(float(y[nearest]), 6)
        return place, " and ".join(texts) or None

    def plan_without(self, start: Pose, goal: Pose, cleared: Mask) -> Plan:
        grid = self.source.occupancy
        cells = np.where(cleared, np.int8(codes.FREE), np.asarray(grid.occupancy))
        with errors.capture_warnings():
            costs = self.costmap_on(self.robot, OccupancyGrid(cells, grid.resolution, grid.origin))
            return plan_quickly(self.listed, grid_of(costs, self.robot), start, goal)


def grid_of(costs: Costmap, robot: RobotParameters) -> PlannerGrid:
    cells: Any = np.ascontiguousarray(costs.cost)
    vertices = np.array(robot.footprint.vertices, dtype=np.float64)
    shape = vertices if robot.robot_radius is None else None
    origin = float(costs.origin[0]), float(costs.origin[1])
    return PlannerGrid(cells, as_float32(costs.resolution), origin, shape)


def _cells_near(values: Mapping[str, Any], grid: PlannerGrid, goal: Pose) -> Mask:
    """Return the cells within the planner's tolerance of a goal, in a square."""
    near = np.zeros(grid.costs.shape, bool)
    cells = min(values.get("tolerance", 0.0) / grid.resolution, max(near.shape))
    margin = max(math.ceil(cells), 0) + 1
    cell = grid.cell_of(goal) or (0, 0)
    near[tuple(slice(max(at - margin, 0), at + margin + 1) for at in cell)] = True
    return near


def _regions(listed: ListedPlanner, grid: PlannerGrid, start: Pose) -> Integers32:
    """Return the number of each open cell's connected region, 0 for closed cells."""
    from scipy import ndimage  # slow to import

    is_diagonal = listed.planner is None or listed.planner.moves_diagonally
    size = 1 if listed.planner is not None and is_diagonal else 2  # NavFn rounds the start up
    is_open = grid.costs < codes.INSCRIBED_INFLATED_OBSTACLE
    if listed.settings.get("allow_unknown", True):
        is_open |= grid.costs == codes.NO_INFORMATION
    row, col = grid.cell_of(start) or (0, 0)
    is_open[row : row + size, col : col + size] = True
    if listed.planner is None:
        # planners with headings check poses that are up to three cells apart
        is_open = ndimage.binary_dilation(is_open, _EIGHT_NEIGHBOURS, iterations=2)
    structure = _EIGHT_NEIGHBOURS if is_diagonal else None
    return np.asarray(ndimage.label(is_open, structure)[0])


def _reached_cells(listed: ListedPlanner, grid: PlannerGrid, start: Pose) -> Mask:
    regions = _regions(listed, grid, start)
    return np.asarray(regions == regions[grid.cell_of(start)])


def is_cut_off(listed: ListedPlanner, grid: PlannerGrid, start: Pose, goal: Pose) -> bool:
    if grid.cell_of(start) is None or grid.cell_of(goal) is None:
        return True
    near = _cells_near(listed.settings, grid, goal)
    return not (near & _reached_cells(listed, grid, start)).any()


def plan_quickly(listed: ListedPlanner, grid: PlannerGrid, start: Pose, goal: Pose) -> Plan:
    """Return the planner's plan; if the goal is cut off, skip the search and the exact reason."""
    if listed.planner is None or is_cut_off(listed, grid, start, goal):
        return no_plan("NoValidPathCouldBeFound")
    return listed.planner.plan(grid, start, goal)


@records.dataclass(frozen=True)
class Adjustment:
    """A parameter, its value, and the candidates to try instead, the nearest first."""

    name: str
    value: Any
    candidates: Sequence[Any]
    plan: Callable[[Any], Plan]
    scales: Sequence[float] = ()  # of a footprint, for each candidate
    inscribed_radius: float = 0.0

    def change(self, index: int, *, is_monotonic: bool = True) -> Change:
        """Return the change to a candidate; -1 stands for the value itself."""
        value = self.value if index < 0 else self.candidates[index]
        change: Change = {"parameter": self.name, "from": self.value, "to": value}
        radius = self.inscribed_radius
        if radius > 0 and value < radius:
            note = f"less than the inscribed radius {radius:.4g} m, so that the robot"
            change["note"] = f"{note} may touch obstacles"
        if self.scales:
            change["scale"] = 1.0 if index < 0 else self.scales[index]
        return change if is_monotonic else {**change, "monotonic": False}


def first_success(
    candidates: Sequence[Any], plan: Callable[[Any], Plan], *, current_plan: Plan
) -> tuple[int, bool] | None:
    """Return the index of the first candidate with a path, and whether paths stay beyond it.

    Reaching the goal is assumed to be monotonic. Finding a path is not: tracing it back may fail
    for single values.
    """
    count = len(candidates)
    plans: dict[int, Plan] = {}

    def planned(index: int) -> Plan:
        if index not in plans:
            plans[index] = plan(candidates[index])
        return plans[index]

    def reaches(index: int) -> bool:
        return planned(index).found or planned(index).is_reached

    if count < 1 or not (current_plan.is_reached or reaches(count - 1)):
        return None
    first = 0 if current_plan.is_reached else bisect_left(range(count - 1), True, key=reaches)
    for index in range(first, min(first + _STEPS_BEYOND, count)):
        if planned(index).found:
            next_indices = range(index, min(index + _STEPS_AFTER + 1, count))
            stays = all(planned(k).found for k in next_indices)
            return index, stays and all(plan.found for k, plan in plans.items() if k > index)
    return None


def changes_for(work: PlannerOnMap, start: Pose, goal: Pose, plan: Plan) -> list[Change] | None:
    """Return the smallest single changes that make the planner, if modelled, find a path."""
    if work.listed.planner is None:
        return None
    if plan.reason in ("StartOutsideMapBounds", "GoalOutsideMapBounds"):
        return []
    changes = [
        adjustment.change(success[0], is_monotonic=success[1])
        for adjustment in _Query(work, start, goal).adjustments(plan)
        if (success := first_success(adjustment.candidates, adjustment.plan, current_plan=plan))
    ]
    if not plan.is_reached:
        lethal = work.grid.costs == codes.LETHAL_OBSTACLE
        occupied = lethal & (np.asarray(work.source.occupancy.occupancy) > codes.FREE)
        changes += _wider_passage(work, start, goal, plan, occupied)
        changes += _obstacle_in_the_way(work, start, goal, occupied)
    return changes


def margins_of(work: PlannerOnMap, start: Pose, goal: Pose) -> list[Change]:
    """Return the last value of each parameter with which the planner still finds the path."""
    changes = []
    for adjustment in _Query(work, start, goal).margins():
        candidates, plan = adjustment.candidates, adjustment.plan
        first_loss = bisect_left(candidates, True, key=lambda value: not plan(value).found)
        if first_loss < len(candidates):
            changes.append(adjustment.change(first_loss - 1))
    return changes


def _steps_down(value: float, smallest: float) -> list[float]:
    """Return the multiples of a step below a value, the largest first."""
    first = math.ceil(min(value, _LARGEST_VALUE) / _STEP - 1e-6) - 1
    return [k / 100 for k in range(first, math.ceil(smallest / _STEP - 1e-6) - 1, -1)]


def _steps_up(value: float, largest: float) -> list[float]:
    first = math.floor(value / _STEP + 1e-6) + 1
    return [k / 100 for k in range(first, math.floor(largest / _STEP + 1e-6) + 1)]


@records.dataclass(frozen=True)
class _Query:
    work: PlannerOnMap
    start: Pose
    goal: Pose

    def of_costmap(
        self, name: str, kind: str, value: Any, candidates: Sequence[Any], **options: Any
    ) -> Adjustment:
        def plan_with(candidate: Any) -> Plan:
            return self.work.plan_with(self.start, self.goal, (name, kind, candidate))

        return Adjustment(name, value, candidates, plan_with, **options)

    def of_planner(self, name: str, candidates: Sequence[Any]) -> Adjustment:
        work = self.work

        def plan_with(candidate: Any) -> Plan:
            planner = work.planner.with_value(name, candidate)
            listed = records.replace(work.listed, planner=planner, settings=planner.values)
            return plan_quickly(listed, work.grid, self.start, self.goal)

        value = work.planner.values[name]
        return Adjustment(f"{work.listed.name}.{name}", value, candidates, plan_with)

    def of_size(self, radii: Sequence[float], scales: Sequence[float]) -> Adjustment:
        """Return the adjustment of the robot's radius, or of its footprint by factors."""
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
        work, robot, values = self.work, self.work.robot, self.work.planner.values
        for layer in robot.inflation_layers:
            name, radius = f"{layer.name}.inflation_radius", layer.inflation_radius
            inscribed, radii = layer.inscribed_radius, _steps_down(radius, 0.0)
            yield self.of_costmap(name, "double", radius, radii, inscribed_radius=inscribed)
        yield self.of_size(_steps_down(robot.robot_radius or 0.0, _STEP), _steps_down(1.0, 0.05))
        padding = round(robot.footprint_padding, 6)  # a float32
        yield self.of_costmap("footprint_padding", "double", padding, _steps_down(padding, 0.0))
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
            yield self.of_planner("tolerance", _steps_up(values["tolerance"], _LARGEST_TOLERANCE))
        if values.get("allow_unknown") is False:
            yield self.of_planner("allow_unknown", [True])
        if "use_astar" in values:
            yield self.of_planner("use_astar", [not values["use_astar"]])
        if "max_cycles_factor" in values and plan.is_reached:
            factors = range(values["max_cycles_factor"] + 1, _LARGEST_CYCLES_FACTOR + 1)
            yield self.of_planner("max_cycles_factor", factors)

    def margins(self) -> Iterator[Adjustment]:
        radius, values = self.work.robot.robot_radius or 0.0, self.work.planner.values
        radii = _steps_up(radius, radius + _LARGEST_INCREASE)
        yield self.of_size(radii, _steps_up(1.0, _LARGEST_SCALE))
        if "tolerance" in values:
            yield self.of_planner("tolerance", _steps_down(values["tolerance"], 0.0))
        if values.get("allow_unknown"):
            yield self.of_planner("allow_unknown", [False])


def _wider_passage(
    work: PlannerOnMap, start: Pose, goal: Pose, plan: Plan, occupied: Mask
) -> Iterator[Change]:
    """Yield the narrowest passage with which the planner finds a path, at the first bottleneck."""
    if (limit := _bottleneck(work, start, goal)) is None:
        return
    rows, cols = map(np.arange, work.grid.costs.shape)
    x, y = _centres(work, rows[:, np.newaxis], cols)
    # Moved a little, so that hardly any centre of a cell lies on a circle of whole centimetres.
    place = rounded_place(limit.x + 0.0031, limit.y + 0.0017)
    squares = (x - place["x"]) ** 2 + (y - place["y"]) ** 2
    widths = _steps_up(limit.width - 2 * _STEP, limit.width + _LARGEST_INCREASE)

    def plan_with(width: float) -> Plan:
        return work.plan_without(start, goal, occupied & (squares <= (width / 2) ** 2))

    if success := first_success(widths, plan_with, current_plan=plan):
        index, is_monotonic = success
        change = {"map": "passage", **place, "from": round(limit.width, 6), "width": widths[index]}
        yield change if is_monotonic else {**change, "monotonic": False}


def _bottleneck(work: PlannerOnMap, start: Pose, goal: Pose) -> Bottleneck | None:
    """Return the narrowest passage between start and goal; None if lethal cells separate them."""
    costs, grid = work.grid.costs, work.grid
    height, width = costs.shape
    frame = Frame(height, width, grid.resolution, (*grid.origin, 0.0))  # planners ignore the yaw
    cells = np.where(costs == codes.NO_INFORMATION, np.int8(codes.UNKNOWN), np.int8(codes.FREE))
    cells[costs == codes.LETHAL_OBSTACLE] = codes.OCCUPIED
    ground = reaching.Ground(cells, frame, work.planner.values["allow_unknown"])
    if ground.blocked[grid.cell_of(start)]:
        return None
    # Points on the map's border may lie outside by the last bit: the middles of their cells do not.
    start_xy, goal_xy = (_centres(work, *(grid.cell_of(pose) or (0, 0))) for pose in (start, goal))
    with errors.capture_warnings():
        reach = reaching.reach_on(ground, None, start=start_xy, goals=[Goal(*goal_xy)], headings=4,
                         margin=0.0, min_area=math.inf)  # fmt: skip
    return reach.goals[0].limited_by


def _centres(work: PlannerOnMap, rows: Any, cols: Any) -> tuple[Any, Any]:
    (x, y), resolution = work.grid.origin, work.grid.resolution
    return x + (cols + 0.5) * resolution, y + (rows + 0.5) * resolution


def _obstacle_in_the_way(
    work: PlannerOnMap, start: Pose, goal: Pose, occupied: Mask
) -> Iterator[Change]:
    """Yield the smallest obstacle without which the planner finds a path."""
    from scipy import ndimage  # slow to import

    if not occupied.any():
        return
    labels, _ = ndimage.label(occupied, _EIGHT_NEIGHBOURS)
    sizes = np.bincount(labels.ravel())
    most_cells = _LARGEST_OBSTACLE / work.grid.resolution**2
    in_the_way = _obstacles_between(work, start, goal, labels)
    small = sorted((int(sizes[label]), label) for label in in_the_way if sizes[label] <= most_cells)
    for size, label in small[:_MOST_OBSTACLES]:
        if work.plan_without(start, goal, labels == label).found:
            rows, cols = np.nonzero(labels == label)
            middle = np.argmin((rows - rows.mean()) ** 2 + (cols - cols.mean()) ** 2)
            x, y = _centres(work, rows[middle], cols[middle])
            area = size * work.grid.resolution**2
            yield {"map": "obstacle", **rounded_place(float(x), float(y)), "area": round(area, 6)}
            return


def _obstacles_between(work: PlannerOnMap, start: Pose, goal: Pose, labels: Integers32) -> set[int]:
    """Return the obstacles that close cells beside the region of the start and that of the goal.

    A path that one removed obstacle opens leaves the first region and enters the last one through
    cells that this obstacle alone has closed.
    """
    from scipy import ndimage  # slow to import

    grid = work.grid
    regions = _regions(work.listed, grid, start)
    near_goal = _cells_near(work.planner.values, grid, goal)
    cells = ndimage.distance_transform_edt(labels == 0, return_distances=False, return_indices=True)
    nearest_label = labels[tuple(cells)]

    def labels_beside(region: Mask) -> set[int]:
        is_beside = ndimage.binary_dilation(region, _EIGHT_NEIGHBOURS) & (regions == 0)
        return set(np.unique(nearest_label[is_beside]).tolist())

    at_start = labels_beside(regions == regions[grid.cell_of(start)])
    at_goal = labels_beside(np.isin(regions, np.setdiff1d(regions[near_goal], [0])))
    at_goal |= set(np.unique(nearest_label[near_goal & (regions == 0)]).tolist())
    return at_start & at_goal
