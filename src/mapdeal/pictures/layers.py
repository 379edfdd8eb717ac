"""Pictures of all kinds of layers, and of the zones of costmap filters."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any, cast

import numpy as np

from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField, PotentialField
from mapdeal.grid.filters import FilterInfo
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN
from mapdeal.kernels.arrays import Bytes, Floats, Mask
from mapdeal.kernels.blocks import Layer, looked_up, swept
from mapdeal.kernels.lookup import histogram, level_rows, look_up, set_where
from mapdeal.pictures import canvas, colours as palette, overlay as overlays, styles
from mapdeal.pictures.colours import LayerStyle, Scale, Swatch
from mapdeal.records import dataclass, replace


class Drawing(ABC):
    """A picture that is drawn in two steps: all rows of the grid are collected, then rendered."""

    def __init__(
        self, grid: Any, *, image_max: int = overlays.DEFAULT_IMAGE_MAX,
        image_extent: overlays.ImageExtent = "all", overlay: overlays.Overlay | None = None,
    ) -> None:  # fmt: skip
        layer, unknown = self._layer_and_unknown(grid)
        part = overlays.shown_part(
            layer, grid.frame, image_extent, unknown=unknown, overlay=overlay
        )
        self._grid, self._overlay = grid, overlay
        self._raster = overlays.Raster.fitting(grid.shape, image_max, part=part)
        self._collectors: list[overlays.Pooling | styles.EndsByRows] = []
        self._begin()

    def _layer_and_unknown(self, grid: Any) -> tuple[Layer, int]:
        return grid.occupancy, UNKNOWN

    @abstractmethod
    def _begin(self) -> None: ...

    def _pooling(self, layer: Layer, choose: np.ufunc) -> overlays.Pooling:
        pooling = overlays.Pooling(self._raster, layer, choose)
        self._collectors.append(pooling)
        return pooling

    def take(self, rows: slice) -> None:
        for collector in self._collectors:
            collector.take(rows)

    @abstractmethod
    def image(self, title: str) -> canvas.Image:
        """Return the picture, after all rows were collected."""

    @classmethod
    def draw(cls, grid: Any, *, title: str, **look: Any) -> canvas.Image:
        drawing = cls(grid, **look)
        for rows in swept(grid.layer):
            drawing.take(rows)
        return drawing.image(title)

    def _on_sheet(self, pixels: Bytes, style: LayerStyle, **texts: Any) -> canvas.Image:
        frame, overlay = self._grid.frame, self._overlay
        return canvas.on_sheet(pixels, style, frame, self._raster, overlay=overlay, **texts)


class OccupancyDrawing(Drawing):
    _grid: OccupancyGrid

    def _begin(self) -> None:
        self._values = self._pooling(self._grid.occupancy, np.fmax)

    def image(self, title: str) -> canvas.Image:
        style, values = styles.occupancy_style(), self._values.pixels
        pixels = look_up(values, cast("Bytes", style.by_value))
        if not histogram(values)[1:OCCUPIED].any():  # black and white need no scale
            style = replace(style, bar=None)
        return self._on_sheet(self._raster.enlarged(pixels), style, title=title)


occupancy_image = OccupancyDrawing.draw  # of several cells in a pixel the most occupied one shows


class FieldDrawing(Drawing):
    _grid: DistanceField

    def _begin(self) -> None:
        field, is_unknown = self._grid, np.arange(256) == UNKNOWN % 256
        # of a field with a box, only the box is scanned
        self._ends = styles.EndsByRows(field) if field.region is None else None
        self._collectors += [] if self._ends is None else [self._ends]
        self._obstacles = self._pooling(field.obstacles(), np.fmax)
        self._distance = self._pooling(field.distance, np.fmin)
        self._unknown = self._pooling(looked_up(field.occupancy, is_unknown), np.fmin)

    def image(self, title: str) -> canvas.Image:
        field = self._grid
        ends = styles.FieldEnds.of(field) if self._ends is None else self._ends.found()
        style = styles.field_style(field, ends)
        pixels, faded = self._pixels(cast("Scale", style.scale))
        more = f"convention {field.convention}"
        more += "" if field.strength == 1.0 else f", strength {field.strength:g}"
        swatches = _field_swatches(style, pixels, faded)
        return self._on_sheet(pixels, style, title=title, more=more, swatches=swatches)

    def _pixels(self, scale: Scale) -> tuple[Bytes, int | None]:
        # Palette: inside obstacles, outside, both faded for unknown cells, outlines, no distance.
        obstacles, unknown = self._obstacles.pixels, self._unknown.pixels
        distance = self._distance.pixels
        nowhere = np.isnan(distance) if self._grid.region is not None else None
        if nowhere is not None:
            distance, unknown = np.where(nowhere, np.float32(0), distance), unknown & ~nowhere
        below = round(-scale.low / (scale.high - scale.low) * scale.levels)  # steps below zero
        # Obstacles are red even if rounding or a distance of 0 would put them outside.
        levels = level_rows(
            distance, obstacles, unknown, low=scale.low, factor=scale.factor, levels=scale.levels,
            first=scale.first, below=below, faded_by=styles.FIELD_LEVELS,
        )  # fmt: skip
        if nowhere is not None:
            levels[nowhere] = styles.NOWHERE
        pixels = self._raster.enlarged(levels)
        set_where(pixels, overlays.inner_outline(self._raster.enlarged(obstacles)), styles.LINE)
        outside = bool((unknown > obstacles).any())
        return pixels, styles.faded_index(below, outside=outside) if unknown.any() else None


field_image = FieldDrawing.draw  # of several cells in a pixel the smallest distance shows


def _field_swatches(style: LayerStyle, pixels: Bytes, faded: int | None) -> list[Swatch]:
    swatches = []
    for swatch in style.swatches:
        index: int | None = swatch.index
        if index in (styles.LINE, styles.NOWHERE):
            index = index if (pixels == index).any() else None
        elif styles.FIELD_LEVELS <= swatch.index < styles.LINE:
            index = faded
        elif style.bar is None:  # a uniform field
            index = int(pixels[pixels != styles.NOWHERE][0])
        if index is not None:
            swatches.append(Swatch(index, swatch.label))
    return swatches


class CostDrawing(Drawing):
    _grid: Costmap

    def _layer_and_unknown(self, grid: Any) -> tuple[Layer, int]:
        return grid.cost, grid.unknown_value

    def _begin(self) -> None:
        # Adding 1 wraps 255 (unknown) to 0, so unknown never wins.
        shifted = (np.arange(256) + 1).astype(np.uint8)
        self._ranks = self._pooling(looked_up(self._grid.cost, shifted), np.fmax)

    def image(self, title: str) -> canvas.Image:
        costmap, raster, ranks = self._grid, self._raster, self._ranks.pixels
        style = styles.cost_style(costmap)
        pixels = look_up(ranks, np.roll(cast("Bytes", style.by_value), 1))
        pixels = raster.enlarged(pixels)
        if styles.bounds_circumscribed(costmap):
            above = raster.enlarged(ranks > costmap.circumscribed_cost)
            line = overlays.inner_outline(above)
            line |= overlays.inner_outline(above & ~line)
            pixels[line] = styles.CostPalette.contour
        return self._on_sheet(pixels, style, title=title)


cost_image = CostDrawing.draw  # of several cells in a pixel the highest cost shows
_ARROW_SPACING = 34.0  # pixels


def potential_image(
    field: PotentialField, *, title: str, image_max: int = overlays.DEFAULT_IMAGE_MAX,
    image_extent: overlays.ImageExtent = "all", overlay: overlays.Overlay | None = None,
) -> canvas.Image:  # fmt: skip
    # Of several cells in a pixel an obstacle shows, or else the highest potential.
    goal = () if field.goal is None else field.goal
    part = overlays.shown_part(
        field.occupancy, field.frame, image_extent, overlay=overlay, places_xy=goal
    )
    raster = overlays.Raster.fitting(field.shape, image_max, part=part)
    frame, style = raster.frame_of(field.frame), styles.potential_style(field)
    obstacles = raster.largest(field.obstacles())
    normalised = raster.largest(field.normalised)
    nowhere = np.isnan(normalised)
    steps = np.where(nowhere, 0, normalised) / 10 * styles.POTENTIAL_LEVELS
    levels = np.minimum(steps, styles.POTENTIAL_LEVELS - 1).astype(np.uint8)
    unknown = raster.smallest(field.occupancy == UNKNOWN) & ~nowhere
    levels[unknown] += styles.POTENTIAL_LEVELS
    levels[obstacles] = styles.POTENTIAL_OBSTACLE
    levels[nowhere] = styles.POTENTIAL_NOWHERE
    pixels = raster.enlarged(levels).copy()
    has_lines = field.cost_to_go is not None and _draw_isolines(pixels, field.cost_to_go, raster)
    on = overlays.Surface(pixels, frame, raster)
    has_arrows, has_goal = _draw_arrows(on, field), bool(goal) and frame.contains([goal])[0]
    if has_goal:
        place = on.places([goal])[0]
        overlays.Brush(pixels).dot(place, styles.POTENTIAL_GOAL, radius=max(6.0, on.side / 80))
    occurs = {
        styles.POTENTIAL_OBSTACLE: obstacles.any(),
        styles.POTENTIAL_ARROW: has_arrows,
        styles.POTENTIAL_GOAL: has_goal,
        styles.POTENTIAL_NOWHERE: nowhere.any(),
        styles.POTENTIAL_LINE: has_lines,
    }
    swatches = [swatch for swatch in style.swatches if occurs.get(swatch.index, unknown.any())]
    potential = field.cropped.potential
    more = f"{float(potential.min()):.4g} .. {float(potential.max()):.4g}"
    gains = f"gains {field.attractive_gain:g} and {field.repulsive_gain:g}"
    return canvas.on_sheet(
        pixels, style, field.frame, raster, title=title, swatches=swatches, overlay=overlay,
        more=f"potential {more}, {gains}" if goal else f"repulsion {more}",
    )  # fmt: skip


def _draw_isolines(pixels: Bytes, lengths: Floats, raster: overlays.Raster) -> bool:
    bands = np.floor(lengths / styles.length_between_lines(lengths))
    bands = raster.enlarged(raster.smallest(np.where(np.isfinite(bands), bands, -1)))
    lines = np.zeros(bands.shape, np.bool_)
    for nearer, farther in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        differs = bands[nearer] != bands[farther]
        lines[farther] |= differs & (np.minimum(bands[nearer], bands[farther]) >= 0)
    pixels[lines] = styles.POTENTIAL_LINE
    return bool(lines.any())


def _draw_arrows(on: overlays.Surface, field: PotentialField) -> bool:
    scale = on.raster.enlarge / on.raster.reduce  # pixels per cell
    step = max(1, math.ceil(max(_ARROW_SPACING, on.side / 36) / scale))
    row, col, *size = on.raster.part or (0, 0, *field.shape)
    rows = row + np.arange(step // 2, size[0], step)
    cols = col + np.arange(step // 2, size[1], step)
    # turned to columns and rows, the axes of the picture
    x, y = field.downhill()
    cos, sin = math.cos(field.origin[2]), math.sin(field.origin[2])
    directions = np.stack([x * cos + y * sin, y * cos - x * sin])[:, rows[:, np.newaxis], cols]
    i, j = np.nonzero(directions.any(axis=0) & ~field.obstacles()[rows[:, np.newaxis], cols])
    centres = (np.stack([cols[j] - col, rows[i] - row], axis=1) + 0.5) * np.float64(scale)
    length = 0.55 * step * scale
    thickness = max(1, round(length / 18))
    overlays.Brush(on.pixels).arrows(
        centres, directions[:, i, j].T, styles.POTENTIAL_ARROW, length=length, thickness=thickness
    )
    return bool(len(centres))


_BINARY = (140, 92, 200)
_SLOW_TO_FAST = [palette.CLOSED_PASSAGE, palette.TIGHT_PASSAGE, palette.CHANGED]
_MOST_LIMITS = 12  # colours of limits; further limits share them

_ColouredCells = tuple[Mask, palette.Colour, str]
"""The cells of a speed limit or of another filter, with their colour and label."""


@dataclass(frozen=True, eq=False)
class ZonesOverlay(overlays.Overlay):
    grid: OccupancyGrid
    masks: Sequence[tuple[OccupancyGrid, FilterInfo]]

    @cached_property
    def _coloured_cells(self) -> list[_ColouredCells]:
        return [zone for grid, info in self.masks for zone in _coloured_cells_in(grid, info)]

    @property
    def colours(self) -> list[palette.Colour]:
        colours: list[palette.Colour] = []
        for _, zone_colour, _ in self._coloured_cells:
            colour = np.array([zone_colour])
            free = palette.mixed(colour, (255, 255, 255), 0.55)
            unknown = palette.mixed(colour, palette.RVIZ_UNKNOWN, 0.6)
            colours += [tuple(map(int, each[0])) for each in (free, unknown, colour)]  # type: ignore[misc]
        return colours

    def draw(self, on: overlays.Surface, first_index: int) -> list[Swatch]:
        values = np.asarray(self.grid.occupancy)
        free = on.raster.enlarged(on.raster.largest(values) <= FREE)
        unknown = on.raster.enlarged(on.raster.largest(values) == UNKNOWN)
        swatches = []
        for number, (zone_cells, _, label) in enumerate(self._coloured_cells):
            index = first_index + 3 * number
            cells = on.raster.enlarged(on.raster.largest(zone_cells))
            on.pixels[cells & free] = index
            on.pixels[cells & unknown] = index + 1
            on.pixels[overlays.inner_outline(cells)] = index + 2
            swatches.append(Swatch(index, label))
        return swatches


def _coloured_cells_in(grid: OccupancyGrid, info: FilterInfo) -> Iterator[_ColouredCells]:
    values = np.asarray(grid.occupancy)
    if info.kind != "speed":
        colour = palette.KEEPOUT if info.kind == "keepout" else _BINARY
        yield values > FREE, colour, info.kind
        return
    found = np.flatnonzero(histogram(values)[FREE + 1 : OCCUPIED + 1]) + 1
    limits = sorted((info.limit_of(v) or 0.0, v) for v in found.tolist())
    scale = palette.interpolated(_SLOW_TO_FAST, min(max(len(limits), 2), _MOST_LIMITS))
    for number, (limit, value) in enumerate(limits):
        colour = scale[number * (len(scale) - 1) // max(len(limits) - 1, 1)].tolist()
        label = f"{limit:.4g} {info.sign}" if limit else "no limit"
        yield values == value, tuple(colour), label


def zones_image(
    grid: OccupancyGrid, masks: Sequence[tuple[OccupancyGrid, FilterInfo]], *, title: str,
    **look: Any,
) -> canvas.Image:  # fmt: skip
    return occupancy_image(grid, title=title, **look | {"overlay": ZonesOverlay(grid, masks)})
