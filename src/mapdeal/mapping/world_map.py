"""Maps of the solids of a simulated world: a horizontal section, or what a robot would hit.

A cell of a section is on a surface if its centre lies within half a cell of an edge, and inside if
the edges of a solid wind around its centre. Free space is known where a robot could map it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from mapdeal import command, errors
from mapdeal.grid import occupancy, values as map_values
from mapdeal.grid.frame import MOST_CELLS, Frame, Region, check_resolution
from mapdeal.kernels import components, polygons
from mapdeal.kernels.arrays import Floats, Integers, Mask
from mapdeal.mapping.cloud_map import MARGIN, CloudMapper, CloudOptions, box_of, ledges
from mapdeal.mapping.voxels import Claim
from mapdeal.records import dataclass, replace

_EPSILON = float(np.finfo(np.float32).eps)
_INWARDS = 0.01  # cells that points on surfaces move into solids
_AT_ONCE = 1 << 20  # cells near edges
_SPACING = 0.5  # cells between points on surfaces
_LONGEST = 64.0  # cells: longer triangles are split, and those outside of the map left out
_POINTS_AT_ONCE = 1 << 19
_SLAB = 0.1  # metres between sections of solids that a robot would hit
_SHARE_ENCLOSED = 0.1  # least area of an enclosed space relative to that around everything
_PER_CELL, _PER_CROSSING = 40, 100  # bytes
_OUTWARDS, _DOWN = 0.3, 0.1  # cells, and the vertical part of a normal


@dataclass(frozen=True, kw_only=True)
class WorldOptions:
    """Options of maps of simulated worlds.

    Parameters
    ----------
    height : float, optional
        Height of the horizontal section that a lidar sees, metres; or else --robot-height.
    solid : bool
        Occupy the inside of solids, and free all space around; both are unknown otherwise.
    visual : bool
        Use what cameras see, <visual>, instead of <collision>.
    static_only : bool
        Skip movable models, those without <static>true</static>.
    """

    height: Annotated[float | None, command.Words("Z"), command.METRES] = None
    solid: bool = False
    visual: bool = False
    static_only: bool = False


class Section(NamedTuple):
    """Edges of a horizontal section, x and y, with the inside of their solid on the left."""

    begin: Floats
    end: Floats
    solid: Integers


def section_at(triangles: Floats, solids: Integers, height: float) -> Section:
    """Return the section of triangles; corners at the height itself count as above it."""
    above = triangles[:, :, 2] >= height
    count = above.sum(axis=1)
    crossing = np.flatnonzero((count == 1) | (count == 2))
    above, is_peak = above[crossing], count[crossing] == 1
    lone = np.where(is_peak, above.argmax(axis=1), above.argmin(axis=1))
    order = (lone[:, np.newaxis] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles[crossing], order[:, :, np.newaxis], 1).transpose(1, 0, 2)
    points = []
    for corner in (b, c):
        # always from the lower corner, so that triangles with a common side meet exactly
        is_up = is_peak[:, np.newaxis]
        low, high = np.where(is_up, corner, a), np.where(is_up, a, corner)
        share = (height - low[:, 2]) / (high[:, 2] - low[:, 2])
        points.append(low[:, :2] + (high - low)[:, :2] * share[:, np.newaxis])
    begin, end = (np.where(is_peak[:, np.newaxis], *pair) for pair in (points, points[::-1]))
    return Section(begin, end, solids[crossing])


class _Runs(NamedTuple):
    """Runs of cells along rows whose centres are inside a solid, sorted by solid and row."""

    solid: Integers
    row: Integers
    start: Integers
    stop: Integers
    frame: Frame

    def depths(self) -> Integers:
        width = self.frame.width + 1
        change = np.zeros(self.frame.height * width, np.int64)
        for col, sign in ((self.start, 1), (self.stop, -1)):
            change += sign * np.bincount(self.row * width + col, minlength=len(change))
        return np.asarray(change.reshape(-1, width).cumsum(axis=1)[:, :-1])

    def hold(self, solid: Integers, row: Integers, col: Integers) -> Mask:
        if not len(self.solid):
            return np.zeros(len(solid), np.bool_)
        height, width = self.frame.shape
        keys = (self.solid * height + self.row) * width + self.start
        line = (solid * height + row) * width
        last = np.searchsorted(keys, line + col, side="right") - 1
        return np.asarray((last >= 0) & (keys[last] >= line) & (col < self.stop[last]))


def _distinct(keys: Integers) -> Integers:
    keys = np.sort(keys)  # several times as fast as np.unique
    return np.asarray(keys[np.diff(keys, prepend=-1) != 0])


def surface_cells(section: Section, frame: Frame, runs: _Runs) -> Mask:
    """Return the cells whose centre lies within half a cell of an edge, and not in other solids."""
    from scipy import ndimage  # takes long to import

    begin, along, length = _in_cells(section, frame)
    normals = along[:, ::-1] * [-1, 1] / np.maximum(length, 1e-12)[:, np.newaxis]
    # surfaces between two cells count once: as far inwards as float32 may have moved them
    begin = begin + _EPSILON * (1 + np.abs(section.begin).max()) / frame.resolution * normals
    ys = begin[:, 1], begin[:, 1] + along[:, 1]
    first = np.clip(np.ceil(np.minimum(*ys) - 1), 0, frame.height).astype(np.int64)
    stop = np.clip(np.floor(np.maximum(*ys)) + 1, 0, frame.height).astype(np.int64)
    cost = np.cumsum(stop - first + np.minimum(length, frame.width))
    keys = np.zeros(0, np.int64)
    cuts = np.searchsorted(cost, np.arange(_AT_ONCE, cost[-1], _AT_ONCE))
    for part in np.split(np.arange(len(cost)), cuts):
        edge, row = polygons.enumerated(first[part], stop[part])
        edge = part[edge]
        (x, y), (dx, dy) = begin[edge].T, along[edge].T
        y, steep = row + 0.5 - y, np.where(np.abs(dy) < 1e-12, 1e-12, dy)
        tilt = 0.5 * np.sign(steep) * dx / np.hypot(dx, steep)
        ends = []
        for sign in (-1, 1):  # the places half a cell from the edge, farthest left and right
            share = np.clip((y + sign * tilt) / steep, 0.0, 1.0)
            away = np.sqrt(np.maximum(0.25 - (y - share * dy) ** 2, 0.0))
            ends.append(x + share * dx + sign * away)
        start = np.clip(np.ceil(ends[0] - 0.5), 0, frame.width).astype(np.int64)
        last = np.clip(np.floor(ends[1] + 0.5), start, frame.width).astype(np.int64)
        whose, col = polygons.enumerated(start, last)
        found = (section.solid[edge] * frame.height + row)[whose] * frame.width + col
        keys = _distinct(np.concatenate([keys, _distinct(found)]))
    solid, row, col = np.unravel_index(keys, (int(section.solid.max()) + 1, *frame.shape))
    is_near = np.zeros(frame.shape, np.bool_)
    is_near[row, col] = True
    inside, size = runs.hold(solid, row, col), is_near.size
    own = np.bincount(keys[inside] % size, minlength=size).reshape(frame.shape)
    # thin legs between the centres of cells count in one cell
    cells = np.floor(begin[length > _EPSILON, ::-1]).astype(np.int64)
    cells = cells[((cells >= 0) & (cells < frame.shape)).all(axis=1)]
    is_lost = np.zeros(frame.shape, np.bool_)
    is_lost[tuple(cells.T)] = True
    is_lost &= ~ndimage.binary_dilation(is_near, np.ones((3, 3)))
    for y, x in np.argwhere(is_lost).tolist():
        is_near[y, x] = not is_near[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2].any()
    depths = runs.depths()
    # solids that touch hide the seam between them
    is_outside = ndimage.binary_dilation(depths == 0, np.ones((3, 3)))
    return np.asarray(is_near & (own == depths) & is_outside)


def inside_runs(section: Section, frame: Frame) -> _Runs:
    begin, along, _ = _in_cells(section, frame)
    edge, row, share = _rows_crossed(begin[:, 1], along[:, 1], frame.height)
    x = begin[edge, 0] + share * along[edge, 0]
    turn = np.where(along[edge, 1] < 0, 1, -1)  # the inside is on the left
    order = np.lexsort((x, row, section.solid[edge]))
    solid, row, x, turn = section.solid[edge][order], row[order], x[order], turn[order]
    enters, leaves = _winding_runs(solid * frame.height + row, turn)
    start, stop = np.clip(np.ceil(x[[enters, leaves]] - 0.5), 0, frame.width).astype(np.int64)
    has_cells = start < stop
    at = enters[has_cells]
    return _Runs(solid[at], row[at], start[has_cells], stop[has_cells], frame)


def _winding_runs(line: Integers, turn: Integers) -> tuple[Integers, Integers]:
    """Return where sorted crossings enter and leave solids; each line crosses one solid."""
    starts = np.flatnonzero(np.diff(line, prepend=-1))
    if len(starts):
        counts = np.diff(starts, append=len(line))
        # surfaces with wrong sides count by turns; lines through an open surface do not count
        alternating = 1 - 2 * ((np.arange(len(line)) - np.repeat(starts, counts)) % 2)
        is_closed = np.repeat(np.add.reduceat(turn, starts) == 0, counts)
        turn = np.where(is_closed, turn, alternating) * np.repeat((counts % 2) == 0, counts)
    winding = np.cumsum(turn)
    enters, leaves = (winding != 0) & (winding == turn), (winding == 0) & (turn != 0)
    return np.flatnonzero(enters), np.flatnonzero(leaves)


def _rows_crossed(begin: Floats, along: Floats, height: int) -> tuple[Integers, Integers, Floats]:
    """Return the edge, row and share of the edge where edges cross the middles of rows."""
    end = begin + along
    ends = np.array([np.minimum(begin, end), np.maximum(begin, end)])
    lowest, highest = np.clip(np.ceil(ends - 0.5), 0, height).astype(np.int64)
    edge, row = polygons.enumerated(lowest, highest)
    return edge, row, (row + 0.5 - begin[edge]) / along[edge]


def _in_cells(section: Section, frame: Frame) -> tuple[Floats, Floats, Floats]:
    begin, end = (frame.continuous_rowcol_from_xy(xy)[:, ::-1] for xy in section[:2])
    along = end - begin
    return begin, along, np.hypot(along[:, 0], along[:, 1])


def frame_around(points_xy: Floats, resolution: float) -> Frame:
    """Return a grid around points, on the lattice of the resolution, with a margin."""
    lattice = Frame(1, 1, check_resolution(resolution))
    ends = np.stack([points_xy.min(axis=0), points_xy.max(axis=0)])
    first, last = lattice.unbounded_rowcol_from_xy(ends)
    height, width = (last - first + 1 + 2 * MARGIN).tolist()
    if height * width > MOST_CELLS:
        size = " x ".join(f"{side:.6g}" for side in (ends[1] - ends[0]).tolist())
        hint = "are lengths in millimetres? --size and --origin bound the map"
        raise errors.MalformedInputError(f"extends over {size} m: too far for a map", hint=hint)
    row, col = (first - MARGIN).tolist()
    return Region(row, col, height, width).frame_in(lattice)


def _space_in(free: Mask, frame: Frame, at: tuple[float, ...] | None) -> tuple[Mask, float]:
    """Return the free cells around a place or robot, and the largest area behind walls, m2."""
    spaces = components.labelled(free, corners=False)
    sizes = spaces.sizes.copy()
    sizes[0] = 0
    rim = np.ones(free.shape, np.bool_)
    rim[1:-1, 1:-1] = False
    enclosed = np.where(spaces.touched_by(rim & free), 0, sizes)
    chosen = int(sizes.argmax())
    if at is not None:
        cell = frame.unbounded_rowcol_from_xy([at[:2]])[0]
        inside = frame.holds(tuple(cell.tolist()))
        chosen = int(spaces.cells[tuple(cell)]) if inside else 0
        if not chosen:
            rule = "must be free" if inside else "lies outside of the map"
            raise errors.ParameterError(rule, place="at", got=at)
    elif enclosed.max() >= _SHARE_ENCLOSED * sizes.max():
        chosen = int(enclosed.argmax())
    enclosed[chosen] = 0
    return (spaces.cells == chosen) & free, float(enclosed.max() * frame.resolution**2)


def map_of_world(
    triangles: Floats, solids: Integers, robot: CloudOptions, options: WorldOptions, *,
    resolution: float, frame: Frame | None, claim: Claim,
) -> tuple[occupancy.OccupancyGrid, float]:  # fmt: skip
    """Return the map of triangles and the solid of each, and the largest area behind walls, m2."""
    size = resolution, frame, claim
    if options.height is None:
        occupied, free, frame = _for_robot(triangles, solids, robot, *size, solid=options.solid)
    else:
        occupied, inside, frame = _at_height(triangles, solids, options.height, *size)
        free = ~(occupied | inside)
        occupied |= inside & options.solid
    known, elsewhere_m2 = (free, 0.0) if options.solid else _space_in(free, frame, robot.at)
    values = np.where(known, map_values.FREE, map_values.UNKNOWN).astype(np.int8)
    values[occupied] = map_values.OCCUPIED
    return occupancy.OccupancyGrid(values, frame.resolution, frame.origin), elsewhere_m2


def _at_height(
    triangles: Floats, solids: Integers, height: float, resolution: float, frame: Frame | None,
    claim: Claim,
) -> tuple[Mask, Mask, Frame]:  # fmt: skip
    """Return what a lidar at a height sees of solids, and their inside."""
    section = section_at(triangles, solids, height)
    if not len(section.begin):
        low, high = triangles[:, :, 2].min(), triangles[:, :, 2].max()
        rule = f"meets nothing: solids reach from {low:.4g} to {high:.4g} m"
        raise errors.ParameterError(rule, place="height", got=height)
    frame = frame or frame_around(np.concatenate(section[:2]), resolution)
    crossed = np.abs(section.end - section.begin).sum() / frame.resolution
    memory = _PER_CELL * (frame.height * frame.width) + _PER_CROSSING * int(crossed)
    claim(memory, f"{frame.width} x {frame.height} cells")
    runs = inside_runs(section, frame)
    return surface_cells(section, frame, runs), runs.depths() > 0, frame


def _for_robot(
    triangles: Floats, solids: Integers, options: CloudOptions, resolution: float,
    frame: Frame | None, claim: Claim, *, solid: bool,
) -> tuple[Mask, Mask, Frame]:  # fmt: skip
    """Return what a robot hits, with ramps and steps as in maps of clouds, and the free floor."""
    points, has_frame = triangles.reshape(-1, 3), frame is not None
    frame = frame or frame_around(points[:, :2], resolution)
    cell = frame.resolution
    row, col = frame.continuous_rowcol_from_xy(points[:, :2]).T
    # in cells of the map, which may be turned
    local = np.stack([col, row, points[:, 2] / cell], axis=1).reshape(-1, 3, 3)
    if options.at is not None:
        row, col = (frame.continuous_rowcol_from_xy([options.at[:2]])[0] * cell).tolist()
        options = replace(options, at=(col, row, options.at[2]))
    mapper = CloudMapper(replace(options, up="z"), frame=Frame(*frame.shape, cell), claim=claim)
    columns = _columns_of(local, solids, frame.shape)
    for points, triangle in points_on(local, frame.shape):
        visible = columns.visible(points, local[triangle], solids[triangle], options.climb / cell)
        mapper.add(points[visible] * cell)
    try:
        contents = mapper.settle()
    except errors.MalformedInputError as error:  # its hint is about clouds
        error.hint = "--floor Z adds a level floor; --at X,Y,Z names a place on a floor"
        raise
    occupied = contents.obstacles.sum(axis=0) > 0
    is_floor = (contents.on_floor > 0) & ~occupied
    if options.drops == "occupied":
        occupied |= (contents.below > 0) & (contents.on_floor == 0)
        occupied |= ledges(contents.floor, is_floor, contents.clearance) & is_floor
    heights = np.where(is_floor, contents.floor / cell, np.nan)
    occupied |= columns.steps(heights, options.climb / cell)
    if solid:
        above = contents.floor.ravel()[columns.cell]
        hits = columns.bottom * cell <= above + options.robot_height
        hits &= columns.top * cell > above + contents.clearance
        occupied.ravel()[columns.cell[hits]] = True
    is_floor &= ~occupied
    if not has_frame:
        box = box_of(occupied if occupied.any() else is_floor)
        part = box.shared_with(occupied.shape)
        occupied, is_floor, frame = occupied[part], is_floor[part], box.frame_in(frame)
    return occupied, is_floor, frame


class _Columns(NamedTuple):
    """Solids above the middles of cells, and surfaces that look up; lengths in cells."""

    cell: Integers  # sorted
    bottom: Floats
    top: Floats
    solid: Integers
    closed: Mask  # by solid
    upper_cell: Integers  # sorted
    upper: Floats
    upper_rise: Floats  # per cell, along columns and rows
    shape: tuple[int, int]

    def steps(self, floor: Floats, climb: float) -> Mask:
        """Return the cells on top of steps that are too high for a robot."""
        # The floor of a cloud is not exact: the surface near it is.
        near = np.flatnonzero(self.upper <= floor.ravel()[self.upper_cell] + 2 * climb)
        height, rise = np.full(self.shape, np.nan), np.zeros((2, *self.shape))
        for place, values in ((height, self.upper), *zip(rise, self.upper_rise.T, strict=True)):
            place.ravel()[self.upper_cell[near]] = values[near]  # the highest is the last
        height[~(np.abs(height - floor) <= 2 * climb)] = np.nan
        found = np.zeros(self.shape, np.bool_)
        for z, slope, steep in ((height, rise[1], found), (height.T, rise[0].T, found.T)):
            # where the planes of both cells end at their common edge
            step = z[1:] - slope[1:] / 2 - z[:-1] - slope[:-1] / 2
            steep[:-1] |= step < -climb - _INWARDS
            steep[1:] |= step > climb + _INWARDS
        return found

    def visible(self, points: Floats, triangles: Floats, solid: Integers, climb: float) -> Mask:
        """Return which points are outside of other solids, and not under boxes on the ground."""
        normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        normal /= np.maximum(np.sqrt((normal**2).sum(axis=1)), 1e-12)[:, np.newaxis]
        beside = points + _OUTWARDS * normal
        at = self._cells(beside)
        whose, run = _pairs_with_equal_keys(self.cell, at)
        z = beside[whose, 2]
        hides = (self.bottom[run] < z) & (z < self.top[run]) & (self.solid[run] != solid[whose])
        visible = np.bincount(whose[hides], minlength=len(points)) == 0
        below = np.flatnonzero(visible & (normal[:, 2] < -_DOWN) & self.closed[solid])
        whose, run = _pairs_with_equal_keys(self.upper_cell, self._cells(points[below]))
        gap = points[below[whose], 2] - self.upper[run]
        least = np.full(len(below), np.inf)
        is_over = gap > -_OUTWARDS
        np.minimum.at(least, whose[is_over], gap[is_over])
        visible[below[(least <= climb) | np.isinf(least)]] = False
        return np.asarray(visible)

    def _cells(self, points: Floats) -> Integers:
        col, row = np.clip(np.floor(points[:, :2]), 0, np.array(self.shape[::-1]) - 1).T
        return np.asarray(row * self.shape[1] + col, dtype=np.int64)


def _pairs_with_equal_keys(in_order: Integers, searched: Integers) -> tuple[Integers, Integers]:
    first = np.searchsorted(in_order, searched, side="left")
    return polygons.enumerated(first, np.searchsorted(in_order, searched, side="right"))


def _columns_of(triangles: Floats, solids: Integers, shape: tuple[int, int]) -> _Columns:
    height, width = shape
    sides = np.roll(triangles, -1, axis=1) - triangles
    # each side from its lower end, so that triangles with a common side leave no gap
    is_up = sides[:, :, 1:2] > 0
    low = np.where(is_up, triangles, np.roll(triangles, -1, axis=1)).reshape(-1, 3)
    along = np.where(is_up, sides, -sides).reshape(-1, 3)
    edge, row, share = _rows_crossed(low[:, 1], along[:, 1], height)
    x, z = (low[edge, axis] + share * along[edge, axis] for axis in (0, 2))
    order = np.lexsort((x, row, edge // 3))  # two sides of a triangle cross each row
    (x, x_end), (z, z_end) = (array[order].reshape(-1, 2).T for array in (x, z))
    triangle, row = edge[order[::2]] // 3, row[order[::2]]
    first, last = (np.clip(np.ceil(ends - 0.5), 0, width).astype(np.int64) for ends in (x, x_end))
    line, col = polygons.enumerated(first, last)
    z = z[line] + (col + 0.5 - x[line]) * ((z_end - z) / np.maximum(x_end - x, 1e-12))[line]
    triangle, cell = triangle[line], row[line] * width + col
    turn = np.where(sides[:, 0, 0] * sides[:, 1, 1] > sides[:, 0, 1] * sides[:, 1, 0], -1, 1)
    turn, solid = turn[triangle], solids[triangle]
    normal = np.cross(sides[:, 0], sides[:, 1])
    upper = np.flatnonzero(turn < 0)
    upper = upper[np.lexsort((z[upper], cell[upper]))]
    rise = -normal[triangle[upper], :2] / normal[triangle[upper], 2:]
    upper_fields = cell[upper], z[upper], rise
    order = np.lexsort((z, solid, cell))
    cell, z, turn, solid = cell[order], z[order], turn[order], solid[order]
    lines = np.cumsum((np.diff(cell, prepend=-1) != 0) | (np.diff(solid, prepend=-1) != 0))
    enters, leaves = _winding_runs(lines, turn)
    closed = np.zeros(int(solids.max()) + 1, np.bool_)
    closed[solid[enters]] = True
    found = cell[enters], z[enters], z[leaves], solid[enters], closed
    return _Columns(*found, *upper_fields, shape)


def points_on(triangles: Floats, shape: tuple[int, int]) -> Iterator[tuple[Floats, Integers]]:
    """Yield points half a cell apart on triangles in a map, and the triangle of each."""
    size, number = np.array(shape[::-1]), np.arange(len(triangles))
    while len(triangles):
        low, high = (join(triangles[:, :, :2], axis=1) for join in (np.min, np.max))
        in_map = ((high >= 0) & (low <= size)).all(axis=1)
        triangles, number = triangles[in_map], number[in_map]
        sides = np.roll(triangles, -1, axis=1) - triangles
        lengths = np.sqrt((sides**2).sum(axis=2))
        is_long = lengths.max(axis=1) > _LONGEST
        if not is_long.all():
            for points, small in _points_on_small(triangles[~is_long], lengths[~is_long]):
                yield points, number[~is_long][small]
        a, b, c = triangles[is_long].transpose(1, 0, 2)
        d, e, f = (a + b) / 2, (b + c) / 2, (c + a) / 2
        quarters = [(a, d, f), (d, b, e), (f, e, c), (d, e, f)]
        triangles = np.concatenate([np.stack(corners, axis=1) for corners in quarters])
        number = np.tile(number[is_long], 4)


def _points_on_small(triangles: Floats, lengths: Floats) -> Iterator[tuple[Floats, Integers]]:
    order = (lengths.argmax(axis=1)[:, np.newaxis] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles, order[:, :, np.newaxis], 1).transpose(1, 0, 2)
    base, up = b - a, c - a
    normal = np.cross(base, up)
    doubled = np.sqrt((normal**2).sum(axis=1))
    longest = lengths.max(axis=1)
    rows = np.ceil(doubled / np.maximum(longest, 1e-12) / _SPACING).clip(1).astype(np.int64)
    a = a - normal * (_INWARDS / np.maximum(doubled, 1e-12))[:, np.newaxis]
    cost = np.cumsum(rows * np.ceil(longest / _SPACING + 1))
    parts = np.searchsorted(cost, np.arange(0, cost[-1], _POINTS_AT_ONCE))
    for first, end in zip(parts, [*parts[1:], len(rows)], strict=True):
        whose, row = polygons.enumerated(np.zeros(end - first, np.int64), rows[first:end])
        whose += first
        rise = (row + 0.5) / rows[whose]
        cols = np.ceil(longest[whose] * (1 - rise) / _SPACING).clip(1).astype(np.int64)
        of_row, col = polygons.enumerated(np.zeros(len(cols), np.int64), cols)
        share = (1 - rise)[of_row] * (col + 0.5) / cols[of_row]
        whose, rise = whose[of_row], rise[of_row]
        points = a[whose] + rise[:, np.newaxis] * up[whose] + share[:, np.newaxis] * base[whose]
        yield points, whose
