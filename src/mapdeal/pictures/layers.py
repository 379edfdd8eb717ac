"""The picture of each kind of layer: which colour each value takes."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, TypedDict, Unpack, cast

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.frame import Region
from mapdeal.grid.framed import Framed
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.values import OCCUPIED, UNKNOWN
from mapdeal.kernels.blocks import Layer, looked_up, swept
from mapdeal.kernels.lookup import histogram, level_rows, look_up, set_where
from mapdeal.pictures.canvas import Image, on_sheet, swatches_in
from mapdeal.pictures.colours import LayerStyle, Scale, Swatch
from mapdeal.pictures.overlay import Brush, ImageExtent, OtherThan, Overlay, shown_part
from mapdeal.pictures.raster import DEFAULT_IMAGE_MAX, Raster, inner_outline
from mapdeal.pictures.styles import (
    FIELD_LEVELS,
    LINE,
    NOWHERE,
    POTENTIAL_ARROW,
    POTENTIAL_GOAL,
    POTENTIAL_LEVELS,
    POTENTIAL_NOWHERE,
    POTENTIAL_OBSTACLE,
    CostPalette,
    EndsByRows,
    FieldEnds,
    bounds_circumscribed,
    cost_style,
    faded_index,
    field_style,
    occupancy_style,
    potential_style,
    steps_below_zero,
)


class Look(TypedDict, total=False):
    """How a picture shows a grid, whatever there is in it."""

    image_max: int
    image_extent: ImageExtent
    overlay: Overlay | None


class Drawing(ABC):
    """The picture of a grid in the making: first its rows are looked at, then it is drawn."""

    def __init__(
        self,
        grid: Any,
        *,
        image_max: int = DEFAULT_IMAGE_MAX,
        image_extent: ImageExtent = "all",
        overlay: Overlay | None = None,
    ) -> None:
        layer, unknown = self._told_unknown(grid)
        part = shown_part(
            layer, grid.frame, image_extent, is_known=OtherThan(unknown), overlay=overlay
        )
        self._grid, self._overlay = grid, overlay
        self._raster = Raster.fitting(grid.shape, image_max, part=part)
        self._begin()

    def _told_unknown(self, grid: Any) -> tuple[Layer, int]:
        """Return the layer that says what is known, and its value of unknown cells."""
        return grid.occupancy, UNKNOWN

    @abstractmethod
    def _begin(self) -> None:
        """Get ready to look at the rows."""

    @abstractmethod
    def take(self, rows: slice) -> None:
        """Look at some rows of the grid: those after the ones that were taken before."""

    @abstractmethod
    def image(self, title: str) -> Image:
        """Return the picture, once all rows were taken."""


class OccupancyDrawing(Drawing):
    """The picture of a map, see `occupancy_image`, which has the same parameters."""

    _grid: OccupancyGrid

    def _begin(self) -> None:
        self._values = self._raster.pooling(self._grid.occupancy, np.fmax)

    def take(self, rows: slice) -> None:
        self._values.take(rows)

    def image(self, title: str) -> Image:
        style, values = occupancy_style(), self._values.pixels
        pixels = look_up(values, cast("NDArray[np.uint8]", style.by_value))
        is_graded = histogram(values)[1:OCCUPIED].any()
        return on_sheet(
            self._raster.enlarged(pixels),
            style.colours,
            self._grid.frame,
            self._raster,
            title=title,
            bar=style.bar if is_graded else None,
            swatches=swatches_in(pixels, style.swatches),
            overlay=self._overlay,
        )


def occupancy_image(grid: OccupancyGrid, *, title: str, **look: Unpack[Look]) -> Image:
    """Return a map in the greys of RViz's scheme "map"."""
    # Where cells share a pixel the most occupied one shows.
    return _drawn(OccupancyDrawing(grid, **look), grid, title)


