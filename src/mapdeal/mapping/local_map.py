"""Maps around a robot, from point clouds and a global map."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mapdeal.command import AT_LEAST_0, METRES, RADIANS, Words, parameters_of
from mapdeal.errors import ParameterError, require
from mapdeal.grid import canvas, frame as frames, values as map_values
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels import engine, polygons
from mapdeal.kernels.arrays import Floats, Integers, Integers32, Mask, SignedBytes
from mapdeal.kernels.sensing import Odds, mark_cloud, weigh_rays
from mapdeal.mapping.transforms import CoveredAngles, Pose, check_pose, wrapped
from mapdeal.records import dataclass, replace

Unknown = Literal["keep", "free"]
_FARTHEST_KEY = 1 << 31
"""In cells: of cells that are nearer, row and column together are one number of 64 bits."""


@dataclass(frozen=True)
class LocalOptions:
    """Options for making a local map from point clouds.

    Parameters
    ----------
    frame : {'robot', 'map'}
        Frame of the cloud's coordinates: the robot's, with x ahead and y to the left, or the map's.
    offset : tuple of float
        x and y to subtract from the points' coordinates in the map frame, metres.
    size : tuple of float
        Extent of the map along x and y, rounded up to whole cells, metres.
    resolution : float
        Side of a cell, metres.
    min_height : float, optional
        Lowest z of the points to use, in the cloud's own coordinates, metres.
    max_height : float, optional
        Highest z of the points to use, metres.
    min_range : float, optional
        Smallest horizontal distance from the robot of the points to use, metres.
    max_range : float, optional
        Largest horizontal distance from the robot of the points to use, metres.
    angle_min : float, optional
        First direction of the points to use, radians from the robot's heading, anticlockwise; needs
        `angle_max`.
    angle_max : float, optional
        Last direction of the points to use, anticlockwise from `angle_min`, radians; below it, the
        fan includes the robot's back.
    raytrace_range : float, optional
        Distance from the robot up to which beams clear cells, metres. [default: `max_range`, else
        up to the point]
    unknown : {'keep', 'free'}
        Whether cells that nothing has seen stay unknown or become free. Without a global map,
        `local_map` and `LocalMapper` always make them free.

    Raises
    ------
    ParameterError
        If a number is not finite or has the wrong sign, or a minimum exceeds its maximum.
    """

    frame: frames.CloudFrame = "robot"
    offset: Annotated[frames.Point, Words("DX,DY")] = (0.0, 0.0)
    size: Annotated[frames.Point, Words("WX,WY")] = (20.0, 20.0)
    resolution: Annotated[float, Words("R")] = 0.05
    min_height: Annotated[float | None, METRES] = None
    max_height: Annotated[float | None, METRES] = None
    min_range: Annotated[float | None, AT_LEAST_0, METRES] = None
    max_range: Annotated[float | None, AT_LEAST_0, METRES] = None
    angle_min: Annotated[float | None, RADIANS] = None
    angle_max: Annotated[float | None, RADIANS] = None
    raytrace_range: Annotated[float | None, AT_LEAST_0, METRES] = None
    unknown: Unknown = "keep"

    def __post_init__(self) -> None:
        for name, parameter in parameters_of(LocalOptions).items():
            object.__setattr__(self, name, parameter.accept(getattr(self, name)))
        object.__setattr__(self, "offset", frames.check_point(self.offset, "offset"))
        object.__setattr__(self, "size", frames.check_point(self.size, "size"))
        object.__setattr__(self, "resolution", frames.check_resolution(self.resolution))
        for least, most in (("min_height", "max_height"), ("min_range", "max_range")):
            low, high = getattr(self, least), getattr(self, most)
            if low is not None and high is not None and low > high:
                raise ParameterError(f"must not be above {most}, {high:g}", place=least, got=low)
        angles = {self.angle_min, self.angle_max}
        if angles != {None} and (None in angles or len(angles) == 1):
            raise ParameterError("must both be given, and differ", place="angle_min, angle_max")

    @property
    def asks_for_heights(self) -> bool:
        """Whether heights are limited, so that points need a z coordinate."""
        return self.min_height is not None or self.max_height is not None

    @property
    def reach(self) -> float | None:
        """Distance from the robot up to which beams clear cells, metres; None if unlimited."""
        return self.max_range if self.raytrace_range is None else self.raytrace_range


@dataclass(frozen=True)
class CloudCounts:
    """Number of points of a cloud by outcome; a point counts only for the first that applies."""

    points: int = 0
    not_finite: int = 0
    beyond_height: int = 0
    beyond_range: int = 0
    outside: int = 0
    marking: int = 0
    beyond_angle: int = 0


class SeenCloud:
    """The cells of a cloud whose points come some at a time."""

    def __init__(
        self, pose: Pose, options: LocalOptions, lattice: frames.Frame, window: frames.Region, *,
        with_beams: bool,
    ) -> None:  # fmt: skip
        self._pose, self._options, self._lattice = pose, options, lattice
        self._frame = window.frame_in(lattice)
        self._with_beams = with_beams
        self._counts = np.zeros(6, dtype=np.int64)
        self.angles = CoveredAngles()
        self._beyond_angle = 0
        self._marks, self._ends = np.zeros((2, 0), dtype=np.int64)
        self.is_hit = np.zeros(self._frame.shape, dtype=np.bool_)

    def add(self, points: ArrayLike) -> None:
        points = np.asarray(points, dtype=np.float64)
        is_wide = points.ndim == 2 and points.shape[1] >= 2
        require(is_wide, "must be an array of shape (N, 2) or wider", "points", got=points.shape)
        if self._options.asks_for_heights and points.shape[1] < 3:
            raise ParameterError("the cloud has no heights", place="min_height, max_height")
        points = self._in_fan(points)
        if engine.engine_name() == "compiled" and not self._with_beams:
            is_placed = self._options.frame == "map"
            counts, from_robot = mark_cloud(points, self._rule(), self.is_hit, is_placed=is_placed)
            self.angles.add(np.arctan2(from_robot[:, 1], from_robot[:, 0]))
            self._counts += counts
            return
        count = len(points)
        finite = np.isfinite(points[:, :3]).all(axis=1)
        points = points[finite] if not finite.all() else points
        not_finite = count - len(points)
        if self._options.asks_for_heights:
            least, most = self._options.min_height, self._options.max_height
            points = points[_between(points[:, 2], least, most)]
        beyond_height = count - not_finite - len(points)
        with np.errstate(over="ignore", invalid="ignore"):  # of points at 1e300
            from_robot, placed = self._from_robot(points[:, :2])
            distance = np.hypot(from_robot[:, 0], from_robot[:, 1])
        near = _between(distance, self._options.min_range, self._options.max_range)
        if self._with_beams:
            self._add_beams(placed, distance, near)
        beyond_range = int(len(near) - np.count_nonzero(near))
        from_robot, placed = from_robot[near], placed[near]
        away = (distance[near] > 0) & np.isfinite(distance[near])
        self.angles.add(np.arctan2(from_robot[away, 1], from_robot[away, 0]))
        cells, inside = self._frame.bounded_rowcol_from_xy(placed)
        cells = cells[inside]
        self.is_hit[cells[:, 0], cells[:, 1]] = True
        outside = len(placed) - len(cells)
        self._counts += (count, not_finite, beyond_height, beyond_range, outside, len(cells))

    def _in_fan(self, points: Floats) -> Floats:
        """Return the points within the angles, and all points that are not finite."""
        first, last = self._options.angle_min, self._options.angle_max
        if first is None or last is None:
            return points
        with np.errstate(over="ignore", invalid="ignore"):
            from_robot, _ = self._from_robot(points[:, :2])
            angles = np.arctan2(from_robot[:, 1], from_robot[:, 0])
            behind = (angles - first + frames.ROUNDING) % (2 * math.pi)
        width = last - first if last > first else last - first + 2 * math.pi
        is_beyond = behind > width + 2 * frames.ROUNDING
        self._beyond_angle += int(np.count_nonzero(is_beyond))
        return points[~is_beyond]

    @property
    def counts(self) -> CloudCounts:
        counts, count = CloudCounts(*self._counts.tolist()), self._beyond_angle
        return replace(counts, points=counts.points + count, beyond_angle=count)

    def cells(self) -> tuple[Integers, Integers, Integers]:
        """Return the cell of the sensor, those in which beams end, and those with a point."""
        sensor = self._lattice.unbounded_rowcol_from_xy(self._sensor_xy())[0]
        return sensor, _cells_from(self._ends), _cells_from(self._marks)

    def _rule(self) -> tuple[float, ...]:
        """Return how points become cells, in the order of `_clouds.mark`."""
        options, frame = self._options, self._frame
        x, y, yaw = self._pose
        turn = -yaw if options.frame == "map" else yaw
        corner_x, corner_y, frame_yaw = frame.origin
        lows = options.min_height, options.min_range
        highs = options.max_height, options.max_range
        min_height, min_range = (-math.inf if low is None else low for low in lows)
        max_height, max_range = (math.inf if high is None else high for high in highs)
        return (
            x, y, math.cos(turn), math.sin(turn), *options.offset,
            min_height, max_height, min_range, max_range,
            corner_x, corner_y, math.cos(-frame_yaw), math.sin(-frame_yaw), frame.resolution,
            frames.FARTHEST, frames.ROUNDING, frames.CELL_TOLERANCE,
        )  # fmt: skip

    def _from_robot(self, points_xy: Floats) -> tuple[Floats, Floats]:
        here, yaw, offset = np.array(self._pose[:2]), self._pose[2], np.array(self._options.offset)
        if self._options.frame == "map":
            placed = points_xy - offset
            return frames.turned(placed - here, -yaw), placed
        return points_xy, frames.turned(points_xy, yaw) + here - offset

    def _sensor_xy(self) -> Floats:
        here = np.array([self._pose[:2]])
        return here if self._options.frame == "map" else here - np.array(self._options.offset)

    def _add_beams(self, placed: Floats, distance: Floats, near: Mask) -> None:
        """Collect the cells with a point, and the cells in which beams end or stop clearing."""
        useful = _between(distance, self._options.min_range, None) & np.isfinite(distance)
        useful &= _both(np.abs(placed) <= frames.FARTHEST)
        placed, distance = placed[useful], distance[useful]
        keys, is_kept = self._keys_of(placed)
        marks = ends = np.unique(keys[near[useful] & is_kept])
        reach = self._options.reach
        clears = np.ones(len(keys), np.bool_) if reach is None else distance <= reach
        if not (clears & near[useful])[is_kept].all():
            ends = np.unique(keys[clears & is_kept])
        if reach is not None and not clears.all():
            sensor, share = self._sensor_xy(), reach / distance[~clears]
            shortened = sensor + (placed[~clears] - sensor) * share[:, np.newaxis]
            keys, is_kept = self._keys_of(shortened)
            ends = _union(ends, np.unique(keys[is_kept]))
        self._marks, self._ends = _union(self._marks, marks), _union(self._ends, ends)

    def _keys_of(self, placed: Floats) -> tuple[Integers, Mask]:
        cells = self._lattice.unbounded_rowcol_from_xy(placed)
        return cells[:, 0] * (2 * _FARTHEST_KEY) + cells[:, 1], _both(np.abs(cells) < _FARTHEST_KEY)


def _both(pairs: Mask) -> Mask:
    """Return where both of a pair are set: faster than `all` along short rows."""
    return pairs[:, 0] & pairs[:, 1]


def _union(first: Integers, second: Integers) -> Integers:
    return np.union1d(first, second) if len(first) else second


def _cells_from(keys: Integers) -> Integers:
    rows = (keys + _FARTHEST_KEY) // (2 * _FARTHEST_KEY)
    return np.stack([rows, keys - rows * (2 * _FARTHEST_KEY)], axis=1)


def _between(values: Floats, least: float | None, most: float | None) -> Mask:
    within = np.ones(len(values), dtype=np.bool_)
    if least is not None:
        within &= values >= least
    if most is not None:
        within &= values <= most
    return within


@dataclass(frozen=True, eq=False, repr=False)
class LocalMap(map_values.Drawn):
    """Map of a robot's surroundings, with figures about its points.

    Parameters
    ----------
    grid : OccupancyGrid
        100 where there is a point or an obstacle of the global map; elsewhere 0, or -1 where
        unknown cells are kept and nothing has been seen; axes along x and y of the map frame.
    pose : tuple of float
        x, y (metres) and yaw (radians) of the robot in the map frame, -pi < yaw <= pi.
    counts : CloudCounts
        Number of points used, and of points left out by reason.
    from_map : int
        Number of cells covered by obstacles of the global map.
    angles : tuple of float, optional
        First and last direction of the points within the limits, anticlockwise from the robot's
        heading, radians: -pi < first <= pi, first <= last < first + 2 pi. Unset without points.
    clouds : int
        Number of clouds in the map; `counts` and `angles` are those of the last one.
    from_earlier : int
        Number of obstacle cells that come from a cloud before the last one.
    """

    grid: OccupancyGrid
    pose: Pose
    counts: CloudCounts
    from_map: int
    angles: tuple[float, float] | None
    clouds: int = 1
    from_earlier: int = 0

    def _repr_parts(self) -> Iterator[str]:
        yield repr(self.grid)
        yield f"pose {map_values.numbers_text(self.pose)}"
        points = map_values.count_text(self.counts.points, "point")
        yield f"{self.counts.marking} of {points} are obstacles"
        if self.clouds > 1:
            yield f"{self.clouds} clouds"

    @property
    def rear_heading(self) -> float:
        """Direction of the robot's back in the map frame, -pi < rear_heading <= pi, radians."""
        return wrapped(self.pose[2] - math.pi)


