"""Rings around places on the picture of a map."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame
from mapdeal.records import dataclass
from mapdeal.render import colours
from mapdeal.render.colours import Colour
from mapdeal.render.overlay import Brush, place_of
from mapdeal.render.raster import Raster
from mapdeal.render.style import Swatch

_CORNERS = 32


@dataclass(frozen=True, eq=False)
class RingOverlay:
    """Rings around places."""

    places_xy: NDArray[np.float64]
    label: str
    text: str

    @property
    def colours(self) -> list[Colour]:
        """Of the rings."""
        return [colours.REMOVED]

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        """Draw the rings; see `Overlay`."""
        if not len(self.places_xy):
            return []
        side = max(pixels.shape)
        radius, thickness = max(6.0, side / 80), max(2, round(side / 400))
        turns = np.linspace(0, 2 * math.pi, _CORNERS + 1)
        circle = radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
        brush = Brush(pixels)
        for place in place_of(self.places_xy, frame, raster):
            brush.polyline(place + circle, first_index, thickness=thickness)
        return [Swatch(first_index, self.label)]
