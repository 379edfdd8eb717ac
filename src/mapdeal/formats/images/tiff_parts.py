"""Strips and tiles of a TIFF file: whether all pixels are there.

Pillow and libtiff leave cells of strips that are not listed as they are, which is black, read
beyond the end of strips, and fill up faxes and JPEG data that end early.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.errors import MalformedInputError
from mapdeal.formats.images.jpeg_scans import check_scans
from mapdeal.formats.images.pillow import damage_refused, have_same_pixels
from mapdeal.records import dataclass

_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _SAMPLES, _PLANAR = 256, 257, 258, 259, 277, 284
_STRIP_OFFSETS, _ROWS_PER_STRIP, _STRIP_SIZES = 273, 278, 279
_TILE_WIDTH, _TILE_HEIGHT, _TILE_OFFSETS, _TILE_SIZES = 322, 323, 324, 325
_JPEG_TABLES = 347
_OF_A_FAX = (_WIDTH, _HEIGHT, _BITS, _COMPRESSION, 262, 266, 274, _SAMPLES, _ROWS_PER_STRIP,
             292, 293, _TILE_WIDTH, _TILE_HEIGHT)  # fmt: skip
_HEADER = 8
TAGS_OF_PARTS = (*_OF_A_FAX, _PLANAR, _STRIP_OFFSETS, _STRIP_SIZES, _TILE_OFFSETS, _TILE_SIZES,
                 _JPEG_TABLES)  # fmt: skip
"""The tags that are looked at."""

_RAW, _JPEG = 1, 7
_FAXES = (2, 3, 4, 32771)
# libtiff says of these where a strip ends early.
_CHECKED_BY_LIBTIFF = {5: "LZW", 8: "deflate", 32946: "deflate", 32773: "PackBits",
                       34925: "LZMA", 50000: "Zstandard"}  # fmt: skip

# What decodes to all kinds of rows, with and without the mark of a new row before it.
_ROWS = [bytes((at * step + step) % 256 for at in range(64)) for step in (83, 101, 167, 229)]
_FILLERS = [mark + rows for mark in (b"", b"\0\x01", b"\0\x18") for rows in _ROWS]


@dataclass(frozen=True)
class TiffParts:
    """Where the strips or tiles of a TIFF file lie."""

    compression: int
    offsets: tuple[int, ...]
    sizes: tuple[int, ...]
    heights: tuple[int, ...]
    width: int

    def of(self, data: bytes) -> list[bytes]:
        """Return the bytes of each part."""
        return [data[at : at + n] for at, n in zip(self.offsets, self.sizes, strict=True)]


def is_fax(compression: object) -> bool:
    """Return whether strips are compressed as faxes, which `check_decoded` decodes once more."""
    return compression in _FAXES


def is_jpeg(compression: object) -> bool:
    """Return whether strips are JPEG data, which `check_decoded` decodes twice, one by one."""
    return compression == _JPEG


def tiff_parts(tags: Mapping[int, Any], file_size: int, path: Path) -> TiffParts:
    """Return where the strips or tiles of a TIFF file lie."""
    width, height = (_whole(tags, tag, path) for tag in (_WIDTH, _HEIGHT))
    compression = _whole(tags, _COMPRESSION, path, default=_RAW)
    if compression not in (_RAW, _JPEG, *_FAXES, *_CHECKED_BY_LIBTIFF):
        rule = f"TIFF compression {compression} is not supported"
        raise MalformedInputError(rule, source=path)
    is_tiled = _TILE_OFFSETS in tags
    if is_tiled == (_STRIP_OFFSETS in tags):
        raise _damaged(path, "it must have either strips or tiles")
    if is_tiled:
        part_width, part_height = (_whole(tags, tag, path) for tag in (_TILE_WIDTH, _TILE_HEIGHT))
    else:
        part_width = width
        part_height = min(_whole(tags, _ROWS_PER_STRIP, path, default=height), height)
    if part_width < 1 or part_height < 1:
        raise _damaged(path, f"its parts are {part_width} x {part_height}")
    planes = _bits_of_planes(tags, path)
    down, across = -(-height // part_height), -(-width // part_width)
    names = (_TILE_OFFSETS, _TILE_SIZES) if is_tiled else (_STRIP_OFFSETS, _STRIP_SIZES)
    expected = down * across * len(planes)
    offsets, sizes = (_list(tags, tag, expected, path) for tag in names)
    # rows are padded to whole bytes; the last strip may be lower, tiles are all of one size
    heights = [part_height if is_tiled else min(part_height, height - row * part_height)
               for _ in planes for row in range(down) for _ in range(across)]  # fmt: skip
    bits = [of_plane for of_plane in planes for _ in range(down * across)]
    for index, (offset, size) in enumerate(zip(offsets, sizes, strict=True)):
        least = heights[index] * -(-part_width * bits[index] // 8) if compression == _RAW else 1
        place = f"{'tile' if is_tiled else 'strip'} {index + 1} of {expected}"
        if size < least:
            rule = f"the pixels end early: expected {least} bytes"
            raise MalformedInputError(rule, source=path, place=place, got=size)
        if offset < _HEADER or offset + size > file_size:
            rule = f"must lie in the file, which has {file_size} bytes"
            raise MalformedInputError(rule, source=path, place=place, got=(offset, size))
    return TiffParts(compression, offsets, sizes, tuple(heights), part_width)


def check_decoded(
    parts: TiffParts, tags: Mapping[int, Any], data: bytes, image: Any, path: Path
) -> None:
    """Refuse a picture of which some pixels were not in the file."""
    if parts.compression == _JPEG:
        tables = tags.get(_JPEG_TABLES, b"")
        for height, stream in zip(parts.heights, parts.of(data), strict=True):
            rows, columns = check_scans(_with_tables(stream, tables), path)
            if rows < height or columns < parts.width:
                raise _damaged(path, "a strip or tile of JPEG data is too small")
    elif parts.compression in _FAXES:
        # Whoever decodes complete data never gets to what lies behind them.
        for filler in _FILLERS:
            filled = [stream + filler for stream in parts.of(data)]
            with damage_refused(path), _opened(_fax_of(tags, filled)) as decoded:
                decoded.load()
                is_same = have_same_pixels(image, decoded)
            if not is_same:
                raise MalformedInputError("the pixels end early", source=path, place="fax data")


def _bits_of_planes(tags: Mapping[int, Any], path: Path) -> list[int]:
    """Return the bits of a pixel in each plane: one plane, or as many as there are samples."""
    samples = _whole(tags, _SAMPLES, path, default=1)
    bits = tags.get(_BITS, (1,))
    if not _are_whole(bits) or not 1 <= samples <= 16 or len(bits) not in (1, samples):
        raise _damaged(path, f"bits {bits} of {samples} samples")
    all_bits = list(bits) * (samples // len(bits))
    is_planar = _whole(tags, _PLANAR, path, default=1) == 2
    return all_bits if is_planar else [sum(all_bits)]


def _whole(tags: Mapping[int, Any], tag: int, path: Path, *, default: int | None = None) -> int:
    value = tags.get(tag, default)
    if not isinstance(value, int):
        raise _damaged(path, f"tag {tag} must be a whole number")
    return value


def _list(tags: Mapping[int, Any], tag: int, expected: int, path: Path) -> tuple[int, ...]:
    """Return the offsets or sizes of all parts."""
    values = tags.get(tag, ())
    if not _are_whole(values) or len(values) != expected:
        rule = f"must list {expected} strips or tiles, as many as cover the picture"
        found = len(values) if _are_whole(values) else values
        raise MalformedInputError(rule, source=path, place=f"tag {tag}", got=found)
    return tuple(values)


def _are_whole(values: object) -> bool:
    return isinstance(values, tuple) and all(isinstance(v, int) and v >= 0 for v in values)


def _with_tables(stream: bytes, tables: bytes) -> bytes:
    """Return a JPEG stream with the tables that all streams of a file have in common."""
    if not tables.startswith(b"\xff\xd8"):
        return stream
    return tables.removesuffix(b"\xff\xd9") + stream.removeprefix(b"\xff\xd8")


def _fax_of(tags: Mapping[int, Any], parts: Sequence[bytes]) -> bytes:
    """Return a TIFF file of the same picture with other data."""
    facts = {tag: tags[tag] for tag in _OF_A_FAX if isinstance(tags.get(tag), int)}
    is_tiled = _TILE_OFFSETS in tags
    starts = np.cumsum([_HEADER, *map(len, parts)])[:-1].tolist()
    names = (_TILE_OFFSETS, _TILE_SIZES) if is_tiled else (_STRIP_OFFSETS, _STRIP_SIZES)
    lists = dict(zip(names, (starts, [len(part) for part in parts]), strict=True))
    body = b"".join(parts)
    entries = []
    end = _HEADER + len(body)
    for tag, values in sorted({**{t: [v] for t, v in facts.items()}, **lists}.items()):
        packed = struct.pack(f"<{len(values)}I", *values)
        if len(values) > 1:
            body += packed
            packed = struct.pack("<I", end)
            end += 4 * len(values)
        entries.append(struct.pack("<HHI", tag, 4, len(values)) + packed)
    directory = struct.pack("<H", len(entries)) + b"".join(entries) + bytes(4)
    return b"II*\0" + struct.pack("<I", end) + body + directory


def _opened(data: bytes) -> Any:
    from PIL import Image

    return Image.open(io.BytesIO(data), formats=("TIFF",))


def _damaged(path: Path, what: str) -> MalformedInputError:
    return MalformedInputError(f"the image is damaged: {what}", source=path)