class Sightings:
    """Cells of a lattice in which clouds leave obstacles, and through which beams clear."""

    # The last cloud with a beam in a cell decides: an end makes it an obstacle, a passing beam
    # free, and both an obstacle, as costmap_2d clears before it marks. So each cell stores one
    # number: the cloud, and its evidence.

    def __init__(self, region: frames.Region, keep: int | None = None) -> None:
        self._region, self._keep, self._count = region, keep, 0
        # 2 k if the k-th cloud was the last with evidence, 2 k + 1 if that was an obstacle
        self._words = np.zeros((region.height, region.width), dtype=np.int32)

    def move(self, region: frames.Region) -> None:
        """Remember the cells of another region from now on; those of both are kept."""
        # As costmap_2d's ``updateOrigin``: the origin moves by whole cells, so that none blurs.
        rows, cols = self._place_of(region).shared_with(self._words.shape)
        if rows.stop - rows.start < region.height or cols.stop - cols.start < region.width:
            self._region, self._words = region, self._words_in(region)

    def skip(self) -> None:
        self._count += 1

    def add(self, sensor: Integers, ends: Integers, marks: Integers) -> None:
        self._count += 1
        corner = np.array(self._region[:2])
        start, ends = sensor - corner, ends - corner
        if (np.abs(start) <= polygons.FARTHEST_CELL).all():
            ends = ends[(np.abs(ends) <= polygons.FARTHEST_CELL).all(axis=1)]
            # the increment reaches the upper bound from any value, so each cell becomes `word`
            word = Odds(2 * self._count, 1, 0, 2 * self._count)
            is_hit, touched = np.zeros(len(ends), np.bool_), np.zeros(self._words.shape, np.uint8)
            weigh_rays(np.broadcast_to(start, ends.shape), ends, is_hit, word, self._words, touched)
        marks = marks[self._region.holds(marks)] - corner
        self._words[marks[:, 0], marks[:, 1]] = 2 * self._count + 1

    def evidence(self, region: frames.Region) -> SignedBytes:
        """Return the occupancy of a region by the remembered clouds: -1, 0 or 100."""
        words = self._words_in(region)
        values = np.full(words.shape, map_values.UNKNOWN, dtype=np.int8)
        counts = words >= 2 * self._oldest
        values[counts & (words % 2 == 0)] = map_values.FREE
        values[counts & (words % 2 == 1)] = map_values.OCCUPIED
        return values

    def count_earlier(self, region: frames.Region) -> int:
        """Return how many cells of a region are obstacles by a cloud before the newest."""
        words = self._words_in(region)
        earlier = (words >= 2 * self._oldest) & (words < 2 * self._count) & (words % 2 == 1)
        return int(np.count_nonzero(earlier))

    @property
    def _oldest(self) -> int:
        return 1 if self._keep is None else max(1, self._count - self._keep + 1)

    def _words_in(self, region: frames.Region) -> Integers32:
        words = np.zeros((region.height, region.width), dtype=np.int32)
        place = self._place_of(region)
        rows, cols = place.shared_with(self._words.shape)
        if rows.start < rows.stop and cols.start < cols.stop:
            words[place.place_of(rows, cols)] = self._words[rows, cols]
        return words

    def _place_of(self, region: frames.Region) -> frames.Region:
        """Return a region, its corner counted from that of the cells that are remembered."""
        return region._replace(row=region.row - self._region.row, col=region.col - self._region.col)


