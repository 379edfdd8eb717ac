"""BMP images, read by Pillow but for those of 32 bits a pixel."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError
from mapdeal.formats.images.image_format import ImageFormat
from mapdeal.formats.images.memory import claim_pixels
from mapdeal.formats.images.pillow import load, open_image, picture_of, size_by_pillow
from mapdeal.formats.picture import Picture

_BITS = slice(28, 30)
_COMPRESSION = slice(30, 34)
_RAW = b"\0\0\0\0"
_RUN_LENGTHS = {b"\1\0\0\0": 1, b"\2\0\0\0": 2}  # and pixels of a byte
_OS2_HEADER = 12


def read_bmp(data: bytes, path: Path, max_cells: int) -> Picture:
    """Return the picture in a BMP file, see `ImageFormat.read`."""
    with open_image(io.BytesIO(data), "BMP", path, max_cells) as image:
        _check_place_of_pixels(data, path)
        if data[_COMPRESSION] in _RUN_LENGTHS and not _is_os2(data):
            _check_runs(data, path, image.width, image.height)
        claim_pixels(image, data, path)
        load(image, path)
        has_opacity = data[_BITS] == b"\x20\0" and data[_COMPRESSION] == _RAW
        if has_opacity and not _is_os2(data):
            bgra = _bgra(data, path, image.width, image.height)
            return Picture("BMP", "rgb", bgra[..., 2::-1], alpha=bgra[..., 3])
        if image.mode == "1":  # Pillow's name for a palette of black and white
            palette = np.array([[0, 0, 0, 255], [255, 255, 255, 255]], dtype=np.uint8)
            bits = np.asarray(image, dtype=np.uint8)
            return Picture("BMP", "palette", bits, palette=palette)
        return picture_of(image, "BMP", path)


def _is_os2(data: bytes) -> bool:
    """Return whether the header is the short one, which knows no compression."""
    return int.from_bytes(data[14:18], "little") == _OS2_HEADER


def _check_place_of_pixels(data: bytes, path: Path) -> None:
    """Refuse pixels within the header: Pillow would read its bytes as such."""
    start, header = (int.from_bytes(data[at : at + 4], "little") for at in (10, 14))
    if 0 < start < 14 + header:
        rule = f"the pixels must lie behind the header of {14 + header} bytes"
        raise MalformedInputError(rule, source=path, place="byte 10", got=start)


def _check_runs(data: bytes, path: Path, width: int, height: int) -> None:
    """Refuse run lengths that leave pixels out, which Pillow makes up.

    Rows that end early and jumps over pixels are known to the format, which does not say what
    the pixels are that they leave out.
    """
    pixels_per_byte = _RUN_LENGTHS[data[_COMPRESSION]]
    offset = int.from_bytes(data[10:14], "little")
    if offset % 2:
        raise MalformedInputError("run lengths must begin at an even byte", source=path)
    row = col = 0
    while (row, col) != (height - 1, width):
        count, value = data[offset : offset + 2] if offset + 2 <= len(data) else (0, 1)
        offset += 2
        if count == 0 and value > 2:  # so many pixels as they are, up to an even byte
            count = value
            offset += 2 * -(-count // (2 * pixels_per_byte))
        elif count == 0 and value == 0 and col == width:
            row, col = row + 1, 0
            continue
        col += count
        if count == 0 or col > width or offset > len(data):
            place = f"row {row + 1} of {height}"
            rule = f"the pixels end early or do not fit: expected {width}"
            raise MalformedInputError(rule, source=path, place=place, got=col)


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
