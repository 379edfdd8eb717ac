"""Images of map_server pairs of which any rows can be read, so that nobody needs them all."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError
from mapdeal.formats.file_state import CHANGED, FileState
from mapdeal.formats.picture import Picture
from mapdeal.formats.pnm import GreyFile, brightness_of_bits, check_pixels, locate_pixels
from mapdeal.formats.source import check_regular

_HEAD = 1 << 17
_SOME = 256
_CHUNK = 1 << 22


@dataclass(frozen=True)
class PixelRows:
    """The pixels of an open P5 image of 8 bits, or of a P4 image.

    Parameters
    ----------
    image : Path
        The file.
    located : GreyFile
        Size and place of the pixels in it.
    """

    image: Path
    located: GreyFile
    _descriptor: int
    _state: FileState

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.located.height, self.located.width

    def picture(self, rows: slice) -> Picture:
        """Return the picture of some rows, which are counted from the south; its row 0 is north."""
        return Picture("PNM", "grey", self._samples(rows), maxval=self.located.maxval)

    def _samples(self, rows: slice) -> NDArray[np.uint8]:
        located = self.located
        north = located.height - rows.stop
        count = (rows.stop - rows.start) * located.row_bytes
        start = located.start + north * located.row_bytes
        data = self._read(start, count)
        if len(data) < count:
            raise FileAccessError(CHANGED, source=self.image)
        samples = np.frombuffer(data, dtype=np.uint8).reshape(-1, located.row_bytes)
        if located.is_packed:
            return brightness_of_bits(samples, located.width)
        check_pixels(samples, located.maxval, north * located.width, self.image)
        return samples

    def sha256(self) -> str:
        """Return the checksum of the whole file."""
        checksum, offset = hashlib.sha256(), 0
        while chunk := self._read(offset, _CHUNK):
            checksum.update(chunk)
            offset += len(chunk)
        return checksum.hexdigest()

    def _read(self, offset: int, count: int) -> bytes:
        """Read some bytes, which are those of the file that was opened.

        Asked each time: in the end would be too late, since results are written by then.
        """
        data = _read(self._descriptor, offset, count, self.image)
        if FileState.of_status(os.fstat(self._descriptor)) != self._state:
            raise FileAccessError(CHANGED, source=self.image)
        return data


@contextmanager
def open_pixel_rows(image: Path) -> Iterator[PixelRows | None]:
    """Open an image of 8-bit P5, or of P4; give None for every other format.

    Raises
    ------
    FileAccessError
        If the file cannot be read; of pixels also if it has changed since.
    MalformedInputError
        If its header is malformed; of pixels, when they are read.
    """
    check_regular(image)
    with _opened(image) as descriptor:
        before = os.fstat(descriptor)

        def read(offset: int, count: int = _SOME) -> bytes:
            return _read(descriptor, offset, count, image)

        located = locate_pixels(
            read(0, _HEAD), before.st_size, read, image, max_cells=sys.maxsize
        )  # fmt: skip
        if located is None:
            yield None
            return
        yield PixelRows(image, located, descriptor, FileState.of_status(before))


@contextmanager
def _opened(image: Path) -> Iterator[int]:
    try:
        descriptor = os.open(image, os.O_RDONLY)
    except OSError as error:
        rule = f"cannot be read: {error.strerror}"
        raise FileAccessError(rule, source=image) from None
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _read(descriptor: int, offset: int, count: int, image: Path) -> bytes:
    """Read at a place, so that threads do not get into each other's way.

    Not through a memory map: a file that gets shorter would end the process.
    """
    parts = []
    try:
        while count > 0 and (part := os.pread(descriptor, count, offset)):
            parts.append(part)
            offset, count = offset + len(part), count - len(part)
    except OSError as error:
        rule = f"cannot be read: {error.strerror}"
        raise FileAccessError(rule, source=image) from None
    return b"".join(parts)
