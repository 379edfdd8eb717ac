"""Pictures of several maps: differences, conflicts of a merge, and walls of a score."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OCCUPIED
from mapdeal.kernels.arrays import Bytes, Floats
from mapdeal.pictures import canvas, colours, overlay, styles

_UNKNOWN = 1  # the largest kind of cells that are unknown in both maps
_SMALL_SIDE = 1200  # pixels; enlarges small maps until single cells are visible


def difference_image(
    changes: Bytes, frame: Frame, *, title: str, image_max: int = overlay.DEFAULT_IMAGE_MAX,
    image_extent: overlay.ImageExtent = "all", only_in: tuple[str, str] | None = None,
    style: colours.LayerStyle | None = None, before: str = "", unknown: int = _UNKNOWN,
) -> canvas.Image:  # fmt: skip
    shows_cells = only_in is not None or style is not None
    options = {"small_side": _SMALL_SIDE} if shows_cells else {}
    cells = np.maximum(changes, unknown)  # those of one map alone count as unknown
    part = overlay.shown_part(cells, frame, image_extent, unknown=unknown)
    raster = overlay.Raster.fitting(frame.shape, image_max, part=part, **options)
    pixels = raster.enlarged(raster.largest(changes))
    style = style or styles.difference_style(only_in)
    return canvas.on_sheet(pixels, style, frame, raster, title=title, before=before)


# Palette indices: occupancy + 1 (unknown is 0), then the kinds of conflict, which are added to
# `_CONFLICT_BASE`. The largest index in a pixel is drawn.
_NOT_KNOWN = 0
_FREE = 1
_OCCUPIED = 101
_CONFLICT_BASE = _OCCUPIED
_ANY_CONFLICT = 3  # the only kind of conflict with more than two maps


def merge_image(
    grid: OccupancyGrid, conflicts: Bytes, *, names: Sequence[str],
    title: str | None = None, image_extent: overlay.ImageExtent = "known", **look: Any,
) -> canvas.Image:  # fmt: skip
    kinds = grid.occupancy.view(np.uint8) + np.uint8(1)  # unknown, 255, wraps to 0
    if len(names) > 2:
        legend = {_CONFLICT_BASE + _ANY_CONFLICT: "occupied in one map, free in another"}
        kinds[conflicts > 0] = _CONFLICT_BASE + _ANY_CONFLICT
    else:
        first, second = names
        legend = {
            _CONFLICT_BASE + 1: f"occupied in {first}, free in {second}",
            _CONFLICT_BASE + 2: f"free in {first}, occupied in {second}",
        }
        np.add(conflicts, _CONFLICT_BASE, out=kinds, where=conflicts > 0)
    legend |= {_OCCUPIED: "occupied", _FREE: "free", _NOT_KNOWN: "unknown"}
    value_colours = styles.occupancy_style().colours
    unknown_colours, known_colours = value_colours[OCCUPIED + 1 :], value_colours[: OCCUPIED + 1]
    conflict_colours = [colours.REMOVED, colours.ADDED, colours.REMOVED]
    swatches = tuple(colours.Swatch(kind, text) for kind, text in legend.items())
    palette = colours.palette_of(unknown_colours, known_colours, conflict_colours)
    style = colours.LayerStyle(palette, swatches=swatches)
    title = title or f"{', '.join(names[:-1])} and {names[-1]}, merged"
    return difference_image(
        kinds, grid.frame, title=title, style=style, unknown=_NOT_KNOWN,
        image_extent=image_extent, **look,
    )  # fmt: skip


# Palette indices of a score; the largest index in a pixel is drawn. Walls of the map follow, by
# their distance to the nearest true wall.
UNKNOWN, KNOWN_BY_MAP, FREE, UNCOVERED, FOUND, MISSED = range(6)
_FIRST_LEVEL, _LEVELS = 6, 100
_LABELS = {
    MISSED: "true wall, no wall of the map within 0.1 m",
    FOUND: "true wall, with a wall of the map",
    UNCOVERED: "known in the true map alone",
    FREE: "free in the true map",
    KNOWN_BY_MAP: "known in the map alone",
    UNKNOWN: "unknown in both",
}
_COLOURS = [
    colours.RVIZ_UNKNOWN, (176, 188, 186), colours.RVIZ_FREE, (208, 222, 240), (150, 150, 150),
    colours.ADDED,
]  # fmt: skip

_ANCHORS = [(12, 12, 30), (95, 20, 115), (190, 35, 85), (240, 95, 30), (255, 170, 0)]
_NEAR = 0.1  # metres: farther true walls are missed
_TOP, _LEAST_CELLS = 0.5, 5  # end of the scale of distances, metres, and at least in cells
_TICKS = 5
_ROUNDING = 1e-9


class ScoredWalls(NamedTuple):
    frame: Frame
    estimate: Bytes
    truth: Bytes
    distances: Floats
    missed: Floats

    @property
    def top(self) -> float:
        return max(_TOP, _LEAST_CELLS * self.frame.resolution)


def score_image(
    walls: ScoredWalls, *, title: str, image_max: int = overlay.DEFAULT_IMAGE_MAX,
    image_extent: overlay.ImageExtent = "all",
) -> canvas.Image:  # fmt: skip
    # True walls without a wall of the map within 0.1 m are marked; in a pixel the farthest shows.
    codes = _codes_of(walls)
    part = overlay.shown_part(codes, walls.frame, image_extent, unknown=UNKNOWN)
    raster = overlay.Raster.fitting(walls.frame.shape, image_max, part=part)
    pixels = raster.enlarged(raster.largest(codes))
    ticks = [(k / _TICKS, f"{walls.top * k / _TICKS:g}") for k in range(_TICKS)]
    ticks.append((1.0, f"{walls.top:g} and more"))
    unit = "walls of the map: to the nearest true one [m]"
    style = colours.LayerStyle(
        colours.palette_of(_COLOURS, colours.interpolated(_ANCHORS, _LEVELS)),
        swatches=tuple(colours.Swatch(index, label) for index, label in _LABELS.items()),
        bar=colours.ColourBar(range(_FIRST_LEVEL, _FIRST_LEVEL + _LEVELS), ticks, unit),
    )
    map_sheet = canvas.on_sheet(pixels, style, walls.frame, raster, title=title)
    return _with_histogram(map_sheet, walls, canvas.text_size_of(pixels.shape))


def _codes_of(walls: ScoredWalls) -> Bytes:
    known, true_known = walls.estimate != 0, walls.truth != 0
    codes = np.zeros(walls.frame.shape, dtype=np.uint8)
    codes[known & ~true_known] = KNOWN_BY_MAP
    codes[true_known] = FREE
    codes[true_known & ~known] = UNCOVERED
    codes[walls.truth == 2] = np.where(walls.missed > _NEAR * (1 + _ROUNDING), MISSED, FOUND)
    codes[walls.estimate == 2] = _index_of(walls.distances, walls.top)
    return codes


def _index_of(metres: Floats, top: float) -> Bytes:
    steps = np.minimum(metres / top, 1.0) * (_LEVELS - 1)
    return np.asarray(np.rint(steps).astype(np.uint8) + np.uint8(_FIRST_LEVEL))


def bins_of(metres: Floats, resolution: float, top: float) -> list[tuple[float, float]]:
    # The last bin has all distances above `top`; its middle is infinite.
    count = math.floor(top / resolution + _ROUNDING) + 1
    places = np.minimum(np.floor(metres / resolution + 0.5), count).astype(np.int64)
    shares = np.bincount(places, minlength=count + 1) / max(1, len(metres))
    middles = [round(k * resolution, 9) for k in range(count)]
    return list(zip([*middles, math.inf], shares.tolist(), strict=True))


def _with_histogram(above: canvas.Image, walls: ScoredWalls, size: int) -> canvas.Image:
    height, width = above.indices.shape
    pen = canvas.Pen(size)
    bins = bins_of(walls.distances, walls.frame.resolution, walls.top)
    left_x = canvas.text_width("100 %", size) + 2 * size
    sheet_width = max(width, left_x + 34 * size)
    plot_height = 12 * size
    bottom = height + 4 * size + plot_height
    pen.open(sheet_width, bottom + 4 * size)
    pen.sheet[:height, :width] = above.indices
    bar_width = max(2, min(4 * size, (sheet_width - left_x - 3 * size) // len(bins)))
    end = left_x + bar_width * len(bins)
    pen.label(size, height + int(0.8 * size), _summary(walls))
    largest_share = max(share for _, share in bins)
    end_of_scale = max(0.1, math.ceil(10 * largest_share - _ROUNDING) / 10)
    step = 0.2 if end_of_scale > 0.4 else 0.1
    for k in range(math.floor(end_of_scale / step + _ROUNDING) + 1):
        y = bottom - round(plot_height * k * step / end_of_scale)
        label = f"{100 * k * step:.0f} %"
        pen.label(left_x - size - canvas.text_width(label, size), y, label)
        row = pen.sheet[y, left_x:end]
        row[row == canvas.WHITE] = canvas.WHITE - 2
    for k, (middle, share) in enumerate(bins):
        x, y = left_x + k * bar_width, bottom - round(plot_height * share / end_of_scale)
        pen.sheet[y:bottom, x + 1 : x + bar_width] = _index_of(np.array([middle]), walls.top)
    _label_bars(pen, [middle for middle, _ in bins], left_x, bottom, bar_width)
    return canvas.Image(pen.sheet, above.palette)


def _label_bars(
    pen: canvas.Pen, middles: Sequence[float], left_x: int, bottom: int, bar_width: int
) -> None:
    """Draw the axis and as many of its labels as there is room for, with that of the end."""
    size = pen.size
    end = left_x + bar_width * len(middles)
    names = ["farther" if math.isinf(middle) else f"{middle:g}" for middle in middles]
    widths = [canvas.text_width(name, size) for name in names]
    bars_per_label = max(1, math.ceil((max(widths[:-1]) + size) / bar_width))
    last_free = end - (bar_width + widths[-1]) // 2 - size // 2
    for k, (name, width) in enumerate(zip(names, widths, strict=True)):
        x = max(left_x, left_x + k * bar_width + (bar_width - width) // 2)
        has_room = k % bars_per_label == 0 and x + width <= last_free
        if has_room or k == len(names) - 1:
            pen.label(x, bottom + int(0.9 * size), name)
    pen.sheet[bottom, left_x - size // 3 : end] = canvas.GREY
    pen.label(left_x, bottom + int(2.4 * size), "distance to the nearest true wall [m]")


def _summary(walls: ScoredWalls) -> str:
    if not len(walls.distances):
        return "The map has no walls here."
    if not np.isfinite(walls.distances[0]):
        return "The true map has no walls."
    mean, median = float(walls.distances.mean()), float(np.median(walls.distances))
    text = f"{len(walls.distances)} wall cells of the map: mean {mean:.3g} m, median {median:.3g} m"
    if len(walls.missed):
        near = float(np.mean(walls.missed <= _NEAR * (1 + _ROUNDING)))
        text += f"; {100 * near:.1f} % of the true walls have one within 0.1 m"
    return text
