"""Shortest routes in any direction: the descent of distances to the goal, pulled taut."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any

import numpy as np

from mapdeal.grid.frame import Point
from mapdeal.grid.reach import Method, Route
from mapdeal.kernels.arrays import Floats, Mask
from mapdeal.kernels.eikonal import Place, is_line_clear, lengths_to, opens
from mapdeal.planning.routes import Terrain
from mapdeal.records import replace

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


def _taut_line(is_open: Mask, start: Floats, goal: Floats, parts: int = 1) -> Floats:
    """Return a taut line, shape (N, 2), by lengths over parts of cells; empty if there is none."""
    finer = is_open.repeat(parts, axis=0).repeat(parts, axis=1) if parts > 1 else is_open
    row, col = (goal * parts).tolist()
    lengths = lengths_to(finer, (row, col))
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
        if is_line_clear(opens(is_open), *map(tuple, line.tolist())):
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
