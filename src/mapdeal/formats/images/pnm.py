"""PNM images, P1 to P6, which `mapdeal.formats.pnm` parses: most maps have one."""

from __future__ import annotations

import sys
from pathlib import Path

from mapdeal.errors import FileAccessError
from mapdeal.formats.budget import claim
from mapdeal.formats.images.image_format import ImageFormat
from mapdeal.formats.open_file import HEAD, OpenFile
from mapdeal.formats.picture import LARGEST_CELLS, Picture
from mapdeal.formats.pnm import (
    LocatedPixels,
    decode_pnm,
    is_pnm,
    locate_pixels,
    pnm_comments,
    pnm_memory,
    pnm_size,
)
from mapdeal.formats.source import CHANGED
from mapdeal.formats.strips import Strips, strips_at_places, strips_of
from mapdeal.records import dataclass

_TRAILING = 256


@dataclass(frozen=True)
class BinaryRows:
    """The pixels of an open P4, P5 or P6 file: see `mapdeal.formats.strips.PixelRows`."""

    file: OpenFile
    located: LocatedPixels
    max_cells: int = LARGEST_CELLS
    memory: int = 0
    is_compressed: bool = False

    @property
    def image(self) -> Path:
        """The file."""
        return self.file.path

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.located.height, self.located.width

    def strips(self) -> Strips:
        """Return all rows."""
        return self.part(slice(0, self.located.height))

    def part(self, rows: slice) -> Strips:
        """Return some rows, which are counted from the south."""
        north = self.located.height - rows.stop
        shape = (rows.stop - rows.start, self.located.width)
        return strips_at_places(
            shape, self.located.row_bytes,
            lambda first, end: self._picture(north + first, north + end),
        )  # fmt: skip

    def _picture(self, first: int, end: int) -> Picture:
        located = self.located
        count = (end - first) * located.row_bytes
        data = self.file.read(located.start + first * located.row_bytes, count)
        if len(data) < count:
            raise FileAccessError(CHANGED, source=self.image)
        return located.picture(data, first, self.image)

    def sha256(self) -> str:
        """Return the checksum of the whole file."""
        return self.file.sha256()


def _rows(file: OpenFile, head: bytes) -> BinaryRows | None:
    return _located(file, head, sys.maxsize)


def _located(file: OpenFile, head: bytes, max_cells: int) -> BinaryRows | None:
    def trailing(offset: int) -> bytes:
        return file.read(offset, _TRAILING)

    located = locate_pixels(head, file.size, trailing, file.path, max_cells=max_cells)
    return None if located is None else BinaryRows(file, located)


def _read(file: OpenFile, max_cells: int) -> Strips:
    head = file.read(0, HEAD)
    pnm_size(head, file.path, max_cells)
    rows = _located(file, head, max_cells)
    if rows is None:
        return strips_of(decode_pnm(file.read_whole(), file.path, max_cells))
    height, width = rows.shape
    claim(file.path, _memory(file, head), what=f"{width} x {height} cells")
    return rows.strips()


def _memory(file: OpenFile, head: bytes) -> int:
    return pnm_memory(head, file.size, file.path)


PNM = ImageFormat(
    name="PNM",
    suffixes=(".pgm", ".pbm", ".ppm", ".pnm"),
    recognises=is_pnm,
    read=_read,
    memory=_memory,
    size=pnm_size,
    max_cells=LARGEST_CELLS,
    suggested=("pgm", "pbm", "ppm"),
    comments=pnm_comments,
    rows=_rows,
)
