"""Letters in shades of grey, drawn from the outlines in ``glyphs.npz``.

Only whole numbers are calculated with, so that a text is the same pixels with any version of any
library. The outlines are those of Aileron Regular, see ``glyphs.md``; ``docs/glyphs.py`` wrote
the file. The letters of small pictures stand drawn in ``atlas.bin``: to read and to draw outlines
would take as long as all the rest of such a picture.
"""

from __future__ import annotations

import io
import zlib
from functools import cache

import numpy as np
from numpy.typing import NDArray

from mapdeal.records import dataclass
from mapdeal.resources import packaged

SHADES = 16
"""Levels of coverage, from 0 for none to 15."""

REPLACEMENT = "\ufffd"
"""Drawn as a box, for characters that there is no outline of."""

_UNITS = 2048  # of outlines, per em
_PIXEL = 64  # of coordinates, per pixel
_SCANS = 16  # lines across a pixel on which coverage is measured
_PIECES = 6  # straight ones that a curve becomes

_CAPITALS, _SMALL, _OVERSHOOT = 1413, 1085, 29
_ASCENT, _DESCENT = 0.97, 0.23
_HEIGHTS = np.array([
    -_UNITS, -_OVERSHOOT, 0, _SMALL, _SMALL + _OVERSHOOT, _CAPITALS, _CAPITALS + _OVERSHOOT,
    2 * _UNITS,
])  # fmt: skip


@dataclass(frozen=True, eq=False)
class Glyph:
    """A character in one size.

    Attributes
    ----------
    shades : numpy.ndarray of uint8, shape (H, W)
        How much of each pixel is covered, below `SHADES`; row 0 at the top.
    left, top : int
        Where the pixels begin: columns right of the pen, rows above the baseline.
    advance : int
        How far the pen moves, pixels.
    """

    shades: NDArray[np.uint8]
    left: int
    top: int
    advance: int


def printable(text: str) -> str:
    """Return `text` in characters that have outlines: no accents if need be, else boxes."""
    if text.isascii() and text.isprintable():
        return text
    import unicodedata

    known = _outlines().places
    kept = []
    for character in unicodedata.normalize("NFC", text):
        if character in known:
            kept.append(character)
            continue
        plain = unicodedata.normalize("NFKD", character)
        parts = [c for c in plain if not unicodedata.combining(c)]
        kept += [c if c in known else REPLACEMENT for c in parts]
    return "".join(kept)


def text_width(text: str, size: int) -> int:
    """Return the pixels that `text` takes in a line."""
    return sum(advance(character, size) for character in printable(text))


def advance(character: str, size: int) -> int:
    """Return how far a character moves the pen, pixels."""
    drawn = _atlas().get((character, size))
    if drawn is not None:
        return drawn.advance
    outlines = _outlines()
    return _scaled(outlines.advances[outlines.places[character]], size)


