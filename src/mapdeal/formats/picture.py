"""A decoded picture, before a dialect gives its pixels a meaning."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError
from mapdeal.kernels.lookup import look_up
from mapdeal.records import dataclass

Samples = NDArray[np.unsignedinteger[Any]]

LARGEST_CELLS = 1_000_000_000
LARGEST_COMPRESSED_CELLS = 200_000_000


@dataclass(frozen=True, eq=False)
class Picture:
    """Integer samples of a picture, row 0 in the north.

    Parameters
    ----------
    file_format : str
        The name of the image format that the samples come from; the readers of ROS treat some
        formats differently.
    colour : {'grey', 'rgb', 'palette'}
        What a sample is: brightness, a red, green, blue triple, or an index into `palette`.
    samples : numpy.ndarray of uint8 or uint16, shape (H, W) or (H, W, 3)
        Values 0 .. `maxval`, or indices.
    maxval : int
        The sample that means full brightness.
    alpha : numpy.ndarray, shape (H, W), optional
        Opacity of each pixel, 0 .. `maxval` (0 .. 255 for palettes).
    alpha_from : {'channel', 'key'}
        Whether the opacity is a channel of its own or comes from one transparent colour.
    palette : numpy.ndarray of uint8, shape (N, 4), optional
        Red, green, blue, opacity of each index.
    display : tuple of str
        What the file says about showing the picture, such as a gamma. No reader applies it.
    """

    file_format: str
    colour: Literal["grey", "rgb", "palette"]
    samples: Samples
    maxval: int = 255
    alpha: Samples | None = None
    alpha_from: Literal["channel", "key"] = "channel"
    palette: NDArray[np.uint8] | None = None
    display: tuple[str, ...] = ()

    def from_the_south(self) -> Picture:
        """Return the picture with row 0 in the south, as grids have it."""
        alpha = None if self.alpha is None else self.alpha[::-1]
        return replace(self, samples=self.samples[::-1], alpha=alpha)

    def bands(self, most: int) -> Iterator[Picture]:
        """Yield the picture in bands of rows, views of it: so many pixels at most, or a row."""
        height, width = self.shape
        step = max(1, most // width)
        for first in range(0, height, step):
            rows = slice(first, first + step)
            alpha = None if self.alpha is None else self.alpha[rows]
            yield replace(self, samples=self.samples[rows], alpha=alpha)

    def greys_and_others(self) -> tuple[Samples, NDArray[np.bool_]]:
        """Return the grey of each pixel, and which pixels are coloured or not opaque.

        Returns
        -------
        grey : numpy.ndarray, shape (H, W)
            A view of the samples; of a palette, indices. It holds for those that are not `others`.
        others : numpy.ndarray of bool, shape (H, W)
        """
        others = np.zeros(self.shape, dtype=np.bool_)
        grey = self.samples
        if grey.ndim == 3:
            grey = self.samples[..., 0]
            for channel in (1, 2):
                others |= self.samples[..., channel] != grey
        if self.alpha is not None:
            others |= self.alpha != self.opaque
        return grey, others

    def only(self, mask: NDArray[np.bool_]) -> Picture:
        """Return the pixels that a mask marks, in a row."""
        alpha = None if self.alpha is None else self.alpha[mask][np.newaxis]
        return replace(self, samples=self.samples[mask][np.newaxis], alpha=alpha)

    @property
    def opaque(self) -> int:
        """The opacity of a pixel that hides what is behind it."""
        return 255 if self.palette is not None else self.maxval

    @property
    def shape(self) -> tuple[int, int]:
        height, width = self.samples.shape[:2]
        return height, width


def by_sample(table: NDArray[Any], samples: Samples) -> NDArray[Any]:
    """Return the table's entry for each sample; samples of 8 bits go the fast way."""
    if samples.dtype == np.uint8 and table.dtype.itemsize == 1 and samples.ndim == 2:
        whole = np.zeros(256, dtype=table.dtype)
        whole[: len(table)] = table
        return look_up(samples, whole)
    return table[samples]


def opaque_greys(kind: Picture) -> Picture:
    """Return a row of all greys 0 .. maxval, opaque, as a picture like another one."""
    # Of a palette it has all indices.
    dtype = kind.samples.dtype
    count = kind.maxval + 1 if kind.palette is None else len(kind.palette)
    greys = np.arange(count)[np.newaxis]
    alpha = None if kind.alpha is None else np.full_like(greys, kind.opaque, kind.alpha.dtype)
    samples = greys.astype(dtype)
    if kind.samples.ndim == 3:
        samples = np.repeat(samples[..., np.newaxis], 3, axis=2)
    return replace(kind, samples=samples, alpha=alpha)


def check_size(source: object, width: int, height: int, limit: int) -> None:
    """Refuse pictures without cells, or with more cells than `limit`, before memory is taken."""
    place = "image size"
    if width <= 0 or height <= 0:
        rule = "width and height must be above 0"
        raise MalformedInputError(rule, source=str(source), place=place, got=(width, height))
    if width * height > limit:
        rule = f"{width} x {height} are {width * height} cells, above the limit of {limit}"
        hint = "--max-cells N raises the limit, if you trust the file"
        raise MalformedInputError(rule, source=str(source), place=place, hint=hint)


def to_16_bit(maxval: int) -> NDArray[np.uint16]:
    """Return the 16-bit sample of each sample 0 .. `maxval`: floor(65535 v / maxval + 0.5).

    Examples
    --------
    >>> to_16_bit(255)[[0, 1, 255]].tolist()  # times 257
    [0, 257, 65535]
    """
    values = np.arange(maxval + 1, dtype=np.int64)
    return ((2 * 65535 * values + maxval) // (2 * maxval)).astype(np.uint16)
