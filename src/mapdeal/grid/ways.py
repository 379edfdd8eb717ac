"""How wide the ways between the cells of a map are."""

from __future__ import annotations

from dataclasses import field
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.coordinates import CELL_TOLERANCE, Point, largest_square_within
from mapdeal.grid.frame import Frame
from mapdeal.grid.open_cells import Cell
from mapdeal.grid.values import OCCUPIED, UNKNOWN
from mapdeal.kernels.clearance_tree import (
    ClearanceTree,
    RootedTree,
    basin_areas,
    clearance_metres,
    clearance_tree,
    rooted,
    widest_metres,
)
from mapdeal.kernels.distance import squared_distance
from mapdeal.kernels.gaps import gap_at
from mapdeal.kernels.meetings import joined
from mapdeal.kernels.squares import SquaredDistances
from mapdeal.kernels.threads import for_rows
from mapdeal.records import dataclass


@dataclass(frozen=True, eq=False)
class Ways:
    """The widths of the ways between the cells of a map: its clearance tree, in metres."""

    tree: ClearanceTree
    squared: SquaredDistances
    frame: Frame
    _gaps: dict[int, tuple[Point, Point]] = field(default_factory=dict, init=False, repr=False)

    @property
    def cell_area(self) -> float:
        """Area of a cell, square metres."""
        return self.frame.resolution * self.frame.resolution

    def counts(self, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return how many cells of a mask lie in each basin."""
        return _counts(self.tree.basins, mask, len(self.tree.peaks)).astype(np.float64)

    def least_count(self, area: float) -> float:
        """Return how many cells make an area in square metres, exact multiples exactly."""
        return area / self.cell_area * (1 - CELL_TOLERANCE)

    def gap(self, saddle: int) -> tuple[Point, Point]:
        """Return the ends of the gap that a cell, by its flat index, lies in; computed once."""
        if saddle not in self._gaps:
            row, col = divmod(saddle, self.frame.width)
            ends = gap_at(self.squared, self.tree.basins, (row, col))
            first, second = self.frame.xy_from_rowcol(ends).tolist()
            self._gaps[saddle] = (first[0], first[1]), (second[0], second[1])
        return self._gaps[saddle]

    def middle(self, saddle: int) -> Point:
        """Return the middle of the gap that a cell lies in."""
        (x, y), (other_x, other_y) = self.gap(saddle)
        return (x + other_x) / 2, (y + other_y) / 2

    def is_open(self, closed_up_to: int) -> NDArray[np.bool_]:
        """Return the cells that ways may use above a square, shape (H, W)."""
        found = np.empty(self.squared.shape, dtype=np.bool_)

        def fill(rows: slice) -> None:
            np.greater(self.squared[rows], closed_up_to, out=found[rows])
            found[rows] &= self.tree.basins[rows] >= 0

        for_rows(fill, found.shape)
        return found

    def clearance(self, *, in_place: bool = False) -> NDArray[np.float32]:
        """Return the distance of each cell to what `squared` measures to, metres, shape (H, W).

        With `in_place` it reuses the memory of the squares, which are then lost.
        """
        return clearance_metres(self.squared, self.frame.resolution, in_place=in_place)

    def in_largest_area(self, closed_up_to: int) -> NDArray[np.bool_] | None:
        """Return the cells of the largest area above a square, shape (H, W); None if none is.

        Areas are connected by the four straight neighbours. Of areas of equal size, the one whose
        first basin comes first is returned.
        """
        tree = self.tree
        areas = basin_areas(tree, self.squared, closed_up_to)
        if not areas.any():
            return None
        is_wider = tree.squares > closed_up_to
        labels, _ = joined(len(areas), tree.one[is_wider], tree.other[is_wider])
        largest = np.argmax(np.bincount(labels, weights=areas))
        return self.cells_of(labels == largest, closed_up_to)

    def cells_of(self, is_chosen: NDArray[np.bool_], closed_up_to: int) -> NDArray[np.bool_]:
        """Return the cells above a square that are in some of the basins, shape (H, W)."""
        by_basin = np.append(is_chosen, False)  # -1 is the last one
        found = np.empty(self.squared.shape, dtype=np.bool_)

        def fill(rows: slice) -> None:
            np.greater(self.squared[rows], closed_up_to, out=found[rows])
            found[rows] &= by_basin[self.tree.basins[rows]]

        for_rows(fill, found.shape)
        return found

    def begun_at(self, start: Cell) -> WaysFrom:
        """Return the ways from a cell."""
        basin = int(self.tree.basins[start])
        return WaysFrom(self, start, None if basin < 0 else rooted(self.tree, basin))


@dataclass(frozen=True, eq=False)
class Ground:
    """The map that a robot moves on."""

    occupancy: NDArray[np.int8]
    frame: Frame
    through_unknown: bool

    @property
    def obstacles(self) -> NDArray[np.bool_]:
        """Mask of obstacles, computed on each access to save memory."""
        obstacles: NDArray[np.bool_] = self.occupancy == OCCUPIED
        return obstacles

    @property
    def blocked(self) -> NDArray[np.bool_]:
        """Mask of cells that no way leads through, computed on each access."""
        blocked = self.obstacles
        if not self.through_unknown:
            for_rows(
                lambda rows: np.logical_or(
                    blocked[rows], self.occupancy[rows] == UNKNOWN, out=blocked[rows]
                ),
                blocked.shape,
            )
        return blocked

    def ways(self) -> Ways:
        """Return the ways and their widths."""
        squared = squares_to(self.obstacles)
        traversable = self.blocked
        np.logical_not(traversable, out=traversable)
        return Ways(clearance_tree(squared, traversable), squared, self.frame)


@dataclass(frozen=True, eq=False)
class WaysFrom:
    """The ways from a start."""

    ways: Ways
    start: Cell
    rooted: RootedTree | None

    def widest_square_at(self, cell: Cell) -> int:
        """Return the least square on the widest way to a cell, 0 if there is no way."""
        basin = int(self.ways.tree.basins[cell])
        if self.rooted is None or basin < 0 or self.rooted.bottlenecks[basin] < 0:
            return 0
        ends = min(int(self.ways.squared[self.start]), int(self.ways.squared[cell]))
        return min(ends, int(self.rooted.bottlenecks[basin]))

    def reachable(self, closed_up_to: int) -> NDArray[np.uint8]:
        """Return 1 for cells that a way staying above a square leads to, else 0, shape (H, W)."""
        squared = self.ways.squared
        if self.rooted is None or squared[self.start] <= closed_up_to:
            return np.zeros(squared.shape, dtype=np.uint8)
        is_reached = self.rooted.bottlenecks > closed_up_to
        return self.ways.cells_of(is_reached, closed_up_to).view(np.uint8)

    def widest(self, *, in_place: bool = False) -> NDArray[np.float32]:
        """Return the least clearance on the widest way to each cell, metres, 0 if there is none.

        With `in_place` it reuses the memory of the basins, which are then lost.
        """
        if self.rooted is None:
            return np.zeros(self.ways.squared.shape, dtype=np.float32)
        return widest_metres(
            self.ways.tree,
            self.ways.squared,
            self.start,
            self.ways.frame.resolution,
            seen=self.rooted,
            in_place=in_place,
        )


def squares_to(marked: NDArray[np.bool_]) -> SquaredDistances:
    """Return the squared distance of each cell to the nearest cell that is marked or outside."""
    squared = squared_distance(marked)
    up, right = (
        np.minimum(np.arange(1, n + 1), np.arange(n, 0, -1), dtype=squared.dtype) ** 2
        for n in squared.shape
    )

    def lower(rows: slice) -> None:
        np.minimum(squared[rows], right, out=squared[rows])
        np.minimum(squared[rows], up[rows, np.newaxis], out=squared[rows])

    for_rows(lower, squared.shape)
    return squared


def largest_closed_square(radius: float, frame: Frame) -> int:
    """Return the largest squared distance in cells that is closed to a round robot.

    Cells at this distance have cost 253 around an obstacle, those beyond it less.
    """
    return largest_square_within(min(radius, max(frame.size_xy)), frame.resolution)


def _counts(basins: NDArray[np.int32], mask: NDArray[np.bool_], count: int) -> NDArray[np.int64]:
    """Return how many cells of a mask lie in each basin."""
    counts = np.zeros(count, dtype=np.int64)
    lock = Lock()

    def add(rows: slice) -> None:
        inside = basins[rows][mask[rows]]
        inside = inside[inside >= 0]  # a robot may stand beside its centre, which is in an obstacle
        if not len(inside):
            return
        first = int(inside.min())  # basins are numbered by rows: those of a few are near together
        found = np.bincount(inside - first)
        with lock:
            counts[first : first + len(found)] += found

    for_rows(add, basins.shape)
    return counts
