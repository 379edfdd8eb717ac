"""Costmaps and their layers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError, require
from mapdeal.grid import frame, values as map_values
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels import blocks, lookup
from mapdeal.kernels.arrays import Floats
from mapdeal.kernels.distance import squares_between_cells
from mapdeal.records import dataclass, field

UNIFORM_SHARE = 0.98  # of the open cells with one cost, above which a costmap is uniform
_NAMED_COSTS: dict[map_values.CostScale, dict[str, int]] = {
    "costmap2d": {
        "lethal": map_values.LETHAL_OBSTACLE,
        "inscribed": map_values.INSCRIBED_INFLATED_OBSTACLE,
        "unknown": map_values.NO_INFORMATION,
    },
    "occupancy": {"lethal": map_values.OCCUPIED, "unknown": map_values.UNKNOWN},
}
Metric = Literal["euclidean", "chebyshev"]  # straight, or along the longer axis
Formula = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # metres to costs
FARTHEST_CELLS = 2048  # up to here, in cells, a curve has every distance between cells
MOST_LISTED = 1000  # most distances of which a document lists every one
_MOST_FAR = 1001


@dataclass(frozen=True, eq=False, repr=False)
class Costmap(frame.ValueGrid):
    """A grid of costs.

    Parameters
    ----------
    cost : array_like, shape (H, W)
        uint8 on scale ``costmap2d`` (0 free .. 252, 253 inscribed, 254 lethal, 255 unknown);
        int8 on scale ``occupancy`` (-1 unknown, 0 free .. 100 lethal). Row 0 is the south.
        Kept as a read-only view. Of bool, True is lethal and False free.
    resolution, origin
        As for `OccupancyGrid`.
    scale : {'costmap2d', 'occupancy'}
        Scale of the costs.
    circumscribed_cost : int, optional
        Cost at the robot's circumscribed radius, if its shape is known. At or above this cost, a
        collision depends on the heading.

    Raises
    ------
    ParameterError
        If the costs do not fit the scale.
    """

    kind = "costmap"
    layer_names = ("cost",)
    cost: NDArray[np.uint8] | NDArray[np.int8]
    resolution: float
    origin: frame.Origin = (0.0, 0.0, 0.0)
    scale: map_values.CostScale = "costmap2d"
    circumscribed_cost: int | None = None

    def __post_init__(self) -> None:
        if self.scale not in ("costmap2d", "occupancy"):
            raise ParameterError("cost scale must be costmap2d or occupancy", got=self.scale)
        is_bytes = self.scale == "costmap2d"
        lethal = map_values.LETHAL_OBSTACLE if is_bytes else map_values.OCCUPIED
        cost = frame.as_layer(self.cost, np.uint8 if is_bytes else np.int8, "cost", true=lethal)
        self._freeze(cost=cost)
        if not blocks.is_lazy(cost) and not is_bytes:
            lowest, highest = ends = int(cost.min()), int(cost.max())
            is_on_scale = lowest >= map_values.UNKNOWN and highest <= map_values.OCCUPIED
            require(is_on_scale, "costs on the occupancy scale must lie in -1..100", got=ends)

    def _own_figures(self) -> frame.Figures:
        figures = figures_of_costs(blocks.counts_of(self.cost), self.scale)
        if self.scale == "costmap2d":
            figures["circumscribed_cost"] = self.circumscribed_cost
        return figures

    def _repr_parameters(self) -> Iterator[str]:
        yield f"scale {self.scale}"
        if self.circumscribed_cost is not None:
            yield f"circumscribed_cost {self.circumscribed_cost}"

    def _repr_values(self) -> Iterator[str]:
        figures = self._own_figures()
        figures["intermediate"] = figures["graded"]
        names = ("lethal", "inscribed", "intermediate", "free", "unknown")
        yield from (f"{figures[name]} {name}" for name in names if name in figures)

    def entries(self) -> dict[str, Any]:
        entries: dict[str, Any] = {"cost": self.cost, "cost_scale": self.scale}
        if self.circumscribed_cost is not None:
            entries["circumscribed_cost"] = np.int64(self.circumscribed_cost)
        return entries

    @property
    def value_range(self) -> tuple[int, int]:
        if self.scale == "costmap2d":
            return 0, map_values.NO_INFORMATION
        return map_values.UNKNOWN, map_values.OCCUPIED

    def _colours(self) -> dict[str, Any]:
        closed = {253: "cyan", 254: "black"} if self.scale == "costmap2d" else {100: "black"}
        highest = max(closed)
        values = np.linspace(0.05, 0.7, highest + 1)
        colours = [*frame.library("matplotlib").colormaps["inferno_r"](values)]
        for value, name in {0: "white", **closed}.items():
            colours[value] = frame.library("matplotlib.colors").to_rgba(name)
        cmap = frame.library("matplotlib.colors").ListedColormap(colours).with_extremes(bad="grey")
        return {"cmap": cmap, "vmin": 0, "vmax": highest}

    @property
    def unknown_value(self) -> int:
        """Value of an unknown cell: 255, or -1 on scale ``occupancy``."""
        return map_values.NO_INFORMATION if self.scale == "costmap2d" else map_values.UNKNOWN

    def to_occupancy(self) -> OccupancyGrid:
        """Return the costs as ROS publishes them in a ``nav_msgs/OccupancyGrid``.

        Examples
        --------
        >>> Costmap([[0, 1, 128, 253, 254, 255]], 0.05).to_occupancy().occupancy.tolist()
        [[0, 1, 50, 99, 100, -1]]
        """
        published: NDArray[Any] = self.cost
        if self.scale == "costmap2d":
            published = lookup.look_up(self.cost, map_values.occupancy_from_cost())
        return OccupancyGrid(published, self.resolution, self.origin)

    @classmethod
    def from_occupancy(cls, grid: OccupancyGrid) -> Costmap:
        """Create a costmap from a map as Nav2's ``Costmap2D(OccupancyGrid)`` does.

        A value v becomes round(2.54 v), and -1 becomes 255. So Nav2 reads costmap filter masks.

        Examples
        --------
        >>> grid = OccupancyGrid([[0, 1, 50, 99, 100, -1]], 0.05)
        >>> Costmap.from_occupancy(grid).cost.tolist()
        [[0, 3, 127, 251, 254, 255]]
        """
        return cls._of_map(grid, map_values.cost_from_occupancy())

    @classmethod
    def from_static_layer(
        cls,
        grid: OccupancyGrid,
        *,
        lethal_threshold: int = map_values.DEFAULT_LETHAL_THRESHOLD,
        trinary: bool = True,
        track_unknown: bool = True,
        inscribed_value: int | None = 99,
    ) -> Costmap:
        """Create a costmap from a map as costmap_2d's static layer does.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        lethal_threshold : int
            ``lethal_cost_threshold``, 0..100: values at or above it become 254.
        trinary : bool
            ``trinary_costmap``: whether lower values become 0 instead of their share of 254.
        track_unknown : bool
            ``track_unknown_space``: whether unknown cells become 255 instead of 0.
        inscribed_value : int, optional
            ``inscribed_obstacle_cost_value`` of Nav2 lyrical and newer: value that becomes 253;
            None for older releases and ROS 1, which lack this rule.

        Raises
        ------
        ParameterError
            If a threshold or value is out of range.

        Examples
        --------
        >>> grid = OccupancyGrid([[0, 50, 98, 99, 100, -1]], 0.05)
        >>> Costmap.from_static_layer(grid).cost.tolist()
        [[0, 0, 0, 253, 254, 255]]
        >>> Costmap.from_static_layer(grid, trinary=False, inscribed_value=None).cost.tolist()
        [[0, 127, 248, 251, 254, 255]]
        """
        table = map_values.static_layer_cost_from_occupancy(
            lethal_threshold=lethal_threshold, trinary=trinary, track_unknown=track_unknown,
            inscribed_value=inscribed_value,
        )  # fmt: skip
        return cls._of_map(grid, table)

    @classmethod
    def _of_map(cls, grid: OccupancyGrid, table: NDArray[np.uint8]) -> Costmap:
        is_map = isinstance(grid, OccupancyGrid)
        require(is_map, "must be an OccupancyGrid, as read_map returns", "grid", got=grid)
        return cls(lookup.look_up(grid.occupancy, table), grid.resolution, grid.origin)


def travel_weights(costmap: Costmap, multiplier: float, *, through_unknown: bool = False) -> Floats:
    """Return the cost of a cell's length by the byte of its cost, shape (256,); 0 if closed."""
    # ``getTraversalCost`` of Nav2's Smac 2D planner. NavFn gives unknown cells the highest cost
    # that is open, too.
    is_bytes = costmap.scale == "costmap2d"
    closed = map_values.INSCRIBED_INFLATED_OBSTACLE if is_bytes else map_values.INSCRIBED_PUBLISHED
    highest = closed - 1
    weights = np.zeros(256)
    weights[: highest + 1] = 1 + multiplier * np.arange(highest + 1) / highest
    if through_unknown:
        weights[costmap.unknown_value] = weights[highest]
    return weights


