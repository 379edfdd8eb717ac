"""Keepout masks: areas that a robot must avoid, combined with its costs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import emit_warning
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Frame, cells_at
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import cost_from_occupancy
from mapdeal.kernels.blocks import made_by_rows, swept
from mapdeal.kernels.lookup import look_up
from mapdeal.kernels.threads import for_rows


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

    def lay_over(old: NDArray[Any], rows: slice) -> None:
        """Raise the costs of some rows, in place, and count what that does."""
        at_row, at_col = _cells_at_centres(mask.frame, costmap.frame, rows)
        inside = (at_row >= 0) & (at_row < height) & (at_col >= 0) & (at_col < width)
        found = values[np.clip(at_row, 0, height - 1), np.clip(at_col, 0, width - 1)]
        known = inside & (found != unknown)
        taken = known & ((found > old) | (old == unknown))
        covered.append(int(np.count_nonzero(known)))
        freed.append(int(np.count_nonzero(taken & (old == unknown) & (found == 0))))
        np.copyto(old, found, where=taken)

    def covered_rows(rows: slice) -> NDArray[Any]:
        cost = costmap.cost[rows].copy()

        def part(some: slice) -> None:
            lay_over(cost[some], slice(rows.start + some.start, rows.start + some.stop))

        for_rows(part, cost.shape)
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
