"""Stage ``cost``, model ``layers``: the layers of a costmap, applied in order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Annotated

import numpy as np

from mapdeal import command, records
from mapdeal.errors import ParameterError, emit_warning
from mapdeal.grid import field, frame as frames
from mapdeal.grid.costmap import CostCurve, Costmap
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE_SPACE, NO_INFORMATION, OCCUPIED, UNKNOWN
from mapdeal.kernels import blocks, lookup
from mapdeal.kernels.arrays import Bytes, Integers, Mask, SignedBytes
from mapdeal.layers import inflation as inflation_layer, static
from mapdeal.layers.inflation import InflationLayer, advice_on, circumscribed_cost, inflation_curve
from mapdeal.layers.keepout import KeepoutFilter, MaskCosts, cells_at_centres
from mapdeal.layers.layer import MasterGrid
from mapdeal.layers.stack import CostmapArea, CostmapLayers, cells_below, covered_cells
from mapdeal.stages.cost import ObstacleSource, cost_model, refuse_view, warn_of_strength
from mapdeal.stages.structured import LayerList

_DEFAULT_LAYERS = (static.StaticLayer(), InflationLayer())
_EMPTY_COST = command.Condition("0 or 255", lambda value: value in (FREE_SPACE, NO_INFORMATION))


def _stack_of(parameters: command.Parameters) -> CostmapLayers:
    return CostmapLayers(parameters["layers"], parameters["default_cost"])


def _advice(parameters: command.Parameters, cost: int) -> str:
    inflations = _stack_of(parameters).inflation_layers
    return advice_on(cost, inflations[-1]) if inflations else "no inflation layer spreads costs"


def _parameters_from_layers(layers: CostmapLayers) -> dict[str, object]:
    names = ("layers", "default_cost", "circumscribed_radius", "area", "footprint")
    parameters = {name: getattr(layers, name) for name in names}
    reaches = any(layer.spreads for layer in layers.effective)
    return parameters if reaches else {**parameters, "circumscribed_radius": None}


def _curve(source: frames.Framed, parameters: command.Parameters) -> CostCurve | None:
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
    parameters_from_layers=_parameters_from_layers,
    curve=_curve,
    radius_in=_radius_in,
)
def layered_cost(
    source: ObstacleSource,
    *,
    layers: LayerList = _DEFAULT_LAYERS,
    default_cost: Annotated[int, _EMPTY_COST, command.COST] = FREE_SPACE,
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
    refuse_view(source)
    warn_of_strength(source, "layers")
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
        at_circumscribed = circumscribed_cost(circumscribed_radius, inflations[-1])
    return Costmap(cost, frame.resolution, frame.origin, circumscribed_cost=at_circumscribed)


def _check_transform(
    stack: CostmapLayers, pose: Sequence[float] | None, map_to_odom: Sequence[float] | None
) -> None:
    if pose is None:
        if map_to_odom is not None:
            raise ParameterError("needs pose", place="map_to_odom")
        return
    frames.warn_of_degrees(pose[2], "pose")
    frames.warn_of_degrees(0.0 if map_to_odom is None else map_to_odom[2], "map_to_odom")
    area = stack.area
    is_in_map_frame = area is None or not area.is_rolling or area.is_in_map_frame
    if map_to_odom is not None and is_in_map_frame:
        emit_warning("cost: map_to_odom has no effect: the costmap's global_frame is the map's")
    reads_map = bool(stack.static_layers) or stack.has_keepout
    if map_to_odom is None and not is_in_map_frame and reads_map and area is not None:
        text = f"cost: the costmap's global_frame is {area.global_frame}, and map_to_odom is not "
        text += "given: it is taken for the frame of the map"
        emit_warning(text)


def _occupancy(source: ObstacleSource, rows: slice) -> SignedBytes:
    values = source.occupancy[rows]
    if isinstance(source, field.DistanceField) and source.unknown == "occupied":
        values = values.copy()
        lookup.set_where(values, values == UNKNOWN, OCCUPIED)
    return values


def _sampled(source: ObstacleSource, row: Integers, col: Integers) -> tuple[SignedBytes, Mask]:
    height, width = source.shape
    in_map = (row >= 0) & (row < height) & (col >= 0) & (col < width)
    row, col = np.clip(row, 0, height - 1), np.clip(col, 0, width - 1)
    first = int(row.min())
    return _occupancy(source, slice(first, int(row.max()) + 1))[row - first, col], in_map
