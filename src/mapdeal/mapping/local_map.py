"""A map of a robot's surroundings, from a point cloud and what a global map knows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.coordinates import check_point, check_resolution, turned
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.region import region_of
from mapdeal.grid.resample import is_turned, obstacles_in
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, OCCUPIED
from mapdeal.mapping.poses import CoveredAngles, Pose, check_pose, wrapped

CloudFrame = Literal["robot", "map"]


@dataclass(frozen=True)
class LocalOptions:
    """How a local map is made of a cloud.

    Parameters
    ----------
    frame : {'robot', 'map'}
        What the cloud's coordinates are: ahead and to the left of the robot, or those of the
        map already.
    offset : tuple of float
        x and y that are taken off the points' coordinates in the map frame, metres.
    size : tuple of float
        Extent of the map along x and y, metres; covered by whole cells.
    resolution : float
        Side of a cell, metres.
    min_height, max_height : float, optional
        Least and greatest z of the points that count, metres, in the cloud's own coordinates.
    min_range, max_range : float, optional
        Least and greatest distance from the robot, in the plane, of the points that count.

    Raises
    ------
    ParameterError
        If a number is not finite or of the wrong sign, or a limit below its counterpart.
    """

    frame: CloudFrame = "robot"
    offset: tuple[float, float] = (0.0, 0.0)
    size: tuple[float, float] = (20.0, 20.0)
    resolution: float = 0.05
    min_height: float | None = None
    max_height: float | None = None
    min_range: float | None = None
    max_range: float | None = None

    def __post_init__(self) -> None:
        if self.frame not in get_args(CloudFrame):
            rule = f"must be one of {', '.join(get_args(CloudFrame))}"
            raise ParameterError(rule, place="frame", got=self.frame)
        object.__setattr__(self, "offset", check_point(self.offset, "offset"))
        object.__setattr__(self, "size", check_point(self.size, "size"))
        object.__setattr__(self, "resolution", check_resolution(self.resolution))
        for what in ("height", "range"):
            self._check_limits(f"min_{what}", f"max_{what}", signed=what == "height")

    def _check_limits(self, least: str, most: str, *, signed: bool) -> None:
        for name in (least, most):
            value = getattr(self, name)
            if value is None:
                continue
            if not math.isfinite(value) or (value < 0 and not signed):
                rule = "must be a finite number" + ("" if signed else ", at least 0")
                raise ParameterError(rule, place=name, got=value)
        low, high = getattr(self, least), getattr(self, most)
        if low is not None and high is not None and low > high:
            raise ParameterError(f"must not be above {most}, {high:g}", place=least, got=low)

    @property
    def asks_for_heights(self) -> bool:
        """Whether points without z cannot be judged."""
        return self.min_height is not None or self.max_height is not None


@dataclass(frozen=True)
class CloudCounts:
    """What became of the points of a cloud: each is counted once, at the first that applies.

    Parameters
    ----------
    points : int
        All points.
    not_finite : int
        Those with a coordinate that is nan or infinite.
    beyond_height, beyond_range : int
        Those outside of the limits.
    outside : int
        Those outside of the window.
    marking : int
        Those that make their cell an obstacle.
    """

    points: int = 0
    not_finite: int = 0
    beyond_height: int = 0
    beyond_range: int = 0
    outside: int = 0
    marking: int = 0


@dataclass(frozen=True, eq=False)
class LocalMap:
    """A local map, and what is to be said of it.

    Parameters
    ----------
    grid : OccupancyGrid
        100 where a point or an obstacle of the global map is, else 0; axes along x and y.
    pose : tuple of float
        The robot's x, y (metres) and yaw, -pi < yaw <= pi.
    counts : CloudCounts
        What became of the points.
    from_map : int
        Cells that the global map's obstacles take.
    angles : tuple of float, optional
        First and last direction in which there are points within the limits, radians from the
        robot's heading, anticlockwise: -pi < first <= pi, first <= last < first + 2 pi. All
        points lie between them, and the rest of the circle is the largest gap. None without
        points.
    """

    grid: OccupancyGrid
    pose: Pose
    counts: CloudCounts
    from_map: int
    angles: tuple[float, float] | None

    @property
    def rear_heading(self) -> float:
        """The direction that the robot's back faces, -pi < rear_heading <= pi."""
        return wrapped(self.pose[2] - math.pi)


def local_map(
    points: ArrayLike,
    pose: Sequence[float],
    *,
    global_map: OccupancyGrid | None = None,
    lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD,
    **options: Any,
) -> OccupancyGrid:
    """Return a map of a robot's surroundings from a point cloud.

    Parameters
    ----------
    points : array_like of float, shape (N, 2) or (N, 3 or more)
        x, y and z of each point, metres; points with a coordinate that is not finite are left
        out.
    pose : sequence of float
        x, y (metres) and yaw (radians) of the robot in the map frame: the middle of the map.
    global_map : OccupancyGrid, optional
        A map whose obstacles are taken over where they overlap a cell.
    lethal_threshold : int
        Occupancy from which a cell of it is an obstacle, 1..100.
    **options
        The fields of `LocalOptions`.

    Returns
    -------
    OccupancyGrid
        100 in cells with a point, or with an obstacle of `global_map`, else 0. Its axes are
        those of the map frame. Its corner is that of the cell in which pose - size / 2 lies, on
        the lattice of the resolution through the map frame's origin, or through the corner of
        `global_map` if that is not turned.

    Raises
    ------
    ParameterError
        If a number is not allowed, or heights are asked of points without z.

    References
    ----------
    Design document 000, ``Local_Tran_Global_Map`` and ``Extract_Local_From_GlobalMap``; with
    floor where these truncate, so that points just outside do not fall into the first cells.

    Examples
    --------
    >>> grid = local_map([[0.3, 0.1, 0.5]], (-1.0, 2.0, math.pi / 2), size=(1, 1), resolution=0.5)
    >>> grid.occupancy.tolist(), grid.origin  # the point lies at -1.1, 2.3
    ([[0, 0], [100, 0]], (-1.5, 1.5, 0.0))
    """
    mapper = LocalMapper(
        pose, LocalOptions(**options), global_map, lethal_threshold=lethal_threshold
    )
    mapper.add(points)
    return mapper.result().grid


