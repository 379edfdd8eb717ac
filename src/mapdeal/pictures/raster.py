"""From cells to pixels: whole factors only, so that cells stay sharp and obstacles stay."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.canvas import cut_out
from mapdeal.grid.frame import Frame, Region
from mapdeal.kernels.blocks import Layer, blocks_of
from mapdeal.kernels.threads import for_rows

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
        """Return the factors for a map or a part of it, of at most `image_max` pixels a side."""
        # 0 means one pixel per cell, whatever the size. The long side of a small map is enlarged
        # to `small_side` pixels or a little more.
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
        return resolution * self.reduce / self.enlarge

    def largest(self, layer: Layer) -> NDArray[Any]:
        """Return the largest value of the cells under each pixel, before enlarging."""
        # Of numbers it is nan only where all cells are.
        return self.pooling(layer, np.fmax).all()

    def smallest(self, layer: Layer) -> NDArray[Any]:
        """Return the smallest value of the cells under each pixel, as `largest` does."""
        return self.pooling(layer, np.fmin).all()

    def pooling(self, layer: Layer, choose: np.ufunc) -> Pooling:
        """Return what makes pixels of cells, some rows at a time."""
        return Pooling(self, layer, choose)

    def enlarged(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Return each pixel as a square of `enlarge` pixels a side."""
        if self.enlarge == 1:
            return pixels
        return np.repeat(np.repeat(pixels, self.enlarge, axis=0), self.enlarge, axis=1)


class Pooling:
    """Cells that become pixels, some rows at a time."""

    def __init__(self, raster: Raster, layer: Layer, choose: np.ufunc) -> None:
        self._step = raster.reduce
        self._first = 0 if raster.part is None else raster.part.row
        self._layer = layer if raster.part is None else cut_out(layer, raster.part)
        self._choose = choose
        self._pixels: NDArray[Any] | None = None

    def all(self) -> NDArray[Any]:
        """Return the pixels of a layer that nothing else goes through."""
        for rows in blocks_of(self._layer):
            self.take(slice(rows.start + self._first, rows.stop + self._first))
        return self.pixels

    @property
    def pixels(self) -> NDArray[Any]:
        """The chosen value under each pixel, before enlarging, once all rows were taken."""
        if self._pixels is None:
            raise ValueError("no rows were taken")
        return self._pixels

    def take(self, rows: slice) -> None:
        """Take rows of the map: those after the ones that were taken before."""
        height = self._layer.shape[0]
        first, end = (min(max(row - self._first, 0), height) for row in (rows.start, rows.stop))
        if first == end:
            return
        cells = self._layer[first:end]
        if self._step == 1 and len(cells) == height:
            self._pixels = cells
            return
        if self._pixels is None:
            size = (math.ceil(length / self._step) for length in self._layer.shape)
            self._pixels = np.empty(tuple(size), dtype=self._layer.dtype)
        under_last = min(-first % self._step, len(cells))
        if under_last:  # the rest of what is under the last row of pixels
            row = self._pixels[first // self._step]
            self._choose(row, self._pooled(cells[:under_last])[0], out=row)
        self._pool(cells[under_last:], self._pixels[-(-first // self._step) :])

    def _pool(self, cells: NDArray[Any], pixels: NDArray[Any]) -> None:
        """Pool cells, from the first one of a pixel on, into the first rows of pixels."""

        def pool(rows: slice) -> None:
            pixels[rows] = self._pooled(cells[rows.start * self._step : rows.stop * self._step])

        # by the cells, not the pixels, are there enough for threads
        for_rows(pool, (math.ceil(len(cells) / self._step), cells.shape[1]))

    def _pooled(self, cells: NDArray[Any]) -> NDArray[Any]:
        """Return pixels; the last rows and columns may have fewer cells under them."""
        step, choose = self._step, self._choose
        merged = cells[::step].copy()
        for k in range(1, step):
            more = cells[k::step]
            choose(merged[: len(more)], more, out=merged[: len(more)])
        pixels = merged[:, ::step].copy()
        for k in range(1, step):
            more = merged[:, k::step]
            choose(pixels[:, : more.shape[1]], more, out=pixels[:, : more.shape[1]])
        return pixels


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
