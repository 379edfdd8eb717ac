"""Lines, arrows and dots on a map's pixels, as vector drawings are made."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.grid.frame import Frame
from mapdeal.render.canvas import Swatch
from mapdeal.render.colours import Colour
from mapdeal.render.raster import Raster


class Overlay(Protocol):
    """Something that is drawn over the picture of a layer."""

    @property
    def colours(self) -> list[Colour]:
        """What a palette needs for it, one after the other."""

    @property
    def text(self) -> str:
        """What there is to know of it, for a subtitle."""

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        """Draw on the pixels of a map, in place; return the legend.

        Parameters
        ----------
        pixels : numpy.ndarray of uint8, shape (H, W)
            Palette indices, row 0 in the south.
        frame : Frame
            The map's geometry.
        raster : Raster
            How its cells became pixels.
        first_index : int
            Where `colours` begin in the palette.
        """


def place_of(points_xy: ArrayLike, frame: Frame, raster: Raster) -> NDArray[np.float64]:
    """Return the pixel coordinates (column, row) of points in the map frame."""
    places = frame.continuous_rowcol_from_xy(points_xy)[:, ::-1]
    return places * (raster.enlarge / raster.reduce)


class Brush:
    """Draws on pixels whose row 0 is the south; coordinates are in pixels, (column, row)."""

    def __init__(self, draw: Any) -> None:
        self._draw = draw

    def polyline(self, points: NDArray[np.float64], index: int, *, thickness: int) -> None:
        """Draw a line through points, shape (N, 2), with round corners."""
        if len(points) > 1:
            path = [(float(x), float(y)) for x, y in points]
            self._draw.line(path, fill=index, width=thickness, joint="curve")

    def dot(self, centre: NDArray[np.float64], index: int, *, radius: float) -> None:
        """Draw a filled circle."""
        x, y = (float(value) for value in centre)
        self._draw.ellipse([(x - radius, y - radius), (x + radius, y + radius)], fill=index)

    def arrow(
        self, centre: NDArray[np.float64], direction: NDArray[np.float64], index: int, *,
        length: float, thickness: int,
    ) -> None:  # fmt: skip
        """Draw an arrow around a point, along a unit vector."""
        along, across = direction * length, np.array([-direction[1], direction[0]]) * length
        tip, tail, neck = centre + along / 2, centre - along / 2, centre + along * 0.1
        self._draw.line([tuple(tail), tuple(neck)], fill=index, width=thickness)
        wings = (tip, neck + across * 0.22, neck - across * 0.22)
        self._draw.polygon([tuple(corner) for corner in wings], fill=index)

    def dart(
        self, centre: NDArray[np.float64], direction: NDArray[np.float64], index: int, *,
        length: float,
    ) -> None:  # fmt: skip
        """Draw an arrowhead around a point, along a unit vector."""
        along, across = direction * length, np.array([-direction[1], direction[0]]) * length
        corners = (
            centre + along * 0.6,
            centre - along * 0.4 + across * 0.35,
            centre - along * 0.2,
            centre - along * 0.4 - across * 0.35,
        )
        self._draw.polygon([tuple(corner) for corner in corners], fill=index)


@contextmanager
def brush_on(pixels: NDArray[np.uint8]) -> Iterator[Brush]:
    """Give a brush that changes palette indices, shape (H, W), in place."""
    from PIL import Image, ImageDraw

    image = Image.fromarray(pixels)
    yield Brush(ImageDraw.Draw(image))
    pixels[:] = np.asarray(image)
