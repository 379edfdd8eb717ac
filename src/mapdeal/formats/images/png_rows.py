"""The rows of PNG files: inflated and unfiltered some at a time, from the start or on from a mark.

Pillow undoes the filters: a strip, with the row before it as its first, is a picture of its own.
Filters know bytes, not pixels. So what Pillow is given are bytes in one to four channels, and what
a pixel of 1, 2, 4 or 16 bits is follows from them.

References
----------
Portable Network Graphics (PNG) Specification, W3C: filtering, and the representation of pixels.
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_right
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.formats.images.png_chunks import PngFacts, PngHeader
from mapdeal.formats.open_file import OpenFile
from mapdeal.formats.source import CHANGED
from mapdeal.formats.strips import STRIP, rows_of_strip
from mapdeal.records import dataclass

_INFLATER = 48_000
"""Bytes that the state of a decompressor takes."""

_SHARE_OF_MARKS = 64
"""Bytes of rows for each byte of the marks among them."""

_STORED = 65535
_AT_A_TIME = 1 << 18
_MODES = {1: "L", 2: "LA", 3: "RGB", 4: "RGBA"}
_LARGEST_FILTER = 4


@dataclass(frozen=True)
class _Mark:
    """Where to go on in a file."""

    row: int
    inflater: Any
    span: int
    offset: int
    before: NDArray[np.uint8]


class PngBytes:
    """The bytes of the pixels in a PNG file that is not interlaced, without its filters.

    Notes
    -----
    Of colours of 16 bits only the higher byte is there.
    """

    def __init__(self, file: OpenFile, facts: PngFacts) -> None:
        self._file = file
        self._facts = facts
        self._marks: list[_Mark] = []
        self._row_bytes = facts.row_bytes
        self._step = rows_of_strip(facts.width, self._row_bytes)
        # Bytes at the same place in pixels depend on each other alone, so half of them can go.
        self._is_halved = facts.bit_depth == 16 and facts.bits > 16
        lane_bytes = max(facts.bits // 8, 1) // (2 if self._is_halved else 1)
        self._lanes = lane_bytes
        self._columns = (self._row_bytes - 1) // (2 if self._is_halved else 1) // lane_bytes

    def all(self, *, leaves_marks: bool = False) -> Iterator[NDArray[np.uint8]]:
        """Yield all rows, some at a time, each of shape (rows, bytes)."""
        height = self._facts.height
        bytes_between = _SHARE_OF_MARKS * (_INFLATER + self._row_bytes)
        between = max(self._step, bytes_between // self._row_bytes)
        marks: list[_Mark] = []
        stream = _Stream(self._file, self._facts)
        before = self._nothing()
        for first in range(0, height, self._step):
            if leaves_marks and (not marks or first - marks[-1].row >= between):
                marks.append(stream.mark(first, before))
            rows = self._next(stream, min(self._step, height - first), before)
            before = rows[-1]
            yield rows
        stream.check_end()
        if leaves_marks:
            self._marks = marks

    def some(self, first: int, end: int) -> Iterator[NDArray[np.uint8]]:
        """Yield some rows, counted from the north; `all` must have left its marks."""
        index = bisect_right(self._marks, first, key=lambda mark: mark.row) - 1
        mark = self._marks[index]
        stream = _Stream(self._file, self._facts, mark)
        row, before = mark.row, mark.before
        while row < end:
            count = min(self._step, end - row)
            rows = self._next(stream, count, before)
            before = rows[-1]
            if row + count > first:
                yield rows[max(first - row, 0) :]
            row += count

    @property
    def has_marks(self) -> bool:
        """Whether `some` can be called."""
        return bool(self._marks)

    def _nothing(self) -> NDArray[np.uint8]:
        return np.zeros(self._lanes * self._columns, dtype=np.uint8)

    def _next(
        self, stream: _Stream, count: int, before: NDArray[np.uint8]
    ) -> NDArray[np.uint8]:  # fmt: skip
        filtered = np.empty((count + 1, 1 + len(before)), dtype=np.uint8)
        filtered[0, 0] = 0
        filtered[0, 1:] = before
        rows = np.frombuffer(stream.read(count * self._row_bytes), dtype=np.uint8)
        rows = rows.reshape(count, self._row_bytes)
        if rows[:, 0].max() > _LARGEST_FILTER:
            rule = "the image is damaged: a row has a filter that PNG does not know"
            raise MalformedInputError(rule, source=self._file.path, got=int(rows[:, 0].max()))
        if self._is_halved:
            filtered[1:, 0] = rows[:, 0]
            filtered[1:, 1:] = rows[:, 1::2]
        else:
            filtered[1:] = rows
        return self._unfiltered(filtered)[1:]

    def _unfiltered(self, filtered: NDArray[np.uint8]) -> NDArray[np.uint8]:
        if not filtered[:, 0].any():
            return filtered[:, 1:]
        from PIL import Image

        mode, size = _MODES[self._lanes], (self._columns, len(filtered))
        image = Image.frombytes(mode, size, _stored(filtered.data.cast("B")), "zip", mode)
        return np.asarray(image).reshape(len(filtered), -1)


def check_passes(file: OpenFile, facts: PngFacts) -> None:
    """Refuse pixels that end early, in whatever passes they come: what is inflated is dropped."""
    stream = _Stream(file, facts)
    left = facts.inflated_size
    while left:
        left -= len(stream.read(min(left, STRIP)))
    stream.check_end()


def marks_memory(facts: PngHeader) -> int:
    """Return the bytes that marks take, at most."""
    total = facts.height * facts.row_bytes
    return total // _SHARE_OF_MARKS + _INFLATER + facts.row_bytes


def strip_memory(facts: PngHeader) -> int:
    """Return the bytes that decoding a strip takes, at most."""
    rows = min(rows_of_strip(facts.width, facts.row_bytes), facts.height) + 1
    return rows * (6 * facts.row_bytes + 4 * facts.width)


class _Stream:
    """The inflated bytes of a file, from its start or from a mark on."""

    def __init__(self, file: OpenFile, facts: PngFacts, mark: _Mark | None = None) -> None:
        self._file = file
        self._facts = facts
        self._spans = facts.pixels
        self._inflater = zlib.decompressobj() if mark is None else mark.inflater.copy()
        self._span = 0 if mark is None else mark.span
        self._offset = 0 if mark is None else mark.offset
        self._rest = b""
        self._found = 0

    def mark(self, row: int, before: NDArray[np.uint8]) -> _Mark:
        """Return what to go on from, at a row; `before` is the one before it."""
        offset = self._offset - len(self._rest)
        return _Mark(row, self._inflater.copy(), self._span, offset, before.copy())

    def read(self, count: int) -> bytes:
        """Return the next bytes."""
        data = b"".join(self._inflated(count))
        self._found += len(data)
        if len(data) < count:
            expected = self._facts.inflated_size
            rule = f"the pixels end early: expected {expected} bytes"
            raise MalformedInputError(rule, source=self._file.path, place="pixels", got=self._found)
        return data

    def check_end(self) -> None:
        """Refuse pixels whose checksum is wrong or missing; of what follows them, look at some."""
        left = STRIP - sum(map(len, self._inflated(STRIP)))
        if left and not self._inflater.eof:
            rule = "the pixels are damaged: their checksum is missing"
            raise MalformedInputError(rule, source=self._file.path)

    def _inflated(self, count: int) -> Iterator[bytes]:
        """Yield that many bytes, piece by piece, or as many as there are."""
        while count > 0 and not self._inflater.eof:
            data = self._rest or self._compressed()
            try:
                piece = self._inflater.decompress(data, count)
            except zlib.error as error:
                rule = f"the pixels are damaged: {error}"
                raise MalformedInputError(rule, source=self._file.path) from None
            self._rest = self._inflater.unconsumed_tail
            if not piece and not data:
                return
            count -= len(piece)
            yield piece

    def _compressed(self) -> bytes:
        """Return the next compressed bytes of a chunk; none behind the last."""
        lengths = self._spans.lengths
        while self._span < len(lengths) and self._offset == lengths[self._span]:
            self._span, self._offset = self._span + 1, 0
        if self._span == len(lengths):
            return b""
        start = self._spans.starts[self._span] + self._offset
        count = min(lengths[self._span] - self._offset, _AT_A_TIME)
        data = self._file.read(start, count)
        if len(data) < count:
            raise FileAccessError(CHANGED, source=self._file.path)
        self._offset += count
        return data


def _stored(view: memoryview) -> bytes:
    """Return a zlib stream of bytes that are not compressed; zlib's own level 0 takes longer."""
    parts: list[bytes | memoryview] = [b"\x78\x01"]
    for start in range(0, len(view), _STORED):
        block = view[start : start + _STORED]
        is_last = start + _STORED >= len(view)
        parts += (struct.pack("<BHH", is_last, len(block), len(block) ^ _STORED), block)
    parts.append(zlib.adler32(view).to_bytes(4))
    return b"".join(parts)
