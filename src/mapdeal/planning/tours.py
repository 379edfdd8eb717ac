"""Tours of a robot past all that it should see, and its poses along lines over time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mapdeal.errors import ParameterError
from mapdeal.grid.route_graph import RouteGraph
from mapdeal.kernels.arrays import Floats, Integers, Mask

_STEP = 0.02  # metres between places at which headings are computed
_AHEAD = 0.25  # metres before and behind the robot; its heading is the direction between both
_TURNING = 1.0  # radians per second
_MOST_POSES = 10_000_000
_LITTLE = 1e-9


class Tour(NamedTuple):
    """A closed line of points, shape (N, 2), and which of them are viewpoints."""

    points_xy: Floats
    is_viewpoint: Mask


def tour_of(graph: RouteGraph, in_sight: Sequence[Integers], cells: int) -> Tour:
    """Return a tour of a graph that sees all cells in sight of nodes of the largest part."""
    # Viewpoints are chosen greedily by the cells they add, and ordered by a minimum spanning tree.
    from scipy.sparse import csgraph, csr_matrix

    count = len(graph.nodes)
    edges = csr_matrix((graph.lengths, tuple(graph.ends.T)), shape=(count, count))
    _, parts = csgraph.connected_components(edges, connection="strong")
    is_part = parts == np.bincount(parts).argmax()
    indices, starts = np.concatenate(in_sight), np.append(0, np.cumsum(list(map(len, in_sight))))
    sees = csr_matrix((np.ones(len(indices), np.int64), indices, starts), shape=(count, cells))
    missing = np.ones(cells, dtype=np.int64)
    chosen: list[int] = []
    while (gains := np.where(is_part, sees @ missing, 0)).any():
        chosen.append(int(gains.argmax()))
        missing[in_sight[chosen[-1]]] = 0
    chosen = chosen or [int(is_part.argmax())]
    lengths, predecessors = csgraph.dijkstra(edges, indices=chosen, return_predecessors=True)
    between = np.maximum(lengths[:, chosen], _LITTLE)  # zeros would be no edges
    tree = csgraph.minimum_spanning_tree(between)
    order = _shorten_tour(csgraph.depth_first_order(tree, 0, directed=False)[0], between)
    nodes, is_viewpoint = [chosen[order[0]]], [True]
    for start, end in pairwise([*order, order[0]]):
        path = [chosen[end]]
        while path[-1] != chosen[start]:
            path.append(int(predecessors[start, path[-1]]))
        nodes += path[-2::-1]
        is_viewpoint += [node == chosen[end] for node in path[-2::-1]]
    return Tour(graph.points_xy[nodes], np.array(is_viewpoint))


def _shorten_tour(order: Integers, lengths: Floats) -> Integers:
    """Return a closed tour after all exchanges of two edges that shorten it (2-opt)."""
    has_changed = len(order) > 3
    while has_changed:
        has_changed = False
        for k in range(len(order) - 2):
            start, end = order[k], order[k + 1]
            starts, ends = order[k + 2 :], np.append(order[k + 3 :], order[0])
            gains = lengths[start, end] + lengths[starts, ends]
            gains -= lengths[start, starts] + lengths[end, ends]
            best = int(gains.argmax())
            if gains[best] > _LITTLE:
                order[k + 1 : k + 3 + best] = order[k + 1 : k + 3 + best][::-1]
                has_changed = True
    return order


def driven(
    points_xy: Floats, is_viewpoint: Mask, *, speed: float, rate: float, turn: float = 0.0
) -> Floats:
    """Return poses, shape (N, 3), of a robot that follows a line and turns at viewpoints."""
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(points_xy, axis=0).T)))
    places = np.linspace(0.0, along[-1], int(np.ceil(along[-1] / _STEP)) + 1)

    def at(lengths: Floats) -> Floats:
        return np.column_stack([np.interp(lengths, along, axis) for axis in points_xy.T])

    ahead = at(places + _AHEAD) - at(places - _AHEAD)  # interp stays at the ends
    # Where the line turns back, both points coincide: the robot retains its heading.
    has_direction = np.hypot(*ahead.T) > _LITTLE
    latest = np.maximum.accumulate(np.where(has_direction, np.arange(len(places)), 0))
    yaws = np.unwrap(np.arctan2(ahead[latest, 1], ahead[latest, 0]))
    yaws[np.searchsorted(places, along[is_viewpoint])] += turn
    steps = np.maximum(np.diff(places) / speed, np.abs(np.diff(yaws)) / _TURNING)
    times = np.append(0.0, np.cumsum(steps))
    if times[-1] * rate > _MOST_POSES:
        rule = f"{times[-1] * rate:.3g} scans are too many, the most are {_MOST_POSES}"
        raise ParameterError(rule, place="speed, rate", hint="raise --speed, or lower --rate")
    sampled = np.arange(0.0, times[-1] + _LITTLE, 1 / rate)
    poses = np.column_stack([at(places), yaws])
    return np.column_stack([np.interp(sampled, times, axis) for axis in poses.T])
