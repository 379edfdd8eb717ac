"""BMP images, read by Pillow but for those of 32 bits a pixel."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError
from mapdeal.formats.images.image_format import ImageFormat
from mapdeal.formats.images.pillow import load, open_image, picture_of, size_by_pillow
from mapdeal.formats.picture import Picture

_BITS = slice(28, 30)
_COMPRESSION = slice(30, 34)


def read_bmp(data: bytes, path: Path, max_cells: int) -> Picture:
    """Return the picture in a BMP file, see `ImageFormat.read`."""
    with open_image(io.BytesIO(data), "BMP", path, max_cells) as image:
        load(image, path)
        if data[_BITS] == b"\x20\x00" and data[_COMPRESSION] == b"\0\0\0\0":
            bgra = _bgra(data, path, image.width, image.height)
            return Picture("BMP", "rgb", bgra[..., 2::-1], alpha=bgra[..., 3])
        if image.mode == "1":  # Pillow's name for a palette of black and white
            palette = np.array([[0, 0, 0, 255], [255, 255, 255, 255]], dtype=np.uint8)
            bits = np.asarray(image, dtype=np.uint8)
            return Picture("BMP", "palette", bits, palette=palette)
        return picture_of(image, "BMP", path)


def _bgra(data: bytes, path: Path, width: int, height: int) -> NDArray[np.uint8]:
    """Return blue, green, red, opacity: Pillow drops the fourth byte, ROS reads it as opacity."""
    (offset,) = struct.unpack_from("<I", data, 10)
    (signed_height,) = struct.unpack_from("<i", data, 22)
    if offset + 4 * width * height > len(data):
        raise MalformedInputError("the image file ends early", source=path)
    pixels = np.frombuffer(data, dtype=np.uint8, count=4 * width * height, offset=offset)
    pixels = pixels.reshape(height, width, 4)
    return pixels if signed_height < 0 else pixels[::-1]


BMP = ImageFormat(
    name="BMP",
    suffixes=(".bmp",),
    recognises=lambda head: head.startswith(b"BM"),
    read=read_bmp,
    size=size_by_pillow("BMP"),
    size_is_in_head=False,
    suggested=("bmp",),
)
