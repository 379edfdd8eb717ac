"""Grids too large for memory: their layers are made by rows when they are asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from mapdeal.grid.coordinates import Origin
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import (
    DEFAULT_LETHAL_THRESHOLD,
    UNKNOWN,
    Convention,
    CostScale,
    UnknownPolicy,
)
from mapdeal.kernels.rows import MadeRows


@dataclass(frozen=True, eq=False)
class LargeMap:
    """What `OccupancyGrid` is for a map that fits into memory.

    Parameters
    ----------
    occupancy : MadeRows of int8, shape (H, W)
        -1 unknown, 0 free, 100 occupied, 1..99 in between. Row 0 is the south.
    resolution : float
        Side of a cell, metres.
    origin : tuple of float
        x, y (metres) and yaw (radians) of the outer corner of cell (0, 0).
    """

    occupancy: MadeRows
    resolution: float
    origin: Origin = (0.0, 0.0, 0.0)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.occupancy.shape

    @property
    def frame(self) -> Frame:
        """The geometry of the grid."""
        return Frame(*self.shape, self.resolution, self.origin)

    def part(self, rows: slice) -> OccupancyGrid:
        """Return some rows, at the origin of the whole: for what does not look at origins."""
        return OccupancyGrid(self.occupancy[rows], self.resolution, self.origin)


@dataclass(frozen=True, eq=False)
class LargeField:
    """What `DistanceField` is for a map that fits into memory; the parameters are the same."""

    distance: MadeRows
    occupancy: MadeRows
    resolution: float
    origin: Origin = (0.0, 0.0, 0.0)
    convention: Convention = "seed"
    strength: float = 1.0
    max_distance: float | None = None
    lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD
    unknown: UnknownPolicy = "free"

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.distance.shape

    @property
    def frame(self) -> Frame:
        """The geometry of the field."""
        return Frame(*self.shape, self.resolution, self.origin)

    @property
    def grid(self) -> LargeMap:
        """The map that the field is made from."""
        return LargeMap(self.occupancy, self.resolution, self.origin)

    def obstacles(self) -> MadeRows:
        """Return the mask of cells that the field counts as obstacles."""
        with_unknown = self.unknown == "occupied"
        return self.occupancy.mapped(
            bool,
            lambda values: (values >= self.lethal_threshold) | (with_unknown & (values == UNKNOWN)),
        )

    def part(self, rows: slice) -> DistanceField:
        """Return some rows, at the origin of the whole: for what does not look at origins."""
        return DistanceField(
            self.distance[rows],
            self.occupancy[rows],
            self.resolution,
            self.origin,
            convention=self.convention,
            strength=self.strength,
            max_distance=self.max_distance,
            lethal_threshold=self.lethal_threshold,
            unknown=self.unknown,
        )


@dataclass(frozen=True, eq=False)
class LargeCosts:
    """What `Costmap` is for costs that fit into memory; the parameters are the same."""

    cost: MadeRows
    resolution: float
    origin: Origin = (0.0, 0.0, 0.0)
    scale: CostScale = "costmap2d"
    circumscribed_cost: int | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.cost.shape

    @property
    def frame(self) -> Frame:
        """The geometry of the costmap."""
        return Frame(*self.shape, self.resolution, self.origin)

    def part(self, rows: slice) -> Costmap:
        """Return some rows, at the origin of the whole: for what does not look at origins."""
        return Costmap(
            self.cost[rows], self.resolution, self.origin, self.scale, self.circumscribed_cost
        )


LargeGrid = LargeMap | LargeField | LargeCosts


def told_of_rows(grid: LargeGrid, tell: Callable[[int], None]) -> LargeGrid:
    """Return a grid that tells how many rows of its own layer it has just given."""

    def told(part: NDArray[Any]) -> NDArray[Any]:
        tell(len(part))
        return part

    def watched(layer: MadeRows) -> MadeRows:
        return layer.mapped(layer.dtype, told)

    if isinstance(grid, LargeField):
        return replace(grid, distance=watched(grid.distance))
    if isinstance(grid, LargeCosts):
        return replace(grid, cost=watched(grid.cost))
    return replace(grid, occupancy=watched(grid.occupancy))
