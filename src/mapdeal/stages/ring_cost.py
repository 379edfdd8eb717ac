"""Stage ``cost``, model ``rings``: one value for each ring of cells around obstacles."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import COST, PERCENT, LethalThreshold, Parameters
from mapdeal.errors import ParameterError
from mapdeal.grid.costmap import CostCurve, Costmap
from mapdeal.grid.framed import Framed
from mapdeal.grid.values import OCCUPIED
from mapdeal.kernels.blocks import made_by_windows
from mapdeal.kernels.dilation import ringed
from mapdeal.stages.cost import (
    ObstacleSource,
    check_lethal_threshold,
    cost_model,
    obstacles_of,
    warn_of_strength,
)


def _curve(source: Framed, parameters: Parameters) -> CostCurve:
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
    curve=_curve,
)
def ring_cost(
    source: ObstacleSource,
    *,
    values: Annotated[tuple[int, ...], PERCENT, COST] = (90, 70, 50),
    lethal_threshold: LethalThreshold | None = None,
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
    threshold = check_lethal_threshold(source, lethal_threshold)
    warn_of_strength(source, "rings")
    obstacles = obstacles_of(source, threshold)
    costs = (OCCUPIED, *values)

    def rings(rows: slice) -> NDArray[np.int8]:
        return ringed(source.occupancy[rows], obstacles[rows], costs)

    cost = made_by_windows(source.occupancy, np.int8, rings, halo=len(values))
    return Costmap(cost, source.resolution, source.origin, scale="occupancy")
