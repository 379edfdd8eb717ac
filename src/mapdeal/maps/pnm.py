"""Netpbm images, P1 to P6, read and written without a library.

Libraries disagree on maxval, on comments and on damaged files; ROS maps have them all.

References
----------
The netpbm pages of the formats pbm, pgm and ppm.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError, MapdealWarning, emit_warning
from mapdeal.files.budget import PIECES, claim
from mapdeal.files.source import CHANGED
from mapdeal.kernels.blocks import Layer
from mapdeal.maps.picture import (
    HEAD,
    LARGEST_CELLS,
    ImageFormat,
    OpenFile,
    Picture,
    Samples,
    Strips,
    check_size,
    strips_at_places,
    strips_of,
)

_WHITE = re.compile(rb"[ \t\n\v\f\r]*")
_WORD = re.compile(rb"[^ \t\n\v\f\r#]*")
_COMMENT = re.compile(rb"#[^\n\r]*")
_BLANK = re.compile(rb"[ \t\n\v\f\r]")
_WHOLE_NUMBERS = b"0123456789 \t\n\v\f\r"
_IN_A_LINE = bytes.maketrans(b"\n\r", b"  ")
_MOST_DIGITS = 9
_TEXT_TOGETHER = 1 << 18
_LONGEST_HEADER = 1 << 16
_WRITTEN_TOGETHER = 1 << 20
_TRAILING = 64


@dataclass(frozen=True)
class _Header:
    magic: int
    width: int
    height: int
    maxval: int
    end: int
    """Offset of the byte behind the last number."""
    raw: bytes

    @property
    def channels(self) -> int:
        return 3 if self.magic in (3, 6) else 1


def is_pnm(data: bytes) -> bool:
    """Return whether `data` starts like a netpbm file, PFM and PAM included."""
    return re.match(rb"P[1-7fF](\s|#)", data) is not None


def decode_pnm(data: bytes, source: Path, max_cells: int = LARGEST_CELLS) -> Picture:
    # 1 is black in P1 and P4, as netpbm says; the ROS 1 reader takes bits for grey levels.
    header = _read_header(data, source)
    check_size(source, header.width, header.height, max_cells)
    _claim(len(data), header, source)
    if header.magic > 3:
        return _located(header).picture(_binary_rows(data, header, source), 0, source)
    samples = _plain(data, header, source)
    if header.magic == 1:
        samples = np.where(samples, np.uint8(0), np.uint8(255))
    return Picture(
        "PNM", "rgb" if header.channels == 3 else "grey", samples,
        maxval=255 if header.magic == 1 else header.maxval,
    )  # fmt: skip


def decode_pbm(
    data: bytes, source: Path, *, max_cells: int = LARGEST_CELLS
) -> tuple[NDArray[np.uint8], int]:
    """Return the bits of a P1 or P4 file, packed, and the width of a row in bits."""
    header = _read_header(data, source)
    if header.magic not in (1, 4):
        rule = "must be a bit map, P1 or P4"
        raise MalformedInputError(rule, source=source, place="header", got=f"P{header.magic}")
    check_size(source, header.width, header.height, max_cells)
    _claim(len(data), header, source, keeps_bits=True)
    if header.magic == 1:
        return np.packbits(_plain(data, header, source), axis=1), header.width
    rows = np.frombuffer(_binary_rows(data, header, source), dtype=np.uint8)
    return rows.reshape(header.height, -1), header.width


@dataclass(frozen=True)
class LocatedPixels:
    """Where the pixels of a binary netpbm file lie: of a P4, P5 or P6 file."""

    width: int
    height: int
    maxval: int
    start: int
    channels: int = 1
    is_packed: bool = False

    @property
    def row_bytes(self) -> int:
        if self.is_packed:
            return (self.width + 7) // 8
        return self.width * self.channels * (2 if self.maxval > 255 else 1)

    def picture(self, data: bytes | memoryview, first: int, source: Path) -> Picture:
        """Return the picture of some rows.

        Parameters
        ----------
        data : bytes
            Their bytes.
        first : int
            The first of them, counted from the north.
        source : Path
            The file's name, for messages.

        Raises
        ------
        MalformedInputError
            If a pixel is above maxval.
        """
        if self.is_packed:
            packed = np.frombuffer(data, dtype=np.uint8).reshape(-1, self.row_bytes)
            return Picture("PNM", "grey", brightness_of_bits(packed, self.width))
        samples: Samples = np.frombuffer(data, dtype=np.uint8)
        if self.maxval > 255:
            samples = np.frombuffer(data, dtype=">u2").astype(np.uint16)
        per_row = self.width * self.channels
        check_pixels(samples, self.maxval, first * per_row, source)
        if self.channels == 3:
            samples = samples.reshape(-1, self.width, 3)
            return Picture("PNM", "rgb", samples, maxval=self.maxval)
        return Picture("PNM", "grey", samples.reshape(-1, self.width), maxval=self.maxval)


def _located(header: _Header) -> LocatedPixels:
    is_packed = header.magic == 4
    maxval = 255 if is_packed else header.maxval
    return LocatedPixels(header.width, header.height, maxval, 0, header.channels, is_packed)


def brightness_of_bits(packed: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Return the pixels, shape (H, `width`), of rows of packed bits: 1 is black."""
    bits = np.unpackbits(packed, axis=1, count=width)
    np.subtract(bits, 1, out=bits)  # 0 becomes 255, and 1 becomes 0
    return bits


