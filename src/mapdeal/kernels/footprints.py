"""Costs of a footprint at many poses, as Nav2's collision checker has them.

References
----------
``FootprintCollisionChecker`` in ``footprint_collision_checker.cpp`` of Nav2. The corners are
turned and moved, and those of the grid are cut off to cells (``worldToMap``). Lines of cells
(``LineIterator``, the same as costmap_2d's in `mapdeal.kernels.polygons`) lead from each corner
to the next, and one from the first to the last. A line costs 254 if it meets that, else the
largest of its costs. The footprint costs the largest of its lines, but the first line that costs
254 ends the search, so that a line of 255 before it hides it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.polygons import Indices, enumerated
from mapdeal.kernels.threads import in_parallel

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

LETHAL, UNKNOWN = 254, 255
_CELLS_TOGETHER = 1 << 18
"""Cells of outlines that are looked up together: worth a thread, and small in memory."""

_POSES_TOGETHER = 1 << 14

# A look-up both ways: of the costs of a line, 254 is the worst, before 255.
_SEVERITY = np.arange(256, dtype=np.uint8)
_SEVERITY[[LETHAL, UNKNOWN]] = UNKNOWN, LETHAL


class Lattice(NamedTuple):
    """Where the cells of a costmap lie."""

    resolution: float
    x: float
    y: float
    yaw: float


def costs_at_poses(
    costs: Bytes, lattice: Lattice, corners: Floats, poses: Floats, *, filled: bool
) -> tuple[Bytes, Mask]:
    """Return what a footprint costs at each pose, and whether the grid holds all its corners."""
    # The cells of a footprint that is filled are those of its outline and all that costmap_2d fills
    # when it draws it (`mapdeal.kernels.polygons`). That draws the last line in the other
    # direction, which may lead through other cells: both count.
    results = np.empty(len(poses), dtype=np.uint8)
    inside = np.empty(len(poses), dtype=np.bool_)
    costs, corners, poses = map(np.ascontiguousarray, (costs, corners, poses))
    together = _poses_together(lattice.resolution, corners)
    compiled = engine_name() == "compiled"

    def part(some: slice) -> None:
        if compiled:
            from mapdeal.kernels import _compiled

            _compiled.costs_of_footprints(
                costs, *lattice[:3], math.cos(lattice.yaw), math.sin(lattice.yaw), corners,
                poses[some], filled, results[some], inside[some].view(np.uint8),
            )  # fmt: skip
        else:
            results[some], inside[some] = _costs_at(costs, lattice, corners, poses[some], filled)

    def parts(first: int, end: int) -> None:
        for k in range(first, end):
            part(slice(k * together, (k + 1) * together))

    in_parallel(parts, -(-len(poses) // together))
    return results, inside


def _poses_together(resolution: float, corners: Floats) -> int:
    """Return for how many poses cells are looked up together."""
    lengths = np.abs(np.roll(corners, -1, axis=0) - corners).sum(axis=1)
    cells = float((lengths / resolution).sum()) + 2 * len(corners)
    return int(min(max(_CELLS_TOGETHER // cells, 1), _POSES_TOGETHER))


def _costs_at(
    costs: Bytes, lattice: Lattice, corners: Floats, poses: Floats, filled: bool
) -> tuple[Bytes, Mask]:
    rows, cols, inside = _corner_cells(costs.shape, lattice, corners, poses)
    results = np.full(len(poses), LETHAL, dtype=np.uint8)
    if len(rows):
        worst = _of_outline(costs, rows, cols, filled=filled)
        if filled:
            worst = np.maximum(worst, _of_inside(costs, rows, cols))
        results[inside] = _SEVERITY[worst]
    return results, inside


def _corner_cells(
    shape: tuple[int, ...], lattice: Lattice, corners: Floats, poses: Floats
) -> tuple[Indices, Indices, Mask]:
    """Return rows and columns of the corners at the poses that are inside, and which these are."""
    x, y = poses[:, :1], poses[:, 1:2]
    # the C library's, which Nav2 and the compiled kernel call: numpy's own differ in last bits
    angles = np.where(np.isfinite(poses[:, 2]), poses[:, 2], np.nan).tolist()
    cos, sin = (np.array([[of(angle)] for angle in angles]) for of in (math.cos, math.sin))
    grid_cos, grid_sin = math.cos(lattice.yaw), math.sin(lattice.yaw)
    height, width = shape
    with np.errstate(invalid="ignore", over="ignore"):
        dx = x + (corners[:, 0] * cos - corners[:, 1] * sin) - lattice.x
        dy = y + (corners[:, 0] * sin + corners[:, 1] * cos) - lattice.y
        along, across = dx * grid_cos + dy * grid_sin, dy * grid_cos - dx * grid_sin
        cols, rows = along / lattice.resolution, across / lattice.resolution
    held = (along >= 0) & (across >= 0) & (cols < width) & (rows < height)
    inside: Mask = held.all(axis=1)
    return rows[inside].astype(np.int64), cols[inside].astype(np.int64), inside


def _of_outline(costs: Bytes, rows: Indices, cols: Indices, *, filled: bool) -> Bytes:
    """Return the severity of the outline at each pose; of cells (N, K) of its corners."""
    last = rows.shape[1] - 1
    starts, ends = [*range(last), 0], [*range(1, last + 1), last]
    if filled:
        starts, ends = [*starts, last], [*ends, 0]
    row, col = rows[:, starts].ravel(), cols[:, starts].ravel()
    down, right = rows[:, ends].ravel() - row, cols[:, ends].ravel() - col
    n, minor = np.maximum(np.abs(down), np.abs(right)), np.minimum(np.abs(down), np.abs(right))
    which, step = enumerated(np.zeros_like(n), n + 1)
    moved = (n[which] // 2 + step * minor[which]) // np.maximum(n, 1)[which]
    is_flat = (np.abs(right) >= np.abs(down))[which]
    at_row = row[which] + np.sign(down)[which] * np.where(is_flat, moved, step)
    at_col = col[which] + np.sign(right)[which] * np.where(is_flat, step, moved)
    first_cells = np.cumsum(n + 1) - (n + 1)
    lines = np.maximum.reduceat(_SEVERITY[costs[at_row, at_col]], first_cells)
    lines = lines.reshape(len(rows), len(starts))
    worst: Bytes = lines.max(axis=1)
    if filled:
        return worst
    decides = lines >= LETHAL
    first = lines[np.arange(len(rows)), decides.argmax(axis=1)]
    return np.where(decides.any(axis=1), first, worst)


def _of_inside(costs: Bytes, rows: Indices, cols: Indices) -> Bytes:
    """Return the severity of the cells inside of the outline by the even-odd rule; else 0."""
    poses, starts, stops = _inner_spans(rows, cols, costs.shape[1])
    worst = np.zeros(len(rows), dtype=np.uint8)
    flat = costs.ravel()
    ends = np.cumsum(stops - starts)
    cuts = np.searchsorted(ends, np.arange(0, ends[-1] if len(ends) else 0, _CELLS_TOGETHER))
    for some in map(slice, cuts, [*cuts[1:], len(ends)]):
        which, cells = enumerated(starts[some], stops[some])
        if len(cells):
            firsts = np.flatnonzero(np.diff(which, prepend=-1))
            spans = np.maximum.reduceat(_SEVERITY[flat[cells]], firsts)
            np.maximum.at(worst, poses[some][which[firsts]], spans)
    return worst


def _inner_spans(rows: Indices, cols: Indices, width: int) -> tuple[Indices, Indices, Indices]:
    """Return whose inside they are, and the runs of cells, counted through all rows."""
    sides = rows.shape[1]
    row, col = rows.ravel(), cols.ravel()
    next_row, next_col = (np.roll(cells, -1, axis=1).ravel() for cells in (rows, cols))
    is_up = row < next_row
    low_row, low_col = np.where(is_up, row, next_row), np.where(is_up, col, next_col)
    high_row, high_col = np.where(is_up, next_row, row), np.where(is_up, next_col, col)
    which, row = enumerated(low_row, high_row)
    rise, run = (high_row - low_row)[which], (high_col - low_col)[which]
    col = low_col[which] - (row - low_row[which]) * -run // rise
    order = np.lexsort((col, row, which // sides))
    # a closed outline crosses a row an even number of times: enter, leave, enter, leave
    starts, stops = order[::2], order[1::2]
    at = row[starts] * width
    return which[starts] // sides, at + col[starts], at + col[stops]
