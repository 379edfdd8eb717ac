"""The picture of each kind of layer: which colour each value takes."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OCCUPIED, UNKNOWN
from mapdeal.kernels.blocks import looked_up
from mapdeal.kernels.lookup import histogram, level_rows, look_up, set_where
from mapdeal.render.canvas import (
    corner_of,
    frame_text,
    sheet,
    swatches_in,
)
from mapdeal.render.cost_palette import CostPalette
from mapdeal.render.field_style import (
    FIELD_LEVELS,
    LINE,
    NOWHERE,
    FieldEnds,
    faded_index,
    field_style,
    steps_below_zero,
)
from mapdeal.render.overlay import Overlay
from mapdeal.render.pen import Image
from mapdeal.render.raster import DEFAULT_IMAGE_MAX, Raster, inner_outline
from mapdeal.render.shown import ImageExtent, shown_part
from mapdeal.render.style import ColourBar, LayerStyle, Scale, Swatch
from mapdeal.render.styles import bounds_circumscribed, cost_style, occupancy_style


def occupancy_image(
    grid: OccupancyGrid,
    *,
    title: str,
    image_max: int = DEFAULT_IMAGE_MAX,
    image_extent: ImageExtent = "all",
    overlay: Overlay | None = None,
) -> Image:
    """Return a map in the greys of RViz's scheme "map".

    Where cells share a pixel the most occupied one shows. An overlay is drawn over all.
    """
    part = shown_part(grid.occupancy, grid.frame, image_extent, overlay=overlay)
    raster = Raster.fitting(grid.shape, image_max, part=part)
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
    image_extent: ImageExtent = "all",
    overlay: Overlay | None = None,
) -> Image:
    """Return a distance field in a diverging scale, obstacles red, free space blue.

    The outermost obstacle cells, where the field of convention seed is 0, are drawn black.
    Unknown cells are faded, those without a distance grey. Where cells share a pixel the
    smallest distance shows. The scale ends at the largest distances of known cells.
    An overlay is drawn over all.
    """
    part = shown_part(field.occupancy, field.frame, image_extent, overlay=overlay)
    raster = Raster.fitting(field.shape, image_max, part=part)
    style = field_style(field, FieldEnds.of(field))
    pixels, faded = _field_pixels(field, raster, cast("Scale", style.scale))
    strength = "" if field.strength == 1.0 else f", strength {field.strength:g}"
    return _on_sheet(
        pixels,
        style.colours,
        field.frame,
        raster,
        title=title,
        more=f"convention {field.convention}{strength}",
        bar=style.bar,
        swatches=_field_swatches(style, pixels, faded),
        overlay=overlay,
    )


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


def _field_pixels(
    field: DistanceField, raster: Raster, scale: Scale
) -> tuple[NDArray[np.uint8], int | None]:
    """Return palette indices, and one that shows what unknown cells look like, if there are any.

    Levels inside, then outside of obstacles; the same again, faded, for unknown cells; then the
    outline of obstacles, and cells without a distance.
    """
    obstacles = raster.largest(field.obstacles())
    indices, faded = _field_levels(field, raster, scale, obstacles)
    pixels = raster.enlarged(indices)
    set_where(pixels, inner_outline(raster.enlarged(obstacles)), LINE)
    return pixels, faded


def _field_levels(
    field: DistanceField, raster: Raster, scale: Scale, obstacles: NDArray[np.bool_]
) -> tuple[NDArray[np.uint8], int | None]:
    distance = raster.smallest(field.distance)
    is_unknown = np.zeros(256, dtype=np.bool_)
    is_unknown[UNKNOWN] = True
    unknown = raster.smallest(looked_up(field.occupancy, is_unknown))
    nowhere = np.isnan(distance) if field.region is not None else None
    if nowhere is not None:
        distance = np.where(nowhere, np.float32(0), distance)
        unknown &= ~nowhere
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


def cost_image(
    costmap: Costmap,
    *,
    title: str,
    image_max: int = DEFAULT_IMAGE_MAX,
    image_extent: ImageExtent = "all",
    overlay: Overlay | None = None,
) -> Image:
    """Return a costmap in an even scale; lethal, inscribed, unknown and free stand apart.

    Where cells share a pixel the highest cost shows. If the circumscribed cost is known, a
    line bounds the cells of that cost and more. An overlay is drawn over all.
    """
    part = shown_part(
        costmap.cost,
        costmap.frame,
        image_extent,
        is_known=lambda cost: cost != costmap.unknown_value,
        overlay=overlay,
    )
    raster = Raster.fitting(costmap.shape, image_max, part=part)
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
    texts = [frame_text(frame, raster.part), *([more] if more else [])]
    shown = raster.frame_of(frame)
    if overlay is not None:
        if not pixels.flags.writeable:  # they are the layer itself
            pixels = np.array(pixels)
        swatches = swatches + overlay.draw(pixels, shown, raster, len(palette))
        palette = np.vstack([palette, overlay.colours])
        texts += [overlay.text] if overlay.text else []
    return sheet(
        pixels,
        palette.astype(np.uint8),
        title=title,
        subtitle="; ".join(texts),
        metres_per_pixel=raster.metres_per_pixel(frame.resolution),
        corner_xy=corner_of(shown),
        bar=bar,
        swatches=swatches,
    )
