"""Shortest routes around closed cells: down the lengths to a goal, and then pulled tight."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Point
from mapdeal.grid.goal_field import SEEN_WITHIN, Place, is_line_clear, lengths_to, may_step
from mapdeal.grid.reach import Method, Route
from mapdeal.kernels.polygons import Cell
from mapdeal.planning.routes import Terrain

Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]

_OFF = 1e-6  # in cells: how far taut lines cut corners, more than rounding moves a place by
_BESIDE = (
    1e-3  # in cells: how far routes pass by corners, so that rounded points stay in open cells
)
_TOUCHING = 4e-3  # in cells: corners nearer to a taut line become bends
_ROUNDING = 1e-9  # of angles in radians, and of lengths in cells
_LONGEST_STEP = 0.5
_MOST_PARTS, _MOST_PARTS_OF_SIDE = 1 << 21, 16
_STEPS = tuple((row, col) for row in (-1, 0, 1) for col in (-1, 0, 1) if row or col)


def shortest_way(
    costmap: Costmap,
    start_xy: Point,
    goal_xy: Point,
    *,
    cost_travel_multiplier: float = 2.0,
    through_unknown: bool = False,
) -> Route:
    """Find the shortest route in any direction around the closed cells of a costmap.

    Parameters
    ----------
    costmap : Costmap
        Costs, of which only those of closed cells matter; these are as for `shortest_route`.
    start_xy, goal_xy : tuple of float
        Start and goal in the map frame, metres.
    cost_travel_multiplier : float
        Weight of costs relative to length in the route's `cost`; it does not affect the path.
    through_unknown : bool
        Whether unknown cells are open.

    Returns
    -------
    Route
        Its points are at most half a cell apart. If there is no route, `reached` is False and there
        are no points.

    Raises
    ------
    ParameterError
        If start or goal is outside the map or in a closed cell.

    Notes
    -----
    The route descends the lengths to the goal from cell to cell (see `potential`, `cost_to_go`) and
    is then pulled tight: no route that passes closed cells on the same sides is shorter. It bends
    at corners of closed cells alone, a thousandth of a cell away from them.

    Examples
    --------
    >>> from mapdeal.grid.costmap import Costmap
    >>> wall = Costmap([[0, 0, 0], [0, 254, 254], [0, 0, 0]], 0.5)
    >>> route = shortest_way(wall, (1.25, 0.25), (1.25, 1.25))
    >>> route.reached, round(route.length, 2)
    (True, 2.08)
    """
    terrain = Terrain.of(
        costmap, cost_travel_multiplier=cost_travel_multiplier, through_unknown=through_unknown
    )
    return shortest_over(terrain, start_xy, goal_xy)


def shortest_over(terrain: Terrain, start_xy: Point, goal_xy: Point) -> Route:
    terrain.open_cell_of(start_xy, "start")
    terrain.open_cell_of(goal_xy, "goal")
    frame = terrain.costmap.frame
    places, _ = frame.bounded_continuous_rowcol_from_xy([start_xy, goal_xy])
    start, goal = (tuple(place) for place in places.tolist())
    is_open = terrain.weights > 0
    line = _tight_way(is_open, start, goal)
    if line is None:
        none, nan = np.empty((0, 2)), math.nan
        return Route("geodesic", False, start_xy, goal_xy, none, nan, nan, nan)
    line = min(line, _finer_way(is_open, line), key=_length)
    points = frame.xy_from_continuous_rowcol(_in_steps(np.array(line)))
    points[0], points[-1] = start_xy, goal_xy
    return Route("geodesic", True, start_xy, goal_xy, points, **terrain.measured(points))


def route_in_window(
    terrain: Terrain, find: Callable[[Point, Point], Route], start_xy: Point, goal_xy: Point, *,
    by_length: bool, known: Terrain | None = None,
) -> Route:  # fmt: skip
    """Return a route to a goal, or to the border on the way to one that is beyond the terrain.

    `find` finds a route to a point, by its length or its cost. The rest from a border cell to the
    goal is the straight distance, or the lowest cost on a terrain that is known; then the route
    also ends at the border if none leads to a goal in the window.
    """
    route = None
    if terrain.costmap.frame.contains([goal_xy])[0]:
        route = find(start_xy, goal_xy)
        if route.reached or known is None:
            return route
    terrain.open_cell_of(start_xy, "start")
    costs = terrain.costs_to(start_xy, by_length=by_length)
    inner = np.zeros(costs.shape, np.bool_)
    inner[1:-1, 1:-1] = True
    cells = np.argwhere(np.isfinite(costs) & ~inner)
    centres = terrain.costmap.frame.xy_from_rowcol(cells)
    if known is None:
        remaining = np.hypot(*(centres - goal_xy).T)
    else:
        known_cells, inside = known.costmap.frame.bounded_rowcol_from_xy(centres)
        known_cells[~inside] = 0
        costs_known = known.costs_to(goal_xy, by_length=by_length)
        remaining = np.where(inside, costs_known[known_cells[:, 0], known_cells[:, 1]], math.inf)
    total = costs[cells[:, 0], cells[:, 1]] + remaining
    if not np.isfinite(total).any():
        none, nan = np.empty((0, 2)), math.nan
        method: Method = "geodesic" if by_length else "astar"
        return route or Route(method, False, start_xy, goal_xy, none, nan, nan, nan)
    x, y = centres[int(np.argmin(total))].tolist()
    route = find(start_xy, (x, y))
    return replace(route, goal=goal_xy, reached=False, beyond_window=route.reached)


def _finer_way(is_open: Mask, line: list[Place]) -> list[Place]:
    """Return a line by lengths between parts of cells: the first may have erred about sides."""
    # No shorter way leaves the ellipse of its length around both ends.
    start, goal = line[0], line[-1]
    across = np.subtract(goal, start)[::-1]
    half = np.sqrt(np.maximum(_length(line) ** 2 - across**2, 0)) / 2 + 1
    middle = np.add(start, goal) / 2
    low = np.maximum(np.floor(middle - half), 0).astype(int)
    high = np.ceil(middle + half).astype(int)
    box = is_open[low[0] : high[0], low[1] : high[1]]
    parts = min(math.isqrt(_MOST_PARTS // box.size), _MOST_PARTS_OF_SIDE)
    if parts < 2:
        return line
    ends = [(row - low[0], col - low[1]) for row, col in (start, goal)]
    found = _tight_way(box, ends[0], ends[1], parts=parts)
    if found is None:
        return line
    return [start, *((row + low[0], col + low[1]) for row, col in found[1:-1]), goal]


def _tight_way(is_open: Mask, start: Place, goal: Place, *, parts: int = 1) -> list[Place] | None:
    """Return a taut line from a start to a goal, by lengths between parts of cells."""
    finer = is_open.repeat(parts, axis=0).repeat(parts, axis=1) if parts > 1 else is_open
    end = (goal[0] * parts, goal[1] * parts)
    lengths = lengths_to(finer, end)
    first = (math.floor(start[0] * parts), math.floor(start[1] * parts))
    if math.isinf(lengths[first]):
        return None
    centres = np.array(_descended(finer, lengths, first, end)) / parts
    return _pulled_tight(is_open, [start, *map(tuple, centres.tolist()), goal])


def _length(line: list[Place]) -> float:
    return sum(itertools.starmap(math.dist, pairwise(line)))


def _opens(mask: Mask) -> Callable[[Cell], bool]:
    height, width = mask.shape
    return lambda cell: 0 <= cell[0] < height and 0 <= cell[1] < width and bool(mask[cell])


def _descended(mask: Mask, lengths: Floats, cell: Cell, goal: Place) -> list[Place]:
    """Return the centres on the steepest way down, up to one that sees the goal."""
    is_open, centres = _opens(mask), []
    while True:
        centre = (cell[0] + 0.5, cell[1] + 0.5)
        centres.append(centre)
        length = lengths[cell]
        if length <= SEEN_WITHIN and is_line_clear(is_open, centre, goal):
            return centres
        steepest, following = 0.0, None
        for rows, cols in _STEPS:
            beside = (cell[0] + rows, cell[1] + cols)
            if may_step(is_open, cell, beside):
                slope = float(length - lengths[beside]) / math.hypot(rows, cols)
                if slope > steepest:
                    steepest, following = slope, beside
        if following is None:
            raise ArithmeticError("lengths to a goal have no minimum but the goal")
        cell = following


class _Corners:
    """The corners of closed cells that a tight line can bend at, in the order of their rows."""

    def __init__(self, is_open: Mask, line: list[Place]) -> None:
        low = np.maximum(np.floor(np.min(line, axis=0)).astype(int) - 1, 0)
        high = np.ceil(np.max(line, axis=0)).astype(int) + 1
        closed = np.pad(~is_open[low[0] : high[0], low[1] : high[1]], 1, constant_values=True)
        around = np.stack([closed[:-1, :-1], closed[:-1, 1:], closed[1:, :-1], closed[1:, 1:]])
        corners = np.argwhere(around.sum(axis=0) == 1)
        which = around[:, corners[:, 0], corners[:, 1]].argmax(axis=0)
        toward = np.stack([which // 2, which % 2], axis=1) * 2.0 - 1
        self.places = corners + low.astype(np.float64)
        self.inner = self.places + _OFF * toward
        """Places in the closed cell: a line that passes by does not touch them."""
        self._deeper = self.places + 2 * _OFF * toward
        self.outer = self.places - _BESIDE * toward

    def hull(self, before: Place, bend: Place, after: Place) -> list[Place]:
        """Return where a line bends that is pulled from a bend towards its neighbours' line."""
        side = np.sign(_cross(before, after, np.array(bend)))
        if side == 0:
            return []
        rows = self._between(*sorted((before[0], bend[0], after[0]))[::2])
        deeper, places = self._deeper[rows], self.inner[rows]
        for first, second in ((before, after), (after, bend), (bend, before)):
            is_inside = side * _cross(first, second, deeper) > 0
            deeper, places = deeper[is_inside], places[is_inside]
        bends, here = [], before
        while len(places):
            turns = np.arctan2(side * _cross(here, after, places), _along(here, after, places))
            if not turns.max() > 0:
                break
            is_first = turns > turns.max() - _ROUNDING  # the farthest of those on a line
            best = int(np.argmax(np.where(is_first, np.hypot(*(places - here).T), -1.0)))
            here = (float(places[best, 0]), float(places[best, 1]))
            bends.append(here)
            places = places[(turns > 0) & (np.arange(len(places)) != best)]
        return bends

    def touched(self, start: Place, end: Place) -> Floats:
        """Return places beside the corners that a straight line touches, in its order."""
        length = math.dist(start, end)
        rows = self._between(*sorted((start[0], end[0])))
        shares = _along(start, end, self.places[rows]) / (length or 1.0)
        is_near = np.abs(_cross(start, end, self.places[rows])) < _TOUCHING * length
        is_near &= (shares > _TOUCHING) & (shares < length - _TOUCHING)
        found: Floats = self.outer[rows][is_near][np.argsort(shares[is_near], kind="stable")]
        return found

    def _between(self, low: float, high: float) -> slice:
        first, end = np.searchsorted(self.places[:, 0], [low - _TOUCHING, high + _TOUCHING])
        return slice(int(first), int(end))


