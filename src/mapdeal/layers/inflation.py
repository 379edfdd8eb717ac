"""Costmap layer ``inflation``: costs that fall with the distance to lethal cells."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Annotated, ClassVar, Literal

import numpy as np

from mapdeal import command, errors
from mapdeal.grid import costmap, frame, values as map_values
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.values import FREE_SPACE, LETHAL_OBSTACLE, NO_INFORMATION
from mapdeal.kernels.arrays import Bytes, Floats, Integers, Integers32
from mapdeal.kernels.distance import bytes_by_distance, queued_squares
from mapdeal.kernels.lookup import raise_bytes
from mapdeal.layers import layer as base

HIGHEST_GRADED = map_values.INSCRIBED_INFLATED_OBSTACLE - 1
CostLookup = Literal["exact", "nav2"]  # "nav2" rounds distances to 1/100 cell
_ASYMMETRIC_PARAMETERS = {
    "cost_scaling_factor_left", "cost_scaling_factor_right", "goal_distance_threshold", "plan_topic"
}  # fmt: skip


@dataclass(frozen=True, repr=False)
class InflationLayer(base.CostmapLayer):
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

    References
    ----------
    ``computeCost`` and ``updateCosts`` of costmap_2d and nav2_costmap_2d: ``inflation_layer.hpp``,
    ``inflation_layer.cpp``, ``legacy_inflation_layer.cpp``, ``asymmetric_inflation_layer.cpp``.
    """

    name: str = "inflation_layer"
    inscribed_radius: Annotated[float, command.AT_LEAST_0] = 0.0
    inflation_radius: Annotated[float, command.AT_LEAST_0] = 0.55
    cost_scaling_factor: Annotated[float, command.AT_LEAST_0] = 10.0
    inflate_unknown: bool = False
    inflate_around_unknown: bool = False
    lookup: CostLookup = "exact"
    key: ClassVar[str] = "inflation"
    nav2_plugins: ClassVar[tuple[str, ...]] = (
        "nav2_costmap_2d::InflationLayer", "nav2_costmap_2d::LegacyInflationLayer",
        "nav2_costmap_2d::AsymmetricInflationLayer",
    )  # fmt: skip
    ros1_plugins: ClassVar[tuple[str, ...]] = ("costmap_2d::InflationLayer",)
    about: ClassVar[str] = "spreads costs around lethal cells"
    spreads: ClassVar[bool] = True
    nav2_parameters: ClassVar[Mapping[str, str]] = {
        "custom_inscribed_radius": "double", "num_threads": "integer",
    }  # fmt: skip
    other_parameters: ClassVar[frozenset[str]] = frozenset({"robot_radius"})
    ros1_costmap_parameters: ClassVar[tuple[str, ...]] = ("cost_scaling_factor", "inflation_radius")

    def why_idle(self, has_unknown: bool) -> str | None:
        return None if self.inflation_radius > 0 else "inflation_radius is 0"

    def unknown_after(self, is_unknown: bool) -> bool:
        return is_unknown and not self.inflate_around_unknown

    def halo(self, shape: tuple[int, int], cell_size: float) -> int:
        return profile_of(self, shape, cell_size).cells

    def apply(self, master: base.MasterGrid) -> None:
        profile_of(self, master.shape, master.cell_size).raise_around_seeds(master.costs)

    def reach_cells(self, cell_size: float) -> int:
        """Return the number of cells that the costs reach, ROS's ``cell_inflation_radius``."""
        return reach_in_cells(self.inflation_radius, cell_size)

    def cost_at(self, distance: float) -> int:
        """Return the cost at a distance, metres; 0 beyond the inflation radius."""
        return FREE_SPACE if distance > self.inflation_radius else _cost_of(distance, self)

    def with_inscribed_radius(self, previous_radius: float, footprint: Footprint) -> InflationLayer:
        if self.inscribed_radius != previous_radius:  # the parameter file sets it for this layer
            return self
        return replace(self, inscribed_radius=footprint.inscribed_radius)

    def live(self, place: base.LivePlace, sensing: None) -> LiveInflation:
        return LiveInflation(self, place)

    def effect(self) -> str:
        factor, radius = self.cost_scaling_factor, self.inflation_radius
        text = f"cost 253 as far as {self.inscribed_radius:.4g} m from obstacles, then falling "
        text += f"with cost_scaling_factor {factor:g} as far as {radius:g} m"
        if self.inflate_around_unknown:
            return f"{text}; unknown cells are lethal, and inflated, too"
        return f"{text}; unknown cells take costs, too" if self.inflate_unknown else text

    @classmethod
    def known_parameters(cls, plugin: str) -> frozenset[str]:
        known = super().known_parameters(plugin) - {"inscribed_radius", "lookup"}
        if "Asymmetric" not in plugin:
            return known
        return known - {"cost_scaling_factor", "custom_inscribed_radius"} | _ASYMMETRIC_PARAMETERS

    @classmethod
    def from_nav2(cls, values: base.Nav2Values, entry: base.PluginEntry) -> InflationLayer:
        name, inscribed_radius = entry.name, entry.inscribed_radius
        is_asymmetric = "Asymmetric" in entry.plugin
        is_legacy = values.up_to_kilted or "Legacy" in entry.plugin
        radius = values.number(f"{name}.inflation_radius", 2.0 if is_asymmetric else 0.55)
        if is_asymmetric:
            factor = _factor_without_path(values, name)
        else:
            factor = values.number(f"{name}.cost_scaling_factor", 10.0, least=0.0)
        if not is_legacy:
            values.get(f"{name}.num_threads", "integer", -1)
        if not (is_legacy or is_asymmetric):
            inscribed_radius = _custom_inscribed_radius(values, name, inscribed_radius)
        if radius < inscribed_radius:
            parameter = f"{name}.inflation_radius"
            text, hint = inflation_too_small(radius, inscribed_radius)
            values.problem("params.inflation-radius", "warning", text, parameter, hint)
        takes_unknown = values.flag(f"{name}.inflate_unknown")
        around_unknown = values.flag(f"{name}.inflate_around_unknown")
        lookup: CostLookup = "exact" if is_legacy else "nav2"
        radius = max(radius, 0.0)
        return cls(name, inscribed_radius, radius, factor, takes_unknown, around_unknown, lookup)

    @classmethod
    def from_ros1(cls, server: base.Ros1Values, entry: base.PluginEntry) -> InflationLayer:
        name, inscribed_radius = entry.name, entry.inscribed_radius

        def number(parameter: str, default: float, largest: float, unit: str = "") -> float:
            place = server.place(name, parameter)
            value = server.double(default, *place, unit=unit)
            return server.clamp(value, largest, "dynamic_reconfigure", place, unit)

        radius = number("inflation_radius", 0.55, 50.0, " m")
        if 0 < radius < inscribed_radius and not server.is_substituted:
            text, hint = inflation_too_small(radius, inscribed_radius)
            place = server.place(name, "inflation_radius")
            server.problem("params.inflation-radius", "warning", text, place, hint)
        factor = number("cost_scaling_factor", 10.0, 100.0)
        takes_unknown = server.boolean(False, name, "inflate_unknown")
        return cls(name, inscribed_radius, radius, factor, takes_unknown)

    def _repr_parts(self) -> Iterator[str]:
        yield self.name
        yield f"inscribed_radius {self.inscribed_radius:.6g} m"
        yield f"inflation_radius {self.inflation_radius:.6g} m"
        yield f"cost_scaling_factor {self.cost_scaling_factor:.6g}"


