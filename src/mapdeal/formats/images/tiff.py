"""TIFF images, read by Pillow."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mapdeal.formats.images.image_format import ImageFormat
from mapdeal.formats.images.memory import (
    check_pixels,
    claim_picture,
    decoding_memory,
    tile_bytes,
)
from mapdeal.formats.images.pillow import (
    damage_refused,
    load,
    one_at_a_time,
    open_image,
    picture_of,
    size_by_pillow,
    strips_of_image,
)
from mapdeal.formats.images.tiff_parts import (
    TAGS_OF_PARTS,
    check_decoded,
    is_fax,
    is_jpeg,
    tiff_parts,
)
from mapdeal.formats.open_file import OpenFile
from mapdeal.formats.strips import Strips

NAME = "TIFF"
_BITS_PER_SAMPLE, _COMPRESSION, _ROWS_PER_STRIP = 258, 259, 278
_RAW = 1
_OF_JPEG = 4
"""Bytes of a pixel of JPEG data in Pillow's memory, at most."""
_TILE = (322, 323)

# Either byte order, the mark of either in the wrong one, and BigTIFF: what Pillow opens.
_SIGNATURES = (b"MM\0*", b"II*\0", b"MM*\0", b"II\0*", b"MM\0+", b"II+\0")


def read_tiff(file: OpenFile, max_cells: int) -> Strips:
    """Return the strips of the picture in a TIFF file, see `ImageFormat.read`."""
    path, data = file.path, file.read_whole()
    image = open_image(io.BytesIO(data), NAME, path, max_cells)
    with damage_refused(path):  # Pillow reads the values of tags when they are asked for
        bits, tile = _bits_of(image), _tile_of(image)
        tags = {tag: image.tag_v2.get(tag) for tag in TAGS_OF_PARTS if tag in image.tag_v2}
    check_pixels(image, file.size, path, bits=bits, tile=tile)
    claim_picture(image, _memory_of(image, file), path, tile=tile)
    parts = tiff_parts(tags, len(data), path)
    load(image, path, around=_silent_libtiff())
    with _silent_libtiff():
        check_decoded(parts, tags, data, image, path)
    return strips_of_image(image, lambda part: picture_of(part, NAME, path))


def _memory(file: OpenFile, _head: bytes) -> int:
    with open_image(file.stream(), NAME, file.path, sys.maxsize) as image:
        return _memory_of(image, file)


def _memory_of(image: Any, file: OpenFile) -> int:
    with damage_refused(file.path):
        bits, tile, strip = _bits_of(image), _tile_of(image), _strip_of(image)
        compression = image.tag_v2.get(_COMPRESSION, _RAW)
    part = tile or strip
    work = 0 if compression == _RAW else tile_bytes(image, part, bits=bits)
    if is_jpeg(compression):
        work += 2 * _OF_JPEG * part
    return decoding_memory(
        image.mode, image.size, file.size, work=work, is_decoded_twice=is_fax(compression)
    )  # fmt: skip


def _bits_of(image: Any) -> int:
    """Return the bits of a pixel in the file."""
    bits = image.tag_v2.get(_BITS_PER_SAMPLE, (1,))
    return max(1, sum(bits)) if all(isinstance(one, int) for one in bits) else 1


def _tile_of(image: Any) -> int:
    """Return the pixels of a tile, which are decoded together; 0 if there are none."""
    width, height = (image.tag_v2.get(tag, 0) for tag in _TILE)
    is_tiled = isinstance(width, int) and isinstance(height, int)
    return max(0, width * height) if is_tiled else 0


def _strip_of(image: Any) -> int:
    """Return the pixels of a strip, which are decoded together."""
    rows = image.tag_v2.get(_ROWS_PER_STRIP, image.height)
    height = min(rows, image.height) if isinstance(rows, int) else image.height
    return max(0, int(height * image.width))


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
    name=NAME,
    suffixes=(".tif", ".tiff"),
    recognises=lambda head: head.startswith(_SIGNATURES),
    read=read_tiff,
    memory=_memory,
    size=size_by_pillow(NAME),
    suggested=("tiff",),
)
