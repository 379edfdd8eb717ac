"""Text and lines on a sheet of palette indices."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapdeal.records import dataclass
from mapdeal.render.colours import Colours
from mapdeal.render.glyphs import SHADES, advance, ascent, glyph, middle, printable, text_width

MOST_COLOURS = 256 - SHADES
"""Palette entries that a picture may use; the rest are the greys of the text."""

BLACK, WHITE = MOST_COLOURS, 255
GREY = MOST_COLOURS + SHADES // 3


@dataclass(frozen=True, eq=False)
class Image:
    """A palette image: indices, shape (H, W), row 0 at the top, and colours, shape (256, 3)."""

    indices: NDArray[np.uint8]
    palette: Colours


class Pen:
    """Text and lines, in one size, on a white sheet of palette indices."""

    def __init__(self, size: int) -> None:
        self.size = size
        self._title_size = round(1.25 * size)
        self.sheet = np.empty((0, 0), dtype=np.uint8)

    def open(self, width: int, height: int) -> None:
        """Begin a white sheet."""
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
        self.write(int(x), int(y) + middle(self.size), printable(text), self.size)

    def write(self, x: int, baseline: int, text: str, size: int) -> None:
        """Write `printable` text in any size from x on."""
        for character in text:
            letter = glyph(character, size)
            left, top = max(x + letter.left, 0), max(baseline - letter.top, 0)
            height, width = letter.shades.shape
            under = self.sheet[top : top + height, left : left + width]
            shades = WHITE - letter.shades[: under.shape[0], : under.shape[1]]
            np.minimum(under, shades, out=under)
            x += advance(character, size)

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
        palette[MOST_COLOURS:] = np.linspace(0, 255, SHADES).astype(np.uint8)[:, np.newaxis]
        return Image(self.sheet, palette)


def _cut(text: str, limit: int, size: int) -> str:
    if text_width(text, size) <= limit:
        return text
    limit -= text_width("...", size)
    while text and text_width(text, size) > limit:
        text = text[:-1]
    return f"{text}..."