class LiveInflation(base.LiveLayer):
    """Inflation around the cells that changed in this update and the one before."""

    def __init__(self, layer: InflationLayer, place: base.LivePlace) -> None:
        super().__init__(layer, place)
        self._settings = layer
        self._last: tuple[list[float], list[float]] | None = None

    def update_bounds(self, update: base.Update) -> None:
        bounds = update.bounds
        radius = self._settings.inflation_radius
        last, self._last = self._last, (bounds.low, bounds.high)
        if last is None:
            bounds.low, bounds.high = [-math.inf] * 2, [math.inf] * 2
            return
        bounds.low = [min(pair) - radius for pair in zip(last[0], bounds.low, strict=True)]
        bounds.high = [max(pair) + radius for pair in zip(last[1], bounds.high, strict=True)]

    def update_costs(self, master: base.MasterGrid, window: base.Window) -> None:
        reach = self._settings.reach_cells(master.cell_size)
        # Seeds lie within `reach` of the window. The queue spreads costs beyond it, as in ROS.
        is_queued = self._settings.lookup == "exact"
        around = base.grown(window, reach * (1 + is_queued))
        surroundings = master.part(around)
        surroundings.costs = costs = surroundings.costs.copy()
        if is_queued and reach:
            profile = profile_of(self._settings, master.shape, master.cell_size)
            seeds = np.zeros(costs.shape, dtype=np.bool_)
            near = base.within(base.grown(window, reach), around)
            seeds[near] = costs[near] == LETHAL_OBSTACLE
            profile.raise_costs(costs, profile.costs_of(queued_squares(seeds, profile.reach)))
        else:
            self.layer.apply(surroundings)
        if not self.place.is_ros1:
            master.costs[window] = costs[base.within(window, around)]
        else:  # ROS 1 also raises the cells around the window
            master.costs[around] = costs


