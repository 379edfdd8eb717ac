"""The picture of what differs between two maps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame
from mapdeal.render.canvas import corner_of, frame_text, sheet, swatches_in
from mapdeal.render.pen import Image
from mapdeal.render.raster import DEFAULT_IMAGE_MAX, Raster
from mapdeal.render.shown import ImageExtent, shown_part
from mapdeal.render.style import LayerStyle
from mapdeal.render.styles import difference_style

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
    """Return a picture of changes."""
    is_fine = only_in is not None or style is not None
    more = {"small_side": _SMALL_SIDE} if is_fine else {}
    part = shown_part(changes, frame, image_extent, is_known=lambda kinds: kinds > _UNKNOWN)
    raster = Raster.fitting(frame.shape, image_max, part=part, **more)
    pixels = raster.largest(changes)
    style = style or difference_style(only_in)
    return sheet(
        raster.enlarged(pixels),
        style.colours,
        title=title,
        subtitle=frame_text(frame, part),
        metres_per_pixel=raster.metres_per_pixel(frame.resolution),
        corner_xy=corner_of(raster.frame_of(frame)),
        swatches=swatches_in(pixels, style.swatches),
    )