def lattice_of(options: LocalOptions, global_map: OccupancyGrid | None) -> frames.Frame:
    """Return the lattice of local maps, of one cell: the global map's, unless it is turned."""
    corner = (0.0, 0.0)
    if global_map is not None and not canvas.is_turned(global_map.frame):
        corner = global_map.origin[:2]
    return frames.Frame(1, 1, options.resolution, (*corner, 0.0))


def window_around(pose: Pose, options: LocalOptions, lattice: frames.Frame) -> frames.Region:
    region = frames.region_of(lattice, options.size, center_xy=pose[:2])
    region.frame_in(lattice)
    return region


def _joined(
    global_map: OccupancyGrid | None,
    lethal_threshold: int,
    values: SignedBytes,
    frame: frames.Frame,
    *,
    keeps_unknown: bool,
) -> tuple[OccupancyGrid, int]:
    """Add a global map to the values of clouds; also return the number of its obstacle cells."""
    # The larger value wins, as when costmap_2d combines its layers: obstacles win over free space,
    # and free space over unknown.
    from_map = 0
    if global_map is not None:
        rows, cols = canvas.rows_and_cols_under(frame, global_map.frame)
        if rows.start < rows.stop and cols.start < cols.stop:
            known = np.asarray(global_map.occupancy[rows])[:, cols]
            part = global_map.frame.window(rows.start, cols.start, *known.shape)
            obstacles = canvas.obstacles_in(frame, known >= lethal_threshold, part)
            is_known = canvas.contained_in(frame, known != map_values.UNKNOWN, part)
            values[is_known & (values == map_values.UNKNOWN)] = map_values.FREE
            values[obstacles] = map_values.OCCUPIED
            from_map = int(np.count_nonzero(obstacles))
    if not keeps_unknown:
        values[values == map_values.UNKNOWN] = map_values.FREE
    return OccupancyGrid(values, frame.resolution, frame.origin), from_map


