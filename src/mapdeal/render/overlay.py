"""Lines, arrows and dots on a map's pixels, as vector drawings are made."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray


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


@contextmanager
def brush_on(pixels: NDArray[np.uint8]) -> Iterator[Brush]:
    """Give a brush that changes palette indices, shape (H, W), in place."""
    from PIL import Image, ImageDraw

    image = Image.fromarray(pixels)
    yield Brush(ImageDraw.Draw(image))
    pixels[:] = np.asarray(image)