def check_pixels(samples: Samples, maxval: int, first: int, source: Path) -> None:
    """Refuse samples above `maxval`; `first` is the number of the first of them."""
    if maxval not in (255, 65535) and samples.max() > maxval:
        flat = samples.reshape(-1)
        index = int(np.argmax(flat > maxval))
        raise _above_maxval(int(flat[index]), first + index, maxval, source)


def pnm_comments(head: bytes) -> list[str]:
    r"""Return the comments of a picture's header, given its first bytes."""
    found: list[str] = []
    words = 0  # type, width, height, maxval: behind them there are pixels
    for line in head.split(b"\n"):
        plain, mark, comment = line.partition(b"#")
        words += len(plain.split())
        if mark:
            found.append(comment.decode("latin-1").strip())
        if words >= 4:
            break
    return found


def pnm_size(head: bytes, source: Path, max_cells: int) -> tuple[int, int]:
    """Return height and width, given the first bytes of a file; raises as `decode_pnm` does."""
    header = _read_header(head, source)
    check_size(source, header.width, header.height, max_cells)
    return header.height, header.width


def write_pbm(file: BinaryIO, packed: NDArray[np.uint8], width: int) -> None:
    """Write a P4 file of packed bits, shape (H, ceil(W / 8)), row 0 in the north, 1 black."""
    file.write(f"P4\n{width} {len(packed)}\n".encode())
    _write_rows(file, packed)


def begin_pgm(file: BinaryIO, pixels: Layer, *, comment: str = "") -> Callable[[slice], None]:
    """Begin a P5 file of 8-bit pixels, and return what writes rows of them, row 0 in the south."""
    height, width = pixels.shape
    note = f"# {comment}\n" if comment else ""
    file.write(f"P5\n{note}{width} {height}\n255\n".encode())
    start = file.tell()

    def put(rows: slice) -> None:
        file.seek(start + (height - rows.stop) * width)
        _write_rows(file, pixels[rows][::-1])

    return put


