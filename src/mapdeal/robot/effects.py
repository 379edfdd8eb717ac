"""Effects of a robot's layers on a map file, in words and in numbers."""

from __future__ import annotations

import math
from typing import Any

from mapdeal.grid.coordinates import as_float32
from mapdeal.grid.costmap_layers import CostmapLayer, InflationLayer, StaticLayer
from mapdeal.robot.parameters import INJECTED, ListedLayer, RobotParameters

_UNKNOWN = 255


def effect_of(one: ListedLayer, robot: RobotParameters) -> str:
    """Return what a layer of the list does to a file, or why it does nothing."""
    if one.layer is None:
        return f"ignored: {one.why_ignored}"
    if not one.is_enabled:
        return "switched off"
    if isinstance(one.layer, InflationLayer) and one.layer.inflation_radius <= 0:
        return "no effect: inflation_radius is 0"
    if all(one.layer is not other for other in robot.costmap_layers.that_count):
        return "no effect: a static layer above it replaces all costs"
    effect = _effect_of(one.layer)
    return f"not in the file, put in front: {effect}" if one.name == INJECTED else effect


def _effect_of(layer: CostmapLayer) -> str:
    if isinstance(layer, StaticLayer):
        return _effect_of_static(layer)
    text = f"cost 253 as far as {layer.inscribed_radius:.4g} m from obstacles, then falling by "
    text += f"{layer.cost_scaling_factor:g} per metre as far as {layer.inflation_radius:g} m"
    if layer.inflate_around_unknown:
        text += "; unknown cells are lethal, and inflated, too"
    elif layer.inflate_unknown:
        text += "; unknown cells take costs, too"
    return text


def _effect_of_static(layer: StaticLayer) -> str:
    least = layer.lethal_cost_threshold
    text = f"occupancy {least} is lethal" if least == 100 else f"occupancy {least}..100 is lethal"
    if layer.inscribed_obstacle_cost_value is not None and not layer.trinary_costmap:
        text += f", {layer.inscribed_obstacle_cost_value} inscribed"
    text += ", all else free" if layer.trinary_costmap else ", less costs its share of 254"
    if layer.unknown_cost_value != _UNKNOWN:
        text += f"; {layer.unknown_cost_value} counts as unknown, and -1 as lethal"
    text += ", unknown stays unknown" if layer.track_unknown_space else ", unknown becomes free"
    return text + ("; costs are only raised" if layer.use_maximum else "")


def reach_of(layer: InflationLayer, resolution: float) -> int:
    """Return how many cells an inflation layer reaches on a map, its ``cell_inflation_radius``.

    The resolution is that of the map's message: 0.45 m are 16 cells of 0.03 m, as float32(0.03)
    is a little less.
    """
    return max(0, math.ceil(layer.inflation_radius / as_float32(resolution)))


def on_map(robot: RobotParameters, resolution: float) -> list[dict[str, Any]]:
    """Return what each inflation layer comes to on a map of some resolution, metres."""
    return [
        {
            "layer": one.name,
            "resolution": as_float32(resolution),
            "cell_inflation_radius": reach_of(one, resolution),
            "reach": reach_of(one, resolution) * as_float32(resolution),
            "inscribed_radius_cells": one.inscribed_radius / as_float32(resolution),
            "circumscribed_cost": _cost_at(one, robot.circumscribed_radius),
        }
        for one in robot.inflation_layers
    ]


def _cost_at(layer: InflationLayer, metres: float) -> int:
    """Return the cost at some metres from an obstacle; 0 beyond the inflation radius."""
    if metres > layer.inflation_radius:
        return 0
    if metres <= layer.inscribed_radius:
        return 253
    decay = math.exp(-layer.cost_scaling_factor * (metres - layer.inscribed_radius))
    return int(252 * decay)
