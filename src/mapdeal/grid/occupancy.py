"""The occupancy grid: what a map file holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Framed, Origin, as_layer
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, UNKNOWN


@dataclass(frozen=True, eq=False)
class OccupancyGrid(Framed):
    """A grid of occupancy values, as ``nav_msgs/OccupancyGrid``.

    Parameters
    ----------
    occupancy : array_like of int8, shape (H, W)
        -1 unknown, 0 free, 100 occupied, 1..99 in between. Row 0 is the south. Kept as a
        read-only view: do not change the array behind it.
    resolution : float
        Side of a cell, metres.
    origin : sequence of float
        x, y (metres) and yaw (radians) of the outer corner of cell (0, 0).

    Raises
    ------
    ParameterError
        If a value lies outside -1..100, or the geometry is not finite.

    Examples
    --------
    >>> grid = OccupancyGrid([[0, 100, -1]], resolution=0.05, origin=(1.0, 2.0, 0.0))
    >>> grid.shape, grid.occupied().tolist()
    ((1, 3), [[False, True, False]])
    """

    occupancy: NDArray[np.int8]
    resolution: float
    origin: Origin = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        occupancy = as_layer(self.occupancy, np.int8, "occupancy")
        self._freeze(occupancy=occupancy)
        if occupancy.min() < UNKNOWN or occupancy.max() > 100:
            rule = "occupancy must lie in -1..100"
            raise ParameterError(rule, got=(int(occupancy.min()), int(occupancy.max())))

    @property
    def _layer(self) -> NDArray[Any]:
        return self.occupancy

    def occupied(self, lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD) -> NDArray[np.bool_]:
        """Return the mask of obstacle cells, those of at least `lethal_threshold`."""
        occupied: NDArray[np.bool_] = self.occupancy >= lethal_threshold
        return occupied

    def unknown(self) -> NDArray[np.bool_]:
        """Return the mask of unknown cells."""
        unknown: NDArray[np.bool_] = self.occupancy == UNKNOWN
        return unknown