def figures_of_costs(counts: NDArray[np.int64], scale: map_values.CostScale) -> frame.Figures:
    figures: frame.Figures = {"cost_scale": scale, "free": int(counts[0])}
    figures |= {name: int(counts[cost]) for name, cost in _NAMED_COSTS[scale].items()}
    named = sum(figures[name] for name in ("free", *_NAMED_COSTS[scale]))
    common = _most_common(counts, scale)
    return {**figures, "graded": int(counts.sum()) - named, "most_common": common}


def _most_common(counts: NDArray[np.int64], scale: map_values.CostScale) -> frame.Figures | None:
    # Open cells are free or graded. On scale ``occupancy`` ROS publishes 99 for inscribed, but for
    # some models 99 is the highest graded cost. If nearly all cells but obstacles have it, it is
    # returned.
    closed_from = map_values.INSCRIBED_INFLATED_OBSTACLE
    if scale == "occupancy":
        closed_from = map_values.INSCRIBED_PUBLISHED
        not_lethal, highest = int(counts[: map_values.OCCUPIED].sum()), int(counts[closed_from])
        if highest > UNIFORM_SHARE * not_lethal:
            return {"cost": closed_from, "share": highest / not_lethal}
    open_ = counts[:closed_from]
    if not open_.any():
        return None
    return {"cost": int(open_.argmax()), "share": int(open_.max()) / int(open_.sum())}


