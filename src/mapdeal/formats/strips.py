"""Image formats, and pictures that come in strips of rows: nobody needs all their cells twice."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.open_file import OpenFile
from mapdeal.formats.picture import LARGEST_COMPRESSED_CELLS, Picture
from mapdeal.records import dataclass

STRIP = 1 << 20
"""Bytes of the pixels in a strip, about: they stay in the processor's cache."""

_PIXELS_TOGETHER = 1 << 22


@dataclass(frozen=True, eq=False)
class Strips:
    """A picture whose rows are decoded some at a time, from the north to the south."""

    shape: tuple[int, int]
    pictures: Callable[[], Iterator[Picture]]

    def placed(self) -> Iterator[tuple[slice, Picture]]:
        """Yield each strip and its rows, counted from the south, as grids count them."""
        stop = self.shape[0]
        for picture in self.pictures():
            start = stop - picture.shape[0]
            yield slice(start, stop), picture
            stop = start

    def whole(self) -> Picture:
        samples: NDArray[Any] | None = None
        alpha: NDArray[Any] | None = None
        first = 0
        for part in self.pictures():
            rows = slice(first, first + part.shape[0])
            first = rows.stop
            if part.shape == self.shape:
                return part
            if samples is None:
                more = part.samples.shape[2:]
                samples = np.empty((*self.shape, *more), dtype=part.samples.dtype)
                alpha = None if part.alpha is None else np.empty(self.shape, part.alpha.dtype)
            samples[rows] = part.samples
            if alpha is not None:
                alpha[rows] = part.alpha
        if samples is None:
            raise ValueError("a picture without strips")
        return replace(part, samples=samples, alpha=alpha)


NOT_AN_IMAGE = "is not an image in a supported format: pgm, pbm, ppm, png, bmp, tiff"


@dataclass(frozen=True)
class ImageFormat:
    # The readers of ROS treat some formats differently, because their image libraries do: the
    # modules in `mapdeal.formats.dialects` know these by name. In a format that they do not name,
    # samples mean what `Picture` says.
    name: str
    suffixes: tuple[str, ...]
    recognises: Callable[[bytes], bool]
    read: Callable[[OpenFile, int], Strips]
    memory: Callable[[OpenFile, bytes], int]
    size: Callable[[bytes, Path, int], tuple[int, int]]
    max_cells: int = LARGEST_COMPRESSED_CELLS
    comments: Callable[[bytes], list[str]] = lambda _: []


def rows_of_strip(width: int, row_bytes: int) -> int:
    """Return the rows of a strip, given the pixels of a row and its bytes, which may be fewer."""
    return max(1, STRIP // max(width, row_bytes))


def strips_of(picture: Picture) -> Strips:
    """Return the strips of a picture that is in memory; they are views of it."""
    height, width = picture.shape
    step = max(1, _PIXELS_TOGETHER // width)

    def parts() -> Iterator[Picture]:
        for first in range(0, height, step):
            rows = slice(first, first + step)
            alpha = None if picture.alpha is None else picture.alpha[rows]
            yield replace(picture, samples=picture.samples[rows], alpha=alpha)

    return Strips(picture.shape, parts)


def strips_at_places(
    shape: tuple[int, int], row_bytes: int, rows_at: Callable[[int, int], Picture]
) -> Strips:
    """Return the strips of a picture, given what reads the rows from one to another."""
    step = rows_of_strip(shape[1], row_bytes)

    def parts() -> Iterator[Picture]:
        for first in range(0, shape[0], step):
            yield rows_at(first, min(first + step, shape[0]))

    return Strips(shape, parts)
