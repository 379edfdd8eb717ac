"""The entries of npz files, read without trusting them, at once or by rows.

Every array's type, shape and size is checked before memory is taken for it, and nothing is ever
unpickled.
"""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Lock
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError
from mapdeal.formats.budget import PIECES, check_expansion, claim
from mapdeal.formats.npy import NpyHeader, read_npy_header
from mapdeal.formats.source import check_readable
from mapdeal.grid.values import OCCUPIED, UNKNOWN
from mapdeal.kernels.blocks import Layer, LazyLayer

_LARGEST_SMALL_ARRAY = 4096
_LARGEST_DIRECTORY = 1 << 20
_END_OF_ZIP = (1 << 16) + 256
_TOLD_BY_ZIP64 = 0xFFFFFFFF
_LARGEST_SMALL_NUMBER = 1 << 31
_MOST_COLUMNS = 1 << 16
_CHUNK = 1 << 22


class NpzReader:
    """The entries of an npz file, each checked before its memory is taken."""

    # If a height of blocks is given, layers are lazy, but for those that are stored column by
    # column. Rows before those that were read last are read from the start again. Memory is taken
    # for the rows that are asked for, so data that expand a thousand times do no harm. What is
    # damaged is found when its rows are read, a wrong checksum with the last row.
    def __init__(self, path: Path, max_cells: int, block_height: int | None = None) -> None:
        self.path = path
        self._max_cells = max_cells
        self._block_height = block_height
        self._taken = 0
        self._files = ExitStack()
        check_readable(path)
        try:
            if _directory_size(path) > _LARGEST_DIRECTORY:
                raise MalformedInputError("holds too many arrays", source=path)
            self._zip = self._files.enter_context(zipfile.ZipFile(path))
        except (zipfile.BadZipFile, NotImplementedError, ValueError):
            raise MalformedInputError("is not an npz file", source=path) from None
        except OSError as error:
            rule = f"cannot be read: {error.strerror}"
            raise FileAccessError(rule, source=path) from None

    def __enter__(self) -> NpzReader:
        return self

    def __exit__(self, *_: object) -> None:
        self._files.close()

    def names(self) -> set[str]:
        return {name.removesuffix(".npy") for name in self._zip.namelist()}

    def header(self, name: str) -> NpyHeader:
        with self._opened(name) as (_, header):
            return header

    def layer(self, name: str, dtype: type[np.generic]) -> Layer:
        header = self._checked(name, self._max_cells, np.dtype(dtype))
        if len(header.shape) != 2:
            raise self._error(name, f"must have two axes, has {len(header.shape)}")
        if self._block_height is None or header.is_fortran:
            return self._values(name, header.nbytes * (1 + header.is_fortran))
        file, header = self._files.enter_context(self._opened(name))
        height, width = header.shape
        row_size = width * header.dtype.itemsize
        lock = Lock()

        def read(rows: slice) -> NDArray[Any]:
            size = (rows.stop - rows.start) * row_size
            claim(self.path, size + min(PIECES, size))
            values = np.empty((rows.stop - rows.start, width), dtype=dtype)
            with lock, self._damage_told(name):
                file.seek(header.start + rows.start * row_size)
                _fill(values, file)
            self._check_values(name, values)
            return values

        layer = LazyLayer((height, width), dtype, read, block_height=self._block_height)
        return cast("Layer", layer)

    def small(self, name: str, dtype: type[np.generic], shape: tuple[int, ...]) -> NDArray[Any]:
        return self._values(
            name, self._checked(name, _LARGEST_SMALL_ARRAY, np.dtype(dtype), shape).nbytes
        )

    def number(self, name: str) -> float:
        return float(self._single(name, "iuf", "a number"))

    def whole_number(self, name: str) -> int:
        value = self.number(name)
        if value % 1 or abs(value) > _LARGEST_SMALL_NUMBER:  # nan and inf leave a rest of nan
            raise self._error(name, f"must be a whole number, is {value:g}")
        return int(value)

    def text(self, name: str, choices: tuple[str, ...] | None) -> str:
        value = self._single(name, "U", "text")
        little = value.astype(value.dtype.newbyteorder("<"))
        try:  # not by numpy, which makes broken strings of characters beyond Unicode
            text = little.tobytes().decode("utf-32-le").rstrip("\0")
        except UnicodeDecodeError:
            raise self._error(name, "must be text, is not Unicode") from None
        if choices is not None and text not in choices:
            raise self._error(name, f"must be one of {', '.join(choices)}")
        return text

    def numbers(self, name: str, axes: int) -> NDArray[np.float64]:
        header = self._checked(name, self._max_cells)
        if header.dtype.kind not in "iuf" or len(header.shape) != axes:
            found = f"{header.dtype} of shape {header.shape}"
            raise self._error(name, f"must be numbers with {axes} axes, is {found}")
        wide = 16 * header.elements  # converted to float64, and looked at
        return self._values(name, header.nbytes + wide).astype(np.float64)

    def rows(
        self, name: str, columns: int, *, shape: tuple[int, int] | None = None
    ) -> Iterator[NDArray[np.float64]]:
        """Yield the first `columns` numbers of each row of a table, many rows at a time."""
        # Rows that have fewer are yielded whole; at least two numbers make a row. If a shape is
        # given, the table must have it. A table that is stored column by column is held in memory.
        with self._opened(name) as (file, header):
            if shape is not None and header.shape != shape:
                raise self._error(name, f"must have shape {shape}, has {header.shape}")
            least = 2 if shape is None else 0
            if header.dtype.kind not in "iuf" or len(header.shape) != 2 or header.shape[1] < least:
                found = f"{header.dtype} of shape {header.shape}"
                raise self._error(name, f"must be numbers of shape (N, 2) or wider, is {found}")
            height, width = header.shape
            if width > _MOST_COLUMNS:
                raise self._error(name, f"{width} columns, above the limit of {_MOST_COLUMNS}")
            # as many as are little memory, too, when they are converted
            together = max(1, _CHUNK // (max(1, width) * max(8, header.dtype.itemsize)))
            table = self._values(name, header.nbytes) if header.is_fortran else None
            for first in range(0, height, together):
                count = min(together, height - first)
                part = (
                    np.empty((count, width), header.dtype)
                    if table is None
                    else table[first:][:count]
                )
                if table is None:
                    _fill(part, file)
                yield part[:, :columns].astype(np.float64)

    def _single(self, name: str, kinds: str, what: str) -> NDArray[Any]:
        header = self._checked(name, _LARGEST_SMALL_ARRAY, shape=())
        if header.dtype.kind not in kinds or header.nbytes > _LARGEST_SMALL_ARRAY:
            raise self._error(name, f"must be {what}, is {header.dtype}")
        return self._values(name, header.nbytes)

    def _checked(
        self, name: str, most: int, dtype: Any = None, shape: tuple[int, ...] | None = None
    ) -> NpyHeader:
        header = self.header(name)
        if dtype is not None and header.dtype != dtype:
            raise self._error(name, f"must be {dtype}, is {header.dtype}")
        if shape is not None and header.shape != shape:
            raise self._error(name, f"must have shape {shape}, has {header.shape}")
        if header.elements > most:
            raise self._error(name, f"{header.elements} elements, above the limit of {most}")
        return header

    def _check_values(self, name: str, values: NDArray[Any]) -> None:
        """Refuse rows that a map or costs in memory would be refused for."""
        if values.dtype == np.int8 and values.size:
            lowest, highest = int(values.min()), int(values.max())
            if lowest < UNKNOWN or highest > OCCUPIED:
                rule = f"{name} must lie in -1..100"
                raise ParameterError(rule, got=(lowest, highest)).in_file(self.path)

    def _error(self, name: str, rule: str) -> MalformedInputError:
        return MalformedInputError(rule, source=self.path, place=name)

    def _values(self, name: str, taken: int) -> NDArray[Any]:
        """Return an array, for which so much memory is taken besides that of those before."""
        with self._opened(name) as (file, header):
            check_expansion(
                self.path, self._zip.getinfo(f"{name}.npy").compress_size, header.nbytes, place=name
            )
            self._taken += taken
            claim(self.path, self._taken + min(PIECES, self._taken))
            array = np.empty(header.elements, dtype=header.dtype)
            _fill(array, file)
            return array.reshape(header.shape, order="F" if header.is_fortran else "C")

    @contextmanager
    def _opened(self, name: str) -> Iterator[tuple[IO[bytes], NpyHeader]]:
        """Yield the file of an entry behind its header, and this; report damage met meanwhile."""
        try:
            info = self._zip.getinfo(f"{name}.npy")
        except KeyError:
            raise self._error(name, "missing key") from None
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise self._error(name, "compressed by a method that npz files do not use")
        with self._damage_told(name), self._zip.open(info) as file:
            header = read_npy_header(file)
            if header.dtype.hasobject:
                raise self._error(name, "holds Python objects, which are never loaded")
            # The header's word is only taken as far as the archive has bytes for it.
            if header.start + header.nbytes != info.file_size:
                raise self._error(name, "the array's size does not fit its data")
            yield file, header

    @contextmanager
    def _damage_told(self, name: str) -> Iterator[None]:
        """Raise what reading a damaged entry leads to, in zipfile and zlib, as such."""
        try:
            yield
        except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, NotImplementedError,
                RuntimeError, OSError) as error:  # fmt: skip
            raise self._error(name, f"damaged: {error}") from None


def _directory_size(path: Path) -> int:
    """Return the bytes of the list of a zip file's entries: read, it takes ten times as many."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - _END_OF_ZIP, 0))
        tail = file.read()
    end = tail.rfind(b"PK\5\6")
    if end < 0:
        return 0
    own = int.from_bytes(tail[end + 12 : end + 16], "little")
    large = tail.rfind(b"PK\6\6", 0, end)  # the record of zip64, with wider numbers
    wide = int.from_bytes(tail[large + 40 : large + 48], "little") if large >= 0 else 0
    return max(wide, own if own < _TOLD_BY_ZIP64 else 0)


def _fill(array: NDArray[Any], file: IO[bytes]) -> None:
    """Fill a contiguous array from a file, which verifies its checksum at the end."""
    view = memoryview(array.reshape(-1).view(np.uint8).data) if array.size else memoryview(b"")
    for start in range(0, len(view), _CHUNK):
        part = view[start : start + _CHUNK]
        if file.readinto(part) < len(part):  # type: ignore[attr-defined]
            raise EOFError("the data end early")
