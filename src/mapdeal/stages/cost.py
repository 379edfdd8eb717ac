"""Stage ``cost``: what its models share, and keepout masks that are laid over costs."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import P, Parameters, R, stage
from mapdeal.errors import ParameterError, emit_warning
from mapdeal.grid.costmap import UNIFORM_SHARE, Costmap
from mapdeal.grid.field import DistanceField, FieldView
from mapdeal.grid.frame import Figures, Frame, cells_at
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import (
    DEFAULT_LETHAL_THRESHOLD,
    INSCRIBED_PUBLISHED,
    LETHAL_OBSTACLE,
    cost_from_occupancy,
)
from mapdeal.kernels.blocks import made_by_rows, swept
from mapdeal.kernels.lookup import look_up
from mapdeal.kernels.threads import for_rows


def cost_model(
    name: str, *, advice: Callable[[Parameters, int], str], when_closed: str, **more: Any
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Turn a function into a cost model; see `mapdeal.command.Stage`."""
    # The advice is which of the parameters to change, given the cost that most cells have.

    def remark(parameters: Parameters, figures: Figures) -> str | None:
        """Return what to say of costs that are the same nearly everywhere, None of others."""
        common = figures["most_common"]
        if common is None:
            if figures["unknown"] == figures["width"] * figures["height"]:
                return "every cell is unknown"
            return f"every known cell is lethal or inscribed: {when_closed}"
        if common["share"] <= UNIFORM_SHARE:
            return None
        cost, cells = common["cost"], f"{100 * common['share']:.4g} % of the open cells"
        if not figures["lethal"]:
            return f"{cells} cost {cost}: there is no obstacle"
        if figures["cost_scale"] == "occupancy" and cost < INSCRIBED_PUBLISHED:
            cells += f" (below {INSCRIBED_PUBLISHED})"
        return f"{cells} cost {cost}: {advice(parameters, cost)}"

    return stage(
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


ObstacleSource = OccupancyGrid | DistanceField


def check_lethal_threshold(source: ObstacleSource, lethal_threshold: int | None) -> int:
    """Return the threshold to use: the field's own for a field, else the given or 100."""
    refuse_view(source)
    if isinstance(source, DistanceField):
        if lethal_threshold not in (None, source.lethal_threshold):
            rule = f"the distance field was made with {source.lethal_threshold}"
            raise ParameterError(rule, place="lethal_threshold", got=lethal_threshold)
        return source.lethal_threshold
    return DEFAULT_LETHAL_THRESHOLD if lethal_threshold is None else lethal_threshold


def refuse_view(source: ObstacleSource) -> None:
    if isinstance(source, FieldView):
        rule = "is the 0..100 view of a distance field, not a map"
        hint = "only costs of model threshold are made of it; take the map or the npz of the field"
        raise ParameterError(rule, hint=hint)


def warn_of_strength(source: ObstacleSource, model: str) -> None:
    """Warn where costs are made of a field whose strength the model takes no account of."""
    if isinstance(source, DistanceField) and source.strength != 1:
        text = f"cost: model {model} takes no account of the field's strength"
        text += f", {source.strength:g}; views and model threshold do"
        emit_warning(text, stacklevel=4)


def obstacles_of(source: ObstacleSource, lethal_threshold: int | None) -> NDArray[np.bool_]:
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
    Cells outside the mask, or where it is unknown, keep their cost. Elsewhere the larger of the two
    costs is used; an unknown cost is always replaced by the mask's.

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
    values: NDArray[Any] = mask.occupancy
    if costmap.scale == "costmap2d":
        values = look_up(mask.occupancy, cost_from_occupancy())
    height, width = mask.shape
    unknown = costmap.unknown_value
    covered: list[int] = []
    freed: list[int] = []

    def covered_rows(rows: slice) -> NDArray[Any]:
        cost = costmap.cost[rows].copy()

        def lay_over(part: slice) -> None:
            in_grid = slice(rows.start + part.start, rows.start + part.stop)
            at_row, at_col = _cells_at_centres(mask.frame, costmap.frame, in_grid)
            inside = (at_row >= 0) & (at_row < height) & (at_col >= 0) & (at_col < width)
            found = values[np.clip(at_row, 0, height - 1), np.clip(at_col, 0, width - 1)]
            known, was_unknown = inside & (found != unknown), cost[part] == unknown
            taken = known & ((found > cost[part]) | was_unknown)
            covered.append(int(np.count_nonzero(known)))
            freed.append(int(np.count_nonzero(taken & was_unknown & (found == 0))))
            np.copyto(cost[part], found, where=taken)

        for_rows(lay_over, cost.shape)
        return cost

    layer = made_by_rows(costmap.cost, costmap.cost.dtype, covered_rows, is_kept=True)
    for rows in swept(layer):  # for the counts; of an array it is done already
        layer[rows]
    if not sum(covered):
        text = "the mask covers no cell of the costs: it has no known cell there"
        emit_warning(text, stacklevel=2)
    if sum(freed):
        text = f"{sum(freed)} unknown cells became free where the mask is 0, as in Nav2"
        emit_warning(text, stacklevel=2)
    return costmap.with_values(layer)


def closed_by(mask: OccupancyGrid, frame: Frame) -> NDArray[np.bool_]:
    """Return the cells of a frame in which a keepout mask is 100, shape (H, W)."""
    nothing = Costmap(np.zeros(frame.shape, dtype=np.uint8), frame.resolution, frame.origin)
    closed: NDArray[np.bool_] = apply_keepout_mask(nothing, mask).cost == LETHAL_OBSTACLE
    return closed


def _cells_at_centres(
    source: Frame, target: Frame, rows: slice
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows and columns of a grid that hold the cell centres of another's rows."""
    # Without a turn between the two they are a column and a row that broadcast.
    along = np.arange(rows.start, rows.stop)[:, np.newaxis]
    across = np.arange(target.width)[np.newaxis, :]
    centre = target.xy_from_rowcol([[0, 0]])
    row, col = source.continuous_rowcol_from_xy(centre)[0].tolist()
    tolerance = source.tolerance_at(centre)
    step = target.resolution / source.resolution
    turn = target.origin[2] - source.origin[2]
    if turn == 0.0:
        return cells_at(row + along * step, tolerance), cells_at(col + across * step, tolerance)
    cos, sin = step * math.cos(turn), step * math.sin(turn)
    return (
        cells_at(row + along * cos + across * sin, tolerance),
        cells_at(col - along * sin + across * cos, tolerance),
    )
