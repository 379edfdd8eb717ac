"""The facts of a PNG file that Pillow smooths over: its true pixel type, key and checksums."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from mapdeal.errors import MalformedInputError

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_AT_A_TIME = 1 << 20
# First column, first row, column step, row step of each pass of an interlaced picture.
_ADAM7 = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
          (0, 1, 1, 2)]  # fmt: skip
_GREY, _RGB, _PALETTE, _GREY_ALPHA, _RGB_ALPHA = 0, 2, 3, 4, 6
_SAMPLES = {_GREY: 1, _RGB: 3, _PALETTE: 1, _GREY_ALPHA: 2, _RGB_ALPHA: 4}
_DEPTHS = {_GREY: (1, 2, 4, 8, 16), _RGB: (8, 16), _PALETTE: (1, 2, 4, 8), _GREY_ALPHA: (8, 16),
           _RGB_ALPHA: (8, 16)}  # fmt: skip
_START_OF_HEADER, _HEADER = slice(8, 16), slice(16, 29)


@dataclass(frozen=True)
class PngFacts:
    """What the chunks of a PNG file say.

    Parameters
    ----------
    width, height : int
        Pixels.
    bit_depth : int
        Bits of a sample: 1, 2, 4, 8 or 16.
    has_colour, has_palette, has_alpha : bool
        The parts of the colour type.
    transparency : bytes or None
        The tRNS chunk: opacities of a palette, or the transparent colour.
    display : tuple of str
        What the chunks gAMA and iCCP say about showing the picture, in words.
    """

    width: int
    height: int
    bit_depth: int
    has_colour: bool
    has_palette: bool
    has_alpha: bool
    transparency: bytes | None
    display: tuple[str, ...] = ()

    @property
    def bits(self) -> int:
        """Bits of a pixel."""
        if self.has_palette:
            return self.bit_depth
        return self.bit_depth * ((3 if self.has_colour else 1) + self.has_alpha)

    def key(self) -> tuple[int, ...] | None:
        """Return the transparent colour of a picture without palette, if it has one."""
        if self.transparency is None or self.has_palette or self.has_alpha:
            return None
        return tuple(v for (v,) in struct.iter_unpack(">H", self.transparency))


def read_png_facts(data: bytes, source: Path) -> PngFacts:
    """Return the facts of a PNG file.

    Raises
    ------
    MalformedInputError
        If a checksum is wrong, the file ends early, chunks do not stand where they may, or it
        is animated.
    """
    header = read_png_header(data, source)
    transparency = palette = None
    pixels: list[memoryview] = []
    display: list[str] = []
    before = b""
    for name, body in _chunks(data, source):
        shown_name = name.decode("latin-1")
        if name == b"IHDR" and before:
            raise MalformedInputError("stands twice", source=source, place=f"chunk {shown_name}")
        if name in (b"PLTE", b"tRNS") and pixels:
            rule = "must stand before the pixels"
            raise MalformedInputError(rule, source=source, place=f"chunk {shown_name}")
        if name == b"tRNS":
            transparency = bytes(body)
        elif name == b"PLTE":
            palette = bytes(body)
        elif name == b"IDAT":
            if pixels and before != name:
                rule = "other chunks stand between the pixels"
                raise MalformedInputError(rule, source=source, place=f"chunk {shown_name}")
            pixels.append(body)
        elif name == b"gAMA" and len(body) == 4:
            display.append(f"a gamma of {int.from_bytes(body) / 100_000:g}")
        elif name == b"iCCP":
            display.append("a colour profile")
        elif name == b"acTL":
            raise MalformedInputError("animated PNG images are not supported", source=source)
        before = name
    width, height, bit_depth, colour_type, _ = header
    if colour_type == _PALETTE and (not palette or len(palette) % 3 or len(palette) > 768):
        rule = "a palette of 1 to 256 colours must be there"
        raise MalformedInputError(rule, source=source, place="chunk PLTE")
    _check_pixels(pixels, header, source)
    key_length = {_GREY: 2, _RGB: 6}.get(colour_type)
    if transparency is not None and key_length not in (None, len(transparency)):
        rule = f"the transparent colour takes {key_length} bytes"
        raise MalformedInputError(rule, source=source, place="chunk tRNS", got=len(transparency))
    return PngFacts(
        width, height, bit_depth,
        has_colour=colour_type in (_RGB, _PALETTE, _RGB_ALPHA),
        has_palette=colour_type == _PALETTE,
        has_alpha=colour_type in (_GREY_ALPHA, _RGB_ALPHA),
        transparency=transparency,
        display=tuple(display),
    )  # fmt: skip


class PngHeader(NamedTuple):
    """The chunk IHDR; see the PNG specification."""

    width: int
    height: int
    bit_depth: int
    colour_type: int
    is_interlaced: bool


def read_png_header(data: bytes, source: Path) -> PngHeader:
    """Return the header of a PNG file, given its first bytes.

    Raises
    ------
    MalformedInputError
        If it is not there, or one of its numbers is none of PNG's.
    """
    body = data[_HEADER]
    if data[_START_OF_HEADER] != struct.pack(">I4s", len(body), b"IHDR") or len(body) != 13:
        raise MalformedInputError("must start with its header", source=source, place="chunk IHDR")
    width, height, bit_depth, colour_type, method, filters, interlace = struct.unpack(
        ">IIBBBBB", body
    )
    if colour_type not in _DEPTHS:
        rule = "is none of PNG's colour types"
        raise MalformedInputError(rule, source=source, place="chunk IHDR", got=colour_type)
    if bit_depth not in _DEPTHS[colour_type]:
        rule = f"bits of a sample must be one of {_DEPTHS[colour_type]}"
        raise MalformedInputError(rule, source=source, place="chunk IHDR", got=bit_depth)
    if method or filters or interlace > 1:
        rule = "is compressed, filtered or interlaced in a way that PNG does not know"
        raise MalformedInputError(rule, source=source, place="chunk IHDR")
    return PngHeader(width, height, bit_depth, colour_type, interlace == 1)


def _chunks(data: bytes, source: Path) -> Iterator[tuple[bytes, memoryview]]:
    """Yield name and body of each chunk up to the last, their checksums verified."""
    view = memoryview(data)
    offset = len(SIGNATURE)
    while offset + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, offset)
        end = offset + 12 + length
        if end > len(data):
            break
        name = data[offset + 4 : offset + 8]
        (checksum,) = struct.unpack_from(">I", data, end - 4)
        if zlib.crc32(view[offset + 4 : end - 4]) != checksum:
            place = f"chunk {name.decode('latin-1')}"
            raise MalformedInputError("wrong checksum", source=source, place=place)
        if name == b"IEND":
            return
        yield name, view[offset + 8 : end - 4]
        offset = end
    raise MalformedInputError("the PNG file ends early", source=source, place=f"byte {offset}")


def _check_pixels(chunks: list[memoryview], header: PngHeader, source: Path) -> None:
    """Refuse a file whose pixels end early: decoders fill up with zeros, which is black.

    Only counts: what is decompressed is dropped at once.
    """
    expected = _size_of_pixels(header)
    decompressor = zlib.decompressobj()
    found = 0
    try:
        for chunk in chunks:
            rest: bytes | memoryview = chunk
            while rest and found < expected and not decompressor.eof:
                found += len(decompressor.decompress(rest, _AT_A_TIME))
                rest = decompressor.unconsumed_tail
    except zlib.error as error:
        raise MalformedInputError(f"the pixels are damaged: {error}", source=source) from None
    found += 0 if found >= expected else len(decompressor.flush())
    if found < expected:
        rule = f"the pixels end early: expected {expected} bytes"
        raise MalformedInputError(rule, source=source, place="pixels", got=found)


def _size_of_pixels(header: PngHeader) -> int:
    """Return the bytes of all rows before compression, each with its filter byte."""
    width, height, bit_depth, colour_type, interlace = header
    bits = bit_depth * _SAMPLES[colour_type]
    passes = _ADAM7 if interlace else [(0, 0, 1, 1)]
    total = 0
    for first_col, first_row, col_step, row_step in passes:
        cols = -(-(width - first_col) // col_step)
        rows = -(-(height - first_row) // row_step)
        if cols > 0 and rows > 0:
            total += rows * (1 + (cols * bits + 7) // 8)
    return total
