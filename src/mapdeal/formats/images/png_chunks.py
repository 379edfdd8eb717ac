"""The facts of a PNG file that Pillow smooths over: its true pixel type, key and checksums."""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Iterator
from pathlib import Path

from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.formats.budget import claim
from mapdeal.formats.open_file import OpenFile
from mapdeal.formats.source import CHANGED
from mapdeal.records import dataclass

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_AT_A_TIME = 1 << 20
_TEXTS = (b"eXIf", b"tEXt", b"zTXt", b"iTXt")
# First column, first row, column step, row step of each pass of an interlaced picture.
_ADAM7 = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
          (0, 1, 1, 2)]  # fmt: skip
_GREY, _RGB, _PALETTE, _GREY_ALPHA, _RGB_ALPHA = 0, 2, 3, 4, 6
_SAMPLES = {_GREY: 1, _RGB: 3, _PALETTE: 1, _GREY_ALPHA: 2, _RGB_ALPHA: 4}
_DEPTHS = {_GREY: (1, 2, 4, 8, 16), _RGB: (8, 16), _PALETTE: (1, 2, 4, 8), _GREY_ALPHA: (8, 16),
           _RGB_ALPHA: (8, 16)}  # fmt: skip
_START_OF_HEADER, _HEADER = slice(8, 16), slice(16, 29)