def local_map(
    points: ArrayLike, pose: Sequence[float], *, global_map: OccupancyGrid | None = None,
    lethal_threshold: int = map_values.DEFAULT_LETHAL_THRESHOLD, **options: Any,
) -> OccupancyGrid:  # fmt: skip
    """Return a map of a robot's surroundings from a point cloud.

    Parameters
    ----------
    points : array_like of float, shape (N, 2) or (N, 3 or more)
        x, y and z of each point, metres; points with a coordinate that is not finite are ignored.
    pose : sequence of float
        x, y (metres) and yaw (radians) of the robot in the map frame; the centre of the map.
    global_map : OccupancyGrid, optional
        Map to take obstacles and free space from: a cell that overlaps one of its obstacles is
        occupied, and any other cell that lies entirely in its known cells is free.
    lethal_threshold : int
        Occupancy at or above which a cell of `global_map` is an obstacle, 1..100.
    **options
        Fields of `LocalOptions`.

    Returns
    -------
    OccupancyGrid
        100 in cells with a point or an obstacle of `global_map`. Without `global_map`, all other
        cells are free, 0. With it, cells that it knows to be free or that a beam passes are 0,
        and the rest is unknown, -1, or 0 if `unknown` is ``free``. The axes are those of the map
        frame. The corner is that of the cell that contains pose - size / 2, on the lattice through
        the origin of the map frame, or through the corner of `global_map` if that has no yaw.

    Raises
    ------
    ParameterError
        If a number is not allowed, or heights are limited but the points have no z.

    Notes
    -----
    Each point belongs to the cell that contains it. Coordinates are not truncated toward zero, so
    points just outside the window do not end up in its first cells.

    Examples
    --------
    >>> grid = local_map([[0.3, 0.1, 0.5]], (-1.0, 2.0, math.pi / 2), size=(1, 1), resolution=0.5)
    >>> grid.occupancy.tolist(), grid.origin  # the point lies at -1.1, 2.3
    ([[0, 0], [100, 0]], (-1.5, 1.5, 0.0))
    """
    threshold = lethal_threshold
    mapper = LocalMapper(pose, LocalOptions(**options), global_map, lethal_threshold=threshold)
    mapper.add(points)
    return mapper.result().grid


