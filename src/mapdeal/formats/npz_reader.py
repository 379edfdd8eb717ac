"""The entries of npz files, read without trusting them.

Every array's type, shape and size is checked before memory is taken for it, and nothing is ever
unpickled.
"""

from __future__ import annotations

import io
import os
import warnings
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.formats.budget import PIECES, check_expansion, claim
from mapdeal.formats.pillow_images import one_at_a_time
from mapdeal.formats.source import check_readable

LONGEST_ARRAY_HEADER = 1 << 16
_LARGEST_SMALL_ARRAY = 4096
_LARGEST_DIRECTORY = 1 << 20
_END_OF_ZIP = (1 << 16) + 256
_TOLD_BY_ZIP64 = 0xFFFFFFFF
_LARGEST_SMALL_NUMBER = 1 << 31
_MOST_COLUMNS = 1 << 16
_MOST_ROWS_BY_COLUMNS = 1 << 25
_CHUNK = 1 << 22


class _Entry(NamedTuple):
    """An array of which only the header is read, and the file that its data come from."""

    file: Any
    stored: int
    shape: tuple[int, ...]
    is_fortran: bool
    dtype: np.dtype[Any]

    @property
    def elements(self) -> int:
        return int(np.prod([int(n) for n in self.shape], dtype=object))

    @property
    def bytes(self) -> int:
        return self.elements * self.dtype.itemsize


