"""Stage ``cost``, model ``threshold``: costs by thresholds on the field's view."""

from __future__ import annotations

import functools
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError, emit_warning
from mapdeal.grid.cost_curve import CostCurve
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.field_view import FieldView, View, ViewScale
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.kernels.blocks import looked_up, swept
from mapdeal.records import dataclass
from mapdeal.stages.cost import cost_model
from mapdeal.stages.definition import InPlaceOf, Parameters
from mapdeal.stages.esdf import Viewer, esdf
from mapdeal.stages.field_values import furthest_kept
from mapdeal.stages.obstacle_source import ObstacleSource, check_lethal_threshold
from mapdeal.stages.parameters import (
    ABOVE_0,
    AT_LEAST_0,
    FACTOR,
    METRES,
    PERCENT,
    VIEW_VALUE,
    LethalThreshold,
)
from mapdeal.stages.view_curve import view_curve

_HIGHEST_BELOW_OBSTACLE = 99

_TOLERANCE = 1e-9
"""Metres by which a cell may be nearer than a threshold, through rounding."""


def _title(parameters: Parameters) -> str:
    named = []
    for name in ("down", "up"):
        distance = parameters[f"{name}_distance"]
        named.append(f"{parameters[name]:g}" if distance is None else f"{distance:g} m")
    return f"cost, thresholds {' and '.join(named)}, {parameters['view']}"


def _distance_as_value(parameters: Parameters, name: str) -> float | None:
    """Return the view at a threshold in metres; in the per-map view the map decides."""
    if parameters["view"] != "metric":
        return None
    scale = ViewScale("metric", parameters["view_range"])
    return _value_at(parameters[name], name, None, scale, 0.0)


def _advice(parameters: Parameters, cost: int) -> str:
    """Return what to change where nearly all open cells have one cost."""
    if cost == 0:
        return _advice_on_nothing(parameters)
    if parameters["view"] == "per-map":
        return "view per-map is scaled by the extremes of the map; take view metric"
    if cost == _HIGHEST_BELOW_OBSTACLE:
        return f"lower up_factor ({parameters['up_factor']:g})"
    return "change down, up and their factors"


def _advice_on_nothing(parameters: Parameters) -> str:
    """Return what to change where nearly all open cells cost 0.

    The costs begin at `down`, but where the factor makes 0 of the whole middle range, at `up`.
    """
    up, factor = parameters["up"], parameters["down_factor"]
    begin = "down" if factor * (OCCUPIED if up is None else up) >= 1 else "up"
    if begin == "up" and parameters["up_factor"] * _HIGHEST_BELOW_OBSTACLE < 1:
        return f"raise up_factor ({parameters['up_factor']:g})"
    lengths = {} if parameters["view"] == "per-map" else {"view_range": parameters["view_range"]}
    value, distance = parameters[begin], parameters[f"{begin}_distance"]
    if distance is not None:
        # up_distance must not be larger than down_distance, and neither than view_range
        limits = {"down_distance": parameters["down_distance"], **lengths}
        reached = [name for name, limit in limits.items() if limit == distance]
        others = [f" and {name}" for name in reached if name != f"{begin}_distance"]
        return f"raise {begin}_distance ({distance:g} m){''.join(others)}"
    if value == 0:
        return ", or ".join(["raise up_factor and down_factor", *lengths])
    if begin == "down" or not parameters["down"]:
        return f"lower {begin} ({value:g}), or give {begin}_distance in metres"
    both = f"lower up ({value:g}) and down ({parameters['down']:g})"
    return f"{both}, or give up_distance and down_distance in metres"


def _curve(source: ObstacleSource | FieldView, parameters: Parameters) -> CostCurve:
    names = ("down", "up", "down_distance", "up_distance")
    view, view_range = parameters["view"], parameters["view_range"]
    strength = source.strength if isinstance(source, DistanceField) else 1.0
    if isinstance(source, FieldView):
        scale = source.scale
    elif view == "metric":
        scale = ViewScale(view, view_range)
    else:
        field = _field_of(source, parameters["lethal_threshold"])
        scale = Viewer.of(field, field.obstacles(), view=view, view_range=view_range).scale
    thresholds = _Thresholds.of(
        scale, source.resolution, **{name: parameters[name] for name in names}
    )
    factors = parameters["down_factor"], parameters["up_factor"]
    table = table_of_views(thresholds.down, thresholds.up, *factors)
    marks = {"down": thresholds.down, "up": thresholds.up}
    return view_curve(scale, strength, source.resolution, table, marks)


