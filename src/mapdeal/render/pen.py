"""Text and lines on a sheet of palette indices."""

from __future__ import annotations

import math
import unicodedata
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.kernels.room import check_room
from mapdeal.records import dataclass
from mapdeal.render.colours import Colours

_SHADES = 16

MOST_COLOURS = 256 - _SHADES
"""Palette entries that a picture may use; the rest are the greys of the text."""

BLACK, WHITE = MOST_COLOURS, 255
GREY = MOST_COLOURS + _SHADES // 3

_INK = [WHITE - round(covered * (_SHADES - 1) / 255) for covered in range(256)]
"""Indices by how much of a pixel is covered."""

_FREETYPE = 16 << 20
"""Bytes, more than FreeType takes for letters: it dies where it finds none."""

_ALIKE = str.maketrans({
    "\u00d7": "x", "\u2010": "-", "\u2011": "-", "\u2012": "-", "\u2013": "-", "\u2014": "-",
    "\u2212": "-", "\u00df": "ss", "\u00b5": "u", "\u00f8": "o", "\u00d8": "O",
})  # fmt: skip
"""Characters that the font of Pillow does not have and accents do not make of others."""

_NO_CHARACTER = "\ufffd"
"""Drawn as a box."""


def printable(text: str) -> str:
    """Return `text` in characters that the font has: no accents if need be, else boxes."""
    if text.isascii() and text.isprintable():
        return text
    kept = []
    for character in unicodedata.normalize("NFC", text).translate(_ALIKE):
        plain = unicodedata.normalize("NFKD", character)
        parts = [c for c in plain if not unicodedata.combining(c)]
        shown = [character] if _has(character) else parts
        kept += [c if _has(c) else _NO_CHARACTER for c in shown]
    return "".join(kept)


@cache
def _has(character: str) -> bool:
    font = _font(20)
    masks = [bytes(font.getmask(one)) for one in (character, _NO_CHARACTER)]
    return character.isprintable() and masks[0] != masks[1]


@cache
def _font(size: int) -> Any:
    """Return Pillow's own font, Aileron, laid out alike with and without further libraries."""
    from PIL import ImageFont

    font: Any = ImageFont.load_default(size)
    return font.font_variant(layout_engine=ImageFont.Layout.BASIC)


def text_width(text: str, size: int) -> int:
    """Return the pixels that `text` takes in a line."""
    length: float = _font(size).getlength(printable(text))
    return math.ceil(length)


def ascent(size: int) -> int:
    """Return the rows between the top of a line and its baseline."""
    return int(_font(size).getmetrics()[0])


def capital_height(size: int) -> int:
    return int(-_font(size).getbbox("H", anchor="ls")[1])


@dataclass(frozen=True, eq=False)
class Image:
    """A palette image: indices, shape (H, W), row 0 at the top, and colours, shape (256, 3)."""

    indices: NDArray[np.uint8]
    palette: Colours


class Pen:
    """Text and lines, in one size, on a white sheet of palette indices."""

    def __init__(self, size: int) -> None:
        check_room(_FREETYPE)
        self.size = size
        self._title_size = round(1.25 * size)
        self.sheet = np.empty((0, 0), dtype=np.uint8)

    def open(self, width: int, height: int) -> None:
        self.sheet = np.full((height, width), WHITE, dtype=np.uint8)

    def text_width(self, title: str, subtitle: str) -> int:
        """Return the pixels that the two lines above the map take."""
        return 1 + max(text_width(title, self._title_size), text_width(subtitle, self.size))

    def text(self, x: int, y: int, text: str, *, limit: int, large: bool = False) -> None:
        """Write a line whose upper left corner is given; what does not fit `limit` is cut."""
        size = self._title_size if large else self.size
        self.write(x, y + ascent(size), _cut(printable(text), limit, size), size)

    def fitting(self, text: str, limit: int) -> str:
        """Return a line, cut if it does not fit `limit` pixels."""
        return _cut(printable(text), limit, self.size)

    def label(self, x: float, y: float, text: str) -> None:
        """Write a line that begins at x, its middle at y."""
        above, below = _font(self.size).getmetrics()
        self.write(int(x), int(y) + (above - below) // 2, printable(text), self.size)

    def write(self, x: int, baseline: int, text: str, size: int) -> None:
        """Write `printable` text in any size from x on."""
        from PIL import Image as Pillow
        from PIL import ImageDraw

        line = Pillow.new("L", (text_width(text, size) + size, 2 * size))
        at = (size // 2, ascent(size))  # a letter may begin left of its place
        ImageDraw.Draw(line).text(at, text, fill=255, font=_font(size), anchor="ls")
        left, top = x - at[0], baseline - at[1]
        under = self.sheet[max(top, 0) : top + line.height, max(left, 0) : left + line.width]
        # numpy dies for lack of memory where it converts types, so Pillow turns shades to indices
        ink = np.asarray(line.point(_INK))[max(-top, 0) :, max(-left, 0) :]
        np.minimum(under, ink[: len(under), : under.shape[1]], out=under)

    def fill(self, left: float, top: float, right: float, bottom: float) -> None:
        """Fill a black box, its edges included."""
        self.sheet[int(top) : int(bottom) + 1, int(left) : int(right) + 1] = BLACK

    def frame(self, x: int, y: int, width: int, height: int) -> None:
        """Draw a thin dark line around a rectangle, outside of it."""
        self.sheet[y - 1, x - 1 : x + width + 1] = GREY
        self.sheet[y + height, x - 1 : x + width + 1] = GREY
        self.sheet[y - 1 : y + height + 1, x - 1] = GREY
        self.sheet[y - 1 : y + height + 1, x + width] = GREY

    def image(self, colours: ArrayLike) -> Image:
        """Return the sheet as a picture, given what the indices below `MOST_COLOURS` mean."""
        own = np.asarray(colours, dtype=np.uint8)
        palette = np.zeros((256, 3), dtype=np.uint8)
        palette[: len(own)] = own
        palette[MOST_COLOURS:] = np.linspace(0, 255, _SHADES).astype(np.uint8)[:, np.newaxis]
        return Image(self.sheet, palette)


def _cut(text: str, limit: int, size: int) -> str:
    if text_width(text, size) <= limit:
        return text
    limit -= text_width("...", size)
    while text and text_width(text, size) > limit:
        text = text[:-1]
    return f"{text}..."
