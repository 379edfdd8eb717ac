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
    """Return a picture of changes.

    Parameters
    ----------
    changes : numpy.ndarray of uint8, shape (H, W)
        What each cell is: 0 outside of one map, 1 unknown and 2 free in both, 3 free in one and
        unknown in the other, 4 a wall in both, 5 a wall that is gone, 6 a new one. Where cells
        share a pixel the largest shows.
    frame : Frame
        The cells.
    title : str
        What stands above.
    image_max : int
        Longest side in pixels; 0 for one pixel per cell.
    image_extent : {'known', 'all'}
        Whether the cells that are known in one of the maps are drawn, or all.
    only_in : tuple of str, optional
        What to call the maps, if the second is not a later state of the first but made of the
        same data: they differ by single cells, and the picture is larger.
    style : LayerStyle, optional
        What other kinds of cells are called, and their colours, of maps that differ by single
        cells as well.
    """
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