def ascent(size: int) -> int:
    """Return the rows between the top of a line and its baseline."""
    return -int(-_ASCENT * size // 1)


def middle(size: int) -> int:
    """Return the rows between the middle of a line and its baseline."""
    return (ascent(size) + int(-_DESCENT * size // 1)) // 2


def capital_height(size: int) -> int:
    """Return the height of capitals and digits, pixels."""
    return _scaled(_CAPITALS, size)


@cache
def glyph(character: str, size: int) -> Glyph:
    """Return a character of `printable` text as pixels, `size` pixels per em."""
    return _atlas().get((character, size)) or drawn_glyph(character, size)


def drawn_glyph(character: str, size: int) -> Glyph:
    """Return a character of `printable` text, drawn from its outline."""
    outlines = _outlines()
    points = outlines.segments(outlines.places[character])
    shift = _scaled(outlines.advances[outlines.places[character]], size)
    if not len(points):
        return Glyph(np.zeros((0, 0), dtype=np.uint8), 0, 0, shift)
    x = points[..., 0] * (size * _PIXEL) // (_UNITS * _PIECES**2)
    y = _fitted(points[..., 1] // _PIECES**2, size)
    left, bottom = int(x.min()) // _PIXEL, int(y.min()) // _PIXEL
    width = int(x.max()) // _PIXEL - left + 1
    height = -(-int(y.max()) // _PIXEL) - bottom
    shades = _shades(x - left * _PIXEL, y - bottom * _PIXEL, height, width)
    return Glyph(shades[::-1], left, bottom + height, shift)


def _fitted(y: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    """Return heights in units as `_PIXEL`s, letters' tops and bottoms on the edges of pixels."""
    small, capitals = (_scaled(units, size) * _PIXEL for units in (_SMALL, _CAPITALS))
    below = (_UNITS - _OVERSHOOT) * size * _PIXEL // _UNITS
    above = (2 * _UNITS - _CAPITALS - _OVERSHOOT) * size * _PIXEL // _UNITS
    fitted = np.array([-below, 0, 0, small, small, capitals, capitals, capitals + above])
    piece = np.searchsorted(_HEIGHTS, y, side="right") - 1
    start, end = _HEIGHTS[piece], _HEIGHTS[piece + 1]
    risen: NDArray[np.int64] = (y - start) * (fitted[piece + 1] - fitted[piece]) // (end - start)
    return fitted[piece] + risen


def _scaled(units: int, size: int) -> int:
    return (2 * units * size + _UNITS) // (2 * _UNITS)


def _shades(
    x: NDArray[np.int64], y: NDArray[np.int64], height: int, width: int
) -> NDArray[np.uint8]:
    """Return what lines, shape (N, 2) each, enclose; row 0 is at the bottom.

    Along each of some lines across a row of pixels, a pixel is covered from where an upward edge
    is crossed to where a downward one is.
    """
    step = _PIXEL // _SCANS
    first, last = (-((step // 2 - y[:, k]) // step) for k in (0, 1))  # scans at or above
    upward = last > first
    low, high = np.minimum(first, last), np.maximum(first, last)
    count = high - low
    edge = np.repeat(np.arange(len(count)), count)
    scan = low[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    rise = scan * step + step // 2 - y[edge, 0]
    crossing = x[edge, 0] + rise * (x[edge, 1] - x[edge, 0]) // (y[edge, 1] - y[edge, 0])
    sign = np.where(upward[edge], 1, -1)
    column, beyond = crossing // _PIXEL, crossing % _PIXEL
    covered = np.zeros(height * (width + 1), dtype=np.int64)
    place = scan // _SCANS * (width + 1) + column
    np.add.at(covered, place, sign * (_PIXEL - beyond))
    np.add.at(covered, place + 1, sign * beyond)
    whole = _SCANS * _PIXEL
    share = np.cumsum(covered.reshape(height, width + 1), axis=1)[:, :width]
    share = np.minimum(np.abs(share), whole)
    return ((2 * share * (SHADES - 1) + whole) // (2 * whole)).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class _Outlines:
    """Closed contours of quadratic curves: points on them, and one off each, in units."""

    places: dict[str, int]
    advances: list[int]
    first_curves: list[int]
    start: NDArray[np.int64]
    off: NDArray[np.int64]
    end: NDArray[np.int64]

    def segments(self, place: int) -> NDArray[np.int64]:
        """Return a glyph's straight pieces, shape (N, 2, 2), in units times `_PIECES` squared."""
        curves = slice(*self.first_curves[place : place + 2])
        return _pieces(self.start[curves], self.off[curves], self.end[curves])


def _pieces(
    start: NDArray[np.int64], off: NDArray[np.int64], end: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return quadratic curves as straight pieces, shape (N, 2, 2)."""
    t = np.arange(_PIECES + 1)[:, np.newaxis, np.newaxis]
    rest = _PIECES - t
    points = start * rest**2 + off * (2 * t * rest) + end * t**2
    return np.stack([points[:-1], points[1:]], axis=2).reshape(-1, 2, 2)


@cache
def _outlines() -> _Outlines:
    with np.load(io.BytesIO(packaged("mapdeal.render", "glyphs.npz"))) as file:
        points = np.cumsum(file["steps"], axis=1, dtype=np.int64).T
        last_curves = np.cumsum(file["lengths"], dtype=np.int64) // 2  # points on and off by turns
        first_curves = np.concatenate([[0], last_curves])
        ends = np.arange(1, last_curves[-1] + 1)
        ends[last_curves - 1] = first_curves[:-1]
        first_contours = np.concatenate([[0], np.cumsum(file["contours"], dtype=np.int64)])
        return _Outlines(
            places={chr(code): place for place, code in enumerate(file["characters"].tolist())},
            advances=file["advances"].tolist(),
            first_curves=first_curves[first_contours].tolist(),
            start=points[::2],
            off=points[1::2],
            end=points[::2][ends],
        )


ATLAS_SIZES = (14, 18)
"""Pixels per em of what `atlas.bin` holds: the text and the titles of small pictures."""

ATLAS_CHARACTERS = [chr(code) for code in range(0x20, 0x7F)]

_NUMBERS = 5
_BIAS = 128


def packed(glyphs: list[Glyph]) -> bytes:
    """Return the glyphs of an atlas as the bytes of its file.

    Compressed: five bytes for each glyph (left and top plus 128, advance, height, width), then
    the shades of all of them.
    """
    sizes = [(g.left + _BIAS, g.top + _BIAS, g.advance, *g.shades.shape) for g in glyphs]
    return zlib.compress(
        np.array(sizes, np.uint8).tobytes() + b"".join(g.shades.tobytes() for g in glyphs), 9
    )


@cache
def _atlas() -> dict[tuple[str, int], Glyph]:
    data = np.frombuffer(zlib.decompress(packaged("mapdeal.render", "atlas.bin")), np.uint8)
    keys = [(character, size) for size in ATLAS_SIZES for character in ATLAS_CHARACTERS]
    at = _NUMBERS * len(keys)
    sizes = data[:at].reshape(len(keys), _NUMBERS).tolist()
    found = {}
    for key, (left, top, shift, height, width) in zip(keys, sizes, strict=True):
        shades = data[at : at + height * width].reshape(height, width)
        found[key] = Glyph(shades, left - _BIAS, top - _BIAS, shift)
        at += height * width
    return found
