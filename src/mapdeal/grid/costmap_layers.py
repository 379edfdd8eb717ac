"""The layers of costmap_2d that a map goes through: what is set, apart from what they do."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from mapdeal.grid.display import OneLine
from mapdeal.records import dataclass

CostLookup = Literal["exact", "nav2"]
"""How a distance becomes a cost: as it is, or rounded to 1/100 cell, as Nav2 does."""


@dataclass(frozen=True, repr=False)
class StaticLayer(OneLine):
    """What costmap_2d's static layer makes of the values of a map.

    Parameters
    ----------
    name : str
        Its name in the list of plugins.
    track_unknown_space : bool
        Cells of `unknown_cost_value` become 255, rather than 0.
    lethal_cost_threshold : int
        Values from here on become 254; 0 .. 100.
    trinary_costmap : bool
        Values below become 0, rather than their share of 254.
    unknown_cost_value : int
        The value that means unknown, as a byte 0 .. 255; 255 is -1.
    inscribed_obstacle_cost_value : int, optional
        This value becomes 253. Nav2 newer than Kilted has 99; None for all others.
    use_maximum : bool
        The layer raises the costs of those below it, and its unknown cells change nothing.
        Otherwise it replaces all that lies below it.
    """

    name: str = "static_layer"
    track_unknown_space: bool = True
    lethal_cost_threshold: int = 100
    trinary_costmap: bool = True
    unknown_cost_value: int = 255
    inscribed_obstacle_cost_value: int | None = None
    use_maximum: bool = False

    def _told(self) -> Iterator[str]:
        yield self.name
        yield f"lethal from {self.lethal_cost_threshold}"
        yield "unknown tracked" if self.track_unknown_space else "unknown free"


@dataclass(frozen=True, repr=False)
class InflationLayer(OneLine):
    """How costmap_2d's inflation layer spreads costs around lethal cells.

    Parameters
    ----------
    name : str
        Its name in the list of plugins.
    inscribed_radius : float
        Cost 253 up to here, metres.
    inflation_radius : float
        Costs reach this far, metres, rounded up to whole cells; with 0 the layer does nothing.
    cost_scaling_factor : float
        Steepness, per metre.
    inflate_unknown : bool
        Unknown cells take any cost, not only 253 and more.
    inflate_around_unknown : bool
        Unknown cells become lethal and spread costs.
    lookup : {'exact', 'nav2'}
        How a distance becomes a cost: as it is, or rounded to 1/100 cell, as in Nav2 newer than
        Kilted.
    """

    name: str = "inflation_layer"
    inscribed_radius: float = 0.0
    inflation_radius: float = 0.55
    cost_scaling_factor: float = 10.0
    inflate_unknown: bool = False
    inflate_around_unknown: bool = False
    lookup: CostLookup = "exact"

    def _told(self) -> Iterator[str]:
        yield self.name
        yield f"inscribed_radius {self.inscribed_radius:.6g} m"
        yield f"inflation_radius {self.inflation_radius:.6g} m"
        yield f"cost_scaling_factor {self.cost_scaling_factor:.6g}"


CostmapLayer = StaticLayer | InflationLayer


@dataclass(frozen=True)
class CostmapLayers:
    """The layers that make a costmap of a map, from the first to the last.

    Parameters
    ----------
    layers : tuple of StaticLayer or InflationLayer
        Those that are switched on, in the order in which they are applied.
    default_cost : int
        What cells cost before the first one, 0 or 255.
    circumscribed_radius : float, optional
        The robot cannot collide farther away, metres.
    """

    layers: tuple[CostmapLayer, ...]
    default_cost: int = 0
    circumscribed_radius: float | None = None

    @property
    def that_count(self) -> tuple[CostmapLayer, ...]:
        """The layers that have an effect.

        Those below a static layer that replaces all costs have none, nor has an inflation that
        does not reach the next cell.
        """
        replacing = [
            index
            for index, one in enumerate(self.layers)
            if isinstance(one, StaticLayer) and not one.use_maximum
        ]
        above = self.layers[replacing[-1] if replacing else 0 :]
        return tuple(one for one in above if isinstance(one, StaticLayer) or one.inflation_radius)

    @property
    def static_and_inflation(self) -> tuple[StaticLayer, InflationLayer | None] | None:
        """The one static layer and the one inflation layer above it, if there are no others.

        A static layer that only raises costs counts as well: there is nothing below it.
        """
        match self.that_count:
            case (StaticLayer() as static,):
                return static, None
            case (StaticLayer() as static, InflationLayer() as inflation):
                return static, inflation
        return None
