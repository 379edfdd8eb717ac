"""PCD, the files of the Point Cloud Library: ascii, binary and binary_compressed.

References
----------
The Point Cloud Library's "The PCD (Point Cloud Data) file format", version 0.7.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError, emit_warning
from mapdeal.files.budget import PIECES, claim, use_memory
from mapdeal.files.source import access_to, check_readable
from mapdeal.files.text import delimiter_of, first_line, is_number, read_rows
from mapdeal.inputs.kinds import CLOUD, NUMBERS, recognised
from mapdeal.kernels.clouds import lzf_expanded
from mapdeal.maps.npz import NpyHeader, NpzReader, read_npy_header

LONGEST_HEADER = 1 << 20
MOST_POINTS = 1 << 40

_BYTES_TOGETHER = 1 << 22
LONGEST_RECORD = 1 << 16
"""Bytes of a point, at most."""


@dataclass(frozen=True)
class Record:
    """Layout of a point's numbers in a file."""

    names: tuple[str, ...]
    types: tuple[np.dtype[Any], ...]
    counts: tuple[int, ...]

    @property
    def size(self) -> int:
        return sum(t.itemsize * n for t, n in zip(self.types, self.counts, strict=True))

    def axes(self, path: Path, place: str) -> tuple[int, ...]:
        """Return the columns of x, y and, if there is one, z."""
        found = [self.names.index(name) for name in ("x", "y", "z") if name in self.names]
        if not {"x", "y"} <= set(self.names):
            rule = "must name x and y"
            raise MalformedInputError(rule, source=path, place=place, got=" ".join(self.names))
        for column in found:
            if self.counts[column] != 1:
                rule = f"{self.names[column]} must be one number"
                raise MalformedInputError(rule, source=path, place=place, got=self.counts[column])
        return tuple(found)

    def offset(self, column: int) -> int:
        """Return the bytes of a point before a column."""
        before = zip(self.types[:column], self.counts[:column], strict=True)
        return sum(t.itemsize * n for t, n in before)

    def place_in_row(self, column: int) -> int:
        """Return how many numbers of a line come before a column's."""
        return sum(self.counts[:column])


