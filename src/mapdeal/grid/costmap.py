"""The costmap, in the two scales that ROS uses for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Framed, Origin, as_layer
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import (
    INSCRIBED_INFLATED_OBSTACLE,
    LETHAL_OBSTACLE,
    NO_INFORMATION,
    OCCUPIED,
    UNKNOWN,
    CostScale,
)


@dataclass(frozen=True, eq=False)
class Costmap(Framed):
    """A grid of costs.

    Parameters
    ----------
    cost : array_like, shape (H, W)
        uint8 on scale ``costmap2d`` (0 free .. 252, 253 inscribed, 254 lethal, 255 unknown);
        int8 on scale ``occupancy`` (-1 unknown, 0 free .. 100 lethal). Row 0 is the south.
        Kept as a read-only view.
    resolution : float
        Side of a cell, metres.
    origin : sequence of float
        x, y (metres) and yaw (radians) of the outer corner of cell (0, 0).
    scale : {'costmap2d', 'occupancy'}
        Which of the two the costs are on.
    circumscribed_cost : int, optional
        The cost at the robot's circumscribed radius, where a robot shape is known: from there
        on upwards a collision depends on the heading.

    Raises
    ------
    ParameterError
        If the costs do not fit the scale.
    """

    cost: NDArray[np.uint8] | NDArray[np.int8]
    resolution: float
    origin: Origin = (0.0, 0.0, 0.0)
    scale: CostScale = "costmap2d"
    circumscribed_cost: int | None = None

    def __post_init__(self) -> None:
        if self.scale not in ("costmap2d", "occupancy"):
            rule = "cost scale must be costmap2d or occupancy"
            raise ParameterError(rule, got=self.scale)
        cost = as_layer(self.cost, np.uint8 if self.scale == "costmap2d" else np.int8, "cost")
        self._freeze(cost=cost)
        if self.scale == "occupancy" and (cost.min() < UNKNOWN or cost.max() > 100):
            rule = "costs on the occupancy scale must lie in -1..100"
            raise ParameterError(rule, got=(int(cost.min()), int(cost.max())))

    @property
    def _layer(self) -> NDArray[Any]:
        return self.cost

    def to_occupancy(self) -> OccupancyGrid:
        """Return the costs as ROS would publish them in a ``nav_msgs/OccupancyGrid``."""
        occupancy = self.cost if self.scale == "occupancy" else published_costs()[self.cost]
        return OccupancyGrid(occupancy.astype(np.int8, copy=False), self.resolution, self.origin)


def published_costs() -> NDArray[np.int8]:
    """Return the value that costmap_2d publishes for each of the 256 costs.

    Returns
    -------
    numpy.ndarray of int8, shape (256,)
        Indexed by the cost: 0 -> 0, 1..252 -> 1..98, 253 -> 99, 254 -> 100, 255 -> -1.

    References
    ----------
    ``costmap_2d_publisher.cpp`` of both ROS navigation stacks: 1 + 97 (cost - 1) / 251 in
    integer division. Not invertible.

    Examples
    --------
    >>> published_costs()[[0, 1, 4, 128, 252, 253, 254, 255]].tolist()
    [0, 1, 2, 50, 98, 99, 100, -1]
    """
    table = 1 + (97 * (np.arange(256) - 1)) // 251
    table[0] = 0
    table[INSCRIBED_INFLATED_OBSTACLE] = 99
    table[LETHAL_OBSTACLE] = OCCUPIED
    table[NO_INFORMATION] = UNKNOWN
    return table.astype(np.int8)
