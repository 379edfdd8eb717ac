"""Stage ``reach``: where a robot can go from a start, and the passages that stop it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.footprint_cells import footprint_spans
from mapdeal.grid.frame import Frame
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.open_cells import Cell, cell_of_point, nearest_marked, nearest_open_text
from mapdeal.grid.passages import bottleneck_on_way, passages
from mapdeal.grid.reach import Goal, GoalReach, Reach, closed_text, reach_radius, robot_text
from mapdeal.grid.values import FREE, LETHAL_OBSTACLE, OCCUPIED, UNKNOWN
from mapdeal.grid.ways import Ways, WaysFrom, largest_closed_square
from mapdeal.kernels.clearance_tree import clearance_tree
from mapdeal.kernels.configuration_space import ConfigurationSpace, Pose, Reached
from mapdeal.kernels.distance import squared_distance
from mapdeal.kernels.threads import for_rows
from mapdeal.stages.definition import InPlaceOf, Parameters, RobotShape, stage
from mapdeal.stages.goal_parameters import Goals
from mapdeal.stages.obstacle_source import (
    check_lethal_threshold,
    obstacles_of,
    occupancy_with_obstacles,
)
from mapdeal.stages.parameters import (
    AT_LEAST_0,
    HEADINGS,
    METRES,
    POSE,
    SQUARE_METRES,
    LethalThreshold,
)

_TURN = 2 * math.pi
_DECIMALS = 9
_SHOWN = 3

_MEMORY = 14.0
"""Bytes for each cell: squares and basins take four each."""


def _shape_of(parameters: Parameters) -> Footprint | None:
    footprint: Footprint | None = parameters["footprint"]
    radius: float = parameters["radius"]
    return footprint or (Footprint.circle(radius) if radius > 0 else None)


def _memory_of_headings(parameters: Parameters) -> float:
    """Return the bytes for each cell that a robot with corners takes beyond `_MEMORY`.

    There is a bit for each heading.
    """
    shape = _shape_of(parameters)
    if shape is None or not shape.vertices:
        return 0.0
    count: int = parameters["headings"]
    return max(0.0, count / 8 + 5.0 - _MEMORY)


def _remark(_: Parameters, figures: Figures) -> str | None:
    """Return which goals a run does not reach, None if it reaches all."""
    missed = [name for name, is_reached in figures["goals"].items() if not is_reached]
    if not missed:
        return None
    names = ", ".join(missed[:_SHOWN]) + f" and {len(missed) - _SHOWN} more" * (
        len(missed) > _SHOWN
    )
    return f"not reachable: {names}"


@stage(
    name="reach",
    summary="Tell where a robot can go from a start, and which passages stop it.",
    title=lambda parameters: f"reach of {robot_text(_shape_of(parameters))}",
    memory=_MEMORY,
    more_memory=_memory_of_headings,
    is_whole=lambda _: True,
    hands_on=False,
    remark=_remark,
    robot=RobotShape("radius", ("footprint",), lambda footprint: {"footprint": footprint}),
    in_place_of={"footprint": InPlaceOf("radius", lambda p: reach_radius(p["footprint"]))},
)
def reach(
    source: OccupancyGrid | DistanceField | Costmap,
    *,
    start: Annotated[tuple[float, ...], POSE] | None = None,
    goals: Goals = (),
    radius: Annotated[float, AT_LEAST_0, METRES] = 0.0,
    footprint: Footprint | None = None,
    headings: Annotated[int, HEADINGS] = 72,
    through_unknown: bool = False,
    margin: Annotated[float, AT_LEAST_0, METRES] = 0.1,
    min_area: Annotated[float, AT_LEAST_0, SQUARE_METRES] = 1.0,
    lethal_threshold: LethalThreshold | None = None,
) -> Reach:
    """Return where a robot can go from a start, and the passages that stop it.

    Parameters
    ----------
    source : OccupancyGrid, DistanceField or Costmap
        The map. Of a field the obstacles are the field's; of costs they are the lethal cells, 254,
        or 100 on scale ``occupancy``, whatever the costs around them.
    start : tuple of float, optional
        Where the robot starts, x, y or x, y, yaw in the map frame. Without a yaw it starts in
        every heading that is open there; without a start, at the widest place of the largest open
        area.
    goals : tuple of Goal
        Places it should get to.
    radius : float
        The radius of a round robot; 0 is a point.
    footprint : Footprint, optional
        The robot's corners, or in a recipe {radius: R} of a round one.
    headings : int
        How many headings a robot with corners can have, 4..255.
    through_unknown : bool
        Whether unknown cells are open.
    margin : float
        Passages that leave less than this on either side of the robot are told, too.
    min_area : float
        Passages that cut off less than this are not told.
    lethal_threshold : int, optional
        Occupancy of an obstacle, 1..100; 100 for a map, a field's own for a field.

    Returns
    -------
    Reach
        Its layers, the answers for the goals, and the passages.

    Raises
    ------
    ParameterError
        If start or goal lies outside of the map, or the robot cannot stand at the start.
    MalformedInputError
        If it cannot stand anywhere.

    Notes
    -----
    A cell is open to a round robot if the distance of its centre to that of the nearest obstacle
    cell is larger than the radius; costmap_2d gives all others inscribed costs. Unknown cells are
    closed, but count for no distance. A pose of a robot with corners, the centre of a cell and
    a heading 2 pi k / `headings`, is open if no cell of the footprint, drawn as costmap_2d draws
    polygons, is an obstacle, unknown, or outside of the map.

    The robot moves to the 8 neighbours of its cell, diagonally only between two open straight
    ones, and turns on the spot to the next heading on either side.

    A goal in a cell that is closed to the robot is not reachable.

    Examples
    --------
    >>> from mapdeal.grid.occupancy import OccupancyGrid
    >>> rooms = [[0, 0, 0, 100, 0, 0, 0], [0, 0, 0, 0, 0, 0, 0], [0, 0, 0, 100, 0, 0, 0]]
    >>> found = reach(OccupancyGrid(rooms, 1.0), start=(0.5, 1.5), radius=0.9)
    >>> int(found.reachable.sum()), found.widest[1].tolist()
    (19, [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    """
    ground = _Ground.of(source, lethal_threshold, through_unknown=through_unknown)
    robot = _shape_of({"footprint": footprint, "radius": radius})
    asked = None if start is None else _checked_pose(start)
    first = None if asked is None else cell_of_point(ground.frame, (asked[0], asked[1]), "start")
    cells = [cell_of_point(ground.frame, (goal.x, goal.y), "goal") for goal in goals]
    # robots with corners first: what both need at once would take twice the memory
    stood = _stood(ground, robot, headings, first, asked, cells)
    ways = ground.ways() if stood.ways is None else stood.ways
    from_start = ways.begun_at(stood.first)
    answers = [
        _answer(goal, cell, int(counts.sum()), from_start)
        for goal, cell, counts in zip(goals, cells, stood.reached.headings, strict=True)
    ]
    has_corners = robot is not None and bool(robot.vertices)
    is_open = stood.headings > 0
    found = passages(
        ways,
        is_open,
        stood.first,
        radius=reach_radius(robot),
        margin=margin,
        min_area=min_area,
        circumscribed_radius=robot.circumscribed_radius if robot is not None else None,
        is_reached=stood.reached.reachable.view(np.bool_) if has_corners else None,
    )
    del is_open
    widest = from_start.widest(in_place=True)  # the basins are of no more use, nor the squares
    clearance = ways.clearance(in_place=True)
    return Reach(
        stood.reached.reachable,
        stood.headings,
        clearance,
        widest,
        ground.occupancy,
        ground.frame.resolution,
        ground.frame.origin,
        start=stood.start,
        robot=robot,
        heading_count=headings,
        through_unknown=through_unknown,
        goals=tuple(answers),
        passages=found,
    )


@dataclass(frozen=True, eq=False)
class _Ground:
    """What a robot meets.

    Parameters
    ----------
    occupancy : numpy.ndarray of int8, shape (H, W)
        The map: 100 is an obstacle, -1 unknown.
    frame : Frame
        Where it lies.
    through_unknown : bool
        Whether ways may lead through unknown cells.
    """

    occupancy: NDArray[np.int8]
    frame: Frame
    through_unknown: bool

    @classmethod
    def of(
        cls,
        source: OccupancyGrid | DistanceField | Costmap,
        lethal_threshold: int | None,
        *,
        through_unknown: bool,
    ) -> _Ground:
        """Return the ground of a map, a field or costs."""
        if isinstance(source, Costmap):
            occupancy = _of_costs(source, lethal_threshold)
        else:
            lethal_threshold = check_lethal_threshold(source, lethal_threshold)
            occupancy = np.asarray(source.occupancy)
            if isinstance(source, DistanceField) or lethal_threshold < OCCUPIED:
                obstacles = np.asarray(obstacles_of(source, lethal_threshold))
                occupancy = occupancy_with_obstacles(occupancy, obstacles)
        return cls(occupancy, source.frame, through_unknown)

    @property
    def obstacles(self) -> NDArray[np.bool_]:
        """The mask of obstacles, made anew each time: masks would take memory all the while."""
        obstacles: NDArray[np.bool_] = self.occupancy == OCCUPIED
        return obstacles

    @property
    def blocked(self) -> NDArray[np.bool_]:
        """The mask of cells that no way leads through, made anew each time."""
        blocked = self.obstacles
        if not self.through_unknown:
            for_rows(
                lambda rows: np.logical_or(
                    blocked[rows], self.occupancy[rows] == UNKNOWN, out=blocked[rows]
                ),
                blocked.shape,
            )
        return blocked

    def ways(self) -> Ways:
        """Return how wide the ways are."""
        squared = squared_distance(self.obstacles)
        traversable = self.blocked
        np.logical_not(traversable, out=traversable)
        return Ways(clearance_tree(squared, traversable), squared, self.frame)


def _of_costs(costs: Costmap, lethal_threshold: int | None) -> NDArray[np.int8]:
    """Return the map of a costmap's lethal and unknown cells."""
    lethal = LETHAL_OBSTACLE if costs.scale == "costmap2d" else OCCUPIED
    if lethal_threshold not in (None, OCCUPIED):
        rule = f"is for maps: of costs the lethal cells are obstacles, {lethal}"
        raise ParameterError(rule, place="lethal_threshold", got=lethal_threshold)
    occupancy = np.full(costs.shape, FREE, dtype=np.int8)
    occupancy[costs.cost == costs.unknown_value] = UNKNOWN
    occupancy[costs.cost == lethal] = OCCUPIED
    return occupancy


class _RoundPoses:
    """The poses of a round robot, which fits in all headings or none; as `ConfigurationSpace`."""

    def __init__(self, ways: Ways, closed_up_to: int, heading_count: int) -> None:
        self._ways, self._closed_up_to = ways, closed_up_to
        self._heading_count = heading_count
        self.headings = ways.is_open(closed_up_to).view(np.uint8)
        self.headings *= np.uint8(heading_count)

    def open_headings(self, row: int, col: int) -> NDArray[np.bool_]:
        """Return in which headings a cell is open."""
        return np.full(self._heading_count, self.headings[row, col] > 0)

    def reach(self, seeds: Sequence[Pose], cells: Sequence[Cell]) -> Reached:
        """Return what can be reached from a cell, and in which headings some cells are."""
        reachable = self._ways.begun_at(seeds[0][1:]).reachable(self._closed_up_to)
        shape = (len(cells), self._heading_count)
        headings = np.zeros(shape, dtype=np.bool_)
        for index, cell in enumerate(cells):
            headings[index] = reachable[cell]
        return Reached(reachable, headings)


@dataclass(frozen=True, eq=False)
class _Stood:
    """Where a robot can stand, and where it gets to from its start.

    Parameters
    ----------
    headings : numpy.ndarray of uint8, shape (H, W)
        In how many headings it can stand in each cell.
    start : tuple of float
        The start in the map frame.
    first : tuple of int
        Row and column of the start.
    reached : Reached
        What it reaches.
    ways : Ways, optional
        The ways of round robots, if they are known already.
    """

    headings: NDArray[np.uint8]
    start: tuple[float, ...]
    first: Cell
    reached: Reached
    ways: Ways | None


def _stood(
    ground: _Ground,
    robot: Footprint | None,
    heading_count: int,
    first: Cell | None,
    start: tuple[float, ...] | None,
    cells: Sequence[Cell],
) -> _Stood:
    """Return where a robot can stand, and what it reaches from its start, or a chosen one.

    Raises
    ------
    MalformedInputError
        If it can stand nowhere.
    ParameterError
        If it cannot stand at its start.
    """
    ways = None
    closed_up_to = largest_closed_square(reach_radius(robot), ground.frame)
    poses: _RoundPoses | ConfigurationSpace
    if robot is None or not robot.vertices:
        ways = ground.ways()
        widest = ways.widest_place(closed_up_to) if start is None else None
        poses = _RoundPoses(ways, closed_up_to, heading_count)
    else:
        widest = ground.ways().widest_place(closed_up_to) if start is None else None
        footprints = footprint_spans(robot, ground.frame, heading_count)
        poses = ConfigurationSpace(ground.blocked, footprints)
    if not poses.headings.any():
        raise MalformedInputError(f"no cell is open to {robot_text(robot)}")
    if first is None or start is None:
        # there may be no room for the robot's corners, or none for a circle within them
        first = nearest_marked(poses.headings > 0, widest or (0, 0)) or (0, 0)
        start = tuple(ground.frame.xy_from_rowcol([first])[0].round(_DECIMALS).tolist())
    seeds = [(heading, *first) for heading in _headings_at(poses, first, start, ground, robot)]
    return _Stood(poses.headings, start, first, poses.reach(seeds, cells), ways)


def _checked_pose(start: Sequence[float]) -> tuple[float, ...]:
    """Return a start as x, y or x, y, yaw."""
    if len(start) not in (2, 3):
        raise ParameterError("must be x,y or x,y,yaw", place="start", got=tuple(start))
    return tuple(start)


def _headings_at(
    poses: _RoundPoses | ConfigurationSpace,
    first: Cell,
    start: Sequence[float],
    ground: _Ground,
    robot: Footprint | None,
) -> list[int]:
    """Return the headings to start in: the one that is asked for, or all that are open.

    Raises
    ------
    ParameterError
        If that is closed, or all are.
    """
    is_open = poses.open_headings(*first)
    if not is_open.any():
        square = int(squared_distance(ground.obstacles)[first])
        clearance = math.sqrt(square) * ground.frame.resolution
        what = closed_text(int(ground.occupancy[first]), clearance, robot)
        hint = nearest_open_text(ground.frame, poses.headings > 0, first)
        raise ParameterError(
            f"lies in a closed cell ({what})", place="start", got=tuple(start[:2]), hint=hint
        )
    turns = np.flatnonzero(is_open)
    if len(start) == 2:
        return [int(heading) for heading in turns]
    count = len(is_open)
    heading = round(start[2] / _TURN * count) % count
    if not is_open[heading]:
        away = np.abs((turns - heading + count // 2) % count - count // 2)
        nearest = float(turns[np.argmin(away)]) * _TURN / count
        rule = f"the robot cannot stand there in this heading, only in {len(turns)} of {count}"
        hint = f"the nearest open heading is {nearest:.4g}; without a yaw all that are open count"
        raise ParameterError(rule, place="start", got=tuple(start), hint=hint)
    return [heading]


def _answer(goal: Goal, cell: Cell, heading_count: int, from_start: WaysFrom) -> GoalReach:
    """Return the answer for a goal."""
    widest = from_start.ways.metres_of(from_start.widest_square_at(cell))
    limited_by = None
    if from_start.rooted is not None:
        limited_by = bottleneck_on_way(from_start.ways, from_start.rooted, from_start.start, cell)
    return GoalReach(goal, bool(heading_count), int(heading_count), widest, limited_by)
