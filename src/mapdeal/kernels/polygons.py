"""Cells of polygons, discs and lines, as spans of rows, and costs of footprints.

Lines are those of ``raytraceLine`` and ``bresenham2D`` in ``costmap_2d.hpp`` of both ROS navigation
stacks. n is the larger difference; the error starts at n // 2 and grows by the smaller difference
with each step; where it reaches n, the minor axis moves. So after i steps the minor axis has moved
(n // 2 + i * minor) // n times. The lines from a to b and from b to a may differ.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mapdeal.kernels import engine, threads
from mapdeal.kernels.arrays import Array, Bytes, Floats, Integers, Mask

_SHORT = 8  # runs up to this length are painted together, longer ones one by one
MOST_TOGETHER = 1 << 20  # at a time, so that a shape needs no more memory than its map
_TOLERANCE = 1e-9  # cells: centres exactly on the rim belong to the shape
_LEVEL = 1e-12  # cells: a side that rises less is level and crosses at most one row of centres
Position = tuple[float, float]
_Ends = tuple[Floats, Floats]
Cell = tuple[int, int]
Pose = tuple[int, int, int]  # heading, row and column
FARTHEST_CELL = 1 << 30  # up to this cell index all products in this module fit 64 bits
_COUNT_BITS = 20  # of the count of runs of a kind that cover a cell; three share 64 bits
_SOLID, _HOLLOW, _RIM = (1 << (_COUNT_BITS * k) for k in range(3))
_ONE_COUNT = (1 << _COUNT_BITS) - 1
LETHAL, UNKNOWN = 254, 255
_CELLS_TOGETHER = 1 << 18  # of outlines that a thread looks up at a time, small in memory
_POSES_TOGETHER = 1 << 14
# Severity of a cost, and cost of a severity: 254 is the worst cost of a line, before 255.
_SEVERITY = np.arange(256, dtype=np.uint8)
_SEVERITY[[LETHAL, UNKNOWN]] = UNKNOWN, LETHAL


class Spans(NamedTuple):
    """Cells as runs along rows; runs may overlap."""

    rows: Integers
    starts: Integers
    stops: Integers

    def places(self, shape: tuple[int, int]) -> list[slice]:
        """Return the rows and columns of the cells around which all runs lie in a grid."""
        found = []
        sides = (self.rows, self.rows + 1, shape[0]), (self.starts, self.stops, shape[1])
        for starts, stops, size in sides:
            first, end = max(0, -int(starts.min())), min(size, size + 1 - int(stops.max()))
            found.append(slice(first, max(first, end)))
        return found

    def clipped(self, width: int) -> Spans:
        starts, stops = np.clip(self.starts, 0, width), np.clip(self.stops, 0, width)
        has_cells = starts < stops
        return Spans(self.rows[has_cells], starts[has_cells], stops[has_cells])


def paint(values: Array, spans: Spans, value: int | Integers, *, over: Mask | None = None) -> None:
    """Set the cells of runs to a value, or to the value of each run in order."""
    if isinstance(value, np.ndarray):
        columns = (*spans, value)
        for row, start, stop, own in zip(*(column.tolist() for column in columns), strict=True):
            values[row, start:stop] = own
        return
    is_long = spans.stops - spans.starts > _SHORT
    for row, start, stop in zip(*(column[is_long].tolist() for column in spans), strict=True):
        cells = values[row, start:stop]
        if over is None:
            cells[:] = value
        else:
            cells[over[cells.view(np.uint8)]] = value
    rows, starts, stops = (column[~is_long] for column in spans)
    for k in range(_SHORT):
        has_more = starts + k < stops
        at = rows[has_more], starts[has_more] + k
        if over is not None:
            is_painted = over[values[at].view(np.uint8)]
            at = at[0][is_painted], at[1][is_painted]
        values[at] = value


def enumerated(starts: Integers, stops: Integers) -> tuple[Integers, Integers]:
    """Return the range of each number, and the numbers of all half open ranges in order."""
    counts = np.maximum(stops - starts, 0)
    whose = np.repeat(np.arange(len(counts)), counts)
    before = np.cumsum(counts) - counts
    return whose, np.arange(len(whose)) - before[whose] + starts[whose]


def halves(spans: Spans) -> tuple[Integers, Integers, Integers]:
    """Return rows, starts and exponents of runs of 2^exponent cells: one per span, or two."""
    lengths = spans.stops - spans.starts
    exponents = np.frexp(lengths.astype(np.float64))[1].astype(np.int64) - 1
    second = np.flatnonzero(lengths != 1 << exponents)
    rows = np.concatenate([spans.rows, spans.rows[second]])
    starts = np.concatenate([spans.starts, (spans.stops - (1 << exponents))[second]])
    return rows, starts, np.concatenate([exponents, exponents[second]])


def bands(starts: Integers, stops: Integers, height: int) -> Iterator[tuple[int, int]]:
    """Yield bands of rows that each hold about `MOST_TOGETHER` rows of all ranges together."""
    ends = (np.clip(rows, 0, height) for rows in (starts, np.maximum(starts, stops)))
    begun, ended = (np.bincount(rows, minlength=height + 1) for rows in ends)
    in_row = np.cumsum((begun - ended)[:-1])
    used = np.flatnonzero(in_row)
    if used.size == 0:
        return
    bottom, top = int(used[0]), int(used[-1]) + 1
    share = np.cumsum(in_row[bottom:top]) // MOST_TOGETHER
    edges = bottom + np.flatnonzero(np.diff(share, prepend=-1))
    yield from zip(edges.tolist(), [*edges[1:].tolist(), top], strict=True)


def capsule_spans(start: Position, stop: Position, radius: float, shape: tuple[int, int]) -> Spans:
    """Return the cells whose centre lies within a distance of the segment between two points."""
    reach = radius + _TOLERANCE
    bottom = math.ceil(max(min(start[0], stop[0]) - reach - 0.5, 0))
    top = math.floor(min(max(start[0], stop[0]) + reach - 0.5, shape[0] - 1))
    rows = np.arange(bottom, top + 1, dtype=np.int64)
    if rows.size == 0:
        return Spans(rows, rows, rows)
    y: Floats = rows.astype(np.float64) + 0.5
    # The shape is convex: it meets each row in one run, from its leftmost to its rightmost part.
    ends = [_disc(start, reach, y), _disc(stop, reach, y), *_rim(start, stop, reach, y)]
    low = np.min([end[0] for end in ends], axis=0)
    high = np.max([end[1] for end in ends], axis=0)
    first = np.ceil(np.clip(low - 0.5, -1, shape[1] + 1))
    last = np.floor(np.clip(high - 0.5, -1, shape[1] + 1))
    return Spans(rows, first.astype(np.int64), last.astype(np.int64) + 1).clipped(shape[1])


def _disc(centre: Position, radius: float, y: Floats) -> _Ends:
    squared = radius**2 - (y - centre[0]) ** 2
    half = np.sqrt(np.maximum(squared, 0.0))
    within = squared >= 0
    return (np.where(within, centre[1] - half, np.inf), np.where(within, centre[1] + half, -np.inf))


def _rim(start: Position, stop: Position, radius: float, y: Floats) -> list[_Ends]:
    (y0, x0), (y1, x1) = start, stop
    length = math.hypot(y1 - y0, x1 - x0)
    if length == 0.0:
        return []
    across_y, across_x = radius * (x1 - x0) / length, -radius * (y1 - y0) / length
    sides = []
    for sign in (-1, 1):
        a_y, a_x = y0 + sign * across_y, x0 + sign * across_x
        b_y, b_x = y1 + sign * across_y, x1 + sign * across_x
        if abs(b_y - a_y) < _LEVEL:
            continue  # level: the discs at its ends reach as far
        share = (y - a_y) / (b_y - a_y)
        x = a_x + share * (b_x - a_x)
        within = (share >= 0) & (share <= 1)
        sides.append((np.where(within, x, np.inf), np.where(within, x, -np.inf)))
    return sides


class Edges(NamedTuple):
    """Directed lines between cells, from row, col to next_row, next_col: int64, shape (N,)."""

    row: Integers
    col: Integers
    next_row: Integers
    next_col: Integers

    @property
    def bottom(self) -> Integers:
        return np.minimum(self.row, self.next_row)

    @property
    def top(self) -> Integers:
        return np.maximum(self.row, self.next_row)

    def chosen(self, which: Integers) -> Edges:
        return Edges(*(column[which] for column in self))


def edges_through(cells: Sequence[Cell], *, closed: bool = False) -> Edges:
    ends = np.array(cells, dtype=np.int64).reshape(-1, 2)
    following = np.roll(ends, -1, axis=0)
    if not closed:
        ends, following = ends[:-1], following[:-1]
    return Edges(ends[:, 0], ends[:, 1], following[:, 0], following[:, 1])


def line_spans(edges: Edges, shape: tuple[int, int]) -> Iterator[Spans]:
    for bottom, top in bands(edges.bottom, edges.top + 1, shape[0]):
        _, spans = runs(edges, bottom, top)
        yield spans.clipped(shape[1])


def runs(edges: Edges, bottom: int, top: int) -> tuple[Integers, Spans]:
    """Return the line of each run, and the runs of all lines in rows `bottom` .. `top` - 1."""
    which, rows = enumerated(np.maximum(edges.bottom, bottom), np.minimum(edges.top + 1, top))
    row, col, next_row, next_col = edges.chosen(which)
    across, along = np.abs(next_row - row), np.abs(next_col - col)
    moved = np.abs(rows - row)
    n = np.maximum(np.maximum(across, along), 1)
    # If rows are the major axis, each row has one cell. Otherwise row k holds the steps i with
    # (n // 2 + i * across) // n == k.
    single = (n // 2 + moved * along) // n
    steps = np.maximum(across, 1)
    first = np.where(moved == 0, 0, -((n // 2 - moved * n) // steps))
    last = np.where(moved == across, n, -((n // 2 - (moved + 1) * n) // steps) - 1)
    first, last = (np.where(across >= along, single, end) for end in (first, last))
    to_the_right = next_col >= col
    lowest = np.where(to_the_right, col + first, col - last)
    highest = np.where(to_the_right, col + last, col - first)
    return which, Spans(rows, lowest, highest + 1)


def polygon_spans(rings: Sequence[Sequence[Cell]], shape: tuple[int, int]) -> Iterator[Spans]:
    # The outline consists of costmap_2d's lines of cells between the corners. Inside are the cells
    # whose centre lies inside by the even-odd rule on the corners' centres. Cells inside a hole but
    # not on its outline are left out. A polygon that reaches beyond the grid is cut off exactly.
    # For a convex polygon these are the cells of costmap_2d's ``convexFillCells``, which fills each
    # column from its lowest to its highest cell: also with the corners moved to their cells, a
    # column meets just two edges.
    ring_of = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    yield from _drawn(edges_of_rings(rings), ring_of, shape)


def stacked_spans(edges: Edges, shape: tuple[int, int]) -> Iterator[Spans]:
    """Yield the cells of polygons that share no rows, by rising row."""
    yield from _drawn(edges, np.zeros(len(edges.row), dtype=np.int64), shape)


def edges_of_rings(rings: Sequence[Sequence[Cell]]) -> Edges:
    of_rings = [edges_through(ring, closed=True) for ring in rings]
    return Edges(*(np.concatenate(columns) for columns in zip(*of_rings, strict=True)))


def _drawn(edges: Edges, ring_of: Integers, shape: tuple[int, int]) -> Iterator[Spans]:
    """Yield the cells of ring 0, which may have several parts, minus its holes, the other rings."""
    for bottom, top in bands(edges.bottom, edges.top + 1, shape[0]):
        line_of, outline = runs(edges, bottom, top)
        rim = ring_of[line_of]
        inside_of, inside = _inside(edges, ring_of, bottom, top, shape[1])
        spans = Spans(*map(np.concatenate, zip(outline, inside, strict=True)))
        kinds = np.repeat([_RIM, _HOLLOW], [len(rim), len(inside_of)])
        kinds[np.concatenate([rim, inside_of]) == 0] = _SOLID
        yield _covered(spans, kinds, shape[1])


def _inside(
    edges: Edges, ring_of: Integers, bottom: int, top: int, width: int
) -> tuple[Integers, Spans]:
    """Return the ring of each run, and the runs inside of rings by the even-odd rule."""
    # Cells on an edge may be missing: they belong to the outline.
    which, rows = enumerated(np.maximum(edges.bottom, bottom), np.minimum(edges.top, top))
    row, col, next_row, next_col = edges.chosen(which)
    up = next_row > row
    low_row, low_col = np.where(up, row, next_row), np.where(up, col, next_col)
    high_row, high_col = np.where(up, next_row, row), np.where(up, next_col, col)
    # the first column at or right of the edge, at the rows' centres
    passed = -(((rows - low_row) * (low_col - high_col)) // (high_row - low_row))
    cols = np.clip(low_col + passed, 0, width)
    count = int(ring_of[-1]) + 1
    keys = np.sort(((rows - bottom) * count + ring_of[which]) * (width + 1) + cols)
    places, cols = np.divmod(keys, width + 1)
    # A closed ring crosses a row an even number of times: columns alternately enter and leave.
    rows, rings = np.divmod(places[::2], count)
    return rings, Spans(rows + bottom, cols[::2], cols[1::2])


def _covered(spans: Spans, kinds: Integers, width: int) -> Spans:
    """Return disjoint runs of the solid cells that lie outside of holes or on their rim."""
    starts, stops = (np.clip(ends, 0, width) for ends in (spans.starts, spans.stops))
    keys = np.concatenate([spans.rows * (width + 1) + ends for ends in (starts, stops)])
    order = np.argsort(keys, kind="stable")
    keys, counts = keys[order], np.cumsum(np.concatenate([kinds, -kinds])[order])
    is_last = np.append(keys[1:] != keys[:-1], True)
    keys, counts = keys[is_last], counts[is_last]
    solid = (counts & _ONE_COUNT) > 0
    hollow = ((counts >> _COUNT_BITS) & _ONE_COUNT) > 0
    rim = (counts >> (2 * _COUNT_BITS)) > 0
    change = np.diff((solid & (~hollow | rim)).astype(np.int8), prepend=0)
    rows, begins = np.divmod(keys[change == 1], width + 1)
    return Spans(rows, begins, keys[change == -1] % (width + 1))


class Lattice(NamedTuple):
    resolution: float
    x: float
    y: float
    yaw: float


def costs_at_poses(
    costs: Bytes, lattice: Lattice, corners: Floats, poses: Floats, *, filled: bool
) -> tuple[Bytes, Mask]:
    """Return the cost of a footprint at each pose, and whether all corners lie in the grid."""
    # As Nav2's ``FootprintCollisionChecker``: corners are turned, moved, and truncated to cells.
    # Lines connect each corner to the next, and the first to the last. A line costs 254 if it meets
    # 254, else its largest cost. The footprint costs as much as its most expensive line, but the
    # search ends at the first line of 254, so that a line of 255 before it hides it.
    # A filled footprint has the cells of its outline and those that costmap_2d fills. costmap_2d
    # draws the last line in the other direction, maybe through other cells: both lines count.
    results = np.empty(len(poses), dtype=np.uint8)
    inside = np.empty(len(poses), dtype=np.bool_)
    costs, corners, poses = map(np.ascontiguousarray, (costs, corners, poses))
    compiled = engine.engine_name() == "compiled"

    def part(chosen: slice) -> None:
        if compiled:
            from mapdeal.kernels import _compiled

            _compiled.costs_of_footprints(
                costs, *lattice[:3], math.cos(lattice.yaw), math.sin(lattice.yaw), corners,
                poses[chosen], filled, results[chosen], inside[chosen].view(np.uint8),
            )  # fmt: skip
        else:
            found = _costs_at(costs, lattice, corners, poses[chosen], filled)
            results[chosen], inside[chosen] = found

    sides = np.abs(np.roll(corners, -1, axis=0) - corners).sum(axis=1)
    cells = int(min((sides / lattice.resolution).sum(), _CELLS_TOGETHER)) + 2 * len(corners)
    together = min(max(_CELLS_TOGETHER // cells, 1), _POSES_TOGETHER)
    threads.for_rows(part, (len(poses), cells), together)
    return results, inside


def _costs_at(
    costs: Bytes, lattice: Lattice, corners: Floats, poses: Floats, filled: bool
) -> tuple[Bytes, Mask]:
    rows, cols, inside = _corner_cells(costs.shape, lattice, corners, poses)
    results = np.full(len(poses), LETHAL, dtype=np.uint8)
    if len(rows):
        worst = _of_outline(costs, rows, cols, filled=filled)
        if filled:
            _add_inside(worst, costs, rows, cols)
        results[inside] = _SEVERITY[worst]
    return results, inside


def _corner_cells(
    shape: tuple[int, ...], lattice: Lattice, corners: Floats, poses: Floats
) -> tuple[Integers, Integers, Mask]:
    x, y = poses[:, :1], poses[:, 1:2]
    # sine and cosine of the C library, as in Nav2 and the compiled kernel: numpy's differ slightly
    angles = np.where(np.isfinite(poses[:, 2]), poses[:, 2], np.nan).tolist()
    cos, sin = (np.array([[of(angle)] for angle in angles]) for of in (math.cos, math.sin))
    grid_cos, grid_sin = math.cos(lattice.yaw), math.sin(lattice.yaw)
    height, width = shape
    with np.errstate(invalid="ignore", over="ignore"):
        dx = x + (corners[:, 0] * cos - corners[:, 1] * sin) - lattice.x
        dy = y + (corners[:, 0] * sin + corners[:, 1] * cos) - lattice.y
        along, across = dx * grid_cos + dy * grid_sin, dy * grid_cos - dx * grid_sin
        cols, rows = along / lattice.resolution, across / lattice.resolution
    inside: Mask = ((along >= 0) & (across >= 0) & (cols < width) & (rows < height)).all(axis=1)
    return rows[inside].astype(np.int64), cols[inside].astype(np.int64), inside


def _of_outline(costs: Bytes, rows: Integers, cols: Integers, *, filled: bool) -> Bytes:
    """Return the severity of the outline at each pose, given the corner cells, shape (N, K)."""
    last = rows.shape[1] - 1
    starts, ends = [*range(last), 0], [*range(1, last + 1), last]
    if filled:
        starts, ends = [*starts, last], [*ends, 0]
    edges = Edges(*(cells[:, which].ravel() for which in (starts, ends) for cells in (rows, cols)))
    line_of_run, spans = runs(edges, 0, len(costs))
    run, at_col = enumerated(spans.starts, spans.stops)
    severity = _SEVERITY[costs[spans.rows[run], at_col]]
    begins = np.flatnonzero(np.diff(line_of_run[run], prepend=-1))
    lines = np.maximum.reduceat(severity, begins).reshape(len(rows), len(starts))
    worst: Bytes = lines.max(axis=1)
    if filled:
        return worst
    decides = lines >= LETHAL
    deciding = lines[np.arange(len(rows)), decides.argmax(axis=1)]
    return np.where(decides.any(axis=1), deciding, worst)


def _add_inside(worst: Bytes, costs: Bytes, rows: Integers, cols: Integers) -> None:
    """Raise `worst` by the severity of the cells inside of outlines, by the even-odd rule."""
    ends = np.roll(rows, -1, axis=1), np.roll(cols, -1, axis=1)
    edges = Edges(*(corners.ravel() for corners in (rows, cols, *ends)))
    pose_of_edge = np.repeat(np.arange(len(rows)), rows.shape[1])
    poses, spans = _inside(edges, pose_of_edge, 0, *costs.shape)
    counts = np.cumsum(spans.stops - spans.starts)
    cuts = np.searchsorted(counts, np.arange(0, counts[-1] if len(counts) else 0, _CELLS_TOGETHER))
    for chunk in map(slice, cuts, [*cuts[1:], len(counts)]):
        run, at_col = enumerated(spans.starts[chunk], spans.stops[chunk])
        if len(run):
            severity = _SEVERITY[costs[spans.rows[chunk][run], at_col]]
            begins = np.flatnonzero(np.diff(run, prepend=-1))
            np.maximum.at(worst, poses[chunk][run[begins]], np.maximum.reduceat(severity, begins))
