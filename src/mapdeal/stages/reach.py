"""Stage ``reach``: where a robot can go from a start, and the passages that stop it."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mapdeal import command
from mapdeal.errors import ParameterError
from mapdeal.grid import costmap, field, frame
from mapdeal.grid.footprint import Footprint, FootprintLike, shape_of
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import Reach, reach_radius, robot_text
from mapdeal.grid.values import FREE, LETHAL_OBSTACLE, OCCUPIED, UNKNOWN, few_text
from mapdeal.stages.cost import check_lethal_threshold, closed_by, obstacles_of
from mapdeal.stages.structured import Goals, accept_goals

_MOST_SHOWN = 3
_MEMORY = 15.0  # bytes per cell: four each for squares and basins; 14.3 were measured


def _shape_of(parameters: command.Parameters) -> Footprint | None:
    footprint: Footprint | None = parameters["footprint"]
    radius: float = parameters["radius"]
    return footprint or (Footprint.circle(radius) if radius > 0 else None)


def _memory_of_headings(parameters: command.Parameters) -> float:
    shape = _shape_of(parameters)
    if shape is None or not shape.vertices:
        return 0.0
    count: int = parameters["headings"]
    return max(0.0, count / 8 + 5.0 - _MEMORY)


def _remark(_: command.Parameters, figures: frame.Figures) -> str | None:
    missed = [name for name, is_reached in figures["goals"].items() if not is_reached]
    if not missed:
        return None
    stopped_by = figures["stopped_by"]
    texts = [f"{name} ({stopped_by[name]})" if name in stopped_by else name for name in missed]
    return f"not reachable: {few_text(texts, _MOST_SHOWN)}"


@command.stage(
    name="reach",
    summary="Show where a robot can go from a start, and which passages stop it.",
    title=lambda parameters: f"reach of {robot_text(_shape_of(parameters))}",
    memory=_MEMORY,
    more_memory=_memory_of_headings,
    is_whole=lambda _: True,
    passes_output_on=False,
    accepts_mask=lambda _: True,
    remark=_remark,
    robot=command.RobotShape("radius", ("footprint",), lambda footprint: {"footprint": footprint}),
    in_place_of={"footprint": command.InPlaceOf("radius", lambda p: reach_radius(p["footprint"]))},
)
def reach(
    source: OccupancyGrid | field.DistanceField | costmap.Costmap,
    *,
    start: Annotated[tuple[float, ...], command.POSE] | None = None,
    goals: Goals = (),
    radius: Annotated[float, command.AT_LEAST_0, command.METRES, command.FromRobot] = 0.0,
    footprint: FootprintLike | None = None,
    headings: Annotated[int, command.HEADINGS] = 72,
    through_unknown: bool = False,
    margin: Annotated[float, command.AT_LEAST_0, command.METRES] = 0.1,
    min_area: Annotated[float, command.AT_LEAST_0, command.SQUARE_METRES] = 1.0,
    lethal_threshold: command.LethalThreshold | None = None,
    mask: Annotated[OccupancyGrid | None, command.OnlyInPython] = None,
) -> Reach:
    """Compute where a robot can go from a start, and the passages that stop it.

    Parameters
    ----------
    source : OccupancyGrid, DistanceField or Costmap
        The map. For a field, the field's obstacles are used; for costs, only the lethal cells are
        obstacles: 254, or 100 on scale ``occupancy``.
    start : tuple of float, optional
        Start of the robot, x, y or x, y, yaw in the map frame. Without a yaw it starts in every
        heading that is free there; without a start, at the widest place of the largest free area.
    goals : tuple of Goal
        Places that it should reach.
    radius : float
        Radius of a round robot, metres; 0 is a point.
    footprint : Footprint, optional
        The robot's corners, or in a recipe {radius: R} for a round robot.
    headings : int
        Number of headings for a robot with corners, 4..255.
    through_unknown : bool
        Whether unknown cells count as free.
    margin : float
        Clearance on either side of the robot below which passages are reported as well, metres.
    min_area : float
        Passages that cut off less than this are left out, square metres.
    lethal_threshold : int, optional
        Least occupancy of an obstacle, 1..100; 100 for a map, the field's own for a field.
    mask : OccupancyGrid, optional
        Keepout mask, as for `apply_keepout_mask`: where it is 100 the robot's centre must not be.

    Returns
    -------
    Reach
        Reachable cells and other layers, the results for the goals, and the passages.

    Raises
    ------
    ParameterError
        If the start lies outside the map, or the robot cannot stand there.
    MalformedInputError
        If the robot cannot stand anywhere.

    Notes
    -----
    A cell is open to a round robot if the distance between its centre and that of the nearest
    obstacle cell, or cell outside the map, is larger than the radius. Around obstacles all other
    cells have at least inscribed cost in costmap_2d. Unknown cells are closed, but do not count as
    obstacles for distances. A pose of a robot with corners, the centre of a cell and a heading
    2 pi k / `headings`, is open if no cell of the footprint, rasterised like polygons in
    costmap_2d, is an obstacle, unknown, or outside the map.

    The robot moves to the 8 neighbours of its cell, diagonally only if both adjacent straight
    neighbours are open, and turns in place to the next heading on either side. A goal outside the
    map, or in a cell that is closed to the robot, is not reachable.

    Examples
    --------
    >>> rooms = [[0, 0, 0, 100, 0, 0, 0], [0, 0, 0, 0, 0, 0, 0], [0, 0, 0, 100, 0, 0, 0]]
    >>> found = reach(OccupancyGrid(rooms, 1.0), start=(0.5, 1.5), radius=0.9)
    >>> int(found.reachable.sum()), found.widest[1, 3:].tolist()
    (19, [1.0, 1.0, 1.0, 1.0])
    """
    from mapdeal.grid.reaching import Ground, reach_on  # rarely used, and slow to import

    shape = shape_of(footprint)
    if radius and shape is not None and not math.isclose(radius, reach_radius(shape)):
        raise ParameterError("cannot be given together with footprint", place="radius", got=radius)
    occupancy = _occupancy_of(source, lethal_threshold)
    closed = None if mask is None else closed_by(mask, source.frame)
    ground = Ground(occupancy, source.frame, through_unknown, closed)
    return reach_on(
        ground, _shape_of({"footprint": shape, "radius": radius}), start=start,
        goals=accept_goals("goals", goals), headings=headings, margin=margin, min_area=min_area,
    )  # fmt: skip


def _occupancy_of(
    source: OccupancyGrid | field.DistanceField | costmap.Costmap, lethal_threshold: int | None
) -> NDArray[np.int8]:
    """Return a map, a field or costs as occupancy in which every obstacle is 100."""
    if isinstance(source, costmap.Costmap):
        lethal = LETHAL_OBSTACLE if source.scale == "costmap2d" else OCCUPIED
        if lethal_threshold not in (None, OCCUPIED):
            rule = f"applies to maps: of costs the lethal cells are obstacles, {lethal}"
            raise ParameterError(rule, place="lethal_threshold", got=lethal_threshold)
        occupancy = np.full(source.shape, FREE, dtype=np.int8)
        occupancy[source.cost == source.unknown_value] = UNKNOWN
        occupancy[source.cost == lethal] = OCCUPIED
        return occupancy
    threshold = check_lethal_threshold(source, lethal_threshold)
    occupancy = np.asarray(source.occupancy)
    if isinstance(source, field.DistanceField) or threshold < OCCUPIED:
        return np.where(np.asarray(obstacles_of(source, threshold)), np.int8(OCCUPIED), occupancy)
    return occupancy
