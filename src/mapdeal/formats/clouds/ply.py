"""PLY, the Stanford polygon format: the vertices of ascii and binary files.

References
----------
Greg Turk, "The PLY Polygon File Format", 1994.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError
from mapdeal.formats.clouds.header import Record, binary_points, header_lines, whole_number
from mapdeal.formats.source import access_to
from mapdeal.formats.text_rows import read_rows
from mapdeal.records import dataclass

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
    encoding, elements, lines = _read_header(file, path)
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
        encoding, elements, _ = _read_header(file, path)
    vertices = [one for one in elements if one.name == "vertex"]
    fields = " ".join(name for one in vertices for name in one.names)
    return {"encoding": encoding, "points": sum(one.count for one in vertices), "fields": fields}


def _read_header(file: BinaryIO, path: Path) -> tuple[str, list[_Element], int]:
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
