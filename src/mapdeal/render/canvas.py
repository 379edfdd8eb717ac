"""The sheet around a map: title, legend, colour bar and scale bar."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame, Region
from mapdeal.kernels.lookup import histogram
from mapdeal.render.colours import Colours
from mapdeal.render.overlay import Overlay
from mapdeal.render.pen import Image, Pen, capital_height, text_width
from mapdeal.render.raster import Raster
from mapdeal.render.style import ColourBar, Swatch

_X_AXIS, _Y_AXIS = "x [m]", "y [m]"


def sheet(
    pixels: NDArray[np.uint8],
    colours: Colours,
    *,
    title: str,
    subtitle: str,
    metres_per_pixel: float,
    corner_xy: tuple[float, float] | None = None,
    bar: ColourBar | None = None,
    swatches: Sequence[Swatch] = (),
) -> Image:
    """Return the picture of a map on a sheet with everything that explains it."""
    height, width = pixels.shape
    text_size = text_size_of(pixels.shape)
    pen = _Pen(text_size)
    pad = text_size
    column = pen.legend_width(bar, swatches)
    map_width = max(width, pen.minimum_width())
    legend_height = max(height, pen.legend_height(bar, swatches))
    across = ticks_between(corner_xy[0], width, metres_per_pixel, text_size) if corner_xy else []
    along = ticks_between(corner_xy[1], height, metres_per_pixel, text_size) if corner_xy else []
    left, top = pad + pen.labels_width(along), pad + int((4.2 if along else 3.4) * text_size)
    below = int(1.6 * text_size) if across else 0
    needed = left + map_width + (pad + column if column else 0) + pad
    # Thin maps get a sheet that their title fits on, very long titles are cut.
    sheet_width = max(needed, min(pen.text_width(title, subtitle), 60 * text_size) + 2 * pad)
    sheet_height = max(top + height + below + int(3.2 * text_size), top + legend_height + pad)

    pen.open(sheet_width, sheet_height)
    pen.text(pad, pad, title, limit=sheet_width - 2 * pad, large=True)
    pen.text(pad, pad + int(1.55 * text_size), subtitle, limit=sheet_width - 2 * pad)
    pen.coordinates(left, top + height, across, along)
    scale_top = top + height + below + int(0.9 * text_size)
    end = pen.scale_bar(left, scale_top, map_width, metres_per_pixel)
    if along:
        pen.above(pad, left, top, _Y_AXIS)
    if across:
        pen.label(max(end, left + width - text_width(_X_AXIS, text_size)), scale_top, _X_AXIS)
    boxes = pen.legend(left + map_width + pad, top, legend_height, bar, swatches)
    indices = pen.sheet
    indices[top : top + height, left : left + width] = pixels[::-1]
    pen.frame(left, top, width, height)
    for (x, y, w, h), content in boxes:
        indices[y : y + h, x : x + w] = content
        pen.frame(x, y, w, h)

    return pen.image(colours)


def on_sheet(
    pixels: NDArray[np.uint8],
    palette: NDArray[np.integer],
    frame: Frame,
    raster: Raster,
    *,
    title: str,
    swatches: list[Swatch],
    before: str = "",
    more: str = "",
    bar: ColourBar | None = None,
    overlay: Overlay | None = None,
) -> Image:
    """Return the picture of a layer of a frame, with an overlay over it, on a sheet."""
    texts = [before, frame_text(frame, raster.part), more]
    shown = raster.frame_of(frame)
    if overlay is not None:
        if not pixels.flags.writeable:  # they are the layer itself
            pixels = np.array(pixels)
        swatches = swatches + overlay.draw(pixels, shown, raster, len(palette))
        palette = np.vstack([palette, overlay.colours])
        texts.append(overlay.text)
    return sheet(
        pixels,
        palette.astype(np.uint8),
        title=title,
        subtitle="; ".join(filter(None, texts)),
        metres_per_pixel=raster.metres_per_pixel(frame.resolution),
        corner_xy=corner_of(shown),
        bar=bar,
        swatches=swatches,
    )


def text_size_of(shape: tuple[int, ...]) -> int:
    """Return the pixels per em of the text around a map of so many pixels."""
    return int(min(40, max(14, max(shape) / 55)))


def swatches_in(pixels: NDArray[np.uint8], swatches: Sequence[Swatch]) -> list[Swatch]:
    """Return the legend entries whose colour a map shows."""
    shown = histogram(pixels) > 0
    return [swatch for swatch in swatches if shown[swatch.index]]


def frame_text(frame: Frame, part: Region | None = None) -> str:
    """Return a map's size in cells and metres, for a subtitle; of a turned one corner and yaw."""
    # If a picture shows a part of it alone, its size in cells is shown as well.
    width, height = frame.width * frame.resolution, frame.height * frame.resolution
    text = (
        f"{frame.width} x {frame.height} cells, {frame.resolution:.6g} m each, "
        f"{width:.6g} x {height:.6g} m"
    )
    x, y, yaw = frame.origin
    if yaw:
        text += f", from {x:.10g}, {y:.10g} at yaw {yaw:.4g} (not turned here)"
    return text if part is None else f"{text}; shown: {part.width} x {part.height} cells"


def corner_of(frame: Frame) -> tuple[float, float] | None:
    """Return the lower left corner of a map that is not turned, for `sheet`."""
    x, y, yaw = frame.origin
    return None if yaw else (x, y)