class LocalMapper:
    """Builder of a local map from points that are added in parts.

    Parameters
    ----------
    pose : sequence of float
        x, y (metres) and yaw (radians) of the robot in the map frame; the centre of the map.
    options : LocalOptions
        Size of the map, and how points become cells.
    global_map : OccupancyGrid, optional
        Map to take obstacles and free space from.
    lethal_threshold : int
        Occupancy at or above which a cell of `global_map` is an obstacle, 1..100.

    Raises
    ------
    ParameterError
        If the pose is not finite, or the window has too many cells.
    """

    def __init__(
        self, pose: Sequence[float], options: LocalOptions, global_map: OccupancyGrid | None = None,
        *, lethal_threshold: int = map_values.DEFAULT_LETHAL_THRESHOLD,
    ) -> None:  # fmt: skip
        self.pose = check_pose(pose)
        """x, y (metres) and yaw (radians) of the robot, -pi < yaw <= pi."""
        self._known = global_map, lethal_threshold
        lattice = lattice_of(options, global_map)
        self._window = window_around(self.pose, options, lattice)
        self._keeps_unknown = global_map is not None and options.unknown == "keep"
        self._frame = self._window.frame_in(lattice)
        self._cloud = SeenCloud(
            self.pose, options, lattice, self._window, with_beams=self._keeps_unknown
        )

    def add(self, points: ArrayLike) -> None:
        """Add points, shape (N, 2) or (N, 3 or more), metres; limits of height need z.

        Raises
        ------
        ParameterError
            If the points have another shape, or no z although heights are limited.
        """
        self._cloud.add(points)

    def result(self) -> LocalMap:
        """Return the map of all points so far."""
        evidence = np.full(self._frame.shape, map_values.UNKNOWN, dtype=np.int8)
        if self._keeps_unknown:
            sightings = Sightings(self._window)
            sensor, ends, _ = self._cloud.cells()
            sightings.add(sensor, ends, np.empty((0, 2), np.int64))
            evidence = sightings.evidence(self._window)
        evidence[self._cloud.is_hit] = map_values.OCCUPIED
        keeps = self._keeps_unknown
        grid, from_map = _joined(*self._known, evidence, self._frame, keeps_unknown=keeps)
        return LocalMap(grid, self.pose, self._cloud.counts, from_map, self._cloud.angles.arc())


