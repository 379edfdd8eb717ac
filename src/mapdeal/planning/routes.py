"""Routes: cheapest by A*, down a potential, shortest in any direction, and on a route graph."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any

import numpy as np

from mapdeal.errors import ParameterError
from mapdeal.grid import reaching, values
from mapdeal.grid.costmap import Costmap, travel_weights
from mapdeal.grid.frame import Point
from mapdeal.grid.reach import Method, Route
from mapdeal.grid.route_graph import RouteGraph
from mapdeal.kernels import paths
from mapdeal.kernels.arrays import Floats, Mask, Metres
from mapdeal.kernels.distance import signed_distance
from mapdeal.kernels.paths import Place
from mapdeal.records import dataclass, replace

FIELD_RANGE = 2.0  # metres from obstacles within which the field weighs, as in its metric view
_LARGEST_FACTOR = 1e6
_AT_CENTRE = 1e-6  # in cells: larger than rounding errors of a centre
_LARGEST_EXACT_SQUARE = 1 << 20  # squares up to which float32 distances distinguish neighbours
_CANDIDATES = 10  # candidates for the first and for the last node of a route


@dataclass(frozen=True, eq=False)
class Terrain:
    costmap: Costmap
    weights: Floats
    distance: Metres  # to the nearest lethal cell, metres
    lethal: Mask
    weights_by_cost: Floats

    @classmethod
    def of(
        cls, costmap: Costmap, *, cost_travel_multiplier: float = 2.0, field_weight: float = 0.0,
        through_unknown: bool = False,
    ) -> Terrain:  # fmt: skip
        check_factor("cost_travel_multiplier", cost_travel_multiplier)
        lethal = values.LETHAL_OBSTACLE if costmap.scale == "costmap2d" else values.OCCUPIED
        is_lethal = costmap.cost == lethal
        distance = signed_distance(is_lethal, scale=costmap.resolution)
        by_cost = travel_weights(costmap, cost_travel_multiplier, through_unknown=through_unknown)
        terrain = cls(costmap, by_cost[costmap.cost.view(np.uint8)], distance, is_lethal, by_cost)
        return replace(terrain, weights=terrain.weights_near_obstacles(field_weight))

    def weights_near_obstacles(self, field_weight: float) -> Floats:
        if check_factor("field_weight", field_weight) == 0:
            return self.weights
        weights = self.nearness()
        weights *= field_weight
        weights += self.weights
        weights[self.weights <= 0] = 0
        return weights

    def nearness(self) -> Floats:
        """Return how near each cell is to an obstacle, shape (H, W): 1 at it, 0 from 2 m on."""
        near: Floats = self.distance / np.float64(FIELD_RANGE)
        np.clip(near, 0, 1, out=near)
        return np.subtract(1, near, out=near)

    def costs_to(self, point: Point, *, by_length: bool) -> Floats:
        place = self.costmap.frame.place_in_cell(point)
        if place is None:
            return np.full(self.weights.shape, math.inf)
        if by_length:
            costs = paths.lengths_to(self.weights > 0, place)
        else:
            classes = self.costmap.cost.view(np.uint8)
            costs = paths.weighted_lengths_to(classes, self.weights_by_cost, place)
        return costs * self.costmap.resolution

    def is_open(self, cell: reaching.Cell) -> bool:
        return self.costmap.frame.holds(cell) and bool(self.weights[cell] > 0)

    def is_clear(self, start: Place, end: Place) -> bool:
        return paths.is_line_clear(self.is_open, start, end)

    def open_cell_of(self, point: Point, name: str) -> reaching.Cell:
        frame = self.costmap.frame
        cell = reaching.cell_of_point(frame, point, name)
        if not self.is_open(cell):
            cost = int(self.costmap.cost[cell])
            cost_text = "unknown" if cost == self.costmap.unknown_value else f"cost {cost}"
            rule = f"lies in a closed cell ({cost_text})"
            hint = reaching.nearest_open_text(frame, self.weights > 0, cell)
            raise ParameterError(rule, place=name, got=point, hint=hint)
        return cell

    def measure_route(self, points_xy: Floats) -> dict[str, Any]:
        """Return the length, cost and clearances of a route by their names in `Route`."""
        pieces = np.hypot(*np.diff(points_xy, axis=0).T)
        cells = self.costmap.frame.clamped_rowcol_from_xy(points_xy)[1:]
        length = float(pieces.sum())
        cost = float(pieces @ self.weights[cells[:, 0], cells[:, 1]])
        clearances = self.clearances_of(points_xy)
        mean = float(clearances[0])
        if length > 0 and math.isfinite(mean):
            mean = float(pieces @ (clearances[:-1] + clearances[1:]) / (2 * length))
        least = float(clearances.min())
        return {"length": length, "cost": cost, "min_clearance": least, "mean_clearance": mean}

    def clearances_of(self, points_xy: Floats) -> Floats:
        """Return the distances of points in open cells to the nearest centre of a lethal cell."""
        # Exact, metres, shape (N,); +inf if there is no lethal cell. At cell centres the distance
        # field is exact; elsewhere it bounds the search radius.
        frame, resolution = self.costmap.frame, self.costmap.resolution
        places = frame.continuous_rowcol_from_xy(points_xy)
        cells = frame.clamped_rowcol_from_xy(points_xy)
        at_centre = self.distance[cells[:, 0], cells[:, 1]].astype(np.float64) / resolution
        squares = np.rint(at_centre**2)
        distances = np.where(squares < _LARGEST_EXACT_SQUARE, np.sqrt(squares), at_centre)
        is_between = (np.abs(places - cells - 0.5) > _AT_CENTRE).any(axis=1)
        for index in np.flatnonzero(is_between & np.isfinite(at_centre)).tolist():
            reach = math.ceil(at_centre[index] + 1.0)
            first, stop = np.maximum(cells[index] - reach, 0), cells[index] + reach + 1
            near = self.lethal[first[0] : stop[0], first[1] : stop[1]]
            centres = np.argwhere(near) + first + 0.5
            distances[index] = np.hypot(*(centres - places[index]).T).min()
        return distances * resolution


def check_factor(name: str, value: float) -> float:
    if not 0 <= value <= _LARGEST_FACTOR:
        raise ParameterError(f"must lie between 0 and {_LARGEST_FACTOR:g}", place=name, got=value)
    return value


def surcharges_near_obstacles(terrain: Terrain, heuristic_weight: float) -> Floats | None:
    # The unit is that of the search: cells of length and weight 1.
    if check_factor("heuristic_weight", heuristic_weight) == 0:
        return None
    surcharges = terrain.nearness()
    surcharges *= heuristic_weight / terrain.costmap.resolution
    return surcharges


def route_over(
    terrain: Terrain, start: Point, goal: Point, *, weights: Floats | None = None,
    surcharges: Floats | None = None,
) -> Route:  # fmt: skip
    first, last = terrain.open_cell_of(start, "start"), terrain.open_cell_of(goal, "goal")
    searched = terrain.weights if weights is None else weights
    path = paths.cheapest_path(searched, first, last, surcharges=surcharges)
    search: dict[str, Any] = {"expanded": path.expanded, "optimal": surcharges is None}
    if len(path.cells) == 0:
        return Route("astar", False, start, goal, **search)
    places = path.cells + 0.5
    ends, _ = terrain.costmap.frame.bounded_continuous_rowcol_from_xy([start, goal])
    # Omit the centres of the first and the last cell where the line is clear: no hooks at the ends.
    begin = int(len(places) < 2 or terrain.is_clear(ends[0], places[1]))
    end = len(places) - int(len(places) < 2 or terrain.is_clear(places[-2], ends[1]))
    between = terrain.costmap.frame.xy_from_continuous_rowcol(places[begin : max(begin, end)])
    points = np.vstack([[start], between, [goal]])
    return Route("astar", True, start, goal, points, **terrain.measure_route(points), **search)


def route_in_window(
    terrain: Terrain, find: Callable[[Point, Point], Route], start: Point, goal: Point, *,
    by_length: bool, known: Terrain | None = None,
) -> Route:  # fmt: skip
    """Return a route to a goal, or to the border cell with the least total cost to it.

    The part beyond the border costs its straight length, or the lowest cost on the `known` terrain.
    With a known terrain, a goal cut off within the window is also approached through the border.
    """
    route = None
    if terrain.costmap.frame.contains([goal])[0]:
        route = find(start, goal)
        if route.reached or known is None:
            return route
    terrain.open_cell_of(start, "start")
    costs = terrain.costs_to(start, by_length=by_length)
    costs[1:-1, 1:-1] = math.inf
    cells = np.argwhere(np.isfinite(costs))
    centres = terrain.costmap.frame.xy_from_rowcol(cells)
    if known is None:
        remaining = np.hypot(*(centres - goal).T)
    else:
        known_cells, inside = known.costmap.frame.bounded_rowcol_from_xy(centres)
        known_cells[~inside] = 0
        costs_known = known.costs_to(goal, by_length=by_length)
        remaining = np.where(inside, costs_known[tuple(known_cells.T)], math.inf)
    total = costs[tuple(cells.T)] + remaining
    if not np.isfinite(total).any():
        method: Method = "geodesic" if by_length else "astar"
        return route or Route(method, False, start, goal)
    x, y = centres[int(np.argmin(total))].tolist()
    route = find(start, (x, y))
    return replace(route, goal=goal, reached=False, beyond_window=route.reached)


_STEPS = (0.5, 0.25, 0.125)
"""In cells, the longest first; a shorter one is tried where the longer one does not lead down."""
_OFF = (-1e-6, 1e-6)  # in cells: larger than rounding errors of a place
_STEPS_PER_CELL_OF_SIDE = 20  # at most: a path of ten times the length of both sides of the map


def descend_on(terrain: Terrain, surface: Floats, start: Point, goal: Point) -> Route:
    """Follow the negative gradient of a surface over the centres of cells to a goal.

    Steps are half a cell long, or shorter where the surface, interpolated between the centres of
    cells, would not fall; it falls with every step. The route slides along closed cells, with
    steps along the rows or the columns alone. If no such step exists, it takes the steepest way
    down to the centre of its cell or of a neighbour; without one, the place is a local minimum.
    """
    frame = terrain.costmap.frame
    terrain.open_cell_of(start, "start")
    terrain.open_cell_of(goal, "goal")
    ends = map(tuple, frame.continuous_rowcol_from_xy([start, goal]).tolist())
    places, ending = _Slope(surface, terrain).follow(*ends)
    points = frame.xy_from_continuous_rowcol(places)
    points[0] = start
    minimum = tuple(points[-1].tolist()) if ending == "minimum" else None
    if has_arrived := ending == "arrived":
        points = np.vstack([points, [goal]])
    measures = terrain.measure_route(points)
    return Route("descent", has_arrived, start, goal, points, **measures, local_minimum=minimum)


class _Slope:
    """Surface over the centres of cells, in cells, and the steps allowed on it."""

    def __init__(self, surface: Floats, terrain: Terrain) -> None:
        self._height, self._width = surface.shape
        self._values = surface.reshape(-1).data
        self._terrain = terrain

    def follow(self, start: Place, goal: Place) -> tuple[list[Place], str]:
        places = [start]
        while len(places) <= _STEPS_PER_CELL_OF_SIDE * (self._height + self._width):
            is_near = math.dist(places[-1], goal) <= 1.0 or _cell_of(places[-1]) == _cell_of(goal)
            if is_near and self._terrain.is_clear(places[-1], goal):
                return places, "arrived"
            following = self.step_down(places[-1])
            if following is None:
                return places, "minimum"
            places.append(following)
        return places, "abandoned"

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
        cells = (_cell_of((following[0] + row, following[1] + col)) for row in _OFF for col in _OFF)
        return self._terrain.is_clear(place, following) and all(map(self._terrain.is_open, cells))

    def value_at(self, place: Place) -> float:
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
        row, col = math.floor(place[0] - 0.5), math.floor(place[1] - 0.5)
        v, u = place[0] - 0.5 - row, place[1] - 0.5 - col
        along_rows = along_cols = 0.0
        for r, c, share in (
            (row, col, (1 - v) * (1 - u)), (row, col + 1, (1 - v) * u),
            (row + 1, col, v * (1 - u)), (row + 1, col + 1, v * u),
        ):  # fmt: skip
            south, north = _beside(r, self._height)
            west, east = _beside(c, self._width)
            along_rows += share * (self._at(north, c) - self._at(south, c)) / max(north - south, 1)
            along_cols += share * (self._at(r, east) - self._at(r, west)) / max(east - west, 1)
        return along_rows, along_cols

    def _lowest_neighbour(self, place: Place, here: float) -> Place | None:
        """Return the centre with the steepest descent, of this cell or of a cell around it."""
        best, steepest = None, 0.0
        row, col = _cell_of(place)
        for beside in ((row + rows, col + cols) for rows in (-1, 0, 1) for cols in (-1, 0, 1)):
            if not self._terrain.is_open(beside):
                continue
            centre = (beside[0] + 0.5, beside[1] + 0.5)
            drop, length = here - self._at(*beside), math.dist(place, centre)
            if length and drop / length > steepest and self._terrain.is_clear(place, centre):
                best, steepest = centre, drop / length
        return best


def _beside(index: int, length: int) -> tuple[int, int]:
    """Return the indices on both sides, or at the border the index itself on one."""
    index = min(max(index, 0), length - 1)
    return max(index - 1, 0), min(index + 1, length - 1)


def _cell_of(place: Place) -> reaching.Cell:
    return math.floor(place[0]), math.floor(place[1])


# in cells
_BEND_OFFSET = 1e-3  # from corners to bends, so that rounded points stay in open cells
_BEHIND_OFFSET = 1e-6  # from bends to the places behind them: more than rounding errors
_INSIDE = 2 * _BEND_OFFSET
_ROUNDING = 1e-9
_LONGEST_STEP = 0.5
_MOST_PARTS, _MOST_PARTS_OF_SIDE = 1 << 21, 16
_STEP_LENGTHS = np.hypot(*np.ogrid[-1:2, -1:2]) + np.diag([0.0, 1.0, 0.0])
"""Lengths of steps to the cells around a cell; 1 for the cell itself."""


def shortest_over(terrain: Terrain, start: Point, goal: Point) -> Route:
    """Return the shortest route in any direction, with points at most half a cell apart.

    It descends the lengths to the goal from cell to cell and is then pulled tight: no route that
    passes closed cells on the same sides is shorter. It bends at corners of closed cells alone.
    """
    terrain.open_cell_of(start, "start")
    terrain.open_cell_of(goal, "goal")
    frame = terrain.costmap.frame
    first, last = (np.array(frame.place_in_cell(point)) for point in (start, goal))
    is_open = terrain.weights > 0
    line = _taut_line(is_open, first, last)
    if not len(line):
        return Route("geodesic", False, start, goal)
    # The eikonal lengths may favour the wrong side of an obstacle, so a finer grid follows. No
    # shorter line leaves the ellipse of this length around both ends.
    half = np.sqrt(np.maximum(_length(line) ** 2 - (last - first)[::-1] ** 2, 0)) / 2 + 1
    low = np.maximum(np.floor((first + last) / 2 - half), 0).astype(int)
    end = np.ceil((first + last) / 2 + half).astype(int)
    box = is_open[low[0] : end[0], low[1] : end[1]]
    parts = min(math.isqrt(_MOST_PARTS // box.size), _MOST_PARTS_OF_SIDE)
    if parts > 1:
        line = min(line, _taut_line(box, first - low, last - low, parts) + low, key=_length)
    steps = np.hypot(*np.diff(line, axis=0).T)
    counts = np.maximum(np.ceil(steps / _LONGEST_STEP).astype(int), 1).tolist()
    along = [k + np.arange(count) / count for k, count in enumerate(counts)]
    positions = np.concatenate([*along, [len(counts)]])
    places = [np.interp(positions, np.arange(len(line)), axis) for axis in line.T]
    points = frame.xy_from_continuous_rowcol(np.stack(places, axis=1))
    points[0], points[-1] = start, goal
    return Route("geodesic", True, start, goal, points, **terrain.measure_route(points))


def _length(line: Floats) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def _taut_line(is_open: Mask, start: Floats, goal: Floats, parts: int = 1) -> Floats:
    """Return a taut line, shape (N, 2), by lengths over parts of cells; empty if there is none."""
    finer = is_open.repeat(parts, axis=0).repeat(parts, axis=1) if parts > 1 else is_open
    row, col = (goal * parts).tolist()
    lengths = paths.lengths_to(finer, (row, col))
    first = np.floor(start * parts).astype(int)
    if math.isinf(lengths[tuple(first)]):
        return np.empty((0, 2))
    centres = np.array(list(_descend(lengths, *first.tolist()))) / parts
    # ends stay off the edges of their cells, so that bends are closer to corners
    ends = [np.clip(end, np.floor(end) + _INSIDE, np.floor(end) + 1 - _INSIDE)
            for end in (start, goal)]  # fmt: skip
    taut = _pull_taut(is_open, np.stack([ends[0], *centres, ends[1]]))
    for inner in (taut[1:-1], taut, centres):
        line = np.stack([start, *inner, goal])
        if paths.is_line_clear(paths.opens(is_open), *map(tuple, line.tolist())):
            return line
    raise ArithmeticError("the descent of distances does not end in sight of the goal")


def _descend(lengths: Floats, row: int, col: int) -> Iterator[tuple[float, float]]:
    """Yield the centres of cells on the steepest descent, until no cell beside is lower."""
    lengths = np.pad(lengths, 1, constant_values=math.inf)
    while True:
        yield row + 0.5, col + 0.5
        around = lengths[row : row + 3, col : col + 3]
        slopes = (around[1, 1] - around) / _STEP_LENGTHS
        closed = np.isinf(around)
        slopes[::2, ::2][closed[::2, 1, np.newaxis] & closed[1, ::2]] = 0  # between closed cells
        steepest = int(slopes.argmax())
        if slopes.flat[steepest] <= 0:
            return
        rows, cols = steepest // 3 - 1, steepest % 3 - 1
        if rows and cols and closed[1 + rows, 1]:  # around a corner, not through it
            yield row + 0.5, col + cols + 0.5
        elif rows and cols and closed[1, 1 + cols]:
            yield row + rows + 0.5, col + 0.5
        row, col = row + rows, col + cols


def _pull_taut(is_open: Mask, line: Floats) -> Floats:
    """Return the shortest line that passes closed cells on the same sides, at `_BEND_OFFSET`."""
    low = np.maximum(np.floor(line.min(axis=0)).astype(int) - 1, 0)
    high = np.ceil(line.max(axis=0)).astype(int) + 1
    closed = np.pad(~is_open[low[0] : high[0], low[1] : high[1]], 1, constant_values=True)
    around = np.stack([closed[:-1, :-1], closed[:-1, 1:], closed[1:, :-1], closed[1:, 1:]])
    corners = np.argwhere(around.sum(axis=0) == 1)
    quadrant = around[:, corners[:, 0], corners[:, 1]].argmax(axis=0)
    outward = 1 - 2 * np.stack(np.divmod(quadrant, 2), axis=1)
    corners += low
    bends = corners + _BEND_OFFSET * outward
    behind = bends - _BEHIND_OFFSET * outward  # a triangle there keeps the bend

    def pull_at(before: Place, bend: Place, after: Place) -> list[Place]:
        """Return the bends at which a line caught at `bend` rests once it is pulled straight."""
        side = math.copysign(1.0, _cross(before, after, *bend))
        rows = (before[0], bend[0], after[0])
        first, end = np.searchsorted(corners[:, 0], [min(rows) - _INSIDE, max(rows) + _INSIDE])
        nearby = np.arange(first, end)
        for start, stop in ((before, after), (after, bend), (bend, before)):
            if not len(nearby):
                return []
            nearby = nearby[side * _cross(start, stop, *behind[nearby].T) > 0]
        nearby = nearby[(bends[nearby] != before).any(axis=1)]
        row, col = (bends[nearby] - before).T
        angles = np.arctan2(col, row) - math.atan2(after[1] - before[1], after[0] - before[0])
        turns = (side * angles + math.pi) % math.tau - math.pi
        hull = [before]  # a Graham scan of the bends and `after` around `before`
        order = np.lexsort((np.hypot(row, col), -turns.round(9)))
        for place in (*map(tuple, bends[nearby[order]].tolist()), after):
            while len(hull) > 1 and side * _cross(hull[-2], hull[-1], *place) >= 0:
                hull.pop()
            hull.append(place)
        return hull[1:-1]

    taut, previous_length = list(map(tuple, line.tolist())), math.inf
    while (length := _length(np.array(taut))) < previous_length - _ROUNDING:
        previous_length = length
        for parity in (1, 0):  # move every other bend, while its neighbours stay
            inner = (pull_at(*taut[k - 1 : k + 2]) if k % 2 == parity else [taut[k]]
                     for k in range(1, len(taut) - 1))  # fmt: skip
            taut = [taut[0], *chain.from_iterable(inner), taut[-1]]
    return np.array(taut)


def _cross(start: Place, end: Place, row: Any, col: Any) -> Any:
    """Return the distances of places to a line, signed by side, times the line's length."""
    return (end[0] - start[0]) * (col - start[1]) - (end[1] - start[1]) * (row - start[0])


