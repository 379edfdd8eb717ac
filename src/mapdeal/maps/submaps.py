"""Paints Cartographer's submaps, byte for byte as the graphics library that it uses.

References
----------
Cartographer, ``io/submap_painter.cc``: the order, the frame and the colours of submaps.
cairo 1.16 and pixman: the matrix in 16.16 fixed point, which is exact in the middle of the area;
bilinear weights of 7 bits; the 8-bit operator OVER.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError
from mapdeal.kernels.arrays import Floats
from mapdeal.kernels.rotations import product

UNKNOWN_GREY = 128
_PADDING = 5  # pixels around all submaps
_UNIT, _HALF = 1 << 16, 1 << 15  # in fixed point
_WEIGHTS = 128
_PIXELS_AT_ONCE = 1 << 16
_WIDEST_IN_32_BITS = 1 << 13
_FARTHEST = 2**30
_ALIGNED = 1 / 256  # cairo treats smaller elements of a matrix as 0


class Slice(NamedTuple):
    """Where a texture lies on the canvas: x, y = scale (col, row) + shift, in pixels."""

    width: int
    height: int
    scale: Floats
    shift: Floats

    def moved_by(self, pixels: tuple[float, float]) -> Slice:
        return self._replace(shift=self.shift + pixels)


class Canvas(NamedTuple):
    width: int
    height: int
    origin: tuple[float, float]  # of the map on the canvas, pixels from its upper left corner


def canvas_of(slices: Iterable[tuple[Any, Slice]]) -> Canvas:
    """Return the canvas around all slices, with float32 bounds as Cartographer has them."""
    corners = [
        product(np.array([(0, 0), (w, 0), (0, h), (w, h)]), scale.T) + shift
        for _, (w, h, scale, shift) in slices
    ]
    points = np.concatenate(corners)
    if not (np.abs(points) < _FARTHEST).all():
        raise MalformedInputError("a submap lies too far away", place="pose graph")
    points = points.astype(np.float32)
    low = points.min(axis=0)
    width, height = np.ceil(points.max(axis=0) - low).astype(int) + 2 * _PADDING
    x, y = (np.float32(_PADDING) - low).tolist()
    return Canvas(int(width), int(height), (x, y))


def paint(pixels: NDArray[np.uint8], texture: NDArray[np.uint32], place: Slice) -> None:
    """Paint a texture over grey pixels, row 0 at the top."""
    # The lower half of each texel is its intensity, the upper half its opacity.
    inverse = _inverse(place.scale)
    shift = -(inverse * place.shift).sum(axis=1)
    west, north, east, south = _covered(place, inverse, pixels.shape)
    if west >= east or north >= south:
        return
    matrix, offset = _fixed(inverse, shift, ((west + east) / 2, (north + south) / 2))
    is_exact = _is_aligned(inverse) and not (np.rint(shift * 256) % 256).any()
    filters = None if _is_bilinear(inverse, shift) else [_box_filter(row) for row in inverse]
    wide = np.pad(texture, 2)
    step = max(1, _PIXELS_AT_ONCE // (east - west))
    dtype = np.int32 if max(texture.shape) < _WIDEST_IN_32_BITS else np.int64
    for first in range(north, south, step):
        rows = np.arange(first, min(first + step, south))
        starts = ((west + offset[0]) * _UNIT + _HALF, (rows + offset[1]) * _UNIT + _HALF)
        firsts = [value - (1 if is_exact else _HALF) for value in _applied(matrix, *starts)]
        steps = matrix[:, :1] * np.arange(east - west)
        x, y = (np.stack(firsts)[:, :, np.newaxis] + steps[:, np.newaxis]).astype(dtype)
        if is_exact:
            x, y = x >> 16 << 16, y >> 16 << 16
        if filters is None:
            texels = _interpolated(wide, x, y)
        else:
            texels = _averaged(texture, x + _HALF, y + _HALF, *filters)
        area = pixels[first : rows[-1] + 1, west:east]
        shown = area * (255 - (texels >> 16)) + 128
        area[...] = np.minimum(((shown + (shown >> 8)) >> 8) + (texels & 0xFFFF), 255)


def _covered(place: Slice, inverse: Floats, shape: tuple[int, ...]) -> list[int]:
    """Return the columns and rows of the area that cairo paints: west, north, east, south."""
    pads = [0.5 if math.hypot(*inverse[:, axis]) < 1 else 0.0 for axis in (0, 1)]
    xs, ys = ((-pad, size + pad) for pad, size in zip(pads, place[:2], strict=True))
    corners = np.array([(x, y) for x in xs for y in ys])
    corners = product(corners, place.scale.T) + place.shift
    beyond = 0.5 - np.array(pads)
    low, high = corners.min(axis=0) - beyond, corners.max(axis=0) + beyond
    ends = np.floor(np.concatenate([low, high]) + 0.5)
    return np.clip(ends, 0, [shape[1], shape[0]] * 2).astype(int).tolist()  # type: ignore[no-any-return]


def _fixed(
    inverse: Floats, shift: Floats, middle: tuple[float, float]
) -> tuple[NDArray[np.int64], list[int]]:
    """Return the matrix from pixels to texels in fixed point, and an offset of pixels before it."""
    # The offset keeps the shift small; corrections make the matrix exact at `middle`.
    (xx, xy), (yx, yy) = inverse.tolist()
    x0, y0 = shift.tolist()
    offsets = [(x0, y0)] + [
        ((y0 * xy - x0 * (yy + j)) / det, (x0 * yx - y0 * (xx + i)) / det)
        for i, j in itertools.product((-1, 1), repeat=2)
        if abs(det := (xx + i) * (yy + j) - xy * yx) >= np.finfo(float).eps
    ]
    offset = np.floor(min(offsets, key=lambda xy: max(map(abs, xy))))
    shift = shift + (inverse * offset).sum(axis=1)
    matrix = np.rint(np.column_stack([inverse, shift]) * _UNIT).astype(np.int64)
    for _ in range(0 if _is_aligned(inverse) else 5):
        texel = np.array(_applied(matrix, *(np.rint(np.array(middle) * _UNIT).astype(np.int64))))
        error = (_inverse(inverse) * (texel / _UNIT - shift)).sum(axis=1) - middle
        correction = np.rint((inverse * error).sum(axis=1) * _UNIT).astype(np.int64)
        if not correction.any():
            break
        matrix[:, 2] -= correction
    return matrix, (-offset).astype(int).tolist()


def _determinant(matrix: Floats) -> float:
    (a, b), (c, d) = matrix.tolist()
    return float(a * d - b * c)


def _inverse(matrix: Floats) -> Floats:
    (a, b), (c, d) = matrix.tolist()
    return np.array([[d, -b], [-c, a]]) / _determinant(matrix)


def _is_aligned(inverse: Floats) -> bool:
    """Return whether cairo treats a matrix as a rotation by quarter turns without scaling."""
    is_small = np.abs(inverse) < _ALIGNED
    is_turned = is_small.trace() == 2 or is_small[::-1].trace() == 2
    return bool(is_turned and abs(_determinant(inverse) ** 2 - 1) < _ALIGNED)


def _applied(matrix: NDArray[np.int64], x: Any, y: Any) -> list[Any]:
    return [(row[0] * x + row[1] * y + row[2] * _UNIT + _HALF) >> 16 for row in matrix]


def _is_bilinear(inverse: Floats, shift: Floats) -> bool:
    """Return whether cairo interpolates: for pixels below 4/3 of a texel, and exact halves."""
    squares = (inverse * inverse).sum(axis=1)
    is_half = (abs(squares - 4) < 0.01) & (np.rint(256 * inverse.prod(axis=1)) == 0)
    is_half &= np.rint(256 * shift) % 256 == 0
    return bool(((squares < 16 / 9) | is_half).all())


_BoxFilter = tuple[int, NDArray[np.int64]]
"""Weights of texels, in fixed point, for places between them: bits, and shape (2**bits, width)."""


def _box_filter(row: Floats) -> _BoxFilter:
    """Return the filter by which cairo averages along an axis of a smaller picture."""
    size = min(math.hypot(*row), 16.0)
    size = size if size >= 1 / 0.75 else 1.0
    width, bits = math.ceil(size + 1), math.floor(math.log2(128 / size)) + 1
    place = (np.arange(1 << bits) + 0.5) / (1 << bits)
    first = np.ceil(place - width / 2 - 0.5) - place + 0.5
    overlap = np.clip((size + 1) / 2 - np.abs(first[:, np.newaxis] + np.arange(width)), 0, 1)
    share = 1 / overlap.sum(axis=1, keepdims=True)
    weights = (np.floor(overlap * _UNIT) * share).astype(np.int64)
    weights[:, width // 2] += _UNIT - weights.sum(axis=1)
    return bits, weights


def _averaged(
    texture: NDArray[np.uint32], x: NDArray[Any], y: NDArray[Any], *filters: _BoxFilter
) -> NDArray[np.uint32]:
    """Return the means of texels around places in fixed point; those outside are 0."""
    starts, weights = [], []
    border = max(table.shape[1] for _, table in filters) + 1
    for values, size, (bits, table) in zip((x, y), texture.shape[::-1], filters, strict=True):
        middle = (values >> 16 - bits << 16 - bits) + (1 << 16 - bits) // 2
        weights.append(table[(middle & _UNIT - 1) >> 16 - bits])
        start = (middle - 1 - (table.shape[1] - 1) * _HALF) >> 16
        starts.append(np.clip(start + border, 0, size + border))
    wide = np.pad(texture, ((border, 2 * border), (border, 2 * border))).astype(np.int64)
    total = np.zeros((2, *x.shape), dtype=np.int64)
    for row in range(weights[1].shape[-1]):
        for col in range(weights[0].shape[-1]):
            weight = (weights[1][..., row] * weights[0][..., col] + _HALF) >> 16
            texels = wide[starts[1] + row, starts[0] + col]
            total += np.array([texels & 0xFFFF, texels >> 16]) * weight
    intensity, opacity = np.clip((total + _HALF) >> 16, 0, 255).astype(np.uint32)
    return np.asarray(intensity | opacity << 16)


def _interpolated(wide: NDArray[np.uint32], x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.uint32]:
    """Return texels at places in fixed point; those in a border of 2 and beyond it are 0."""
    height, width = wide.shape
    at = np.clip((y >> 16) + 2, 0, height - 2) * width + np.clip((x >> 16) + 2, 0, width - 2)
    right = ((x >> 9) & (_WEIGHTS - 1)).astype(np.uint32)
    below = ((y >> 9) & (_WEIGHTS - 1)).astype(np.uint32)
    texels = wide.reshape(-1)
    # both halves of a texel stay below 16 bits
    upper = texels[at] * (_WEIGHTS - right) + texels[at + 1] * right
    at += width
    lower = texels[at] * (_WEIGHTS - right) + texels[at + 1] * right
    above = _WEIGHTS - below
    intensity = ((upper & 0xFFFF) * above + (lower & 0xFFFF) * below) >> 14
    opacity = ((upper >> 16) * above + (lower >> 16) * below) >> 14
    return np.asarray(intensity | opacity << 16)
