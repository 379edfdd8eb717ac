"""How the three map_server readers in use turn pixels into occupancy, one module each.

Every rule depends on a small integer only, a grey level or a sum of samples; so each module
fills a table in exactly the precision of its reader, and indexes it.

References
----------
Read off and checked against the readers of ROS 1 (``map_server/image_loader.cpp``), of Nav2
humble and of Nav2 jazzy and later (``nav2_map_server/map_io.cpp`` with GraphicsMagick).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.dialects import humble, nav2, ros1
from mapdeal.formats.map_yaml import Dialect, MapMetadata
from mapdeal.formats.picture import Picture

Reader = Callable[[Picture, MapMetadata], NDArray[np.int8]]

_PIXELS_TOGETHER = 1 << 17

DIALECTS: dict[Dialect, Reader] = {
    "nav2": nav2.occupancy_of,
    "humble": humble.occupancy_of,
    "ros1": ros1.occupancy_of,
}


def cells_of(
    picture: Picture,
    metadata: MapMetadata,
    dialect: Dialect,
    *,
    out: NDArray[np.int8] | None = None,
) -> NDArray[np.int8]:
    """Return the occupancy of each cell as a reader has it, shape (H, W), row 0 in the south.

    Parameters
    ----------
    picture : Picture
        The pixels, row 0 in the north.
    metadata : MapMetadata
        What the YAML file says.
    dialect : {'nav2', 'humble', 'ros1'}
        Whose reading to follow.
    out : numpy.ndarray of int8, optional
        Where to put the result.
    """
    picture = picture.from_the_south()
    read = DIALECTS[dialect]
    if _is_plain(picture):
        values = read(picture, metadata)
        if out is None:
            return np.ascontiguousarray(values)
        out[:] = values
        return out
    # colours and opacities become wide numbers on the way: not those of all pixels at once
    height, width = picture.shape
    cells = np.empty((height, width), dtype=np.int8) if out is None else out
    step = max(1, _PIXELS_TOGETHER // width)
    for first in range(0, height, step):
        rows = slice(first, first + step)
        alpha = None if picture.alpha is None else picture.alpha[rows]
        part = replace(picture, samples=picture.samples[rows], alpha=alpha)
        cells[rows] = read(part, metadata)
    return cells


def _is_plain(picture: Picture) -> bool:
    """Return whether pixels are bytes that all readers look up in a table."""
    is_byte = picture.samples.dtype == np.uint8 and picture.samples.ndim == 2
    is_opaque = picture.alpha is None and (
        picture.palette is None or bool((picture.palette[:, 3] == 255).all())
    )
    return is_byte and is_opaque and picture.file_format == "PNM"
