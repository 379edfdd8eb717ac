"""Costmap layer ``keepout``: the keepout filter, which lays a mask over the costs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mapdeal.errors import emit_warning
from mapdeal.grid.frame import Frame, cells_at
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import NO_INFORMATION, UNKNOWN, CostScale, cost_from_occupancy
from mapdeal.kernels import lookup, threads
from mapdeal.kernels.arrays import Array, Integers
from mapdeal.layers.layer import CostmapLayer, MasterGrid

CellsAt = Callable[[slice], tuple[Integers, Integers]]
"""Function that returns the mask's row and column below each cell in rows of a costmap."""


@dataclass(frozen=True, repr=False)
class KeepoutFilter(CostmapLayer):
    """Settings of Nav2's keepout filter, without its mask.

    Parameters
    ----------
    name : str
        Name in the list of plugins or filters.

    References
    ----------
    ``process`` in ``keepout_filter.cpp`` of nav2_costmap_2d, with base 0 and multiplier 1.
    """

    name: str = "keepout_filter"
    key: ClassVar[str] = "keepout"
    nav2_plugins: ClassVar[tuple[str, ...]] = ("nav2_costmap_2d::KeepoutFilter",)
    about: ClassVar[str] = "raises costs to those of the keepout mask, at its place in the list"
    needs: ClassVar[str] = "mask"

    def apply(self, master: MasterGrid) -> None:
        if master.lay_mask_over is not None:
            master.lay_mask_over(master.costs, master.rows)

    def effect(self) -> str:
        return "raises costs to those of a keepout mask (--mask)"


class MaskCosts:
    """Costs of a keepout mask at the cells of a costmap, and how many cells they changed."""

    # A value v of the mask is round(2.54 v) on scale ``costmap2d``.

    def __init__(self, mask: OccupancyGrid, cells_at: CellsAt, scale: CostScale) -> None:
        self._shape, self._cells_at = mask.shape, cells_at
        self._unknown = NO_INFORMATION if scale == "costmap2d" else UNKNOWN
        self._values: Array = mask.occupancy
        if scale == "costmap2d":
            self._values = lookup.look_up(mask.occupancy, cost_from_occupancy())
        self._covered: list[int] = []
        self._freed: list[int] = []

    def lay_over(self, costs: Array, rows: slice) -> None:
        """Raise the costs of some rows of the frame, in place; unknown costs are replaced."""

        def lay_over_part(part: slice) -> None:
            row, col = self._cells_at(slice(rows.start + part.start, rows.start + part.stop))
            height, width = self._shape
            is_inside = (row >= 0) & (row < height) & (col >= 0) & (col < width)
            values = self._values[np.clip(row, 0, height - 1), np.clip(col, 0, width - 1)]
            is_known = is_inside & (values != self._unknown)
            was_unknown = costs[part] == self._unknown
            changed = is_known & ((values > costs[part]) | was_unknown)
            self._covered.append(int(np.count_nonzero(is_known)))
            self._freed.append(int(np.count_nonzero(changed & was_unknown & (values == 0))))
            np.copyto(costs[part], values, where=changed)

        threads.for_rows(lay_over_part, costs.shape)

    def warn(self) -> None:
        if not sum(self._covered):
            emit_warning("the mask covers no cell of the costs: it has no known cell there")
        if sum(self._freed):
            text = f"{sum(self._freed)} unknown cells became free where the mask is 0, as in Nav2"
            emit_warning(text)


def cells_at_centres(target: Frame, source: Frame, rows: slice) -> tuple[Integers, Integers]:
    # If both have the same yaw, the results are a column and a row that broadcast.
    target_row = np.arange(rows.start, rows.stop)[:, np.newaxis]
    target_col = np.arange(target.width)[np.newaxis, :]
    centre = target.xy_from_rowcol([[0, 0]])
    row, col = source.continuous_rowcol_from_xy(centre)[0].tolist()
    tolerance = source.tolerance_at(centre)
    step = target.resolution / source.resolution
    turn = target.origin[2] - source.origin[2]
    if turn == 0.0:
        row, col = row + target_row * step, col + target_col * step
    else:
        cos, sin = step * math.cos(turn), step * math.sin(turn)
        row = row + target_row * cos + target_col * sin
        col = col - target_row * sin + target_col * cos
    return cells_at(row, tolerance), cells_at(col, tolerance)
