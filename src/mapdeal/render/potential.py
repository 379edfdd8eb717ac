"""The picture of a potential field."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Region
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.values import UNKNOWN
from mapdeal.render.canvas import on_sheet
from mapdeal.render.overlay import Brush, Overlay
from mapdeal.render.pen import Image
from mapdeal.render.raster import DEFAULT_IMAGE_MAX, Raster
from mapdeal.render.shown import ImageExtent, shown_part
from mapdeal.render.styles import (
    POTENTIAL_ARROW,
    POTENTIAL_GOAL,
    POTENTIAL_LEVELS,
    POTENTIAL_NOWHERE,
    POTENTIAL_OBSTACLE,
    potential_style,
)

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
