"""BMP images, read by Pillow but for those of 32 bits a pixel: all at once or row by row."""

from __future__ import annotations

import io
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.formats.budget import PIECES
from mapdeal.formats.images.image_format import ImageFormat
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
)
from mapdeal.formats.open_file import HEAD, OpenFile
from mapdeal.formats.picture import LARGEST_COMPRESSED_CELLS, Picture
from mapdeal.formats.source import CHANGED
from mapdeal.formats.strips import Strips, strips_at_places, strips_of
from mapdeal.records import dataclass

NAME = "BMP"
_BITS = slice(28, 30)
_COMPRESSION = slice(30, 34)
_RAW = b"\0\0\0\0"
_RUN_LENGTHS = {b"\1\0\0\0": 1, b"\2\0\0\0": 2}  # and pixels of a byte
_OS2_HEADER = 12
_OS2_HEIGHT, _HEIGHT = 20, 22
_BIT_FIELDS = b"\3\0\0\0"
_BIT_DEPTHS = (1, 4, 8, 16, 24, 32)
_COLOURS = 46
_LEAST_HEADER = 54


@dataclass(frozen=True)
class BmpRows:
    """The pixels of an open BMP file without compression, see `formats.strips.PixelRows`."""

    file: OpenFile
    head: bytes
    width: int
    height: int
    row_bytes: int
    is_top_down: bool
    max_cells: int = LARGEST_COMPRESSED_CELLS
    memory: int = PIECES
    is_compressed: bool = False

    @property
    def image(self) -> Path:
        """The file."""
        return self.file.path

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.height, self.width

    def strips(self) -> Strips:
        """Return all rows."""
        return self.part(slice(0, self.height))

    def part(self, rows: slice) -> Strips:
        """Return some rows, which are counted from the south."""
        north = self.height - rows.stop
        shape = (rows.stop - rows.start, self.width)
        return strips_at_places(
            shape, self.row_bytes, lambda first, end: self._picture(north + first, north + end)
        )

    def _picture(self, first: int, end: int) -> Picture:
        """Return rows counted from the north: what is read of a BMP file of these alone."""
        count = end - first
        at = first if self.is_top_down else self.height - end
        data = self.file.read(len(self.head) + at * self.row_bytes, count * self.row_bytes)
        if len(data) < count * self.row_bytes:
            raise FileAccessError(CHANGED, source=self.image)
        head = bytearray(self.head)
        if _is_os2(self.head):
            struct.pack_into("<H", head, _OS2_HEIGHT, count)
        else:
            struct.pack_into("<i", head, _HEIGHT, -count if self.is_top_down else count)
        return _decoded(bytes(head) + data, self.image, sys.maxsize).whole()

    def sha256(self) -> str:
        """Return the checksum of the whole file."""
        return self.file.sha256()


def read_bmp(file: OpenFile, max_cells: int) -> Strips:
    """Return the strips of the picture in a BMP file, see `ImageFormat.read`."""
    head = file.read(0, HEAD)
    rows = _rows(file, head)
    if rows is None:
        return _decoded(file.read_whole(), file.path, max_cells)
    with open_image(file.stream(), NAME, file.path, max_cells) as image:
        claim_picture(image, _memory_of(rows), file.path)
    return rows.strips()


def _decoded(data: bytes, path: Path, max_cells: int) -> Strips:
    """Return the strips of the picture in the bytes of a whole file."""
    image = open_image(io.BytesIO(data), NAME, path, max_cells)
    _check_place_of_pixels(data, path)
    if data[_COMPRESSION] in _RUN_LENGTHS and not _is_os2(data):
        _check_runs(data, path, image.width, image.height)
    check_pixels(image, len(data), path)
    claim_picture(image, _decoding_memory(image, len(data)), path)
    load(image, path)
    has_opacity = data[_BITS] == b"\x20\0" and data[_COMPRESSION] == _RAW
    if has_opacity and not _is_os2(data):
        bgra = _bgra(data, path, image.width, image.height)
        return strips_of(Picture(NAME, "rgb", bgra[..., 2::-1], alpha=bgra[..., 3]))
    return strips_of_image(image, lambda part: _picture_of(part, path))


