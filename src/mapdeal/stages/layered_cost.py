"""Stage ``cost``, model ``layers``: the layers of a costmap, applied in order."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import AT_LEAST_0, COST, METRES, Condition, FromRobot, Parameters
from mapdeal.grid.costmap import (
    CostCurve,
    Costmap,
    CostmapLayer,
    CostmapLayers,
    DenoiseLayer,
    InflationLayer,
    StaticLayer,
)
from mapdeal.grid.field import DistanceField
from mapdeal.grid.frame import Framed
from mapdeal.grid.values import (
    FREE_SPACE,
    INSCRIBED_INFLATED_OBSTACLE,
    NO_INFORMATION,
    OCCUPIED,
    UNKNOWN,
    static_layer_cost_from_occupancy,
)
from mapdeal.kernels.blocks import made_by_windows
from mapdeal.kernels.components import drop_small_groups
from mapdeal.kernels.distance import unreachable
from mapdeal.kernels.lookup import look_up, set_where
from mapdeal.kernels.threads import for_rows
from mapdeal.stages.cost import ObstacleSource, cost_model, refuse_view, warn_of_strength
from mapdeal.stages.exponential_cost import (
    BaseCosts,
    CostProfile,
    advice_on,
    inflation_curve,
    layer_of,
    warn_of_radii,
)
from mapdeal.stages.structured import LayerList

_OF_COSTMAP_2D = (StaticLayer(), InflationLayer())
_OF_EMPTY_COSTMAP = Condition("0 or 255", lambda value: value in (FREE_SPACE, NO_INFORMATION))

Master = NDArray[np.uint8]
Spread = Callable[[CostProfile, Master], None]
"""Raises costs, in place, around the cells that they spread from."""


def _advice(parameters: Parameters, cost: int) -> str:
    inflation = [one for one in parameters["layers"] if isinstance(one, InflationLayer)]
    return advice_on(cost, inflation[-1]) if inflation else "no inflation layer spreads costs"


def _of_layers(layers: CostmapLayers) -> dict[str, object]:
    reaches = any(isinstance(one, InflationLayer) for one in layers.that_count)
    return {
        "layers": layers.layers,
        "default_cost": layers.default_cost,
        "circumscribed_radius": layers.circumscribed_radius if reaches else None,
    }


def _curve(source: Framed, parameters: Parameters) -> CostCurve | None:
    layers = CostmapLayers(parameters["layers"]).that_count
    static = [number for number, layer in enumerate(layers) if isinstance(layer, StaticLayer)]
    if not static:  # there is no obstacle to be at a distance from
        return None
    return inflation_curve(
        [layer for layer in layers[static[0] :] if isinstance(layer, InflationLayer)],
        source.resolution,
        circumscribed_radius=parameters["circumscribed_radius"],
    )


def _more_memory(parameters: Parameters) -> float:
    """Return the bytes of each cell that labels of groups take, with their sizes and masks."""
    layers = CostmapLayers(parameters["layers"]).that_count
    return 14.0 if any(isinstance(one, DenoiseLayer) for one in layers) else 0.0


def _radius_in(parameters: Parameters) -> tuple[str, float]:
    layers = (one for one in parameters["layers"] if isinstance(one, InflationLayer))
    return "inscribed_radius", max((one.inscribed_radius for one in layers), default=0.0)


@cost_model(
    "layers",
    title=lambda given: f"cost, {', '.join(one.name for one in given['layers']) or 'no layers'}",
    memory=3.0,
    more_memory=_more_memory,
    advice=_advice,
    when_closed="lower inscribed_radius, or the radius of inflate",
    of_layers=_of_layers,
    curve=_curve,
    radius_in=_radius_in,
)
def layered_cost(
    source: ObstacleSource,
    *,
    layers: LayerList = _OF_COSTMAP_2D,
    default_cost: Annotated[int, _OF_EMPTY_COSTMAP, COST] = FREE_SPACE,
    circumscribed_radius: Annotated[float, AT_LEAST_0, METRES, FromRobot] | None = None,
) -> Costmap:
    """Compute the costs of a stack of costmap layers, applied in order.

    Parameters
    ----------
    source : OccupancyGrid or DistanceField
        The map that all static layers receive, or its distance field.
    layers : list of layers
        Static, denoise and inflation layers, the lowest first.
    default_cost : int
        Cost of an empty costmap, 0 or 255. ROS uses 255 with track_unknown_space.
    circumscribed_radius : float, optional
        Distance beyond which the robot cannot collide, metres. It only sets `circumscribed_cost`,
        and a robot's shape defines it.

    Returns
    -------
    Costmap
        Costs on scale ``costmap2d``; without layers, `default_cost` everywhere.

    Raises
    ------
    ParameterError
        If a layer is malformed.

    Warns
    -----
    MapdealWarning
        If an inscribed radius is larger than the inflation radius of its layer, the circumscribed
        radius is larger than the inflation radius of the last layer, or the field has a strength
        other than 1.

    Notes
    -----
    A static layer replaces all costs below it. With ``use_maximum`` it only raises them: its own
    unknown cells have no effect, and unknown costs below it are replaced. An inflation layer
    spreads costs, in place, around the cells that are 254 after the layers below it. Lengths are
    counted in cells of the float32 resolution of a map message, without a tolerance. A denoise
    layer frees the groups of fewer than ``minimal_group_size`` cells that are 253 or 254; unknown
    cells belong to them where `default_cost` is not 255.

    Unknown cells that a field counts as obstacles have value 100 for the layers; the field's
    distances are not used.

    References
    ----------
    ``updateWithTrueOverwrite`` and ``updateWithMax`` in ``costmap_layer.cpp``, ``interpretValue``
    in ``static_layer.cpp``, ``updateCosts`` in ``inflation_layer.cpp`` and ``denoise_layer.cpp`` of
    nav2_costmap_2d.

    Examples
    --------
    >>> from mapdeal.grid.occupancy import OccupancyGrid
    >>> grid = OccupancyGrid([[100, 0, 0, -1]], resolution=0.5)
    >>> inflation = {"inflation_radius": 1.0, "cost_scaling_factor": 1.0}
    >>> layered_cost(grid, layers=["static", {"inflation": inflation}]).cost.tolist()
    [[254, 152, 92, 255]]
    """
    refuse_view(source)
    warn_of_strength(source, "layers")
    for layer in layers:
        if isinstance(layer, InflationLayer):
            warn_of_radii(layer)
    grid = _MasterGrid(source, layers, default_cost)
    cost = made_by_windows(source.occupancy, np.uint8, grid.costs, halo=grid.halo)
    profiles = [one for one in grid.laid if isinstance(one, CostProfile)]
    return Costmap(
        cost,
        source.resolution,
        source.origin,
        circumscribed_cost=profiles[-1].cost_at(circumscribed_radius) if profiles else None,
    )


class _MasterGrid:
    """The layers over a map that have an effect."""

    def __init__(
        self,
        source: ObstacleSource,
        layers: Sequence[CostmapLayer],
        default_cost: int,
        spread: Spread = CostProfile.raise_around_seeds,
    ) -> None:
        self._source, self._default_cost, self._spread = source, default_cost, spread
        self.laid = [
            self._laid(layer) for layer in CostmapLayers(tuple(layers), default_cost).that_count
        ]

    def _laid(self, layer: CostmapLayer) -> tuple[StaticLayer, Master] | CostProfile | DenoiseLayer:
        if isinstance(layer, StaticLayer):
            return layer, _costs_of_values(layer)
        if isinstance(layer, InflationLayer):
            return CostProfile(self._source, layer, float32_resolution=True)
        return layer

    @property
    def halo(self) -> int:
        """Largest number of rows between a cell and another one that it affects."""
        # A group that the edge of a window cuts, a denoise layer's size away, is not small.
        rows = self._source.shape[0]
        return sum(
            one.cells if isinstance(one, CostProfile) else min(one.minimal_group_size, rows)
            for one in self.laid
            if not isinstance(one, tuple)
        )

    def costs(self, rows: slice) -> Master:
        values = self._source.occupancy[rows]
        if isinstance(self._source, DistanceField) and self._source.unknown == "occupied":
            values = values.copy()
            set_where(values, values == UNKNOWN, OCCUPIED)
        master = np.full(values.shape, self._default_cost, dtype=np.uint8)
        for layer in self.laid:
            if isinstance(layer, CostProfile):
                _spread_with(self._spread, layer, master)
                continue
            if isinstance(layer, DenoiseLayer):
                _free_small_groups(layer, master, with_unknown=self._default_cost != NO_INFORMATION)
                continue
            static, table = layer
            costs: Master = look_up(values, table)
            if static.use_maximum:
                _raise_to(master, costs)
            else:
                master = costs
        return master


def _free_small_groups(layer: DenoiseLayer, master: Master, *, with_unknown: bool) -> None:
    obstacles = master >= INSCRIBED_INFLATED_OBSTACLE
    if not with_unknown:
        obstacles &= master != NO_INFORMATION
    corners = layer.group_connectivity_type == 8
    kept = drop_small_groups(obstacles, layer.minimal_group_size, corners=corners)
    set_where(master, obstacles & ~kept, FREE_SPACE)


def _costs_of_values(layer: StaticLayer) -> NDArray[np.uint8]:
    inscribed, unknown = layer.inscribed_obstacle_cost_value, layer.unknown_cost_value
    table = static_layer_cost_from_occupancy(
        lethal_threshold=layer.lethal_cost_threshold,
        trinary=layer.trinary_costmap,
        track_unknown=layer.track_unknown_space,
        inscribed_value=inscribed if inscribed is not None and inscribed <= OCCUPIED else None,
        unknown_value=unknown,
    )
    if inscribed == NO_INFORMATION != unknown:  # -1 is that byte
        table[inscribed] = INSCRIBED_INFLATED_OBSTACLE
    return table


def _raise_to(master: Master, costs: Master) -> None:
    def raise_rows(rows: slice) -> None:
        # of bytes one higher 255 is 0, the lowest: it changes nothing, and all replace it
        master[rows] += np.uint8(1)
        np.maximum(master[rows], costs[rows] + np.uint8(1), out=master[rows])
        master[rows] -= np.uint8(1)

    for_rows(raise_rows, master.shape)


def _spread_with(spread: Spread, profile: CostProfile, master: Master) -> None:
    """Spread costs by a function where the lookup is exact; newer releases have no queue."""
    if profile.layer.lookup == "nav2":
        spread = CostProfile.raise_around_seeds
    spread(profile, master)


def queue_squares(seeds: NDArray[np.bool_], reach: int) -> NDArray[np.int64]:
    """Return each cell's squared distance to the seed that the queue reaches it from."""
    # Cells wait in bins of the squared distance to their seed. Bins are emptied from the nearest
    # on; the first entry of a cell counts, and puts the cell's neighbours into the bins of their
    # distance to the same seed: left, down, right, up. A neighbour is never in its cell's own bin,
    # since the square changes by an odd number, so that a bin can be taken as a whole. Entries for
    # bins that are done already are lost, as there. A few cells are reached from an obstacle that
    # is not the nearest.
    # From ``updateCosts`` and ``enqueue`` in ``inflation_layer.cpp`` of ROS 1's costmap_2d, and in
    # ``legacy_inflation_layer.cpp`` of nav2_costmap_2d.
    height, width = seeds.shape
    squares = np.empty(seeds.size, dtype=np.int64)
    unset = unreachable(squares)
    squares[:] = unset
    first_entry = np.empty(seeds.size, dtype=np.int64)
    cells = np.flatnonzero(seeds)  # by their index, row by row
    waiting, bins = [0], {0: [(cells, cells)]}
    while waiting:
        square = heapq.heappop(waiting)
        cells, sources = (np.concatenate(some) for some in zip(*bins.pop(square), strict=True))
        is_open = squares[cells] == unset
        cells, sources = cells[is_open], sources[is_open]
        places = np.arange(len(cells))
        first_entry[cells[::-1]] = places[::-1]  # of equal indices the last one stays
        is_first = first_entry[cells] == places
        cells, sources = cells[is_first], sources[is_first]
        squares[cells] = square
        row, col = np.divmod(cells[:, np.newaxis], width)
        source_row, source_col = np.divmod(sources[:, np.newaxis], width)
        rows, cols = row + np.array([0, -1, 0, 1]), col + np.array([-1, 0, 1, 0])
        found = (rows - source_row) ** 2 + (cols - source_col) ** 2
        taken = (found > square) & (found <= reach * reach)
        taken &= (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
        neighbours = (rows * width + cols)[taken]
        origins = np.broadcast_to(sources[:, np.newaxis], found.shape)[taken]
        found, is_open = found[taken], squares[neighbours] == unset
        found, neighbours, origins = found[is_open], neighbours[is_open], origins[is_open]
        for waits_at in np.unique(found).tolist():
            some = found == waits_at
            if waits_at not in bins:
                heapq.heappush(waiting, waits_at)
            bins.setdefault(waits_at, []).append((neighbours[some], origins[some]))
    return squares.reshape(seeds.shape)


class QueueDifference(NamedTuple):
    cells: int
    largest: int


def queue_difference(source: ObstacleSource, parameters: Parameters) -> QueueDifference:
    """Return how costs differ from those of ROS 1, and of Nav2 up to Kilted."""
    exact, queued = (
        costs_spread(source, parameters, spread).astype(np.int16)
        for spread in (CostProfile.raise_around_seeds, raise_by_queue)
    )
    difference = np.abs(exact - queued)
    return QueueDifference(int(np.count_nonzero(difference)), int(difference.max(initial=0)))


def raise_by_queue(profile: CostProfile, cost: Master) -> None:
    """Raise costs, in place, by the distances to the cells that the queue reaches others from."""
    if profile.reach > 0:
        squares = queue_squares(profile.seeds_in(cost), profile.cells)
        profile.raise_costs(cost, profile.table[np.minimum(squares, len(profile.table) - 1)])


def costs_spread(source: ObstacleSource, parameters: Parameters, spread: Spread) -> Master:
    """Return the costs of either model, spread by a function where the lookup is exact."""
    rows = slice(0, source.shape[0])
    if "layers" in parameters:
        layers, default_cost = parameters["layers"], parameters["default_cost"]
        return _MasterGrid(source, layers, default_cost, spread).costs(rows)
    cost = BaseCosts(source, **parameters).costs(rows)
    float32_resolution = parameters["float32_resolution"]
    profile = CostProfile(source, layer_of(parameters), float32_resolution=float32_resolution)
    _spread_with(spread, profile, cost)
    return cost
