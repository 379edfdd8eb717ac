"""The cheapest route through a costmap."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Point
from mapdeal.grid.route import Route
from mapdeal.kernels.shortest_paths import cheapest_path
from mapdeal.planning.terrain import NO_WAY, Terrain, check_factor


def shortest_route(
    costmap: Costmap,
    start_xy: Point,
    goal_xy: Point,
    *,
    cost_travel_multiplier: float = 2.0,
    field_weight: float = 0.0,
    heuristic_weight: float = 0.0,
    through_unknown: bool = False,
) -> Route:
    """Find the route of lowest cost through a costmap by A*, over eight neighbours per cell.

    Parameters
    ----------
    costmap : Costmap
        The costs. Lethal and inscribed cells are closed: 254 and 253, or 100 and 99 on scale
        ``occupancy``.
    start_xy, goal_xy : tuple of float
        Start and goal in the map frame, metres.
    cost_travel_multiplier : float
        Weight of costs relative to length, at least 0: a cell of cost c has the weight
        1 + multiplier * c / 252, or c / 98 on scale ``occupancy``.
    field_weight : float
        Additional weight near obstacles, at least 0: the weight of a cell grows by
        field_weight * (1 - d / 2) if its distance d to an obstacle is below 2 m.
    heuristic_weight : float
        Additional estimate near obstacles, at least 0, metres: the heuristic of a cell grows by
        heuristic_weight * (1 - d / 2) if its distance d to an obstacle is below 2 m. Above 0, the
        route need not have the lowest cost.
    through_unknown : bool
        Whether unknown cells are open; they then have the highest cost of an open cell.

    Returns
    -------
    Route
        The points are the start, the centres of cells, and the goal. If there is no route,
        `reached` is False and there are no points.

    Raises
    ------
    ParameterError
        If start or goal is outside the map or in a closed cell, or a number is not allowed.

    Notes
    -----
    A step costs its length, 1 or sqrt(2) cells, times the weight of the cell that it enters. If
    `heuristic_weight` is 0, no other route has a lower sum: the route is `optimal`.

    A weight in the heuristic postpones cells near obstacles: they are expanded after cells in the
    open whose routes cost up to heuristic_weight metres more. A cell is never reopened after its
    expansion, so the first route to it stays.

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
    surcharges = surcharges_near_obstacles(terrain, heuristic_weight)
    return route_over(terrain, start_xy, goal_xy, surcharges=surcharges)


def surcharges_near_obstacles(
    terrain: Terrain, heuristic_weight: float
) -> NDArray[np.float64] | None:  # fmt: skip
    """Return the heuristic's addition near obstacles, shape (H, W), or None."""
    # The unit is that of the search: cells of length and weight 1.
    if check_factor("heuristic_weight", heuristic_weight) == 0:
        return None
    surcharges = terrain.nearness()
    surcharges *= heuristic_weight / terrain.costmap.resolution
    return surcharges


def route_over(
    terrain: Terrain,
    start_xy: Point,
    goal_xy: Point,
    *,
    weights: NDArray[np.float64] | None = None,
    surcharges: NDArray[np.float64] | None = None,
) -> Route:
    first = terrain.open_cell_of(start_xy, "start")
    last = terrain.open_cell_of(goal_xy, "goal")
    searched = terrain.weights if weights is None else weights
    found = cheapest_path(searched, first, last, surcharges=surcharges)
    how: dict[str, Any] = {"expanded": found.expanded, "optimal": surcharges is None}
    if len(found.cells) == 0:
        none = np.empty((0, 2))
        return Route("astar", False, start_xy, goal_xy, none, **vars(NO_WAY), **how)
    places = found.cells + 0.5
    (start, goal), _ = terrain.costmap.frame.bounded_continuous_rowcol_from_xy([start_xy, goal_xy])
    # no hooks: the centres of the first and the last cell are left out where the way is clear
    begin = int(len(places) < 2 or terrain.is_clear(start, places[1]))
    end = len(places) - int(len(places) < 2 or terrain.is_clear(places[-2], goal))
    between = terrain.costmap.frame.xy_from_continuous_rowcol(places[begin : max(begin, end)])
    points = np.vstack([[start_xy], between, [goal_xy]])
    measures = terrain.measured(points)
    return Route("astar", True, start_xy, goal_xy, points, **vars(measures), **how)