def _picture_of(image: Any, path: Path) -> Picture:
    if image.mode == "1":  # Pillow's name for a palette of black and white
        palette = np.array([[0, 0, 0, 255], [255, 255, 255, 255]], dtype=np.uint8)
        bits = np.asarray(image, dtype=np.uint8)
        return Picture(NAME, "palette", bits, palette=palette)
    return picture_of(image, NAME, path)


def _memory(file: OpenFile, head: bytes) -> int:
    rows = _rows(file, head)
    if rows is not None:
        return _memory_of(rows)
    with open_image(file.stream(), NAME, file.path, sys.maxsize) as image:
        return _decoding_memory(image, file.size)


def _memory_of(rows: BmpRows) -> int:
    return rows.width * rows.height + min(PIECES, 16 * rows.row_bytes * rows.height)


def _decoding_memory(image: Any, length: int) -> int:
    # Pillow collects the pixels of run lengths in arrays of bytes
    return decoding_memory(image.mode, image.size, length, work=2 * bytes_in_file(image))


def _rows(file: OpenFile, head: bytes) -> BmpRows | None:
    """Return the pixels if they are not compressed, and all there.

    Whatever is unusual is left to Pillow, which says what is wrong.
    """
    if len(head) < _LEAST_HEADER:
        return None
    start, header = struct.unpack_from("<II", head, 10)
    width: int
    height: int
    if _is_os2(head):
        width, height, _, bits = struct.unpack_from("<HHHH", head, 18)
        is_packed = False
    else:
        width, height, _, bits = struct.unpack_from("<iiHH", head, 18)
        is_packed = head[_COMPRESSION] not in (_RAW, _BIT_FIELDS)
    if is_packed or bits not in _BIT_DEPTHS or width <= 0 or height == 0:
        return None
    row_bytes = (width * bits + 31) // 32 * 4
    if (
        not 14 + header + _table_bytes(head, bits) <= start <= len(head)
        or start + row_bytes * abs(height) > file.size
    ):
        return None
    return BmpRows(file, head[:start], width, abs(height), row_bytes, is_top_down=height < 0)


def _table_bytes(head: bytes, bits: int) -> int:
    """Return the bytes of the masks or the palette that follow the header."""
    if _is_os2(head):
        return 3 << bits if bits <= 8 else 0
    if bits > 8:
        return 12 if head[_COMPRESSION] == _BIT_FIELDS else 0
    (colours,) = struct.unpack_from("<I", head, _COLOURS)
    return 4 * (int(colours) or 1 << bits)


def _is_os2(data: bytes) -> bool:
    """Return whether the header is the short one, which knows no compression."""
    return int.from_bytes(data[14:18], "little") == _OS2_HEADER


def _check_place_of_pixels(data: bytes, path: Path) -> None:
    """Refuse pixels within the header: Pillow would read its bytes as such."""
    start, header = (int.from_bytes(data[at : at + 4], "little") for at in (10, 14))
    if 0 < start < 14 + header:
        rule = f"the pixels must follow the header of {14 + header} bytes"
        raise MalformedInputError(rule, source=path, place="byte 10", got=start)


def _check_runs(data: bytes, path: Path, width: int, height: int) -> None:
    """Refuse run lengths that leave pixels out, which Pillow makes up.

    Rows that end early and jumps over pixels are known to the format, which does not state what
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
    name=NAME,
    suffixes=(".bmp",),
    recognises=lambda head: head.startswith(b"BM"),
    read=read_bmp,
    memory=_memory,
    size=size_by_pillow(NAME),
    suggested=("bmp",),
    rows=_rows,
)