class FieldDrawing(Drawing):
    """The picture of a distance field, see `field_image`, which has the same parameters."""

    _grid: DistanceField

    def _begin(self) -> None:
        field, raster = self._grid, self._raster
        is_unknown = np.zeros(256, dtype=np.bool_)
        is_unknown[UNKNOWN] = True
        # around the box of numbers there is nothing to look at: the box is gone through alone
        self._ends = EndsByRows(field) if field.region is None else None
        self._obstacles = raster.pooling(field.obstacles(), np.fmax)
        self._distance = raster.pooling(field.distance, np.fmin)
        self._unknown = raster.pooling(looked_up(field.occupancy, is_unknown), np.fmin)

    def take(self, rows: slice) -> None:
        for one in (self._ends, self._obstacles, self._distance, self._unknown):
            if one is not None:
                one.take(rows)

    def image(self, title: str) -> Image:
        field, raster = self._grid, self._raster
        ends = FieldEnds.of(field) if self._ends is None else self._ends.found()
        style = field_style(field, ends)
        pixels, faded = self._pixels(cast("Scale", style.scale))
        strength = "" if field.strength == 1.0 else f", strength {field.strength:g}"
        return on_sheet(
            pixels,
            style.colours,
            field.frame,
            raster,
            title=title,
            more=f"convention {field.convention}{strength}",
            bar=style.bar,
            swatches=_field_swatches(style, pixels, faded),
            overlay=self._overlay,
        )

    def _pixels(self, scale: Scale) -> tuple[NDArray[np.uint8], int | None]:
        """Return palette indices, and one that shows what unknown cells look like, if any do."""
        # Levels inside, then outside of obstacles; the same again, faded, for unknown cells; then
        # the outline of obstacles, and cells without a distance.
        obstacles = self._obstacles.pixels
        indices, faded = self._levels(scale, obstacles)
        pixels = self._raster.enlarged(indices)
        set_where(pixels, inner_outline(self._raster.enlarged(obstacles)), LINE)
        return pixels, faded

    def _levels(
        self, scale: Scale, obstacles: NDArray[np.bool_]
    ) -> tuple[NDArray[np.uint8], int | None]:
        distance, unknown = self._distance.pixels, self._unknown.pixels
        nowhere = np.isnan(distance) if self._grid.region is not None else None
        if nowhere is not None:
            distance = np.where(nowhere, np.float32(0), distance)
            unknown = unknown & ~nowhere
        below = steps_below_zero(scale)
        # Whatever rounding says, and where obstacles have the distance 0: they are red.
        levels = level_rows(
            distance, obstacles, unknown, low=scale.low, factor=scale.factor, levels=scale.levels,
            first=scale.first, below=below, faded_by=FIELD_LEVELS,
        )  # fmt: skip
        if nowhere is not None:
            levels[nowhere] = NOWHERE
        if not unknown.any():
            return levels, None
        outside = bool((unknown > obstacles).any())
        return levels, faded_index(below, outside=outside)


def field_image(field: DistanceField, *, title: str, **look: Unpack[Look]) -> Image:
    """Return a distance field in a diverging scale, obstacles red, free space blue."""
    # The outermost obstacle cells, where a field of the Fast-Planner convention is 0, are black.
    # Unknown cells are faded, those without a distance grey. Where cells share a pixel the smallest
    # distance shows. The scale ends at the largest distances of known cells.
    return _drawn(FieldDrawing(field, **look), field, title)


def _field_swatches(
    style: LayerStyle, pixels: NDArray[np.uint8], faded: int | None
) -> list[Swatch]:
    """Return the legend entries of what a picture shows; `faded` shows what unknown cells do."""
    swatches = []
    for swatch in style.swatches:
        index: int | None = swatch.index
        if index in (LINE, NOWHERE):
            index = index if (pixels == index).any() else None
        elif FIELD_LEVELS <= swatch.index < LINE:
            index = faded
        elif style.bar is None:  # of a field that is the same everywhere, known or not
            index = int(pixels[pixels != NOWHERE][0])
        if index is not None:
            swatches.append(Swatch(index, swatch.label))
    return swatches


class CostDrawing(Drawing):
    """The picture of a costmap, see `cost_image`, which has the same parameters."""

    _grid: Costmap

    def _told_unknown(self, grid: Any) -> tuple[Layer, int]:
        return grid.cost, grid.unknown_value

    def _begin(self) -> None:
        # One more than the cost, so that unknown cells are the lowest: 255 + 1 is 0.
        one_more = (np.arange(256) + 1).astype(np.uint8)
        self._ranks = self._raster.pooling(looked_up(self._grid.cost, one_more), np.fmax)

    def take(self, rows: slice) -> None:
        self._ranks.take(rows)

    def image(self, title: str) -> Image:
        costmap, raster, ranks = self._grid, self._raster, self._ranks.pixels
        style = cost_style(costmap)
        pixels = look_up(ranks, np.roll(cast("NDArray[np.uint8]", style.by_value), 1))
        pixels = raster.enlarged(pixels)
        if bounds_circumscribed(costmap):
            above = raster.enlarged(ranks > costmap.circumscribed_cost)
            line = inner_outline(above)
            line |= inner_outline(above & ~line)
            pixels[line] = CostPalette.contour
        return on_sheet(
            pixels,
            style.colours,
            costmap.frame,
            raster,
            title=title,
            bar=style.bar,
            swatches=swatches_in(pixels, style.swatches),
            overlay=self._overlay,
        )