class LocalMapper:
    """Makes a local map of points that come some at a time.

    Parameters
    ----------
    pose : sequence of float
        x, y (metres) and yaw (radians) of the robot in the map frame.
    options : LocalOptions
        The rest.
    global_map : OccupancyGrid, optional
        A map whose obstacles are taken over.
    lethal_threshold : int
        Occupancy from which a cell of it is an obstacle, 1..100.

    Raises
    ------
    ParameterError
        If the pose is not finite, or the window has too many cells.
    """

    def __init__(
        self,
        pose: Sequence[float],
        options: LocalOptions,
        global_map: OccupancyGrid | None = None,
        *,
        lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD,
    ) -> None:
        self._pose = check_pose(pose)
        self._options = options
        self._global_map = global_map
        self._lethal_threshold = lethal_threshold
        corner = (0.0, 0.0)
        if global_map is not None and not is_turned(global_map.frame):
            corner = global_map.origin[:2]
        lattice = Frame(1, 1, options.resolution, (*corner, 0.0))
        region = region_of(lattice, options.size, center_xy=self._pose[:2])
        self._frame = region.frame_in(lattice)
        self._is_hit = np.zeros(self._frame.shape, dtype=np.bool_)
        self._counts = np.zeros(6, dtype=np.int64)
        self._angles = CoveredAngles()

    @property
    def pose(self) -> Pose:
        """The robot's x, y (metres) and yaw, -pi < yaw <= pi."""
        return self._pose

    def add(self, points: ArrayLike) -> None:
        """Mark the cells of points, shape (N, 2) or (N, 3 or more).

        Raises
        ------
        ParameterError
            If they have another shape, or no z although heights are limited.
        """
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] < 2:
            rule = "must be an array of shape (N, 2) or wider"
            raise ParameterError(rule, place="points", got=points.shape)
        if self._options.asks_for_heights and points.shape[1] < 3:
            rule = "the cloud has no heights"
            raise ParameterError(rule, place="min_height, max_height")
        count = len(points)
        finite = np.isfinite(points[:, :3]).all(axis=1)
        points = points[finite] if not finite.all() else points
        not_finite, (points, beyond_height) = count - len(points), self._within_heights(points)
        with np.errstate(over="ignore", invalid="ignore"):  # of points at 1e300
            seen, placed = self._from_robot(points[:, :2])
            distance = np.hypot(seen[:, 0], seen[:, 1])
        near = self._in_range(distance)
        beyond_range = int(len(near) - np.count_nonzero(near))
        seen, placed = seen[near], placed[near]
        away = (distance[near] > 0) & np.isfinite(distance[near])
        self._angles.add(np.arctan2(seen[away, 1], seen[away, 0]))
        cells, inside = self._frame.bounded_rowcol_from_xy(placed)
        cells = cells[inside]
        self._is_hit[cells[:, 0], cells[:, 1]] = True
        outside = len(placed) - len(cells)
        self._counts += (count, not_finite, beyond_height, beyond_range, outside, len(cells))

    def result(self) -> LocalMap:
        """Return the map of all points so far."""
        occupied = self._is_hit
        from_map = 0
        if self._global_map is not None:
            known = self._global_map
            lethal = known.occupied(self._lethal_threshold)
            obstacles = obstacles_in(self._frame, lethal, known.frame)
            from_map = int(np.count_nonzero(obstacles))
            occupied = occupied | obstacles
        values = occupied.astype(np.int8) * np.int8(OCCUPIED)
        return LocalMap(
            OccupancyGrid(values, self._frame.resolution, self._frame.origin),
            self._pose,
            CloudCounts(*self._counts.tolist()),
            from_map,
            self._angles.arc(),
        )

    def _within_heights(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], int]:  # fmt: skip
        least, most = self._options.min_height, self._options.max_height
        if least is None and most is None:
            return points, 0
        kept = points[_between(points[:, 2], least, most)]
        return kept, len(points) - len(kept)

    def _in_range(self, distance: NDArray[np.float64]) -> NDArray[np.bool_]:
        return _between(distance, self._options.min_range, self._options.max_range)

    def _from_robot(
        self, points_xy: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points as the robot sees them, and in the map frame."""
        x, y, yaw = self._pose
        if self._options.frame == "map":
            placed = points_xy - np.array(self._options.offset)
            return turned(placed - np.array([x, y]), -yaw), placed
        return points_xy, turned(points_xy, yaw) + np.array([x, y]) - np.array(self._options.offset)


def _between(
    values: NDArray[np.float64], least: float | None, most: float | None
) -> NDArray[np.bool_]:
    within = np.ones(len(values), dtype=np.bool_)
    if least is not None:
        within &= values >= least
    if most is not None:
        within &= values <= most
    return within
