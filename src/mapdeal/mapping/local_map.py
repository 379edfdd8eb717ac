"""Local maps: a robot's surroundings from a point cloud and a global map."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.grid.display import Drawn, count_text, numbers_text
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.region import Region, region_of
from mapdeal.grid.resample import is_turned, obstacles_in, rows_and_cols_under, wholly_in
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, FREE, OCCUPIED, UNKNOWN
from mapdeal.mapping.local_options import LocalOptions
from mapdeal.mapping.poses import Pose, check_pose, wrapped
from mapdeal.mapping.seen_cloud import CloudCounts, SeenCloud
from mapdeal.mapping.sightings import Sightings
from mapdeal.records import dataclass


@dataclass(frozen=True, eq=False, repr=False)
class LocalMap(Drawn):
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
        First and last direction of the points within the limits, from the robot's heading,
        anticlockwise, radians: -pi < first <= pi, first <= last < first + 2 pi. All points lie
        between them, and the rest of the circle is the largest gap. None if there are no points.
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

    def _told(self) -> Iterator[str]:
        yield repr(self.grid)
        yield f"pose {numbers_text(self.pose)}"
        yield f"{self.counts.marking} of {count_text(self.counts.points, 'point')} are obstacles"
        if self.clouds > 1:
            yield f"{self.clouds} clouds"

    @property
    def rear_heading(self) -> float:
        """Direction of the robot's back in the map frame, -pi < rear_heading <= pi, radians."""
        return wrapped(self.pose[2] - math.pi)


@dataclass(frozen=True, eq=False)
class KnownMap:
    """Obstacles and free space of a global map."""

    grid: OccupancyGrid
    lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD

    def seen_in(self, frame: Frame) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which cells of a frame overlap an obstacle, and which are known entirely."""
        source = self.grid.frame
        rows, cols = rows_and_cols_under(frame, source)
        if rows.start >= rows.stop or cols.start >= cols.stop:
            nothing = np.zeros(frame.shape, dtype=np.bool_)
            return nothing, nothing
        values = np.asarray(self.grid.occupancy[rows])[:, cols]
        part = source.window(rows.start, cols.start, *values.shape)
        obstacles = obstacles_in(frame, values >= self.lethal_threshold, part)
        return obstacles, wholly_in(frame, values != UNKNOWN, part)


def lattice_of(options: LocalOptions, global_map: OccupancyGrid | None) -> Frame:
    """Return the lattice of local maps, of one cell: the global map's, unless it is turned."""
    corner = (0.0, 0.0)
    if global_map is not None and not is_turned(global_map.frame):
        corner = global_map.origin[:2]
    return Frame(1, 1, options.resolution, (*corner, 0.0))


def window_around(pose: Pose, options: LocalOptions, lattice: Frame) -> Region:
    """Return the cells of the local map around a pose."""
    region = region_of(lattice, options.size, center_xy=pose[:2])
    region.frame_in(lattice)
    return region


def joined(
    evidence: NDArray[np.int8], frame: Frame, known: KnownMap | None, *, keeps_unknown: bool
) -> tuple[OccupancyGrid, int]:
    """Combine the evidence of clouds with a known map; also return its number of obstacle cells.

    The larger value wins, as when costmap_2d combines its layers: obstacles win over free space,
    and free space over unknown.
    """
    values, from_map = evidence.copy(), 0
    if known is not None:
        obstacles, is_known = known.seen_in(frame)
        values[is_known & (values == UNKNOWN)] = FREE
        values[obstacles] = OCCUPIED
        from_map = int(np.count_nonzero(obstacles))
    if not keeps_unknown:
        values[values == UNKNOWN] = FREE
    return OccupancyGrid(values, frame.resolution, frame.origin), from_map


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
    mapper = LocalMapper(
        pose, LocalOptions(**options), global_map, lethal_threshold=lethal_threshold
    )
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
        self,
        pose: Sequence[float],
        options: LocalOptions,
        global_map: OccupancyGrid | None = None,
        *,
        lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD,
    ) -> None:
        self._pose = check_pose(pose)
        self._known = None if global_map is None else KnownMap(global_map, lethal_threshold)
        lattice = lattice_of(options, global_map)
        self._window = window_around(self._pose, options, lattice)
        self._keeps_unknown = global_map is not None and options.unknown == "keep"
        self._frame = self._window.frame_in(lattice)
        self._cloud = SeenCloud(
            self._pose, options, lattice, self._window, with_beams=self._keeps_unknown
        )

    @property
    def pose(self) -> Pose:
        """x, y (metres) and yaw (radians) of the robot, -pi < yaw <= pi."""
        return self._pose

    def add(self, points: ArrayLike) -> None:
        """Add points, shape (N, 2) or (N, 3 or more), metres.

        Raises
        ------
        ParameterError
            If the points have another shape, or no z although heights are limited.
        """
        self._cloud.add(points)

    def result(self) -> LocalMap:
        """Return the map of all points so far."""
        evidence = np.full(self._frame.shape, UNKNOWN, dtype=np.int8)
        if self._keeps_unknown:
            sightings = Sightings(self._window)
            sightings.add(self._cloud.sensor, self._cloud.ends, np.empty((0, 2), np.int64))
            evidence = sightings.evidence(self._window)
        evidence[self._cloud.is_hit] = OCCUPIED
        grid, from_map = joined(
            evidence, self._frame, self._known, keeps_unknown=self._keeps_unknown
        )
        return LocalMap(grid, self._pose, self._cloud.counts, from_map, self._cloud.angles)
