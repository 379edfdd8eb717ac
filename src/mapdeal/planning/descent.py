"""A route that follows the potential downhill, as a local planner does."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Point
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.reaching import Cell
from mapdeal.grid.route import Route
from mapdeal.planning.terrain import Place, Terrain

_STEPS = (0.5, 0.25, 0.125)
"""In cells, the longest first; a shorter one is tried where the longer one does not lead down."""

Ending = Literal["arrived", "minimum", "tired"]

_OFF = (-1e-6, 1e-6)
"""In cells: more than what rounding moves a place by."""

_STEPS_PER_CELL_OF_SIDE = 20
"""Bounds the number of steps: a way as long as ten times both sides of the map."""


def descend(
    costmap: Costmap,
    potential: PotentialField,
    start_xy: Point,
    *,
    cost_travel_multiplier: float = 2.0,
    through_unknown: bool = False,
) -> Route:
    """Follow the negative gradient of a potential from a start to its goal.

    Parameters
    ----------
    costmap : Costmap
        Costs on the same cells. Lethal and inscribed cells are closed: 254 and 253, or 100 and 99
        on scale ``occupancy``. Costs also determine the `cost` of the route; see `shortest_route`.
    potential : PotentialField
        Potential with a goal.
    start_xy : tuple of float
        Start in the map frame, metres.
    cost_travel_multiplier : float
        Weight of costs relative to length in the route's `cost`; it does not affect the path.
    through_unknown : bool
        Whether unknown cells are open.

    Returns
    -------
    Route
        If `reached` is False, the route ends in its `local_minimum`. If that is None, the route
        was abandoned after as many steps as would make it ten times as long as both sides of the
        map together.

    Raises
    ------
    ParameterError
        If the potential has no goal or another geometry, or start or goal is outside the map or
        in a closed cell.

    Notes
    -----
    Steps are half a cell long, or shorter where the potential, interpolated between the centres
    of cells, would not fall; it falls with every step. The route slides along closed cells, with
    steps along the rows or the columns alone. If no such step exists, the route takes the steepest
    way down to the centre of its cell or of a neighbour; a local minimum is a place from which
    there is none either. Every segment lies in open cells. The goal is reached from within a
    cell's length of it, or from within its cell, if nothing closed lies in between.

    The potential is interpolated from `PotentialField.downhill_surface`.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid, potential
    >>> grid = OccupancyGrid([[0, 0, 0, 0]], 0.5)
    >>> costmap, field = Costmap.from_occupancy(grid), potential(grid, goal=(1.75, 0.25))
    >>> route = descend(costmap, field, (0.3, 0.25))
    >>> route.reached, round(route.length, 6)
    (True, 1.45)
    """
    if not isinstance(potential, PotentialField):
        rule = "takes a PotentialField; potential makes one of a map"
        raise ParameterError(rule, source="descend", got=type(potential).__name__)
    if potential.goal is None:
        raise ParameterError("the potential has no goal to descend to")
    terrain = Terrain.of(
        costmap, cost_travel_multiplier=cost_travel_multiplier, through_unknown=through_unknown
    )
    if potential.frame != costmap.frame:
        raise ParameterError("potential and costmap must have the same cells")
    terrain.open_cell_of(start_xy, "start")
    terrain.open_cell_of(potential.goal, "goal")
    frame = costmap.frame
    start, goal = frame.continuous_rowcol_from_xy([start_xy, potential.goal]).tolist()
    slope = _Slope(potential.downhill_surface(), terrain)
    places, ending = _followed(slope, tuple(start), tuple(goal))
    points = frame.xy_from_continuous_rowcol(places)
    points[0] = start_xy
    minimum = None
    if ending == "arrived":
        points = np.vstack([points, [potential.goal]])
    elif ending == "minimum":
        minimum = (float(points[-1, 0]), float(points[-1, 1]))
    measures = terrain.measured(points)
    return Route(
        "descent",
        ending == "arrived",
        start_xy,
        potential.goal,
        points,
        **vars(measures),
        local_minimum=minimum,
    )


def _followed(slope: _Slope, start: Place, goal: Place) -> tuple[list[Place], Ending]:
    places = [start]
    most = _STEPS_PER_CELL_OF_SIDE * sum(slope.shape)
    while len(places) <= most:
        if slope.leads_to(places[-1], goal):
            return places, "arrived"
        following = slope.step_down(places[-1])
        if following is None:
            return places, "minimum"
        places.append(following)
    return places, "tired"


class _Slope:
    """Surface over the centres of cells, in cells, and the steps allowed on it."""

    def __init__(self, surface: NDArray[np.float64], terrain: Terrain) -> None:
        self.shape = surface.shape
        self._height, self._width = surface.shape
        self._values = surface.reshape(-1).data
        self._terrain = terrain

    def step_down(self, place: Place) -> Place | None:
        """Return the next place downhill, or None in a local minimum."""
        here = self.value_at(place)
        row, col = self._gradient_at(place)
        for along_rows, along_cols in ((row, col), (row, 0.0), (0.0, col)):
            length = math.hypot(along_rows, along_cols)
            for step in _STEPS if length > 0 else ():
                share = step / length
                following = (place[0] - share * along_rows, place[1] - share * along_cols)
                if self.value_at(following) < here and self._may_step(place, following):
                    return following
        return self._lowest_neighbour(place, here)

    def _may_step(self, place: Place, following: Place) -> bool:
        # open cells, and not the edge of a closed one: rounding would put it on either side
        corners = ((following[0] + row, following[1] + col) for row in _OFF for col in _OFF)
        return self._terrain.is_clear(place, following) and all(
            self._terrain.is_open(_cell_of(corner)) for corner in corners
        )

    def leads_to(self, place: Place, goal: Place) -> bool:
        is_near = math.dist(place, goal) <= 1.0 or _cell_of(place) == _cell_of(goal)
        return is_near and self._terrain.is_clear(place, goal)

    def value_at(self, place: Place) -> float:
        """Return the surface between the centres of cells, bilinear."""
        row, col = math.floor(place[0] - 0.5), math.floor(place[1] - 0.5)
        v, u = place[0] - 0.5 - row, place[1] - 0.5 - col
        south = (1 - u) * self._at(row, col) + u * self._at(row, col + 1)
        north = (1 - u) * self._at(row + 1, col) + u * self._at(row + 1, col + 1)
        return (1 - v) * south + v * north

    def _at(self, row: int, col: int) -> float:
        row, col = min(max(row, 0), self._height - 1), min(max(col, 0), self._width - 1)
        value: float = self._values[row * self._width + col]
        return value

    def _gradient_at(self, place: Place) -> tuple[float, float]:
        """Return the blend of the central differences at the four centres around a place."""
        row, col = math.floor(place[0] - 0.5), math.floor(place[1] - 0.5)
        v, u = place[0] - 0.5 - row, place[1] - 0.5 - col
        along_rows = along_cols = 0.0
        for r, c, share in (
            (row, col, (1 - v) * (1 - u)),
            (row, col + 1, (1 - v) * u),
            (row + 1, col, v * (1 - u)),
            (row + 1, col + 1, v * u),
        ):
            south, north = _beside(r, self._height)
            west, east = _beside(c, self._width)
            along_rows += share * (self._at(north, c) - self._at(south, c)) / max(north - south, 1)
            along_cols += share * (self._at(r, east) - self._at(r, west)) / max(east - west, 1)
        return along_rows, along_cols

    def _lowest_neighbour(self, place: Place, here: float) -> Place | None:
        """Return the centre of the steepest way down to a cell, this one or one beside it."""
        best, steepest = None, 0.0
        cell = _cell_of(place)
        for rows in (-1, 0, 1):
            for cols in (-1, 0, 1):
                beside = (cell[0] + rows, cell[1] + cols)
                if not self._terrain.is_open(beside):
                    continue
                centre = (beside[0] + 0.5, beside[1] + 0.5)
                drop, way = here - self._at(*beside), math.dist(place, centre)
                if way == 0 or drop / way <= steepest:
                    continue
                if self._terrain.is_clear(place, centre):
                    best, steepest = centre, drop / way
        return best


def _beside(index: int, length: int) -> tuple[int, int]:
    """Return the indices on both sides, or at the border the index itself on one."""
    index = min(max(index, 0), length - 1)
    return max(index - 1, 0), min(index + 1, length - 1)


def _cell_of(place: Place) -> Cell:
    return math.floor(place[0]), math.floor(place[1])
