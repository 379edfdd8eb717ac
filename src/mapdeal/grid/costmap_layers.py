"""The layers of costmap_2d that a map goes through: their settings, not their computation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from mapdeal.grid.display import OneLine
from mapdeal.records import dataclass

CostLookup = Literal["exact", "nav2"]
"""How a distance becomes a cost: as it is, or rounded to 1/100 cell, as Nav2 does."""


@dataclass(frozen=True, repr=False)
class StaticLayer(OneLine):
    """Settings of costmap_2d's static layer, which converts map values to costs.

    Parameters
    ----------
    name : str
        Name in the list of plugins.
    track_unknown_space : bool
        Whether cells of `unknown_cost_value` become 255 instead of 0.
    lethal_cost_threshold : int
        Least value that becomes 254, 0..100.
    trinary_costmap : bool
        Whether lower values become 0 instead of their share of 254.
    unknown_cost_value : int
        Value that means unknown, as a byte 0..255; 255 is -1.
    inscribed_obstacle_cost_value : int, optional
        Value that becomes 253. Nav2 newer than Kilted uses 99; None for all others.
    use_maximum : bool
        Whether the layer only raises the costs of the layers below it, with no effect in its
        unknown cells. Otherwise it replaces them.
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
    """Settings of costmap_2d's inflation layer, which spreads costs around lethal cells.

    Parameters
    ----------
    name : str
        Name in the list of plugins.
    inscribed_radius : float
        Radius within which cells cost 253, metres.
    inflation_radius : float
        Range of the costs, metres. It is rounded up to whole cells; with 0 the layer has no effect.
    cost_scaling_factor : float
        Decay of the costs, per metre. Larger is steeper.
    inflate_unknown : bool
        Whether unknown cells take any cost. Otherwise they take only 253 and 254.
    inflate_around_unknown : bool
        Whether unknown cells become lethal and spread costs.
    lookup : {'exact', 'nav2'}
        How a distance becomes a cost: unrounded, or rounded to 1/100 cell as in Nav2 newer than
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
    """The layers that turn a map into a costmap, from the first to the last."""

    layers: tuple[CostmapLayer, ...]
    default_cost: int = 0
    circumscribed_radius: float | None = None

    @property
    def that_count(self) -> tuple[CostmapLayer, ...]:
        """Layers that have an effect.

        Layers below a static layer that replaces all costs have none, nor does an inflation layer
        whose range is less than one cell.
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
        """The only static layer and the only inflation layer above it, None if there are others.

        A static layer that only raises costs counts as well: there is nothing below it.
        """
        match self.that_count:
            case (StaticLayer() as static,):
                return static, None
            case (StaticLayer() as static, InflationLayer() as inflation):
                return static, inflation
        return None
