"""The signed Euclidean distance field (ESDF)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Origin
from mapdeal.grid.framed import Framed, as_layer
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import DEFAULT_LETHAL_THRESHOLD, UNKNOWN, Convention, UnknownPolicy


@dataclass(frozen=True, eq=False)
class DistanceField(Framed):
    """A signed distance field together with the map that it was made from.

    Parameters
    ----------
    distance : array_like of float32, shape (H, W)
        Signed distance, metres: positive in free space, negative or 0 inside obstacles,
        +inf where the map has no obstacle, -inf where it has nothing else.
    occupancy : array_like of int8, shape (H, W)
        The map that the distances belong to.
    resolution : float
        Side of a cell, metres.
    origin : sequence of float
        x, y (metres) and yaw (radians) of the outer corner of cell (0, 0).
    convention : {'seed', 'center', 'border'}
        Which points the distances are between, see `mapdeal.esdf`.
    strength : float
        Factor that the positive distances were multiplied by.
    max_distance : float, optional
        Bound in metres that both signs were clipped to, before `strength`.
    lethal_threshold : int
        Occupancy from which a cell counts as an obstacle.
    unknown : {'free', 'occupied'}
        What unknown cells count as.
    """

    distance: NDArray[np.float32]
    occupancy: NDArray[np.int8]
    resolution: float
    origin: Origin = (0.0, 0.0, 0.0)
    convention: Convention = "seed"
    strength: float = 1.0
    max_distance: float | None = None
    lethal_threshold: int = DEFAULT_LETHAL_THRESHOLD
    unknown: UnknownPolicy = "free"

    def __post_init__(self) -> None:
        if self.convention not in ("seed", "center", "border"):
            raise ParameterError("convention must be seed, center or border", got=self.convention)
        if self.unknown not in ("free", "occupied"):
            raise ParameterError("unknown must be free or occupied", got=self.unknown)
        if not 1e-6 <= self.strength <= 1e6:
            raise ParameterError("strength must lie between 1e-6 and 1e6", got=self.strength)
        if self.max_distance is not None and not 0 < self.max_distance < math.inf:
            raise ParameterError("max_distance must be finite and above 0", got=self.max_distance)
        if not 1 <= self.lethal_threshold <= 100:
            rule = "lethal_threshold must lie between 1 and 100"
            raise ParameterError(rule, got=self.lethal_threshold)
        distance = as_layer(self.distance, np.float32, "distance")
        if distance.size and np.isnan(distance.min()):  # min hands nan on
            raise ParameterError("distance must not hold nan")
        self._freeze(
            distance=distance,
            occupancy=as_layer(self.occupancy, np.int8, "occupancy"),
        )

    @property
    def _layer(self) -> NDArray[Any]:
        return self.distance

    @property
    def grid(self) -> OccupancyGrid:
        """The map that the field was made from."""
        return OccupancyGrid(self.occupancy, self.resolution, self.origin)

    def obstacles(self) -> NDArray[np.bool_]:
        """Return the mask of cells that the field counts as obstacles."""
        occupied = self.occupancy >= self.lethal_threshold
        if self.unknown == "occupied":
            occupied |= self.occupancy == UNKNOWN
        return occupied