def _custom_inscribed_radius(values: base.Nav2Values, name: str, inscribed_radius: float) -> float:
    """Return the radius that the layer uses instead of the footprint's, with a warning if any."""
    parameter = f"{name}.custom_inscribed_radius"
    custom = values.number(parameter, -1.0)
    if custom < 0.0:
        return inscribed_radius
    text = f"takes the place of the footprint's own inscribed radius, {inscribed_radius:.4g} m"
    hint = "unsafe unless all that reads the costmap is made for it; remove it"
    values.problem("params.custom-inscribed-radius", "warning", text, parameter, hint)
    return custom


def _factor_without_path(values: base.Nav2Values, name: str) -> float:
    """Return the larger of both sides' factors, which applies if there is no path."""
    for parameter, kind, least in (
        (f"{name}.inflation_radius", "double", 0), (f"{name}.num_threads", "integer", -1),
        (f"{name}.cost_scaling_factor_left", "double", 0),
        (f"{name}.cost_scaling_factor_right", "double", 0),
        (f"{name}.goal_distance_threshold", "double", 0), ("transform_tolerance", "double", 0),
    ):  # fmt: skip
        if values.get(parameter, kind, least) < least:
            text = f"must not be below {least}; Nav2 does not start"
            values.problem("params.not-positive", "refused", text, parameter)
    values.get(f"{name}.plan_topic", "string", None)
    sides = {side: f"{name}.cost_scaling_factor_{side}" for side in ("left", "right")}
    factors = {side: values.number(parameter, 4.0) for side, parameter in sides.items()}
    wider = min(factors, key=factors.__getitem__)
    factor = max(factors.values())
    if factors[wider] < factor:
        text = f"raises costs {wider} of the robot's path; here there is no path, and "
        text += f"{factor:g} counts on both sides"
        place = next(side for side in (sides[wider], *sides.values()) if side in values.parameters)
        values.problem("params.asymmetric", "note", text, place)
    return factor


def inflation_too_small(radius: float, inscribed: float) -> tuple[str, str]:
    """Return text and hint for an inflation radius below the inscribed one, in millimetres."""
    text = f"{radius:g} m is less than the inscribed radius, {inscribed:.4g} m"
    scaled = inscribed * 1000
    needed = math.ceil(scaled) / 1000 if math.isfinite(scaled) else inscribed
    return text, f"set it to {needed:g} or more"


