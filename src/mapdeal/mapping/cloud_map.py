"""Maps for robots from point clouds of whole buildings: the floor, then obstacles on it.

Points are counted in voxels, so memory grows with the scanned surfaces and not with the points.
Thin layers of voxels with room above them become patches of surface, one per tile and level;
patches that a robot could drive between make the floor. Heights of obstacles are relative to the
floor beside them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal import command, records
from mapdeal.errors import MalformedInputError, require
from mapdeal.grid.frame import Figures, Frame, Region, check_resolution
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN, Drawn
from mapdeal.kernels import components, sensing, threads
from mapdeal.kernels.arrays import Floats, Mask
from mapdeal.mapping import voxels as cloud_voxels
from mapdeal.mapping.cloud_evidence import Floor, floor_in, stated_floor
from mapdeal.mapping.cloud_floor import TILE, Limits
from mapdeal.mapping.voxels import FINEST, Claim, Columns, Tilt, Voxels, levelled, upright

Drops = Literal["occupied", "unknown"]
Up = Literal["z", "-z", "y", "-y", "x", "-x"]
DEGREES = command.Unit("degrees", "DEGREES")
_SLOPE = command.Condition("above 0 and below 60", lambda value: 0 < value < 60)
_MOST_FAR = 0.4  # of the points
_SEEDS = 200  # most places of the robot below which the floor is searched
_SLAB = 0.2  # metres of height that beams clear as one
_LOW = 0.4  # metres; everything that moves has points below this height
_SHORTEST = 2.0  # cells: shorter beams clear nothing
_LEVEL = 1e-6
_CELLS_AT_ONCE = 1 << 16  # of a row
_PER_CELL = 80
_PER_SLAB = 24
_PASSES = 10  # clouds whose beams pass a place per cloud with points there, to clear it
_SPARSE = 1.5  # cells between points from which a floor has gaps everywhere
_GAP_OF_SPARSE = 2.5  # times the distance between points: wider is one random gap of 500
_ANY_GAP = 1.8  # times that: wider is one of 10^8
_LONE = 4  # cells
_SHARE_OF_FLOOR = 0.02
_SHARE_OF_NEXT, _DENSE = 0.12, 30  # points
_SHARE_OF_EDGE = 0.1
_ENCLOSED = 5  # occupied neighbours of 8 that make a cell occupied
MARGIN = 2  # cells around the known cells, within the frame
_NEAR_FLOOR, _BINS = 0.15, 300


@records.dataclass(frozen=True, kw_only=True)
class CloudOptions:
    """Options that decide which cells of a cloud are free and which are occupied.

    Parameters
    ----------
    climb : float
        Highest step that the robot drives over, metres; lower points are floor.
    robot_height : float
        Height above the floor up to which points are obstacles, metres.
    max_slope : float
        Steepest ramp that the robot drives on, degrees.
    drops : {'occupied', 'unknown'}
        Value of cells with points below the floor, such as stairs down.
    min_points : int
        Least number of points of an obstacle in a cell and its 8 neighbours.
    fill : float
        Widest gap between seen pieces of floor that becomes free, metres.
    level : bool
        Whether to turn the cloud so that its floor is level, by up to 40 degrees.
    up : {'z', '-z', 'y', '-y', 'x', '-x'}, optional
        Axis of the cloud that points up. By default z, unless the cloud contradicts it.
    floor : float, optional
        Height of a floor that is not in the cloud, metres. Cells without points stay unknown.
    at : tuple of float, optional
        Place on the storey to map, metres; the lowest storey by default.
    """

    climb: Annotated[float, command.ABOVE_0, command.METRES] = 0.05
    robot_height: Annotated[float, command.ABOVE_0, command.METRES] = 1.0
    max_slope: Annotated[float, _SLOPE, DEGREES] = 20.0
    drops: Drops = "occupied"
    min_points: Annotated[int, command.AT_LEAST_1] = 3
    fill: Annotated[float, command.AT_LEAST_0, command.METRES] = 0.15
    level: bool = False
    up: Up | None = None
    floor: Annotated[float | None, command.Words("Z"), command.METRES] = None
    at: Annotated[tuple[float, float, float] | None, command.Words("X,Y,Z")] = None

    def __post_init__(self) -> None:
        for name, parameter in command.parameters_of(CloudOptions).items():
            object.__setattr__(self, name, parameter.accept(getattr(self, name)))
        is_one = self.floor is None or self.at is None
        require(is_one, "cannot be given together with floor", "at", got=self.at)
        rule = f"must be above climb, {self.climb:g}"
        require(self.robot_height > self.climb, rule, "robot_height", got=self.robot_height)


@records.dataclass(frozen=True, eq=False, repr=False)
class CloudMap(Drawn):
    """Map made of a point cloud.

    Parameters
    ----------
    grid : OccupancyGrid
        0 where the floor was seen, 100 where something stands on it, -1 elsewhere.
    layers : dict of str to numpy.ndarray
        ``floor_height`` and ``slope`` (metres, and rise over run; nan where the floor is not
        known), ``obstacle_height`` (of the highest obstacle above the floor, metres; 0 for none),
        ``points`` (in the cell, at any height): float32 and int32 of the shape of the grid.
    points, not_finite, beyond : int
        Number of all points, of points that are not finite, and of points too far away for a map.
    tilt : float
        Angle between the floor and the horizontal, degrees; the cloud was turned by it if
        `CloudOptions.level` asked for that.
    noise : float
        Standard deviation of the points from the floor, metres.
    clearance : float
        Height above the floor from which points are obstacles, metres.
    overlaid_m2 : float
        Area of the map above or below which other storeys lie, square metres.
    storeys : tuple of float
        Heights of these storeys, and of other floors that are not on the map, metres.
    may_be_upside_down : bool
        Whether too much hangs from the ceiling, compared with things on the floor.
    at_sensor : int
        Points that were left out because they are at the sensor or below its least range.
    cleared : int
        Cells whose points were cleared by beams that passed later or more often.
    """

    grid: OccupancyGrid
    layers: dict[str, NDArray[Any]]
    points: int
    not_finite: int
    beyond: int
    tilt: float
    noise: float
    clearance: float
    overlaid_m2: float
    storeys: tuple[float, ...] = ()
    may_be_upside_down: bool = False
    at_sensor: int = 0
    cleared: int = 0

    def figures(self) -> Figures:
        values, area = np.asarray(self.grid.occupancy), self.grid.resolution**2
        states = {"floor": FREE, "obstacle": OCCUPIED, "unknown": UNKNOWN}
        counts = {name: int((values == value).sum()) for name, value in states.items()}
        floor = self.layers["floor_height"][values != UNKNOWN]
        least, most = (float(np.nanmin(floor)), float(np.nanmax(floor))) if floor.size else (0, 0)
        return {
            "points": self.points,
            "not_finite": self.not_finite,
            "beyond": self.beyond,
            "at_sensor": self.at_sensor,
            **{f"{name}_share": round(n / max(values.size, 1), 6) for name, n in counts.items()},
            **{f"{name}_m2": round(n * area, 4) for name, n in counts.items()},
            "floor_height_min": round(least, 4),
            "floor_height_max": round(most, 4),
            "tilt_deg": round(self.tilt, 3),
            "noise": round(self.noise, 4),
            "clearance": round(self.clearance, 4),
            "overlaid_m2": round(self.overlaid_m2, 4),
            "storeys": [round(height, 3) for height in self.storeys],
            "cleared": self.cleared,
        }

    def _repr_parts(self) -> Iterator[str]:
        yield repr(self.grid)
        yield f"{self.points} points, noise {self.noise:.3g} m"


@records.dataclass(frozen=True, eq=False)
class CellContents:
    """Counts and heights of points in the cells of a frame, relative to the floor."""

    frame: Frame
    floor: NDArray[np.float32]
    slope: NDArray[np.float32]
    on_floor: NDArray[np.int32]
    below: NDArray[np.int32]
    points: NDArray[np.int32]
    obstacles: NDArray[np.int32]  # by slab of height, (S, H, W)
    highest: NDArray[np.float32]  # by slab of height, (S, H, W)
    clearance: float
    noise: float
    column: float  # points in one cell of a thinned wall; inf for dense clouds
    level: Floor  # that the heights are relative to


class CloudMapper:
    """Builder of a map from a point cloud that is added in parts.

    Parameters
    ----------
    options : CloudOptions, optional
        Options of the map.
    resolution : float, optional
        Side of a cell, metres; by default 0.05, or the distance between points if that is larger.
    frame : Frame, optional
        Cells of the map, without a yaw; by default the box of known cells.
    claim : callable, optional
        Called with the bytes of each large allocation and a description; it may raise an error.
    """

    def __init__(
        self,
        options: CloudOptions | None = None,
        *,
        resolution: float | None = None,
        frame: Frame | None = None,
        claim: Claim | None = None,
    ) -> None:
        require(frame is None or isinstance(frame, Frame), "must be a Frame", "frame", got=frame)
        resolution = None if resolution is None else check_resolution(resolution)
        self.options = options or CloudOptions()
        self._frame, self._claim = frame, claim or (lambda *_: None)
        self._may_choose = resolution is None and frame is None
        cell = (resolution or FINEST) if frame is None else frame.resolution
        corner = None if frame is None else frame.origin[:2]
        step = min(max(self.options.climb / 4, 0.01), 0.05)
        self._voxels = Voxels(cell, step, corner, claim)
        self._contents: CellContents | None = None
        self._places: list[Floats] = []
        self._scans: NDArray[np.int32] | None = None  # hits and passes by slab
        self._level: Floats | None = None  # unit vector that points up
        self.at_sensor = 0

    def turn(self, tilt: Tilt) -> None:
        """Level all points added from now on by a known tilt."""
        self._level = tilt.up()

    def _upright(self, points: Floats) -> Floats:
        turned = upright(points, self.options.up)
        return turned if self._level is None else levelled(turned, self._level)

    def add_place(self, place: ArrayLike | None) -> None:
        """Add a position of the sensor, shape (3,), below which the floor is."""
        if place is not None:
            self._places.append(self._upright(np.array(place, np.float64)[np.newaxis])[0])

    def add(self, points: ArrayLike) -> None:
        """Add points, shape (N, 3), metres."""
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] < 3:
            raise MalformedInputError("the cloud has no heights: points need x, y and z")
        away = cloud_voxels.away_from_sensor(points[:, :3])
        self.at_sensor += len(points) - len(away)
        self._voxels.add(self._upright(away))

    def settle(self, *, follows_beams: bool = False) -> CellContents:
        """Return the floor and the obstacles; afterwards no points can be added.

        Parameters
        ----------
        follows_beams : bool
            Whether `clear` will be called, which takes more memory.
        """
        if self._contents is not None:
            return self._contents
        voxels, options = self._voxels, self.options
        columns = voxels.columns()
        bad, far = voxels.not_finite, voxels.beyond
        if far > _MOST_FAR * (voxels.points - bad):
            rule = f"{far} of {voxels.points} points are far apart"
            hint = "are its coordinates in millimetres? they must be metres"
            raise MalformedInputError(rule, hint=hint)
        if columns is None:
            rule = "holds no points" if not voxels.points else "holds no points that are finite"
            raise MalformedInputError(rule)
        cloud_voxels.check_extent(columns)
        if self._may_choose:
            columns = cloud_voxels.fitting(columns)
        # a voxel filter puts heights, and so the floor, on steps
        steps = cloud_voxels.steps_of(columns)
        limits = Limits(options.climb, options.robot_height, options.max_slope, steps)
        tile = max(3, round(TILE / columns.cell))
        corner = np.array([*columns.corner, 0.0])
        if options.floor is not None:
            floor = stated_floor(columns, tile, options.floor, self._claim)
        else:
            if options.up is None:
                cloud_voxels.check_upright(columns)
            chosen = self._places[:: max(1, len(self._places) // _SEEDS)]
            places = np.reshape(chosen, (-1, 3)) - corner
            at = None if options.at is None else np.array(options.at) - corner
            floor = floor_in(columns, tile, limits, places, at, self._claim)
        self._contents = self._measure(columns, floor, limits, follows_beams=follows_beams)
        return self._contents

    def _measure(
        self, columns: Columns, floor_found: Floor, limits: Limits, *, follows_beams: bool
    ) -> CellContents:
        options, cell = self.options, columns.cell
        tiles, gap = floor_found.tiles, limits.gap
        if self._frame is None:
            row, col, last_row, last_col = tiles.box()
            row, col = max(row, int(columns.row.min())), max(col, int(columns.col.min()))
            last_row = min(last_row, int(columns.row.max()) + 1)
            last_col = min(last_col, int(columns.col.max()) + 1)
            lattice = Frame(1, 1, cell, (*columns.corner.tolist(), 0.0))
            frame = Region(row, col, last_row - row, last_col - col).frame_in(lattice)
        else:
            row = col = 0
            frame = self._frame
        height, width = frame.shape
        slabs = max(1, math.ceil((options.robot_height - gap) / _SLAB)) if follows_beams else 1
        self._claim((_PER_CELL + _PER_SLAB * slabs) * height * width, f"{width} x {height} cells")
        rows, cols = columns.row - row, columns.col - col
        inside = (rows >= 0) & (cols >= 0) & (rows < height) & (cols < width)
        flat = np.where(inside, rows * width + cols, 0)
        surface = np.empty((height, width))
        slope = np.empty((height, width), np.float32)
        all_cols = np.arange(col, col + width)

        def fill(part: slice) -> None:
            band = np.arange(part.start + row, part.stop + row)[:, np.newaxis]
            for first in range(0, width, _CELLS_AT_ONCE):  # rows may be very long
                at = part, slice(first, first + _CELLS_AT_ONCE)
                band_cols = all_cols[at[1]]
                surface[at] = tiles.heights(band, band_cols, options.climb)
                slope[at] = tiles.slopes(band, band_cols)

        threads.for_rows(fill, (height, width))
        floor, out = surface.ravel()[flat], np.flatnonzero(~inside)
        floor[out] = tiles.heights(columns.row[out], columns.col[out], options.climb)
        upper = tiles.uppers(columns.row, columns.col)
        whose = columns.of_voxels()
        at_ledge = np.flatnonzero(np.isfinite(upper)[whose])
        owners, counts = whose[at_ledge], columns.counts[at_ledge]
        heights = columns.heights[at_ledge]
        near = (np.abs(heights - level[owners]) <= options.climb for level in (upper, floor))
        on_top, on_foot = (np.bincount(owners, counts * is_near, len(floor)) for is_near in near)
        # in a cell with both, at the edge, points on top stand on the lower floor
        is_upper = (on_top > 0) & (on_foot <= _SHARE_OF_EDGE * on_top)
        floor[is_upper] = upper[is_upper]
        known = inside & np.isfinite(floor)
        surface.ravel()[flat[known]] = floor[known]
        noise = 0.0 if floor_found.is_stated else _noise(columns, floor, options.robot_height)
        half = limits.steps / 2 if limits.steps > 1.5 * self._voxels.step else 0.0  # of a voxel
        clear = max(gap, 3 * noise)
        apart = cell if self._may_choose and cell > FINEST else limits.steps if half else 0.0
        column = (options.robot_height + half - clear) // apart if apart else math.inf
        tall = (options.robot_height - clear) / slabs
        on_floor, below, points = np.zeros((3, height, width), np.int32)
        obstacles = np.zeros((slabs, height, width), np.int32)
        highest = np.zeros(obstacles.shape, np.float32)
        for which, part in columns.parts():
            heights, is_in_map = part.above(floor[which]), inside[which]
            cells = flat[which][is_in_map]
            for layer, counted in (
                (on_floor, part.counts * (np.abs(heights) <= clear)),
                (below, part.counts * (heights < -clear)),
                (points, part.counts),
            ):
                layer.ravel()[cells] = np.add.reduceat(counted, part.starts)[is_in_map]
            is_high = (heights > clear) & (heights <= options.robot_height + half)
            stands = np.flatnonzero(is_high & np.repeat(is_in_map, part.lengths()))
            above = heights[stands]
            slab = np.minimum(((above - clear) / tall).astype(np.int64), slabs - 1)
            at = slab * (height * width) + flat[which][part.of_voxels()[stands]]
            np.add.at(obstacles.ravel(), at, part.counts[stands])
            highest.ravel()[at] = above  # the last, and so the highest voxel of a column stays
        return CellContents(
            frame, surface.astype(np.float32), slope, on_floor, below, points,
            obstacles, highest, clear, noise, column, floor_found,
        )  # fmt: skip

    def clear(self, points: ArrayLike, place: ArrayLike) -> None:
        """Record which cells the beams of one cloud passed.

        Parameters
        ----------
        points : array_like of float, shape (N, 3)
            Points that have been added, metres.
        place : array_like of float, shape (3,)
            Position of the sensor, metres.
        """
        contents = self.settle(follows_beams=True)
        ends = self._upright(np.asarray(points, dtype=np.float64)[:, :3])
        start = self._upright(np.array(place, np.float64)[np.newaxis])[0]
        frame, cell = contents.frame, contents.frame.resolution
        corner = np.array(frame.origin[:2])
        ends = ends[np.isfinite(ends).all(axis=1)]
        begin = ((start[:2] - corner) / cell)[::-1]
        at = ((ends[:, :2] - corner) / cell)[:, ::-1]
        shape = np.array(frame.shape)
        cells, here = np.floor(at).astype(np.int64), np.floor(begin).astype(np.int64)
        inside = ((cells >= 0) & (cells < shape)).all(axis=1)
        if not ((here >= 0) & (here < shape)).all():
            return
        at, cells, z = at[inside], cells[inside], ends[inside, 2]
        # heights above the floor along a beam are interpolated between its ends
        z0 = float(start[2] - contents.floor[here[0], here[1]])
        z1 = z - contents.floor[cells[:, 0], cells[:, 1]]
        along = at - begin
        length = np.hypot(along[:, 0], along[:, 1])
        useful = np.isfinite(z1) & (length > _SHORTEST)
        if not math.isfinite(z0) or not useful.any():
            return
        along, cells, z1, length = along[useful], cells[useful], z1[useful], length[useful]
        low = np.minimum(cells.min(axis=0), here)
        window = np.maximum(cells.max(axis=0), here) + 1 - low
        if self._scans is None:
            self._scans = np.zeros((2, *contents.obstacles.shape), np.int32)
        rows, cols = (slice(low[k], low[k] + window[k]) for k in (0, 1))
        tall = (self.options.robot_height - contents.clearance) / len(contents.obstacles)
        stop = 1.0 - (1.5 + 2 * contents.noise / cell) / length
        rise = np.where(np.abs(z1 - z0) < _LEVEL, _LEVEL, z1 - z0)
        for slab, (hits, misses) in enumerate(zip(*self._scans, strict=True)):
            bottom = contents.clearance + slab * tall
            is_hit = np.zeros(window, np.bool_)
            inside = (z1 > bottom) & (z1 <= bottom + tall)
            is_hit[tuple((cells[inside] - low).T)] = True
            at_bottom, at_top = (bottom - z0) / rise, (bottom + tall - z0) / rise
            enter = np.maximum(np.minimum(at_bottom, at_top), 0.0)
            leave = np.minimum(np.maximum(at_bottom, at_top), stop)
            passes = np.flatnonzero(leave > enter)
            first, last = (
                np.floor(begin + along[passes] * share[passes, np.newaxis]).astype(np.int64) - low
                for share in (enter, leave)
            )
            nothing, passed = np.zeros((2, *window), np.int32)
            sensing.count_rays(first, last, np.zeros(len(passes), np.bool_), nothing, passed)
            hits[rows, cols] += is_hit
            misses[rows, cols] += (passed > 0) & ~is_hit

    def result(self) -> CloudMap:
        """Return the map.

        Raises
        ------
        MalformedInputError
            If the cloud is empty or has no floor.
        """
        contents, options, voxels = self.settle(), self.options, self._voxels
        up = None if self._level is None else float(self._level[2])
        tilt = contents.level.tilt if up is None else math.acos(min(1.0, up))
        counts = contents.obstacles.sum(axis=0, dtype=np.int32)
        highest, cleared = contents.highest.max(axis=0), 0
        passed = np.zeros(contents.frame.shape, np.bool_)
        if self._scans is not None:
            hits, misses = self._scans
            # moving things stand on the floor; beams pass below tables, which must stay
            low = max(1, round(_LOW / _SLAB))
            is_remaining = (misses <= _PASSES * hits) | (hits[:low] == 0).all(axis=0)
            remaining = np.where(is_remaining, contents.obstacles, 0).sum(axis=0, dtype=np.int32)
            cleared = int(((remaining == 0) & (counts > 0)).sum())
            counts, highest = remaining, np.where(is_remaining, contents.highest, 0).max(axis=0)
            passed = misses.sum(axis=0) >= options.min_points
        occupied, floor = _states(contents, counts, passed, options)
        values = np.full(contents.frame.shape, UNKNOWN, np.int8)
        values[floor], values[occupied] = FREE, OCCUPIED
        known = values != UNKNOWN
        box = box_of(known) if self._frame is None else Region(0, 0, *contents.frame.shape)
        part, frame = box.shared_with(contents.frame.shape), box.frame_in(contents.frame)
        grid = OccupancyGrid(values[part].copy(), frame.resolution, frame.origin)
        layers = {
            "floor_height": np.where(known, contents.floor, np.nan).astype(np.float32),
            "obstacle_height": np.where(occupied, highest, 0).astype(np.float32),
            "slope": np.where(known, contents.slope, np.nan).astype(np.float32),
            "points": contents.points,
        }
        layers = {name: layer[part].copy() for name, layer in layers.items()}
        return CloudMap(
            grid, layers, voxels.points + self.at_sensor, voxels.not_finite, voxels.beyond,
            math.degrees(tilt), contents.noise, contents.clearance, contents.level.overlaid_m2,
            contents.level.storeys, contents.level.may_be_ceiling and options.up is None,
            self.at_sensor, cleared,
        )  # fmt: skip


def _states(
    contents: CellContents, counts: NDArray[np.int32], passed: Mask, options: CloudOptions
) -> tuple[Mask, Mask]:
    on_floor = contents.on_floor
    occupied = (counts > 0) & (_around(counts) >= min(options.min_points, contents.column))
    # excludes the tails of the noise of the floor, and of a wall in the next cell
    occupied &= counts >= _SHARE_OF_FLOOR * on_floor
    most = _around(counts, np.maximum)
    occupied &= (counts >= _SHARE_OF_NEXT * most) | (most < _DENSE)
    _drop_lone(occupied, counts, on_floor, 3 * options.min_points, contents.column)
    enclosed = _around(occupied.astype(np.int32)) >= _ENCLOSED
    # an aisle may be one wide cell
    occupied |= enclosed & ((on_floor == 0) | (contents.frame.resolution < TILE))
    floor = (on_floor > 0) & ~occupied
    lower = (contents.below > 0) & (on_floor == 0) & ~occupied
    lower &= _around(contents.below) >= options.min_points
    _drop_lone(lower, contents.below, on_floor, 3 * options.min_points, math.inf)
    gap = math.floor(min(options.fill / contents.frame.resolution + 1e-6, max(floor.shape)))
    if contents.level.is_above_others:  # the storey below shows through gaps between points
        lower &= ~_closed(floor, max(gap, math.ceil(_ANY_GAP * _random_gap_cells(contents))))
    if options.drops == "occupied":
        occupied |= lower | (ledges(contents.floor, floor, contents.clearance) & floor)
        floor &= ~occupied
    may_be_floor = ~lower & ~occupied & np.isfinite(contents.floor)
    for wide, mask in ((gap, may_be_floor), (3 * gap, passed & may_be_floor)):
        if wide and mask.any():
            floor |= _closed(floor, wide) & mask
    if contents.level.is_stated:
        floor |= passed & may_be_floor
    elif contents.level.spacing > _SPARSE * contents.frame.resolution:
        wide = math.ceil(_random_gap_cells(contents))
        beside = _around(occupied.astype(np.int32)) > 0  # their points may be feet of walls
        between = components.labelled(_closed(floor | occupied, wide) & may_be_floor, corners=False)
        floor |= between.cells_of(between.touched_by(floor & ~beside))
    return occupied, floor


def _random_gap_cells(contents: CellContents) -> float:
    return _GAP_OF_SPARSE * contents.level.spacing / contents.frame.resolution


def _drop_lone(
    occupied: Mask, counts: NDArray[np.int32], on_floor: NDArray[np.int32], least: int, most: float
) -> None:
    """Remove, in place, groups of few cells with far fewer points than the floor around them."""
    is_inner = occupied & (_around(occupied.astype(np.int32)) > _LONE)
    loose = occupied & ~is_inner
    if not loose.any():
        return
    cells, whose = components.touching_groups(loose)
    at = tuple(cells.T)
    lone = np.bincount(whose, 1 + _LONE * _around(is_inner.astype(np.int32))[at]) <= _LONE
    point_count = np.bincount(whose, counts[at])
    around = np.bincount(whose, _around(on_floor)[at] / 9)
    occupied[at] = ~(lone & (point_count < np.maximum(least, around).clip(max=most)))[whose]


def _around(counts: NDArray[np.int32], join: np.ufunc = np.add) -> NDArray[np.int32]:
    """Reduce each cell and its 8 neighbours with a ufunc, by default to their sum."""
    padded = np.pad(counts, 1)
    rows = join(join(padded[:-2], padded[1:-1]), padded[2:])
    return np.asarray(join(join(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:]))


def _closed(marked: Mask, wide: int) -> Mask:
    sides = [min(wide, side) for side in marked.shape]  # wider ones cover no more of the map
    found = np.pad(marked, [(side, side) for side in sides])
    for join in (np.logical_or, np.logical_and):
        for side in sides:
            joined = 1
            while joined <= side:
                step = min(joined, side + 1 - joined)
                found = join(found[:-step], found[step:])
                joined += step
            found = found.T
    return found


def ledges(floor: NDArray[np.float32], is_floor: Mask, climb: float) -> Mask:
    """Return the cells of the floor beside a drop of more than a robot climbs."""
    found = np.zeros(floor.shape, np.bool_)
    for z, known, marked in ((floor, is_floor, found), (floor.T, is_floor.T, found.T)):
        step, both = np.diff(z, axis=0), known[:-1] & known[1:]
        with np.errstate(invalid="ignore"):
            marked[:-1] |= both & (step < -climb)
            marked[1:] |= both & (step > climb)
    return found


def box_of(known: Mask) -> Region:
    in_rows, in_cols = (np.asarray(known.any(axis=axis)) for axis in (1, 0))
    region = Region.spanning(in_rows, in_cols, grow=MARGIN)
    if region is None:
        raise MalformedInputError("no floor found: nothing is known of any cell")
    return region


def _noise(columns: Columns, floor: Floats, robot_height: float) -> float:
    found = np.zeros(_BINS + 1)
    for which, part in columns.parts():
        heights = part.above(floor[which])
        away = np.abs(heights)
        stands = (heights > _NEAR_FLOOR) & (heights <= robot_height)  # their feet are no floor
        is_open = ~np.logical_or.reduceat(stands, part.starts)
        near = np.flatnonzero((away < _NEAR_FLOOR) & np.repeat(is_open, part.lengths()))
        bins = (away[near] * (_BINS / _NEAR_FLOOR)).astype(np.int64)
        found += np.bincount(bins, part.counts[near], len(found))
    if not found.any():
        return 0.0
    below = np.cumsum(found)
    median = float(np.searchsorted(below, below[-1] / 2) + 0.5) * _NEAR_FLOOR / _BINS
    return median * 1.4826  # of a normal distribution


def cloud_map(
    points: ArrayLike,
    *,
    resolution: float | None = None,
    frame: Frame | None = None,
    **options: Any,
) -> CloudMap:
    """Make a map for robots from a point cloud.

    Parameters
    ----------
    points : array_like of float, shape (N, 3)
        x, y and z, metres, with z up.
    resolution : float, optional
        Side of a cell, metres; by default 0.05, or the distance between points if that is larger.
    frame : Frame, optional
        Cells of the map, without a yaw; by default the box of known cells.
    **options
        Fields of `CloudOptions`.

    Returns
    -------
    CloudMap
        The map, with the heights of the floor and of obstacles.

    Raises
    ------
    ParameterError
        If an option is not allowed.
    MalformedInputError
        If the points lack heights, are infinite or nan, or show no floor.
    """
    settings = CloudOptions(**options)
    points = np.asarray(points, dtype=np.float64)
    mapper = CloudMapper(settings, resolution=resolution, frame=frame)
    if settings.level and points.ndim == 2 and points.shape[1] >= 3:
        tilt = Tilt()
        tilt.add(upright(points[:, :3], settings.up))
        mapper.turn(tilt)
    mapper.add(points)
    return mapper.result()
