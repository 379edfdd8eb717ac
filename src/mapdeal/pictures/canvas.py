"""The sheet around a map: title, legend, colour bar and scale bar."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from mapdeal.grid.frame import Frame, Region
from mapdeal.kernels import engine, lookup
from mapdeal.kernels.arrays import Bytes
from mapdeal.pictures.colours import ColourBar, Colours, LayerStyle, Swatch
from mapdeal.pictures.overlay import Overlay, Raster, Surface

_SHADES = 16
MOST_COLOURS = 256 - _SHADES  # of a picture; the others are the greys of the text
BLACK, WHITE = MOST_COLOURS, 255
GREY = MOST_COLOURS + _SHADES // 3
_INK = bytes(WHITE - round(covered * (_SHADES - 1) / 255) for covered in range(256))
"""Palette index of each coverage of a pixel, 0..255."""
_FREETYPE = 16 << 20  # bytes; more than FreeType needs, which crashes without memory
_REPLACEMENTS = str.maketrans({
    "\u00d7": "x", "\u2010": "-", "\u2011": "-", "\u2012": "-", "\u2013": "-", "\u2014": "-",
    "\u2212": "-", "\u00df": "ss", "\u00b5": "u", "\u00f8": "o", "\u00d8": "O",
})  # fmt: skip
"""Replacements of characters that Pillow's font lacks even after accents are removed."""
_NO_CHARACTER = "\ufffd"  # drawn as a box


def printable(text: str) -> str:
    """Return `text` in characters of the font: accents are dropped, others become boxes."""
    if text.isascii() and text.isprintable():
        return text
    characters = []
    for character in unicodedata.normalize("NFC", text).translate(_REPLACEMENTS):
        plain = unicodedata.normalize("NFKD", character)
        parts = [c for c in plain if not unicodedata.combining(c)]
        variants = [character] if _has(character) else parts
        characters += [c if _has(c) else _NO_CHARACTER for c in variants]
    return "".join(characters)


@cache
def _has(character: str) -> bool:
    font = _font(20)
    masks = [bytes(font.getmask(tested)) for tested in (character, _NO_CHARACTER)]
    return character.isprintable() and masks[0] != masks[1]


@cache
def _font(size: int) -> Any:
    """Return Pillow's own font, Aileron, with a layout that no optional library changes."""
    from PIL import ImageFont

    font: Any = ImageFont.load_default(size)
    return font.font_variant(layout_engine=ImageFont.Layout.BASIC)


@lru_cache(maxsize=512)  # FreeType takes longer than everything else of a small picture
def text_width(text: str, size: int) -> int:
    length: float = _font(size).getlength(printable(text))
    return math.ceil(length)


def ascent(size: int) -> int:
    return int(_font(size).getmetrics()[0])


def capital_height(size: int) -> int:
    return int(-_font(size).getbbox("H", anchor="ls")[1])


