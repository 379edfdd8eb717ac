"""The cost curve of costmap_2d's inflation layers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.cost_curve import CostCurve, squares_up_to
from mapdeal.grid.costmap import InflationLayer
from mapdeal.grid.frame import as_float32
from mapdeal.grid.values import FREE_SPACE, INSCRIBED_INFLATED_OBSTACLE, LETHAL_OBSTACLE
from mapdeal.stages.cost_profile import circumscribed_cost_of, costs_of_squares, reach_of

_MOST_CELLS = 2.0**52
"""Of a reach: whole numbers of cells up to here are floats."""


def inflation_curve(
    layers: Sequence[InflationLayer],
    resolution: float,
    *,
    circumscribed_radius: float | None = None,
    float32_resolution: bool = True,
) -> CostCurve:
    side = as_float32(resolution) if float32_resolution else resolution
    reaches = [
        reach_of(
            min(layer.inflation_radius, _MOST_CELLS * side), side, is_exact=not float32_resolution
        )
        for layer in layers
    ]
    squares = squares_up_to(max(reaches, default=0))
    cost = np.where(squares == 0, LETHAL_OBSTACLE, FREE_SPACE).astype(np.uint8)
    for layer, reach in zip(layers, reaches, strict=True):
        with np.errstate(over="ignore"):  # of exponents, which end at 0 all the same
            spread = costs_of_squares(
                squares,
                resolution=side,
                inscribed_radius=layer.inscribed_radius,
                cost_scaling_factor=layer.cost_scaling_factor,
                lookup=layer.lookup,
                is_exact=not float32_resolution,
            )
        np.maximum(cost, spread, out=cost, where=squares <= float(reach) ** 2)
    if not layers:
        return CostCurve(resolution, np.sqrt(squares), cost)
    farthest, last = layers[int(np.argmax(reaches))], layers[-1]
    at_circumscribed = None
    if circumscribed_radius is not None:
        at_circumscribed = circumscribed_cost_of(
            circumscribed_radius, last.inscribed_radius, last.inflation_radius,
            last.cost_scaling_factor,
        )  # fmt: skip
    return CostCurve(
        resolution,
        np.sqrt(squares),
        cost,
        inscribed_radius=last.inscribed_radius,
        circumscribed_radius=circumscribed_radius,
        circumscribed_cost=at_circumscribed,
        inflation_radius=farthest.inflation_radius,
        marks=tuple(
            (f"inflation radius of {layer.name}", layer.inflation_radius)
            for layer in layers
            if layer is not farthest
        ),
        note="distances rounded to 1/100 cell" if last.lookup == "nav2" else "",
        formula=partial(
            _decay, layers=tuple(layers), reaches=tuple(reach * side for reach in reaches)
        ),
    )


def _decay(
    metres: NDArray[np.float64], *, layers: tuple[InflationLayer, ...], reaches: tuple[float, ...]
) -> NDArray[np.float64]:
    """Return the highest of the layers' costs, each as far as it reaches, not truncated."""
    highest = np.zeros_like(metres)
    for layer, reach in zip(layers, reaches, strict=True):
        beyond = np.maximum(metres - layer.inscribed_radius, 0.0)
        with np.errstate(over="ignore"):
            decay = (INSCRIBED_INFLATED_OBSTACLE - 1) * np.exp(-layer.cost_scaling_factor * beyond)
        decay[beyond == 0] = INSCRIBED_INFLATED_OBSTACLE
        np.maximum(highest, decay, out=highest, where=metres <= reach * (1 + 1e-6))
    return highest
