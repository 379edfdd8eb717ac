"""A cloud as cells: those with a point, and those in which beams end."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.coordinates import CELL_TOLERANCE, FARTHEST, turned
from mapdeal.grid.frame import ROUNDING, Frame
from mapdeal.grid.region import Region
from mapdeal.kernels.clouds import CloudRule, mark_cloud, marks_clouds
from mapdeal.mapping.local_options import LocalOptions
from mapdeal.mapping.poses import CoveredAngles, Pose
from mapdeal.records import dataclass

Floats = NDArray[np.float64]
Cells = NDArray[np.int64]

_FARTHEST_KEY = 1 << 31
"""In cells: of cells that are nearer, row and column together are one number of 64 bits."""


@dataclass(frozen=True)
class CloudCounts:
    """Number of points of a cloud by outcome; a point counts only for the first that applies."""

    points: int = 0
    not_finite: int = 0
    beyond_height: int = 0
    beyond_range: int = 0
    outside: int = 0
    marking: int = 0


class SeenCloud:
    """The cells of a cloud whose points come some at a time."""

    def __init__(
        self, pose: Pose, options: LocalOptions, lattice: Frame, window: Region, *, with_beams: bool
    ) -> None:
        self._pose = pose
        self._options = options
        self._lattice = lattice
        self._window = window
        self._frame = window.frame_in(lattice)
        self._with_beams = with_beams
        self._counts = np.zeros(6, dtype=np.int64)
        self._angles = CoveredAngles()
        self._marks, self._ends = np.zeros((2, 0), dtype=np.int64)
        self.is_hit = np.zeros(self._frame.shape, dtype=np.bool_)
        """Cells of the window with a point."""

    def add(self, points: ArrayLike) -> None:
        """Take points, shape (N, 2) or (N, 3 or more)."""
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] < 2:
            rule = "must be an array of shape (N, 2) or wider"
            raise ParameterError(rule, place="points", got=points.shape)
        if self._options.asks_for_heights and points.shape[1] < 3:
            rule = "the cloud has no heights"
            raise ParameterError(rule, place="min_height, max_height")
        if marks_clouds() and not self._with_beams:
            counts, seen = mark_cloud(
                points, self._rule(), self.is_hit, is_placed=self._options.frame == "map"
            )
            self._angles.add(np.arctan2(seen[:, 1], seen[:, 0]))
            self._counts += counts
            return
        count = len(points)
        finite = np.isfinite(points[:, :3]).all(axis=1)
        points = points[finite] if not finite.all() else points
        not_finite, (points, beyond_height) = count - len(points), self._within_heights(points)
        with np.errstate(over="ignore", invalid="ignore"):  # of points at 1e300
            seen, placed = self._from_robot(points[:, :2])
            distance = np.hypot(seen[:, 0], seen[:, 1])
        near = _between(distance, self._options.min_range, self._options.max_range)
        if self._with_beams:
            self._add_beams(placed, distance, near)
        beyond_range = int(len(near) - np.count_nonzero(near))
        seen, placed = seen[near], placed[near]
        away = (distance[near] > 0) & np.isfinite(distance[near])
        self._angles.add(np.arctan2(seen[away, 1], seen[away, 0]))
        cells, inside = self._frame.bounded_rowcol_from_xy(placed)
        cells = cells[inside]
        self.is_hit[cells[:, 0], cells[:, 1]] = True
        outside = len(placed) - len(cells)
        self._counts += (count, not_finite, beyond_height, beyond_range, outside, len(cells))

    @property
    def counts(self) -> CloudCounts:
        """Number of points by outcome."""
        return CloudCounts(*self._counts.tolist())

    @property
    def angles(self) -> tuple[float, float] | None:
        """First and last direction with points; see `LocalMap`."""
        return self._angles.arc()

    @property
    def sensor(self) -> Cells:
        """Row and column of the cell in which beams begin, shape (2,)."""
        cell: Cells = self._lattice.unbounded_rowcol_from_xy(self._sensor_xy())[0]
        return cell

    @property
    def marks(self) -> Cells:
        """The cells with a point, shape (M, 2), each once."""
        return _cells_from(self._marks)

    @property
    def ends(self) -> Cells:
        """The cells in which beams end, shape (K, 2), each once."""
        return _cells_from(self._ends)

    def _rule(self) -> CloudRule:
        """Return the same for the compiled code."""
        options, frame = self._options, self._frame
        x, y, yaw = self._pose
        turn = -yaw if options.frame == "map" else yaw
        corner_x, corner_y, frame_yaw = frame.origin
        least, most = -math.inf, math.inf
        return CloudRule(
            x, y, math.cos(turn), math.sin(turn), options.offset[0], options.offset[1],
            least if options.min_height is None else options.min_height,
            most if options.max_height is None else options.max_height,
            least if options.min_range is None else options.min_range,
            most if options.max_range is None else options.max_range,
            corner_x, corner_y, math.cos(-frame_yaw), math.sin(-frame_yaw), frame.resolution,
            FARTHEST, ROUNDING, CELL_TOLERANCE,
        )  # fmt: skip

    def _within_heights(self, points: Floats) -> tuple[Floats, int]:
        least, most = self._options.min_height, self._options.max_height
        if least is None and most is None:
            return points, 0
        kept = points[_between(points[:, 2], least, most)]
        return kept, len(points) - len(kept)

    def _from_robot(self, points_xy: Floats) -> tuple[Floats, Floats]:
        """Return points as the robot sees them, and in the map frame."""
        x, y, yaw = self._pose
        if self._options.frame == "map":
            placed = points_xy - np.array(self._options.offset)
            return turned(placed - np.array([x, y]), -yaw), placed
        return points_xy, turned(points_xy, yaw) + np.array([x, y]) - np.array(self._options.offset)

    def _sensor_xy(self) -> Floats:
        """Return where the cloud is seen from: moved as it is, shape (1, 2)."""
        here = np.array([self._pose[:2]])
        return here if self._options.frame == "map" else here - np.array(self._options.offset)

    def _add_beams(self, placed: Floats, distance: Floats, near: NDArray[np.bool_]) -> None:
        """Keep cells with a point, and those in which beams end: there, or where they clear to."""
        useful = _between(distance, self._options.min_range, None) & np.isfinite(distance)
        useful &= _both(np.abs(placed) <= FARTHEST)
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

    def _keys_of(self, placed: Floats) -> tuple[Cells, NDArray[np.bool_]]:
        """Return row and column of points as one number, and for which points there is one."""
        cells = self._lattice.unbounded_rowcol_from_xy(placed)
        return cells[:, 0] * (2 * _FARTHEST_KEY) + cells[:, 1], _both(np.abs(cells) < _FARTHEST_KEY)


def _both(pairs: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return where both of a pair are set: faster than `all` along short rows."""
    return pairs[:, 0] & pairs[:, 1]


def _union(one: Cells, other: Cells) -> Cells:
    return np.union1d(one, other) if len(one) else other


def _cells_from(keys: Cells) -> Cells:
    """Return the pairs of row and column that stand for each number."""
    rows = (keys + _FARTHEST_KEY) // (2 * _FARTHEST_KEY)
    return np.stack([rows, keys - rows * (2 * _FARTHEST_KEY)], axis=1)


def _between(values: Floats, least: float | None, most: float | None) -> NDArray[np.bool_]:
    within = np.ones(len(values), dtype=np.bool_)
    if least is not None:
        within &= values >= least
    if most is not None:
        within &= values <= most
    return within
