"""Stage ``cost``, models ``threshold`` and ``rings``: those of the ROS package robot_costmap."""

from __future__ import annotations

from typing import Annotated, Any, NoReturn

import numpy as np

from mapdeal import command
from mapdeal.command import Parameters
from mapdeal.errors import ParameterError, emit_warning, require
from mapdeal.grid.costmap import CostCurve, Costmap, squares_up_to
from mapdeal.grid.field import DistanceField, FieldView, View, ViewScale, truncated
from mapdeal.grid.frame import Framed
from mapdeal.grid.values import OCCUPIED, UNKNOWN
from mapdeal.kernels.arrays import Floats, Mask, SignedBytes
from mapdeal.kernels.blocks import looked_up, made_by_windows, swept
from mapdeal.kernels.distance import ringed
from mapdeal.stages import cost as models
from mapdeal.stages.cost import ObstacleSource, cost_model
from mapdeal.stages.esdf import LARGER_MAX_DISTANCE, Viewer, esdf, furthest_kept

_HIGHEST_BELOW_OBSTACLE = 99
_TOLERANCE = 1e-9  # metres; rounding may put a cell this far below a threshold


def _title(parameters: command.Parameters) -> str:
    distances = {name: parameters[f"{name}_distance"] for name in ("down", "up")}
    down, up = (f"{parameters[name]:g}" if distance is None else f"{distance:g} m"
                for name, distance in distances.items())  # fmt: skip
    return f"cost, thresholds {down} and {up}, {parameters['view']}"


def _advice(parameters: command.Parameters, cost: int) -> str:
    is_per_map = parameters["view"] == "per-map"
    if cost and is_per_map:
        return "view per-map is scaled by the extremes of the map; take view metric"
    if cost == _HIGHEST_BELOW_OBSTACLE:
        return f"lower up_factor ({parameters['up_factor']:g})"
    if cost:
        return "change down, up and their factors"
    # Costs begin at `down`, or at `up` if the factor reduces the whole middle range to 0.
    up, factor = parameters["up"], parameters["down_factor"]
    begin = "down" if factor * (OCCUPIED if up is None else up) >= 1 else "up"
    if begin == "up" and parameters["up_factor"] * _HIGHEST_BELOW_OBSTACLE < 1:
        return f"raise up_factor ({parameters['up_factor']:g})"
    lengths = {} if is_per_map else {"view_range": parameters["view_range"]}
    value, distance = parameters[begin], parameters[f"{begin}_distance"]
    if distance is not None:
        # raising one distance requires raising those that limit it
        limits = {"down_distance": parameters["down_distance"], **lengths}
        reached = [name for name, limit in limits.items() if limit == distance]
        along_with = [f" and {name}" for name in reached if name != f"{begin}_distance"]
        return f"raise {begin}_distance ({distance:g} m){''.join(along_with)}"
    if value == 0:
        return ", or ".join(["raise up_factor and down_factor", *lengths])
    if begin == "down" or not parameters["down"]:
        return f"lower {begin} ({value:g}), or give {begin}_distance in metres"
    both = f"lower up ({value:g}) and down ({parameters['down']:g})"
    return f"{both}, or give up_distance and down_distance in metres"


def _curve_of_thresholds(source: ObstacleSource | FieldView, parameters: Parameters) -> CostCurve:
    view, view_range = parameters["view"], parameters["view_range"]
    strength = source.strength if isinstance(source, DistanceField) else 1.0
    if isinstance(source, FieldView):
        scale = source.scale
    elif view == "metric":
        scale = ViewScale(view, view_range)
    else:
        scale = Viewer(_field_of(source, parameters["lethal_threshold"]), view, view_range).scale
    return _Rule(source, scale, **parameters).curve(scale, strength, source.resolution)


