"""Clouds in numpy's own files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError, emit_warning
from mapdeal.formats.clouds.header import LONGEST_RECORD
from mapdeal.formats.npy import NpyHeader, read_npy_header
from mapdeal.formats.npz_reader import NpzReader
from mapdeal.formats.source import access_to
from mapdeal.records import dataclass

_POINTS_TOGETHER = 1 << 17
_MOST_ELEMENTS = 1 << 31
_MOST_LIKELY = 16
_BYTES_TOGETHER = 1 << 23
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
        together = max(1, min(_POINTS_TOGETHER, _BYTES_TOGETHER // table.row_size))
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
