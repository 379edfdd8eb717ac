"""Stage ``cost``, models ``exponential`` and ``layers``: those of costmap_2d."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Annotated, Any

import numpy as np

from mapdeal import command, errors, records
from mapdeal.grid import frame as frames, values as map_values
from mapdeal.grid.costmap import CostCurve, Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels import blocks
from mapdeal.kernels.arrays import Bytes, Integers, Mask, SignedBytes
from mapdeal.kernels.lookup import look_up, set_where
from mapdeal.layers import inflation as inflation_layer
from mapdeal.layers.inflation import advice_on, inflation_curve
from mapdeal.layers.keepout import KeepoutFilter, MaskCosts, cells_at_centres
from mapdeal.layers.layer import MasterGrid
from mapdeal.layers.stack import CostmapArea, CostmapLayers, cells_below, covered_cells
from mapdeal.layers.static import StaticLayer
from mapdeal.stages import cost as models
from mapdeal.stages.cost import ObstacleSource, cost_model
from mapdeal.stages.esdf import LARGER_MAX_DISTANCE, bytes_in, furthest_kept
from mapdeal.stages.structured import LayerList

_CELLS_AT_ONCE = 1 << 22  # bounds the memory
_RADII = ("inscribed_radius", "circumscribed_radius")
_DEFAULT_LAYERS = (StaticLayer(), inflation_layer.InflationLayer())
_EMPTY_COST = command.Condition("0 or 255", lambda value: value in (0, 255))


def layer_of(parameters: command.Parameters) -> inflation_layer.InflationLayer:
    names = (field.name for field in records.fields(inflation_layer.InflationLayer))
    settings = {name: parameters[name] for name in names if name in parameters}
    return inflation_layer.InflationLayer(**settings)


def _exponential_parameters(layers: CostmapLayers) -> dict[str, object] | None:
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


def _exponential_curve(source: frames.Framed, parameters: command.Parameters) -> CostCurve:
    radius = parameters["circumscribed_radius"]
    return inflation_curve(
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
    advice=lambda parameters, cost: advice_on(cost, layer_of(parameters)),
    when_closed="lower inscribed_radius, or the radius of inflate",
    curve=_exponential_curve,
    robot=command.RobotShape(
        "inscribed_radius", _RADII, lambda shape: {name: getattr(shape, name) for name in _RADII}
    ),
    derived=_derived,
    parameters_from_layers=_exponential_parameters,
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
    models.warn_of_strength(source, "exponential")
    layer = inflation_layer.InflationLayer(
        inscribed_radius=inscribed_radius, inflation_radius=inflation_radius,
        cost_scaling_factor=cost_scaling_factor, inflate_unknown=inflate_unknown,
        inflate_around_unknown=inflate_around_unknown, lookup=lookup,
    )  # fmt: skip
    inflation_layer.warn_of_radii(layer)
    is_float32 = _resolution_is_float32(lookup, float32_resolution)
    cell_size = frames.as_float32(source.resolution) if is_float32 else source.resolution
    is_tolerant = not is_float32
    profile = inflation_layer.CostProfile(layer, source.shape, cell_size, is_tolerant=is_tolerant)
    table = map_values.static_layer_cost_from_occupancy(
        lethal_threshold=models.check_lethal_threshold(source, lethal_threshold),
        trinary=trinary_costmap, track_unknown=track_unknown_space,
        inscribed_value=inscribed_obstacle_cost_value,
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
        cost = blocks.made_by_windows(source.occupancy, np.uint8, costs, halo=profile.cells)
    else:
        cost = blocks.made_by_rows(source.occupancy, np.uint8, costs, is_cached=True)
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
    return not differs.any() or not blocks.counts_of(field.occupancy)[differs].any()


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


def _stack_of(parameters: command.Parameters) -> CostmapLayers:
    return CostmapLayers(parameters["layers"], parameters["default_cost"])


def _advice(parameters: command.Parameters, cost: int) -> str:
    inflations = _stack_of(parameters).inflation_layers
    return advice_on(cost, inflations[-1]) if inflations else "no inflation layer spreads costs"


def _layered_parameters(layers: CostmapLayers) -> dict[str, object]:
    names = ("layers", "default_cost", "circumscribed_radius", "area", "footprint")
    parameters = {name: getattr(layers, name) for name in names}
    reaches = any(layer.spreads for layer in layers.effective)
    return parameters if reaches else {**parameters, "circumscribed_radius": None}


def _layered_curve(source: frames.Framed, parameters: command.Parameters) -> CostCurve | None:
    inflations = _stack_of(parameters).inflations_above_map
    if inflations is None:  # no layer below the inflation has obstacles
        return None
    radius = parameters["circumscribed_radius"]
    return inflation_curve(inflations, source.resolution, circumscribed_radius=radius)


def _radius_in(parameters: command.Parameters) -> tuple[str, float]:
    layers = _stack_of(parameters).inflation_layers
    return "inscribed_radius", max((layer.inscribed_radius for layer in layers), default=0.0)


def _has_own_area(parameters: command.Parameters) -> bool:
    area = parameters["area"]
    return area is not None and not (area.is_rolling and parameters["pose"] is None)


def _cells(_: frames.Framed, parameters: command.Parameters) -> Iterator[int]:
    yield parameters["area"].height * parameters["area"].width


@cost_model(
    "layers",
    title=lambda p: f"cost, {', '.join(layer.name for layer in p['layers']) or 'no layers'}",
    memory=3.0,
    more_memory=lambda p: max((layer.memory for layer in _stack_of(p).effective), default=0.0),
    cells=_cells,
    moves=_has_own_area,
    advice=_advice,
    when_closed="lower inscribed_radius, or the radius of inflate",
    accepts_mask=lambda parameters: _stack_of(parameters).has_keepout or _has_own_area(parameters),
    parameters_from_layers=_layered_parameters,
    curve=_layered_curve,
    radius_in=_radius_in,
)
def layered_cost(
    source: ObstacleSource,
    *,
    layers: LayerList = _DEFAULT_LAYERS,
    default_cost: Annotated[int, _EMPTY_COST, command.COST] = map_values.FREE_SPACE,
    circumscribed_radius: Annotated[float, command.AT_LEAST_0, command.METRES, command.FromRobot]
    | None = None,
    area: Annotated[CostmapArea | None, command.FromRobot] = None,
    footprint: Annotated[Footprint | None, command.FromRobot] = None,
    pose: Annotated[tuple[float, float, float], command.POSE] | None = None,
    map_to_odom: Annotated[tuple[float, float, float], command.POSE] | None = None,
    mask: Annotated[OccupancyGrid | None, command.OnlyInPython] = None,
) -> Costmap:
    """Compute the costs of a stack of costmap layers, applied in order.

    Parameters
    ----------
    source : OccupancyGrid or DistanceField
        The map that all static layers receive, or its distance field.
    layers : list of layers
        The layers, the lowest first. Sensor layers are in their state before the first observation.
    default_cost : int
        Cost of an empty costmap, 0 or 255. ROS uses 255 with track_unknown_space.
    circumscribed_radius : float, optional
        Distance beyond which the robot cannot collide, metres. It only sets `circumscribed_cost`.
        A robot's shape sets this radius.
    area : CostmapArea, optional
        Size and place of the costmap, if the map does not give them.
    footprint : Footprint, optional
        Padded footprint of the robot. With `pose`, obstacle layers free the cells below it.
    pose : tuple of float, optional
        Pose of the robot in the costmap's global frame, metres and radians. A rolling costmap is
        computed around it. Without a pose the robot stands outside the map, and the layers of a
        rolling costmap are applied to the whole map.
    map_to_odom : tuple of float, optional
        Pose of the costmap's global frame in the map frame, metres and radians, if they differ.
    mask : OccupancyGrid, optional
        Mask of the keepout filters among the layers; without one it acts last.

    Returns
    -------
    Costmap
        Costs on scale ``costmap2d``; without layers, `default_cost` everywhere.

    Raises
    ------
    ParameterError
        If a layer is malformed, or `map_to_odom` is given without `pose`.

    Warns
    -----
    MapdealWarning
        If an inscribed radius is larger than the inflation radius of its layer, the circumscribed
        radius is larger than the inflation radius of the last layer, the field has a strength
        other than 1, or `map_to_odom` is missing or without effect.

    Notes
    -----
    A static layer replaces all costs below it, or with ``use_maximum`` raises them. An inflation
    layer spreads costs around the cells that are 254 after the layers below it. Lengths are counted
    in cells of the float32 resolution of a map message, or of a rolling costmap's own resolution,
    without a tolerance. A denoise layer frees groups of fewer than ``minimal_group_size`` cells
    that are 253 or 254, or unknown where `default_cost` is not 255.

    Unknown cells that a field counts as obstacles have value 100 for the layers; the field's
    distances are not used.

    References
    ----------
    ``updateMap`` in ``layered_costmap.cpp``; ``updateWithTrueOverwrite``, ``updateWithOverwrite``
    and ``updateWithMax`` in ``costmap_layer.cpp``; ``updateCosts`` of each layer.

    Examples
    --------
    >>> from mapdeal.grid.occupancy import OccupancyGrid
    >>> grid = OccupancyGrid([[100, 0, 0, -1]], resolution=0.5)
    >>> inflation = {"inflation_radius": 1.0, "cost_scaling_factor": 1.0}
    >>> layered_cost(grid, layers=["static", {"inflation": inflation}]).cost.tolist()
    [[254, 152, 92, 255]]
    """
    models.refuse_view(source)
    models.warn_of_strength(source, "layers")
    stack = CostmapLayers(layers, default_cost, area=area)
    for inflation in stack.inflation_layers:
        inflation_layer.warn_of_radii(inflation)
    _check_transform(stack, pose, map_to_odom)
    has_own_area = _has_own_area({"area": area, "pose": pose})
    if area is not None and has_own_area:
        frame = area.placed(pose)
        cell_size, cells_of = frame.resolution, partial(cells_below, frame, map_to_odom)
    else:
        frame = source.frame
        cell_size, cells_of = frames.as_float32(frame.resolution), partial(cells_at_centres, frame)
    lay_mask_over = under_robot = None
    if mask is not None:
        lay_mask_over = MaskCosts(mask, partial(cells_of, mask.frame), "costmap2d").lay_over
    if footprint is not None and pose is not None:
        under_robot = covered_cells(footprint, pose, frame, cell_size)
    applied = stack.effective if pose is None and not has_own_area else stack.layers
    if mask is not None and not stack.has_keepout:
        applied = (*applied, KeepoutFilter())

    def costs(rows: slice, occupancy: SignedBytes, in_map: Mask | None = None) -> Bytes:
        master = MasterGrid(
            np.full(occupancy.shape, default_cost, dtype=np.uint8), rows, frame.shape, cell_size,
            default_cost, occupancy, in_map, lay_mask_over,
            None if under_robot is None else under_robot[rows],
        )  # fmt: skip
        for layer in applied:
            layer.apply(master)
        return master.costs

    cost: blocks.Layer
    if has_own_area:
        all_rows = slice(0, frame.height)
        cost = costs(all_rows, *_sampled(source, *cells_of(source.frame, all_rows)))
    else:
        cost = blocks.made_by_windows(
            source.occupancy, np.uint8, lambda rows: costs(rows, _occupancy(source, rows)),
            halo=sum(layer.halo(frame.shape, cell_size) for layer in applied),
        )  # fmt: skip
    inflations = records.replace(stack, layers=applied).inflation_layers
    at_circumscribed = None
    if inflations:
        at_circumscribed = inflation_layer.circumscribed_cost(circumscribed_radius, inflations[-1])
    return Costmap(cost, frame.resolution, frame.origin, circumscribed_cost=at_circumscribed)


def _check_transform(
    stack: CostmapLayers, pose: Sequence[float] | None, map_to_odom: Sequence[float] | None
) -> None:
    if pose is None:
        if map_to_odom is not None:
            raise errors.ParameterError("needs pose", place="map_to_odom")
        return
    frames.warn_of_degrees(pose[2], "pose")
    frames.warn_of_degrees(0.0 if map_to_odom is None else map_to_odom[2], "map_to_odom")
    area = stack.area
    is_in_map_frame = area is None or not area.is_rolling or area.is_in_map_frame
    if map_to_odom is not None and is_in_map_frame:
        text = "cost: map_to_odom has no effect: the costmap's global_frame is the map's"
        errors.emit_warning(text)
    reads_map = bool(stack.static_layers) or stack.has_keepout
    if map_to_odom is None and not is_in_map_frame and reads_map and area is not None:
        text = f"cost: the costmap's global_frame is {area.global_frame}, and map_to_odom is not "
        text += "given: it is taken for the frame of the map"
        errors.emit_warning(text)


def _occupancy(source: ObstacleSource, rows: slice) -> SignedBytes:
    values = source.occupancy[rows]
    if isinstance(source, DistanceField) and source.unknown == "occupied":
        values = values.copy()
        set_where(values, values == map_values.UNKNOWN, map_values.OCCUPIED)
    return values


def _sampled(source: ObstacleSource, row: Integers, col: Integers) -> tuple[SignedBytes, Mask]:
    height, width = source.shape
    in_map = (row >= 0) & (row < height) & (col >= 0) & (col < width)
    row, col = np.clip(row, 0, height - 1), np.clip(col, 0, width - 1)
    first = int(row.min())
    return _occupancy(source, slice(first, int(row.max()) + 1))[row - first, col], in_map
