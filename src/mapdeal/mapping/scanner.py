"""A simulated laser scanner: the inverse of a map from scans."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property

import numpy as np

from mapdeal.grid import occupancy, values
from mapdeal.grid.frame import as_float32
from mapdeal.kernels.arrays import Bytes, Floats, Integers, Mask
from mapdeal.kernels.sensing import cast_rays, room_around
from mapdeal.mapping.evidence import Scans
from mapdeal.records import dataclass

_INSIDE = 1e-7  # metres that beams go into the cell that they hit, or rounding may end them before
_BEAMS_TOGETHER = 1 << 18
_GRAZING = 0.25  # radians to a wall, below which mappers can free cells in front of the hit one
_SEED = 0


@dataclass(frozen=True)
class Surroundings:
    """What beams hit: the obstacles of a map; unknown cells end them without a return."""

    grid: occupancy.OccupancyGrid
    through_unknown: bool = False

    @cached_property
    def _room(self) -> Bytes:
        unknown = (self.grid.occupancy == values.UNKNOWN) & (not self.through_unknown)
        return room_around(self.grid.occupied(), unknown)

    @property
    def cells(self) -> int:
        return self.grid.occupancy.size

    def is_open(self, poses: Floats) -> Mask:
        cells, is_inside = self.grid.frame.bounded_rowcol_from_xy(poses[:, :2])
        return np.asarray(is_inside & (self._room[tuple(cells.T)] > 1))

    def lengths(self, poses: Floats, angles: Floats, range_max: float) -> Floats:
        """Return the lengths of beams, shape (N, M), metres; inf for those without a return."""
        frame = self.grid.frame
        starts = frame.continuous_rowcol_from_xy(poses[:, :2])
        directions = poses[:, 2:] + angles - frame.origin[2]
        limit = range_max / frame.resolution
        found = cast_rays(self._room, starts, directions, limit) * frame.resolution + _INSIDE
        found[~self.is_open(poses)] = np.inf
        return found

    def hit_cells(self, poses: Floats, angles: Floats, lengths: Floats) -> Integers:
        scan, beam = np.nonzero(np.isfinite(lengths))
        headings, reach = poses[scan, 2] + angles[beam], lengths[scan, beam, np.newaxis]
        ends = poses[scan, :2] + reach * np.column_stack([np.cos(headings), np.sin(headings)])
        cells = self.grid.frame.clamped_rowcol_from_xy(ends)
        flat = np.unique(np.ravel_multi_index(tuple(cells.T), self.grid.shape))
        return np.asarray(flat[self._room.reshape(-1)[flat] == 0])

    def sights(self, places_xy: Floats, range_max: float) -> Iterator[tuple[Integers, Integers]]:
        """Yield for each place the obstacles in sight, and those that beams do not only graze."""
        reach = min(range_max, math.hypot(*self.grid.frame.size_xy))
        count = math.ceil(2 * math.pi * reach / self.grid.resolution)
        angles = np.linspace(-math.pi, math.pi, count, endpoint=False)
        for pose in np.pad(places_xy, ((0, 0), (0, 1)))[:, np.newaxis]:
            lengths = self.lengths(pose, angles, range_max)
            with np.errstate(invalid="ignore"):  # between two beams without return
                steps = np.abs(np.diff(lengths, axis=1, append=lengths[:, :1]))
                is_steep = steps < lengths * (2 * math.pi / count / math.tan(_GRAZING))
            steep = np.where(is_steep, lengths, np.inf)
            yield self.hit_cells(pose, angles, lengths), self.hit_cells(pose, angles, steep)


@dataclass(frozen=True)
class Scanner:
    """A laser scanner on a robot; lengths in metres, angles in radians, probabilities to 1."""

    range_min: float
    range_max: float
    fov: float
    beams: int
    noise: float = 0.0
    dropout: float = 0.0
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def first_angle(self) -> float:
        return as_float32(-self.fov / 2)

    @property
    def step(self) -> float:
        """Angle between two beams; the last of a full circle is not that of the first."""
        is_circle = self.fov > 2 * math.pi - 1e-6
        return as_float32(self.fov / (self.beams if is_circle else self.beams - 1))

    @property
    def angles(self) -> Floats:
        # of float32, as a LaserScan has them, so that all logs have the same beams
        return np.asarray(self.first_angle + self.step * np.arange(self.beams), dtype=np.float64)

    def poses_of(self, robot_poses: Floats) -> Floats:
        x, y, yaw = self.mount
        moves = (x + 1j * y) * np.exp(1j * robot_poses[:, 2])
        turns = np.full(len(moves), yaw)
        return np.asarray(robot_poses + np.column_stack([moves.real, moves.imag, turns]))

    def scans(self, around: Surroundings, robot_poses: Floats, is_hit: Mask | None = None) -> Scans:
        """Return the scans at poses of the robot, and mark the cells that beams hit."""
        # the seed is fixed: the same input gives the same bytes
        random = np.random.default_rng(_SEED)
        poses, angles = self.poses_of(robot_poses), self.angles
        ranges = np.empty((len(poses), self.beams))
        scans_together = max(1, _BEAMS_TOGETHER // self.beams)
        for first in range(0, len(poses), scans_together):
            part = slice(first, first + scans_together)
            lengths = around.lengths(poses[part], angles, self.range_max)
            if is_hit is not None:
                is_hit[around.hit_cells(poses[part], angles, lengths)] = True
            if self.noise:
                lengths += random.normal(0.0, self.noise, lengths.shape)
            if self.dropout:
                lengths[random.random(lengths.shape) < self.dropout] = np.inf
            lengths[(lengths < self.range_min) | (lengths <= 0)] = -np.inf  # too near: REP 117
            lengths[lengths >= self.range_max] = np.inf
            ranges[part] = lengths
        return Scans(poses, angles, ranges)


def noisy_odometry(robot_poses: Floats, noise: float) -> tuple[Floats, Floats]:
    """Return poses of odometry, which begins at 0, and those of its frame in the map."""
    # `noise` is the standard deviation of its error after one metre, and after one radian.
    random = np.random.default_rng(_SEED)
    yaws, places = robot_poses[:, 2], robot_poses[:, 0] + 1j * robot_poses[:, 1]
    moves, turns = np.diff(places) * np.exp(-1j * yaws[:-1]), np.diff(yaws)
    lengths, errors = np.abs(moves), random.normal(0.0, noise, (2, len(turns)))
    moves += errors[0] * np.sqrt(lengths)
    turns += errors[1] * np.sqrt(lengths + np.abs(turns))
    odometry_yaws = np.append(0.0, np.cumsum(turns))
    odometry = np.append(0.0, np.cumsum(moves * np.exp(1j * odometry_yaws[:-1])))
    frame_yaws = yaws - odometry_yaws
    frames = places - odometry * np.exp(1j * frame_yaws)
    odometry_poses = np.column_stack([odometry.real, odometry.imag, odometry_yaws])
    return odometry_poses, np.column_stack([frames.real, frames.imag, frame_yaws])