@dataclass(frozen=True)
class PngHeader:
    """The chunk IHDR; see the PNG specification."""

    width: int
    height: int
    bit_depth: int
    colour_type: int
    is_interlaced: bool

    @property
    def has_colour(self) -> bool:
        """Whether pixels have more than a brightness."""
        return self.colour_type in (_RGB, _PALETTE, _RGB_ALPHA)

    @property
    def has_palette(self) -> bool:
        """Whether samples are indices."""
        return self.colour_type == _PALETTE

    @property
    def has_alpha(self) -> bool:
        """Whether opacity is a channel."""
        return self.colour_type in (_GREY_ALPHA, _RGB_ALPHA)

    @property
    def bits(self) -> int:
        """Bits of a pixel."""
        return self.bit_depth * _SAMPLES[self.colour_type]

    @property
    def mode(self) -> str:
        """Pillow's mode of the picture, or another one that takes as much memory."""
        if self.colour_type in (_GREY, _PALETTE):
            return "I" if self.bit_depth == 16 else "L"
        return "RGBA"

    @property
    def row_bytes(self) -> int:
        """Bytes of a row before compression, with that of its filter."""
        return _row_bytes(self.width, self.bits)

    @property
    def inflated_size(self) -> int:
        """Bytes of all rows before compression, each with that of its filter."""
        passes = _ADAM7 if self.is_interlaced else [(0, 0, 1, 1)]
        total = 0
        for first_col, first_row, col_step, row_step in passes:
            cols = -(-(self.width - first_col) // col_step)
            rows = -(-(self.height - first_row) // row_step)
            if cols > 0 and rows > 0:
                total += rows * _row_bytes(cols, self.bits)
        return total


@dataclass(frozen=True)
class PngFacts(PngHeader):
    """Content of a PNG file's chunks, besides the numbers in the header."""

    transparency: bytes | None
    display: tuple[str, ...]
    palette: bytes
    pixels: PixelSpans
    texts: tuple[bytes, bytes]

    def key(self) -> tuple[int, ...] | None:
        """Return the transparent colour of a picture without palette, if it has one."""
        if self.transparency is None or self.has_palette or self.has_alpha:
            return None
        return tuple(v for (v,) in struct.iter_unpack(">H", self.transparency))

    def around_a_pixel(self) -> bytes:
        """Return a PNG file with the same texts and a single pixel."""
        header = struct.pack(">IIBBBBB", 1, 1, 8, _GREY, 0, 0, 0)
        before, behind = self.texts
        return b"".join([
            SIGNATURE, _chunk(b"IHDR", header), before, _chunk(b"IDAT", zlib.compress(b"\0\0")),
            behind, _chunk(b"IEND", b""),
        ])  # fmt: skip


def _row_bytes(width: int, bits: int) -> int:
    return 1 + (width * bits + 7) // 8


def _chunk(name: bytes, body: bytes) -> bytes:
    checksum = zlib.crc32(name + body)
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", checksum)


def read_png_facts(file: OpenFile) -> PngFacts:
    """Return the facts of a PNG file, all of which is read, but for the pixels themselves."""
    source = file.path
    header = read_png_header(file.read(0, _HEADER.stop), source)
    transparency = palette = None
    pixels = PixelSpans()
    display: list[str] = []
    texts: tuple[list[bytes], list[bytes]] = ([], [])
    before = b""
    for name, start, length, window in _chunks(file):
        shown_name = name.decode("latin-1")
        if name == b"IHDR" and before:
            raise MalformedInputError("appears twice", source=source, place=f"chunk {shown_name}")
        if name in (b"PLTE", b"tRNS") and pixels:
            rule = "must stand before the pixels"
            raise MalformedInputError(rule, source=source, place=f"chunk {shown_name}")
        if name == b"tRNS":
            transparency = window.whole(start, length)
        elif name == b"PLTE":
            palette = window.whole(start, length)
        elif name == b"IDAT":
            if pixels and before != name:
                rule = "other chunks stand between the pixels"
                raise MalformedInputError(rule, source=source, place=f"chunk {shown_name}")
            pixels.add(start, length)
        elif name == b"gAMA" and length == 4:
            display.append(f"a gamma of {int.from_bytes(window.whole(start, 4)) / 100_000:g}")
        elif name == b"iCCP":
            display.append("a colour profile")
        elif name == b"acTL":
            raise MalformedInputError("animated PNG images are not supported", source=source)
        if name != b"IDAT" and (pixels or name in _TEXTS):
            texts[bool(pixels)].append(window.whole(start - 8, length + 12))
        before = name
    colour_type = header.colour_type
    if colour_type == _PALETTE and (not palette or len(palette) % 3 or len(palette) > 768):
        rule = "a palette of 1 to 256 colours must be there"
        raise MalformedInputError(rule, source=source, place="chunk PLTE")
    key_length = {_GREY: 2, _RGB: 6}.get(colour_type)
    if transparency is not None and key_length not in (None, len(transparency)):
        rule = f"the transparent colour takes {key_length} bytes"
        raise MalformedInputError(rule, source=source, place="chunk tRNS", got=len(transparency))
    return PngFacts(
        header.width, header.height, header.bit_depth, colour_type, header.is_interlaced,
        transparency, tuple(display), palette or b"", pixels,
        (b"".join(texts[0]), b"".join(texts[1])),
    )  # fmt: skip


def claim_before_pixels(file: OpenFile) -> None:
    """Claim the memory of the chunks before the pixels, which Pillow reads as wholes."""
    window = _Window(file)
    offset = total = 0
    start = len(SIGNATURE)
    while start + offset + 12 <= file.size:
        length, name = struct.unpack(">I4s", window.some(start + offset, 8))
        if name == b"IDAT":
            break
        offset += 12 + length
        total += min(length, file.size)
    claim(file.path, 2 * total)


class PixelSpans:
    """Where the bodies of the chunks with pixels lie in the file; there may be many."""

    def __init__(self) -> None:
        self.starts = array("Q")
        self.lengths = array("Q")

    def __len__(self) -> int:
        return len(self.starts)

    def add(self, start: int, length: int) -> None:
        """Add the next."""
        self.starts.append(start)
        self.lengths.append(length)


def read_png_header(data: bytes, source: Path) -> PngHeader:
    """Return the header of a PNG file, given its first bytes."""
    body = data[_HEADER]
    if data[_START_OF_HEADER] != struct.pack(">I4s", len(body), b"IHDR") or len(body) != 13:
        raise MalformedInputError("must start with its header", source=source, place="chunk IHDR")
    width, height, bit_depth, colour_type, method, filters, interlace = struct.unpack(
        ">IIBBBBB", body
    )
    if colour_type not in _DEPTHS:
        rule = "is not a PNG colour type"
        raise MalformedInputError(rule, source=source, place="chunk IHDR", got=colour_type)
    if bit_depth not in _DEPTHS[colour_type]:
        rule = f"bits of a sample must be one of {_DEPTHS[colour_type]}"
        raise MalformedInputError(rule, source=source, place="chunk IHDR", got=bit_depth)
    if method or filters or interlace > 1:
        rule = "is compressed, filtered or interlaced by a method that PNG does not define"
        raise MalformedInputError(rule, source=source, place="chunk IHDR")
    return PngHeader(width, height, bit_depth, colour_type, interlace == 1)


class _Window:
    """Some bytes of a file: chunks may be so short that each would be a call of the system."""

    def __init__(self, file: OpenFile) -> None:
        self._file = file
        self._start = 0
        self._data = b""
        self._kept = 0

    def some(self, start: int, count: int) -> memoryview:
        """Return bytes, `_AT_A_TIME` at most; fewer at the end of the file."""
        first = start - self._start
        if first < 0 or first + count > len(self._data):
            self._data = self._file.read(start, _AT_A_TIME)
            self._start, first = start, 0
        return memoryview(self._data)[first : first + count]

    def pieces(self, start: int, count: int) -> Iterator[memoryview]:
        """Yield any number of bytes piece by piece."""
        end = start + count
        while start < end:
            piece = self.some(start, min(end - start, _AT_A_TIME))
            if not piece:
                raise FileAccessError(CHANGED, source=self._file.path)
            yield piece
            start += len(piece)

    def whole(self, start: int, count: int) -> bytes:
        """Return any number of bytes at once, which are kept."""
        self._kept += count
        claim(self._file.path, 3 * self._kept)  # Pillow makes copies
        return b"".join(self.pieces(start, count))


def _chunks(file: OpenFile) -> Iterator[tuple[bytes, int, int, _Window]]:
    """Yield name, start and length of the body of each chunk up to the last, all of it verified.

    With them comes what reads the body.
    """
    window = _Window(file)
    offset = len(SIGNATURE)
    while offset + 12 <= file.size:
        length, name = struct.unpack(">I4s", window.some(offset, 8))
        end = offset + 12 + length
        if end > file.size:
            break
        found = 0
        for piece in window.pieces(offset + 4, 4 + length):
            found = zlib.crc32(piece, found)
        (checksum,) = struct.unpack(">I", window.some(end - 4, 4))
        if found != checksum:
            place = f"chunk {name.decode('latin-1')}"
            raise MalformedInputError("wrong checksum", source=file.path, place=place)
        if name == b"IEND":
            return
        yield name, offset + 8, length, window
        offset = end
    raise MalformedInputError("the PNG file ends early", source=file.path, place=f"byte {offset}")
