"""Stage ``cost``, model ``exponential``: costmap_2d's inflation with exact distances."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.values import (
    INSCRIBED_INFLATED_OBSTACLE,
    LETHAL_OBSTACLE,
    NO_INFORMATION,
    UNKNOWN,
)
from mapdeal.kernels.blocks import blocks_of, made_by_rows, made_by_windows
from mapdeal.kernels.lookup import set_where
from mapdeal.stages.cost import cost_model
from mapdeal.stages.cost_profile import CostProfile
from mapdeal.stages.definition import Parameters, RobotShape
from mapdeal.stages.obstacle_source import (
    ObstacleSource,
    check_lethal_threshold,
    obstacles_of,
    warn_of_strength,
)
from mapdeal.stages.parameters import (
    AT_LEAST_0,
    METRES,
    PER_METRE,
    FromRobot,
    LethalThreshold,
)

_HIGHEST_GRADED = INSCRIBED_INFLATED_OBSTACLE - 1


def _title(parameters: Parameters) -> str:
    return (
        f"cost, inscribed {parameters['inscribed_radius']:.4g} m, "
        f"inflation {parameters['inflation_radius']:.4g} m, "
        f"factor {parameters['cost_scaling_factor']:.4g}"
    )


def _radii_of(footprint: Footprint) -> dict[str, object]:
    return {
        "inscribed_radius": footprint.inscribed_radius,
        "circumscribed_radius": footprint.circumscribed_radius,
    }


def _advice(parameters: Parameters, cost: int) -> str:
    """Return what to change where nearly all open cells have one cost."""
    inscribed, inflation, factor = (
        parameters[name] for name in ("inscribed_radius", "inflation_radius", "cost_scaling_factor")
    )
    if cost > 0:
        return f"raise cost_scaling_factor ({factor:g})"
    if factor > 0 and inscribed + math.log(_HIGHEST_GRADED) / factor < inflation:
        return f"lower cost_scaling_factor ({factor:g})"
    return f"raise inflation_radius ({inflation:g} m)"


@cost_model(
    "exponential",
    title=_title,
    memory=3.0,
    advice=_advice,
    when_closed="lower inscribed_radius, or the radius of inflate",
    robot=RobotShape("inscribed_radius", ("inscribed_radius", "circumscribed_radius"), _radii_of),
)
def exponential_cost(
    source: ObstacleSource,
    *,
    inscribed_radius: Annotated[float, AT_LEAST_0, METRES] = 0.0,
    inflation_radius: Annotated[float, AT_LEAST_0, METRES] = 0.55,
    cost_scaling_factor: Annotated[float, AT_LEAST_0, PER_METRE] = 10.0,
    inflate_unknown: bool = False,
    inflate_around_unknown: bool = False,
    lethal_threshold: LethalThreshold | None = None,
    circumscribed_radius: Annotated[float, AT_LEAST_0, METRES, FromRobot] | None = None,
) -> Costmap:
    """Return the costs of costmap_2d's inflation layer.

    Parameters
    ----------
    source : OccupancyGrid or DistanceField
        The map, or its distance field: obstacles then are the field's, distances its own.
    inscribed_radius : float
        Cost 253 up to here. Within it the robot collides whatever its heading.
    inflation_radius : float
        Costs reach this far. It is rounded up to whole cells.
    cost_scaling_factor : float
        Steepness, per metre. Larger is steeper.
    inflate_unknown : bool
        Unknown cells take any cost. Otherwise they only take 253 and more.
    inflate_around_unknown : bool
        Unknown cells are lethal and spread costs.
    lethal_threshold : int, optional
        Occupancy of an obstacle, 1..100; 100 for a map, a field's own for a field.
    circumscribed_radius : float, optional
        The robot cannot collide farther away. It only sets `circumscribed_cost`, and a robot's
        shape gives it.

    Returns
    -------
    Costmap
        On scale ``costmap2d``. 254 on obstacles; 253 where d <= `inscribed_radius`; else
        trunc(252 exp(-cost_scaling_factor (d - inscribed_radius))) as far as the costs reach,
        with d the metres between cell centres; unknown 255.

    Raises
    ------
    ParameterError
        If the field was clipped below the reach.

    Warns
    -----
    MapdealWarning
        If the inscribed or the circumscribed radius is larger than the inflation radius, or the
        field has a strength other than 1.

    Notes
    -----
    The reach is closed and counted in cells, d <= ceil(inflation_radius / resolution), so costs
    exist up to almost one cell beyond the radius. The brushfire of costmap_2d overestimates the
    distance of a few cells; the costs here are of the exact distance, never lower.

    References
    ----------
    ``inflation_layer.hpp`` of nav2_costmap_2d (``computeCost``, ``updateCosts``).

    Examples
    --------
    >>> from mapdeal.grid.occupancy import OccupancyGrid
    >>> grid = OccupancyGrid([[100, 0, 0, 0, 0, 0]], resolution=0.05)
    >>> exponential_cost(grid, inscribed_radius=0.1, inflation_radius=0.2).cost.tolist()
    [[254, 253, 253, 152, 92, 0]]
    """
    lethal_threshold = check_lethal_threshold(source, lethal_threshold)
    warn_of_strength(source, "exponential")
    profile = CostProfile.of(
        inscribed_radius,
        inflation_radius,
        cost_scaling_factor,
        inflate_unknown=inflate_unknown,
        inflate_around_unknown=inflate_around_unknown,
        resolution=source.resolution,
        shape=source.shape,
    )
    circumscribed_cost = profile.cost_at(circumscribed_radius)
    obstacles = obstacles_of(source, lethal_threshold)

    def around_seeds(rows: slice) -> NDArray[np.uint8]:
        cost = costs_before(source.occupancy[rows], obstacles[rows])
        if profile.reach > 0:
            profile.raise_around_seeds(cost, obstacles[rows])
        return cost

    def from_field(field: DistanceField) -> Callable[[slice], NDArray[np.uint8]]:
        def make(rows: slice) -> NDArray[np.uint8]:
            cost = costs_before(field.occupancy[rows], obstacles[rows])
            profile.raise_from_field(cost, field.part(rows), obstacles[rows])
            return cost

        return make

    if (
        isinstance(source, DistanceField)
        and profile.reach > 0
        and not (inflate_around_unknown and _has_unknown_besides(source, obstacles))
        and profile.is_in(source)
    ):
        cost = made_by_rows(source.occupancy, np.uint8, from_field(source), is_kept=True)
    else:
        cost = made_by_windows(source.occupancy, np.uint8, around_seeds, halo=profile.cells)
    return Costmap(
        cost, source.resolution, source.origin, circumscribed_cost=circumscribed_cost
    )  # fmt: skip


def _has_unknown_besides(source: DistanceField, obstacles: NDArray[np.bool_]) -> bool:
    """Return whether there are unknown cells that the field does not count as obstacles."""
    occupancy = source.occupancy
    return any(
        ((occupancy[rows] == UNKNOWN) & ~obstacles[rows]).any() for rows in blocks_of(occupancy)
    )


def costs_before(
    occupancy: NDArray[np.int8], obstacles: NDArray[np.bool_]
) -> NDArray[np.uint8]:  # fmt: skip
    """Return the costs before they spread: lethal obstacles, no information, and 0."""
    cost = np.zeros(occupancy.shape, dtype=np.uint8)
    set_where(cost, occupancy == UNKNOWN, NO_INFORMATION)
    set_where(cost, obstacles, LETHAL_OBSTACLE)
    return cost
