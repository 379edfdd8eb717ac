"""TIFF images, read by Pillow."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mapdeal.formats.images.image_format import ImageFormat
from mapdeal.formats.images.memory import claim_pixels
from mapdeal.formats.images.pillow import (
    damage_refused,
    load,
    one_at_a_time,
    open_image,
    picture_of,
    size_by_pillow,
)
from mapdeal.formats.images.tiff_parts import TAGS_OF_PARTS, check_decoded, tiff_parts
from mapdeal.formats.picture import Picture

_BITS_PER_SAMPLE = 258
_TILE = (322, 323)

# Either byte order, the mark of either in the wrong one, and BigTIFF: what Pillow opens.
_SIGNATURES = (b"MM\0*", b"II*\0", b"MM*\0", b"II\0*", b"MM\0+", b"II+\0")


def read_tiff(data: bytes, path: Path, max_cells: int) -> Picture:
    """Return the picture in a TIFF file, see `ImageFormat.read`."""
    with open_image(io.BytesIO(data), "TIFF", path, max_cells) as image:
        with damage_refused(path):  # Pillow reads the values of tags when they are asked for
            bits, tile = _bits_of(image), _tile_of(image)
            tags = {tag: image.tag_v2.get(tag) for tag in TAGS_OF_PARTS if tag in image.tag_v2}
        claim_pixels(image, data, path, bits=bits, tile=tile, is_decoded_twice=True)
        parts = tiff_parts(tags, len(data), path)
        load(image, path, around=_silent_libtiff())
        with _silent_libtiff():
            check_decoded(parts, tags, data, image, path)
        return picture_of(image, "TIFF", path)


def _bits_of(image: Any) -> int:
    """Return the bits of a pixel in the file."""
    bits = image.tag_v2.get(_BITS_PER_SAMPLE, (1,))
    return max(1, sum(bits)) if all(isinstance(one, int) for one in bits) else 1


def _tile_of(image: Any) -> int:
    """Return the pixels of a tile, which are decoded together; 0 if there are none."""
    width, height = (image.tag_v2.get(tag, 0) for tag in _TILE)
    is_tiled = isinstance(width, int) and isinstance(height, int)
    return max(0, width * height) if is_tiled else 0


@contextmanager
def _silent_libtiff() -> Iterator[None]:
    """Keep libtiff, which writes to the terminal by itself, from doing so."""
    with one_at_a_time():
        saved = _copy_of_stderr()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            if saved is not None:
                os.dup2(saved, 2)
                os.close(saved)
            else:
                os.close(2)
            if nowhere != 2:
                os.close(nowhere)


def _copy_of_stderr() -> int | None:
    try:
        return os.dup(2)
    except OSError:  # there is none: whoever called has closed it
        return None


TIFF = ImageFormat(
    name="TIFF",
    suffixes=(".tif", ".tiff"),
    recognises=lambda head: head.startswith(_SIGNATURES),
    read=read_tiff,
    size=size_by_pillow("TIFF"),
    size_is_in_head=False,
    suggested=("tiff",),
)
