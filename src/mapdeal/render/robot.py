"""A robot's shape in a corner of a picture, true to scale."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.coordinates import turned
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame
from mapdeal.kernels.lookup import histogram
from mapdeal.records import dataclass
from mapdeal.render import colours
from mapdeal.render.colours import Colour
from mapdeal.render.overlay import Brush
from mapdeal.render.raster import Raster
from mapdeal.render.style import Swatch

_CORNERS_OF_CIRCLE = 48
_AWAY = 10
"""Pixels between the shape and the edges."""
_LEAST, _LARGEST_SHARE = 4, 0.4
"""Of a shape that is drawn: pixels, and its part of the picture's sides."""


def outline_of(
    robot: Footprint, pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> NDArray[np.float64]:
    """Return the closed outline of a robot at a pose, shape (N, 2), in the frame of the pose."""
    if robot.vertices:
        corners = np.array([*robot.vertices, robot.vertices[0]])
    else:
        turns = np.linspace(0, 2 * math.pi, _CORNERS_OF_CIRCLE + 1)
        corners = robot.radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    x, y, yaw = pose
    outline: NDArray[np.float64] = turned(corners, yaw) + np.array([x, y])
    return outline


@dataclass(frozen=True)
class RobotOverlay:
    """A robot's shape, true to scale, in the corner of a picture where least is to be seen."""

    robot: Footprint
    label: str = "robot, to scale"

    @property
    def colours(self) -> list[Colour]:
        """Of the outline, and of the line around it."""
        return [colours.ROBOT_OUTLINE, colours.RVIZ_FREE]

    @property
    def text(self) -> str:
        """Nothing: the legend says it."""
        return ""

    @property
    def places_xy(self) -> NDArray[np.float64]:
        """None: a corner is always there."""
        return np.empty((0, 2))

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        """Draw the outline, if there is room for it; see `Overlay`."""
        outline = outline_of(self.robot) / raster.metres_per_pixel(frame.resolution)
        outline -= outline.min(axis=0)
        size = np.ceil(outline.max(axis=0)) + 2 * _AWAY  # columns and rows
        height, width = pixels.shape
        if outline.max() < _LEAST or (size > _LARGEST_SHARE * np.array([width, height])).any():
            return []
        cols, rows = size.astype(int).tolist()
        corners = [(left, low) for low in (0, height - rows) for left in (width - cols, 0)]
        left, low = max(corners, key=lambda at: _evenness(pixels, at, (cols, rows)))
        outline += np.array([left, low]) + _AWAY
        brush = Brush(pixels)
        for index, thickness in ((first_index + 1, 4), (first_index, 2)):
            brush.polyline(outline, index, thickness=thickness)
        return [Swatch(first_index, self.label)]


def _evenness(pixels: NDArray[np.uint8], corner: tuple[int, int], size: tuple[int, int]) -> int:
    """Return how many pixels of a box, columns and rows, have the colour that most have."""
    (left, low), (width, height) = corner, size
    part = np.ascontiguousarray(pixels[low : low + height, left : left + width])
    return int(histogram(part).max())