@cost_model(
    "threshold",
    title=_title,
    memory=9.0,
    advice=_advice,
    when_closed="lower the radius of inflate",
    curve=_curve_of_thresholds,
    in_place_of={
        f"{name}_distance": command.InPlaceOf(name, lambda _: None) for name in ("down", "up")
    },
)
def threshold_cost(
    source: ObstacleSource | FieldView,
    *,
    down: Annotated[float, command.PERCENT, command.VIEW_VALUE] | None = 45,
    up: Annotated[float, command.PERCENT, command.VIEW_VALUE] | None = 54,
    down_distance: Annotated[float, command.AT_LEAST_0, command.METRES] | None = None,
    up_distance: Annotated[float, command.AT_LEAST_0, command.METRES] | None = None,
    down_factor: Annotated[float, command.AT_LEAST_0, command.FACTOR] = 0.0,
    up_factor: Annotated[float, command.AT_LEAST_0, command.FACTOR] = 1.5,
    view: View = "metric",
    view_range: Annotated[float, command.ABOVE_0, command.METRES] = 2.0,
    lethal_threshold: command.LethalThreshold | None = None,
) -> Costmap:
    """Compute costs by thresholds on the 0..100 view of the distance field.

    Parameters
    ----------
    source : OccupancyGrid, DistanceField or FieldView
        The distance field. A map is converted to a field first, with unknown cells free. A view is
        used unchanged: `view` and `view_range` then have no effect.
    down : float, optional
        Largest view value that costs 0. None if `down_distance` is given.
    up : float, optional
        Largest view value of the middle range. None if `up_distance` is given.
    down_distance : float, optional
        Distance from obstacles at and beyond which cells cost 0, metres. It replaces `down`.
    up_distance : float, optional
        Distance below which cells belong to the near range, metres. It replaces `up`.
    down_factor : float
        Factor of the middle range.
    up_factor : float
        Factor of the near range.
    view : {'metric', 'per-map'}
        How distances become 0..100. See `mapdeal.field_view`.
    view_range : float
        Distance at which the metric view is 0, metres.
    lethal_threshold : int, optional
        Least occupancy of an obstacle, 1..100; 100 for a map, the field's own for a field.

    Returns
    -------
    Costmap
        Costs on scale ``occupancy``. With v the view value: 0 for v <= down or from
        `down_distance` on, trunc(up_factor v), at most 99, for v > up or nearer than `up_distance`,
        and trunc(down_factor v) in between; obstacles stay 100 and unknown cells -1.

    Raises
    ------
    ParameterError
        If the field was clipped where the costs still depend on the distance, `down` exceeds
        `up`, or a distance lies where the view is already 0.

    Notes
    -----
    Distances are those between cell centres times the field's strength. On a view, a threshold in
    metres becomes the whole view value there. Products are rounded to 1e-9 before they are
    truncated: 0.58 of 50 is 29. In robot_costmap the product overflows 8 bits.

    Examples
    --------
    >>> from mapdeal.grid.occupancy import OccupancyGrid
    >>> grid = OccupancyGrid([[100, 0, 0, 0, 0, -1]], resolution=0.25)
    >>> threshold_cost(grid).cost.tolist()  # the view is 100, 87, 75, 62, 50, -1
    [[100, 99, 99, 93, 0, -1]]
    >>> threshold_cost(grid, down_distance=0.75, up_distance=0.5, down_factor=1).cost.tolist()
    [[100, 99, 75, 0, 0, -1]]
    """
    if isinstance(source, FieldView):
        scale = source.scale
        text = "the view was made with a threshold of its own"
        has_default = lethal_threshold in (None, OCCUPIED)
        require(has_default, text, "lethal_threshold", got=lethal_threshold)
        if view != scale.view or (view == "metric" and ViewScale(view, view_range) != scale):
            text = f"cost: the input is a view already, {scale.described()}; it is used as it is"
            emit_warning(text)
    else:
        source = _field_of(source, lethal_threshold)
        viewer = Viewer(source, view, view_range)
        scale = viewer.scale
    rule = _Rule(
        source, scale, down=down, up=up, down_distance=down_distance, up_distance=up_distance,
        down_factor=down_factor, up_factor=up_factor,
    )  # fmt: skip
    if isinstance(source, FieldView):
        cost = looked_up(source.occupancy, rule.table())
    else:
        _check_clip(source, rule, scale)
        cost = viewer.values(rule.costs_of)
    return Costmap(cost, source.resolution, source.origin, scale="occupancy")


