"""JPEG images, read by Pillow."""

from __future__ import annotations

import io
import sys
from typing import Any

from mapdeal.formats.images.image_format import ImageFormat
from mapdeal.formats.images.jpeg_scans import check_scans
from mapdeal.formats.images.memory import (
    bytes_in_file,
    check_pixels,
    claim_picture,
    decoding_memory,
)
from mapdeal.formats.images.pillow import (
    load,
    open_image,
    picture_of,
    size_by_pillow,
    strips_of_image,
    warn,
)
from mapdeal.formats.open_file import OpenFile
from mapdeal.formats.strips import Strips

NAME = "JPEG"
_COEFFICIENT = 2
"""Bytes."""


def read_jpeg(file: OpenFile, max_cells: int) -> Strips:
    """Return the strips of the picture in a JPEG file, see `ImageFormat.read`."""
    path, data = file.path, file.read_whole()
    image = open_image(io.BytesIO(data), NAME, path, max_cells)
    check_pixels(image, file.size, path)
    claim_picture(image, _memory_of(image, file), path)
    load(image, path)
    check_scans(data, path, image)
    text = "JPEG is lossy: greys may have moved across the thresholds"
    warn(path, text, "image.lossy")
    return strips_of_image(image, lambda part: picture_of(part, NAME, path))


def _memory(file: OpenFile, _head: bytes) -> int:
    with open_image(file.stream(), NAME, file.path, sys.maxsize) as image:
        return _memory_of(image, file)


def _memory_of(image: Any, file: OpenFile) -> int:
    # the scans of a progressive picture are collected before there are pixels
    coefficients = _COEFFICIENT * bytes_in_file(image) if "progressive" in image.info else 0
    return decoding_memory(
        image.mode, image.size, file.size, work=coefficients, is_decoded_twice=True
    )


JPEG = ImageFormat(
    name=NAME,
    suffixes=(".jpg", ".jpeg"),
    recognises=lambda head: head.startswith(b"\xff\xd8\xff"),
    read=read_jpeg,
    memory=_memory,
    size=size_by_pillow(NAME),
)
