"""Shapes as pixels: those whose centres lie inside.

Corners are rounded to a fraction of a pixel, and what follows is whole numbers: the same pixels
everywhere. A centre on a left or lower edge is inside, one on a right or upper edge is not, so
that shapes side by side neither overlap nor leave a gap.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_PIXEL = 256  # of coordinates, per pixel
_FARTHEST = 2.0**20  # pixels; beyond, products of coordinates need more than 64 bits


def fill_polygons(pixels: NDArray[np.uint8], corners: NDArray[np.float64], index: int) -> None:
    """Fill convex polygons."""
    fixed = _fixed(corners)
    first, end = (_from_centre(reach) for reach in (fixed[..., 1].min(1), fixed[..., 1].max(1)))
    which, row = _rows(first, end, len(pixels))
    start = fixed[which]
    stop = np.roll(start, -1, axis=1)
    y = (row * _PIXEL + _PIXEL // 2)[:, np.newaxis]
    crosses = (start[..., 1] <= y) != (stop[..., 1] <= y)
    height = np.where(crosses, stop[..., 1] - start[..., 1], 1)
    x = start[..., 0] + (y - start[..., 1]) * (stop[..., 0] - start[..., 0]) // height
    far = np.iinfo(np.int64).max
    left = np.where(crosses, x, far).min(axis=1)
    right = np.where(crosses, x, -far).max(axis=1)
    _fill(pixels, row, _from_centre(left), _from_centre(right), index)


def fill_discs(
    pixels: NDArray[np.uint8], centres: NDArray[np.float64], radius: float, index: int
) -> None:
    """Fill discs around centres, shape (N, 2): column and row, in pixels."""
    fixed = _fixed(centres)
    reach = int(_fixed(np.array(radius)))
    x, y = fixed[:, 0], fixed[:, 1]
    which, row = _rows(_from_centre(y - reach), _from_centre(y + reach), len(pixels))
    rise = row * _PIXEL + _PIXEL // 2 - y[which]
    half = np.floor(np.sqrt(np.maximum(reach**2 - rise**2, 0))).astype(np.int64)
    _fill(pixels, row, _from_centre(x[which] - half), _from_centre(x[which] + half), index)


def thick_lines(
    starts: NDArray[np.float64], ends: NDArray[np.float64], thickness: float
) -> NDArray[np.float64]:
    """Return lines between points, shape (N, 2) each, as rectangles, shape (M, 4, 2)."""
    along = ends - starts
    length = np.sqrt((along**2).sum(axis=1, keepdims=True))
    seen = length[:, 0] > 0
    starts, ends, along = starts[seen], ends[seen], along[seen] / length[seen]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1) * (thickness / 2)
    return np.stack([starts + aside, ends + aside, ends - aside, starts - aside], axis=1)


def _fixed(pixels: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.rint(np.clip(pixels, -_FARTHEST, _FARTHEST) * _PIXEL).astype(np.int64)


def _from_centre(place: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the first pixel whose centre is at a place or beyond it."""
    return -((_PIXEL // 2 - place) // _PIXEL)


def _rows(
    first: NDArray[np.int64], end: NDArray[np.int64], height: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return every row of every shape: which shape, and which row."""
    first, end = np.clip(first, 0, height), np.clip(end, 0, height)
    count = np.maximum(end - first, 0)
    which = np.repeat(np.arange(len(count)), count)
    return which, first[which] + _counted(count)


def _fill(
    pixels: NDArray[np.uint8], row: NDArray[np.int64], first: NDArray[np.int64],
    end: NDArray[np.int64], index: int,
) -> None:  # fmt: skip
    first, end = np.clip(first, 0, pixels.shape[1]), np.clip(end, 0, pixels.shape[1])
    count = np.maximum(end - first, 0)
    pixels[np.repeat(row, count), np.repeat(first, count) + _counted(count)] = index


def _counted(count: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return 0, 1, .. below each count, one after the other."""
    return np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