@cost_model(
    "threshold",
    title=_title,
    memory=9.0,
    advice=_advice,
    when_closed="lower the radius of inflate",
    curve=_curve,
    in_place_of={
        name: InPlaceOf(value, functools.partial(_distance_as_value, name=name))
        for value, name in (("down", "down_distance"), ("up", "up_distance"))
    },
)
def threshold_cost(
    source: ObstacleSource | FieldView,
    *,
    down: Annotated[float, PERCENT, VIEW_VALUE] | None = 45,
    up: Annotated[float, PERCENT, VIEW_VALUE] | None = 54,
    down_distance: Annotated[float, AT_LEAST_0, METRES] | None = None,
    up_distance: Annotated[float, AT_LEAST_0, METRES] | None = None,
    down_factor: Annotated[float, AT_LEAST_0, FACTOR] = 0.0,
    up_factor: Annotated[float, AT_LEAST_0, FACTOR] = 1.5,
    view: View = "metric",
    view_range: Annotated[float, ABOVE_0, METRES] = 2.0,
    lethal_threshold: LethalThreshold | None = None,
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
        Distance from obstacles at and beyond which cells cost 0, metres. It replaces `down`, which
        becomes the view at this distance.
    up_distance : float, optional
        Distance below which cells belong to the near range, metres. It replaces `up`, which
        becomes the view at this distance.
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
        Costs on scale ``occupancy``. With v the view value: 0 for v <= down, trunc(down_factor v)
        up to `up`, and trunc(up_factor v), at most 99, above it; obstacles stay 100 and unknown
        cells -1.

    Raises
    ------
    ParameterError
        If the field was clipped where the costs still depend on the distance, `down` exceeds
        `up`, or a distance lies where the view is already 0.

    Notes
    -----
    Distances are those between cell centres times the field's strength. The view is truncated to
    whole numbers, so that a threshold in metres takes effect up to one view value closer to
    obstacles.

    The rule is that of robot_costmap, where the product overflows 8 bits; here 100 is reserved for
    obstacles.

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
        _check_view(source, view, view_range, lethal_threshold)
        scale = source.scale
    else:
        source = _field_of(source, lethal_threshold)
        obstacles = source.obstacles()
        viewer = Viewer.of(source, obstacles, view=view, view_range=view_range)
        scale = viewer.scale
    _check_order(down_distance, up_distance)
    thresholds = _Thresholds.of(
        scale, source.resolution, down=down, up=up, down_distance=down_distance,
        up_distance=up_distance,
    )  # fmt: skip
    table = table_of_views(thresholds.down, thresholds.up, down_factor, up_factor)
    if isinstance(source, FieldView):
        cost = looked_up(source.occupancy, table)
    else:
        if source.max_distance is not None:
            for rows in swept(source.distance):
                check_clip(source.part(rows), thresholds.down, view, view_range)
        cost = viewer.values_of(source, obstacles, table)
    return Costmap(cost, source.resolution, source.origin, scale="occupancy")


def _field_of(
    source: ObstacleSource, lethal_threshold: int | None
) -> DistanceField:  # fmt: skip
    """Return a field as it is, and that of a map, with unknown cells free."""
    threshold = check_lethal_threshold(source, lethal_threshold)
    if isinstance(source, DistanceField):
        return source
    return esdf(source, lethal_threshold=threshold)


@dataclass(frozen=True)
class _Thresholds:
    """Both thresholds as values of the view."""

    down: float
    up: float

    @classmethod
    def of(
        cls, scale: ViewScale, resolution: float, *, down: float | None, up: float | None,
        down_distance: float | None, up_distance: float | None,
    ) -> _Thresholds:  # fmt: skip
        """Return the thresholds on a scale, of values or of metres, whichever are given."""
        lower = _value_at(down_distance, "down_distance", down, scale, resolution)
        upper = _value_at(up_distance, "up_distance", up, scale, resolution)
        _check_order_of_views(lower, upper, down_distance, up_distance)
        return cls(lower, upper)


def _check_view(
    source: FieldView, view: View, view_range: float, lethal_threshold: int | None
) -> None:
    """Warn of parameters that an input which is a view already makes void; refuse one."""
    if lethal_threshold not in (None, OCCUPIED):
        rule = "the view was made with a threshold of its own"
        raise ParameterError(rule, place="lethal_threshold", got=lethal_threshold)
    asked = ViewScale(view, view_range)
    if asked.view != source.scale.view or (view == "metric" and asked != source.scale):
        text = f"cost: the input is a view already, {source.scale.described()}; it is used as it is"
        emit_warning(text, stacklevel=4)


def _check_order(down_distance: float | None, up_distance: float | None) -> None:
    if down_distance is None or up_distance is None or down_distance >= up_distance:
        return
    rule = f"must not be less than up_distance ({up_distance:g} m)"
    raise ParameterError(rule, place="down_distance", got=down_distance)


def _check_order_of_views(
    lower: float, upper: float, down_distance: float | None, up_distance: float | None
) -> None:
    """Refuse a threshold in metres that contradicts the other one, which is a view value."""
    if lower <= upper or (down_distance is None) == (up_distance is None):
        return
    if up_distance is None:
        rule = f"the view is {lower:g} there, above up ({upper:g})"
        raise ParameterError(
            rule, place="down_distance", got=down_distance, hint="give up_distance as well"
        )
    rule = f"the view is {upper:g} there, below down ({lower:g})"
    raise ParameterError(
        rule, place="up_distance", got=up_distance, hint="give down_distance as well"
    )


def _value_at(
    distance: float | None, name: str, value: float | None, scale: ViewScale, resolution: float
) -> float:
    """Return the view at a distance, or the value that is given where no distance is."""
    if distance is None:
        if value is None:
            raise ParameterError("is required if its value is none", place=name)
        return value
    if scale.view == "metric" and distance > scale.view_range:
        rule = f"must not be larger than view_range ({scale.view_range:g} m), where the view is 0"
        raise ParameterError(rule, place=name, got=distance, hint=f"give view_range {distance:g}")
    return scale.value_at(max(distance - _TOLERANCE, 0.0), resolution)


def table_of_views(
    down: float, up: float, down_factor: float, up_factor: float
) -> NDArray[np.int8]:
    """Return the cost of each view value, shape (256,), by byte: -1 is the last."""
    if down > up:
        rule = f"must not be larger than up ({up:g})"
        raise ParameterError(rule, place="down", got=down)
    table = np.zeros(256, dtype=np.int8)
    for value in range(FREE, OCCUPIED):
        factor = 0.0 if value <= down else down_factor if value <= up else up_factor
        table[value] = int(min(factor * value, _HIGHEST_BELOW_OBSTACLE))
    table[OCCUPIED] = OCCUPIED
    table[UNKNOWN] = UNKNOWN
    return table


def check_clip(field: DistanceField, down: float, view: View, view_range: float) -> None:
    """Refuse a field whose clipped cells would cost something else at their true distance.

    In the metric view, clipping has no effect if cells at the limit already cost 0. The per-map
    view is scaled by the farthest and deepest cells, which clipping hides.
    """
    if field.max_distance is None:
        return
    limit = np.float32(field.max_distance)
    clipped = (field.distance >= limit * np.float32(field.strength)) | (field.distance <= -limit)
    if not clipped.any():
        return
    end = field.strength * furthest_kept(field)
    at_clip = 100 * (1 - min(end, view_range) / view_range)
    if view == "metric" and int(at_clip) <= down:
        return
    rule = f"the field is clipped where the {view} view still falls"
    hint = "make the field with a larger max_distance, or none"
    raise ParameterError(rule, place="max_distance", got=field.max_distance, hint=hint)