def _field_of(source: ObstacleSource, lethal_threshold: int | None) -> DistanceField:
    threshold = models.check_lethal_threshold(source, lethal_threshold)
    return source if isinstance(source, DistanceField) else esdf(source, lethal_threshold=threshold)


class _Rule:
    """Thresholds, as view values or metres, and the factors of the ranges between them."""

    def __init__(self, source: ObstacleSource | FieldView, scale: ViewScale, **limits: Any) -> None:
        down_distance: float | None = limits["down_distance"]
        up_distance: float | None = limits["up_distance"]
        if down_distance is not None and up_distance is not None and down_distance < up_distance:
            rule = f"must not be less than up_distance ({up_distance:g} m)"
            raise ParameterError(rule, place="down_distance", got=down_distance)
        self.down = _value_at("down", limits, scale, source.resolution)
        self.up = _value_at("up", limits, scale, source.resolution)
        if self.down > self.up:
            _refuse_order(self.down, self.up, down_distance, up_distance)
        if isinstance(source, FieldView):  # a view has no metres: distances are now values
            down_distance = up_distance = None
        self.down_distance, self.up_distance = down_distance, up_distance
        self.factors = limits["up_factor"], limits["down_factor"]

    def is_beyond(self, view: Floats, metres: Floats) -> Mask:
        if self.down_distance is None:
            return np.less_equal(view, self.down)
        return np.greater_equal(metres, self.down_distance - _TOLERANCE)

    def is_near(self, view: Floats, metres: Floats) -> Mask:
        """Return where `up_factor` applies, if the cell is not beyond `down`."""
        if self.up_distance is None:
            return np.greater(view, self.up)
        return np.less(metres, self.up_distance - _TOLERANCE)

    def costs_of(self, view: Floats, metres: Floats) -> Floats:
        highest = _HIGHEST_BELOW_OBSTACLE  # also the largest useful factor: the least view is 1
        factors = (min(factor, highest) for factor in self.factors)
        products = np.where(self.is_near(view, metres), *factors) * view
        return np.where(self.is_beyond(view, metres), 0.0, np.minimum(truncated(products), highest))

    def table(self) -> SignedBytes:
        """Return the cost of each byte of a view, shape (256,); the last one is -1."""
        table = np.zeros(256, dtype=np.int8)
        view = np.arange(float(OCCUPIED))
        table[:OCCUPIED] = self.costs_of(view, view)
        table[OCCUPIED] = OCCUPIED
        table[UNKNOWN] = UNKNOWN
        return table

    def curve(self, scale: ViewScale, strength: float, resolution: float) -> CostCurve:
        """Return the cost curve with marks at the farthest distance of each range."""
        cells = np.sqrt(squares_up_to(scale.end / strength / resolution + 1))
        metres = strength * (cells * resolution)
        view = scale.values_of(metres, resolution)
        cost = self.costs_of(view, metres).astype(np.int8)
        cost[0] = OCCUPIED
        marks = []
        for name, value, distance, is_within in (
            ("down", self.down, self.down_distance, ~self.is_beyond(view, metres)),
            ("up", self.up, self.up_distance, self.is_near(view, metres)),
        ):
            label = f"view {value:g}" if distance is None else f"{distance:g} m"
            if is_within.any():
                farthest = float(cells[np.flatnonzero(is_within)[-1]] * resolution)
                marks.append((f"{name}, {label}", farthest))
        end = int(np.flatnonzero(cost)[-1]) + 1
        return CostCurve(resolution, cells[:end], cost[:end], "occupancy", marks=tuple(marks))


def _refuse_order(
    lower: float, upper: float, down_distance: float | None, up_distance: float | None
) -> NoReturn:
    if up_distance is not None:
        rule, hint = f"the view is {upper:g} there, below down ({lower:g})", "give down_distance"
        raise ParameterError(rule, place="up_distance", got=up_distance, hint=f"{hint} as well")
    if down_distance is not None:
        rule, hint = f"the view is {lower:g} there, above up ({upper:g})", "give up_distance"
        raise ParameterError(rule, place="down_distance", got=down_distance, hint=f"{hint} as well")
    raise ParameterError(f"must not be larger than up ({upper:g})", place="down", got=lower)