class NpzReader:
    """The entries of an npz file, each checked before its memory is taken."""

    def __init__(self, path: Path, max_cells: int) -> None:
        self.path = path
        self._max_cells = max_cells
        self._taken = 0
        check_readable(path)
        try:
            if _directory_size(path) > _LARGEST_DIRECTORY:
                raise MalformedInputError("holds too many arrays", source=path)
            self._zip = zipfile.ZipFile(path)
        except (zipfile.BadZipFile, NotImplementedError, ValueError):
            raise MalformedInputError("is not an npz file", source=path) from None
        except OSError as error:
            rule = f"cannot be read: {error.strerror}"
            raise FileAccessError(rule, source=path) from None

    def __enter__(self) -> NpzReader:
        return self

    def __exit__(self, *_: object) -> None:
        self._zip.close()

    def names(self) -> set[str]:
        """Return the names of the arrays."""
        return {name.removesuffix(".npy") for name in self._zip.namelist()}

    def layer(self, name: str, dtype: type[np.generic]) -> NDArray[Any]:
        """Return an array of two axes with values of that type."""
        array = self._read(name, np.dtype(dtype), None, self._max_cells)
        self._check_axes(name, array.ndim)
        return array

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of an array, of which the header is read."""
        with self._opened(name) as entry:
            return entry.shape

    def nbytes(self, name: str) -> int:
        """Return the bytes of an array, of which the header is read."""
        with self._opened(name) as entry:
            return entry.bytes

    def small(self, name: str, dtype: type[np.generic], shape: tuple[int, ...]) -> NDArray[Any]:
        """Return an array of that type and shape."""
        return self._read(name, np.dtype(dtype), shape, _LARGEST_SMALL_ARRAY)

    def number(self, name: str) -> float:
        """Return a single number."""
        value = self._read(name, None, (), _LARGEST_SMALL_ARRAY)
        if value.dtype.kind not in "iuf":
            raise self._error(name, f"must be a number, is {value.dtype}")
        return float(value)

    def whole_number(self, name: str) -> int:
        """Return a single whole number."""
        value = self.number(name)
        if value % 1 or abs(value) > _LARGEST_SMALL_NUMBER:  # nan and inf leave a rest of nan
            raise self._error(name, f"must be a whole number, is {value:g}")
        return int(value)

    def text(self, name: str, choices: tuple[str, ...] | None) -> str:
        """Return a single text, one of the choices if there are any."""
        value = self._read(name, None, (), _LARGEST_SMALL_ARRAY)
        if value.dtype.kind != "U":
            raise self._error(name, f"must be text, is {value.dtype}")
        little = value.astype(value.dtype.newbyteorder("<"))
        try:  # not by numpy, which makes broken strings of characters beyond Unicode
            text = little.tobytes().decode("utf-32-le").rstrip("\0")
        except UnicodeDecodeError:
            raise self._error(name, "must be text, is not Unicode") from None
        if choices is not None and text not in choices:
            raise self._error(name, f"must be one of {', '.join(choices)}")
        return text

    def numbers(self, name: str, axes: int) -> NDArray[np.float64]:
        """Return an array of any type of number, with so many axes."""
        array = self._read(name, None, None, self._max_cells, small=False)
        if array.dtype.kind not in "iuf" or array.ndim != axes:
            found = f"{array.dtype} of shape {array.shape}"
            raise self._error(name, f"must be numbers with {axes} axes, is {found}")
        return array.astype(np.float64)

    def rows(
        self, name: str, columns: int, *, shape: tuple[int, int] | None = None
    ) -> Iterator[NDArray[np.float64]]:
        """Yield the first `columns` numbers of each row of a table, many rows at a time.

        Rows that have fewer are yielded whole; at least two numbers make a row. If a shape is
        given, the table must have it. A table that is
        stored column by column is held in memory.
        """
        with self._opened(name) as entry:
            if shape is not None and entry.shape != shape:
                raise self._error(name, f"must have shape {shape}, has {entry.shape}")
            least = 2 if shape is None else 0
            if entry.dtype.kind not in "iuf" or len(entry.shape) != 2 or entry.shape[1] < least:
                found = f"{entry.dtype} of shape {entry.shape}"
                raise self._error(name, f"must be numbers of shape (N, 2) or wider, is {found}")
            height, width = entry.shape
            if width > _MOST_COLUMNS:
                raise self._error(name, f"{width} columns, above the limit of {_MOST_COLUMNS}")
            # as many as are little memory, too, when they are converted
            wide = max(np.dtype(np.float64).itemsize, entry.dtype.itemsize)
            together = max(1, _CHUNK // max(1, width * wide))
            if entry.is_fortran:
                if height > _MOST_ROWS_BY_COLUMNS:
                    rule = f"{height} rows, stored column by column, above the limit of"
                    hint = "row by row (C order) any number can be read"
                    raise self._error(name, f"{rule} {_MOST_ROWS_BY_COLUMNS}", hint=hint)
                per_row = entry.dtype.itemsize + np.dtype(np.float64).itemsize * min(columns, width)
                self._claim(name, entry, per_row * height)
                table = np.empty((min(columns, width), height))
                for column in table:
                    part = np.empty(height, dtype=entry.dtype)
                    fill(entry.file, part)
                    column[:] = part
                while entry.file.read(_CHUNK):  # so that the checksum is verified
                    pass
                for first in range(0, height, together):
                    yield table[:, first : first + together].T
                return
            for first in range(0, height, together):
                part = np.empty((min(together, height - first), width), dtype=entry.dtype)
                fill(entry.file, part)
                yield part[:, :columns].astype(np.float64)
            entry.file.read(1)  # so that the checksum is verified

    def opened_behind_header(self, name: str) -> Any:
        """Return the open file of an array, whose header is read; whoever asks closes it."""
        with ExitStack() as stack:
            file = stack.enter_context(self._open(name))
            self._entry(name, file)
            stack.pop_all()
        return file

    def _check_layer(self, name: str, entry: _Entry, dtype: type[np.generic]) -> None:
        self._check_type(name, entry, np.dtype(dtype), None, self._max_cells)
        self._check_axes(name, len(entry.shape))

    def _check_axes(self, name: str, axes: int) -> None:
        if axes != 2:
            raise self._error(name, f"must have two axes, has {axes}")

    def _check_type(
        self,
        name: str,
        entry: _Entry,
        dtype: np.dtype[Any] | None,
        shape: tuple[int, ...] | None,
        most_elements: int,
    ) -> None:
        if dtype is not None and entry.dtype != dtype:
            raise self._error(name, f"must be {dtype}, is {entry.dtype}")
        if shape is not None and entry.shape != shape:
            raise self._error(name, f"must have shape {shape}, has {entry.shape}")
        if entry.elements > most_elements:
            rule = f"{entry.elements} elements, above the limit of {most_elements}"
            raise self._error(name, rule)

    def _error(self, name: str, rule: str, *, hint: str | None = None) -> MalformedInputError:
        return MalformedInputError(rule, source=self.path, place=name, hint=hint)

    def _claim(self, name: str, entry: _Entry, count: int) -> None:
        """Refuse an array that takes too much memory, beside those that were read before."""
        check_expansion(self.path, entry.stored, entry.bytes, place=name)
        self._taken += count
        claim(self.path, self._taken + min(PIECES, self._taken))

    def _read(
        self,
        name: str,
        dtype: np.dtype[Any] | None,
        shape: tuple[int, ...] | None,
        most_elements: int,
        *,
        small: bool = True,
    ) -> NDArray[Any]:
        with self._opened(name) as entry:
            self._check_type(name, entry, dtype, shape, most_elements)
            if small and dtype is None and entry.bytes > _LARGEST_SMALL_ARRAY:
                raise self._error(name, f"must be a single value, is {entry.dtype}")
            wide = 2 * entry.elements * np.dtype(np.float64).itemsize  # converted, and looked at
            self._claim(name, entry, entry.bytes * (1 + entry.is_fortran) if small else
                        entry.bytes + wide)  # fmt: skip
            array = np.empty(entry.elements, dtype=entry.dtype)
            _read_into(entry.file, array)
            return array.reshape(entry.shape, order="F" if entry.is_fortran else "C")

    def _header(self, name: str, file: Any, version: tuple[int, int]) -> io.BytesIO:
        """Return the header with its length before it: numpy would read any length."""
        length = file.read(2 if version == (1, 0) else 4)
        count = int.from_bytes(length, "little")
        if count > LONGEST_ARRAY_HEADER:
            raise self._error(name, f"a header of {count} bytes is too long")
        return io.BytesIO(length + file.read(count))

    @contextmanager
    def _opened(self, name: str) -> Iterator[_Entry]:
        """Yield an entry after its header; damage that is met in the block is reported as such."""
        with self.damage_told(name), self._open(name) as file:
            yield self._entry(name, file)

    def _open(self, name: str) -> Any:
        """Return the open file of an array's entry."""
        try:
            info = self._zip.getinfo(f"{name}.npy")
        except KeyError:
            raise self._error(name, "missing key") from None
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise self._error(name, "compressed by a method that npz files do not use")
        return self._zip.open(info)

    def _entry(self, name: str, file: Any) -> _Entry:
        """Return the array in an open file, of which the header is read."""
        info = self._zip.getinfo(f"{name}.npy")
        version = npy_format.read_magic(file)
        read_header = {
            (1, 0): npy_format.read_array_header_1_0,
            (2, 0): npy_format.read_array_header_2_0,
        }.get(version)
        if read_header is None:
            raise self._error(name, f"array format {version} is not supported")
        with one_at_a_time(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of headers that Python 2 wrote
            header = self._header(name, file, version)
            entry = _Entry(file, info.compress_size, *read_header(header))
        if entry.dtype.hasobject:
            raise self._error(name, "holds Python objects, which are never loaded")
        # The header's word is only taken as far as the archive has bytes for it.
        if entry.bytes + file.tell() != info.file_size:
            raise self._error(name, "the array's size does not fit its data")
        return entry

    @contextmanager
    def damage_told(self, name: str) -> Iterator[None]:
        """Raise what reading a damaged entry leads to as such."""
        from tokenize import TokenError  # of use to few, and slow to import

        try:
            yield
        # What reading a damaged header or entry leads to, in numpy and in zipfile.
        except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, NotImplementedError,
                RuntimeError, OSError, SyntaxError, TokenError, LookupError,
                TypeError) as error:  # fmt: skip
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


def _read_into(file: Any, array: NDArray[Any]) -> None:
    """Fill `array` from a file, and read to the end so that the checksum is verified."""
    fill(file, array)
    file.read(1)


def fill(file: Any, array: NDArray[Any]) -> None:
    """Fill a contiguous array from a file; EOFError if that ends before."""
    view = memoryview(array.reshape(-1).view(np.uint8).data) if array.size else memoryview(b"")
    done = 0
    while done < len(view):
        chunk = file.read(min(_CHUNK, len(view) - done))
        if not chunk:
            raise EOFError("the data end early")
        view[done : done + len(chunk)] = chunk
        done += len(chunk)