def route_on_graph(terrain: Terrain, graph: RouteGraph, start: Point, goal: Point) -> Route:
    """Find the cheapest route on a graph, with the paths to its first node and from its last.

    An edge costs its length, divided by ``speed_limit`` if set, as with Nav2's DistanceScorer; an
    edge that is not overridable costs its own ``cost``. The server begins at the node nearest to
    the start and ends at the node nearest to the goal. Here these are the nearest nodes that a
    straight line through open cells reaches and that a route connects.

    Edges are assumed to be free: ``mapdeal lint --graph`` checks them.
    """
    terrain.open_cell_of(start, "start")
    terrain.open_cell_of(goal, "goal")
    firsts, lasts = (_nearest_nodes(terrain, graph, place) for place in (start, goal))
    ranks = np.ndindex(len(firsts), len(lasts))
    for first, last in sorted(ranks, key=lambda pair: (sum(pair), pair)):
        nodes, expanded = cheapest_nodes(graph, firsts[first], lasts[last])
        if not nodes:
            continue
        begin = _path_to(terrain, start, graph, nodes[0])
        end = _path_to(terrain, goal, graph, nodes[-1])
        if begin is None or end is None:
            continue
        points = np.concatenate([begin, graph.points_xy[nodes], end[::-1]])
        points = points[np.append(True, (np.diff(points, axis=0) != 0).any(axis=1))]
        measures = terrain.measure_route(points)
        return Route("graph", True, start, goal, points, **measures, expanded=expanded)
    return Route("graph", False, start, goal, expanded=0)


