"""TIFF images, read by Pillow."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mapdeal.formats.images.image_format import ImageFormat
from mapdeal.formats.images.pillow import load, open_image, picture_of, size_by_pillow
from mapdeal.formats.picture import Picture

# Either byte order, the mark of either in the wrong one, and BigTIFF: what Pillow opens.
_SIGNATURES = (b"MM\0*", b"II*\0", b"MM*\0", b"II\0*", b"MM\0+", b"II+\0")


def read_tiff(data: bytes, path: Path, max_cells: int) -> Picture:
    """Return the picture in a TIFF file, see `ImageFormat.read`."""
    with open_image(io.BytesIO(data), "TIFF", path, max_cells) as image:
        load(image, path, around=_silent_libtiff())
        return picture_of(image, "TIFF", path)


@contextmanager
def _silent_libtiff() -> Iterator[None]:
    """Keep libtiff, which writes to the terminal by itself, from doing so."""
    saved, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(nowhere)


TIFF = ImageFormat(
    name="TIFF",
    suffixes=(".tif", ".tiff"),
    recognises=lambda head: head.startswith(_SIGNATURES),
    read=read_tiff,
    size=size_by_pillow("TIFF"),
    size_is_in_head=False,
    suggested=("tiff",),
)
