"""Computation of where a robot can go: the map it moves on, where it can stand, what it reaches."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.grid.coordinates import check_point
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.footprint_cells import footprint_spans
from mapdeal.grid.open_cells import Cell, cell_of_point, nearest_marked, nearest_open_text
from mapdeal.grid.passages import bottleneck_on_way, passages
from mapdeal.grid.reach import (
    Goal,
    GoalReach,
    Reach,
    reach_radius,
    robot_text,
    width_of,
)
from mapdeal.grid.values import OCCUPIED, UNKNOWN
from mapdeal.grid.ways import Ground, Ways, WaysFrom, largest_closed_square, squares_to
from mapdeal.kernels.configuration_space import ConfigurationSpace, Pose, Reached
from mapdeal.records import dataclass

_TURN = 2 * math.pi
_DECIMALS = 9


def reach_on(
    ground: Ground,
    robot: Footprint | None,
    *,
    start: Sequence[float] | None,
    goals: Sequence[Goal],
    headings: int,
    margin: float,
    min_area: float,
) -> Reach:
    """Compute where a robot can go; see the stage ``reach``."""
    asked = None if start is None else _checked_pose(start)
    first = None if asked is None else cell_of_point(ground.frame, (asked[0], asked[1]), "start")
    points = [check_point((goal.x, goal.y), _name_of(goal)) for goal in goals]
    cells = [(row, col) for row, col in ground.frame.unbounded_rowcol_from_xy(points).tolist()]
    inside = [cell for cell in cells if ground.frame.holds(cell)]
    # robots with corners first: what both need at once would take twice the memory
    stood = _stood(ground, robot, headings, first, asked, inside)
    ways = ground.ways() if stood.ways is None else stood.ways
    from_start = ways.begun_at(stood.first)
    is_open = stood.headings > 0
    counts = dict(zip(inside, stood.reached.headings.sum(axis=1).tolist(), strict=True))
    answers = [
        _answer(goal, cell, counts.get(cell, 0), from_start, ground, robot, is_open)
        for goal, cell in zip(goals, cells, strict=True)
    ]
    has_corners = robot is not None and bool(robot.vertices)
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
        through_unknown=ground.through_unknown,
        goals=tuple(answers),
        passages=found,
    )


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
    """Where a robot can stand, and where it gets to from its start."""

    headings: NDArray[np.uint8]
    start: tuple[float, ...]
    first: Cell
    reached: Reached
    ways: Ways | None


def _stood(
    ground: Ground,
    robot: Footprint | None,
    heading_count: int,
    first: Cell | None,
    start: tuple[float, ...] | None,
    cells: Sequence[Cell],
) -> _Stood:
    """Return where a robot can stand, and what it reaches from its start, or a chosen one."""
    ways = None
    closed_up_to = largest_closed_square(reach_radius(robot), ground.frame)
    poses: _RoundPoses | ConfigurationSpace
    if robot is None or not robot.vertices:
        ways = ground.ways()
        widest = _widest_place(ground, ways, closed_up_to) if start is None else None
        poses = _RoundPoses(ways, closed_up_to, heading_count)
    else:
        widest = None
        if start is None:
            widest = _widest_place(ground, ground.ways(), closed_up_to)
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


def _widest_place(ground: Ground, ways: Ways, closed_up_to: int) -> Cell | None:
    """Return where to start if nobody says: in the largest area, the place with the most room.

    Unknown cells that are closed count here, too: a stray beam far from all obstacles is no room.
    """
    inside = ways.in_largest_area(closed_up_to)
    if inside is None:
        return None
    room = squares_to(ground.blocked)
    room[~inside] = -1
    places = np.flatnonzero(room == room.max())
    best = places[np.argmax(ways.squared.reshape(-1)[places])]  # of equal ones away from walls
    row, col = divmod(int(best), room.shape[1])
    return row, col


def _checked_pose(start: Sequence[float]) -> tuple[float, ...]:
    """Return a start as x, y or x, y, yaw."""
    if len(start) not in (2, 3):
        raise ParameterError("must be x,y or x,y,yaw", place="start", got=tuple(start))
    return tuple(start)


def _headings_at(
    poses: _RoundPoses | ConfigurationSpace,
    first: Cell,
    start: Sequence[float],
    ground: Ground,
    robot: Footprint | None,
) -> list[int]:
    """Return the headings to start in: the one that is asked for, or all that are open."""
    is_open = poses.open_headings(*first)
    if not is_open.any():
        square = int(squares_to(ground.obstacles)[first])
        rule = f"lies in a closed cell ({_closed_text(ground, first, square, robot)})"
        hint = nearest_open_text(ground.frame, poses.headings > 0, first)
        raise ParameterError(rule, place="start", got=tuple(start[:2]), hint=hint)
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


def _name_of(goal: Goal) -> str:
    return "goal" if goal.name is None else f"goal {goal.name}"


def _closed_text(ground: Ground, cell: Cell, square: int, robot: Footprint | None) -> str:
    """Return what a closed cell is, given its squared distance from obstacles and the edge."""
    if not ground.frame.holds(cell):
        return "outside of the map"
    if ground.occupancy[cell] == OCCUPIED:
        return "an obstacle"
    if robot is not None and robot.vertices:
        return "too narrow for the robot in every heading"
    if ground.occupancy[cell] == UNKNOWN and not ground.through_unknown:
        return "unknown"
    clearance = width_of(square, ground.frame.resolution) / 2
    row, col = cell
    height, width = ground.frame.shape
    to_edge = min(row + 1, height - row, col + 1, width - col)
    what = "the map's edge" if to_edge**2 == square else "an obstacle"
    return f"{clearance:.4g} m from {what}, the robot's radius is {reach_radius(robot):.4g} m"


def _answer(
    goal: Goal,
    cell: Cell,
    heading_count: int,
    from_start: WaysFrom,
    ground: Ground,
    robot: Footprint | None,
    is_open: NDArray[np.bool_],
) -> GoalReach:
    """Return the answer for a goal in a cell, which may lie outside of the map."""
    frame = ground.frame
    widest, limited_by, square = 0.0, None, 0
    if frame.holds(cell):
        square = int(from_start.ways.squared[cell])
        widest = width_of(from_start.widest_square_at(cell), frame.resolution) / 2
        limited_by = bottleneck_on_way(from_start, cell)
        if is_open[cell]:
            return GoalReach(goal, heading_count > 0, heading_count, widest, limited_by)
    reason = _closed_text(ground, cell, square, robot)
    x, y = frame.xy_from_rowcol([nearest_marked(is_open, cell) or cell])[0].tolist()
    return GoalReach(goal, False, 0, widest, limited_by, reason, (x, y))
