"""Routes: the cheapest through costs, by A*, the descent of a potential, and on a route graph."""

from __future__ import annotations

import heapq
import math
from typing import Any, Literal

import numpy as np

from mapdeal.errors import ParameterError
from mapdeal.grid.costmap import Costmap, travel_weights
from mapdeal.grid.field import DistanceField
from mapdeal.grid.frame import Point
from mapdeal.grid.reach import Route
from mapdeal.grid.reaching import Cell, cell_of_point, nearest_open_text
from mapdeal.grid.route_graph import RouteEdge, RouteGraph
from mapdeal.grid.values import LETHAL_OBSTACLE, OCCUPIED
from mapdeal.kernels.arrays import Floats
from mapdeal.kernels.distance import signed_distance
from mapdeal.kernels.eikonal import Place, is_line_clear, lengths_to, weighted_lengths_to
from mapdeal.kernels.paths import cheapest_path
from mapdeal.records import dataclass, replace

FIELD_RANGE = 2.0
"""Metres from obstacles at which the field no longer weighs: the range of its metric view."""
_LARGEST_FACTOR = 1e6
_AT_CENTRE = 1e-6  # in cells: larger than rounding errors of a centre
_LARGEST_EXACT_SQUARE = 1 << 20
"""Squares of cells up to which float32 distances distinguish neighbouring squares."""
_CANDIDATES = 10  # candidates for the first and for the last node of a route


@dataclass(frozen=True, eq=False)
class Terrain:
    costmap: Costmap
    weights: Floats
    field: DistanceField
    weights_by_cost: Floats

    @classmethod
    def of(
        cls,
        costmap: Costmap,
        *,
        cost_travel_multiplier: float = 2.0,
        field_weight: float = 0.0,
        through_unknown: bool = False,
    ) -> Terrain:
        check_factor("cost_travel_multiplier", cost_travel_multiplier)
        check_factor("field_weight", field_weight)
        lethal = LETHAL_OBSTACLE if costmap.scale == "costmap2d" else OCCUPIED
        obstacles = costmap.cost == lethal
        resolution, origin = costmap.resolution, costmap.origin
        distance = signed_distance(obstacles, scale=resolution)
        occupancy = np.where(obstacles, OCCUPIED, 0).astype(np.int8)
        field = DistanceField(distance, occupancy, resolution, origin, convention="center")
        by_cost = travel_weights(costmap, cost_travel_multiplier, through_unknown=through_unknown)
        terrain = cls(costmap, by_cost[costmap.cost.view(np.uint8)], field, by_cost)
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
        near: Floats = self.field.distance / np.float64(FIELD_RANGE)
        np.clip(near, 0, 1, out=near)
        return np.subtract(1, near, out=near)

    def costs_to(self, point: Point, *, by_length: bool) -> Floats:
        place = self.costmap.frame.place_in_cell(point)
        if place is None:
            return np.full(self.weights.shape, math.inf)
        if by_length:
            costs = lengths_to(self.weights > 0, place)
        else:
            classes = self.costmap.cost.view(np.uint8)
            costs = weighted_lengths_to(classes, self.weights_by_cost, place)
        return costs * self.costmap.resolution

    def is_open(self, cell: Cell) -> bool:
        return self.costmap.frame.holds(cell) and bool(self.weights[cell] > 0)

    def is_clear(self, start: Place, end: Place) -> bool:
        return is_line_clear(self.is_open, start, end)

    def open_cell_of(self, point: Point, name: str) -> Cell:
        frame = self.costmap.frame
        cell = cell_of_point(frame, point, name)
        if not self.is_open(cell):
            cost = int(self.costmap.cost[cell])
            cost_text = "unknown" if cost == self.costmap.unknown_value else f"cost {cost}"
            rule = f"lies in a closed cell ({cost_text})"
            hint = nearest_open_text(frame, self.weights > 0, cell)
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
        at_centre = self.field.distance[cells[:, 0], cells[:, 1]].astype(np.float64) / resolution
        squares = np.rint(at_centre**2)
        distances = np.where(squares < _LARGEST_EXACT_SQUARE, np.sqrt(squares), at_centre)
        is_between = (np.abs(places - cells - 0.5) > _AT_CENTRE).any(axis=1)
        for index in np.flatnonzero(is_between & np.isfinite(at_centre)).tolist():
            reach = math.ceil(at_centre[index] + 1.0)
            first, stop = np.maximum(cells[index] - reach, 0), cells[index] + reach + 1
            near = self.field.occupancy[first[0] : stop[0], first[1] : stop[1]]
            centres = np.argwhere(near == OCCUPIED) + first + 0.5
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
    terrain: Terrain,
    start: Point,
    goal: Point,
    *,
    weights: Floats | None = None,
    surcharges: Floats | None = None,
) -> Route:
    first, last = terrain.open_cell_of(start, "start"), terrain.open_cell_of(goal, "goal")
    searched = terrain.weights if weights is None else weights
    path = cheapest_path(searched, first, last, surcharges=surcharges)
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


_STEPS = (0.5, 0.25, 0.125)
"""In cells, the longest first; a shorter one is tried where the longer one does not lead down."""
Ending = Literal["arrived", "minimum", "abandoned"]
_OFF = (-1e-6, 1e-6)  # in cells: larger than rounding errors of a place
_STEPS_PER_CELL_OF_SIDE = 20
"""Limits the number of steps: a path of ten times the length of both sides of the map."""


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

    def follow(self, start: Place, goal: Place) -> tuple[list[Place], Ending]:
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


def _cell_of(place: Place) -> Cell:
    return math.floor(place[0]), math.floor(place[1])


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


def cost_of_edge(edge: RouteEdge, length: float) -> float:
    if not edge.overridable:
        return edge.cost
    limit = edge.metadata.get("speed_limit")
    return length / limit if isinstance(limit, int | float) and limit > 0 else length


def cheapest_nodes(graph: RouteGraph, first: int, last: int) -> tuple[list[int], int]:
    following: list[list[tuple[int, float]]] = [[] for _ in graph.nodes]
    lengths = graph.lengths.tolist()
    for edge, (start, end), length in zip(graph.edges, graph.ends.tolist(), lengths, strict=True):
        following[start].append((end, cost_of_edge(edge, length)))
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
