"""Stage ``cost``, model ``layers``: the layers of a costmap, applied in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import AT_LEAST_0, COST, METRES, Bound, FromRobot, Parameters
from mapdeal.grid.costmap import (
    CostCurve,
    Costmap,
    CostmapLayer,
    CostmapLayers,
    InflationLayer,
    StaticLayer,
)
from mapdeal.grid.field import DistanceField
from mapdeal.grid.framed import Framed
from mapdeal.grid.values import (
    FREE_SPACE,
    INSCRIBED_INFLATED_OBSTACLE,
    NO_INFORMATION,
    OCCUPIED,
    UNKNOWN,
    static_layer_cost_from_occupancy,
)
from mapdeal.kernels.blocks import made_by_windows
from mapdeal.kernels.lookup import look_up, set_where
from mapdeal.kernels.threads import for_rows
from mapdeal.stages.cost import ObstacleSource, cost_model, refuse_view, warn_of_strength
from mapdeal.stages.cost_profile import CostProfile, advice_on, inflation_curve, warn_of_radii
from mapdeal.stages.structured import LayerList

_OF_COSTMAP_2D = (StaticLayer(), InflationLayer())
_OF_EMPTY_COSTMAP = Bound("0 or 255", lambda value: value in (FREE_SPACE, NO_INFORMATION))

Master = NDArray[np.uint8]
Spread = Callable[[CostProfile, Master], None]
"""Raises costs, in place, around the cells that they spread from."""


def _title(parameters: Parameters) -> str:
    return f"cost, {', '.join(layer.name for layer in parameters['layers']) or 'no layers'}"


def _advice(parameters: Parameters, cost: int) -> str:
    layers = reversed(parameters["layers"])
    inflation = next((one for one in layers if isinstance(one, InflationLayer)), None)
    if inflation is None:
        return "no inflation layer spreads costs"
    return advice_on(
        cost, inflation.inscribed_radius, inflation.inflation_radius, inflation.cost_scaling_factor
    )


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
    above = layers[static[0] :]
    return inflation_curve(
        [layer for layer in above if isinstance(layer, InflationLayer)],
        source.resolution,
        circumscribed_radius=parameters["circumscribed_radius"],
    )


def _radius_in(parameters: Parameters) -> tuple[str, float]:
    radii = (
        one.inscribed_radius for one in parameters["layers"] if isinstance(one, InflationLayer)
    )
    return "inscribed_radius", max(radii, default=0.0)


@cost_model(
    "layers",
    title=_title,
    memory=3.0,
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
        Static and inflation layers, the lowest first.
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
    counted in cells of the float32 resolution of a map message, without a tolerance.

    Unknown cells that a field counts as obstacles have value 100 for the layers; the field's
    distances are not used.

    References
    ----------
    ``updateWithTrueOverwrite`` and ``updateWithMax`` in ``costmap_layer.cpp``, ``interpretValue``
    in ``static_layer.cpp``, ``updateCosts`` in ``inflation_layer.cpp`` of nav2_costmap_2d.

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
            warn_of_radii(layer.inscribed_radius, layer.inflation_radius)
    grid = MasterGrid.of(source, layers, default_cost)
    cost = made_by_windows(source.occupancy, np.uint8, grid.costs, halo=grid.halo)
    profiles = [one.profile for one in grid.laid if isinstance(one, LaidInflation)]
    return Costmap(
        cost,
        source.resolution,
        source.origin,
        circumscribed_cost=profiles[-1].cost_at(circumscribed_radius) if profiles else None,
    )


raise_around_seeds: Spread = CostProfile.raise_around_seeds
"""By the exact distances to these cells."""


@dataclass(frozen=True, eq=False)
class LaidStatic:
    """A static layer: the cost of each value, and what it does to the costs below."""

    table: NDArray[np.uint8]
    use_maximum: bool

    @classmethod
    def of(cls, layer: StaticLayer) -> LaidStatic:
        """Create it from the settings of a layer."""
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
        return cls(table, layer.use_maximum)

    def over(self, master: Master, values: NDArray[np.int8]) -> Master:
        """Return the master grid with the layer applied; it may be changed in place."""
        costs: Master = look_up(values, self.table)
        if not self.use_maximum:
            return costs

        def raise_rows(rows: slice) -> None:
            # of bytes one higher 255 is 0, the lowest: it changes nothing, and all replace it
            master[rows] += np.uint8(1)
            np.maximum(master[rows], costs[rows] + np.uint8(1), out=master[rows])
            master[rows] -= np.uint8(1)

        for_rows(raise_rows, master.shape)
        return master


@dataclass(frozen=True, eq=False)
class LaidInflation:
    """An inflation layer on a grid, and how its costs spread."""

    profile: CostProfile
    spread: Spread

    def over(self, master: Master, _: NDArray[np.int8]) -> Master:
        self.spread(self.profile, master)
        return master


@dataclass(frozen=True, eq=False)
class MasterGrid:
    """The layers over a map that have an effect."""

    source: ObstacleSource
    laid: tuple[LaidStatic | LaidInflation, ...]
    default_cost: int

    @classmethod
    def of(
        cls,
        source: ObstacleSource,
        layers: Sequence[CostmapLayer],
        default_cost: int,
        spread_of: Callable[[InflationLayer], Spread] = lambda _: raise_around_seeds,
    ) -> MasterGrid:
        """Create the layers over a map; `spread_of` defines how the costs of each spread."""
        laid: list[LaidStatic | LaidInflation] = []
        for layer in CostmapLayers(tuple(layers)).that_count:
            if isinstance(layer, StaticLayer):
                laid.append(LaidStatic.of(layer))
                continue
            profile = CostProfile.of(source, **vars(layer), float32_resolution=True)
            laid.append(LaidInflation(profile, spread_of(layer)))
        return cls(source, tuple(laid), default_cost)

    @property
    def halo(self) -> int:
        """Largest number of rows between a cell and another one that it affects."""
        return sum(one.profile.cells for one in self.laid if isinstance(one, LaidInflation))

    def costs(self, rows: slice) -> Master:
        """Return the costs of some rows."""
        values = self._values(rows)
        master = np.full(values.shape, self.default_cost, dtype=np.uint8)
        for layer in self.laid:
            master = layer.over(master, values)
        return master

    def _values(self, rows: slice) -> NDArray[np.int8]:
        occupancy = self.source.occupancy[rows]
        if isinstance(self.source, DistanceField) and self.source.unknown == "occupied":
            occupancy = occupancy.copy()
            set_where(occupancy, occupancy == UNKNOWN, OCCUPIED)
        return occupancy
