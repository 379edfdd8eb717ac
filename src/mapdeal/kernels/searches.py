"""Searches of Nav2's planners NavFn, Smac 2D and Theta*, equal to Nav2's to the last bit.

NavFn's search runs from the start. It has three buffers of cells: those of this cycle, of the next,
and those whose potential is above a threshold that rises as soon as the others are empty. All
potentials are float32; constants in the formulas are doubles.

Of entries with equal keys, the open list of Smac 2D and Theta* returns first that which C++'s
``std::priority_queue`` returns first: Python's heap exchanges entries in the same order, if only
the keys are compared. Their cells are numbers: row times width plus column.

References
----------
navigation2: ``setCostmap``, ``updateCell``, ``propNavFnDijkstra``, ``propNavFnAstar``,
``calcPath``, ``gradCell`` in ``navfn.cpp`` of nav2_navfn_planner; ``a_star.cpp``, ``node_2d.cpp``,
``smoother.cpp`` of nav2_smac_planner; ``theta_star.cpp`` of nav2_theta_star_planner.
"""

from __future__ import annotations

import math
from array import array
from contextlib import suppress
from heapq import heappop, heappush

import numpy as np

from mapdeal.kernels.arrays import Bytes, Floats, Integers, Metres
from mapdeal.kernels.engine import engine_name

with suppress(ImportError):  # then `engine_name` is never compiled
    from mapdeal.kernels import _planners, _smac

Cell = tuple[int, int]
Point = tuple[float, float]
UNREACHED = 1e10
_OUTCOMES = ("found", "left map", "left reached cells", "no gradient", "no turns")
_NEUTRAL, _CLOSED, _ROOM = 50, 254, 10_000
_GRID_STEPS = ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))
_THETA_STEPS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, -1), (-1, 1), (1, 1), (-1, -1))
_CAME_BY, _IS_VISITED = 15, 16


def cost_table(allow_unknown: bool) -> Bytes:
    table: Bytes = np.minimum(_NEUTRAL + 0.8 * np.arange(256), _CLOSED - 1).astype(np.uint8)
    table[253:] = _CLOSED, _CLOSED, _CLOSED - allow_unknown
    return table


def potentials(
    costs: Bytes, start: Cell, target: Cell, *, allow_unknown: bool, is_astar: bool
) -> Metres:
    """Return the potentials of all cells when the search ends, elsewhere `UNREACHED`."""
    # Cells are x, y. A target beyond the last column stands for the first cell of the next row.
    table, costs = cost_table(allow_unknown), np.ascontiguousarray(costs)
    potential = np.empty(costs.shape, np.float32)
    if engine_name() == "compiled":
        _planners.search(costs, table, start, target, is_astar, potential)
        return potential
    potential[:] = np.reshape(_potentials(table[costs], start, target, is_astar), costs.shape)
    return potential


