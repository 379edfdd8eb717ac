"""The picture of each kind of layer: which colour each value takes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OCCUPIED, UNKNOWN
from mapdeal.kernels.blocks import blocks_of, looked_up
from mapdeal.kernels.lookup import histogram, look_up, set_where
from mapdeal.kernels.threads import for_rows
from mapdeal.render import colours
from mapdeal.render.canvas import (
    corner_of,
    frame_text,
    sheet,
    swatches_in,
)
from mapdeal.render.cost_palette import CostPalette
from mapdeal.render.overlay import Overlay
from mapdeal.render.pen import Image
from mapdeal.render.raster import DEFAULT_IMAGE_MAX, Raster, inner_outline
from mapdeal.render.style import ColourBar, Swatch
from mapdeal.render.styles import bounds_circumscribed, cost_style, occupancy_style, round_values

_FREE_LEVELS, _OBSTACLE_LEVELS = 70, 49
_FIELD_LEVELS = _FREE_LEVELS + _OBSTACLE_LEVELS
_LINE = 2 * _FIELD_LEVELS
_NOWHERE = _LINE + 1
"""Of a field: the outline of obstacles, and cells without a distance."""


def occupancy_image(
    grid: OccupancyGrid,
    *,
    title: str,
    image_max: int = DEFAULT_IMAGE_MAX,
    overlay: Overlay | None = None,
) -> Image:
    """Return a map in the greys of RViz's scheme "map".

    Where cells share a pixel the most occupied one shows. An overlay is drawn over all.
    """
    raster = Raster.fitting(grid.shape, image_max)
    style = occupancy_style()
    values = raster.largest(grid.occupancy)
    pixels = look_up(values, cast("NDArray[np.uint8]", style.by_value))
    is_graded = histogram(values)[1:OCCUPIED].any()
    return _on_sheet(
        raster.enlarged(pixels),
        style.colours,
        grid.frame,
        raster,
        title=title,
        bar=style.bar if is_graded else None,
        swatches=swatches_in(pixels, style.swatches),
        overlay=overlay,
    )


def field_image(
    field: DistanceField,
    *,
    title: str,
    image_max: int = DEFAULT_IMAGE_MAX,
    overlay: Overlay | None = None,
) -> Image:
    """Return a distance field in a diverging scale, obstacles red, free space blue.

    The outermost obstacle cells, where the field of convention seed is 0, are drawn black.
    Unknown cells are faded, those without a distance grey. Where cells share a pixel the
    smallest distance shows. Each side of the scale ends at its largest distance of a known cell.
    An overlay is drawn over all.
    """
    raster = Raster.fitting(field.shape, image_max)
    ends = _Ends.of(field.cropped)
    pixels, faded_index = _field_pixels(field, raster, ends)

    known_side = np.vstack([
        colours.obstacle_side(_OBSTACLE_LEVELS)[::-1], colours.free_side(_FREE_LEVELS)
    ])  # fmt: skip
    faded = colours.mixed(known_side, colours.RVIZ_UNKNOWN, 0.6)
    swatches = swatches_in(pixels, [Swatch(_LINE, "obstacle edge")])
    bar = None
    if ends.are_finite:
        bar = _field_bar(ends)
    else:
        everywhere = "+inf: no obstacle" if ends.highest > 0 else "-inf: nothing free"
        index = int(pixels[pixels != _NOWHERE][0])
        swatches.append(Swatch(index, everywhere))
    if faded_index is not None and bar is not None:
        swatches.append(Swatch(faded_index, "unknown: faded"))
    special = [colours.LINE]
    if field.region is not None:
        special.append(colours.RVIZ_UNKNOWN)
        swatches += swatches_in(pixels, [Swatch(_NOWHERE, "no distance")])
    strength = "" if field.strength == 1.0 else f", strength {field.strength:g}"
    return _on_sheet(
        pixels,
        np.vstack([known_side, faded, special]),
        field.frame,
        raster,
        title=title,
        more=f"convention {field.convention}{strength}",
        bar=bar,
        swatches=swatches,
        overlay=overlay,
    )


def _field_pixels(
    field: DistanceField, raster: Raster, ends: _Ends
) -> tuple[NDArray[np.uint8], int | None]:
    """Return palette indices, and one that shows what unknown cells look like, if there are any.

    Levels inside, then outside of obstacles; the same again, faded, for unknown cells; then the
    outline of obstacles, and cells without a distance.
    """
    obstacles = raster.largest(field.obstacles())
    indices, faded_index = _field_levels(field, raster, ends, obstacles)
    pixels = raster.enlarged(indices)
    set_where(pixels, inner_outline(raster.enlarged(obstacles)), _LINE)
    return pixels, faded_index


def _field_levels(
    field: DistanceField, raster: Raster, ends: _Ends, obstacles: NDArray[np.bool_]
) -> tuple[NDArray[np.uint8], int | None]:
    distance = raster.smallest(field.distance)
    is_unknown = np.zeros(256, dtype=np.bool_)
    is_unknown[UNKNOWN] = True
    unknown = raster.smallest(looked_up(field.occupancy, is_unknown))
    nowhere = np.isnan(distance) if field.region is not None else None
    if nowhere is not None:
        distance = np.where(nowhere, np.float32(0), distance)
        unknown &= ~nowhere
    levels = np.empty(distance.shape, dtype=np.uint8)

    def level(rows: slice) -> None:
        part = _OBSTACLE_LEVELS + _level(distance[rows], ends.far, _FREE_LEVELS)
        inside = _OBSTACLE_LEVELS - 1 - _level(-distance[rows], ends.deep, _OBSTACLE_LEVELS)
        np.copyto(part, inside, where=obstacles[rows])
        levels[rows] = part + _FIELD_LEVELS * unknown[rows].view(np.uint8)

    for_rows(level, levels.shape)
    if nowhere is not None:
        levels[nowhere] = _NOWHERE
    if not unknown.any():
        return levels, None
    outside = bool((unknown > obstacles).any())
    return levels, _FIELD_LEVELS + outside * _OBSTACLE_LEVELS + _OBSTACLE_LEVELS // 2


def cost_image(
    costmap: Costmap,
    *,
    title: str,
    image_max: int = DEFAULT_IMAGE_MAX,
    overlay: Overlay | None = None,
) -> Image:
    """Return a costmap in an even scale; lethal, inscribed, unknown and free stand apart.

    Where cells share a pixel the highest cost shows. If the circumscribed cost is known, a
    line bounds the cells of that cost and more. An overlay is drawn over all.
    """
    raster = Raster.fitting(costmap.shape, image_max)
    style = cost_style(costmap)
    # One more than the cost, so that unknown cells are the lowest: 255 + 1 is 0.
    one_more = (np.arange(256) + 1).astype(np.uint8)
    ranks = raster.largest(looked_up(costmap.cost, one_more))
    pixels = look_up(ranks, np.roll(cast("NDArray[np.uint8]", style.by_value), 1))
    pixels = raster.enlarged(pixels)
    if bounds_circumscribed(costmap):
        above = raster.enlarged(ranks > costmap.circumscribed_cost)
        line = inner_outline(above)
        line |= inner_outline(above & ~line)
        pixels[line] = CostPalette.contour
    return _on_sheet(
        pixels,
        style.colours,
        costmap.frame,
        raster,
        title=title,
        bar=style.bar,
        swatches=swatches_in(pixels, style.swatches),
        overlay=overlay,
    )


def _on_sheet(
    pixels: NDArray[np.uint8],
    palette: NDArray[np.integer],
    frame: Frame,
    raster: Raster,
    *,
    title: str,
    more: str | None = None,
    bar: ColourBar | None,
    swatches: list[Swatch],
    overlay: Overlay | None,
) -> Image:
    texts = [frame_text(frame), *([more] if more else [])]
    if overlay is not None:
        pixels = np.array(pixels)  # they may be the layer itself
        swatches = swatches + overlay.draw(pixels, frame, raster, len(palette))
        palette = np.vstack([palette, overlay.colours])
        texts.append(overlay.text)
    return sheet(
        pixels,
        palette.astype(np.uint8),
        title=title,
        subtitle="; ".join(texts),
        metres_per_pixel=raster.metres_per_pixel(frame.resolution),
        corner_xy=corner_of(frame),
        bar=bar,
        swatches=swatches,
    )


def _level(distance: NDArray[np.float32], end: float, levels: int) -> NDArray[np.uint8]:
    """Return the level 0 .. levels - 1 of distances 0 .. `end`; others take the nearest."""
    share = np.clip(distance * np.float32(1 / max(end, 1e-9)), 0, 1)
    level: NDArray[np.uint8] = np.minimum(share * np.float32(levels), levels - 1).astype(np.uint8)
    return level


@dataclass(frozen=True)
class _Ends:
    """How far a field goes: over known cells, 0 for none, and over all."""

    far: float
    deep: float
    highest: float
    lowest: float

    @property
    def are_finite(self) -> bool:
        return math.isfinite(self.highest) and math.isfinite(self.lowest)

    @classmethod
    def of(cls, field: DistanceField) -> _Ends:
        """Return the ends of a field; where nothing is known, its unknown cells count."""
        known: list[tuple[float, float]] = []
        every: list[tuple[float, float]] = []

        def look(rows: slice) -> None:
            distance, occupancy = distances[rows], occupancies[rows]
            every.append((float(distance.max()), float(distance.min())))
            is_known = occupancy != UNKNOWN
            if is_known.any():
                finite = np.where(is_known & np.isfinite(distance), distance, np.float32(0))
                known.append((float(finite.max()), float(finite.min())))

        for block in blocks_of(field.distance):
            distances, occupancies = field.distance[block], field.occupancy[block]
            for_rows(look, distances.shape)
        highest, lowest = max(end[0] for end in every), min(end[1] for end in every)
        if known:
            return cls(max(e[0] for e in known), -min(e[1] for e in known), highest, lowest)
        finite = [end if math.isfinite(end) else 0.0 for end in (highest, lowest)]
        return cls(max(finite[0], 0.0), -min(finite[1], 0.0), highest, lowest)


def _field_bar(ends: _Ends) -> ColourBar:
    """Return the scale of a field: red below zero, blue above, each linear in itself."""
    far, deep = ends.far, ends.deep
    middle = 0.0 if deep == 0 else 1.0 if far == 0 else 0.3
    steps = 200
    positions = np.linspace(0, 1, steps)
    last = _FIELD_LEVELS - 1
    below = _OBSTACLE_LEVELS * positions / max(middle, 1e-9)
    above = _OBSTACLE_LEVELS + _FREE_LEVELS * (positions - middle) / max(1 - middle, 1e-9)
    indices = np.where(positions < middle, below, np.minimum(above, last)).astype(int)
    ticks = [(middle, "0")]
    if deep > 0:
        sign = "<-" if ends.lowest < -deep else "-"
        ticks += [(middle * (1 - v / deep), f"-{v:g}") for v in round_values(deep, 2)]
        ticks.append((0.0, f"{sign}{deep:.3g}"))
    if far > 0:
        sign = ">" if ends.highest > far else ""
        ticks += [(middle + (1 - middle) * v / far, f"{v:g}") for v in round_values(far, 5)]
        ticks.append((1.0, f"{sign}{far:.3g}"))
    return ColourBar(indices.tolist(), ticks, "distance, m")