def ticks_between(
    start: float, pixels: int, metres_per_pixel: float, text_size: int
) -> list[tuple[int, str]]:  # fmt: skip
    """Return the round coordinates along an edge, each with its pixel, as many as find room."""
    widest = max(len(f"{value:.0f}") for value in (start, start + pixels * metres_per_pixel))
    room = text_size * max(4.0, 0.7 * widest + 2)  # pixels
    step = next(
        factor * 10.0**power
        for power in range(-7, 13)
        for factor in (1, 2, 5)
        if factor * 10.0**power >= room * metres_per_pixel
    )
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    first = math.ceil(start / step - 1e-6)
    last = math.floor((start + pixels * metres_per_pixel) / step + 1e-6)
    return [
        (round((k * step - start) / metres_per_pixel), f"{k * step + 0.0:.{decimals}f}")
        for k in range(first, last + 1)
    ]


def round_length(length: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is at most `length`.

    Examples
    --------
    >>> round_length(7.3), round_length(0.25)
    (5.0, 0.2)
    """
    power = 10.0 ** math.floor(math.log10(length))
    step = max(s for s in (1, 2, 5) if s * power <= length * (1 + 1e-9))
    return float(step * power)


class _Pen(Pen):
    """A pen that writes what goes with a map."""

    def minimum_width(self) -> int:
        """Return the width below which a scale bar makes no sense."""
        return 8 * self.size

    def legend_width(self, bar: ColourBar | None, swatches: Sequence[Swatch]) -> int:
        labels = [s.label for s in swatches]
        if bar is not None:
            labels += [label for _, label in bar.ticks] + [bar.unit]
        if not labels:
            return 0
        return int(1.9 * self.size + max(text_width(label, self.size) for label in labels))

    def legend_height(self, bar: ColourBar | None, swatches: Sequence[Swatch]) -> int:
        return int(self.size * (1.6 * len(swatches) + (14 if bar is not None else 0)))

    def legend(
        self, x: int, y: int, height: int, bar: ColourBar | None, swatches: Sequence[Swatch]
    ) -> list[tuple[tuple[int, int, int, int], NDArray[np.uint8]]]:
        """Draw the labels; return the boxes of colour with their palette indices."""
        boxes = []
        size = self.size
        if bar is not None:
            top = y + int(1.5 * size)
            bar_height = min(height - int(size * (1.6 * len(swatches) + 3)), 30 * size)
            self.text(x, y - int(0.2 * size), bar.unit, limit=10**6)
            column = np.asarray(bar.indices, dtype=np.uint8)[::-1]
            rows = np.arange(bar_height) * len(column) // bar_height
            content = np.repeat(column[rows][:, np.newaxis], int(1.2 * size), axis=1)
            boxes.append(((x, top, int(1.2 * size), bar_height), content))
            for position, label in bar.ticks:
                tick_y = top + round((1 - position) * (bar_height - 1))
                self.fill(x + 1.2 * size, tick_y, x + 1.5 * size, tick_y)
                self.label(x + 1.8 * size, tick_y, label)
            y = top + bar_height + size
        for swatch in swatches:
            content = np.full((int(1.1 * size), int(1.2 * size)), swatch.index, dtype=np.uint8)
            boxes.append(((x, y, content.shape[1], content.shape[0]), content))
            self.label(x + 1.8 * size, y + content.shape[0] / 2, swatch.label)
            y += int(1.6 * size)
        return boxes

    def labels_width(self, ticks: Sequence[tuple[int, str]]) -> int:
        """Return the room that labels left of the map take."""
        if not ticks:
            return 0
        return int(max(text_width(label, self.size) for _, label in ticks) + 0.6 * self.size)

    def coordinates(
        self, left: int, bottom: int, across: Sequence[tuple[int, str]],
        along: Sequence[tuple[int, str]],
    ) -> None:  # fmt: skip
        """Draw round coordinates below and left of the map, whose lower left corner is given."""
        mark = max(3, self.size // 3)
        for pixel, label in across:
            x = left + pixel
            self.fill(x, bottom, x, bottom + mark)
            baseline = int(bottom + 1.3 * mark) + capital_height(self.size)
            self.write(x - text_width(label, self.size) // 2, baseline, label, self.size)
        for pixel, label in along:
            y = bottom - pixel
            self.fill(left - mark, y, left, y)
            self.label(left - 1.5 * mark - text_width(label, self.size), y, label)

    def above(self, left: int, right: int, top: int, name: str) -> None:
        """Name the labels left of a map, which end at `right`, above its upper edge `top`."""
        x = max(left, right - text_width(name, self.size) - self.size // 2)
        self.write(x, top - int(0.55 * self.size), name, self.size)

    def scale_bar(self, x: int, y: int, width: int, metres_per_pixel: float) -> int:
        """Draw a bar of a round length; return where something else may follow."""
        length = round_length(width * metres_per_pixel * 0.4)
        pixels = round(length / metres_per_pixel)
        thick = max(2, self.size // 6)
        self.fill(x, y, x + pixels, y + thick)
        for end in (x, x + pixels):
            self.fill(end, y - 2 * thick, end + thick // 2, y + thick)
        label = f"{length:g} m"
        self.label(x + pixels + self.size, y, label)
        return x + pixels + 2 * self.size + text_width(label, self.size)
