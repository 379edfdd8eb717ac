"""Routes on a route graph, as Nav2's route server finds them."""

from __future__ import annotations

import heapq
import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Point
from mapdeal.grid.reach import Route
from mapdeal.grid.route_graph import RouteEdge, RouteGraph
from mapdeal.planning.routes import Terrain, route_over

_NEAREST = 10  # candidates for the first and for the last node of a route


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
    firsts, lasts = (_nearest(terrain, graph, place) for place in (start, goal))
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
        measures = terrain.measured(points)
        return Route("graph", True, start, goal, points, **measures, expanded=expanded)
    return Route("graph", False, start, goal, expanded=0)


def _nearest(terrain: Terrain, graph: RouteGraph, point: Point) -> list[int]:
    """Return the nearest nodes, first those that a straight free line reaches."""
    away = np.hypot(*(graph.points_xy - point).T)
    nearest = np.argsort(away, kind="stable")[:_NEAREST].tolist()
    return sorted(nearest, key=lambda node: not _is_visible(terrain, point, graph.points_xy[node]))


def _is_visible(terrain: Terrain, point: Point, node: NDArray[np.float64]) -> bool:
    ends = np.array([point, node])
    places, inside = terrain.costmap.frame.bounded_continuous_rowcol_from_xy(ends)
    return bool(inside.all()) and terrain.is_clear(*map(tuple, places.tolist()))


def _path_to(
    terrain: Terrain, point: Point, graph: RouteGraph, node: int
) -> NDArray[np.float64] | None:
    end = graph.points_xy[node]
    if _is_visible(terrain, point, end):
        return np.array([point])
    cells, inside = terrain.costmap.frame.bounded_rowcol_from_xy([end])
    row, col = cells[0].tolist()
    if not inside[0] or not terrain.is_open((row, col)):
        return None
    found = route_over(terrain, point, (float(end[0]), float(end[1])))
    return found.points_xy[:-1] if found.reached else None


def cost_of_edge(edge: RouteEdge, length: float) -> float:
    if not edge.overridable:
        return edge.cost
    limit = edge.metadata.get("speed_limit")
    return length / limit if isinstance(limit, int | float) and limit > 0 else length


def cheapest_nodes(graph: RouteGraph, first: int, last: int) -> tuple[list[int], int]:
    following: list[list[tuple[int, float]]] = [[] for _ in graph.nodes]
    for edge, ends, length in zip(
        graph.edges, graph.ends.tolist(), graph.lengths.tolist(), strict=True
    ):
        following[ends[0]].append((ends[1], cost_of_edge(edge, length)))
    best, before = {first: 0.0}, {first: first}
    heap = [(0.0, first)]
    expanded = 0
    while heap:
        cost, node = heapq.heappop(heap)
        if cost > best[node]:
            continue
        if node == last:
            nodes = [last]
            while nodes[-1] != first:
                nodes.append(before[nodes[-1]])
            return nodes[::-1], expanded
        expanded += 1
        for end, step in following[node]:
            if cost + step < best.get(end, math.inf):
                best[end], before[end] = cost + step, node
                heapq.heappush(heap, (cost + step, end))
    return [], expanded
