"""Measurements of sensors in cells: points of clouds, and the evidence of rays.

A ray passes the cells of costmap_2d's line between both ends (`mapdeal.kernels.polygons`) except
the last, where it hits or stops. Ends may lie outside of the grid; the cells inside are the same as
on a larger grid.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.arrays import Bytes, Floats, Integers, Integers32, Mask
from mapdeal.kernels.distance import bytes_by_distance
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.polygons import Edges, enumerated, runs
from mapdeal.kernels.threads import in_parallel, thread_count

with suppress(ImportError):  # then `engine_name` is never compiled
    from mapdeal.kernels import _clouds, _compiled, _rays, _updates

_TURN = 2 * math.pi
MOST_EXPANSION = 132  # of LZF: two bytes of data copy at most 264 bytes
DISTANCE_UNIT = 1 << 20  # one truncation in `measure_rays`: integer sums are exact
# marks of `weigh_rays`: an observed cell, one hit, and the number up to which hits count
OBSERVED, A_HIT, MOST_HITS = 1, 2, 3
_PARTS_PER_THREAD = 2  # each part of the rows reads every beam once more
_CELLS_TOGETHER = 1 << 20
_RAYS_TOGETHER = 1 << 16
_MOST_ROOM = 253  # cells that a ray may jump: bytes hold it above two marks, see rays.h
_MOST_STEPS = 1 << 20  # cells of rays that are computed together
# the lowest voxel of a column: bits 16 to 31 are marked, bits 0 to 15 marked or unknown
VOXEL = np.uint32(1 << 16 | 1)
_BITS = np.array([byte.bit_count() for byte in range(256)], dtype=np.uint8)
_NO_COLUMNS = np.empty((0, 0), dtype=np.uint32)


def mark_cloud(
    points: Floats, rule: tuple[float, ...], hit: Mask, *, is_placed: bool
) -> tuple[Integers, Floats]:
    """Mark the cells of points (compiled only); return counts, and points in the robot's frame."""
    counts = np.zeros(6, dtype=np.int64)
    counts[0] = len(points)
    if not len(points):
        return counts, np.empty((0, 2))
    robot_xy = np.empty((len(points), 2))
    bytes_ = hit.view(np.uint8)
    found = _clouds.mark(np.ascontiguousarray(points), rule, is_placed, bytes_, robot_xy, counts)
    return counts, robot_xy[:found]


def cover_angles(angles: Floats, first: Floats, last: Floats) -> None:
    """Update the first and last angle of each bin; bins divide a turn from -pi evenly."""
    if engine_name() == "compiled":
        _clouds.cover(np.ascontiguousarray(angles), _TURN, math.pi, first, last)
        return
    angles = angles - _TURN * np.ceil((angles - math.pi) / _TURN)
    angles = np.minimum(angles, math.pi)  # rounding may exceed pi
    bins = ((angles + math.pi) * (len(first) / _TURN)).astype(np.int64)
    np.clip(bins, 0, len(first) - 1, out=bins)
    np.minimum.at(first, bins, angles)
    np.maximum.at(last, bins, angles)


