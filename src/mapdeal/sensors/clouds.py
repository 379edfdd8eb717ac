"""Point clouds in PCD, PLY, KITTI, OctoMap, text, npy and npz files.

References
----------
The Point Cloud Library's "The PCD (Point Cloud Data) file format", version 0.7. The development
kit of the KITTI odometry benchmark, ``readme.txt``: ``.bin`` has four float32 for each point.
OctoMap's ``OccupancyOcTreeBase::readBinaryNode`` and ``OcTreeBaseImpl::readNodesRecurs``: points of
octrees are the centres of their occupied voxels.
"""

from __future__ import annotations

import itertools
import os
import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from mapdeal.errors import FileAccessError, MalformedInputError, emit_warning
from mapdeal.files.source import PIECES, binary_file, check_readable, claim, use_memory
from mapdeal.files.text import coordinate_name, delimiter_of, first_line, is_number, read_rows
from mapdeal.kernels.arrays import Array, Floats, Integers, Mask
from mapdeal.kernels.sensing import lzf_expanded
from mapdeal.maps import kinds, npz
from mapdeal.records import dataclass, field

_LONGEST_HEADER = 1 << 20
_MOST_POINTS = 1 << 40
_POINTS_TOGETHER = 1 << 17
_BYTES_TOGETHER = 1 << 22
_LONGEST_RECORD = 1 << 16  # bytes of a point, at most


@dataclass
class Record:
    names: list[str] = field(default_factory=list)
    types: list[np.dtype[Any]] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)

    @property
    def size(self) -> int:
        return self.offset(len(self.names))

    def axes(self, place: str) -> tuple[int, ...]:
        names = [coordinate_name(name) for name in self.names]
        columns = tuple(names.index(name) for name in ("x", "y", "z") if name in names)
        if not {"x", "y"} <= set(names):
            raise MalformedInputError("must name x and y", place=place, got=" ".join(self.names))
        for column in columns:
            if self.counts[column] != 1:
                rule = f"{self.names[column]} must be one number"
                raise MalformedInputError(rule, place=place, got=self.counts[column])
        return columns

    def offset(self, column: int) -> int:
        preceding = zip(self.types[:column], self.counts[:column], strict=True)
        return sum(kind.itemsize * count for kind, count in preceding)


