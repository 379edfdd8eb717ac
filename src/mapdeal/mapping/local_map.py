"""A map of a robot's surroundings, from a point cloud and what a global map knows."""

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
    """A local map, and what is to be said of it.

    Parameters
    ----------
    grid : OccupancyGrid
        100 where a point or an obstacle of the global map is; 0, or -1 where unknown cells are
        kept and nothing has seen it; axes along x and y.
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
    clouds : int
        How many clouds the map is made of; the counts and angles are the last one's.
    from_earlier : int
        Cells that are obstacles by an earlier cloud than the last.
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
        """The direction that the robot's back faces, -pi < rear_heading <= pi."""
        return wrapped(self.pose[2] - math.pi)


@dataclass(frozen=True, eq=False)
class KnownMap:
    """What a global map knows: its obstacles, and what is free.

    Parameters
    ----------
    grid : OccupancyGrid
        The map, whole or lazy.
    lethal_threshold : int
        Occupancy from which a cell of it is an obstacle, 1..100.
    """

    grid: OccupancyGrid
    lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD

    def seen_in(self, frame: Frame) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which cells of a frame overlap an obstacle, and which are known all over."""
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
    """Return the cells of the local map of a pose.

    Raises
    ------
    ParameterError
        If there would be too many.
    """
    region = region_of(lattice, options.size, center_xy=pose[:2])
    region.frame_in(lattice)
    return region


def joined(
    evidence: NDArray[np.int8], frame: Frame, known: KnownMap | None, *, keeps_unknown: bool
) -> tuple[OccupancyGrid, int]:
    """Return what clouds have seen, joined with what a map knows, and the map's obstacle cells.

    The larger of the two counts, as where costmap_2d lays its layers over each other: an obstacle
    before what is free, and that before what is unknown.
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
        x, y and z of each point, metres; points with a coordinate that is not finite are left
        out.
    pose : sequence of float
        x, y (metres) and yaw (radians) of the robot in the map frame: the middle of the map.
    global_map : OccupancyGrid, optional
        A map whose obstacles are taken over where they overlap a cell, and whose free cells where
        they cover it.
    lethal_threshold : int
        Occupancy from which a cell of it is an obstacle, 1..100.
    **options
        The fields of `LocalOptions`.

    Returns
    -------
    OccupancyGrid
        100 in cells with a point, or with an obstacle of `global_map`. Others are free, 0, without
        `global_map`; with it, those that it knows to be free, or through which a beam passes,
        while the rest is unknown, -1, or free if `unknown` is so. Its axes are those of the map
        frame. Its corner is that of the cell in which pose - size / 2 lies, on
        the lattice of the resolution through the map frame's origin, or through the corner of
        `global_map` if that is not turned.

    Raises
    ------
    ParameterError
        If a number is not allowed, or heights are asked of points without z.

    Notes
    -----
    A point belongs to the cell that holds it, also below zero, so that points just outside of the
    window do not fall into its first cells.

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
        A map whose obstacles are taken over, and what it knows to be free.
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
        """The robot's x, y (metres) and yaw, -pi < yaw <= pi."""
        return self._pose

    def add(self, points: ArrayLike) -> None:
        """Mark the cells of points, shape (N, 2) or (N, 3 or more).

        Raises
        ------
        ParameterError
            If they have another shape, or no z although heights are limited.
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
