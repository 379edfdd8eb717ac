"""The facts of a PNG file that Pillow smooths over: its true pixel type, key and checksums."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

from mapdeal.errors import MalformedInputError

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_AT_A_TIME = 1 << 20
# First column, first row, column step, row step of each pass of an interlaced picture.
_ADAM7 = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
          (0, 1, 1, 2)]  # fmt: skip
_GREY, _RGB, _PALETTE, _GREY_ALPHA, _RGB_ALPHA = 0, 2, 3, 4, 6


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

    def key(self) -> tuple[int, ...] | None:
        """Return the transparent colour of a picture without palette, if it has one."""
        if self.transparency is None or self.has_palette:
            return None
        return tuple(v for (v,) in struct.iter_unpack(">H", self.transparency))


def read_png_facts(data: bytes, source: Path) -> PngFacts:
    """Return the facts of a PNG file.

    Raises
    ------
    MalformedInputError
        If a checksum is wrong, the file ends early, or it is animated.
    """
    header: tuple[int, ...] | None = None
    transparency = palette = None
    pixels: list[memoryview] = []
    display: list[str] = []
    offset = len(SIGNATURE)
    ended = False
    while offset < len(data) and not ended:
        if offset + 12 > len(data):
            break
        (length,) = struct.unpack_from(">I", data, offset)
        name = data[offset + 4 : offset + 8]
        end = offset + 12 + length
        if end > len(data):
            break
        body = data[offset + 8 : offset + 8 + length]
        (checksum,) = struct.unpack_from(">I", data, end - 4)
        shown_name = name.decode("latin-1")
        if zlib.crc32(memoryview(data)[offset + 4 : end - 4]) != checksum:
            raise MalformedInputError("wrong checksum", source=source, place=f"chunk {shown_name}")
        if header is None and (name != b"IHDR" or length != 13):
            raise MalformedInputError("must start with its header", source=source, place=shown_name)
        if name == b"IHDR":
            header = struct.unpack(">IIBBBBB", body)
        elif name == b"tRNS":
            transparency = body
        elif name == b"PLTE":
            palette = body
        elif name == b"IDAT":
            pixels.append(memoryview(data)[offset + 8 : offset + 8 + length])
        elif name == b"gAMA" and length == 4:
            display.append(f"a gamma of {int.from_bytes(body) / 100_000:g}")
        elif name == b"iCCP":
            display.append("a colour profile")
        elif name == b"acTL":
            raise MalformedInputError("animated PNG images are not supported", source=source)
        ended = name == b"IEND"
        offset = end
    if header is None or not ended:
        raise MalformedInputError("the PNG file ends early", source=source, place=f"byte {offset}")
    width, height, bit_depth, colour_type = header[:4]
    if colour_type not in (_GREY, _RGB, _PALETTE, _GREY_ALPHA, _RGB_ALPHA):
        rule = "is none of PNG's colour types"
        raise MalformedInputError(rule, source=source, place="chunk IHDR", got=colour_type)
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


def _check_pixels(chunks: list[memoryview], header: tuple[int, ...], source: Path) -> None:
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


def _size_of_pixels(header: tuple[int, ...]) -> int:
    """Return the bytes of all rows before compression, each with its filter byte."""
    width, height, bit_depth, colour_type, _, _, interlace = header
    bits = bit_depth * {_GREY: 1, _RGB: 3, _PALETTE: 1, _GREY_ALPHA: 2, _RGB_ALPHA: 4}[colour_type]
    passes = _ADAM7 if interlace else [(0, 0, 1, 1)]
    total = 0
    for first_col, first_row, col_step, row_step in passes:
        cols = -(-(width - first_col) // col_step)
        rows = -(-(height - first_row) // row_step)
        if cols > 0 and rows > 0:
            total += rows * (1 + (cols * bits + 7) // 8)
    return total
