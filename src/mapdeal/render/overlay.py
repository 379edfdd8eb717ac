"""Lines, arrows and dots on a map's pixels, as vector drawings are made."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.grid.frame import Frame
from mapdeal.records import dataclass
from mapdeal.render.colours import Colour
from mapdeal.render.raster import Raster
from mapdeal.render.style import Swatch

_FARTHEST = 2.0**20  # pixels; beyond, Pillow's coordinates overflow
_MOST_PIXELS = 1 << 24
"""Of a picture, that are copied to be drawn on, unless a single shape takes more."""


class Overlay(Protocol):
    """Something that is drawn over the picture of a layer."""

    @property
    def colours(self) -> list[Colour]:
        """What a palette needs for it, one after the other."""

    @property
    def text(self) -> str:
        """What there is to know of it, for a subtitle."""

    @property
    def places_xy(self) -> NDArray[np.float64]:
        """What a picture has to show of it, shape (N, 2), metres in the map frame."""

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


@dataclass(frozen=True)
class Overlays:
    """Several things that are drawn over the same picture, one over the other."""

    overlays: tuple[Overlay, ...]

    @property
    def colours(self) -> list[Colour]:
        """Those of all, one after the other."""
        return [colour for overlay in self.overlays for colour in overlay.colours]

    @property
    def text(self) -> str:
        """What there is to know of each."""
        return "; ".join(overlay.text for overlay in self.overlays if overlay.text)

    @property
    def places_xy(self) -> NDArray[np.float64]:
        """Those of all."""
        return np.concatenate([np.reshape(one.places_xy, (-1, 2)) for one in self.overlays])

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        """Draw all of them; see `Overlay`."""
        swatches = []
        for overlay in self.overlays:
            swatches += overlay.draw(pixels, frame, raster, first_index)
            first_index += len(overlay.colours)
        return swatches


def place_of(points_xy: ArrayLike, frame: Frame, raster: Raster) -> NDArray[np.float64]:
    """Return the pixel coordinates (column, row) of points in the map frame."""
    places = frame.continuous_rowcol_from_xy(points_xy)[:, ::-1]
    return places * (raster.enlarge / raster.reduce)


class Brush:
    """Draws on pixels whose row 0 is the south; coordinates are in pixels, (column, row)."""

    def __init__(self, pixels: NDArray[np.uint8]) -> None:
        self._pixels = pixels

    def polyline(self, points: NDArray[np.float64], index: int, *, thickness: int) -> None:
        """Draw a line through points, shape (N, 2), with round corners."""
        if len(points) > 1:
            self.segments(points[:-1], points[1:], index, thickness=thickness)

    def segments(
        self, starts: NDArray[np.float64], ends: NDArray[np.float64], index: int, *,
        thickness: int,
    ) -> None:  # fmt: skip
        """Draw lines between points, shape (N, 2) each, with round ends."""
        self._draw(index, np.stack([starts, ends], axis=1), thickness=thickness)
        if thickness > 2:
            points = np.unique(np.concatenate([starts, ends]), axis=0)
            self._draw(index, points[:, np.newaxis], radius=thickness / 2)

    def dot(self, centre: NDArray[np.float64], index: int, *, radius: float) -> None:
        """Draw a filled circle."""
        self._draw(index, centre[np.newaxis, np.newaxis], radius=radius)

    def arrows(
        self, centres: NDArray[np.float64], directions: NDArray[np.float64], index: int, *,
        length: float, thickness: int,
    ) -> None:  # fmt: skip
        """Draw arrows around points, shape (N, 2), along unit vectors."""
        along, across = directions * length, _left_of(directions) * length
        tip, tail, neck = centres + along / 2, centres - along / 2, centres + along * 0.1
        self._draw(index, np.stack([tail, neck], axis=1), thickness=thickness)
        self._draw(index, np.stack([tip, neck + across * 0.22, neck - across * 0.22], axis=1))

    def dart(
        self, centre: NDArray[np.float64], direction: NDArray[np.float64], index: int, *,
        length: float,
    ) -> None:  # fmt: skip
        """Draw an arrowhead around a point, along a unit vector."""
        along, across = direction * length, _left_of(direction) * length
        tip, notch = centre + along * 0.6, centre - along * 0.2
        left, right = (centre - along * 0.4 + side * across * 0.35 for side in (1, -1))
        self._draw(index, np.array([[tip, left, notch, right]]))

    def _draw(
        self, index: int, shapes: NDArray[np.float64], *, thickness: int = 0, radius: float = 0.0
    ) -> None:
        """Draw shapes of some points each, shape (N, K, 2): discs, lines, or filled corners."""
        from PIL import Image, ImageDraw

        if not len(shapes):
            return
        height, width = self._pixels.shape
        shapes = np.clip(shapes, -_FARTHEST, _FARTHEST)
        reach = radius + thickness + 1
        low = np.clip(shapes.min(axis=(0, 1)) - reach, 0, (width, height)).astype(int)
        high = np.clip(shapes.max(axis=(0, 1)) + reach, 0, (width, height)).astype(int)
        under = self._pixels[low[1] : high[1], low[0] : high[0]]
        if under.size > _MOST_PIXELS and len(shapes) > 1:
            for half in np.array_split(shapes, 2):
                self._draw(index, half, thickness=thickness, radius=radius)
            return
        if not under.size:
            return
        image = Image.fromarray(under)
        draw = ImageDraw.Draw(image)
        for points in shapes - low:
            if radius:
                first, last = _edge(points[0] - radius), _edge(points[0] + radius) - 1
                draw.ellipse([*first, *np.maximum(first, last)], fill=index)
            elif thickness:
                middle = _edge(points - thickness / 2) + (thickness - 1) // 2
                draw.line(middle.ravel().tolist(), fill=index, width=thickness)
            else:
                draw.polygon(np.floor(points).ravel().tolist(), fill=index)
        under[:] = np.asarray(image)


def _edge(places: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.floor(places + 0.5)  # half a pixel always to the same side


def _left_of(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([-direction[..., 1], direction[..., 0]], axis=-1)
