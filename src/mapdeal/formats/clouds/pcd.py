"""PCD, the files of the Point Cloud Library: ascii, binary and binary_compressed.

References
----------
The Point Cloud Library's "The PCD (Point Cloud Data) file format", version 0.7.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, emit_warning
from mapdeal.formats.budget import PIECES, claim
from mapdeal.formats.clouds.header import (
    LONGEST_RECORD,
    Record,
    binary_points,
    header_lines,
    whole_number,
)
from mapdeal.formats.source import access_to
from mapdeal.formats.text_rows import read_rows
from mapdeal.kernels.lzf import lzf_expanded
from mapdeal.records import dataclass

_POINTS_TOGETHER = 1 << 17
_KINDS = {"I": "i", "U": "u", "F": "f"}
_SIZES = {"I": (1, 2, 4, 8), "U": (1, 2, 4, 8), "F": (4, 8)}


@dataclass(frozen=True)
class _Header:
    record: Record
    points: int
    encoding: str
    lines: int


def pcd_points(file: BinaryIO, path: Path) -> Iterator[NDArray[np.float64]]:
    """Yield the points of a PCD file, shape (n, 2) or (n, 3), some at a time."""
    # The viewpoint is not applied, as in the Point Cloud Library.
    header = _read_header(file, path)
    axes = header.record.axes(path, "FIELDS")
    if header.encoding == "ascii":
        record = header.record
        columns = [record.place_in_row(column) for column in axes]
        found = 0
        for rows in read_rows(
            file, columns, path=path, first_line=header.lines + 1, most=header.points,
            width=sum(record.counts),
        ):  # fmt: skip
            found += len(rows)
            yield rows
        if found < header.points:
            raise MalformedInputError(f"ends after {found} of {header.points} points", source=path)
    elif header.encoding == "binary":
        yield from binary_points(file, header.record, axes, header.points, path)
    else:
        yield from _compressed_points(file, header, axes, path)
    _warn_of_rest(file, path)


def pcd_figures(path: Path) -> dict[str, Any]:
    """Return encoding, number of points and fields from the header of a PCD file."""
    with access_to(path), path.open("rb") as file:
        header = _read_header(file, path)
    fields = " ".join(header.record.names)
    return {"encoding": header.encoding, "points": header.points, "fields": fields}


def _read_header(file: BinaryIO, path: Path) -> _Header:
    entries: dict[str, list[str]] = {}
    number = 0
    for number, line in header_lines(file, path):
        if not line or line.startswith("#"):
            continue
        key, *words = line.split()
        if key in entries:
            raise MalformedInputError("appears twice", source=path, place=f"line {number}", got=key)
        entries[key] = words
        if key == "DATA":
            break
        if key not in ("VERSION", "FIELDS", "COLUMNS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT",
                       "VIEWPOINT", "POINTS"):  # fmt: skip
            rule = "invalid PCD header line"
            raise MalformedInputError(rule, source=path, place=f"line {number}", got=line)
    encoding = " ".join(entries["DATA"])
    if encoding not in ("ascii", "binary", "binary_compressed"):
        rule = "must be ascii, binary or binary_compressed"
        raise MalformedInputError(rule, source=path, place="DATA", got=encoding)
    return _Header(_record_of(entries, path), _points_of(entries, path), encoding, number)


def _record_of(entries: dict[str, list[str]], path: Path) -> Record:
    names = entries.get("FIELDS", entries.get("COLUMNS"))
    if not names:
        raise MalformedInputError("missing", source=path, place="FIELDS")
    lists = {"COUNT": entries.get("COUNT", ["1"] * len(names))}
    for key in ("SIZE", "TYPE"):
        if key not in entries:
            raise MalformedInputError("missing", source=path, place=key)
        lists[key] = entries[key]
    for key, words in lists.items():
        if len(words) != len(names):
            rule = f"must have {len(names)} entries, as FIELDS has"
            raise MalformedInputError(rule, source=path, place=key, got=" ".join(words))
    types = []
    for kind, size in zip(lists["TYPE"], lists["SIZE"], strict=True):
        if kind not in _KINDS:
            raise MalformedInputError("must be I, U or F", source=path, place="TYPE", got=kind)
        width = whole_number(size, path, "SIZE")
        if width not in _SIZES[kind]:
            rule = f"of type {kind} must be one of {', '.join(map(str, _SIZES[kind]))}"
            raise MalformedInputError(rule, source=path, place="SIZE", got=size)
        types.append(np.dtype(f"<{_KINDS[kind]}{width}"))
    counts = tuple(
        whole_number(word, path, "COUNT", most=LONGEST_RECORD) for word in lists["COUNT"]
    )
    record = Record(tuple(names), tuple(types), counts)
    if not 0 < record.size <= LONGEST_RECORD:
        rule = f"a point must have 1 to {LONGEST_RECORD} bytes"
        raise MalformedInputError(rule, source=path, place="COUNT", got=record.size)
    return record


def _points_of(entries: dict[str, list[str]], path: Path) -> int:
    numbers = {}
    for key in ("WIDTH", "HEIGHT", "POINTS"):
        if key in entries:
            numbers[key] = whole_number(" ".join(entries[key]), path, key)
    if "WIDTH" in numbers and "HEIGHT" in numbers:
        points = numbers["WIDTH"] * numbers["HEIGHT"]
        if numbers.get("POINTS", points) != points:
            rule = f"must be WIDTH x HEIGHT, {points}"
            raise MalformedInputError(rule, source=path, place="POINTS", got=numbers["POINTS"])
        return points
    if "POINTS" not in numbers:
        raise MalformedInputError("missing", source=path, place="POINTS")
    return numbers["POINTS"]


def _compressed_points(
    file: BinaryIO, header: _Header, axes: tuple[int, ...], path: Path
) -> Iterator[NDArray[np.float64]]:
    """Yield points whose columns were stored one after the other, and compressed."""
    record, count = header.record, header.points
    sizes = file.read(8)
    if not sizes and count == 0:
        return
    if len(sizes) < 8:
        raise MalformedInputError("ends before its data", source=path, place="DATA")
    compressed, expanded = struct.unpack("<II", sizes)
    if expanded != record.size * count:
        rule = f"must expand to {record.size * count} bytes"
        raise MalformedInputError(rule, source=path, place="DATA", got=expanded)
    left = os.fstat(file.fileno()).st_size - file.tell()
    if left < compressed:  # asked before memory is taken
        rule = f"ends after {left} of {compressed} bytes"
        raise MalformedInputError(rule, source=path, place="DATA")
    claim(path, compressed + expanded + min(PIECES, expanded), what=f"{count} compressed points")
    data = file.read(compressed)
    bytes_ = lzf_expanded(data, expanded)
    if bytes_ is None:
        raise MalformedInputError("the compressed data are damaged", source=path, place="DATA")
    columns = []
    for column in axes:
        start = record.offset(column) * count
        kind = record.types[column]
        columns.append(bytes_[start : start + kind.itemsize * count].view(kind))
    for first in range(0, count, _POINTS_TOGETHER):
        part = [column[first : first + _POINTS_TOGETHER] for column in columns]
        yield np.stack(part, axis=1).astype(np.float64)


def _warn_of_rest(file: BinaryIO, path: Path) -> None:
    """Warn if there is more than padding behind the data."""
    rest = file.read(1 << 16)
    if rest.strip(b"\0 \r\n\t"):
        text = f"{path}: data after the points are ignored"
        emit_warning(text, stacklevel=2)