def _value_at(threshold: str, parameters: Parameters, scale: ViewScale, resolution: float) -> float:
    name = f"{threshold}_distance"
    value: float | None = parameters[threshold]
    distance: float | None = parameters[name]
    if distance is None:
        if value is None:
            raise ParameterError("is required if its value is none", place=name)
        return value
    if scale.view == "metric" and distance > scale.view_range:
        rule = f"must not be larger than view_range ({scale.view_range:g} m), where the view is 0"
        raise ParameterError(rule, place=name, got=distance, hint=f"give view_range {distance:g}")
    return scale.value_at(distance, resolution)


def _check_clip(field: DistanceField, rule: _Rule, scale: ViewScale) -> None:
    """Refuse a field whose clipped cells would have other costs at their true distance."""
    # In the metric view, clipping has no effect if cells at the limit already cost 0. The per-map
    # view is scaled by the farthest and deepest cells, which clipping hides.
    limit = field.max_distance
    if limit is None:
        return
    end = np.array([field.strength * furthest_kept(field)])
    is_free = rule.is_beyond(scale.values_of(end, field.resolution), end)[0]
    highest, lowest = np.float32(limit * field.strength), np.float32(-limit)
    for rows in swept(field.distance):
        distance = field.distance[rows]
        is_clipped = ((distance >= highest) | (distance <= lowest)).any()
        if is_clipped and not (scale.view == "metric" and is_free):
            text = f"the field is clipped where the {scale.view} view still falls"
            raise ParameterError(text, place="max_distance", got=limit, hint=LARGER_MAX_DISTANCE)


def _curve_of_rings(source: Framed, parameters: command.Parameters) -> CostCurve:
    values = parameters["values"]
    cells = np.arange(len(values) + 1, dtype=np.float64)
    cost = np.array([OCCUPIED, *values], dtype=np.int8)
    return CostCurve(source.resolution, cells, cost, "occupancy", "chebyshev")


@cost_model(
    "rings",
    title=lambda parameters: f"cost, rings {', '.join(map(str, parameters['values']))}",
    memory=5.0,
    advice=lambda parameters, _: (
        f"give more values; {','.join(map(str, parameters['values']))} reach "
        f"{len(parameters['values'])} cells"
    ),
    when_closed="lower the radius of inflate",
    curve=_curve_of_rings,
)
def ring_cost(
    source: ObstacleSource,
    *,
    values: Annotated[tuple[int, ...], command.PERCENT, command.COST] = (90, 70, 50),
    lethal_threshold: command.LethalThreshold | None = None,
) -> Costmap:
    """Compute costs that decrease ring by ring around obstacles.

    Parameters
    ----------
    source : OccupancyGrid or DistanceField
        The map, or a field whose map and obstacles are used.
    values : sequence of int
        Costs of the rings of cells, from the inside out. Rings lie at Chebyshev distance 1, 2, 3,
        ... from the nearest obstacle.
    lethal_threshold : int, optional
        Least occupancy of an obstacle, 1..100; 100 for a map, the field's own for a field.

    Returns
    -------
    Costmap
        Costs on scale ``occupancy``: 100 on obstacles, the ring's value in each ring, including
        its unknown cells; all other cells keep their value.

    Warns
    -----
    MapdealWarning
        If the field has a strength other than 1: rings count cells.

    References
    ----------
    ``Set_Cost_Map`` of the ROS package robot_costmap.

    Examples
    --------
    >>> from mapdeal.grid.occupancy import OccupancyGrid
    >>> grid = OccupancyGrid([[100, 0, -1, 0, 0, -1]], resolution=0.1)
    >>> ring_cost(grid).cost.tolist()
    [[100, 90, 70, 50, 0, -1]]
    """
    if not values:
        raise ParameterError("needs at least one number", place="values", got=values)
    obstacles = models.obstacles_of(source, lethal_threshold)
    models.warn_of_strength(source, "rings")
    costs = (OCCUPIED, *values)

    def rings(rows: slice) -> SignedBytes:
        return ringed(source.occupancy[rows], obstacles[rows], costs)

    cost = made_by_windows(source.occupancy, np.int8, rings, halo=len(values))
    return Costmap(cost, source.resolution, source.origin, scale="occupancy")