def _cross(start: Place, end: Place, places: Floats) -> Floats:
    """Return on which side of a line places lie, times their distance and the line's length."""
    row, col = end[0] - start[0], end[1] - start[1]
    crossed: Floats = row * (places[..., 1] - start[1]) - col * (places[..., 0] - start[0])
    return crossed


def _along(start: Place, end: Place, places: Floats) -> Floats:
    """Return how far along a line places lie, times the line's length."""
    row, col = end[0] - start[0], end[1] - start[1]
    lengths: Floats = row * (places[..., 0] - start[0]) + col * (places[..., 1] - start[1])
    return lengths


def _pulled_tight(mask: Mask, line: list[Place]) -> list[Place]:
    corners = _Corners(mask, line)
    tight, before = list(line), math.inf
    while (length := _length(tight)) < before - _ROUNDING:
        before = length
        for parity in (1, 0):
            pulled = tight[:1]
            for index in range(1, len(tight) - 1):
                is_turn = index % 2 == parity
                pulled += corners.hull(*tight[index - 1 : index + 2]) if is_turn else [tight[index]]
            tight = [*pulled, tight[-1]]
    outer = dict(zip(map(tuple, corners.inner.tolist()), corners.outer.tolist(), strict=True))
    beside = []
    for start, end in pairwise(tight):
        beside += [
            tuple(outer.get(start, start)),
            *map(tuple, corners.touched(start, end).tolist()),
        ]
    beside.append(tight[-1])
    is_valid = all(is_line_clear(_opens(mask), *piece) for piece in pairwise(beside))
    return beside if is_valid else line


def _in_steps(line: Floats) -> Floats:
    """Return places on a line that are at most half a cell apart, its bends among them."""
    steps = np.hypot(*np.diff(line, axis=0).T)
    counts = np.maximum(np.ceil(steps / _LONGEST_STEP).astype(int), 1)
    shares = np.concatenate([np.arange(count) / count for count in counts] + [np.zeros(1)])
    index = np.append(np.repeat(np.arange(len(counts)), counts), len(counts) - 1)
    shares[-1] = 1.0
    stepped: Floats = line[index] + shares[:, np.newaxis] * (line[index + 1] - line[index])
    return stepped