class CostProfile:
    """The costs of an inflation layer by distance, and how far they reach on a grid."""

    # ROS rounds radii up to whole cells without a tolerance: rounding errors may add a cell to a
    # multiple of the cell size. With `is_tolerant` they do not.

    def __init__(
        self, layer: InflationLayer, shape: tuple[int, int], cell_size: float, *,
        is_tolerant: bool = False,
    ) -> None:  # fmt: skip
        self.layer = layer
        reach = reach_in_cells(layer.inflation_radius, cell_size, is_tolerant=is_tolerant)
        self.reach = min(reach, math.ceil(math.hypot(*shape)))
        farthest = self.reach
        if layer.cost_scaling_factor > 0:  # from some distance on, costs are truncated to 0
            decay = math.log(HIGHEST_GRADED) / layer.cost_scaling_factor
            cells = min((layer.inscribed_radius + decay) / cell_size, self.reach)
            farthest = min(self.reach, math.ceil(cells) + 1)
        squares = np.arange(farthest * farthest + 2)
        self.table = _costs_of_squares(squares, layer, cell_size, is_tolerant=is_tolerant)
        self.table[-1] = FREE_SPACE

    @property
    def cells(self) -> int:
        return math.isqrt(len(self.table) - 2)

    def raise_around_seeds(self, cost: Bytes) -> None:
        if self.reach > 0:
            around_unknown = self.layer.inflate_around_unknown
            seeds = cost >= LETHAL_OBSTACLE if around_unknown else cost == LETHAL_OBSTACLE
            self.raise_costs(cost, bytes_by_distance(seeds, self.table))

    def costs_of(self, squares: Integers32) -> Bytes:
        return self.table[np.minimum(squares, len(self.table) - 1)]

    def raise_costs(self, cost: Bytes, spread: Bytes) -> None:
        """Raise costs, in place, to `spread`, the cost at the distance to the nearest seed."""
        least = 1 if self.layer.inflate_unknown else map_values.INSCRIBED_INFLATED_OBSTACLE
        raise_bytes(cost, spread, least=least, unknown=NO_INFORMATION)


profile_of = lru_cache(maxsize=8)(CostProfile)
_MOST_CELLS = 2.0**52  # limit of a reach: floats represent all whole numbers up to here


def reach_in_cells(radius: float, cell_size: float, *, is_tolerant: bool = False) -> int:
    radius = min(radius, _MOST_CELLS * cell_size)
    return frame.cells_to_cover(radius, cell_size) if is_tolerant else math.ceil(radius / cell_size)


def _costs_of_squares(
    squares: Integers | Floats, layer: InflationLayer, cell_size: float, *, is_tolerant: bool
) -> Bytes:
    if layer.lookup == "nav2":
        # in float32 and rounded as Nav2's inflation layer does
        cells = np.sqrt(squares.astype(np.float32))
        hundredths = (cells * np.float32(100) + np.float32(0.5)).astype(np.int64)
        starts = np.flatnonzero(np.diff(hundredths, prepend=-1))
        places = [index / 100.0 * cell_size for index in hundredths[starts].tolist()]
        steps = np.array([_cost_of(metres, layer) for metres in places], dtype=np.uint8)
        costs = np.repeat(steps, np.diff(starts, append=len(squares)))
    else:
        metres = np.sqrt(squares.astype(np.float64)) * cell_size
        beyond = np.maximum(metres - layer.inscribed_radius, 0.0)
        costs = (HIGHEST_GRADED * np.exp(-layer.cost_scaling_factor * beyond)).astype(np.uint8)
        is_within = metres <= layer.inscribed_radius + frame.RADIUS_TOLERANCE * is_tolerant
        costs[is_within] = map_values.INSCRIBED_INFLATED_OBSTACLE
    costs[squares == 0] = LETHAL_OBSTACLE
    return costs


def _cost_of(metres: float, layer: InflationLayer) -> int:
    if metres <= layer.inscribed_radius:
        return map_values.INSCRIBED_INFLATED_OBSTACLE
    decay = math.exp(-layer.cost_scaling_factor * (metres - layer.inscribed_radius))
    return int(HIGHEST_GRADED * decay)


