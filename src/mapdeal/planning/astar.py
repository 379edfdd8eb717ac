"""The cheapest route through a costmap."""

from __future__ import annotations

import math

import numpy as np

from mapdeal.grid.coordinates import Point
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.route import Route
from mapdeal.kernels.shortest_paths import cheapest_path
from mapdeal.planning.terrain import Terrain


def shortest_route(
    costmap: Costmap,
    start_xy: Point,
    goal_xy: Point,
    *,
    cost_travel_multiplier: float = 2.0,
    field_weight: float = 0.0,
    through_unknown: bool = False,
) -> Route:
    """Return the route of the lowest cost over the eight neighbours of cells, by A*.

    Parameters
    ----------
    costmap : Costmap
        The costs. Lethal and inscribed cells are closed: 254 and 253, or 100 and 99 on scale
        ``occupancy``.
    start_xy, goal_xy : tuple of float
        Points in the map frame, metres.
    cost_travel_multiplier : float
        How much costs count against length, at least 0: the weight of a cell of cost c is
        1 + multiplier * c / 252, or c / 98 on scale ``occupancy``.
    field_weight : float
        How much nearness to obstacles counts on top, at least 0: the weight grows by
        field_weight * (1 - d / 2) where an obstacle is d < 2 m away.
    through_unknown : bool
        Whether unknown cells are open; they then have the highest cost.

    Returns
    -------
    Route
        Its points are the start, centres of cells, and the goal. If there is no way it is not
        `reached` and has no points.

    Raises
    ------
    ParameterError
        If start or goal is outside of the map or in a closed cell, or a number not allowed.

    Notes
    -----
    A step is as long as it is, 1 or the root of 2 cells, times the weight of the cell that it
    enters. No sum of these is lower: the answer is the optimum. Design document 000 adds the
    field's value to the heuristic instead, with which the answer depends on the order of the
    search; here the same value is a part of the cost.

    Diagonal steps between two closed cells are not allowed.

    Examples
    --------
    >>> from mapdeal.grid.costmap import Costmap
    >>> wall = Costmap([[0, 0, 0], [0, 254, 254], [0, 0, 0]], 0.5)
    >>> route = shortest_route(wall, (1.25, 0.25), (1.25, 1.25))
    >>> route.reached, round(route.length, 6), round(route.min_clearance, 6)
    (True, 2.414214, 0.5)
    """
    terrain = Terrain.of(
        costmap,
        cost_travel_multiplier=cost_travel_multiplier,
        field_weight=field_weight,
        through_unknown=through_unknown,
    )
    first = terrain.open_cell_of(start_xy, "start")
    last = terrain.open_cell_of(goal_xy, "goal")
    found = cheapest_path(terrain.weights, first, last)
    if found is None:
        empty = np.empty((0, 2))
        return Route("astar", False, start_xy, goal_xy, empty, math.nan, math.nan, math.nan)
    places = found[0] + 0.5
    (start, goal), _ = costmap.frame.bounded_continuous_rowcol_from_xy([start_xy, goal_xy])
    # no hooks: the centres of the first and the last cell are left out where the way is clear
    begin = int(len(places) < 2 or terrain.is_clear(start, places[1]))
    end = len(places) - int(len(places) < 2 or terrain.is_clear(places[-2], goal))
    between = costmap.frame.xy_from_continuous_rowcol(places[begin : max(begin, end)])
    points = np.vstack([[start_xy], between, [goal_xy]])
    return Route("astar", True, start_xy, goal_xy, points, *terrain.measured(points))