def _binary_points(
    file: BinaryIO, record: Record, axes: tuple[int, ...], count: int
) -> Iterator[Floats]:
    part_size = max(1, _BYTES_TOGETHER // max(record.size, 8 * len(axes)))
    for start in range(0, count, part_size):
        size = min(part_size, count - start)
        data = file.read(size * record.size)
        if len(data) < size * record.size:
            found = start + len(data) // record.size
            raise MalformedInputError(f"ends after {found} of {count} points")
        points = np.empty((size, len(axes)))
        with np.errstate(invalid="ignore"):  # conversion of a signalling nan
            for k, column in enumerate(axes):
                place = record.types[column], data, record.offset(column), (record.size,)
                points[:, k] = np.ndarray(size, *place)
        yield points


def _counted_points(
    file: BinaryIO, path: Path, columns: Sequence[int], lines: int, count: int, **form: Any
) -> Iterator[Floats]:
    """Yield so many points behind the first lines; refuse a file that ends before."""
    found = 0
    for rows in read_rows(file, columns, path=path, first_line=lines + 1, most=count, **form):
        found += len(rows)
        yield rows
    if found < count:
        raise MalformedInputError(f"ends after {found} of {count} points")


def _header_lines(file: BinaryIO) -> Iterator[tuple[int, str]]:
    length = 0
    for number in itertools.count(1):
        line = file.readline(4096)
        length += len(line)
        if not line.endswith(b"\n") or length > _LONGEST_HEADER:
            raise MalformedInputError("the header does not end", place=f"line {number}")
        yield number, line.decode("latin-1").strip()


def _whole_number(text: str, place: str, *, most: int = _MOST_POINTS) -> int:
    if not (text.isascii() and text.isdigit() and int(text[:20]) <= most and len(text) <= 20):
        raise MalformedInputError(f"must be a whole number from 0 to {most}", place=place, got=text)
    return int(text)


_MOST_ELEMENTS = 1 << 31
_MOST_LIKELY = 16
_KEY = "points"


def _npz_points(_: BinaryIO, path: Path) -> Iterator[Floats]:
    with npz.NpzReader(path, _MOST_ELEMENTS) as reader:
        names = reader.names()
        if _KEY not in names and len(names) != 1:
            rule = "must hold an array points, or one array alone"
            raise MalformedInputError(rule, source=path, got=", ".join(sorted(names)))
        yield from reader.rows(_KEY if _KEY in names else names.pop(), 3)


def _npy_points(file: BinaryIO, path: Path) -> Iterator[Floats]:
    # A memory map would crash the process if another program truncates the file.
    shape, is_fortran, dtype, start = header = _npy_header(file)
    axes = [name for name in ("x", "y", "z") if name in (dtype.names or ())]
    is_table = dtype.kind in "iuf" and len(shape) == 2 and shape[1] >= 2
    are_records = len(shape) == 1 and axes[:2] == ["x", "y"]
    are_records = are_records and all(dtype[name].kind in "iuf" for name in axes)
    if not (is_table or are_records) or dtype.hasobject or dtype.itemsize > _LONGEST_RECORD:
        rule = "must be numbers of shape (N, 2) or wider, or records with x and y"
        raise MalformedInputError(rule, got=f"{dtype} of shape {shape}")
    found = os.fstat(file.fileno()).st_size - start
    if not 0 <= header.nbytes <= found:
        rule = f"the numbers end early: expected {header.nbytes} bytes"
        raise MalformedInputError(rule, got=found)
    height, width = shape[0], shape[1] if is_table else 1
    if is_table and height in (2, 3) and width > _MOST_LIKELY:
        numbers = f"{height} points of {width} numbers each"
        emit_warning(f"{path}: {numbers}; is the array transposed?")

    def read(element: int, count: int) -> Array:
        file.seek(start + element * dtype.itemsize)
        data = file.read(count * dtype.itemsize)
        if len(data) < count * dtype.itemsize:
            raise FileAccessError("changed while it was read", source=path)
        return np.frombuffer(data, dtype)

    row_size = dtype.itemsize * (1 if is_fortran else width)
    part_size = max(1, min(_POINTS_TOGETHER, _BYTES_TOGETHER // row_size))
    for first in range(0, height, part_size):
        count = min(part_size, height - first)
        if are_records:
            records = read(first, count)
            columns = [records[name] for name in axes]
        elif is_fortran:
            columns = [read(k * height + first, count) for k in range(min(3, width))]
        else:
            columns = [*read(first * width, count * width).reshape(count, width)[:, :3].T]
        with np.errstate(invalid="ignore"):  # conversion of a signalling nan
            yield np.stack(columns, axis=1).astype(np.float64)


def _npy_header(file: BinaryIO) -> npz.NpyHeader:
    try:
        return npz.read_npy_header(file)
    except ValueError as error:
        raise MalformedInputError(f"is not an npy file: {error}") from None


# numpy's letter for each type, and the permitted sizes, bytes.
_PCD_TYPES = {"I": ("i", (1, 2, 4, 8)), "U": ("u", (1, 2, 4, 8)), "F": ("f", (4, 8))}
_PCD_KEYS = ("VERSION", "FIELDS", "COLUMNS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT",
             "VIEWPOINT", "POINTS")  # fmt: skip


def _pcd_points(file: BinaryIO, path: Path) -> Iterator[Floats]:
    # Like the Point Cloud Library, this ignores the viewpoint.
    record, count, encoding, lines = _read_pcd_header(file)
    axes = record.axes("FIELDS")
    if encoding == "ascii":
        columns, width = [sum(record.counts[:column]) for column in axes], sum(record.counts)
        yield from _counted_points(file, path, columns, lines, count, width=width)
    elif encoding == "binary":
        yield from _binary_points(file, record, axes, count)
    else:
        yield from _compressed_points(file, record, axes, count, path)
    if file.read(1 << 16).strip(b"\0 \r\n\t"):  # these are padding
        emit_warning(f"{path}: data after the points are ignored")


def _read_pcd_header(file: BinaryIO) -> tuple[Record, int, str, int]:
    """Return the layout and the number of points, their encoding, and the number of lines."""
    entries: dict[str, list[str]] = {}
    number = 0
    for number, line in _header_lines(file):
        if not line or line.startswith("#"):
            continue
        key, *words = line.split()
        if key in entries:
            raise MalformedInputError("appears twice", place=f"line {number}", got=key)
        entries[key] = words
        if key == "DATA":
            break
        if key not in _PCD_KEYS:
            raise MalformedInputError("invalid PCD header line", place=f"line {number}", got=line)
    encoding = " ".join(entries["DATA"])
    if encoding not in ("ascii", "binary", "binary_compressed"):
        rule = "must be ascii, binary or binary_compressed"
        raise MalformedInputError(rule, place="DATA", got=encoding)
    return _record_of(entries), _number_of_points(entries), encoding, number


def _record_of(entries: dict[str, list[str]]) -> Record:
    if not (names := entries.get("FIELDS", entries.get("COLUMNS"))):
        raise MalformedInputError("missing", place="FIELDS")
    lists = {"COUNT": ["1"] * len(names), **entries}
    for key in ("SIZE", "TYPE", "COUNT"):
        if key not in lists:
            raise MalformedInputError("missing", place=key)
        if len(lists[key]) != len(names):
            rule = f"must have {len(names)} entries, as FIELDS has"
            raise MalformedInputError(rule, place=key, got=" ".join(lists[key]))
    types = []
    for kind, size in zip(lists["TYPE"], lists["SIZE"], strict=True):
        if kind not in _PCD_TYPES:
            raise MalformedInputError("must be I, U or F", place="TYPE", got=kind)
        letter, sizes = _PCD_TYPES[kind]
        if _whole_number(size, "SIZE") not in sizes:
            rule = f"of type {kind} must be one of {', '.join(map(str, sizes))}"
            raise MalformedInputError(rule, place="SIZE", got=size)
        types.append(np.dtype(f"<{letter}{int(size)}"))
    counts = [_whole_number(word, "COUNT", most=_LONGEST_RECORD) for word in lists["COUNT"]]
    record = Record(names, types, counts)
    if not 0 < record.size <= _LONGEST_RECORD:
        rule = f"a point must have 1 to {_LONGEST_RECORD} bytes"
        raise MalformedInputError(rule, place="COUNT", got=record.size)
    return record


def _number_of_points(entries: dict[str, list[str]]) -> int:
    keys = [key for key in ("WIDTH", "HEIGHT", "POINTS") if key in entries]
    numbers = {key: _whole_number(" ".join(entries[key]), key) for key in keys}
    if keys[:2] == ["WIDTH", "HEIGHT"]:
        points = numbers["WIDTH"] * numbers["HEIGHT"]
        if numbers.setdefault("POINTS", points) != points:
            rule = f"must be WIDTH x HEIGHT, {points}"
            raise MalformedInputError(rule, place="POINTS", got=numbers["POINTS"])
    if "POINTS" not in numbers:
        raise MalformedInputError("missing", place="POINTS")
    return numbers["POINTS"]


def _compressed_points(
    file: BinaryIO, record: Record, axes: tuple[int, ...], count: int, path: Path
) -> Iterator[Floats]:
    sizes = file.read(8)
    if not sizes and count == 0:
        return
    if len(sizes) < 8:
        raise MalformedInputError("ends before its data", place="DATA")
    compressed, length = struct.unpack("<II", sizes)
    if length != record.size * count:
        rule = f"must expand to {record.size * count} bytes"
        raise MalformedInputError(rule, place="DATA", got=length)
    remaining = os.fstat(file.fileno()).st_size - file.tell()
    if remaining < compressed:  # before memory is allocated
        raise MalformedInputError(f"ends after {remaining} of {compressed} bytes", place="DATA")
    claim(path, compressed + length + min(PIECES, length), what=f"{count} compressed points")
    if (data := lzf_expanded(file.read(compressed), length)) is None:
        raise MalformedInputError("the compressed data are damaged", place="DATA")
    columns = []
    for column in axes:
        start, kind = record.offset(column) * count, record.types[column]
        columns.append(data[start : start + kind.itemsize * count].view(kind))
    for first in range(0, count, _POINTS_TOGETHER):
        part = [column[first : first + _POINTS_TOGETHER] for column in columns]
        yield np.stack(part, axis=1).astype(np.float64)


_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_PLY_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_MOST_PROPERTIES = 1 << 12


@dataclass
class _Element:
    name: str
    count: int
    record: Record = field(default_factory=Record)
    list_property: str | None = None


def _ply_points(file: BinaryIO, path: Path) -> Iterator[Floats]:
    encoding, elements, lines = _read_ply_header(file)
    for element in elements:
        record, count, place = element.record, element.count, f"element {element.name}"
        if element.list_property is not None:
            rule = f"the list property {element.list_property} cannot be read past"
            raise MalformedInputError(rule, place=place)
        if element.name == "vertex":
            axes = record.axes(place)
            if encoding == "ascii":
                yield from _counted_points(file, path, axes, lines, count, width=len(record.names))
            else:
                yield from _binary_points(file, record, axes, count)
            return
        if encoding == "ascii":
            for _ in read_rows(file, [0], path=path, first_line=lines + 1, most=count):
                pass
            lines += count
        else:
            size, remaining = record.size * count, os.fstat(file.fileno()).st_size - file.tell()
            if size > remaining:
                raise MalformedInputError(f"ends after {remaining} of {size} bytes", place=place)
            file.seek(size, os.SEEK_CUR)
    raise MalformedInputError("has no element vertex")


def _read_ply_header(file: BinaryIO) -> tuple[str, list[_Element], int]:
    encoding: str | None = None
    elements: list[_Element] = []
    for number, line in _header_lines(file):
        place, words = f"line {number}", line.split()
        if number == 1:
            if line != "ply":
                raise MalformedInputError("must be ply", place=place, got=line)
        elif not words or words[0] in ("comment", "obj_info"):
            continue
        elif words[0] == "end_header":
            if encoding is None:
                raise MalformedInputError("missing", place="format")
            return encoding, elements, number
        elif words[0] == "format":
            if len(words) != 3 or words[1] not in _PLY_ORDERS or words[2] != "1.0":
                rule = f"format must be one of {', '.join(_PLY_ORDERS)}, version 1.0"
                raise MalformedInputError(rule, place=place, got=" ".join(words[1:]))
            encoding = words[1]
        elif encoding is None:
            raise MalformedInputError("format must stand before the elements", place=place)
        elif words[0] == "element" and len(words) == 3:
            elements.append(_Element(words[1], _whole_number(words[2], place)))
        elif words[0] == "property" and elements:
            _add_property(elements[-1], words, encoding, place)
        else:
            raise MalformedInputError("invalid PLY header line", place=place, got=line)
    raise AssertionError  # unreachable: _header_lines raises an error at the end


def _add_property(element: _Element, words: list[str], encoding: str, place: str) -> None:
    if len(words) == 5 and words[1] == "list":
        element.list_property = element.list_property or words[4]
        return
    if len(words) != 3 or words[1] not in _PLY_TYPES:
        rule = "a property must have a type and a name"
        raise MalformedInputError(rule, place=place, got=" ".join(words))
    element.record.names.append(words[2])
    element.record.types.append(np.dtype(f"{_PLY_ORDERS[encoding]}{_PLY_TYPES[words[1]]}"))
    element.record.counts.append(1)
    if len(element.record.names) > _MOST_PROPERTIES:
        raise MalformedInputError("too many properties", place=place)


_KITTI_RECORD = 16  # bytes: x, y, z and the reflectance
_FARTHEST = 1e5  # metres; a KITTI file with larger coordinates does not contain points


def _kitti_points(file: BinaryIO, _: Path) -> Iterator[Floats]:
    size = os.fstat(file.fileno()).st_size
    if size % _KITTI_RECORD:
        rule = f"must have {_KITTI_RECORD} bytes for each point: x, y, z and reflectance as float32"
        raise MalformedInputError(rule, got=f"{size} bytes")
    while data := file.read(_KITTI_RECORD * _POINTS_TOGETHER):
        singles = np.frombuffer(data, "<f4", len(data) // _KITTI_RECORD * 4).reshape(-1, 4)[:, :3]
        with np.errstate(invalid="ignore"):  # conversion of a signalling nan
            numbers = singles.astype(np.float64)
        if (np.abs(numbers) > _FARTHEST).any():
            rule = f"must be coordinates within {_FARTHEST:g} m, as float32"
            raise MalformedInputError(rule, got=float(np.nanmax(np.abs(numbers))))
        yield numbers


_DEPTH = 16  # levels of all of OctoMap's trees
_MIDDLE = 1 << (_DEPTH - 1)  # key of the voxel whose lower corner is the origin
_SLOTS = np.arange(8)
_CORNERS = np.stack([_SLOTS & 1, _SLOTS >> 1 & 1, _SLOTS >> 2], axis=1)  # of children: x, y, z
_MOST_LINES = 100
_BYTES_PER_NODE, _BYTES_PER_POINT = 200, 120  # peak memory

_FIELDS: list[tuple[Any, ...]] = [("value", "<f4"), ("children", "u1")]
_RECORDS = {
    "OcTree": np.dtype(_FIELDS),
    "OcTreeStamped": np.dtype(_FIELDS),
    "ColorOcTree": np.dtype([_FIELDS[0], ("colour", "u1", 3), _FIELDS[1]]),
}
"""Layout of the nodes in a ``.ot`` file; in a ``.bt`` file each child has two bits."""


def _read_octree_header(file: BinaryIO) -> tuple[bool, str, float]:
    """Return whether a tree is binary, its kind, and the side of its voxels in metres."""
    first, entries = file.readline(256), {"id": "", "res": ""}
    for _ in range(_MOST_LINES):
        key, _, value = file.readline(4096).decode("latin-1").strip().partition(" ")
        if key == "data":
            break
        entries[key] = value.strip()
    else:
        raise MalformedInputError("the header of an OctoMap file does not end")
    tree, side = entries["id"], entries["res"]
    if tree not in _RECORDS:
        raise MalformedInputError(f"must be one of {', '.join(_RECORDS)}", place="id", got=tree)
    if not is_number(side) or not 1e-4 <= float(side) <= 1e3:
        raise MalformedInputError("must be the side of a voxel, metres", place="res", got=side)
    return b"binary" in first, tree, float(side)


def _octree_points(file: BinaryIO, path: Path) -> Iterator[Floats]:
    is_binary, tree, resolution = _read_octree_header(file)
    record = np.dtype("<u2") if is_binary else _RECORDS[tree]
    size = os.fstat(file.fileno()).st_size - file.tell()
    claim(path, _BYTES_PER_NODE * (size // record.itemsize), what="the nodes of an octree")
    data = file.read(size)
    nodes: Array = np.frombuffer(data, record, len(data) // record.itemsize)
    if not len(nodes):
        return
    leaves_by_height = list(_leaves_of_binary(nodes) if is_binary else _leaves_of_full(nodes))
    count = sum(len(corners) << 3 * height for height, corners in leaves_by_height)
    claim(path, _BYTES_PER_POINT * count, what=f"{count} voxels")
    for height, corners in leaves_by_height:
        side = np.arange(1 << height if len(corners) else 1)
        within = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
        batch_size = max(1, _POINTS_TOGETHER // len(within))
        for start in range(0, len(corners), batch_size):
            voxels = corners[start : start + batch_size, np.newaxis] + within
            centres = voxels.reshape(-1, 3) - (_MIDDLE - 0.5)
            yield np.asarray(centres * resolution, dtype=np.float64)


def _leaves_of_binary(nodes: Array) -> Iterator[tuple[int, Integers]]:
    """Yield the height and the corners, in voxels, of the occupied leaves of each level."""
    # A ``.bt`` file has no nodes for leaves: two bits of the parent describe each child.
    free, occupied = ((nodes[:, np.newaxis] >> 2 * _SLOTS + bit) & 1 == 1 for bit in (0, 1))
    for height, indices, keys in _levels(has_child=free & occupied):
        if height:
            parents, slots = np.nonzero((occupied & ~free)[indices])
            yield height - 1, keys[parents] + (_CORNERS << height - 1)[slots]


def _leaves_of_full(nodes: Array) -> Iterator[tuple[int, Integers]]:
    """Yield the same for a ``.ot`` file, in which each leaf has a node."""
    has_child = (nodes["children"][:, np.newaxis] >> _SLOTS) & 1 == 1
    is_occupied_leaf = ~has_child.any(axis=1) & (nodes["value"] >= 0)
    for height, indices, keys in _levels(has_child):
        yield height, keys[is_occupied_leaf[indices]]


def _levels(has_child: Mask) -> Iterator[tuple[int, Integers, Integers]]:
    """Yield the height of each level, and the indices and the corners, in voxels, of its nodes."""
    # `has_child` marks the children of each node that have nodes of their own. Nodes are stored
    # depth first: the subtree of a node ends where fewer nodes are pending than before it.
    pending = np.cumsum(has_child.sum(axis=1, dtype=np.int64) - 1)
    if pending[-1] > -1:
        raise MalformedInputError("ends within its tree")
    order = np.argsort(pending, kind="stable")
    ranks = pending[order] * len(pending) + order
    indices, keys = np.zeros(1, np.int64), np.zeros((1, 3), np.int64)
    for height in range(_DEPTH, -1, -1):
        yield height, indices, keys
        next_children = indices + 1  # index of the next child of each node
        children, corners = [], []
        for slot, step in enumerate(_CORNERS << max(height - 1, 0)):
            is_parent = has_child[indices, slot]
            child = next_children[is_parent]
            children.append(child)
            corners.append(keys[is_parent] + step)
            end = (pending[child - 1] - 1) * len(pending) + child
            next_children[is_parent] = order[np.searchsorted(ranks, end)] + 1
        indices, keys = np.concatenate(children), np.concatenate(corners)
    if len(indices):
        raise MalformedInputError(f"a tree must have {_DEPTH} levels at most")


def _text_points(file: BinaryIO, path: Path) -> Iterator[Floats]:
    # The first line of numbers shows the delimiter: white space, commas or semicolons. Columns are
    # x, y and z unless a line of names stands above. Lines that begin with # are skipped.
    number, start, line = first_line(file)
    if not line:
        return
    if line.isascii() and line.isdigit():
        while line:
            count, start = _whole_number(line, f"line {number}"), file.tell()
            delimiter = delimiter_of(first_line(file)[2])
            file.seek(start)
            yield from _counted_points(file, path, range(3), number, count, delimiter=delimiter)
            number += count + 1
            _, _, line = first_line(file)
        return
    delimiter = delimiter_of(line)
    # CloudCompare writes two slashes before column names
    words = [word.strip().strip('"') for word in line.removeprefix("//").split(delimiter)]
    if words and is_number(words[0]):
        if len(words) < 2:
            rule = "must have 2 numbers or more"
            raise MalformedInputError(rule, place=f"line {number}", got=line)
        columns = list(range(min(3, len(words))))
        file.seek(start)
    else:
        names = [coordinate_name(word) for word in words]
        if not {"x", "y"} <= set(names):
            rule = "must be numbers, or names with x and y among them"
            raise MalformedInputError(rule, place=f"line {number}", got=line)
        columns = [names.index(name) for name in ("x", "y", "z") if name in names]
        number += 1
    yield from read_rows(file, columns, path=path, first_line=number, delimiter=delimiter)


_READERS: dict[str, Callable[[BinaryIO, Path], Iterator[Floats]]] = {
    ".pcd": _pcd_points, ".ply": _ply_points, ".xyz": _text_points, ".txt": _text_points,
    ".csv": _text_points, ".asc": _text_points, ".pts": _text_points, ".npy": _npy_points,
    ".bt": _octree_points, ".ot": _octree_points, ".bin": _kitti_points,
    ".npz": _npz_points,
}  # fmt: skip

CLOUD_SUFFIXES = tuple(_READERS)


def header_figures(path: Path, form: str) -> dict[str, Any]:
    """Return what the header of a file says; `form` is that of its `FileKind`."""
    with binary_file(path) as file:
        if form == "npy":
            shape, _, dtype, _ = _npy_header(file)
            return {"shape": " x ".join(map(str, shape)), "type": str(dtype)}
        if form == "OctoMap":
            _, tree, side = _read_octree_header(file)
            return {"tree": tree, "voxel_m": side}
        if form == "PCD":
            record, count, encoding, _ = _read_pcd_header(file)
            return {"encoding": encoding, "points": count, "fields": " ".join(record.names)}
        encoding, elements, _ = _read_ply_header(file)
    vertices = [element for element in elements if element.name == "vertex"]
    count = sum(vertex.count for vertex in vertices)
    fields = " ".join(name for vertex in vertices for name in vertex.record.names)
    return {"encoding": encoding, "points": count, "fields": fields}


def cloud_chunks(path: Path) -> Iterator[Floats]:
    with kinds.recognised(path, "a point cloud", kinds.CLOUD, kinds.NUMBERS):
        check_readable(path)
        if (suffix := path.suffix.lower()) not in CLOUD_SUFFIXES:
            rule = f"a cloud must end in {', '.join(CLOUD_SUFFIXES)}"
            raise MalformedInputError(rule, source=path, got=path.suffix)
        with binary_file(path) as file:
            yield from _READERS[suffix](file, path)


def read_cloud(path: Path | str, *, max_memory: int | None = None) -> Floats:
    """Read a point cloud.

    Parameters
    ----------
    path : path or str
        PCD (ascii, binary, binary_compressed), PLY (ascii, binary of either byte order), text
        (``.xyz``, ``.pts``, ``.txt``, ``.csv``, ``.asc``), ``.npy``, ``.npz``, OctoMap's ``.bt``
        and ``.ot``, or KITTI's ``.bin``.
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
    path, chunks, total = Path(path), [], 0
    with use_memory(max_memory):
        for chunk in cloud_chunks(path):
            total += chunk.nbytes
            claim(path, 2 * total + PIECES)  # the parts and their concatenation
            chunks.append(chunk)
    return np.concatenate(chunks) if chunks else np.empty((0, 3))
