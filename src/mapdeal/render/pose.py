"""A robot over the picture of a map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame, xy_ahead
from mapdeal.records import dataclass
from mapdeal.render import colours
from mapdeal.render.colours import Colour
from mapdeal.render.overlay import Brush, place_of
from mapdeal.render.raster import Raster
from mapdeal.render.style import Swatch


@dataclass(frozen=True)
class PoseOverlay:
    """An arrowhead where a robot stands, along its heading."""

    pose: tuple[float, float, float]

    @property
    def colours(self) -> list[Colour]:
        """Of the arrowhead."""
        return [colours.ROBOT]

    @property
    def text(self) -> str:
        """The pose."""
        x, y, yaw = self.pose
        return f"robot at {x:.10g}, {y:.10g}, yaw {yaw:.4g}"

    @property
    def places_xy(self) -> NDArray[np.float64]:
        """Where the robot stands."""
        return np.array([self.pose[:2]])

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        """Draw the arrowhead; see `Overlay`."""
        ahead = xy_ahead(self.pose, frame.resolution)
        centre, tip = place_of([self.pose[:2], ahead], frame, raster)
        direction = (tip - centre) / np.hypot(*(tip - centre))
        length = max(10.0, max(pixels.shape) / 25)
        Brush(pixels).dart(centre, direction, first_index, length=length)
        return [Swatch(first_index, "robot")]
