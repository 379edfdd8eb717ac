"""Stage ``cost``: code shared by its models, and keepout masks over costs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from mapdeal import command, errors
from mapdeal.grid import frame as frames, values
from mapdeal.grid.costmap import UNIFORM_SHARE, Costmap
from mapdeal.grid.field import DistanceField, FieldView
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels import arrays, blocks
from mapdeal.layers.keepout import MaskCosts, cells_at_centres

ObstacleSource = OccupancyGrid | DistanceField


def cost_model(
    name: str, *, advice: Callable[[command.Parameters, int], str], when_closed: str, **more: Any
) -> Callable[[Callable[command.P, command.R]], Callable[command.P, command.R]]:
    # `advice` returns which parameters to change, given the most common cost.

    def remark(parameters: command.Parameters, figures: frames.Figures) -> str | None:
        common = figures["most_common"]
        if common is None:
            if figures["unknown"] == figures["width"] * figures["height"]:
                return "every cell is unknown"
            return f"every known cell is lethal or inscribed: {when_closed}"
        no_obstacle = command.remark_on_obstacles(parameters, figures)
        if common["share"] <= UNIFORM_SHARE:
            return no_obstacle
        cost, cells = common["cost"], f"{100 * common['share']:.4g} % of the open cells"
        if no_obstacle:
            return f"{cells} cost {cost}: {no_obstacle}"
        if figures["cost_scale"] == "occupancy" and cost < values.INSCRIBED_PUBLISHED:
            cells += f" (below {values.INSCRIBED_PUBLISHED})"
        return f"{cells} cost {cost}: {advice(parameters, cost)}"

    return command.stage(
        name="cost",
        group="Maps, distance fields, costmaps",
        example="""\
mapdeal cost examples/maps/office.yaml -o out/cost.yaml --robot-radius 0.22
mapdeal cost examples/maps/office.yaml -o out/robot.npz \\
    --params-file examples/robots/nav2_params.yaml --curve out/curve.png
mapdeal cost examples/maps/office.yaml -o out/rings.npz --model rings""",
        model=name,
        summary="Turn a map or its distance field into a costmap.",
        is_last=True,
        remark=remark,
        **more,
    )


def check_lethal_threshold(source: ObstacleSource, lethal_threshold: int | None) -> int:
    """Return the threshold to use: the field's own for a field, else the argument or 100."""
    refuse_view(source)
    if isinstance(source, DistanceField):
        if lethal_threshold not in (None, source.lethal_threshold):
            rule = f"the distance field was made with {source.lethal_threshold}"
            raise errors.ParameterError(rule, place="lethal_threshold", got=lethal_threshold)
        return source.lethal_threshold
    return values.DEFAULT_LETHAL_THRESHOLD if lethal_threshold is None else lethal_threshold


def refuse_view(source: ObstacleSource) -> None:
    if isinstance(source, FieldView):
        hint = "only costs of model threshold are made of it; take the map or the npz of the field"
        raise errors.ParameterError("is the 0..100 view of a distance field, not a map", hint=hint)


def warn_of_strength(source: ObstacleSource, model: str) -> None:
    if isinstance(source, DistanceField) and source.strength != 1:
        text = f"cost: model {model} takes no account of the field's strength"
        text += f", {source.strength:g}; views and model threshold do"
        errors.emit_warning(text)


def obstacles_of(source: ObstacleSource, lethal_threshold: int | None) -> arrays.Mask:
    threshold = check_lethal_threshold(source, lethal_threshold)
    return source.obstacles() if isinstance(source, DistanceField) else source.occupied(threshold)


def apply_keepout_mask(costmap: Costmap, mask: OccupancyGrid) -> Costmap:
    """Raise costs to at least those of a keepout mask.

    Parameters
    ----------
    costmap : Costmap
        The costs.
    mask : OccupancyGrid
        Keepout mask: 100 where the robot must not go, 1..99 where it should preferably not go, 0
        elsewhere. Its resolution, origin, yaw and size may differ from those of the costs; it is
        sampled at their cell centres.

    Returns
    -------
    Costmap
        Costs with the geometry and scale of `costmap`. A mask value v corresponds to the cost
        round(2.54 v) on scale ``costmap2d``, and to v on scale ``occupancy``.

    Warns
    -----
    MapdealWarning
        If the mask covers no cell of the costs, or it makes unknown cells free.

    Notes
    -----
    As Nav2's ``KeepoutFilter`` with base 0 and multiplier 1, but with the mask's yaw applied. Cells
    outside the mask, or where it is unknown, keep their cost. Elsewhere the larger of the two costs
    is used; an unknown cost is always replaced by the mask's.

    References
    ----------
    Nav2's ``KeepoutFilter`` with base 0 and multiplier 1, but with the mask's yaw applied.

    Examples
    --------
    >>> costmap = Costmap([[0, 200, 254, 255]], 0.5, (1.0, 2.0, 0.0))
    >>> mask = OccupancyGrid([[50, 50]], 1.0, (1.0, 2.0, 0.0))
    >>> apply_keepout_mask(costmap, mask).cost.tolist()
    [[127, 200, 254, 127]]
    """
    keepout = MaskCosts(mask, partial(cells_at_centres, costmap.frame, mask.frame), costmap.scale)

    def raised(rows: slice) -> arrays.Array:
        cost = costmap.cost[rows].copy()
        keepout.lay_over(cost, rows)
        return cost

    layer = blocks.made_by_rows(costmap.cost, costmap.cost.dtype, raised, is_cached=True)
    for rows in blocks.swept(layer):  # a lazy layer is computed for the counts in the warnings
        layer[rows]
    keepout.warn()
    return costmap.with_values(layer)


def closed_by(mask: OccupancyGrid, frame: frames.Frame) -> arrays.Mask:
    """Return the cells of a frame in which a keepout mask is 100, shape (H, W)."""
    nothing = Costmap(np.zeros(frame.shape, dtype=np.uint8), frame.resolution, frame.origin)
    return np.asarray(apply_keepout_mask(nothing, mask).cost == values.LETHAL_OBSTACLE)
