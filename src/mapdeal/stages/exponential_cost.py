"""Stage ``cost``, model ``exponential``: costmap_2d's inflation with exact distances."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from mapdeal import command, errors, records
from mapdeal.grid import frame, values as map_values
from mapdeal.grid.costmap import CostCurve, Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.kernels.arrays import Bytes
from mapdeal.kernels.blocks import counts_of, made_by_rows, made_by_windows
from mapdeal.kernels.lookup import look_up, set_where
from mapdeal.layers import inflation as inflation_layer, stack
from mapdeal.stages.cost import ObstacleSource, check_lethal_threshold, cost_model, warn_of_strength
from mapdeal.stages.esdf import LARGER_MAX_DISTANCE, bytes_in, furthest_kept

_CELLS_AT_ONCE = 1 << 22  # bounds the memory
_RADII = ("inscribed_radius", "circumscribed_radius")


def layer_of(parameters: command.Parameters) -> inflation_layer.InflationLayer:
    names = (field.name for field in records.fields(inflation_layer.InflationLayer))
    settings = {name: parameters[name] for name in names if name in parameters}
    return inflation_layer.InflationLayer(**settings)


def _parameters_from_layers(layers: stack.CostmapLayers) -> dict[str, object] | None:
    found = layers.static_and_inflation
    if found is None or layers.area is not None or layers.footprint is not None:
        return None
    static, inflation = found
    threshold, inscribed = static.lethal_cost_threshold, static.inscribed_obstacle_cost_value
    if inscribed is not None and not 0 <= inscribed <= map_values.OCCUPIED:
        inscribed = None
    has_special_unknown = static.unknown_cost_value != map_values.NO_INFORMATION
    if has_special_unknown or not 1 <= threshold <= map_values.OCCUPIED:
        return None
    if static.use_maximum and static.unknown_is_highest:
        return None
    # updateWithMax skips unknown cells, so the free cells of the costmap below stay free
    keeps_free = static.use_maximum and layers.default_cost == map_values.FREE_SPACE
    values: dict[str, object] = {
        "lethal_threshold": threshold,
        "trinary_costmap": static.trinary_costmap,
        "track_unknown_space": static.track_unknown_space and not keeps_free,
        "inscribed_obstacle_cost_value": inscribed,
        "float32_resolution": True,
    }
    if inflation is None or inflation.inflation_radius <= 0:
        return {**values, "inscribed_radius": 0.0, "inflation_radius": 0.0}
    values |= vars(inflation)
    del values["name"]
    return {**values, "circumscribed_radius": layers.circumscribed_radius}


def _derived(parameters: command.Parameters) -> dict[str, Any]:
    lookup, requested = parameters["lookup"], parameters["float32_resolution"]
    return {"float32_resolution": _resolution_is_float32(lookup, requested)}


def _curve(source: frame.Framed, parameters: command.Parameters) -> CostCurve:
    radius = parameters["circumscribed_radius"]
    return inflation_layer.inflation_curve(
        [layer_of(parameters)], source.resolution, circumscribed_radius=radius,
        **_derived(parameters),
    )  # fmt: skip


@cost_model(
    "exponential",
    title=(
        "cost, inscribed {inscribed_radius:.4g} m, inflation {inflation_radius:.4g} m, "
        "factor {cost_scaling_factor:.4g}"
    ).format_map,
    memory=3.0,
    advice=lambda parameters, cost: inflation_layer.advice_on(cost, layer_of(parameters)),
    when_closed="lower inscribed_radius, or the radius of inflate",
    curve=_curve,
    robot=command.RobotShape(
        "inscribed_radius", _RADII, lambda shape: {name: getattr(shape, name) for name in _RADII}
    ),
    derived=_derived,
    parameters_from_layers=_parameters_from_layers,
)
def exponential_cost(
    source: ObstacleSource,
    *,
    inscribed_radius: Annotated[float, command.AT_LEAST_0, command.METRES] = 0.0,
    inflation_radius: Annotated[float, command.AT_LEAST_0, command.METRES] = 0.55,
    cost_scaling_factor: Annotated[float, command.AT_LEAST_0, command.PER_METRE] = 10.0,
    inflate_unknown: bool = False,
    inflate_around_unknown: bool = False,
    lethal_threshold: command.LethalThreshold | None = None,
    trinary_costmap: bool = True,
    track_unknown_space: bool = True,
    inscribed_obstacle_cost_value: Annotated[int, command.PERCENT, command.OCCUPANCY] | None = None,
    lookup: inflation_layer.CostLookup = "exact",
    float32_resolution: bool | None = None,
    circumscribed_radius: Annotated[float, command.AT_LEAST_0, command.METRES, command.FromRobot]
    | None = None,
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
        range is then rounded up without a tolerance.
    circumscribed_radius : float, optional
        Distance beyond which the robot cannot collide, metres. It only sets `circumscribed_cost`.
        A robot's shape sets this radius.

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
    The range is closed and counted in cells, d <= ceil(inflation_radius / resolution). Costs are
    never below those of the brushfire of costmap_2d up to Nav2 Kilted, and with lookup ``nav2``
    equal those of newer releases byte for byte. Unknown cells that a field counts as obstacles are
    lethal.

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
    layer = inflation_layer.InflationLayer(
        inscribed_radius=inscribed_radius, inflation_radius=inflation_radius,
        cost_scaling_factor=cost_scaling_factor, inflate_unknown=inflate_unknown,
        inflate_around_unknown=inflate_around_unknown, lookup=lookup,
    )  # fmt: skip
    inflation_layer.warn_of_radii(layer)
    is_float32 = _resolution_is_float32(lookup, float32_resolution)
    cell_size = frame.as_float32(source.resolution) if is_float32 else source.resolution
    is_tolerant = not is_float32
    profile = inflation_layer.CostProfile(layer, source.shape, cell_size, is_tolerant=is_tolerant)
    table = map_values.static_layer_cost_from_occupancy(
        lethal_threshold=check_lethal_threshold(source, lethal_threshold), trinary=trinary_costmap,
        track_unknown=track_unknown_space, inscribed_value=inscribed_obstacle_cost_value,
    )  # fmt: skip
    field = None
    if isinstance(source, DistanceField) and profile.reach > 0:
        has_same_obstacles = _spreads_from_obstacles(source, table, inflate_around_unknown)
        field = source if has_same_obstacles and _distinguishes(source, profile) else None

    def costs(rows: slice) -> Bytes:
        cost = base_costs(source, table, rows)
        if field is None:
            profile.raise_around_seeds(cost)
        else:
            _raise_from_field(profile, cost, field.part(rows))
        return cost

    if field is None:
        cost = made_by_windows(source.occupancy, np.uint8, costs, halo=profile.cells)
    else:
        cost = made_by_rows(source.occupancy, np.uint8, costs, is_cached=True)
    at_circumscribed = inflation_layer.circumscribed_cost(circumscribed_radius, layer)
    return Costmap(cost, source.resolution, source.origin, circumscribed_cost=at_circumscribed)


def base_costs(source: ObstacleSource, table: Bytes, rows: slice) -> Bytes:
    """Return the costs of rows before inflation, by the table of the static layer."""
    occupancy = source.occupancy[rows]
    cost: Bytes = look_up(occupancy, table)
    if isinstance(source, DistanceField) and source.unknown == "occupied":
        set_where(cost, occupancy == map_values.UNKNOWN, map_values.LETHAL_OBSTACLE)
    return cost


def _spreads_from_obstacles(field: DistanceField, table: Bytes, around_unknown: bool) -> bool:
    is_lethal = table == map_values.LETHAL_OBSTACLE
    differs = np.zeros(256, dtype=np.bool_)
    obstacles = np.arange(map_values.OCCUPIED + 1) >= field.lethal_threshold
    differs[: map_values.OCCUPIED + 1] = is_lethal[: map_values.OCCUPIED + 1] != obstacles
    if field.unknown == "free" and around_unknown:
        differs[map_values.UNKNOWN] = table[map_values.UNKNOWN] == map_values.NO_INFORMATION
    return not differs.any() or not counts_of(field.occupancy)[differs].any()


def _distinguishes(field: DistanceField, profile: inflation_layer.CostProfile) -> bool:
    # A clipped field cannot distinguish cells exactly at the limit from those beyond it.
    metres = profile.reach * field.resolution
    if field.max_distance is None or furthest_kept(field) > metres * (1 + 1e-6):
        return True
    if field.max_distance < metres * (1 - 1e-6):
        rule = f"the field is clipped below the range of the costs, {metres:g} m"
        got, hint = field.max_distance, LARGER_MAX_DISTANCE
        raise errors.ParameterError(rule, place="max_distance", got=got, hint=hint)
    return False


def _raise_from_field(
    profile: inflation_layer.CostProfile, cost: Bytes, field: DistanceField
) -> None:
    height, width = cost.shape
    step = max(1, _CELLS_AT_ONCE // max(1, width))
    for first in range(0, height, step):
        rows = slice(first, min(first + step, height))
        part = field.part(rows)
        profile.raise_costs(cost[rows], bytes_in(part, part.obstacles(), profile.table))


def _resolution_is_float32(lookup: inflation_layer.CostLookup, requested: bool | None) -> bool:
    if lookup == "nav2" and requested is False:
        rule = "cannot be no with lookup nav2, which takes the resolution of a map message"
        raise errors.ParameterError(rule, place="float32_resolution")
    return lookup == "nav2" or bool(requested)
