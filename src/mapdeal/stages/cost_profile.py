"""The costs of costmap_2d's inflation layer by the distance from an obstacle."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError, emit_warning
from mapdeal.grid.costmap import CostCurve, CostLookup, InflationLayer, squares_up_to
from mapdeal.grid.field import DistanceField
from mapdeal.grid.frame import RADIUS_TOLERANCE, as_float32, cells_to_cover
from mapdeal.grid.values import (
    FREE_SPACE,
    INSCRIBED_INFLATED_OBSTACLE,
    LETHAL_OBSTACLE,
    NO_INFORMATION,
)
from mapdeal.kernels.distance import bytes_by_distance
from mapdeal.kernels.lookup import raise_bytes
from mapdeal.stages.cost import ObstacleSource
from mapdeal.stages.esdf import bytes_in, reach_is_kept

_HIGHEST_GRADED = INSCRIBED_INFLATED_OBSTACLE - 1
_RAISED_TOGETHER = 1 << 22  # cells: no more memory than for some of them


@dataclass(frozen=True, eq=False)
class CostProfile:
    """The profile of costs around obstacles: what an inflation layer is set to, in cells."""

    inscribed_radius: float
    inflation_radius: float
    cost_scaling_factor: float
    inflate_unknown: bool
    inflate_around_unknown: bool
    reach: int
    metres: float
    table: NDArray[np.uint8]

    @classmethod
    def of(
        cls,
        source: ObstacleSource,
        *,
        inscribed_radius: float,
        inflation_radius: float,
        cost_scaling_factor: float,
        inflate_unknown: bool,
        inflate_around_unknown: bool,
        lookup: CostLookup,
        float32_resolution: bool | None,
        **_: object,
    ) -> CostProfile:
        """Return the profile for parameters of `exponential_cost`; unrelated ones are ignored."""
        is_exact = not resolution_is_float32(lookup, float32_resolution)
        side = source.resolution if is_exact else as_float32(source.resolution)
        reach = _reach(inflation_radius, side, source.shape, is_exact=is_exact)
        table = cost_table(
            min(reach, _last_cost_above_0(inscribed_radius, cost_scaling_factor, side)),
            resolution=side,
            inscribed_radius=inscribed_radius,
            cost_scaling_factor=cost_scaling_factor,
            lookup=lookup,
            is_exact=is_exact,
        )
        return cls(
            inscribed_radius, inflation_radius, cost_scaling_factor, inflate_unknown,
            inflate_around_unknown, reach, reach * source.resolution, table,
        )  # fmt: skip

    @property
    def cells(self) -> int:
        """Cells beyond which all costs are 0."""
        return math.isqrt(len(self.table) - 2)

    def cost_at(self, circumscribed_radius: float | None) -> int | None:
        if circumscribed_radius is None:
            return None
        if circumscribed_radius > self.inflation_radius:
            text = (
                f"cost: inflation_radius {self.inflation_radius:g} m is smaller than the robot's "
                f"circumscribed radius {circumscribed_radius:g} m: cost 0 does not mean that "
                "every heading is free"
            )
            emit_warning(text, stacklevel=3)
        return circumscribed_cost_of(
            circumscribed_radius,
            self.inscribed_radius,
            self.inflation_radius,
            self.cost_scaling_factor,
        )

    def is_in(self, field: DistanceField) -> bool:
        if reach_is_kept(field, self.metres):
            return True
        if field.max_distance is not None and field.max_distance < self.metres * (1 - 1e-6):
            rule = f"the field is clipped below the range of the costs, {self.metres:g} m"
            hint = "make the field with a larger max_distance, or none"
            raise ParameterError(rule, place="max_distance", got=field.max_distance, hint=hint)
        # The clip falls on the reach: cells right there look like those beyond.
        return False

    def raise_from_field(self, cost: NDArray[np.uint8], field: DistanceField) -> None:
        height, width = cost.shape
        step = max(1, _RAISED_TOGETHER // max(1, width))
        for first in range(0, height, step):
            rows = slice(first, min(first + step, height))
            part = field.part(rows)
            spread = bytes_in(part, part.obstacles(), self.table)
            raise_costs(cost[rows], spread, inflate_unknown=self.inflate_unknown)

    def raise_around_seeds(self, cost: NDArray[np.uint8]) -> None:
        """Raise costs, in place, by the distances to the cells that costs spread from."""
        if self.reach > 0:
            spread = bytes_by_distance(self.seeds_in(cost), self.table)
            raise_costs(cost, spread, inflate_unknown=self.inflate_unknown)

    def seeds_in(self, cost: NDArray[np.uint8]) -> NDArray[np.bool_]:
        return cost >= LETHAL_OBSTACLE if self.inflate_around_unknown else cost == LETHAL_OBSTACLE


def resolution_is_float32(lookup: CostLookup, asked: bool | None) -> bool:
    """Return whether costs are computed with the float32 resolution of a map message."""
    if lookup == "nav2" and asked is False:
        rule = "cannot be no with lookup nav2, which takes the resolution of a map message"
        raise ParameterError(rule, place="float32_resolution")
    return lookup == "nav2" or bool(asked)


def warn_of_radii(inscribed_radius: float, inflation_radius: float) -> None:
    if inscribed_radius > inflation_radius:
        text = (
            f"cost: inscribed_radius {inscribed_radius:g} m is larger than inflation_radius "
            f"{inflation_radius:g} m, which cuts it off"
        )
        emit_warning(text, stacklevel=3)


def cost_table(reach: int, **given: Any) -> NDArray[np.uint8]:
    """Return `costs_of_squares` of the squared distances 0 .. reach^2, and one 0 beyond."""
    table = costs_of_squares(np.arange(reach * reach + 2), **given)
    table[-1] = FREE_SPACE
    return table


def advice_on(
    cost: int, inscribed_radius: float, inflation_radius: float, cost_scaling_factor: float
) -> str:
    """Return what to change where nearly all open cells have one cost."""
    if cost > 0:
        return f"raise cost_scaling_factor ({cost_scaling_factor:g})"
    if cost_scaling_factor > 0:
        end = inscribed_radius + math.log(_HIGHEST_GRADED) / cost_scaling_factor
        if end < inflation_radius:
            return f"lower cost_scaling_factor ({cost_scaling_factor:g})"
    return f"raise inflation_radius ({inflation_radius:g} m)"


def costs_of_squares(
    squares: NDArray[np.int64] | NDArray[np.float64],
    *,
    resolution: float,
    inscribed_radius: float,
    cost_scaling_factor: float,
    lookup: CostLookup = "exact",
    is_exact: bool = True,
) -> NDArray[np.uint8]:
    """Return the cost of squared distances in cells, however far costs reach."""
    if lookup == "nav2":
        # in float32 and rounded as Nav2's inflation layer does
        cells = np.sqrt(squares.astype(np.float32))
        hundredths = (cells * np.float32(100) + np.float32(0.5)).astype(np.int64)
        starts = np.flatnonzero(np.diff(hundredths, prepend=-1))
        of_hundredths = [
            _cost_of(index / 100.0 * resolution, inscribed_radius, cost_scaling_factor)
            for index in hundredths[starts].tolist()
        ]
        lengths = np.diff(starts, append=len(squares))
        costs = np.repeat(np.array(of_hundredths, dtype=np.uint8), lengths)
    else:
        metres = np.sqrt(squares.astype(np.float64)) * resolution
        decay = np.exp(-cost_scaling_factor * np.maximum(metres - inscribed_radius, 0.0))
        costs = (_HIGHEST_GRADED * decay).astype(np.uint8)
        within = inscribed_radius + RADIUS_TOLERANCE * is_exact
        costs[metres <= within] = INSCRIBED_INFLATED_OBSTACLE
    costs[squares == 0] = LETHAL_OBSTACLE
    return costs


def _cost_of(metres: float, inscribed_radius: float, cost_scaling_factor: float) -> int:
    """Return the cost at a distance above 0, as ``computeCost`` of costmap_2d."""
    if metres <= inscribed_radius:
        return INSCRIBED_INFLATED_OBSTACLE
    decay = math.exp(-cost_scaling_factor * (metres - inscribed_radius))
    return int(_HIGHEST_GRADED * decay)


def raise_costs(
    cost: NDArray[np.uint8], spread: NDArray[np.uint8], *, inflate_unknown: bool = False
) -> None:
    """Raise `cost`, in place, to what the distance to the nearest seed asks for."""
    least = 1 if inflate_unknown else INSCRIBED_INFLATED_OBSTACLE
    raise_bytes(cost, spread, least=least, unknown=NO_INFORMATION)


def _reach(
    inflation_radius: float, resolution: float, shape: tuple[int, int], *, is_exact: bool
) -> int:
    """Return the cells that costs reach; beyond the map's diagonal nothing is left to reach."""
    diagonal = math.ceil(math.hypot(*shape))
    radius = min(inflation_radius, 2 * diagonal * resolution)
    return min(reach_of(radius, resolution, is_exact=is_exact), diagonal)


def reach_of(inflation_radius: float, resolution: float, *, is_exact: bool) -> int:
    """Return the cells that costs reach on a map without end."""
    # ROS has no tolerance for radii that are multiples of the resolution on paper.
    if is_exact:
        return cells_to_cover(inflation_radius, resolution)
    return math.ceil(inflation_radius / resolution)


def _last_cost_above_0(
    inscribed_radius: float, cost_scaling_factor: float, resolution: float
) -> int:  # fmt: skip
    """Return cells from which on costs are truncated to 0, however far they reach."""
    if cost_scaling_factor == 0:
        return sys.maxsize
    decay = math.log(_HIGHEST_GRADED) / cost_scaling_factor
    cells = (inscribed_radius + decay) / resolution
    return math.ceil(min(cells, sys.maxsize // 2)) + 1


def circumscribed_cost_of(
    circumscribed_radius: float,
    inscribed_radius: float,
    inflation_radius: float,
    cost_scaling_factor: float,
) -> int:
    """Return the cost at the robot's circumscribed radius; 0 if costs do not reach there."""
    if circumscribed_radius > inflation_radius:
        return FREE_SPACE
    return _cost_of(circumscribed_radius, inscribed_radius, cost_scaling_factor)


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
