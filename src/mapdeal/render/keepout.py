"""Cells that a keepout mask has closed, over the picture of a costmap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Frame
from mapdeal.grid.values import LETHAL_OBSTACLE, OCCUPIED
from mapdeal.kernels.blocks import Layer, made_by_rows
from mapdeal.records import dataclass
from mapdeal.render import colours
from mapdeal.render.colours import Colour
from mapdeal.render.raster import Raster
from mapdeal.render.style import Swatch


@dataclass(frozen=True, eq=False)
class KeepoutOverlay:
    """Cells that are lethal by a mask alone."""

    closed: Layer

    @classmethod
    def of(cls, before: Costmap, after: Costmap) -> KeepoutOverlay:
        """Return what a mask has closed, given the costs without it and with it."""
        lethal = LETHAL_OBSTACLE if after.scale == "costmap2d" else OCCUPIED

        def closed(rows: slice) -> NDArray[np.bool_]:
            found: NDArray[np.bool_] = after.cost[rows] == lethal
            found &= before.cost[rows] != lethal
            return found

        return cls(made_by_rows(after.cost, bool, closed))

    @property
    def colours(self) -> list[Colour]:
        """Of these cells."""
        return [colours.KEEPOUT]

    @property
    def text(self) -> str:
        """Nothing: the legend says it."""
        return ""

    @property
    def places_xy(self) -> NDArray[np.float64]:
        """None: cells are there anyhow."""
        return np.empty((0, 2))

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        """Draw the cells; see `Overlay`."""
        del frame
        closed = raster.enlarged(raster.largest(self.closed))
        pixels[closed] = first_index
        return [Swatch(first_index, "keepout")] if closed.any() else []