def decimals_in(text: bytes, *, with_slashes: bool = False) -> Floats:
    """Return decimals between spaces, each up to a slash if wanted; nan for v, else ValueError."""
    if engine_name() == "compiled":
        numbers = np.empty(len(text) // 2 + 1)
        return numbers[: _clouds.parse(text, with_slashes, numbers)]
    words = (re.sub(rb"(?<=\S)/\S*", b"", text) if with_slashes else text).split()
    line = b" ".join([b"nan" if word == b"v" else word for word in words])
    return np.loadtxt([line], comments=None, ndmin=1) if words else np.zeros(0)


def cells_of_points(
    points_xy: Floats, origin: tuple[float, float, float], resolution: float,
    precision: tuple[float, float, float],
) -> Integers | None:  # fmt: skip
    # `precision`: rounding, tolerance and farthest coordinate, as in clouds.h
    if engine_name() != "compiled":
        return None
    x, y, yaw = origin
    cells = np.empty(points_xy.shape, dtype=np.int64)
    is_near = _rays.cells(
        np.ascontiguousarray(points_xy), cells, x, y, math.cos(-yaw), math.sin(-yaw),
        resolution, *precision,
    )  # fmt: skip
    return cells if is_near else None


def lzf_expanded(data: bytes, size: int) -> Bytes | None:
    if size > MOST_EXPANSION * len(data):
        return None
    expanded = np.empty(size, dtype=np.uint8)
    if engine_name() == "compiled":
        return expanded if _compiled.lzf_expand(data, expanded) else None
    return expanded if _expand(data, memoryview(expanded.data)) else None


def _expand(data: bytes, to: memoryview) -> bool:
    place = filled = 0
    while place < len(data):
        control = data[place]
        place += 1
        if control < 32:
            run = control + 1
            if run > len(data) - place or run > len(to) - filled:
                return False
            to[filled : filled + run] = data[place : place + run]
            place += run
            filled += run
            continue
        run = control >> 5
        if run == 7:
            if place >= len(data):
                return False
            run += data[place]
            place += 1
        if place >= len(data):
            return False
        back = filled - ((control & 31) << 8) - data[place] - 1
        place += 1
        run += 2
        if back < 0 or run > len(to) - filled:
            return False
        while run > 0:  # a copy may overlap its source, and repeats it
            part = min(run, filled - back)
            to[filled : filled + part] = to[back : back + part]
            filled, run = filled + part, run - part
    return filled == len(to)


class Odds(NamedTuple):
    on_miss: int
    on_hit: int
    lowest: int
    highest: int


def count_rays(
    starts: Integers, ends: Integers, is_hit: Mask, hits: Integers32, misses: Integers32
) -> None:
    if engine_name() == "compiled":
        _by_rows(_rays.count, hits, starts, ends, is_hit.view(np.uint8), hits, misses)
        return
    for _, at, _ in _passed(starts, ends, misses.shape, with_end=False):
        np.add.at(misses.reshape(-1), at, 1)
    np.add.at(hits.reshape(-1), _hit(ends, is_hit, hits.shape)[1], 1)


def weigh_rays(
    starts: Integers, ends: Integers, is_hit: Mask, odds: Odds, values: Integers32, marks: Bytes
) -> None:
    """Add the increment of each ray to the cells it passes or hits, in place; clamp each time."""
    if engine_name() == "compiled":
        _by_rows(_rays.weigh, values, starts, ends, is_hit.view(np.uint8), *odds, values, marks)
        return
    who_hits, hit_at = _hit(ends, is_hit, values.shape)
    cells, counts = np.unique(hit_at, return_counts=True)
    marked = marks.reshape(-1)
    marked[cells] = OBSERVED + A_HIT * np.minimum(marked[cells] // A_HIT + counts, MOST_HITS)
    hits_so_far = 0
    for whose, at, stop in _passed(starts, ends, values.shape, with_end=False):
        hits = slice(hits_so_far, int(np.searchsorted(who_hits, stop)))
        hits_so_far = hits.stop
        at = np.concatenate([at, hit_at[hits]])
        order = np.concatenate([whose, who_hits[hits]])
        added = np.repeat([odds.on_miss, odds.on_hit], [len(whose), hits.stop - hits.start])
        _add_in_order(at, order, added, odds, values.reshape(-1))
        marked[at] |= OBSERVED


def measure_rays(
    starts: Integers, ends: Integers, sensors_rowcol: Floats, ranges: Floats, truncation: float,
    behind: float, sums: Integers | Floats, weights: Integers32, cell: float = 1.0,
) -> None:  # fmt: skip
    """Add to cells, in place, their signed distances to the hits of rays."""
    if engine_name() == "compiled":
        _by_rows(
            _rays.measure, sums, starts, ends, np.ascontiguousarray(sensors_rowcol),
            np.ascontiguousarray(ranges), truncation, behind, cell, sums, weights,
        )  # fmt: skip
        return
    flat: NDArray[Any] = sums.reshape(-1)
    keeps_means = sums.dtype == np.float64
    for whose, at, _ in _passed(starts, ends, sums.shape, with_end=not keeps_means):
        row, col = np.divmod(at, sums.shape[1])
        y, x = row + 0.5 - sensors_rowcol[whose, 0], col + 0.5 - sensors_rowcol[whose, 1]
        distance = (ranges[whose] - np.sqrt(y * y + x * x) * cell) / truncation
        near = distance >= -behind
        share = np.minimum(np.maximum(distance[near], -1.0), 1.0)
        if keeps_means:
            _average_in_order(at[near], share, flat, weights.reshape(-1))
            continue
        units = (share * DISTANCE_UNIT + (DISTANCE_UNIT + 0.5)).astype(np.int64) - DISTANCE_UNIT
        np.add.at(flat, at[near], units)
        np.add.at(weights.reshape(-1), at[near], 1)


def room_around(obstacles: Mask, opaque: Mask) -> Bytes:
    """Return how far rays may jump from each cell, for `cast_rays`; opaque cells end them."""
    # Two places of cells whose centres are d apart are more than d - sqrt(2) apart.
    distances = np.sqrt(np.arange((_MOST_ROOM + 2) ** 2)) - (math.sqrt(2) + 1e-6)
    table = (2 + np.clip(np.floor(distances), 0, _MOST_ROOM)).astype(np.uint8)
    room = bytes_by_distance(obstacles | opaque, table)
    room[opaque], room[obstacles] = 1, 0
    return room


def cast_rays(room: Bytes, starts: Floats, angles: Floats, limit: float) -> Floats:
    """Return the distances of rays to obstacles, shape (N, M), in cells; inf from the limit on."""
    # Starts are rows and columns, shape (N, 2); angles, shape (N, M), are those to the axis of x.
    distances = np.full(angles.shape, np.inf)
    starts = np.ascontiguousarray(starts)
    scans_together = max(1, _RAYS_TOGETHER // max(1, angles.shape[1]))

    def cast(first: int, end: int) -> None:
        for k in range(first, end):
            part = slice(k * scans_together, (k + 1) * scans_together)
            directions = np.stack([np.sin(angles[part]), np.cos(angles[part])], axis=-1)
            if engine_name() == "compiled":
                _rays.cast(room, starts[part], directions, limit, distances[part])
            else:
                _cast(room, starts[part], directions, limit, distances[part])

    in_parallel(cast, -(-len(starts) // scans_together))
    return distances


def _cast(room: Bytes, starts: Floats, directions: Floats, limit: float, distances: Floats) -> None:
    """Do the same as `cast_in` of rays.h, one step of all rays at a time."""
    start = np.repeat(starts, distances.shape[1], axis=0)
    direction = directions.reshape(-1, 2)
    with np.errstate(divide="ignore"):
        per_cell = 1.0 / np.abs(direction)
    step = np.where(direction < 0, -1, 1)
    cells = np.floor(start).astype(np.int64)
    at, ray = np.zeros(len(start)), np.arange(len(start))
    while len(ray):
        is_inside = ((cells >= 0) & (cells < room.shape)).all(axis=1) & (at < limit)
        here = room[tuple(np.where(is_inside[:, np.newaxis], cells, 0).T)]
        is_hit = is_inside & (here == 0)
        distances.reshape(-1)[ray[is_hit]] = at[is_hit]
        goes_on = is_inside & (here > 1)
        ray, at, cells, here = ray[goes_on], at[goes_on], cells[goes_on], here[goes_on]
        origin, heading, to_edge = start[ray], direction[ray], step[ray]
        ends = np.where(heading < 0, origin - cells, cells + 1 - origin) * per_cell[ray]
        is_along = ends[:, 1] <= ends[:, 0]
        jumps = here > 2
        at = np.where(jumps, at + (here - 2.0), np.maximum(at, ends.min(axis=1)))
        moved = cells + to_edge * np.column_stack([~is_along, is_along])
        jumped = np.floor(origin + at[:, np.newaxis] * heading).astype(np.int64)
        cells = np.where(jumps[:, np.newaxis], jumped, moved)


def _by_rows(
    work: Callable[..., None], layer: NDArray[Any], starts: Integers, ends: Integers, *more: Any
) -> None:
    # Each thread follows all rays, but only through its own rows. So every cell receives the beams
    # in order, and results do not depend on the number of threads.
    starts, ends = np.ascontiguousarray(starts), np.ascontiguousarray(ends)
    height = len(layer)
    parts = min(height, 1 if thread_count() == 1 else _PARTS_PER_THREAD * thread_count())

    def work_on(first: int, end: int) -> None:
        for k in range(first, end):
            work(starts, ends, *more, height * k // parts, height * (k + 1) // parts)

    in_parallel(work_on, parts)


def _hit(ends: Integers, is_hit: Mask, shape: tuple[int, ...]) -> tuple[Integers, Integers]:
    whose = np.flatnonzero(is_hit & ((ends >= 0) & (ends < shape)).all(axis=1))
    return whose, ends[whose, 0] * shape[1] + ends[whose, 1]


def _passed(
    starts: Integers, ends: Integers, shape: tuple[int, ...], *, with_end: bool
) -> Iterator[tuple[Integers, Integers, int]]:
    """Yield about `_CELLS_TOGETHER` cells of lines in a grid at a time: line, flat index, stop."""
    # Each item completes the lines before index `stop`.
    height, width = shape
    edges = Edges(*starts.T, *ends.T)
    most = np.minimum(np.abs(ends - starts).max(axis=1) + 1, height + width)  # cells inside
    share = (np.cumsum(most) - most) // _CELLS_TOGETHER
    begins = np.flatnonzero(np.diff(share, prepend=-1))
    for begin, stop in pairwise([*begins.tolist(), len(starts)]):
        ray, spans = runs(edges.chosen(np.arange(begin, stop)), 0, height)
        run, cols = enumerated(np.clip(spans.starts, 0, width), np.clip(spans.stops, 0, width))
        whose, rows = ray[run] + begin, spans.rows[run]
        if not with_end:
            passed = (rows != ends[whose, 0]) | (cols != ends[whose, 1])
            whose, rows, cols = whose[passed], rows[passed], cols[passed]
        yield whose, rows * width + cols, stop


def _average_in_order(at: Integers, shares: Floats, means: Floats, weights: Integers32) -> None:
    """Update means with the shares of rays, first the first share of all cells, then the second."""
    order = np.argsort(at, kind="stable")
    at, shares = at[order], shares[order]
    (following,) = np.nonzero(np.diff(at, prepend=-1))
    stops = np.append(following[1:], len(at))
    while len(following):
        cells = at[following]
        means[cells] = (weights[cells] * means[cells] + shares[following]) / (weights[cells] + 1)
        weights[cells] += 1
        following += 1
        following, stops = following[following < stops], stops[following < stops]


def _add_in_order(
    at: Integers, order: Integers, added: Integers, odds: Odds, values: Integers32
) -> None:
    """Add to cells in order, clamping after each addition; many cells at a time."""
    # Adding and clamping, x -> min(max(x + a, low), high), is a function of three parameters, and
    # the composition of two such functions is another one. Neighbouring pairs are composed until
    # each cell has one function.
    sorting = np.lexsort((order, at))
    at, a = at[sorting], added[sorting].astype(np.int64)
    low = np.full(len(at), odds.lowest, dtype=np.int64)
    high = np.full(len(at), odds.highest, dtype=np.int64)
    while True:
        starts = np.flatnonzero(np.diff(at, prepend=-1))
        place = np.arange(len(at)) - np.repeat(starts, np.diff(starts, append=len(at)))
        first = np.flatnonzero(place % 2 == 0)
        has_next = np.append(place[1:] % 2 == 1, False)[first]
        if not has_next.any():
            break
        before = first[has_next]
        more, floor, top = a[before + 1], low[before + 1], high[before + 1]
        a[before] += more
        low[before] = np.clip(low[before] + more, floor, top)
        high[before] = np.clip(high[before] + more, floor, top)
        at, a, low, high = at[first], a[first], low[first], high[first]
    values[at] = np.clip(values[at] + a, low, high)


class CellRays(NamedTuple):
    """Rays in whole cells, which end `steps` cells from their start along the longer axis."""

    starts: Integers  # one row per axis: x, y and for voxels z
    deltas: Integers
    steps: Integers

    def cells(self) -> Iterator[Integers]:
        """Yield the cells of all rays, one row per axis, some rays at a time."""
        # After i steps, bresenham2D and bresenham3D have moved (n / 2 + i * delta) / n cells along
        # an axis, where n is the largest difference. Along that axis this is i.
        together = max(1, _MOST_STEPS // (int(self.steps.max(initial=0)) + 1))
        for first in range(0, len(self.steps), together):
            part = slice(first, first + together)
            deltas, steps = self.deltas[:, part], self.steps[part]
            lengths = np.abs(deltas).astype(np.int32)
            longest = np.maximum(lengths.max(axis=0), 1)
            count = np.arange(int(steps.max(initial=0)) + 1, dtype=np.int32)[:, np.newaxis]
            is_reached, cells = count <= steps, []
            for start, delta, length in zip(self.starts[:, part], deltas, lengths, strict=True):
                moved = (longest // 2 + count * length) // longest
                cells.append((start + np.where(delta > 0, moved, -moved))[is_reached])
            yield np.array(cells)


def clear_rays(
    rays: CellRays, costs: Bytes, columns: NDArray[np.uint32] = _NO_COLUMNS, *,
    mark_threshold: int = 0, unknown_threshold: int = 0,
) -> None:  # fmt: skip
    """Clear the cells of rays; with columns, their voxels, and cells that have few marks left."""
    # Those become free, or 255 if more voxels than `unknown_threshold` are unknown.
    if engine_name() == "compiled":
        starts, deltas, steps = map(np.ascontiguousarray, rays)
        _updates.clear(starts, deltas, steps, costs, columns, mark_threshold, unknown_threshold)
        return
    for col, row, *levels in rays.cells():
        if not levels:
            costs[row, col] = 0
            continue
        (level,) = levels
        for height in np.unique(level).tolist():  # equal assignments may repeat
            at = row[level == height], col[level == height]
            columns[at] &= ~np.uint32(VOXEL << height)
        marked, both = columns[row, col] >> 16, columns[row, col] & 0xFFFF
        has_few = _bits_of(marked) <= mark_threshold
        is_known = _bits_of(marked ^ both) <= unknown_threshold
        costs[row[has_few], col[has_few]] = np.where(is_known, 0, 255)[has_few]


def _bits_of(values: NDArray[np.uint32]) -> Bytes:
    return np.asarray(_BITS[values & 0xFF] + _BITS[values >> 8])
