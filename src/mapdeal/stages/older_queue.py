"""The distances that the queue of costmap_2d's older inflation layers arrives at.

They walk from cell to cell, so a few cells are reached from an obstacle that is not the nearest.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.distance import unreachable
from mapdeal.stages.cost import ObstacleSource
from mapdeal.stages.cost_profile import CostProfile, raise_costs
from mapdeal.stages.exponential_cost import BaseCosts
from mapdeal.stages.layered_cost import MasterGrid, Spread, raise_around_seeds

Cells = NDArray[np.int64]
"""Indices of cells, row by row."""


def queue_squares(seeds: NDArray[np.bool_], reach: int) -> NDArray[np.int64]:
    """Return each cell's squared distance to the seed that the queue reaches it from."""
    # Cells wait in bins of the squared distance to their seed. Bins are emptied from the nearest
    # on; the first entry of a cell counts, and puts the cell's neighbours into the bins of their
    # distance to the same seed: left, down, right, up. A neighbour is never in its cell's own bin,
    # since the square changes by an odd number, so that a bin can be taken as a whole. Entries for
    # bins that are done already are lost, as there.
    # From ``updateCosts`` and ``enqueue`` in ``inflation_layer.cpp`` of ROS 1's costmap_2d, and in
    # ``legacy_inflation_layer.cpp`` of nav2_costmap_2d.
    queue = _Queue(seeds.shape, reach * reach)
    found = np.flatnonzero(seeds)
    queue.put(0, found, found)
    while queue.waiting:
        square = heapq.heappop(queue.waiting)
        cells, sources = queue.first_of(square)
        queue.squares[cells] = square
        queue.put_neighbours(square, cells, sources)
    return queue.squares.reshape(seeds.shape)


class _Queue:
    """Bins of cells and of the seeds that they were reached from."""

    def __init__(self, shape: tuple[int, int], limit: int) -> None:
        self.height, self.width = shape
        self.limit = limit
        self.squares = np.empty(self.height * self.width, dtype=np.int64)
        self.unset = unreachable(self.squares)
        self.squares[:] = self.unset
        self.waiting: list[int] = []
        self._bins: dict[int, list[tuple[Cells, Cells]]] = {}
        self._first = np.empty(self.squares.size, dtype=np.int64)

    def put(self, square: int, cells: Cells, sources: Cells) -> None:
        if square not in self._bins:
            heapq.heappush(self.waiting, square)
            self._bins[square] = []
        self._bins[square].append((cells, sources))

    def first_of(self, square: int) -> tuple[Cells, Cells]:
        """Empty a bin; of the cells that have no distance yet, return the first entry each."""
        parts = self._bins.pop(square)
        cells, sources = (np.concatenate(some) for some in zip(*parts, strict=True))
        fresh = self.squares[cells] == self.unset
        cells, sources = cells[fresh], sources[fresh]
        places = np.arange(len(cells))
        self._first[cells[::-1]] = places[::-1]  # of equal indices the last one stays
        first = self._first[cells] == places
        return cells[first], sources[first]

    def put_neighbours(self, square: int, cells: Cells, sources: Cells) -> None:
        """Add the neighbours of cells that have just been reached, each to its bin."""
        row, col = (one[:, np.newaxis] for one in np.divmod(cells, self.width))
        source_row, source_col = (one[:, np.newaxis] for one in np.divmod(sources, self.width))
        rows, cols = row + np.array([0, -1, 0, 1]), col + np.array([-1, 0, 1, 0])
        found = (rows - source_row) ** 2 + (cols - source_col) ** 2
        taken = (found > square) & (found <= self.limit)
        taken &= (rows >= 0) & (rows < self.height) & (cols >= 0) & (cols < self.width)
        neighbours = rows * self.width + cols
        origins = np.broadcast_to(sources[:, np.newaxis], found.shape)[taken]
        found, neighbours = found[taken], neighbours[taken]
        is_open = self.squares[neighbours] == self.unset
        found, neighbours, origins = found[is_open], neighbours[is_open], origins[is_open]
        for bin_square in np.unique(found).tolist():
            some = found == bin_square
            self.put(bin_square, neighbours[some], origins[some])


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