@lru_cache(maxsize=64)
def _ink(text: str, size: int) -> Bytes:
    """Return palette indices of a line of text that begins half a `size` from the left."""
    from PIL import Image as Pillow, ImageDraw

    line = Pillow.new("L", (text_width(text, size) + size, 2 * size))
    at = (size // 2, ascent(size))  # a letter may extend to the left of its place
    ImageDraw.Draw(line).text(at, text, fill=255, font=_font(size), anchor="ls")
    # numpy crashes without memory for a type conversion, so `translate` makes indices of shades
    return np.frombuffer(line.tobytes().translate(_INK), np.uint8).reshape(line.size[::-1])


class Image(NamedTuple):
    """A palette image: indices, shape (H, W), row 0 at the top, and colours, shape (256, 3)."""

    indices: Bytes
    palette: Colours


def beside_each_other(images: Sequence[Image]) -> Image:
    height = max(len(image.indices) for image in images)
    parts = [
        np.pad(image.indices, [(0, height - len(image.indices)), (0, 0)], constant_values=WHITE)
        for image in images
    ]
    return Image(np.hstack(parts), images[0].palette)


class Pen:
    """Drawer of text and lines on a white sheet of palette indices."""

    def __init__(self, size: int) -> None:
        engine.check_room(_FREETYPE)
        self.size, self.title_size = size, round(1.25 * size)
        self.sheet = np.empty((0, 0), dtype=np.uint8)

    def open(self, width: int, height: int) -> None:
        self.sheet = np.full((height, width), WHITE, dtype=np.uint8)

    def text(self, x: int, y: int, text: str, *, limit: int, large: bool = False) -> None:
        """Write a line at an upper left corner, cut to `limit` pixels."""
        size = self.title_size if large else self.size
        self.write(x, y + ascent(size), fitting(text, limit, size), size)

    def label(self, x: float, y: float, text: str) -> None:
        above, below = _font(self.size).getmetrics()
        self.write(int(x), int(y) + (above - below) // 2, printable(text), self.size)

    def write(self, x: int, baseline: int, text: str, size: int) -> None:
        """Write `printable` text in any size from x on."""
        ink = _ink(text, size)
        height, width = ink.shape
        left_x, top = x - size // 2, baseline - ascent(size)
        under = self.sheet[max(top, 0) : top + height, max(left_x, 0) : left_x + width]
        ink = ink[max(-top, 0) :, max(-left_x, 0) :]
        np.minimum(under, ink[: len(under), : under.shape[1]], out=under)

    def fill(self, left_x: float, top: float, right: float, bottom: float) -> None:
        """Fill a black box, its edges included."""
        self.sheet[int(top) : int(bottom) + 1, int(left_x) : int(right) + 1] = BLACK

    def frame(self, x: int, y: int, width: int, height: int) -> None:
        """Draw a thin dark line around a rectangle, outside of it."""
        box = self.sheet[y - 1 : y + height + 1, x - 1 : x + width + 1]
        box[[0, -1]] = GREY
        box[:, [0, -1]] = GREY

    def legend(
        self, x: int, y: int, height: int, bar: ColourBar | None, swatches: Sequence[Swatch]
    ) -> list[tuple[tuple[int, int], Bytes]]:
        boxes = []
        size = self.size
        if bar is not None:
            top = y + int(1.5 * size)
            bar_height = min(height - int(size * (1.6 * len(swatches) + 3)), 30 * size)
            self.text(x, y - int(0.2 * size), bar.unit, limit=10**6)
            column = np.asarray(bar.indices, dtype=np.uint8)[::-1]
            rows = np.arange(bar_height) * len(column) // bar_height
            content = np.repeat(column[rows][:, np.newaxis], int(1.2 * size), axis=1)
            boxes.append(((x, top), content))
            for position, label in bar.ticks:
                tick_y = top + round((1 - position) * (bar_height - 1))
                self.fill(x + 1.2 * size, tick_y, x + 1.5 * size, tick_y)
                self.label(x + 1.8 * size, tick_y, label)
            y = top + bar_height + size
        for swatch in swatches:
            content = np.full((int(1.1 * size), int(1.2 * size)), swatch.index, dtype=np.uint8)
            boxes.append(((x, y), content))
            self.label(x + 1.8 * size, y + content.shape[0] / 2, swatch.label)
            y += int(1.6 * size)
        return boxes

    def coordinates(
        self, left_x: int, bottom: int, across: Sequence[tuple[int, str]],
        along: Sequence[tuple[int, str]],
    ) -> None:  # fmt: skip
        mark = max(3, self.size // 3)
        for pixel, label in across:
            x = left_x + pixel
            self.fill(x, bottom, x, bottom + mark)
            baseline = int(bottom + 1.3 * mark) + capital_height(self.size)
            self.write(x - text_width(label, self.size) // 2, baseline, label, self.size)
        for pixel, label in along:
            y = bottom - pixel
            self.fill(left_x - mark, y, left_x, y)
            self.label(left_x - 1.5 * mark - text_width(label, self.size), y, label)

    def scale_bar(self, x: int, y: int, width: int, metres_per_pixel: float) -> int:
        """Draw a bar of a round length; return the x coordinate behind it."""
        length = round_length(width * metres_per_pixel * 0.4)
        pixels = round(length / metres_per_pixel)
        thick = max(2, self.size // 6)
        self.fill(x, y, x + pixels, y + thick)
        for end in (x, x + pixels):
            self.fill(end, y - 2 * thick, end + thick // 2, y + thick)
        label = f"{length:g} m"
        self.label(x + pixels + self.size, y, label)
        return x + pixels + 2 * self.size + text_width(label, self.size)

    def image(self, colours: Colours) -> Image:
        palette = np.zeros((256, 3), dtype=np.uint8)
        palette[: len(colours)] = colours
        palette[MOST_COLOURS:] = np.linspace(0, 255, _SHADES).astype(np.uint8)[:, np.newaxis]
        return Image(self.sheet, palette)


def fitting(text: str, limit: int, size: int) -> str:
    text = printable(text)
    if text_width(text, size) <= limit:
        return text
    limit -= text_width("...", size)
    while text and text_width(text, size) > limit:
        text = text[:-1]
    return f"{text}..."


_X_AXIS, _Y_AXIS = "x [m]", "y [m]"


def sheet(
    pixels: Bytes, colours: Colours, *, title: str, subtitle: str,
    metres_per_pixel: float, corner_xy: tuple[float, float] | None = None,
    bar: ColourBar | None = None, swatches: Sequence[Swatch] = (),
) -> Image:  # fmt: skip
    height, width = pixels.shape
    text_size = text_size_of(pixels.shape)
    pen = Pen(text_size)
    pad = text_size
    labels = [swatch.label for swatch in swatches]
    if bar is not None:
        labels += [label for _, label in bar.ticks] + [bar.unit]
    widest = max((text_width(label, text_size) for label in labels), default=0)
    column = int(1.9 * text_size + widest) if labels else 0
    map_width = max(width, 8 * text_size)  # the least for a scale bar
    legend_lines = 1.6 * len(swatches) + (14 if bar is not None else 0)
    legend_height = max(height, int(text_size * legend_lines))
    across = ticks_between(corner_xy[0], width, metres_per_pixel, text_size) if corner_xy else []
    along = ticks_between(corner_xy[1], height, metres_per_pixel, text_size) if corner_xy else []
    left_x, top = pad, pad + int((4.2 if along else 3.4) * text_size)
    if along:  # room for their labels
        left_x += int(max(text_width(label, text_size) for _, label in along) + 0.6 * text_size)
    below = int(1.6 * text_size) if across else 0
    needed = left_x + map_width + (pad + column if column else 0) + pad
    title_width = 1 + max(text_width(title, pen.title_size), text_width(subtitle, text_size))
    # The sheet of a thin map is as wide as its title, but very long titles are cut.
    sheet_width = max(needed, min(title_width, 60 * text_size) + 2 * pad)
    sheet_height = max(top + height + below + int(3.2 * text_size), top + legend_height + pad)
    pen.open(sheet_width, sheet_height)
    pen.text(pad, pad, title, limit=sheet_width - 2 * pad, large=True)
    pen.text(pad, pad + int(1.55 * text_size), subtitle, limit=sheet_width - 2 * pad)
    pen.coordinates(left_x, top + height, across, along)
    scale_top = top + height + below + int(0.9 * text_size)
    end = pen.scale_bar(left_x, scale_top, map_width, metres_per_pixel)
    if along:  # above the labels
        x = max(pad, left_x - text_width(_Y_AXIS, text_size) - text_size // 2)
        pen.write(x, top - int(0.55 * text_size), _Y_AXIS, text_size)
    if across:
        pen.label(max(end, left_x + width - text_width(_X_AXIS, text_size)), scale_top, _X_AXIS)
    boxes = pen.legend(left_x + map_width + pad, top, legend_height, bar, swatches)
    for (x, y), content in [((left_x, top), pixels[::-1]), *boxes]:
        h, w = content.shape
        pen.sheet[y : y + h, x : x + w] = content
        pen.frame(x, y, w, h)
    return pen.image(colours)


def on_sheet(
    pixels: Bytes, style: LayerStyle, frame: Frame, raster: Raster, *, title: str,
    swatches: Sequence[Swatch] | None = None, before: str = "", more: str = "",
    overlay: Overlay | None = None,
) -> Image:  # fmt: skip
    """Return the picture of a layer on a sheet; by default with the swatches that occur."""
    texts = [before, frame_text(frame, raster.part), more]
    shown, palette = raster.frame_of(frame), style.colours
    if swatches is None:
        occurs = lookup.histogram(pixels) > 0
        swatches = [swatch for swatch in style.swatches if occurs[swatch.index]]
    legend = list(swatches)
    if overlay is not None:
        if not pixels.flags.writeable:  # a view of the layer itself
            pixels = np.array(pixels)
        legend += overlay.draw(Surface(pixels, shown, raster), len(palette))
        palette = np.vstack([palette, overlay.colours])
        texts.append(overlay.text)
    x, y, yaw = shown.origin
    return sheet(
        pixels, palette.astype(np.uint8), title=title, subtitle="; ".join(filter(None, texts)),
        metres_per_pixel=raster.metres_per_pixel(frame.resolution), swatches=legend,
        corner_xy=None if yaw else (x, y), bar=style.bar,
    )  # fmt: skip


def text_size_of(shape: tuple[int, ...]) -> int:
    return int(min(40, max(14, max(shape) / 55)))


def frame_text(frame: Frame, part: Region | None = None) -> str:
    # If the picture shows only a part of the map, the part's size is added.
    width, height = frame.size_xy
    text = f"{frame.width} x {frame.height} cells, {frame.resolution:.6g} m each, "
    text += f"{width:.6g} x {height:.6g} m"
    x, y, yaw = frame.origin
    if yaw:
        text += f", from {x:.10g}, {y:.10g} at yaw {yaw:.4g} (not turned here)"
    return text if part is None else f"{text}; shown: {part.width} x {part.height} cells"


def ticks_between(
    start: float, pixels: int, metres_per_pixel: float, text_size: int
) -> list[tuple[int, str]]:  # fmt: skip
    """Return round coordinates along an edge with their pixels, as many as fit."""
    widest = max(len(f"{value:.0f}") for value in (start, start + pixels * metres_per_pixel))
    least = text_size * max(4.0, 0.7 * widest + 2) * metres_per_pixel
    steps = (factor * 10.0**power for power in range(-12, 20) for factor in (1, 2, 5))
    step = next(step for step in steps if step >= least)
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    first = math.ceil(start / step - 1e-6)
    last = math.floor((start + pixels * metres_per_pixel) / step + 1e-6)
    ticks = (k * step for k in range(first, last + 1))
    return [(round((x - start) / metres_per_pixel), f"{x + 0.0:.{decimals}f}") for x in ticks]


def round_length(length: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is at most `length`."""
    power = 10.0 ** math.floor(math.log10(length))
    return float(max(s for s in (1, 2, 5) if s * power <= length * (1 + 1e-9)) * power)
