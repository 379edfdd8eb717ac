"""A route through a map."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.display import OneLine, count_text, numbers_text

Method = Literal["astar", "descent"]


@dataclass(frozen=True, eq=False, repr=False)
class Route(OneLine):
    """A route from a start to a goal.

    Parameters
    ----------
    method : {'astar', 'descent'}
        Search method.
    reached : bool
        Whether the last point is the goal.
    start, goal : tuple of float
        x and y in the map frame, metres.
    points_xy : numpy.ndarray of float64, shape (N, 2)
        Points of the route in the map frame, beginning at the start, metres; empty if there is no
        route.
    length : float
        Length of the route, metres.
    cost : float
        Sum over the segments of their length in metres times the weight of the cell in which they
        end.
    min_clearance : float
        Smallest distance from a point of the route to the centre of an obstacle cell, metres;
        +inf without obstacles, nan without points.
    local_minimum : tuple of float, optional
        Local minimum of the potential, other than the goal, in which a descent ended.
    mean_clearance : float
        Mean distance to obstacles along the route, metres: each segment counts with its length
        and the mean clearance of its two ends; +inf without obstacles, nan without points.
    expanded : int, optional
        Number of cells that the search expanded; None for a descent.
    optimal : bool
        Whether the search guarantees the lowest cost.
    """

    method: Method
    reached: bool
    start: tuple[float, float]
    goal: tuple[float, float]
    points_xy: NDArray[np.float64]
    length: float
    cost: float
    min_clearance: float
    local_minimum: tuple[float, float] | None = None
    mean_clearance: float = math.nan
    expanded: int | None = None
    optimal: bool = False

    def __post_init__(self) -> None:
        points = np.asarray(self.points_xy, dtype=np.float64).reshape(-1, 2).view()
        points.flags.writeable = False
        object.__setattr__(self, "points_xy", points)

    def _told(self) -> Iterator[str]:
        yield self.method
        yield "reached" if self.reached else "not reached"
        yield f"{numbers_text(self.start)} to {numbers_text(self.goal)}"
        if len(self.points_xy):
            yield count_text(len(self.points_xy), "point")
            yield f"{self.length:.6g} m"
            yield f"cost {self.cost:.6g}"
            yield f"clearance {self.min_clearance:.4g} m"
        if self.local_minimum is not None:
            yield f"local minimum at {numbers_text(self.local_minimum)}"
