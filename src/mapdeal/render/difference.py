"""Pictures of two maps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OCCUPIED
from mapdeal.render import colours
from mapdeal.render.canvas import on_sheet, swatches_in
from mapdeal.render.colours import palette_of
from mapdeal.render.pen import Image
from mapdeal.render.raster import DEFAULT_IMAGE_MAX, Raster
from mapdeal.render.shown import ImageExtent, shown_part
from mapdeal.render.style import LayerStyle, Swatch
from mapdeal.render.styles import difference_style, occupancy_style

_UNKNOWN = 1
"""What cells are up to which neither map knows anything."""

_SMALL_SIDE = 1200
"""Pixels to which maps that differ by single cells are enlarged."""


def difference_image(
    changes: NDArray[np.uint8],
    frame: Frame,
    *,
    title: str,
    image_max: int = DEFAULT_IMAGE_MAX,
    image_extent: ImageExtent = "all",
    only_in: tuple[str, str] | None = None,
    style: LayerStyle | None = None,
) -> Image:
    is_fine = only_in is not None or style is not None
    more = {"small_side": _SMALL_SIDE} if is_fine else {}
    part = shown_part(changes, frame, image_extent, is_known=lambda kinds: kinds > _UNKNOWN)
    raster = Raster.fitting(frame.shape, image_max, part=part, **more)
    pixels = raster.largest(changes)
    style = style or difference_style(only_in)
    return on_sheet(
        raster.enlarged(pixels),
        style.colours,
        frame,
        raster,
        title=title,
        swatches=swatches_in(pixels, style.swatches),
    )


_NOT_KNOWN, _FREE, _OCCUPIED, _NO_CONFLICT = 0, 1, 101, 101
"""Each value of the map has the index above it, so that the largest shows; conflicts follow."""

_PAIR = 2


_ALIKE = 3
"""Of conflicts: the kind that has a colour of its own where there are more maps than two."""


def merge_image(
    grid: OccupancyGrid,
    conflicts: NDArray[np.uint8],
    *,
    names: Sequence[str],
    title: str | None = None,
    image_max: int = DEFAULT_IMAGE_MAX,
    image_extent: ImageExtent = "known",
) -> Image:
    kinds = grid.occupancy.view(np.uint8) + np.uint8(1)  # of unknown, which is 255, it is 0
    if len(names) > _PAIR:
        legend = {_NO_CONFLICT + _ALIKE: "occupied in one map, free in another"}
        kinds[conflicts > 0] = _NO_CONFLICT + _ALIKE
    else:
        first, second = names
        legend = {
            _NO_CONFLICT + 1: f"occupied in {first}, free in {second}",
            _NO_CONFLICT + 2: f"free in {first}, occupied in {second}",
        }
        np.add(conflicts, _NO_CONFLICT, out=kinds, where=conflicts > 0)
    legend |= {_OCCUPIED: "occupied", _FREE: "free", _NOT_KNOWN: "unknown"}
    frame = grid.frame
    part = shown_part(kinds, frame, image_extent, is_known=lambda values: values > _NOT_KNOWN)
    raster = Raster.fitting(frame.shape, image_max, part=part, small_side=_SMALL_SIDE)
    pixels = raster.largest(kinds)
    return on_sheet(
        raster.enlarged(pixels),
        _palette(),
        frame,
        raster,
        title=title or f"{', '.join(names[:-1])} and {names[-1]}, merged",
        swatches=swatches_in(pixels, [Swatch(kind, text) for kind, text in legend.items()]),
    )


def _palette() -> colours.Colours:
    """Return the colours of a map, unknown first, and those of its conflicts."""
    of_values = occupancy_style().colours
    of_conflicts = [colours.REMOVED, colours.ADDED, colours.REMOVED]
    return palette_of(of_values[OCCUPIED + 1 :], of_values[: OCCUPIED + 1], of_conflicts)