def circumscribed_cost(radius: float | None, layer: InflationLayer) -> int | None:
    if radius is None:
        return None
    if radius > layer.inflation_radius:
        errors.emit_warning(
            f"cost: inflation_radius {layer.inflation_radius:g} m is smaller than the robot's "
            f"circumscribed radius {radius:g} m: cost 0 does not mean that every heading is free"
        )
    return layer.cost_at(radius)


def warn_of_radii(layer: InflationLayer) -> None:
    if layer.inscribed_radius > layer.inflation_radius:
        errors.emit_warning(
            f"cost: inscribed_radius {layer.inscribed_radius:g} m is larger than inflation_radius "
            f"{layer.inflation_radius:g} m, which cuts it off"
        )


def advice_on(cost: int, layer: InflationLayer) -> str:
    factor, radius = layer.cost_scaling_factor, layer.inflation_radius
    if cost > 0:
        return f"raise cost_scaling_factor ({factor:g})"
    if factor > 0 and layer.inscribed_radius + math.log(HIGHEST_GRADED) / factor < radius:
        return f"lower cost_scaling_factor ({factor:g})"
    if radius == 0:
        return "nothing is inflated: raise inflation_radius, or list an inflation layer last"
    return f"raise inflation_radius ({radius:g} m)"


def inflation_curve(
    layers: Sequence[InflationLayer], resolution: float, *,
    circumscribed_radius: float | None = None, float32_resolution: bool = True,
) -> costmap.CostCurve:  # fmt: skip
    cell_size = frame.as_float32(resolution) if float32_resolution else resolution
    is_tolerant = not float32_resolution
    radii = [layer.inflation_radius for layer in layers]
    reaches = [reach_in_cells(radius, cell_size, is_tolerant=is_tolerant) for radius in radii]
    squares = costmap.squares_up_to(max(reaches, default=0))
    cost = np.where(squares == 0, LETHAL_OBSTACLE, FREE_SPACE).astype(np.uint8)
    for layer, reach in zip(layers, reaches, strict=True):
        with np.errstate(over="ignore"):  # the costs become 0 even if the exponent overflows
            spread = _costs_of_squares(squares, layer, cell_size, is_tolerant=is_tolerant)
        np.maximum(cost, spread, out=cost, where=squares <= float(reach) ** 2)
    if not layers:
        return costmap.CostCurve(resolution, np.sqrt(squares), cost)
    farthest, last = layers[int(np.argmax(reaches))], layers[-1]
    marked = (layer for layer in layers if layer is not farthest)
    marks = ((f"inflation radius of {layer.name}", layer.inflation_radius) for layer in marked)
    at_circumscribed = None if circumscribed_radius is None else last.cost_at(circumscribed_radius)
    return costmap.CostCurve(
        resolution,
        np.sqrt(squares),
        cost,
        inscribed_radius=last.inscribed_radius,
        circumscribed_radius=circumscribed_radius,
        circumscribed_cost=at_circumscribed,
        inflation_radius=farthest.inflation_radius,
        marks=tuple(marks),
        note="distances rounded to 1/100 cell" if last.lookup == "nav2" else "",
        formula=partial(_decay, layers=layers, reaches=[reach * cell_size for reach in reaches]),
    )


def _decay(metres: Floats, *, layers: Sequence[InflationLayer], reaches: Sequence[float]) -> Floats:
    """Return the highest of the layers' costs within their reaches, before truncation."""
    highest = np.zeros_like(metres)
    for layer, reach in zip(layers, reaches, strict=True):
        beyond = np.maximum(metres - layer.inscribed_radius, 0.0)
        with np.errstate(over="ignore"):
            decay = HIGHEST_GRADED * np.exp(-layer.cost_scaling_factor * beyond)
        decay[beyond == 0] = map_values.INSCRIBED_INFLATED_OBSTACLE
        np.maximum(highest, decay, out=highest, where=metres <= reach * (1 + 1e-6))
    return highest
