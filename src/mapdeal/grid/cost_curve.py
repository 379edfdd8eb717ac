"""Cost by distance from the nearest obstacle, for a cost model on a map."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.display import Drawn
from mapdeal.grid.values import CostScale
from mapdeal.kernels.distance import squares_between_cells
from mapdeal.records import dataclass

Metric = Literal["euclidean", "chebyshev"]
"""How distances between cells are measured: along the line, or along the longer axis alone."""

Formula = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Returns costs, not truncated, of distances in metres."""

FARTHEST_CELLS = 2048
"""Cells up to which a curve has every distance that occurs."""

MOST_LISTED = 1000
"""Distances up to which a document lists every one."""

_MOST_FAR = 1001


@dataclass(frozen=True, eq=False, repr=False)
class CostCurve(Drawn):
    """Cost by distance from the nearest obstacle, for one cell size.

    Parameters
    ----------
    resolution : float
        Side of a cell, metres.
    cells : numpy.ndarray of float64, shape (N,)
        Every distance between cell centres that occurs on a grid, in increasing order, from 0 at
        the obstacle itself to the range of the costs, cells. Beyond `FARTHEST_CELLS` only some
        whole numbers of cells are included, the range among them.
    cost : numpy.ndarray of uint8 or int8, shape (N,)
        Cost of a known cell at each distance, on `scale`. It is 0 beyond the range.
    scale : {'costmap2d', 'occupancy'}
        Scale of the costs.
    metric : {'euclidean', 'chebyshev'}
        Distance metric.
    inscribed_radius, circumscribed_radius : float, optional
        Radii of the robot, metres: the first if the costs depend on it, the second if known.
    circumscribed_cost : int, optional
        Cost at the circumscribed radius; 0 if that is beyond the inflation radius.
    inflation_radius : float, optional
        Requested range of the costs, before rounding up to whole cells, metres.
    marks : tuple of (str, float)
        Other notable distances, by name, metres.
    note : str
        Remark on how distances become costs, empty if none is needed.
    formula : callable, optional
        Costs as a continuous function of the distance in metres, if the model has one.

    Notes
    -----
    No other distances occur in a costmap. Lookups by rounded distances and truncation to whole
    costs are included in `cost`, but not in `formula`.
    """

    resolution: float
    cells: NDArray[np.float64]
    cost: NDArray[np.integer[Any]]
    scale: CostScale = "costmap2d"
    metric: Metric = "euclidean"
    inscribed_radius: float | None = None
    circumscribed_radius: float | None = None
    circumscribed_cost: int | None = None
    inflation_radius: float | None = None
    marks: tuple[tuple[str, float], ...] = ()
    note: str = ""
    formula: Formula | None = field(default=None, repr=False)

    @property
    def distance(self) -> NDArray[np.float64]:
        """Distances, metres, shape (N,)."""
        return self.cells * self.resolution

    @property
    def reach_cells(self) -> float:
        """Range of the costs, cells; a cell at exactly this distance is still within it."""
        return float(self.cells[-1])

    @property
    def reach(self) -> float:
        """Range of the costs, metres."""
        return self.reach_cells * self.resolution

    @property
    def cost_at_reach(self) -> int:
        """Cost at the end of the range; beyond it, costs are 0."""
        return int(self.cost[-1])

    @property
    def end(self) -> float:
        """Largest distance with a cost above 0, metres."""
        positive = np.flatnonzero(self.cost > 0)
        return float(self.cells[positive[-1]] * self.resolution) if len(positive) else 0.0

    def cost_near(self, cells: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the cost at the nearest distance that occurs, given distances in cells.

        The next distance beyond the range is the hypotenuse of the range and one cell, or for the
        chebyshev metric one cell more.
        """
        reach = self.reach_cells
        beyond = math.hypot(reach, 1.0) if self.metric == "euclidean" else reach + 1.0
        known = np.append(self.cells, beyond)
        costs = np.append(self.cost.astype(np.int64), 0)
        near: NDArray[np.int64] = costs[np.searchsorted((known[1:] + known[:-1]) / 2, cells)]
        return near

    def listed(self) -> NDArray[np.intp]:
        """Return the indices into `cells` that `document` lists.

        These are all of them or, if there are more than `MOST_LISTED`, the first and the last
        distance of each cost: all distances in between have the same cost.
        """
        if len(self.cells) <= MOST_LISTED:
            return np.arange(len(self.cells))
        changes = np.flatnonzero(np.diff(self.cost.astype(np.int64)))
        return np.unique(np.concatenate([[0], changes, changes + 1, [len(self.cells) - 1]]))

    def document(self) -> dict[str, Any]:
        """Return the curve as the JSON-serialisable dict that ``mapdeal cost --json`` prints."""
        listed = self.listed()
        entries = zip(
            self.cells[listed].tolist(), self.distance[listed].tolist(), self.cost[listed].tolist(),
            strict=True,
        )  # fmt: skip
        return {
            "cost_scale": self.scale,
            "metric": self.metric,
            "inscribed_radius": self.inscribed_radius,
            "circumscribed_radius": self.circumscribed_radius,
            "circumscribed_cost": self.circumscribed_cost,
            "inflation_radius": self.inflation_radius,
            "marks": dict(self.marks),
            "reach_cells": self.reach_cells,
            "reach_m": self.reach,
            "cost_at_reach": self.cost_at_reach,
            "distances": len(self.cells),
            "every_distance": len(listed) == len(self.cells),
            "curve": [
                {"cells": cells, "distance_m": metres, "cost": cost}
                for cells, metres, cost in entries
            ],
        }

    def _told(self) -> Iterator[str]:
        yield f"{self.resolution:.10g} m"
        for name in ("inscribed_radius", "circumscribed_radius", "inflation_radius"):
            if getattr(self, name) is not None:
                yield f"{name} {getattr(self, name):.6g} m"
        yield f"reach {self.reach_cells:.6g} cells, cost {self.cost_at_reach} there"


def squares_up_to(reach: float) -> NDArray[np.float64]:
    """Return the squared distances of a curve, in cells; see `CostCurve.cells`.

    Examples
    --------
    >>> squares_up_to(2).tolist()
    [0.0, 1.0, 2.0, 4.0]
    """
    near = squares_between_cells(int(min(reach, FARTHEST_CELLS))).astype(np.float64)
    if reach <= FARTHEST_CELLS:
        return near
    far = np.unique(np.floor(np.linspace(FARTHEST_CELLS, reach, _MOST_FAR)[1:]))
    return np.concatenate([near, far**2])
