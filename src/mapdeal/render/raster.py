"""From cells to pixels: whole factors only, so that cells stay sharp and obstacles stay."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.canvas import cut_out
from mapdeal.grid.frame import Frame
from mapdeal.grid.region import Region
from mapdeal.kernels.blocks import Layer, blocks_of, is_lazy
from mapdeal.kernels.threads import for_rows
from mapdeal.records import dataclass

_SMALL_SIDE = 600
"""Pixels that the long side of a small map is enlarged to, about."""

DEFAULT_IMAGE_MAX = 2048


@dataclass(frozen=True)
class Raster:
    """How cells become pixels: `enlarge` pixels per cell, or `reduce` cells per pixel."""

    enlarge: int = 1
    reduce: int = 1
    part: Region | None = None
    """The cells that become pixels, inside of the map; None for all."""

    @classmethod
    def fitting(
        cls,
        shape: tuple[int, int],
        image_max: int,
        *,
        small_side: int = _SMALL_SIDE,
        part: Region | None = None,
    ) -> Raster:
        """Return the factors for a map, or a part of it, its long side at most `image_max` pixels.

        0 means one pixel per cell, whatever the size. The long side of a small map is enlarged
        to `small_side` pixels or a little more.

        Examples
        --------
        >>> Raster.fitting((10, 20), 2048), Raster.fitting((5000, 10), 2048)
        (Raster(enlarge=30, reduce=1, part=None), Raster(enlarge=1, reduce=3, part=None))
        """
        side = max(shape if part is None else (part.height, part.width))
        if image_max == 0:
            return cls(part=part)
        if side > image_max:
            return cls(reduce=math.ceil(side / image_max), part=part)
        enlarge = max(1, min(math.ceil(small_side / side), image_max // side))
        return cls(enlarge=enlarge, part=part)

    def frame_of(self, frame: Frame) -> Frame:
        """Return the geometry of the cells that become pixels, given that of the map."""
        return frame if self.part is None else self.part.frame_in(frame)

    def metres_per_pixel(self, resolution: float) -> float:
        """Return the length of a pixel's side."""
        return resolution * self.reduce / self.enlarge

    def largest(self, layer: Layer) -> NDArray[Any]:
        """Return the largest value of the cells under each pixel, before enlarging.

        Of numbers it is nan only where all cells are.
        """
        return self._pooled(layer, np.fmax)

    def smallest(self, layer: Layer) -> NDArray[Any]:
        """Return the smallest value of the cells under each pixel, as `largest` does."""
        return self._pooled(layer, np.fmin)

    def _pooled(self, layer: Layer, choose: np.ufunc) -> NDArray[Any]:
        if self.part is not None:
            layer = cut_out(layer, self.part)
        if self.reduce == 1:
            return layer[:]
        step = self.reduce
        height, width = (math.ceil(length / step) for length in layer.shape)
        pooled = np.empty((height, width), dtype=layer.dtype)
        # of lazy rows a block is enough: what is under many pixels may be most of the map
        together = max(1, next(blocks_of(layer)).stop // step) if is_lazy(layer) else height

        def pool(rows: slice) -> None:
            for first in range(rows.start, rows.stop, together):
                pool_some(slice(first, min(first + together, rows.stop)))

        def pool_some(rows: slice) -> None:
            under = layer[rows.start * step : rows.stop * step]
            merged = under[::step].copy()
            for k in range(1, step):  # the last rows and columns may have fewer cells under them
                more = under[k::step]
                choose(merged[: len(more)], more, out=merged[: len(more)])
            pixels = pooled[rows]
            pixels[:] = merged[:, ::step]
            for k in range(1, step):
                more = merged[:, k::step]
                choose(pixels[:, : more.shape[1]], more, out=pixels[:, : more.shape[1]])

        for_rows(pool, pooled.shape)
        return pooled

    def enlarged(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Return each pixel as a square of `enlarge` pixels a side."""
        if self.enlarge == 1:
            return pixels
        return np.repeat(np.repeat(pixels, self.enlarge, axis=0), self.enlarge, axis=1)


def inner_outline(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the pixels of `mask` that touch one outside of it, over an edge."""
    inner = mask.copy()
    inner[1:] &= mask[:-1]
    inner[:-1] &= mask[1:]
    inner[:, 1:] &= mask[:, :-1]
    inner[:, :-1] &= mask[:, 1:]
    np.logical_not(inner, out=inner)
    inner &= mask
    return inner