def cost_image(costmap: Costmap, *, title: str, **look: Unpack[Look]) -> Image:
    """Return a costmap in an even scale; lethal, inscribed, unknown and free stand apart."""
    # Where cells share a pixel the highest cost shows. If the circumscribed cost is known, a line
    # bounds the cells of that cost and more.
    return _drawn(CostDrawing(costmap, **look), costmap, title)


def _drawn(drawing: Drawing, grid: Framed, title: str) -> Image:
    """Return the picture of a grid whose rows nothing else goes through."""
    for rows in swept(grid.layer):
        drawing.take(rows)
    return drawing.image(title)


_ARROW_SPACING = 34.0
"""Pixels."""


def potential_image(
    field: PotentialField,
    *,
    title: str,
    image_max: int = DEFAULT_IMAGE_MAX,
    image_extent: ImageExtent = "all",
    overlay: Overlay | None = None,
) -> Image:
    """Return the normalised potential in an even scale, with arrows that point downhill."""
    # Obstacles are black, unknown cells faded, those without a potential grey. Where cells share a
    # pixel the highest potential shows, and an obstacle before all. The arrows stand on a coarse
    # lattice and show the direction only.
    part = shown_part(
        field.occupancy,
        field.frame,
        image_extent,
        overlay=overlay,
        places_xy=() if field.goal is None else field.goal,
    )
    raster = Raster.fitting(field.shape, image_max, part=part)
    frame = raster.frame_of(field.frame)
    style = potential_style(field)
    obstacles = raster.largest(field.obstacles())
    normalised = raster.largest(field.normalised)
    nowhere = np.isnan(normalised)
    levels = np.minimum(
        np.where(nowhere, 0, normalised) / 10 * POTENTIAL_LEVELS, POTENTIAL_LEVELS - 1
    ).astype(np.uint8)
    unknown = raster.smallest(field.occupancy == UNKNOWN) & ~nowhere
    levels[unknown] += POTENTIAL_LEVELS
    levels[obstacles] = POTENTIAL_OBSTACLE
    levels[nowhere] = POTENTIAL_NOWHERE
    pixels = raster.enlarged(levels).copy()
    scale = raster.enlarge / raster.reduce  # pixels per cell
    brush = Brush(pixels)
    arrows = _draw_arrows(brush, field, part, scale, max(pixels.shape))
    has_goal = False
    if field.goal is not None and frame.contains([field.goal])[0]:
        has_goal = True
        place = frame.continuous_rowcol_from_xy([field.goal])[0, ::-1] * scale
        brush.dot(place, POTENTIAL_GOAL, radius=max(6.0, max(pixels.shape) / 80))
    occurs = {
        POTENTIAL_OBSTACLE: obstacles.any(),
        POTENTIAL_ARROW: arrows,
        POTENTIAL_GOAL: has_goal,
        POTENTIAL_NOWHERE: nowhere.any(),
    }
    swatches = [swatch for swatch in style.swatches if occurs.get(swatch.index, unknown.any())]
    return on_sheet(
        pixels,
        style.colours,
        field.frame,
        raster,
        title=title,
        more=_range_text(field),
        bar=style.bar,
        swatches=swatches,
        overlay=overlay,
    )


def _range_text(field: PotentialField) -> str:
    potential = field.cropped.potential
    low, high = float(potential.min()), float(potential.max())
    if field.goal is None:
        return f"repulsion {low:.4g} .. {high:.4g}"
    return (
        f"potential {low:.4g} .. {high:.4g}, gains {field.attractive_gain:g} and "
        f"{field.repulsive_gain:g}"
    )


def _draw_arrows(
    brush: Brush, field: PotentialField, part: Region | None, scale: float, side: int
) -> int:
    """Draw arrows on a lattice of free cells; return how many there are."""
    spacing = max(_ARROW_SPACING, side / 36)
    step = max(1, math.ceil(spacing / scale))
    row, col, *size = part or (0, 0, *field.shape)
    rows, cols = (
        first + np.arange(step // 2, length, step)
        for first, length in zip((row, col), size, strict=True)
    )
    directions = _along_columns_and_rows(field)[:, rows[:, np.newaxis], cols]
    drawn = directions.any(axis=0) & ~field.obstacles()[rows[:, np.newaxis], cols]
    i, j = np.nonzero(drawn)
    centres = (np.stack([cols[j] - col, rows[i] - row], axis=1) + 0.5) * np.float64(scale)
    length = 0.55 * step * scale
    thickness = max(1, round(length / 18))
    brush.arrows(
        centres, directions[:, i, j].T, POTENTIAL_ARROW, length=length, thickness=thickness
    )
    return len(centres)


def _along_columns_and_rows(field: PotentialField) -> NDArray[np.float64]:
    """Return the directions downhill on the picture, whose axes are the grid's own."""
    x, y = field.downhill()
    yaw = field.origin[2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.stack([x * cos + y * sin, y * cos - x * sin])
