"""Common parts of the headers of point clouds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError
from mapdeal.records import dataclass

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
