"""The costs that the queue of costmap_2d's older inflation layers would make, for comparison."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.inflation_queue import queue_squares
from mapdeal.stages.cost_profile import CostProfile, raise_costs
from mapdeal.stages.exponential_cost import BaseCosts
from mapdeal.stages.layered_cost import MasterGrid, Spread, raise_around_seeds
from mapdeal.stages.obstacle_source import ObstacleSource


class QueueDifference(NamedTuple):
    """How costs of exact distances differ from those of the queue."""

    cells: int
    largest: int


def queue_difference(source: ObstacleSource, parameters: Mapping[str, Any]) -> QueueDifference:
    """Return how costs differ from those of ROS 1, and of Nav2 up to Kilted."""
    exact, queued = (
        costs_spread(source, parameters, spread).astype(np.int16)
        for spread in (raise_around_seeds, raise_by_queue)
    )
    difference = np.abs(exact - queued)
    return QueueDifference(int(np.count_nonzero(difference)), int(difference.max(initial=0)))


def raise_by_queue(profile: CostProfile, cost: NDArray[np.uint8]) -> None:
    """Raise costs, in place, by the distances to the cells that the queue reaches others from."""
    if profile.reach > 0:
        squares = queue_squares(profile.seeds_in(cost), profile.cells)
        spread = profile.table[np.minimum(squares, len(profile.table) - 1)]
        raise_costs(cost, spread, inflate_unknown=profile.inflate_unknown)


def costs_spread(
    source: ObstacleSource, parameters: Mapping[str, Any], spread: Spread
) -> NDArray[np.uint8]:
    """Return the costs of either model, spread by a function where the lookup is exact."""
    rows = slice(0, source.shape[0])
    if "layers" in parameters:
        layers, default_cost = parameters["layers"], parameters["default_cost"]
        spreads = {"nav2": raise_around_seeds, "exact": spread}
        grid = MasterGrid.of(source, layers, default_cost, lambda layer: spreads[layer.lookup])
        return grid.costs(rows)
    cost = BaseCosts.of(source, **parameters).costs(rows)
    if parameters["lookup"] == "nav2":
        spread = raise_around_seeds
    spread(CostProfile.of(source, **parameters), cost)
    return cost
