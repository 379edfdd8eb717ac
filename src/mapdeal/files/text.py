"""Rows of numbers in text, many lines at a time."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import BinaryIO, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError

LONGEST_LINE = 1 << 20
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_BYTES_TOGETHER = 1 << 20
_LINE_FEED = ord("\n")


class _Table(NamedTuple):
    path: Path
    columns: Sequence[int]
    delimiter: str | None
    width: int | None

    @property
    def mark(self) -> bytes | None:
        return None if self.delimiter is None else self.delimiter.encode()


def read_rows(
    file: BinaryIO, columns: Sequence[int], *, path: Path, first_line: int,
    delimiter: str | None = None, most: int | None = None, width: int | None = None,
) -> Iterator[NDArray[np.float64]]:  # fmt: skip
    """Yield columns of a table in blocks of rows; the file then stands behind the last row."""
    table = _Table(path, columns, delimiter, width)
    remaining = most
    while remaining is None or remaining > 0:
        text = file.read(_BYTES_TOGETHER) + file.readline(LONGEST_LINE + 1)
        if not text:
            return
        ends = _ends_of_lines(text, first_line, path)
        count = len(ends) if remaining is None else min(remaining, len(ends))
        plain = text[: ends[count - 1]]
        rows = None if b"#" in plain else _rows_at_once(plain, count, table)
        if rows is None:
            lines = enumerate(map(bytes.strip, io.BytesIO(text)), first_line)
            content = ((number, line) for number, line in lines if line and line[:1] != b"#")
            numbered = list(islice(content, remaining))
            count = numbered[-1][0] + 1 - first_line if len(numbered) == remaining else len(ends)
            rows = _rows_of(numbered, table)
        first_line += count
        if remaining is not None:
            remaining -= len(rows)
            if unread := len(text) - int(ends[count - 1]):
                file.seek(-unread, os.SEEK_CUR)
        if len(rows):
            yield rows


def first_line(file: BinaryIO) -> tuple[int, int, str]:
    # The text is empty if the file has no such line.
    number = 0
    start = file.tell()
    while raw := file.readline(LONGEST_LINE):
        number += 1
        if number == 1 and raw.startswith(BYTE_ORDER_MARK):
            start, raw = start + len(BYTE_ORDER_MARK), raw.removeprefix(BYTE_ORDER_MARK)
        line = raw.decode("latin-1").strip()
        if line and not line.startswith("#"):
            return number, start, line
        start = file.tell()
    return number, start, ""


def delimiter_of(line: str) -> str | None:
    return next((mark for mark in (",", ";") if mark in line), None)


def coordinate_name(word: str) -> str:
    """Return the name of a column, with known spellings of x, y and z replaced."""
    name = word.strip().strip('"').lower()
    # VeloView and ParaView name coordinates Points_m_XYZ:0 to :2, or Points:0 to :2
    part = re.fullmatch(r"points\w*:([012])", name)
    return name if part is None else "xyz"[int(part[1])]


def is_number(word: str | bytes) -> bool:
    text = word.decode("latin-1") if isinstance(word, bytes) else word
    if not text.isascii() or "_" in text:  # Python accepts 1_000 and digits of other scripts
        return False
    try:
        float(text)
    except ValueError:
        return False
    return True


def decimal_without_zeros(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _ends_of_lines(text: bytes, first: int, path: Path) -> NDArray[np.intp]:
    ends = np.flatnonzero(np.frombuffer(text, dtype=np.uint8) == _LINE_FEED) + 1
    if not text.endswith(b"\n"):
        ends = np.append(ends, len(text))
    is_long = np.diff(ends, prepend=0) > LONGEST_LINE
    if is_long.any():
        rule = f"must not be longer than {LONGEST_LINE} bytes"
        place = f"line {first + int(np.argmax(is_long))}"
        raise MalformedInputError(rule, source=path, place=place)
    return ends


def _rows_at_once(text: bytes, count: int, table: _Table) -> NDArray[np.float64] | None:
    """Return the rows of a text; None if it holds other than `count` rows of numbers."""
    if not text or text.decode("latin-1").isspace():
        return None
    columns, width = list(table.columns), table.width
    first_row = text.partition(b"\n")[0].split(table.mark)
    has_all_columns = columns == list(range(width or len(first_row)))
    rows = _parsed(text, table, None) if width is not None or has_all_columns else None
    if rows is None and width is None:
        rows = _parsed(text, table, columns)  # a fifth slower than all columns
    if rows is None or rows.shape != (count, width or len(columns)):
        return None
    return rows if has_all_columns or width is None else rows[:, columns]


def _parsed(text: bytes, table: _Table, columns: list[int] | None) -> NDArray[np.float64] | None:
    lines = io.BytesIO(text)
    try:
        return np.loadtxt(lines, delimiter=table.delimiter, usecols=columns, comments=None, ndmin=2)
    except ValueError:
        return None


def _rows_of(numbered: list[tuple[int, bytes]], table: _Table) -> NDArray[np.float64]:
    if not numbered:
        return np.empty((0, len(table.columns)))
    rows = _rows_at_once(b"\n".join(line for _, line in numbered), len(numbered), table)
    if rows is not None:
        return rows
    for number, line in numbered:
        _check_line(line, number, table)
    # for example a carriage return within a line, which numpy refuses
    place = f"lines {numbered[0][0]} to {numbered[-1][0]}"
    raise MalformedInputError("are not a table of numbers", source=table.path, place=place)


def _check_line(line: bytes, number: int, table: _Table) -> None:
    words = line.split(table.mark)
    needed = max(table.columns) + 1 if table.width is None else table.width
    place = f"line {number}"
    if len(words) < needed or (table.width is not None and len(words) != needed):
        rule = f"must have {needed} numbers" + (" or more" if table.width is None else "")
        got = line.decode("latin-1").strip()
        raise MalformedInputError(rule, source=table.path, place=place, got=got)
    for column in table.columns if table.width is None else range(needed):
        if not is_number(words[column]):
            got = words[column].decode("latin-1").strip()
            raise MalformedInputError("must be a number", source=table.path, place=place, got=got)


_NOISE = 1e-12

Kind = Literal["exact", "single", "integer"]
"""Format of the numbers in a column: `repr`; the fewest digits that identify a float32, else nine,
and 0 for rounding errors; or no decimal point. Numbers that are not finite become ``null``."""


class Form(NamedTuple):
    texts: tuple[str, ...]
    columns: tuple[int, ...]


def row_texts(
    values: NDArray[np.float64], kinds: Sequence[Kind], forms: Sequence[Form],
    chosen: NDArray[np.uint8],
) -> str:  # fmt: skip
    rows = np.empty(len(values), dtype=object)
    for number, form in enumerate(forms):
        has_form = chosen == number
        texts = [_texts(values[has_form, column], kinds[column]) for column in form.columns]
        template = "%s".join(text.replace("%", "%%") for text in form.texts)
        rows[has_form] = [template % row for row in zip(*texts, strict=True)]
    return "".join(rows)


def _texts(values: NDArray[np.float64], kind: Kind) -> list[str]:
    if kind == "single":
        values = np.where(np.abs(values) < _NOISE, 0.0, values)
        with np.errstate(over="ignore", invalid="ignore"):
            single = values.astype(np.float32)
        texts = list(map("%.9g".__mod__, values.tolist()))
        short = np.flatnonzero(single == values)
        for index, text in zip(short.tolist(), single[short].astype(str).tolist(), strict=True):
            texts[index] = text
    elif kind == "integer":
        texts = [f"{value:.0f}" for value in values.tolist()]
    else:
        texts = list(map(repr, values.tolist()))
    for index in np.flatnonzero(~np.isfinite(values)).tolist():
        texts[index] = "null"
    return texts
