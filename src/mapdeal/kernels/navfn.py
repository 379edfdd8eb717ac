"""NavFn's potentials and the trace of its path, equal to Nav2's to the last bit.

The search runs from the start. It has three buffers of cells: those of this cycle, of the next,
and those whose potential is above a threshold that rises as soon as the others are empty. All
potentials are float32; constants in the formulas are doubles.

References
----------
navigation2, nav2_navfn_planner/src/navfn.cpp: ``setCostmap``, ``updateCell``,
``propNavFnDijkstra``, ``propNavFnAstar``, ``calcPath``, ``gradCell``.
"""

from __future__ import annotations

import math
from array import array

import numpy as np

from mapdeal.kernels.arrays import Bytes, Metres
from mapdeal.kernels.engine import engine_name

Cell = tuple[int, int]
Point = tuple[float, float]
UNREACHED = 1e10
_OUTCOMES = ("found", "left map", "left reached cells", "no gradient", "no turns")
_NEUTRAL, _CLOSED, _ROOM = 50, 254, 10_000


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
        from mapdeal.kernels import _planners

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
        from mapdeal.kernels import _planners

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