class RollingMapper:
    """Builder of a local map from the most recent clouds of a sequence, after each cloud.

    Parameters
    ----------
    poses : array_like of float, shape (K, 3)
        x, y (metres) and yaw (radians) of the robot in the map frame, one pose per cloud.
    options : LocalOptions
        Size of the maps, and how points become cells.
    keep : int, optional
        Number of clouds in a map, including the newest; all clouds so far if not given.
    global_map : OccupancyGrid, optional
        Map to take obstacles and free space from. Beams do not clear its obstacles.
    lethal_threshold : int
        Occupancy at or above which a cell of `global_map` is an obstacle, 1..100.

    Raises
    ------
    ParameterError
        If a pose is not finite, `keep` is below 1, or a window has too many cells.

    Notes
    -----
    A cloud marks the cells of its points, after it has cleared those that its beams pass from the
    robot. All maps lie on one lattice, so that cells never blur, and each map depends on its clouds
    and poses alone; costmap_2d's rolling obstacle layer forgets cells that leave the window.

    Examples
    --------
    >>> options = LocalOptions(size=(2, 0.5), resolution=0.5)
    >>> mapper = RollingMapper([[0.0, 0.25, 0.0], [0.5, 0.25, 0.0]], options, keep=2)
    >>> mapper.add([[0.6, 0.0]])
    >>> mapper.result().grid.occupancy[0].tolist()  # nobody has looked back
    [-1, -1, 0, 100]
    >>> mapper.add([[0.7, 0.0]])
    >>> mapper.result().grid.occupancy[0].tolist()  # what was at 0.6 is gone
    [-1, 0, 0, 100]
    """

    def __init__(
        self, poses: Iterable[Sequence[float]], options: LocalOptions, *, keep: int | None = None,
        global_map: OccupancyGrid | None = None,
        lethal_threshold: int = map_values.DEFAULT_LETHAL_THRESHOLD,
    ) -> None:  # fmt: skip
        require(keep is None or keep >= 1, "must be at least 1", "keep", got=keep)
        self.poses: list[Pose] = [check_pose(pose) for pose in poses]
        """x, y (metres) and yaw (radians) of the robot for each cloud, -pi < yaw <= pi."""
        self._options, self._keep = options, keep
        self._known = global_map, lethal_threshold
        self._lattice = lattice_of(options, global_map)
        self._windows = [window_around(pose, options, self._lattice) for pose in self.poses]
        self._corners = np.array([window[:2] for window in self._windows]).reshape(-1, 2)
        self._sightings = Sightings(frames.Region(0, 0, 0, 0), keep)
        self.turn = 0
        """Number of clouds added or skipped so far."""
        self._was_added = np.zeros(len(self.poses), dtype=np.bool_)
        self._newest: SeenCloud | None = None

    @property
    def remembered(self) -> frames.Region:
        """Largest region of the lattice that is remembered at any time."""
        all_of_them = map(self._canvas, range(len(self.poses)))
        return max(all_of_them, key=lambda region: region.cells, default=frames.Region(0, 0, 0, 0))

    def _canvas(self, turn: int) -> frames.Region:
        """Return the cells of, and between, all windows to which the cloud of a turn may add."""
        last = None if self._keep is None else turn + self._keep
        corners = self._corners[turn:last]
        row, col = corners.min(axis=0).tolist()
        top, right = (corners.max(axis=0) + self._windows[turn][2:]).tolist()
        return frames.Region(row, col, top - row, right - col)

    def add(self, points: ArrayLike) -> None:
        """Add the next cloud, shape (N, 2) or (N, 3 or more), metres, if it has a pose.

        Raises
        ------
        ParameterError
            If the cloud has no pose, or the points have another shape or no z although heights
            are limited; nothing is added then.
        """
        self.add_in_parts([points])

    def add_in_parts(self, parts: Iterable[ArrayLike]) -> None:
        """Add the next cloud from several arrays of points; see `add`."""
        turn = self._next()
        pose, window = self.poses[turn], self._windows[turn]
        cloud = SeenCloud(pose, self._options, self._lattice, window, with_beams=True)
        for points in parts:
            cloud.add(points)
        self._sightings.move(self._canvas(turn))
        self._sightings.add(*cloud.cells())
        self._was_added[turn] = True
        self._newest, self.turn = cloud, turn + 1

    def skip(self) -> None:
        """Skip the next cloud, which adds nothing but still counts towards `keep`."""
        turn = self._next()
        self._sightings.move(self._canvas(turn))
        self._sightings.skip()
        self._newest, self.turn = None, turn + 1

    def result(self) -> LocalMap:
        """Return the local map at the cloud that was added last, unless that was skipped.

        Raises
        ------
        ParameterError
            If no cloud has been added, or the last one was skipped.
        """
        if self._newest is None:
            raise ParameterError("no cloud has been added", place="result")
        newest, turn = self._newest, self.turn - 1
        window = self._windows[turn]
        evidence, keeps = self._sightings.evidence(window), self._options.unknown == "keep"
        frame = window.frame_in(self._lattice)
        grid, from_map = _joined(*self._known, evidence, frame, keeps_unknown=keeps)
        first = 0 if self._keep is None else max(0, self.turn - self._keep)
        clouds = int(np.count_nonzero(self._was_added[first : self.turn]))
        earlier, pose = self._sightings.count_earlier(window), self.poses[turn]
        return LocalMap(grid, pose, newest.counts, from_map, newest.angles.arc(), clouds, earlier)

    def _next(self) -> int:
        count = len(self.poses)
        require(self.turn < count, "must have a pose for each cloud", "poses", got=count)
        return self.turn
