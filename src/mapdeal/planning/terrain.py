"""Weights for crossing each cell of a costmap."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.frame import Point
from mapdeal.grid.reaching import Cell, cell_of_point, nearest_open_text
from mapdeal.grid.values import INSCRIBED_INFLATED_OBSTACLE, LETHAL_OBSTACLE, OCCUPIED
from mapdeal.kernels.distance import signed_distance
from mapdeal.records import dataclass

FIELD_RANGE = 2.0
"""Metres from obstacles at which the field no longer weighs: the range of its metric view."""

_LARGEST_FACTOR = 1e6

_AT_CENTRE = 1e-6
"""In cells: more than what rounding moves a centre by."""

_LARGEST_TOLD_APART = 1 << 20
"""Squares of cells up to which distances of float32 tell neighbouring ones apart."""

Place = tuple[float, float]


@dataclass(frozen=True)
class Measures:
    """Length, cost and clearance of a route; see `Route`."""

    length: float
    cost: float
    min_clearance: float
    mean_clearance: float


NO_WAY = Measures(math.nan, math.nan, math.nan, math.nan)


@dataclass(frozen=True, eq=False)
class Terrain:
    """A costmap as routes see it."""

    costmap: Costmap
    weights: NDArray[np.float64]
    field: DistanceField

    @classmethod
    def of(
        cls,
        costmap: Costmap,
        *,
        cost_travel_multiplier: float = 2.0,
        field_weight: float = 0.0,
        through_unknown: bool = False,
    ) -> Terrain:
        """Return the terrain of a costmap; see `shortest_route` for its options."""
        # ``getTraversalCost`` of Nav2's Smac 2D planner for the multiplier and its default. NavFn
        # gives unknown cells the highest cost that is open, too.
        if not isinstance(costmap, Costmap):
            rule = "takes a Costmap; exponential_cost makes one of a map"
            raise ParameterError(rule, source="route", got=type(costmap).__name__)
        check_factor("cost_travel_multiplier", cost_travel_multiplier)
        check_factor("field_weight", field_weight)
        lethal = LETHAL_OBSTACLE if costmap.scale == "costmap2d" else OCCUPIED
        obstacles = costmap.cost == lethal
        resolution, origin = costmap.resolution, costmap.origin
        distance = signed_distance(obstacles, scale=resolution)
        occupancy = np.where(obstacles, OCCUPIED, 0).astype(np.int8)
        field = DistanceField(distance, occupancy, resolution, origin, convention="center")
        by_cost = _weights_by_cost(costmap, cost_travel_multiplier, through_unknown)
        terrain = cls(costmap, by_cost[costmap.cost.view(np.uint8)], field)
        return replace(terrain, weights=terrain.weights_near_obstacles(field_weight))

    def weights_near_obstacles(self, field_weight: float) -> NDArray[np.float64]:
        """Return the weights of open cells and what nearness to obstacles adds, shape (H, W)."""
        if check_factor("field_weight", field_weight) == 0:
            return self.weights
        weights = self.nearness()
        weights *= field_weight
        weights += self.weights
        weights[self.weights <= 0] = 0
        return weights

    def nearness(self) -> NDArray[np.float64]:
        """Return how near each cell is to an obstacle, shape (H, W): 1 at it, 0 from 2 m on."""
        near: NDArray[np.float64] = self.field.distance / np.float64(FIELD_RANGE)
        np.clip(near, 0, 1, out=near)
        return np.subtract(1, near, out=near)

    def is_open(self, cell: Cell) -> bool:
        return self.costmap.frame.holds(cell) and bool(self.weights[cell] > 0)

    def allows_step(self, cell: Cell, following: Cell) -> bool:
        """Return whether a neighbour is open, and not diagonally between two closed cells."""
        if not self.is_open(following):
            return False
        beside = ((cell[0], following[1]), (following[0], cell[1]))
        return any(self.is_open(side) for side in beside)

    def is_clear(self, start: Place, end: Place) -> bool:
        """Return whether a straight way is in open cells, never between two closed at a corner."""
        cells = list(_cells_on(start, end))
        return self.is_open(cells[0]) and all(
            self.allows_step(cell, following) for cell, following in pairwise(cells)
        )

    def open_cell_of(self, point: Point, name: str) -> Cell:
        frame = self.costmap.frame
        cell = cell_of_point(frame, point, name)
        if not self.is_open(cell):
            cost = int(self.costmap.cost[cell])
            what = "unknown" if cost == self.costmap.unknown_value else f"cost {cost}"
            rule = f"lies in a closed cell ({what})"
            hint = nearest_open_text(frame, self.weights > 0, cell)
            raise ParameterError(rule, place=name, got=point, hint=hint)
        return cell

    def measured(self, points_xy: NDArray[np.float64]) -> Measures:
        pieces = np.hypot(*np.diff(points_xy, axis=0).T)
        cells = self.costmap.frame.clamped_rowcol_from_xy(points_xy)[1:]
        length, cost = float(pieces.sum()), float(pieces @ self.weights[cells[:, 0], cells[:, 1]])
        clearances = self.clearances_of(points_xy)
        mean = float(clearances[0])
        if length > 0 and math.isfinite(mean):
            mean = float(pieces @ (clearances[:-1] + clearances[1:]) / (2 * length))
        return Measures(length, cost, float(clearances.min()), mean)

    def clearances_of(self, points_xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distances of points in open cells to the nearest centre of a lethal cell."""
        # Exact, metres, shape (N,); +inf if there is no lethal cell. The field knows them of the
        # centres of cells; from another point it says how far away one has to look.
        frame, resolution = self.costmap.frame, self.costmap.resolution
        places = frame.continuous_rowcol_from_xy(points_xy)
        cells = frame.clamped_rowcol_from_xy(points_xy)
        at_centre = self.field.distance[cells[:, 0], cells[:, 1]].astype(np.float64) / resolution
        squares = np.rint(at_centre**2)
        distances = np.where(squares < _LARGEST_TOLD_APART, np.sqrt(squares), at_centre)
        is_between = (np.abs(places - cells - 0.5) > _AT_CENTRE).any(axis=1)
        for index in np.flatnonzero(is_between & np.isfinite(at_centre)).tolist():
            reach = math.ceil(at_centre[index] + 1.0)
            distances[index] = self._nearest_lethal(places[index], cells[index], reach)
        return distances * resolution

    def _nearest_lethal(
        self, place: NDArray[np.float64], cell: NDArray[np.int64], reach: int
    ) -> float:
        """Return the distance in cells of a place to a lethal cell's centre, within a reach."""
        first = np.maximum(cell - reach, 0)
        rows, cols = (slice(a, b) for a, b in zip(first, cell + reach + 1, strict=True))
        centres = np.argwhere(self.field.occupancy[rows, cols] == OCCUPIED) + first + 0.5
        return float(np.hypot(*(centres - place).T).min())