@dataclass(frozen=True, eq=False, repr=False)
class CostCurve(map_values.Drawn):
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
    These are all distances in a costmap. `cost` includes lookups by rounded distances and the
    truncation to whole costs; `formula` does not.
    """

    resolution: float
    cells: NDArray[np.float64]
    cost: NDArray[np.integer[Any]]
    scale: map_values.CostScale = "costmap2d"
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
        """Return the cost at the nearest distance that occurs, given distances in cells."""
        reach = self.reach_cells  # the next distance beyond it has cost 0
        beyond = math.hypot(reach, 1.0) if self.metric == "euclidean" else reach + 1.0
        known, costs = np.append(self.cells, beyond), np.append(self.cost.astype(np.int64), 0)
        return costs[np.searchsorted((known[1:] + known[:-1]) / 2, cells)]

    def listed(self) -> NDArray[np.intp]:
        """Return the indices into `cells` that `document` lists."""
        if len(self.cells) <= MOST_LISTED:
            return np.arange(len(self.cells))
        changes = np.flatnonzero(np.diff(self.cost.astype(np.int64)))
        return np.unique(np.concatenate([[0], changes, changes + 1, [len(self.cells) - 1]]))

    def document(self) -> dict[str, Any]:
        """Return the curve as the JSON-serialisable dict that ``mapdeal cost --json`` prints."""
        listed = self.listed()
        columns = (column[listed].tolist() for column in (self.cells, self.distance, self.cost))
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
                for cells, metres, cost in zip(*columns, strict=True)
            ],
        }

    def _repr_parts(self) -> Iterator[str]:
        yield f"{self.resolution:.10g} m"
        for name in ("inscribed_radius", "circumscribed_radius", "inflation_radius"):
            if getattr(self, name) is not None:
                yield f"{name} {getattr(self, name):.6g} m"
        yield f"reach {self.reach_cells:.6g} cells, cost {self.cost_at_reach} there"


def squares_up_to(reach: float) -> NDArray[np.float64]:
    """Return the squared distances of a curve, in cells; see `CostCurve.cells`."""
    near = squares_between_cells(int(min(reach, FARTHEST_CELLS))).astype(np.float64)
    if reach <= FARTHEST_CELLS:
        return near
    far = np.unique(np.floor(np.linspace(FARTHEST_CELLS, reach, _MOST_FAR)[1:]))
    return np.concatenate([near, far**2])
