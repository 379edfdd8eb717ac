"""The picture of a potential field."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.potential import PotentialField
from mapdeal.grid.values import UNKNOWN
from mapdeal.render import colours
from mapdeal.render.canvas import corner_of, frame_text, sheet
from mapdeal.render.overlay import Brush, Overlay
from mapdeal.render.pen import Image
from mapdeal.render.raster import DEFAULT_IMAGE_MAX, Raster
from mapdeal.render.style import ColourBar, Swatch

_LEVELS = 100
_OBSTACLE, _ARROW, _GOAL, _NOWHERE = range(2 * _LEVELS, 2 * _LEVELS + 4)
_ARROW_SPACING = 26.0
"""Pixels."""


def potential_image(
    field: PotentialField,
    *,
    title: str,
    image_max: int = DEFAULT_IMAGE_MAX,
    overlay: Overlay | None = None,
) -> Image:
    """Return the normalised potential in an even scale, with arrows that point downhill.

    Obstacles are black, unknown cells faded, those without a potential grey. Where cells share a
    pixel the highest potential shows, and an obstacle before all. The arrows stand on a coarse
    lattice and tell the direction alone. An overlay is drawn over all.
    """
    raster = Raster.fitting(field.shape, image_max)
    obstacles = raster.largest(field.obstacles())
    normalised = raster.largest(field.normalised)
    nowhere = np.isnan(normalised)
    levels = np.minimum(np.where(nowhere, 0, normalised) / 10 * _LEVELS, _LEVELS - 1)
    levels = levels.astype(np.uint8)
    unknown = raster.smallest(field.occupancy == UNKNOWN) & ~nowhere
    levels[unknown] += _LEVELS
    levels[obstacles] = _OBSTACLE
    levels[nowhere] = _NOWHERE
    pixels = raster.enlarged(levels).copy()
    scale = raster.enlarge / raster.reduce  # pixels per cell
    brush = Brush(pixels)
    arrows = _draw_arrows(brush, field, scale, max(pixels.shape))
    swatches = [Swatch(_OBSTACLE, "obstacle")] if obstacles.any() else []
    swatches += [Swatch(_LEVELS + _LEVELS // 4, "unknown: faded")] if unknown.any() else []
    swatches += [Swatch(_ARROW, "downhill")] if arrows else []
    if field.goal is not None and field.frame.contains([field.goal])[0]:
        place = field.frame.continuous_rowcol_from_xy([field.goal])[0, ::-1] * scale
        brush.dot(place, _GOAL, radius=max(6.0, max(pixels.shape) / 80))
        swatches.append(Swatch(_GOAL, "goal"))
    special = [colours.LETHAL, colours.ARROW, colours.GOAL]
    if nowhere.any():
        special.append(colours.RVIZ_UNKNOWN)
        swatches.append(Swatch(_NOWHERE, "no potential"))
    scale_colours = colours.potential_scale(_LEVELS)
    faded = colours.mixed(scale_colours, colours.RVIZ_UNKNOWN, 0.6)
    palette = np.vstack([scale_colours, faded, special])
    texts = [frame_text(field.frame), _range_text(field)]
    if overlay is not None:
        swatches = swatches + overlay.draw(pixels, field.frame, raster, len(palette))
        palette = np.vstack([palette, overlay.colours])
        texts.append(overlay.text)
    ticks = [(value / 10, f"{value}") for value in range(0, 11, 2)]
    return sheet(
        pixels,
        palette.astype(np.uint8),
        title=title,
        subtitle="; ".join(texts),
        metres_per_pixel=raster.metres_per_pixel(field.resolution),
        corner_xy=corner_of(field.frame),
        bar=ColourBar(range(_LEVELS), ticks, "normalised"),
        swatches=swatches,
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


def _draw_arrows(brush: Brush, field: PotentialField, scale: float, side: int) -> int:
    """Draw arrows on a lattice of free cells; return how many there are."""
    spacing = max(_ARROW_SPACING, side / 50)
    step = max(1, math.ceil(spacing / scale))
    rows, cols = (np.arange(step // 2, length, step) for length in field.shape)
    directions = _along_columns_and_rows(field)[:, rows[:, np.newaxis], cols]
    drawn = directions.any(axis=0) & ~field.obstacles()[rows[:, np.newaxis], cols]
    i, j = np.nonzero(drawn)
    centres = (np.stack([cols[j], rows[i]], axis=1) + 0.5) * np.float64(scale)
    length = 0.75 * step * scale
    thickness = max(1, round(length / 14))
    brush.arrows(centres, directions[:, i, j].T, _ARROW, length=length, thickness=thickness)
    return len(centres)


def _along_columns_and_rows(field: PotentialField) -> NDArray[np.float64]:
    """Return the directions downhill on the picture, whose axes are the grid's own."""
    x, y = field.downhill()
    yaw = field.origin[2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.stack([x * cos + y * sin, y * cos - x * sin])
