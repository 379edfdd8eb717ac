"""Local maps of a sequence of clouds, each combined with the clouds before it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from mapdeal.errors import ParameterError
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.region import Region
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD
from mapdeal.mapping.local_map import KnownMap, LocalMap, joined, lattice_of, window_around
from mapdeal.mapping.local_options import LocalOptions
from mapdeal.mapping.poses import Pose, check_pose
from mapdeal.mapping.seen_cloud import SeenCloud
from mapdeal.mapping.sightings import Sightings


class RollingMapper:
    """Builder of a local map from the most recent clouds of a sequence, after each cloud.

    A cloud marks the cells of its points, and clears the cells that its beams pass, from the robot
    to each point. Cells marked by recent clouds stay marked until a later beam clears them.

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
    All maps lie on one lattice, so that cells never blur, and each map depends on its clouds and
    poses alone. In costmap_2d's rolling obstacle layer, a cell that leaves the window for a moment
    is forgotten, and beams have no effect outside the window; here, the cells of later windows are
    remembered as well.

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
        self,
        poses: Iterable[Sequence[float]],
        options: LocalOptions,
        *,
        keep: int | None = None,
        global_map: OccupancyGrid | None = None,
        lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD,
    ) -> None:
        if keep is not None and keep < 1:
            raise ParameterError("must be at least 1", place="keep", got=keep)
        self.poses: list[Pose] = [check_pose(pose) for pose in poses]
        """x, y (metres) and yaw (radians) of the robot for each cloud, -pi < yaw <= pi."""
        self._options = options
        self._keep = keep
        self._known = None if global_map is None else KnownMap(global_map, lethal_threshold)
        self._lattice = lattice_of(options, global_map)
        self._windows = [window_around(pose, options, self._lattice) for pose in self.poses]
        self._corners = np.array([window[:2] for window in self._windows]).reshape(-1, 2)
        self._sightings = Sightings(Region(0, 0, 0, 0), keep)
        self.turn = 0
        """Number of clouds added or skipped so far."""
        self._said = np.zeros(len(self.poses), dtype=np.bool_)
        self._newest: SeenCloud | None = None

    @property
    def remembered(self) -> Region:
        """Largest region of the lattice that is remembered at any time."""
        all_of_them = map(self._canvas, range(len(self.poses)))
        return max(all_of_them, key=lambda region: region.cells, default=Region(0, 0, 0, 0))

    def _canvas(self, turn: int) -> Region:
        """Return the cells to remember at a cloud's turn: all that maps may still show.

        These are the cells of, and between, all windows to which the cloud can contribute.
        """
        last = None if self._keep is None else turn + self._keep
        corners = self._corners[turn:last]
        row, col = corners.min(axis=0).tolist()
        top, right = (corners.max(axis=0) + self._windows[turn][2:]).tolist()
        return Region(row, col, top - row, right - col)

    def add(self, points: ArrayLike) -> None:
        """Add the next cloud, shape (N, 2) or (N, 3 or more), metres.

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
        cloud = SeenCloud(
            self.poses[turn], self._options, self._lattice, self._windows[turn], with_beams=True
        )
        for points in parts:
            cloud.add(points)
        self._sightings.move(self._canvas(turn))
        self._sightings.add(cloud.sensor, cloud.ends, cloud.marks)
        self._newest, self.turn, self._said[turn] = cloud, turn + 1, True

    def skip(self) -> None:
        """Skip the next cloud, which adds nothing but still counts towards `keep`."""
        turn = self._next()
        self._sightings.move(self._canvas(turn))
        self._sightings.skip()
        self._newest, self.turn = None, turn + 1

    def result(self) -> LocalMap:
        """Return the local map at the cloud that was added last.

        Raises
        ------
        ParameterError
            If no cloud has been added, or the last one was skipped.
        """
        if self._newest is None:
            raise ParameterError("no cloud has been added", place="result")
        turn = self.turn - 1
        window = self._windows[turn]
        grid, from_map = joined(
            self._sightings.evidence(window),
            window.frame_in(self._lattice),
            self._known,
            keeps_unknown=self._options.unknown == "keep",
        )
        first = 0 if self._keep is None else max(0, self.turn - self._keep)
        return LocalMap(
            grid,
            self.poses[turn],
            self._newest.counts,
            from_map,
            self._newest.angles,
            int(np.count_nonzero(self._said[first : self.turn])),
            self._sightings.count_earlier(window),
        )

    def _next(self) -> int:
        if self.turn >= len(self.poses):
            rule = "must have a pose for each cloud"
            raise ParameterError(rule, place="poses", got=len(self.poses))
        return self.turn
