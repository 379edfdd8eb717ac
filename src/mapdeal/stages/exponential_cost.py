"""Stage ``cost``, model ``exponential``: costmap_2d's inflation with exact distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import (
    AT_LEAST_0,
    METRES,
    OCCUPANCY,
    PER_METRE,
    PERCENT,
    FromRobot,
    LethalThreshold,
    Parameters,
    RobotShape,
)
from mapdeal.grid.costmap import CostCurve, CostLookup, Costmap, CostmapLayers, InflationLayer
from mapdeal.grid.field import DistanceField
from mapdeal.grid.framed import Framed
from mapdeal.grid.values import (
    FREE_SPACE,
    LETHAL_OBSTACLE,
    NO_INFORMATION,
    OCCUPIED,
    UNKNOWN,
    static_layer_cost_from_occupancy,
)
from mapdeal.kernels.blocks import counts_of, made_by_rows, made_by_windows
from mapdeal.kernels.lookup import look_up, set_where
from mapdeal.stages.cost import ObstacleSource, check_lethal_threshold, cost_model, warn_of_strength
from mapdeal.stages.cost_profile import (
    CostProfile,
    advice_on,
    inflation_curve,
    resolution_is_float32,
    warn_of_radii,
)

_RADII = ("inscribed_radius", "circumscribed_radius")


def _title(parameters: Parameters) -> str:
    return (
        f"cost, inscribed {parameters['inscribed_radius']:.4g} m, "
        f"inflation {parameters['inflation_radius']:.4g} m, "
        f"factor {parameters['cost_scaling_factor']:.4g}"
    )


def _of_layers(layers: CostmapLayers) -> dict[str, object] | None:
    """Return the parameters of one static layer and at most one inflation layer above it."""
    found = layers.static_and_inflation
    if found is None:
        return None
    static, inflation = found
    threshold, inscribed = static.lethal_cost_threshold, static.inscribed_obstacle_cost_value
    if static.unknown_cost_value != NO_INFORMATION or not 1 <= threshold <= OCCUPIED:
        return None
    # updateWithMax leaves what is unknown below, and a free costmap is all that lies below
    keeps_free = static.use_maximum and layers.default_cost == FREE_SPACE
    values: dict[str, object] = {
        "lethal_threshold": threshold,
        "trinary_costmap": static.trinary_costmap,
        "track_unknown_space": static.track_unknown_space and not keeps_free,
        "inscribed_obstacle_cost_value": (
            inscribed if inscribed is not None and 0 <= inscribed <= OCCUPIED else None
        ),
        "float32_resolution": True,
    }
    if inflation is None or inflation.inflation_radius <= 0:
        return {**values, "inscribed_radius": 0.0, "inflation_radius": 0.0}
    return {
        **values,
        "inscribed_radius": inflation.inscribed_radius,
        "inflation_radius": inflation.inflation_radius,
        "cost_scaling_factor": inflation.cost_scaling_factor,
        "inflate_unknown": inflation.inflate_unknown,
        "inflate_around_unknown": inflation.inflate_around_unknown,
        "lookup": inflation.lookup,
        "circumscribed_radius": layers.circumscribed_radius,
    }


def _settled(parameters: Parameters) -> dict[str, Any]:
    lookup, asked = parameters["lookup"], parameters["float32_resolution"]
    return {"float32_resolution": resolution_is_float32(lookup, asked)}


def _curve(source: Framed, parameters: Parameters) -> CostCurve:
    names = ("inscribed_radius", "inflation_radius", "cost_scaling_factor", "lookup")
    return inflation_curve(
        [InflationLayer(**{name: parameters[name] for name in names})],
        source.resolution,
        circumscribed_radius=parameters["circumscribed_radius"],
        **_settled(parameters),
    )


def _advice(parameters: Parameters, cost: int) -> str:
    names = ("inscribed_radius", "inflation_radius", "cost_scaling_factor")
    return advice_on(cost, *(parameters[name] for name in names))


@cost_model(
    "exponential",
    title=_title,
    memory=3.0,
    advice=_advice,
    when_closed="lower inscribed_radius, or the radius of inflate",
    curve=_curve,
    robot=RobotShape(
        "inscribed_radius",
        _RADII,
        lambda footprint: {name: getattr(footprint, name) for name in _RADII},
    ),
    settled=_settled,
    of_layers=_of_layers,
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
    trinary_costmap: bool = True,
    track_unknown_space: bool = True,
    inscribed_obstacle_cost_value: Annotated[int, PERCENT, OCCUPANCY] | None = None,
    lookup: CostLookup = "exact",
    float32_resolution: bool | None = None,
    circumscribed_radius: Annotated[float, AT_LEAST_0, METRES, FromRobot] | None = None,
) -> Costmap:
    """Compute the costs of costmap_2d's static layer and inflation layer.

    Parameters
    ----------
    source : OccupancyGrid or DistanceField
        The map, or its distance field, whose obstacles and distances are then used.
    inscribed_radius : float
        Radius within which cells cost 253, metres. There the robot collides whatever its heading.
    inflation_radius : float
        Radius up to which cells have costs, metres. It is rounded up to whole cells.
    cost_scaling_factor : float
        Decay of the costs, per metre. Larger is steeper.
    inflate_unknown : bool
        Whether unknown cells take any cost. Otherwise they take only 253 and 254.
    inflate_around_unknown : bool
        Whether unknown cells are lethal and spread costs.
    lethal_threshold : int, optional
        Least occupancy of an obstacle, 1..100; 100 for a map, the field's own for a field.
    trinary_costmap : bool
        Whether values below the threshold are free. Otherwise they start with the cost
        trunc(254 v / `lethal_threshold`).
    track_unknown_space : bool
        Whether unknown cells are 255. Otherwise they are free, cost 0.
    inscribed_obstacle_cost_value : int, optional
        Occupancy that becomes 253, inscribed. Nav2 newer than Kilted uses 99; older releases and
        ROS 1 have no such rule.
    lookup : {'exact', 'nav2'}
        How a distance becomes a cost. ``exact``: unrounded, as in ROS 1 and Nav2 up to Kilted.
        ``nav2``: rounded to 1/100 cell, as in newer releases.
    float32_resolution : bool, optional
        Whether to round the resolution to float32, as in map messages; lookup nav2 always does. The
        range is counted in such cells, without a tolerance.
    circumscribed_radius : float, optional
        Distance beyond which the robot cannot collide, metres. It only sets `circumscribed_cost`,
        and a robot's shape defines it.

    Returns
    -------
    Costmap
        Costs on scale ``costmap2d``: 254 on obstacles, 253 where d <= `inscribed_radius`, then
        trunc(252 exp(-cost_scaling_factor (d - inscribed_radius))) within the range of the costs,
        with d the distance between cell centres in metres; unknown cells are 255.

    Raises
    ------
    ParameterError
        If the field was clipped below the range of the costs, or `float32_resolution` is False
        with lookup ``nav2``.

    Warns
    -----
    MapdealWarning
        If the inscribed or circumscribed radius is larger than the inflation radius, or the field
        has a strength other than 1.

    Notes
    -----
    The range is closed and counted in cells, d <= ceil(inflation_radius / resolution), so costs
    extend up to almost one cell beyond the radius. The brushfire of costmap_2d, up to Nav2 Kilted,
    overestimates the distance of a few cells; the costs here use the exact distance and are never
    lower. With lookup ``nav2`` they equal those of newer releases byte for byte.

    Unknown cells that a field counts as obstacles are lethal, regardless of
    `track_unknown_space`.

    References
    ----------
    ``inflation_layer.hpp`` of nav2_costmap_2d (``computeCost``, ``updateCosts``);
    ``interpretValue`` in its ``static_layer.cpp``.

    Examples
    --------
    >>> from mapdeal.grid.occupancy import OccupancyGrid
    >>> grid = OccupancyGrid([[100, 0, 0, 0, 0, 0]], resolution=0.05)
    >>> exponential_cost(grid, inscribed_radius=0.1, inflation_radius=0.2).cost.tolist()
    [[254, 253, 253, 152, 92, 0]]
    """
    warn_of_strength(source, "exponential")
    warn_of_radii(inscribed_radius, inflation_radius)
    profile = CostProfile.of(
        source,
        inscribed_radius=inscribed_radius,
        inflation_radius=inflation_radius,
        cost_scaling_factor=cost_scaling_factor,
        inflate_unknown=inflate_unknown,
        inflate_around_unknown=inflate_around_unknown,
        lookup=lookup,
        float32_resolution=float32_resolution,
    )
    base = BaseCosts.of(
        source,
        lethal_threshold=lethal_threshold,
        trinary_costmap=trinary_costmap,
        track_unknown_space=track_unknown_space,
        inscribed_obstacle_cost_value=inscribed_obstacle_cost_value,
    )

    def around_seeds(rows: slice) -> NDArray[np.uint8]:
        cost = base.costs(rows)
        profile.raise_around_seeds(cost)
        return cost

    if (
        isinstance(source, DistanceField)
        and profile.reach > 0
        and base.spread_from_obstacles(source, around_unknown=inflate_around_unknown)
        and profile.is_in(source)
    ):
        field = source

        def from_field(rows: slice) -> NDArray[np.uint8]:
            cost = base.costs(rows)
            profile.raise_from_field(cost, field.part(rows))
            return cost

        cost = made_by_rows(source.occupancy, np.uint8, from_field, is_kept=True)
    else:
        cost = made_by_windows(source.occupancy, np.uint8, around_seeds, halo=profile.cells)
    at_circumscribed = profile.cost_at(circumscribed_radius)
    return Costmap(cost, source.resolution, source.origin, circumscribed_cost=at_circumscribed)


@dataclass(frozen=True, eq=False)
class BaseCosts:
    """Costs before inflation."""

    source: ObstacleSource
    table: NDArray[np.uint8]

    @classmethod
    def of(
        cls,
        source: ObstacleSource,
        *,
        lethal_threshold: int | None,
        trinary_costmap: bool,
        track_unknown_space: bool,
        inscribed_obstacle_cost_value: int | None,
        **_: object,
    ) -> BaseCosts:
        """Create them from parameters of `exponential_cost`; unrelated ones are ignored."""
        table = static_layer_cost_from_occupancy(
            lethal_threshold=check_lethal_threshold(source, lethal_threshold),
            trinary=trinary_costmap,
            track_unknown=track_unknown_space,
            inscribed_value=inscribed_obstacle_cost_value,
        )
        return cls(source, table)

    def costs(self, rows: slice) -> NDArray[np.uint8]:
        """Return the costs of some rows."""
        occupancy = self.source.occupancy[rows]
        cost: NDArray[np.uint8] = look_up(occupancy, self.table)
        if isinstance(self.source, DistanceField) and self.source.unknown == "occupied":
            set_where(cost, occupancy == UNKNOWN, LETHAL_OBSTACLE)
        return cost

    def spread_from_obstacles(self, field: DistanceField, *, around_unknown: bool) -> bool:
        others = np.zeros(256, dtype=np.uint8)
        others[: field.lethal_threshold] = self.table[: field.lethal_threshold] == LETHAL_OBSTACLE
        lethal = slice(field.lethal_threshold, OCCUPIED + 1)
        others[lethal] = self.table[lethal] != LETHAL_OBSTACLE
        if field.unknown == "free":
            others[UNKNOWN] = around_unknown and self.table[UNKNOWN] == NO_INFORMATION
        return not others.any() or not counts_of(field.occupancy)[others.view(np.bool_)].any()
