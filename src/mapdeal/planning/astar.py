"""The cheapest route through a costmap."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.coordinates import Point
from mapdeal.grid.costmap import Costmap
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
    heuristic_weight : float
        How much nearness to obstacles counts in the heuristic, metres, at least 0: the estimate of
        what remains to the goal grows by heuristic_weight * (1 - d / 2) where an obstacle is
        d < 2 m away. Above 0 the route need not have the lowest cost.
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
    enters. Without a `heuristic_weight` no sum of these is lower: the route is `optimal`.

    A weight in the heuristic puts cells off that are near to obstacles: they are looked at after
    cells in the open through which the way costs up to heuristic_weight metres more. No cell is
    opened again once its neighbours were looked at, so the way that came first stays.

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
    """Return what the heuristic adds for nearness to obstacles, shape (H, W), or None.

    In the unit that a search sums in: cells of length and weight 1.

    Raises
    ------
    ParameterError
        If the number is negative, not finite or above 1e6.
    """
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
    """Return the route that a search finds on a terrain, and its measures on that terrain.

    Parameters
    ----------
    terrain : Terrain
        Which cells are closed, and what the route costs.
    start_xy, goal_xy : tuple of float
        Points in the map frame, metres.
    weights : numpy.ndarray of float64, shape (H, W), optional
        What the search goes by, if not by the terrain's own weights; 0 in the same cells.
    surcharges : numpy.ndarray of float64, shape (H, W), optional
        What the heuristic adds, see `surcharges_near_obstacles`.

    Raises
    ------
    ParameterError
        If start or goal is outside of the map or in a closed cell.
    """
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