def _nearest_nodes(terrain: Terrain, graph: RouteGraph, point: Point) -> list[int]:
    """Return the nearest nodes, first those that a straight free line reaches."""
    away = np.hypot(*(graph.points_xy - point).T)
    nearest = np.argsort(away, kind="stable")[:_CANDIDATES].tolist()
    return sorted(nearest, key=lambda node: not _is_visible(terrain, point, graph.points_xy[node]))


def _is_visible(terrain: Terrain, point: Point, node: Floats) -> bool:
    ends = np.array([point, node])
    places, inside = terrain.costmap.frame.bounded_continuous_rowcol_from_xy(ends)
    return bool(inside.all()) and terrain.is_clear(*map(tuple, places.tolist()))


def _path_to(terrain: Terrain, point: Point, graph: RouteGraph, node: int) -> Floats | None:
    end = graph.points_xy[node]
    if _is_visible(terrain, point, end):
        return np.array([point])
    cells, inside = terrain.costmap.frame.bounded_rowcol_from_xy([end])
    row, col = cells[0].tolist()
    if not inside[0] or not terrain.is_open((row, col)):
        return None
    route = route_over(terrain, point, (float(end[0]), float(end[1])))
    return route.points_xy[:-1] if route.reached else None


def cheapest_nodes(graph: RouteGraph, first: int, last: int) -> tuple[list[int], int]:
    following: list[list[tuple[int, float]]] = [[] for _ in graph.nodes]
    lengths = graph.lengths.tolist()
    for edge, (start, end), length in zip(graph.edges, graph.ends.tolist(), lengths, strict=True):
        limit = edge.metadata.get("speed_limit")
        cost = length / limit if isinstance(limit, int | float) and limit > 0 else length
        following[start].append((end, cost if edge.overridable else edge.cost))
    best, previous = {first: 0.0}, {first: first}
    heap, expanded = [(0.0, first)], 0
    while heap:
        cost, node = heapq.heappop(heap)
        if cost > best[node]:
            continue
        if node == last:
            nodes = [last]
            while nodes[-1] != first:
                nodes.append(previous[nodes[-1]])
            return nodes[::-1], expanded
        expanded += 1
        for end, step in following[node]:
            if cost + step < best.get(end, math.inf):
                best[end] = cost + step
                previous[end] = node
                heapq.heappush(heap, (cost + step, end))
    return [], expanded
