"""Stage ``cost``, model ``threshold``: design document 000's costs from the field's view."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.kernels.blocks import blocks_of
from mapdeal.stages.cost import cost_model
from mapdeal.stages.esdf import View, ViewScale, esdf
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

_HIGHEST_BELOW_OBSTACLE = 99


@cost_model(
    "threshold",
    title=lambda p: f"cost, thresholds {p['down']:g} and {p['up']:g}, {p['view']}",
    memory=9.0,
)
def threshold_cost(
    source: ObstacleSource,
    *,
    down: Annotated[float, PERCENT, VIEW_VALUE] = 45,
    up: Annotated[float, PERCENT, VIEW_VALUE] = 54,
    down_factor: Annotated[float, AT_LEAST_0, FACTOR] = 0.0,
    up_factor: Annotated[float, AT_LEAST_0, FACTOR] = 1.5,
    view: View = "metric",
    view_range: Annotated[float, ABOVE_0, METRES] = 2.0,
    lethal_threshold: LethalThreshold | None = None,
) -> Costmap:
    """Return costs by thresholds on the 0..100 view of the distance field.

    Parameters
    ----------
    source : OccupancyGrid or DistanceField
        The field; a map is made into one first, with unknown cells free.
    down : float
        View values up to here cost 0.
    up : float
        End of the middle range.
    down_factor : float
        Factor of the middle range.
    up_factor : float
        Factor of the near range.
    view : {'metric', 'seed'}
        How distances become 0..100. See `mapdeal.field_view`.
    view_range : float
        Where the metric view is 0.
    lethal_threshold : int, optional
        Occupancy of an obstacle, 1..100; 100 for a map, a field's own for a field.

    Returns
    -------
    Costmap
        On scale ``occupancy``. With v the view: 0 for v <= down; trunc(down_factor v) up to
        `up`; trunc(up_factor v) above it, at most 99; obstacles 100 and unknown -1 are kept.

    Raises
    ------
    ParameterError
        If the field was clipped where the costs still depend on the distance.

    Notes
    -----
    Design document 000 lets the product overflow its 8 bits; 100 is kept for obstacles here.

    Examples
    --------
    >>> from mapdeal.grid.occupancy import OccupancyGrid
    >>> grid = OccupancyGrid([[100, 0, 0, 0, 0, -1]], resolution=0.25)
    >>> threshold_cost(grid).cost.tolist()  # the view is 100, 87, 75, 62, 50, -1
    [[100, 99, 99, 93, 0, -1]]
    """
    table = table_of_views(down, up, down_factor, up_factor)
    threshold = check_lethal_threshold(source, lethal_threshold)
    if not isinstance(source, DistanceField):
        source = esdf(source, lethal_threshold=threshold)
    if source.max_distance is not None:
        for rows in blocks_of(source.distance):
            check_clip(source.part(rows), down, view, view_range)
    obstacles = source.obstacles()
    scale = ViewScale.of(source, obstacles, view=view, view_range=view_range)
    cost = scale.values_of(source, obstacles, table)
    return Costmap(cost, source.resolution, source.origin, scale="occupancy")


def table_of_views(
    down: float, up: float, down_factor: float, up_factor: float
) -> NDArray[np.int8]:
    """Return the cost of each value of the view, shape (256,), by its byte: -1 is the last."""
    if down > up:
        raise ParameterError(f"must not be larger than up ({up:g})", place="down", got=down)
    table = np.zeros(256, dtype=np.int8)
    for value in range(FREE, OCCUPIED):
        factor = 0.0 if value <= down else down_factor if value <= up else up_factor
        table[value] = int(min(factor * value, _HIGHEST_BELOW_OBSTACLE))
    table[OCCUPIED] = OCCUPIED
    table[UNKNOWN] = UNKNOWN
    return table


def check_clip(field: DistanceField, down: float, view: View, view_range: float) -> None:
    """Refuse a field whose clipped cells would get another cost at their true distance.

    In the metric view all is well if cells at the clip cost nothing already. The seed view is
    scaled by the farthest and the deepest cell, which a clip hides.
    """
    if field.max_distance is None:
        return
    limit = np.float32(field.max_distance)
    clipped = (field.distance >= limit * np.float32(field.strength)) | (field.distance <= -limit)
    if not clipped.any():
        return
    at_clip = 100 * (1 - min(field.max_distance, view_range) / view_range)
    if view == "metric" and int(at_clip) <= down:
        return
    rule = f"the field is clipped where the {view} view still falls"
    hint = "make the field with a larger max_distance, or none"
    raise ParameterError(rule, place="max_distance", got=field.max_distance, hint=hint)
