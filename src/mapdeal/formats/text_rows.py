"""Rows of numbers in text, many lines at a time."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError
from mapdeal.kernels.numbers import Limits, Rows, compiled_numbers, rows_in

LONGEST_LINE = 1 << 20
_MARK = b"\xef\xbb\xbf"
_LINES_TOGETHER, _BYTES_TOGETHER = 1 << 16, 1 << 22
_LONGEST_BLOCK = _BYTES_TOGETHER + LONGEST_LINE + 1
_FIRST_BLOCK = 1 << 16


def read_rows(
    file: BinaryIO,
    columns: Sequence[int],
    *,
    path: Path,
    first_line: int,
    delimiter: str | None = None,
    most: int | None = None,
    width: int | None = None,
) -> Iterator[NDArray[np.float64]]:
    """Yield columns of a table, some rows at a time."""
    left = most
    blocks = _Blocks(file, columns, delimiter, width)
    while left is None or left > 0:
        together = _LINES_TOGETHER if left is None else min(left, _LINES_TOGETHER)
        block = blocks.read(together)
        if block is not None:
            if not block.lines:
                return
            first_line += block.lines
            if left is not None:
                left -= len(block.values)
            if len(block.values):
                yield block.values
            continue
        lines = _some_lines(file, path, first_line, together)
        if not lines:
            return
        numbered = [
            (number, line)
            for number, line in enumerate(lines, start=first_line)
            if line.strip() and not line.lstrip().startswith(b"#")
        ]
        first_line += len(lines)
        if left is not None:
            left -= len(numbered)
        if numbered:
            yield _numbers_of(numbered, columns, path, delimiter, width)


class _Blocks:
    """Reads blocks of lines at once, where they are nothing but rows of numbers.

    A block ends where lines that are read one by one are taken together: whichever way they are
    read, rows come in the same parts, and errors name the same lines.
    """

    def __init__(
        self, file: BinaryIO, columns: Sequence[int], delimiter: str | None, width: int | None
    ) -> None:
        self._file = file
        self._columns = list(columns)
        self._delimiter = delimiter
        self._width = width
        self._length = _FIRST_BLOCK
        self._is_possible = compiled_numbers() is not None and file.seekable()

    def read(self, most: int) -> Rows | None:
        """Return the rows of at most so many lines, and leave the file behind them.

        None if they must be read one by one; the file is then left where it was.
        """
        if not self._is_possible:
            return None
        start = self._file.tell()
        rows = self._rows_of(self._file.read(self._length), most)
        if rows is None and self._length < _LONGEST_BLOCK:
            self._length = _LONGEST_BLOCK
            self._file.seek(start)
            rows = self._rows_of(self._file.read(self._length), most)
        if rows is None:
            self._file.seek(start)
            return None
        self._file.seek(start + rows.length)
        # the next block is about as long
        self._length = min(_LONGEST_BLOCK, rows.length + rows.length // 8 + _FIRST_BLOCK)
        if self._columns == list(range(rows.values.shape[1])):
            return rows
        return rows._replace(values=rows.values[:, self._columns])

    def _rows_of(self, text: bytes, most: int) -> Rows | None:
        """Return the rows that a text begins with; None if it is too short, or anything else."""
        is_last = len(text) < self._length
        rows = rows_in(
            text if is_last else memoryview(text)[: text.rfind(b"\n") + 1],
            max(self._columns) + 1 if self._width is None else self._width,
            delimiter=self._delimiter,
            is_exact=self._width is not None,
            limits=Limits(most, _BYTES_TOGETHER, LONGEST_LINE),
        )
        if rows is None or is_last or rows.lines == most or rows.length >= _BYTES_TOGETHER:
            return rows
        return None


def first_line(file: BinaryIO) -> tuple[int, int, str]:
    """Return number, place in the file and text of the first line that is no comment.

    The text is empty if there is none.
    """
    number = 0
    start = file.tell()
    while raw := file.readline(LONGEST_LINE):
        number += 1
        if number == 1 and raw.startswith(_MARK):
            start, raw = start + len(_MARK), raw.removeprefix(_MARK)
        line = raw.decode("latin-1").strip()
        if line and not line.startswith("#"):
            return number, start, line
        start = file.tell()
    return number, start, ""


def delimiter_of(line: str) -> str | None:
    """Return what separates the numbers of a line: a comma, a semicolon, or white space (None)."""
    return next((mark for mark in (",", ";") if mark in line), None)


def is_number(word: str | bytes) -> bool:
    """Return whether a word is a number, as other languages write them, too."""
    text = word.decode("latin-1") if isinstance(word, bytes) else word
    if not text.isascii() or "_" in text:  # which Python reads as digits, too
        return False
    try:
        float(text)
    except ValueError:
        return False
    return True


def _some_lines(file: BinaryIO, path: Path, number: int, most: int) -> list[bytes]:
    """Return the next lines: at most so many, and not many more bytes than are read together."""
    lines: list[bytes] = []
    length = 0
    while len(lines) < most and length < _BYTES_TOGETHER:
        line = file.readline(LONGEST_LINE + 1)
        if not line:
            break
        if len(line) > LONGEST_LINE:
            rule = f"must not be longer than {LONGEST_LINE} bytes"
            place = f"line {number + len(lines)}"
            raise MalformedInputError(rule, source=path, place=place)
        lines.append(line)
        length += len(line)
    return lines


def _numbers_of(
    numbered: list[tuple[int, bytes]],
    columns: Sequence[int],
    path: Path,
    delimiter: str | None,
    width: int | None,
) -> NDArray[np.float64]:
    """Return the numbers of lines: all at once, or, if that fails, one error for one line."""
    text = io.BytesIO(b"\n".join(line.rstrip() for _, line in numbered))
    kept = columns if width is None else None
    try:
        numbers = np.loadtxt(text, delimiter=delimiter, usecols=kept, comments=None, ndmin=2)
    except ValueError:
        for number, line in numbered:
            _check_line(line, columns, path, number, delimiter, width)
        raise _no_table(numbered, path) from None
    if len(numbers) != len(numbered):  # numpy takes a carriage return alone for a line's end
        raise _no_table(numbered, path)
    if width is None:
        return numbers
    if numbers.shape[1] != width:
        _check_line(numbered[0][1], columns, path, numbered[0][0], delimiter, width)
    return numbers[:, list(columns)]


def _no_table(numbered: list[tuple[int, bytes]], path: Path) -> MalformedInputError:
    place = f"lines {numbered[0][0]} to {numbered[-1][0]}"
    return MalformedInputError("are not a table of numbers", source=path, place=place)


def _check_line(
    line: bytes,
    columns: Sequence[int],
    path: Path,
    number: int,
    delimiter: str | None,
    width: int | None,
) -> None:
    words = line.split(None if delimiter is None else delimiter.encode())
    needed = max(columns) + 1 if width is None else width
    place = f"line {number}"
    if len(words) < needed or (width is not None and len(words) != width):
        rule = f"must have {needed} numbers" + (" or more" if width is None else "")
        got = line.decode("latin-1").strip()
        raise MalformedInputError(rule, source=path, place=place, got=got)
    for column in columns if width is None else range(width):
        if not is_number(words[column]):
            got = words[column].decode("latin-1").strip()
            raise MalformedInputError("must be a number", source=path, place=place, got=got)