def check_factor(name: str, value: float) -> float:
    """Return a factor that is allowed, 0 to 1e6."""
    if not 0 <= value <= _LARGEST_FACTOR:
        rule = f"must lie between 0 and {_LARGEST_FACTOR:g}"
        raise ParameterError(rule, place=name, got=value)
    return value


def _cells_on(start: Place, end: Place) -> Iterator[Cell]:
    """Yield the cells that a straight piece of way passes, one after the other."""
    way = (end[0] - start[0], end[1] - start[1])
    shares = {0.0, 1.0}
    for from_, along in zip(start, way, strict=True):
        if along:
            low, high = sorted((from_, from_ + along))
            shares |= {
                (edge - from_) / along for edge in range(math.ceil(low), math.floor(high) + 1)
            }
    last = None
    for before, after in pairwise(sorted(share for share in shares if 0 <= share <= 1)):
        middle = (before + after) / 2
        cell = (math.floor(start[0] + middle * way[0]), math.floor(start[1] + middle * way[1]))
        if cell != last:
            yield cell
        last = cell


def _weights_by_cost(
    costmap: Costmap, multiplier: float, through_unknown: bool
) -> NDArray[np.float64]:
    """Return the weight of each byte that a cost can be."""
    highest = (INSCRIBED_INFLATED_OBSTACLE if costmap.scale == "costmap2d" else OCCUPIED - 1) - 1
    weights = np.zeros(256)
    weights[: highest + 1] = 1 + multiplier * np.arange(highest + 1) / highest
    if through_unknown:
        weights[costmap.unknown_value] = weights[highest]
    return weights
