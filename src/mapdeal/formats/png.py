"""Writing PNG files, row band by row band, compressed in threads.

References
----------
Portable Network Graphics (PNG) Specification, W3C: chunks, colour types, filter type 0.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.deflate import PART, Buffer, deflated

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY, _PALETTE, _RGBA = 0, 3, 6
_ZLIB_HEADER = b"\x78\x01"


def write_grey_png(file: BinaryIO, pixels: NDArray[np.uint8]) -> None:
    """Write 8-bit grey pixels, shape (H, W), row 0 in the north."""
    _write(file, pixels, _GREY)


def write_rgba_png(file: BinaryIO, pixels: NDArray[np.uint8]) -> None:
    """Write pixels with opacity, shape (H, W, 4), row 0 in the north."""
    _write(file, pixels.reshape(len(pixels), -1), _RGBA)


def write_indexed_png(
    file: BinaryIO, indices: NDArray[np.uint8], palette: NDArray[np.uint8]
) -> None:
    """Write indices into a palette, shapes (H, W) and (256, 3), row 0 in the north."""
    _write(file, indices, _PALETTE, palette)


def _write(
    file: BinaryIO,
    rows: NDArray[np.uint8],
    colour_type: int,
    palette: NDArray[np.uint8] | None = None,
) -> None:
    height, row_bytes = rows.shape
    width = row_bytes // 4 if colour_type == _RGBA else row_bytes
    file.write(_SIGNATURE)
    _write_chunk(file, b"IHDR", struct.pack(">IIBBBBB", width, height, 8, colour_type, 0, 0, 0))
    if palette is not None:
        _write_chunk(file, b"PLTE", palette.tobytes())
    checksum = zlib.adler32(b"")

    def bands() -> Iterator[Buffer]:
        nonlocal checksum
        step = max(1, PART // (row_bytes + 1))
        for first in range(0, height, step):
            band = rows[first : first + step]
            filtered = np.zeros((len(band), row_bytes + 1), dtype=np.uint8)  # filter type 0
            filtered[:, 1:] = band
            checksum = zlib.adler32(filtered.data, checksum)
            yield filtered.reshape(-1).data

    start = _ZLIB_HEADER
    for block in deflated(bands()):
        _write_chunk(file, b"IDAT", start + block)
        start = b""
    _write_chunk(file, b"IDAT", struct.pack(">I", checksum))
    _write_chunk(file, b"IEND", b"")


def _write_chunk(file: BinaryIO, name: bytes, data: bytes) -> None:
    file.write(struct.pack(">I", len(data)))
    file.write(name)
    file.write(data)
    file.write(struct.pack(">I", zlib.crc32(data, zlib.crc32(name))))