def _potentials(costs: Bytes, start: Cell, target: Cell, is_astar: bool) -> array[float]:
    height, width = costs.shape
    size = height * width
    costs[[0, -1]] = costs[:, [0, -1]] = _CLOSED
    flat = costs.tobytes()
    potential: array[float] = array("f", [UNREACHED]) * size
    first, end = start[1] * width + start[0], target[1] * width + target[0]
    potential[first] = 0.0
    single = array("f", [0.0])  # storing a number rounds it
    steps = [float(np.float32(0.707106781 * cost)) for cost in range(256)]
    pending = bytearray(size)

    def push(cell: int, buffer: list[int]) -> None:
        if 0 <= cell < size and not pending[cell] and flat[cell] < _CLOSED and len(buffer) < _ROOM:
            pending[cell] = 1
            buffer.append(cell)

    def distance(x: int, y: int) -> float:
        dx, dy = x - target[0], y - target[1]
        return float(np.float32(math.sqrt(dx * dx + dy * dy) * _NEUTRAL))

    current: list[int] = []
    following: list[int] = []
    overflow: list[int] = []
    for cell in (first + 1, first - 1, first - width, first + width):
        push(cell, current)
    threshold = _CLOSED + distance(*start) if is_astar else float(_CLOSED)
    single[0] = threshold
    threshold = single[0]
    for _ in range(max(size // 20, width + height)):
        if not current:
            break
        for cell in current:
            pending[cell] = 0
        for cell in current:
            cost = float(flat[cell])
            west, east = potential[cell - 1], potential[cell + 1]
            down, up = potential[cell - width], potential[cell + width]
            across, lowest = min(west, east), min(up, down)
            single[0] = abs(across - lowest)
            difference, lowest = single[0], min(across, lowest)
            if difference >= cost:
                single[0] = lowest + cost
            else:
                single[0] = difference / cost
                share = single[0]
                single[0] = -0.2301 * share * share + 0.5307 * share + 0.7040
                single[0] *= cost
                single[0] += lowest
            reached = single[0]
            if reached >= potential[cell]:
                continue
            potential[cell] = reached
            if is_astar:
                single[0] += distance(cell % width, cell // width)
            key = single[0]
            buffer = following if key < threshold else overflow
            for beside, before in (
                (cell - 1, west), (cell + 1, east), (cell - width, down), (cell + width, up)
            ):  # fmt: skip
                single[0] = key + steps[flat[beside]]
                if before > single[0]:
                    push(beside, buffer)
        current, following = following, []
        if not current:
            single[0] = threshold + 2 * _NEUTRAL
            threshold = single[0]
            current, overflow = overflow, []
        if end < size and potential[end] < np.float32(UNREACHED):
            break
    return potential


def traced_path(potential: Metres, start: Cell, goal: Cell, *, turns: int) -> tuple[Metres, str]:
    """Return the path from goal to start, x and y in cells, and how the trace ended."""
    # Each turn makes a step of half a cell down the gradient, or to the lowest neighbour near cells
    # that were not reached.
    if engine_name() == "compiled":
        path = np.empty((turns, 2), np.float32)
        count, outcome = _planners.trace(potential, start, goal, path)
        return path[:count].copy(), _OUTCOMES[outcome]
    points, name = _trace(potential, start, goal, turns)
    return np.array(points, np.float32).reshape(-1, 2), name


def _trace(potential: Metres, start: Cell, goal: Cell, turns: int) -> tuple[list[Point], str]:
    height, width = potential.shape
    size = height * width
    cells = potential.ravel()
    single, unreached = np.float32, np.float32(UNREACHED)

    def value_at(cell: int) -> np.float32:
        return single(cells[cell]) if 0 <= cell < size else unreached

    def truncated(value: np.float32) -> int:
        return int(value) if value < 2**31 else -(2**31)

    def norm(x: np.float32, y: np.float32) -> np.float32:
        return single(math.sqrt(float(x) ** 2 + float(y) ** 2))

    def gradient(cell: int) -> tuple[np.float32, np.float32]:
        if cell < width or cell > size - width:
            return single(0), single(0)
        here, slopes = value_at(cell), []
        for step in (1, width):
            before, behind = value_at(cell - step), value_at(cell + step)
            slope = before - here if before < unreached else single(0)
            slopes.append(slope + (here - behind) if behind < unreached else slope)
        length = norm(*slopes)
        scale = single(1.0 / float(length)) if length > 0 else single(0)
        return scale * slopes[0], scale * slopes[1]

    def between(first: np.float32, second: np.float32, share: np.float32) -> np.float32:
        return single((1.0 - float(share)) * float(first) + float(share * second))

    points: list[Point] = []
    cell, dx, dy = goal[1] * width + goal[0], single(0), single(0)
    for _ in range(turns):
        # numpy rounds halves to even, C away from zero
        steps = [math.copysign(math.floor(abs(float(d)) + 0.5), d) for d in (dx, dy)]
        nearest = min(max(cell + int(steps[0]) + width * int(steps[1]), 0), size - 1)
        if cells[nearest] < _NEUTRAL:
            return [*points, (float(start[0]), float(start[1]))], "found"
        if cell < width or cell > size - width:
            return points, "left map"
        x, y = single(cell % width) + dx, single(cell // width) + dy
        points.append((float(x), float(y)))
        around = [cell + up * width + right for up in (-1, 0, 1) for right in (-1, 0, 1)]
        alternates = len(points) > 2 and points[-1] == points[-3]
        if alternates or any(value_at(beside) >= unreached for beside in around):
            lowest = truncated(value_at(cell))
            for beside in around:
                if beside != around[4] and value_at(beside) < single(lowest):
                    lowest, cell = truncated(value_at(beside)), beside
            dx = dy = single(0)
            if value_at(cell) >= unreached:
                return points, "left reached cells"
            continue
        slopes = [gradient(cell + corner) for corner in (0, 1, width, width + 1)]
        axes = zip(*slopes, strict=True)
        along_x, along_y = (
            between(between(a, b, dx), between(c, d, dx), dy) for a, b, c, d in axes
        )
        if along_x == 0 and along_y == 0:
            return points, "no gradient"
        step = single(0.5) / norm(along_x, along_y)
        dx, dy = dx + along_x * step, dy + along_y * step
        if dx > 1:
            cell, dx = cell + 1, dx - single(1)
        if dx < -1:
            cell, dx = cell - 1, dx + single(1)
        if dy > 1:
            cell, dy = cell + width, dy - single(1)
        if dy < -1:
            cell, dy = cell - width, dy + single(1)
    return points, "no turns"


class _Entry(float):
    """A key of the open list with its cell; keys alone are compared."""

    cell: int


def grid_step_costs(multiplier: float, *, allow_unknown: bool) -> Metres:
    """Return costs of straight and diagonal steps by the entered cell's, shape (2, 256); or inf."""
    single = np.float32
    straight = single(1) + single(multiplier) * (np.arange(256, dtype=single) / single(252))
    straight[253 : 255 + (not allow_unknown)] = np.inf
    return np.stack([straight, np.sqrt(single(2)) * straight])


def grid_path(
    costs: Bytes, step_costs: Metres, start: int, goal: int, goal_xy: tuple[float, float], *,
    tolerance: float, most_iterations: int, most_near_goal: int,
) -> tuple[Integers, int]:  # fmt: skip
    """Return the cells of the path over the eight neighbours that Smac 2D finds, and iterations."""
    # If the goal is not reached, the path to the nearest cell is returned if that is closer than
    # `tolerance` cells, else no cells. Once such a cell is known, at most `most_near_goal` more
    # iterations follow. `goal_xy` is the goal in cells, rounded to float32.
    costs, width = np.ascontiguousarray(costs), costs.shape[1]
    moves = np.zeros(costs.size, np.uint8)
    search = _smac.grid if engine_name() == "compiled" else _search_grid
    end, iterations = search(
        costs, step_costs, start, goal, *goal_xy, tolerance, most_iterations, most_near_goal, moves
    )
    cells = []
    while end >= 0:
        cells.append(end)
        move = int(moves[end]) & _CAME_BY  # 0 at the start, else the number of the step plus 1
        dx, dy = _GRID_STEPS[move - 1]
        end = end - dx - dy * width if move else -1
    return np.array(cells[::-1], np.int64), iterations


def _search_grid(
    costs: Bytes, step_costs: Metres, start: int, goal: int, goal_x: float, goal_y: float,
    tolerance: float, most_iterations: int, most_near_goal: int, moves: Bytes,
) -> tuple[int, int]:  # fmt: skip
    height, width = costs.shape
    cell_costs = costs.tobytes()
    straight_costs, diagonal_costs = step_costs.tolist()
    single = array("f", [0.0])  # rounds numbers to float32
    path_costs = {start: 0.0}
    open_list: list[_Entry] = []

    def rounded(value: float) -> float:
        single[0] = value
        return single[0]

    def distance_to_goal(x: int, y: int) -> float:
        dx, dy = rounded(goal_x - x), rounded(goal_y - y)
        return rounded(math.sqrt(rounded(rounded(dx * dx) + rounded(dy * dy))))

    def push(key: float, cell: int) -> None:
        entry = _Entry(key)
        entry.cell = cell
        heappush(open_list, entry)

    push(0, start)
    iterations, iterations_near_goal = 0, 0
    nearest, nearest_distance = start, math.inf
    while iterations < most_iterations and open_list:
        cell = heappop(open_list).cell
        if moves[cell] & _IS_VISITED:
            continue
        iterations += 1
        moves[cell] |= _IS_VISITED
        if cell == goal:
            return cell, iterations
        if nearest_distance < tolerance:
            iterations_near_goal += 1
        if iterations_near_goal >= most_near_goal:
            break
        for step, (dx, dy) in enumerate(_GRID_STEPS):
            x, y = cell % width + dx, cell // width + dy
            neighbour = y * width + x
            if not (0 <= x < width and 0 <= y < height) or moves[neighbour] & _IS_VISITED:
                continue
            costs_of_step = diagonal_costs if dx and dy else straight_costs
            path_cost = rounded(path_costs[cell] + costs_of_step[cell_costs[neighbour]])
            if not path_cost < path_costs.get(neighbour, math.inf):
                continue
            path_costs[neighbour] = path_cost
            moves[neighbour] = step + 1
            distance = distance_to_goal(x, y)
            if distance < nearest_distance:
                nearest, nearest_distance = neighbour, distance
            push(rounded(path_cost + distance), neighbour)
    return (nearest if nearest_distance < tolerance else -1), iterations


def smooth_once(raw: Floats, path: Floats, data_weight: float, smooth_weight: float) -> float:
    """Move the inner points of a path, in place, and return the sum of the moves."""
    # Each point is pulled to its raw point and to the middle of its neighbours.
    if engine_name() == "compiled":
        return _smac.smooth(raw, path, data_weight, smooth_weight)
    values, change = path.ravel().tolist(), 0.0
    for i, origin in enumerate(raw.ravel().tolist()[2:-2], start=2):
        before = values[i]
        pull = values[i + 2] + values[i - 2] - 2.0 * before
        values[i] = before + (data_weight * (origin - before) + smooth_weight * pull)
        change += abs(values[i] - before)
    path[:] = np.reshape(values, path.shape)
    return change


def theta_costs(weight: float, *, allow_unknown: bool) -> tuple[Floats, Floats]:
    """Return costs of single steps and of lines of sight by cell cost; infinite if closed."""
    levels = 26 + 0.9 * np.arange(256)
    costs = np.stack([levels, levels])
    costs[1, 255] = 253
    costs = weight * costs * costs / 252 / 252
    costs[:, 253 : 255 + (not allow_unknown)] = np.inf
    costs[1, 252] = np.inf  # lines of sight compare the level, 252.8, with the limit of 252
    return costs[0], costs[1]


def theta_path(
    costs: Bytes, tables: tuple[Floats, Floats], start: int, goal: int, *, corners: int,
    distance_weight: float,
) -> list[int]:  # fmt: skip
    """Return the cells where Theta*'s path turns, with start and goal; `corners` is 4 or 8."""
    costs = np.ascontiguousarray(costs)
    parents = np.zeros(costs.size, np.int64)
    weights = (distance_weight, min(1.0, distance_weight))
    search = _smac.theta if engine_name() == "compiled" else _search_theta
    cell = search(costs, *tables, start, goal, corners, *weights, parents)
    path = [cell] if cell >= 0 else []
    while path and path[-1] != start:
        path.append(int(parents[path[-1]]) - 1)
    return path[::-1]


class _Node:
    """A cell that Theta* reached. Its key changes while it waits in the open list."""

    __slots__ = ("cell", "heuristic", "is_waiting", "parent", "path_cost", "total_estimate")
    parent: _Node

    def __init__(self, cell: int, heuristic: float) -> None:
        self.cell = cell
        self.heuristic = heuristic
        self.is_waiting = False
        self.path_cost = self.total_estimate = math.inf

    def __lt__(self, node: _Node) -> bool:
        return self.total_estimate < node.total_estimate

    def come_from(self, parent: _Node, path_cost: float) -> None:
        self.parent = parent
        self.path_cost = path_cost
        self.total_estimate = path_cost + self.heuristic


def _search_theta(
    costs: Bytes, step_costs: Floats, sight_costs: Floats, start: int, goal: int, corners: int,
    distance_weight: float, heuristic_weight: float, parents: Integers,
) -> int:  # fmt: skip
    height, width = costs.shape
    cell_costs = costs.tobytes()
    steps, sights = step_costs.tolist(), sight_costs.tolist()
    nodes: dict[int, _Node] = {}

    def distance(a: int, b: int) -> float:
        dx, dy = a % width - b % width, a // width - b // width
        return math.sqrt(dx * dx + dy * dy)

    def node_of(cell: int) -> _Node:
        if cell not in nodes:
            nodes[cell] = _Node(cell, heuristic_weight * distance(cell, goal))
        return nodes[cell]

    def sight_cost(begin: int, end: int) -> float:
        """Return the costs of the cells on a line by Bresenham; infinite if it is closed."""
        x, y = begin % width, begin // width
        end_x, end_y = end % width, end // width
        dx, dy = abs(end_x - x), abs(end_y - y)
        x_step = 1 if x < end_x else -1
        y_step = 1 if y < end_y else -1
        error, total = dx - dy, 0.0
        while (x, y) != (end_x, end_y):
            total += sights[cell_costs[y * width + x]]
            moves_x = 2 * error > -dy
            moves_y = not moves_x or 2 * error <= dx
            if moves_x and moves_y:  # the two cells beside a diagonal step must be open
                total += 0.0 * steps[cell_costs[y * width + x + x_step]]  # infinity becomes nan
                total += 0.0 * steps[cell_costs[(y + y_step) * width + x]]
            if not total < math.inf:
                return math.inf
            error += moves_y * dx - moves_x * dy
            x, y = x + moves_x * x_step, y + moves_y * y_step
        return total

    node = node_of(start)
    node.come_from(node, steps[cell_costs[start]])
    open_list = [node]
    while open_list and node.cell != goal:
        node.is_waiting = False
        ancestor = node.parent.parent
        path_cost = ancestor.path_cost + distance_weight * distance(node.cell, ancestor.cell)
        path_cost += sight_cost(node.cell, ancestor.cell)
        if path_cost < node.path_cost:
            node.come_from(ancestor, path_cost)
        for dx, dy in _THETA_STEPS[:corners]:
            x, y = node.cell % width + dx, node.cell // width + dy
            if not (0 <= x < width and 0 <= y < height):
                continue
            cost = steps[cell_costs[y * width + x]]
            if cost == math.inf:
                continue
            beside = node_of(y * width + x)
            path_cost = node.path_cost + distance_weight * distance(node.cell, beside.cell) + cost
            if beside.total_estimate <= path_cost + beside.heuristic:
                continue
            beside.come_from(node, path_cost)
            if not beside.is_waiting:
                beside.is_waiting = True
                heappush(open_list, beside)
        node = heappop(open_list)
    parents[list(nodes)] = [reached_node.parent.cell + 1 for reached_node in nodes.values()]
    return node.cell if open_list else -1
