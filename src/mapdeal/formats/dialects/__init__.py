"""Conversion of pixels to occupancy by the three map_server readers in use, one module each.

Every rule depends on a small integer only, a grey level or a sum of samples, and each module works
it out in exactly the precision of its reader: in a table where there are few of them.

References
----------
Read off and checked against the readers of ROS 1 (``map_server/image_loader.cpp``), of Nav2
humble and of Nav2 jazzy and later (``nav2_map_server/map_io.cpp`` with GraphicsMagick).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.dialects import humble, nav2, ros1
from mapdeal.formats.map_yaml import Dialect, MapMetadata
from mapdeal.formats.picture import Picture, by_sample, opaque_greys

Reader = Callable[[Picture, MapMetadata], NDArray[np.int8]]

_PIXELS_TOGETHER = 1 << 17

DIALECTS: dict[Dialect, Reader] = {
    "nav2": nav2.occupancy_of,
    "humble": humble.occupancy_of,
    "ros1": ros1.occupancy_of,
}


def cells_of(
    picture: Picture, metadata: MapMetadata, dialect: Dialect, *,
    out: NDArray[np.int8] | None = None,
) -> NDArray[np.int8]:  # fmt: skip
    """Return the occupancy of each cell as a reader has it, shape (H, W), row 0 in the south."""
    picture = picture.from_the_south()
    if _is_plain(picture):
        values = DIALECTS[dialect](picture, metadata)
        if out is None:
            return np.ascontiguousarray(values)
        out[:] = values
        return out
    # colours and opacities become wide numbers on the way: not those of all pixels at once
    cells = np.empty(picture.shape, dtype=np.int8) if out is None else out
    read = reader_of(picture, metadata, dialect)
    first = 0
    for band in picture.bands(_PIXELS_TOGETHER):
        stop = first + band.shape[0]
        cells[first:stop] = read(band)
        first = stop
    return cells


def reader_of(
    kind: Picture, metadata: MapMetadata, dialect: Dialect
) -> Callable[[Picture], NDArray[np.int8]]:
    """Return a reader's way to read pictures of one kind, such as strips of a picture."""
    # Images of maps with colours and opacities have few of them: what is grey and opaque is looked
    # up in a table that the reader has made.
    read = DIALECTS[dialect]
    if kind.samples.ndim == 2 and kind.alpha is None:
        return lambda picture: read(picture, metadata)
    by_grey = read(opaque_greys(kind), metadata)[0]

    def occupancy(picture: Picture) -> NDArray[np.int8]:
        grey, others = picture.greys_and_others()
        values: NDArray[np.int8] = by_sample(by_grey, np.ascontiguousarray(grey))
        if others.any():
            values[others] = read(picture.only(others), metadata)[0]
        return values

    return occupancy


def _is_plain(picture: Picture) -> bool:
    """Return whether pixels are bytes that all readers look up in a table."""
    is_byte = picture.samples.dtype == np.uint8 and picture.samples.ndim == 2
    is_opaque = picture.alpha is None and (
        picture.palette is None or bool((picture.palette[:, 3] == 255).all())
    )
    return is_byte and is_opaque and picture.file_format == "PNM"