def binary_points(
    file: BinaryIO, record: Record, axes: tuple[int, ...], count: int, path: Path
) -> Iterator[NDArray[np.float64]]:
    """Yield the points of binary records, some at a time, from where a file stands."""
    types = [record.types[column] for column in axes]
    offsets = [record.offset(column) for column in axes]
    are_neighbours = all(
        kind == types[0] and offset == offsets[0] + k * kind.itemsize
        for k, (kind, offset) in enumerate(zip(types, offsets, strict=True))
    )
    names = [str(k) for k in range(len(axes))]
    layout = np.dtype(
        {"names": names, "formats": types, "offsets": offsets, "itemsize": record.size}
    )
    together = max(1, _BYTES_TOGETHER // max(record.size, 8 * len(axes)))
    done = 0
    while done < count:
        want = min(together, count - done)
        data = file.read(want * record.size)
        if len(data) < want * record.size:
            found = done + len(data) // record.size
            raise MalformedInputError(f"ends after {found} of {count} points", source=path)
        points = np.empty((want, len(axes)))
        with np.errstate(invalid="ignore"):  # of a signalling nan, which is one like others
            if are_neighbours:
                first = (want, len(axes)), types[0], data, offsets[0]
                points[:] = np.ndarray(*first, (record.size, types[0].itemsize))
            else:
                rows = np.frombuffer(data, dtype=layout)
                for k in range(len(axes)):
                    points[:, k] = rows[str(k)]
        yield points
        done += want


def header_lines(file: BinaryIO, path: Path) -> Iterator[tuple[int, str]]:
    """Yield number and text of lines as long as they look like a header."""
    read, number = 0, 0
    while True:
        line = file.readline(4096)
        number += 1
        read += len(line)
        if not line or not line.endswith(b"\n") or read > LONGEST_HEADER:
            rule = "the header does not end"
            raise MalformedInputError(rule, source=path, place=f"line {number}")
        yield number, line.decode("latin-1").strip()


def whole_number(text: str, path: Path, place: str, *, most: int = MOST_POINTS) -> int:
    """Return a number of a header, at least 0."""
    if not (text.isascii() and text.isdigit() and int(text[:20]) <= most and len(text) <= 20):
        rule = f"must be a whole number from 0 to {most}"
        raise MalformedInputError(rule, source=path, place=place, got=text)
    return int(text)


_POINTS_TOGETHER = 1 << 17
_MOST_ELEMENTS = 1 << 31
_MOST_LIKELY = 16
_ARRAYS_BYTES_TOGETHER = 1 << 23
_KEY = "points"


def npz_points(path: Path) -> Iterator[NDArray[np.float64]]:
    """Yield the rows of the array `points` of an npz file, or of the only array that it has."""
    with NpzReader(path, _MOST_ELEMENTS) as reader:
        names = reader.names()
        if _KEY not in names and len(names) != 1:
            rule = "must hold an array points, or one array alone"
            raise MalformedInputError(rule, source=path, got=", ".join(sorted(names)))
        yield from reader.rows(_KEY if _KEY in names else names.pop(), 3)


def npy_points(path: Path) -> Iterator[NDArray[np.float64]]:
    """Yield the rows of an npy file, some at a time."""
    # Not through a memory map: a file that gets shorter would end the process.
    with path.open("rb") as file:
        table = _table_of(file, path)
        together = max(1, min(_POINTS_TOGETHER, _ARRAYS_BYTES_TOGETHER // table.row_size))
        for first in range(0, table.height, together):
            yield table.points(first, min(first + together, table.height))


def npy_figures(path: Path) -> dict[str, Any]:
    """Return shape and type from the header of an npy file."""
    with access_to(path), path.open("rb") as file:
        shape, _, dtype, _ = _header_of(file, path)
    return {"shape": " x ".join(map(str, shape)), "type": str(dtype)}


@dataclass(frozen=True)
class _Table:
    """The array of an npy file: where it lies, and which of its columns are x, y and z."""

    file: BinaryIO
    path: Path
    start: int
    dtype: np.dtype[Any]
    height: int
    width: int
    is_fortran: bool

    @property
    def row_size(self) -> int:
        """Bytes that are read for a point, about."""
        return self.dtype.itemsize * (1 if self.is_fortran else self.width)

    def points(self, first: int, stop: int) -> NDArray[np.float64]:
        count = stop - first
        names = self.dtype.names
        if names is not None:
            rows = self._read(first, count)
            columns = [rows[name] for name in ("x", "y", "z") if name in names]
        elif self.is_fortran:
            columns = [
                self._read(k * self.height + first, count) for k in range(min(3, self.width))
            ]
        else:
            used = min(3, self.width)
            numbers = self._read(first * self.width, (count - 1) * self.width + used)
            columns = [numbers[k :: self.width] for k in range(used)]
        with np.errstate(invalid="ignore"):  # of a signalling nan, which is one like others
            return np.stack(columns, axis=1).astype(np.float64)

    def _read(self, element: int, count: int) -> NDArray[Any]:
        self.file.seek(self.start + element * self.dtype.itemsize)
        data = self.file.read(count * self.dtype.itemsize)
        if len(data) < count * self.dtype.itemsize:
            raise FileAccessError("changed while it was read", source=self.path)
        return np.frombuffer(data, dtype=self.dtype)


def _table_of(file: BinaryIO, path: Path) -> _Table:
    shape, is_fortran, dtype, start = _header_of(file, path)
    if dtype.names is not None and len(shape) == 1:
        kinds = {name: dtype[name] for name in ("x", "y", "z") if name in dtype.names}
        is_table = {"x", "y"} <= set(kinds) and all(kind.kind in "iuf" for kind in kinds.values())
        width = 1
    else:
        is_table = dtype.kind in "iuf" and len(shape) == 2 and shape[1] >= 2
        width = shape[1] if is_table else 0
    if not is_table or dtype.hasobject or dtype.itemsize > LONGEST_RECORD:
        rule = "must be numbers of shape (N, 2) or wider, or records with x and y"
        raise MalformedInputError(rule, source=path, got=f"{dtype} of shape {shape}")
    expected = shape[0] * width * dtype.itemsize
    found = os.fstat(file.fileno()).st_size - start
    if not 0 <= expected <= found:
        rule = f"the numbers end early: expected {expected} bytes"
        raise MalformedInputError(rule, source=path, got=found)
    if dtype.names is None and shape[0] in (2, 3) and width > _MOST_LIKELY:
        text = f"{path}: {shape[0]} points of {width} numbers each; is the array transposed?"
        emit_warning(text, stacklevel=2)
    return _Table(file, path, start, dtype, shape[0], width, is_fortran)


def _header_of(file: BinaryIO, path: Path) -> NpyHeader:
    try:
        return read_npy_header(file)
    except ValueError as error:
        raise MalformedInputError(f"is not an npy file: {error}", source=path) from None


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


_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_MOST_PROPERTIES = 1 << 12


@dataclass
class _Element:
    """One kind of things in the file: its name, how many there are, and their properties."""

    name: str
    count: int
    names: list[str] = field(default_factory=list)
    types: list[np.dtype[Any]] = field(default_factory=list)
    list_property: str | None = None

    def record(self) -> Record:
        return Record(tuple(self.names), tuple(self.types), (1,) * len(self.names))


def ply_points(file: BinaryIO, path: Path) -> Iterator[NDArray[np.float64]]:
    """Yield the vertices of a PLY file, shape (n, 2) or (n, 3), some at a time."""
    encoding, elements, lines = _ply_read_header(file, path)
    for element in elements:
        if element.list_property is not None:
            rule = f"the list property {element.list_property} cannot be read past"
            raise MalformedInputError(rule, source=path, place=f"element {element.name}")
        if element.name == "vertex":
            break
        if encoding == "ascii":
            for _ in read_rows(
                file, [0], path=path, first_line=lines + 1, most=element.count
            ):  # fmt: skip
                pass
            lines += element.count
        else:
            _pass_over(file, element, path)
    else:
        raise MalformedInputError("has no element vertex", source=path)
    record = element.record()
    axes = record.axes(path, "element vertex")
    if encoding != "ascii":
        yield from binary_points(file, record, axes, element.count, path)
        return
    found = 0
    for rows in read_rows(
        file, axes, path=path, first_line=lines + 1, most=element.count, width=len(record.names)
    ):
        found += len(rows)
        yield rows
    if found < element.count:
        raise MalformedInputError(f"ends after {found} of {element.count} points", source=path)


def _pass_over(file: BinaryIO, element: _Element, path: Path) -> None:
    size = element.record().size * element.count
    left = os.fstat(file.fileno()).st_size - file.tell()
    if size > left:
        rule = f"ends after {left} of {size} bytes"
        raise MalformedInputError(rule, source=path, place=f"element {element.name}")
    file.seek(size, os.SEEK_CUR)


def ply_figures(path: Path) -> dict[str, Any]:
    """Return encoding, number of points and fields from the header of a PLY file."""
    with access_to(path), path.open("rb") as file:
        encoding, elements, _ = _ply_read_header(file, path)
    vertices = [one for one in elements if one.name == "vertex"]
    fields = " ".join(name for one in vertices for name in one.names)
    return {"encoding": encoding, "points": sum(one.count for one in vertices), "fields": fields}


def _ply_read_header(file: BinaryIO, path: Path) -> tuple[str, list[_Element], int]:
    encoding: str | None = None
    elements: list[_Element] = []
    for number, line in header_lines(file, path):
        place = f"line {number}"
        words = line.split()
        if number == 1:
            if line != "ply":
                raise MalformedInputError("must be ply", source=path, place=place, got=line)
        elif not words or words[0] in ("comment", "obj_info"):
            continue
        elif words[0] == "end_header":
            if encoding is None:
                raise MalformedInputError("missing", source=path, place="format")
            return encoding, elements, number
        elif words[0] == "format":
            encoding = _format_of(words, path, place)
        elif encoding is None:
            rule = "format must stand before the elements"
            raise MalformedInputError(rule, source=path, place=place)
        elif words[0] == "element" and len(words) == 3:
            elements.append(_Element(words[1], whole_number(words[2], path, place)))
        elif words[0] == "property" and elements:
            _add_property(elements[-1], words, encoding, path, place)
        else:
            rule = "invalid PLY header line"
            raise MalformedInputError(rule, source=path, place=place, got=line)
    raise AssertionError  # header_lines ends with an error


def _format_of(words: list[str], path: Path, place: str) -> str:
    if len(words) != 3 or words[1] not in _ORDERS or words[2] != "1.0":
        rule = f"format must be one of {', '.join(_ORDERS)}, version 1.0"
        raise MalformedInputError(rule, source=path, place=place, got=" ".join(words[1:]))
    return words[1]


def _add_property(
    element: _Element, words: list[str], encoding: str, path: Path, place: str
) -> None:
    if len(words) == 5 and words[1] == "list":
        element.list_property = element.list_property or words[4]
        return
    if len(words) != 3 or words[1] not in _TYPES:
        rule = "a property must have a type and a name"
        raise MalformedInputError(rule, source=path, place=place, got=" ".join(words))
    element.names.append(words[2])
    element.types.append(np.dtype(f"{_ORDERS[encoding]}{_TYPES[words[1]]}"))
    if len(element.names) > _MOST_PROPERTIES:
        raise MalformedInputError("too many properties", source=path, place=place)


Points = NDArray[np.float64]


def text_points(file: BinaryIO, path: Path) -> Iterator[Points]:
    """Yield the points of a text, shape (n, 2) or (n, 3), some at a time."""
    # Numbers are separated by white space, commas or semicolons, as the first line of them shows;
    # they are x, y and z, or what a line of names above says. Lines that begin with # are skipped.
    number, start, line = first_line(file)
    if not line:
        return
    delimiter = delimiter_of(line)
    # CloudCompare puts two slashes before its names
    words = [word.strip().strip('"') for word in line.removeprefix("//").split(delimiter)]
    if words and is_number(words[0]):
        if len(words) < 2:
            rule = "must have 2 numbers or more"
            raise MalformedInputError(rule, source=path, place=f"line {number}", got=line)
        columns = list(range(min(3, len(words))))
        file.seek(start)
    else:
        columns = _columns_of(words, line, path, number)
        number += 1
    yield from read_rows(file, columns, path=path, first_line=number, delimiter=delimiter)


def _columns_of(words: list[str], line: str, path: Path, number: int) -> list[int]:
    names = [word.lower() for word in words]
    if not {"x", "y"} <= set(names):
        rule = "must be numbers, or names with x and y among them"
        raise MalformedInputError(rule, source=path, place=f"line {number}", got=line)
    return [names.index(name) for name in ("x", "y", "z") if name in names]


_IN_A_FILE: dict[str, Callable[[BinaryIO, Path], Iterator[Points]]] = {
    ".pcd": pcd_points,
    ".ply": ply_points,
    ".xyz": text_points,
    ".txt": text_points,
    ".csv": text_points,
    ".asc": text_points,
}
_BY_NAME: dict[str, Callable[[Path], Iterator[Points]]] = {".npy": npy_points, ".npz": npz_points}

CLOUD_SUFFIXES = (*_IN_A_FILE, *_BY_NAME)
"""Suffixes of point clouds."""


def cloud_chunks(path: Path) -> Iterator[Points]:
    with recognised(path, "a point cloud", CLOUD, NUMBERS):
        check_readable(path)
        suffix = path.suffix.lower()
        if suffix not in CLOUD_SUFFIXES:
            rule = f"a cloud must end in {', '.join(CLOUD_SUFFIXES)}"
            raise MalformedInputError(rule, source=path, got=path.suffix)
        try:
            if suffix in _BY_NAME:
                yield from _BY_NAME[suffix](path)
            else:
                with path.open("rb") as file:
                    yield from _IN_A_FILE[suffix](file, path)
        except OSError as error:
            rule = f"cannot be read: {error.strerror or error}"
            raise FileAccessError(rule, source=path) from None


def read_cloud(path: Path | str, *, max_memory: int | None = None) -> Points:
    """Read a point cloud.

    Parameters
    ----------
    path : path or str
        PCD (ascii, binary, binary_compressed), PLY (ascii, binary of either byte order), text
        (``.xyz``, ``.txt``, ``.csv``, ``.asc``), ``.npy``, or ``.npz``.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory.

    Returns
    -------
    numpy.ndarray of float64, shape (N, 2) or (N, 3)
        x, y and, if the file has it, z of each point, metres; values that are not finite are kept.

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    MalformedInputError
        If the file is malformed or of another type.
    """
    path, chunks, taken = Path(path), [], 0
    with use_memory(max_memory):
        for chunk in cloud_chunks(path):
            taken += chunk.nbytes
            claim(path, 2 * taken + PIECES)  # parts, and the whole that they make
            chunks.append(chunk)
    return np.concatenate(chunks) if chunks else np.empty((0, 3))
