"""A decoded picture, before a dialect gives its pixels a meaning."""

from __future__ import annotations

import hashlib
import io
import os
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError, MapdealWarning, emit_warning
from mapdeal.files import source as sources
from mapdeal.kernels.lookup import look_up
from mapdeal.records import dataclass, replace

Samples = NDArray[np.unsignedinteger[Any]]

LARGEST_CELLS = 1_000_000_000
LARGEST_COMPRESSED_CELLS = 200_000_000


@dataclass(frozen=True, eq=False)
class Picture:
    """Integer samples of a picture, row 0 in the north."""

    file_format: str  # which some readers of ROS treat differently
    colour: Literal["grey", "rgb", "palette"]
    samples: Samples  # (H, W), or (H, W, 3) of rgb: 0 .. maxval, or indices into the palette
    maxval: int = 255
    alpha: Samples | None = None  # opacity, (H, W): 0 .. maxval, of palettes 0 .. 255
    alpha_from: Literal["channel", "key"] = "channel"  # key: of one transparent colour
    palette: NDArray[np.uint8] | None = None  # red, green, blue, opacity of each index, (N, 4)
    display: tuple[str, ...] = ()  # gamma or colour profile, which no reader applies

    def __getitem__(self, index: Any) -> Picture:
        alpha = None if self.alpha is None else self.alpha[index]
        return replace(self, samples=self.samples[index], alpha=alpha)

    def bands(self, most_pixels: int) -> Iterator[Picture]:
        """Yield views of bands of rows, each of at most so many pixels, or of one row."""
        height, width = self.shape
        step = max(1, most_pixels // width)
        for first in range(0, height, step):
            yield self[first : first + step]

    def greys_and_exceptions(self) -> tuple[Samples, NDArray[np.bool_]]:
        """Return the grey or palette index of each pixel, and which are coloured or not opaque."""
        exceptions = np.zeros(self.shape, dtype=np.bool_)
        grey = self.samples
        if grey.ndim == 3:
            grey = self.samples[..., 0]
            for channel in (1, 2):
                exceptions |= self.samples[..., channel] != grey
        if self.alpha is not None:
            exceptions |= self.alpha != self.opaque
        return grey, exceptions

    def only(self, mask: NDArray[np.bool_]) -> Picture:
        return self[mask][np.newaxis]

    @property
    def opaque(self) -> int:
        return 255 if self.palette is not None else self.maxval

    @property
    def shape(self) -> tuple[int, int]:
        height, width = self.samples.shape[:2]
        return height, width


def warn_of(path: Path, text: str, check: str) -> None:
    emit_warning(MapdealWarning(f"{path}: {text}", check))


def by_sample(table: NDArray[Any], samples: Samples) -> NDArray[Any]:
    """Return the table's entry for each sample; 8-bit samples use a kernel."""
    if samples.dtype == np.uint8 and table.dtype.itemsize == 1 and samples.ndim == 2:
        full_table = np.zeros(256, dtype=table.dtype)
        full_table[: len(table)] = table
        return look_up(samples, full_table)
    return table[samples]


def opaque_greys(kind: Picture) -> Picture:
    """Return a picture of the same kind as another: one row of all opaque greys 0 .. maxval."""
    # With a palette the row has all indices.
    greys = np.arange(kind.maxval + 1 if kind.palette is None else len(kind.palette))[np.newaxis]
    alpha = None if kind.alpha is None else np.full_like(greys, kind.opaque, kind.alpha.dtype)
    samples = greys.astype(kind.samples.dtype)
    if kind.samples.ndim == 3:
        samples = np.repeat(samples[..., np.newaxis], 3, axis=2)
    return replace(kind, samples=samples, alpha=alpha)


def check_size(source: object, width: int, height: int, limit: int = sys.maxsize) -> None:
    place = "image size"
    if width <= 0 or height <= 0:
        rule = "width and height must be above 0"
        raise MalformedInputError(rule, source=str(source), place=place, got=(width, height))
    if width * height > limit:
        rule = f"{width} x {height} are {width * height} cells, above the limit of {limit}"
        hint = "--max-cells N raises the limit, if you trust the file"
        raise MalformedInputError(rule, source=str(source), place=place, hint=hint)


def to_16_bit(maxval: int) -> NDArray[np.uint16]:
    """Return the 16-bit sample of each sample 0 .. `maxval`: floor(65535 v / maxval + 0.5)."""
    values = np.arange(maxval + 1, dtype=np.int64)
    return ((2 * 65535 * values + maxval) // (2 * maxval)).astype(np.uint16)


HEAD = 1 << 19  # bytes at the start of a file that identify it: headers of images are not longer
_CHUNK = 1 << 20


@dataclass(frozen=True)
class OpenFile:
    """An open regular file, from which several threads can read any bytes at once."""

    path: Path
    size: int
    _descriptor: int
    _state: sources.FileState

    @cached_property
    def head(self) -> bytes:
        return self.read(0, HEAD)

    def read(self, offset: int, count: int) -> bytes:
        """Return `count` bytes from `offset`, fewer at the end; refuse a file that has changed."""
        # A memory map is no option: a file that gets shorter would crash the process.
        # no larger than the file: allocating a buffer takes longer than reading few bytes
        parts, at, remaining = [], offset, min(count, self.size - offset)
        with sources.access_to(self.path):
            while remaining > 0 and (part := os.pread(self._descriptor, remaining, at)):
                parts.append(part)
                at, remaining = at + len(part), remaining - len(part)
            after = os.fstat(self._descriptor)
        if sources.FileState.of_status(after) != self._state:
            raise FileAccessError(sources.CHANGED, source=self.path)
        return b"".join(parts)

    def error(self, rule: str, place: str | None = None, **details: Any) -> MalformedInputError:
        return MalformedInputError(rule, source=self.path, place=place, **details)

    def check_length(self) -> None:
        if self.size > sources.LARGEST_FILE:  # sparse files can claim any size
            rule = f"cannot be read: larger than {sources.LARGEST_FILE} bytes"
            raise FileAccessError(rule, source=self.path, got=self.size)

    def read_all(self) -> bytes:
        self.check_length()
        sources.claim(self.path, self.size)
        try:
            return self.read(0, self.size)
        except MemoryError:
            rule = "does not fit into memory"
            raise FileAccessError(rule, source=self.path, got=self.size) from None

    def sha256(self) -> str:
        checksum, offset = hashlib.sha256(), 0
        while chunk := self.read(offset, _CHUNK):
            checksum.update(chunk)
            offset += len(chunk)
        return checksum.hexdigest()

    def stream(self) -> BinaryIO:
        return io.BufferedReader(_Stream(self))


class _Stream(io.RawIOBase):
    def __init__(self, file: OpenFile) -> None:
        self._file, self._offset = file, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._offset, os.SEEK_END: self._file.size}[whence]
        if base + offset < 0:
            raise ValueError("a place before the file")
        self._offset = base + offset
        return self._offset

    def readinto(self, buffer: bytearray | memoryview) -> int:  # type: ignore[override]
        data = self._file.read(self._offset, len(buffer))
        buffer[: len(data)] = data
        self._offset += len(data)
        return len(data)


@contextmanager
def opened(path: Path) -> Iterator[OpenFile]:
    sources.check_readable(path)
    with sources.access_to(path):
        file = path.open("rb", buffering=0)
    with file:
        status = os.fstat(file.fileno())
        yield OpenFile(path, status.st_size, file.fileno(), sources.FileState.of_status(status))


STRIP = 1 << 20  # bytes of the pixels in a strip, about: they stay in the processor's cache


@dataclass(frozen=True, eq=False)
class Strips:
    """A picture that is decoded in strips of rows, from north to south."""

    shape: tuple[int, int]
    pictures: Callable[[], Iterator[Picture]]

    def placed(self) -> Iterator[tuple[slice, Picture]]:
        """Yield each strip and its rows, counted from the south, as grids count them."""
        stop = self.shape[0]
        for picture in self.pictures():
            start = stop - picture.shape[0]
            yield slice(start, stop), picture
            stop = start


class OpenImage(ABC):
    """An image file that is open: its header is read, its pixels are not."""

    def __init__(self, file: OpenFile, height: int, width: int, limit: int) -> None:
        self.file, self._limit = file, limit
        self.height, self.width = height, width
        check_size(file.path, width, height)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns; more cells than the limit are refused."""
        check_size(self.file.path, self.width, self.height, self._limit)
        return self.height, self.width

    @abstractmethod
    def memory(self) -> int:
        """Return the peak memory of reading the image as cells, in bytes."""

    @abstractmethod
    def _decoded(self) -> Strips: ...

    @contextmanager
    def strips(self) -> Iterator[Strips]:
        self.file.check_length()  # the checksum below reads all of it
        check_size(self.file.path, self.width, self.height, self._limit)
        yield self._decoded()
        sources.note_sum(self.file.path, self.file.sha256)


@dataclass(frozen=True)
class ImageFormat:
    # `mapdeal.maps.dialects` names the formats that image libraries of ROS treat differently. In
    # all other formats samples mean what `Picture` says.
    name: str
    suffixes: tuple[str, ...]
    signature: bytes  # regular expression of its first bytes
    open: Callable[[OpenFile, int], OpenImage]
    max_cells: int = LARGEST_COMPRESSED_CELLS
    comments: Callable[[bytes], list[str]] = lambda _: []


def strips_at_places(
    shape: tuple[int, int], row_bytes: int, rows_at: Callable[[int, int], Picture]
) -> Strips:
    """Return the strips of a picture, given a function that reads a range of rows."""
    step = max(1, STRIP // max(shape[1], row_bytes))  # a row of bits has more pixels than bytes

    def parts() -> Iterator[Picture]:
        for first in range(0, shape[0], step):
            yield rows_at(first, min(first + step, shape[0]))

    return Strips(shape, parts)
