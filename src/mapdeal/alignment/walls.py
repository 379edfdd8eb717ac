"""Features of a map for alignment: the faces of its walls, and the distances to them."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.transform import Transform
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels.distance import squared_distance
from mapdeal.records import dataclass

MOST_CELLS_A_SIDE = 1000
"""Larger maps are aligned on coarser cells: walls are found to a fraction of a cell anyway."""

_MOST_FREE = 25
"""Occupancy up to which a cell counts as free: map_server's default threshold of 0.25."""

_LEAST_FREE = 0.1
"""Free cells of a map, for each obstacle cell, that is not one of walls alone."""

_REACH = 2
"""Cells within which a wall looks for free space to face."""

_FEWEST_FACING = 0.25
"""Share of the walls that must face free space; else walls that face unknown space count, too."""

Mask = NDArray[np.bool_]
Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class WallMap:
    """The walls of a map, on its own lattice, of which the rows and columns around are cut off."""

    frame: Frame
    free: Mask
    known: Mask
    distance: Floats
    faces_xy: Floats
    normals_xy: Floats

    @property
    def resolution(self) -> float:
        """Side of a cell, metres."""
        return self.frame.resolution

    @property
    def wall_length(self) -> float:
        """Faces of walls, metres: a cell's side for each."""
        return len(self.faces_xy) * self.resolution

    @property
    def free_area(self) -> float:
        """Square metres that are free."""
        return float(np.count_nonzero(self.free)) * self.resolution**2

    @property
    def middle_xy(self) -> NDArray[np.float64]:
        """The middle of the cells, metres from their corner."""
        return np.array(self.frame.size_xy) / 2

    def some_faces(self, most: int) -> tuple[Floats, Floats]:
        """Return at most so many faces, evenly chosen, and their normals."""
        if len(self.faces_xy) <= most:
            return self.faces_xy, self.normals_xy
        which = np.arange(most) * len(self.faces_xy) // most
        return self.faces_xy[which], self.normals_xy[which]

    def map_from_cells(self) -> Transform:
        """Return the transform from metres along the cells' axes to the map frame."""
        return Transform.from_pose(self.frame.origin)


def walls_of(grid: OccupancyGrid, most: int = MOST_CELLS_A_SIDE) -> WallMap | None:
    """Return the walls of a map; None if it has no obstacle.

    Notes
    -----
    A map that knows hardly any free space is one of walls alone, such as a drawing: all that is
    no obstacle counts as free.
    """
    occupied = grid.occupied()
    values = grid.occupancy
    free = (values > UNKNOWN) & (values < _MOST_FREE)
    rows, cols = (np.flatnonzero((occupied | free).any(axis=axis)) for axis in (1, 0))
    if not occupied.any():
        return None
    part = np.s_[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    occupied, free = occupied[part], free[part]
    if np.count_nonzero(free) < _LEAST_FREE * np.count_nonzero(occupied):
        free = ~occupied
    frame = grid.frame.window(int(rows[0]), int(cols[0]), *occupied.shape)
    factor = math.ceil(max(frame.shape) / most)
    if factor > 1:
        occupied = pooled(occupied, factor) > 0
        free = (pooled(free, factor) >= factor * factor / 2) & ~occupied
        height, width = occupied.shape
        frame = Frame(height, width, grid.resolution * factor, frame.origin)
    return _of_masks(frame, occupied, free)


def pooled(cells: Mask, factor: int) -> NDArray[np.int64]:
    """Return how many cells of each block are set."""
    height, width = (-(-side // factor) for side in cells.shape)
    padded = np.zeros((height * factor, width * factor), dtype=cells.dtype)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    counts: NDArray[np.int64] = padded.reshape(height, factor, width, factor).sum(axis=(1, 3))
    return counts


def _of_masks(frame: Frame, occupied: Mask, free: Mask) -> WallMap:
    faces = _faces(occupied, free)
    cells = np.argwhere(faces)
    squares = squared_distance(faces)
    distance = np.sqrt(squares, dtype=np.float32) * np.float32(frame.resolution)
    centres = (cells[:, ::-1] + 0.5) * frame.resolution
    return WallMap(
        frame, free, occupied | free, distance, centres.astype(np.float32), _normals(cells, free)
    )


def _faces(occupied: Mask, free: Mask) -> Mask:
    """Return the obstacle cells that a sensor sees: those beside free ones.

    What is behind them depends on how a map was made. Maps that know little free space, as
    those of walls alone, have their walls counted from all sides.
    """
    sides = np.pad(occupied, 1, mode="edge")
    inside = sides[:-2, 1:-1] & sides[2:, 1:-1] & sides[1:-1, :-2] & sides[1:-1, 2:]
    edges = occupied & ~inside
    padded = np.pad(free, 1)
    across = padded[:, :-2] | padded[:, 1:-1] | padded[:, 2:]
    facing: Mask = occupied & (across[:-2] | across[1:-1] | across[2:])
    if np.count_nonzero(facing) >= _FEWEST_FACING * np.count_nonzero(edges) and facing.any():
        return facing
    return edges if edges.any() else occupied


def _normals(cells: NDArray[np.int64], free: Mask) -> Floats:
    """Return for each cell the mean direction to the free cells around it."""
    padded = np.pad(free, _REACH)
    total = np.zeros((len(cells), 2), dtype=np.float32)
    around = range(-_REACH, _REACH + 1)
    for row, col in product(around, around):
        if row or col:
            is_free = padded[cells[:, 0] + _REACH + row, cells[:, 1] + _REACH + col]
            total += is_free[:, None] * (np.array([col, row], np.float32) / math.hypot(row, col))
    length = np.hypot(total[:, 0], total[:, 1])[:, None]
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0.5)