def _write_rows(file: BinaryIO, rows: NDArray[np.uint8]) -> None:
    """Write rows band by band: they may be a view from the last to the first."""
    step = max(1, _WRITTEN_TOGETHER // rows.shape[1])
    bands = (rows[first : first + step] for first in range(0, len(rows), step))
    file.writelines(np.ascontiguousarray(band).data for band in bands)


def _read_header(data: bytes, source: Path) -> _Header:
    kind = data[1:2].decode("latin-1")
    if not data.startswith(b"P") or kind not in list("1234567fF"):
        raise MalformedInputError("is not a netpbm image", source=source)
    if kind not in "123456":
        name = "PAM" if kind == "7" else "PFM"
        raise MalformedInputError(f"{name} images are not supported", source=source)
    magic = int(kind)
    names = ["width", "height"] if magic in (1, 4) else ["width", "height", "maxval"]
    numbers: list[int] = []
    end = 2
    for name in names:
        start, end = _next_word(data, end)
        if start == end:
            raise MalformedInputError("the file ends early", source=source, place=f"header {name}")
        text = data[start:end].decode("latin-1")
        # A width of a million digits is no width, and converting one takes time.
        if not re.fullmatch(r"-?\d{1,12}", text):
            rule = "must be a whole number"
            raise MalformedInputError(rule, source=source, place=f"header {name}", got=text)
        numbers.append(int(text))
    width, height = numbers[:2]
    maxval = numbers[2] if len(numbers) == 3 else 1
    if not 1 <= maxval <= 65535:
        rule = "must lie between 1 and 65535"
        raise MalformedInputError(rule, source=source, place="header maxval", got=maxval)
    return _Header(magic, width, height, maxval, end, data[:end])


def _next_word(data: bytes, start: int) -> tuple[int, int]:
    """Return where the next word begins and ends, behind white space and whole comments."""
    # Both are the same if there is none within the bytes that a header may have.
    limit = start + _LONGEST_HEADER
    while True:
        start = _end_of(_WHITE, data, start, limit)
        after = _end_of(_COMMENT, data, start, limit)
        if after == start:
            return start, _end_of(_WORD, data, start, limit)
        start = after


def _end_of(pattern: re.Pattern[bytes], data: bytes, start: int, limit: int) -> int:
    """Return where what matches a pattern ends; `start` if nothing does."""
    match = pattern.match(data, start, limit)
    return start if match is None else match.end()


def pnm_memory(head: bytes, size: int, source: Path) -> int:
    """Return the bytes that the pixels of a file and their cells take, given its first bytes."""
    # Those of a binary file are read strip by strip.
    header = _read_header(head, source)
    if header.magic <= 3:
        return _bytes_of(size, header)
    per_row = max(header.width, _located(header).row_bytes)
    return header.width * header.height + min(PIECES, 8 * per_row * header.height)


def _claim(
    size: int, header: _Header, source: Path, *, keeps_bits: bool = False
) -> None:  # fmt: skip
    """Refuse a picture whose samples, and the cells that they become, take too much memory."""
    count = _bytes_of(size, header, keeps_bits=keeps_bits)
    claim(source, count, what=f"{header.width} x {header.height} cells")


def _bytes_of(size: int, header: _Header, *, keeps_bits: bool = False) -> int:
    wide = header.maxval > 255
    if header.magic <= 3:  # copies of the text, and the samples with a mark of each
        copies, per_cell = (5, 3) if header.magic == 1 else (2, 1 + header.channels * (1 + wide))
    elif header.magic == 4:
        copies, per_cell = (2, 0) if keeps_bits else (0, 4)
    else:
        copies, per_cell = 0, 1 + (3 * header.channels if wide else 0)
    return (1 + copies) * size + per_cell * header.width * header.height


def _binary_rows(data: bytes, header: _Header, source: Path) -> memoryview:
    """Return the bytes behind the header, checked in number."""
    located = _located(header)
    expected = located.row_bytes * located.height
    start = _start_of_data(data, len(data), header, expected, source)
    _check_length(len(data) - start, expected, data[start + expected :][:_TRAILING], source)
    return memoryview(data)[start : start + expected]


def _start_of_data(data: bytes, size: int, header: _Header, expected: int, source: Path) -> int:
    """Return the offset of the first pixel: one byte behind the header, or two after CR LF."""
    # `data` are the first bytes of the file, `size` is the number of all. A file that went through
    # a DOS text conversion has CR LF ends in its header. If no pixel had the value of a line feed,
    # the pixels came through whole, one byte late.
    if data[header.end : header.end + 1] == b"#":
        # A comment right behind maxval: its line end is the one byte before the pixels.
        line_end = data.find(b"\n", header.end)
        return line_end + 1 if line_end >= 0 else size
    separator = data[header.end : header.end + 2]
    if not separator[:1].isspace():
        if not separator:
            raise MalformedInputError("the file ends after its header", source=source)
        rule = "white space must separate the header from the pixels"
        raise MalformedInputError(rule, source=source, place=f"byte {header.end}")
    start = header.end + 1
    if separator != b"\r\n":
        return start
    length = size - start
    if length == expected + 1:
        text = f"{source}: header: DOS line ends; the pixels are intact and were read"
        emit_warning(MapdealWarning(text, "image.dos-header"), stacklevel=6)
        return start + 1
    if length == expected and b"\r\n" not in header.raw:
        return start  # a lone CR, then a first pixel of value 10
    rule = f"CRLF-damaged: a text conversion has changed the pixels, expected {expected} bytes"
    raise MalformedInputError(rule, source=source, place="pixels", got=length)


def _check_length(actual: int, expected: int, trailing: bytes, source: Path) -> None:
    if actual < expected:
        rule = f"the pixels end early: expected {expected} bytes"
        raise MalformedInputError(rule, source=source, place="pixels", got=actual)
    if actual > expected:
        if is_pnm(trailing.lstrip()):
            raise MalformedInputError("holds more than one picture", source=source)
        text = f"{source}: {actual - expected} bytes after the picture were ignored"
        emit_warning(MapdealWarning(text, "image.trailing-bytes"), stacklevel=6)


def _plain(data: bytes, header: _Header, source: Path) -> Samples:
    """Return the samples of a P1, P2 or P3 file, written as text."""
    count = header.width * header.height * header.channels
    body = data[header.end :]
    if b"#" in body:
        body = _COMMENT.sub(b"", body)
    if header.magic == 1:
        digits = np.frombuffer(body.translate(None, b" \t\n\v\f\r"), dtype=np.uint8)
        is_digit = (digits | 1) == 49
        if not is_digit.all():
            place = f"pixel {int(np.argmin(is_digit))}"
            raise MalformedInputError("a P1 pixel must be 0 or 1", source=source, place=place)
        _check_count(len(digits), count, source)
        return (digits - 48).reshape(header.height, header.width)
    if not body[:1].isspace():
        rule = "white space must separate the header from the pixels"
        raise MalformedInputError(rule, source=source, place=f"byte {header.end}")
    samples = _numbers(body, count, header.maxval, source)
    if header.channels == 3:
        return samples.reshape(header.height, header.width, 3)
    return samples.reshape(header.height, header.width)


def _numbers(body: bytes, count: int, maxval: int, source: Path) -> Samples:
    """Return the numbers of a text, some words at a time: they take much more memory."""
    samples: Samples = np.empty(count, dtype=np.uint8 if maxval <= 255 else np.uint16)
    found = start = 0
    too_large: tuple[int, int] | None = None
    while start < len(body):
        blank = _BLANK.search(body, start + _TEXT_TOGETHER)
        end = blank.start() if blank else len(body)
        some, start = body[start:end], end
        values = _whole_numbers(some, found, maxval, source)
        if too_large is None and values.max(initial=0) > maxval:
            index = int(np.argmax(values > maxval))
            too_large = int(values[index]), found + index
        samples[found : found + len(values)] = values[: max(count - found, 0)]
        found += len(values)
    _check_count(found, count, source)
    if too_large is not None:
        raise _above_maxval(*too_large, maxval, source)
    return samples


def _whole_numbers(text: bytes, first: int, maxval: int, source: Path) -> NDArray[np.int64]:
    """Return the numbers of a text; `first` is the number of the first."""
    if not text.strip():
        return np.empty(0, dtype=np.int64)
    with suppress(ValueError):  # of others than digits, and of too many of them
        if not text.translate(None, _WHOLE_NUMBERS):
            values = np.loadtxt([text.translate(_IN_A_LINE)], dtype=np.int64, ndmin=1)
            if values.max() < 10**_MOST_DIGITS:
                return values
    words = text.split()
    odd = next(i for i, word in enumerate(words) if not word.isdigit() or len(word) > _MOST_DIGITS)
    rule = f"pixels must be whole numbers from 0 to {maxval}"
    got, place = words[odd].decode("latin-1"), f"pixel {first + odd}"
    raise MalformedInputError(rule, source=source, place=place, got=got)


def _check_count(actual: int, expected: int, source: Path) -> None:
    if actual != expected:
        rule = f"must hold {expected} pixel values"
        raise MalformedInputError(rule, source=source, place=f"pixel {min(actual, expected)}",
                                  got=actual)  # fmt: skip


def _above_maxval(value: int, index: int, maxval: int, source: Path) -> MalformedInputError:
    rule = f"pixels must not exceed maxval {maxval}"
    return MalformedInputError(rule, source=source, place=f"pixel {index}", got=value)


@dataclass(frozen=True)
class BinaryRows:
    """The pixels of an open P4, P5 or P6 file, whose rows can be read in any order."""

    file: OpenFile
    located: LocatedPixels

    @property
    def image(self) -> Path:
        return self.file.path

    @property
    def shape(self) -> tuple[int, int]:
        return self.located.height, self.located.width

    def strips(self) -> Strips:
        return self.part(slice(0, self.located.height))

    def part(self, rows: slice) -> Strips:
        north = self.located.height - rows.stop
        shape = (rows.stop - rows.start, self.located.width)
        return strips_at_places(
            shape, self.located.row_bytes,
            lambda first, end: self._picture(north + first, north + end),
        )  # fmt: skip

    def _picture(self, first: int, end: int) -> Picture:
        located = self.located
        count = (end - first) * located.row_bytes
        data = self.file.read(located.start + first * located.row_bytes, count)
        if len(data) < count:
            raise FileAccessError(CHANGED, source=self.image)
        return located.picture(data, first, self.image)

    def sha256(self) -> str:
        return self.file.sha256()


def binary_rows(
    file: OpenFile, head: bytes, max_cells: int = sys.maxsize
) -> BinaryRows | None:  # fmt: skip
    """Return the rows of an open file; None if they are not at known places."""
    header = _read_header(head, file.path)
    if header.magic <= 3:
        return None
    check_size(file.path, header.width, header.height, max_cells)
    located = _located(header)
    count = located.row_bytes * located.height
    start = _start_of_data(head, file.size, header, count, file.path)
    trailing = file.read(start + count, _TRAILING)
    _check_length(file.size - start, count, trailing, file.path)
    return BinaryRows(file, replace(located, start=start))


def _read_strips(file: OpenFile, max_cells: int) -> Strips:
    head = file.read(0, HEAD)
    pnm_size(head, file.path, max_cells)
    rows = binary_rows(file, head, max_cells)
    if rows is None:
        return strips_of(decode_pnm(file.read_whole(), file.path, max_cells))
    height, width = rows.shape
    claim(file.path, _memory(file, head), what=f"{width} x {height} cells")
    return rows.strips()


def _memory(file: OpenFile, head: bytes) -> int:
    return pnm_memory(head, file.size, file.path)


PNM = ImageFormat(
    name="PNM", suffixes=(".pgm", ".pbm", ".ppm", ".pnm"), recognises=is_pnm, read=_read_strips,
    memory=_memory, size=pnm_size, max_cells=LARGEST_CELLS, comments=pnm_comments,
)  # fmt: skip
