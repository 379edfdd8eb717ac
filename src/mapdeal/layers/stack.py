"""The layers of one costmap, in order."""

from __future__ import annotations

from mapdeal.grid.footprint import Footprint
from mapdeal.grid.values import FREE_SPACE, NO_INFORMATION, OCCUPIED, UnknownPolicy
from mapdeal.layers.area import CostmapArea
from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.keepout import KeepoutFilter
from mapdeal.layers.layer import CostmapLayer
from mapdeal.layers.static import StaticLayer
from mapdeal.records import dataclass, replace


@dataclass(frozen=True)
class CostmapLayers:
    """The enabled layers that turn a map into a costmap, from the first to the last."""

    layers: tuple[CostmapLayer, ...]
    default_cost: int = FREE_SPACE  # of an empty costmap, 0 or 255
    circumscribed_radius: float | None = None  # of the robot, metres
    area: CostmapArea | None = None  # if the map does not give size and place
    footprint: Footprint | None = None  # padded, if the robot's pose matters

    @property
    def effective(self) -> tuple[CostmapLayer, ...]:
        """Layers that change a cost, for a robot that stands outside of the map."""
        effective: list[CostmapLayer] = []
        has_unknown = self.default_cost == NO_INFORMATION
        for layer in self.layers:
            if layer.why_idle(has_unknown):
                continue
            if layer.overwrites_all:
                effective.clear()
            effective.append(layer)
            has_unknown = layer.may_leave_unknown(has_unknown)
        return tuple(effective)

    @property
    def static_layers(self) -> tuple[StaticLayer, ...]:
        return tuple(layer for layer in self.layers if isinstance(layer, StaticLayer))

    @property
    def inflation_layers(self) -> tuple[InflationLayer, ...]:
        return tuple(layer for layer in self.layers if isinstance(layer, InflationLayer))

    @property
    def keeps_unknown(self) -> bool:
        """Whether cells that the map does not know are unknown in the costmap."""
        is_unknown = self.default_cost == NO_INFORMATION
        for layer in self.layers:
            is_unknown = layer.unknown_after(is_unknown)
        return is_unknown

    @property
    def has_keepout(self) -> bool:
        return any(map(_is_keepout, self.layers))

    @property
    def inflates_keepout(self) -> bool:
        """Whether an inflation layer sees the lethal cells of a keepout mask."""
        effective = self.effective
        filters = [index for index, layer in enumerate(effective) if _is_keepout(layer)]
        return bool(filters) and any(layer.spreads for layer in effective[filters[0] :])

    @property
    def loses_keepout(self) -> bool:
        """Whether a later layer overwrites all that a keepout mask has written."""
        return self.has_keepout and not any(map(_is_keepout, self.effective))

    def with_mask_last(self) -> CostmapLayers:
        """Return the layers without keepout filters where it makes no difference."""
        # A mask over the finished costs has the same effect as filters after all layers.
        layers = list(self.layers)
        while layers and _is_keepout(layers[-1]):
            layers.pop()
        is_last = len(layers) < len(self.layers) and not any(map(_is_keepout, layers))
        return replace(self, layers=tuple(layers)) if is_last else self

    @property
    def static_and_inflation(self) -> tuple[StaticLayer, InflationLayer | None] | None:
        """One static layer, and at most one inflation layer above it; None for other layers."""
        # Includes static layers that only raise costs, because no layer lies below them.
        match self.effective:
            case (StaticLayer() as static,):
                return static, None
            case (StaticLayer() as static, InflationLayer() as inflation):
                return static, inflation
        return None

    @property
    def inflations_above_map(self) -> tuple[InflationLayer, ...] | None:
        effective = self.effective
        statics = [k for k, layer in enumerate(effective) if isinstance(layer, StaticLayer)]
        if not statics:
            return None
        above = effective[statics[0] :]
        return tuple(layer for layer in above if isinstance(layer, InflationLayer))

    @property
    def obstacle_rule(self) -> tuple[int, UnknownPolicy] | None:
        """Least occupancy of an obstacle, and the policy for unknown cells, of the first map."""
        statics = [layer for layer in self.effective if isinstance(layer, StaticLayer)]
        # A static layer sees -1 as byte 255. Behind a field whose obstacles include unknown cells,
        # layers get 100 for them, so that no layer may treat the two values differently.
        special = {layer.inscribed_obstacle_cost_value for layer in statics}
        special |= {layer.unknown_cost_value for layer in statics}
        for layer in statics:
            if layer.lethal_cost_threshold > 0:  # with a threshold of 0 every cell is an obstacle
                is_lethal = special.isdisjoint({NO_INFORMATION, OCCUPIED})
                return layer.lethal_cost_threshold, "occupied" if is_lethal else "free"
        return None


def _is_keepout(layer: CostmapLayer) -> bool:
    return isinstance(layer, KeepoutFilter)
