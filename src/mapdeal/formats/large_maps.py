"""Maps of map_server pairs of which no more than some rows are ever in memory."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MapdealError, MapdealWarning
from mapdeal.formats.dialects import DIALECTS
from mapdeal.formats.map_server import find_image
from mapdeal.formats.map_yaml import Dialect, MapMetadata, read_metadata
from mapdeal.formats.picture import LARGEST_CELLS, Picture
from mapdeal.formats.pnm import GreyFile, check_pixels, locate_pixels
from mapdeal.formats.source import check_regular
from mapdeal.grid.large import LargeMap
from mapdeal.kernels.rows import MadeRows, Room

_HEAD = 1 << 17
_SOME = 256
_VALUES_OF_RAW = (101, 254)


@dataclass(frozen=True)
class LargeSource:
    """A large map, and the files it is read from.

    Parameters
    ----------
    grid : LargeMap
        The map.
    files : tuple of Path
        The YAML file and the image.
    """

    grid: LargeMap
    files: tuple[Path, ...]


def shape_of_pair(path: Path) -> tuple[int, int] | None:
    """Return the rows and columns of a map that `open_pair` opens, from its header alone.

    None for every other file, be it another kind of map or none: reading it tells.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapdealWarning)  # reading the map warns of it again
        try:
            with open_pair(path, together=1, max_cells=sys.maxsize, is_read=False) as source:
                return None if source is None else source.grid.shape
        except MapdealError:
            return None


@contextmanager
def open_pair(
    path: Path,
    *,
    together: int,
    room: Room | None = None,
    dialect: Dialect = "nav2",
    max_cells: int | None = None,
    is_read: bool = True,
) -> Iterator[LargeSource | None]:
    """Open a pair whose image is a P5 file of 8 bits; give None for every other kind of map.

    Parameters
    ----------
    path : Path
        The YAML file.
    together : int
        Rows that are read together.
    room : Room, optional
        What layers made of the map may take to keep their rows.
    dialect : {'nav2', 'humble', 'ros1'}
        Whose reading of pixels to follow.
    max_cells : int, optional
        Cells up to which the image is read, 1e9 if not given.
    is_read : bool
        Whether pixels will be asked for, and may be looked at now.

    Raises
    ------
    FileAccessError
        If one of the files cannot be read, and, in the end, if the image has changed meanwhile.
    MalformedInputError
        If one of them is malformed; of pixels, when they are read.
    """
    metadata = read_metadata(path, dialect=dialect)
    if metadata.cost_scale is not None:
        yield None
        return
    image = find_image(path, metadata.image)
    check_regular(image)
    with _opened(image) as descriptor:
        before = os.fstat(descriptor)

        def read(offset: int, count: int = _SOME) -> bytes:
            return _read(descriptor, offset, count, image)

        limit = LARGEST_CELLS if max_cells is None else max_cells
        located = locate_pixels(
            read(0, _HEAD), before.st_size, read, image, max_cells=limit
        )  # fmt: skip
        if located is None:
            yield None
            return
        rows = _Rows(descriptor, located, image, metadata, dialect)
        shape = (located.height, located.width)
        layer = MadeRows(shape, np.int8, rows.occupancy, together=together, room=room)
        if metadata.mode == "raw" and is_read:
            rows.warn_of_lost_values(together)
        yield LargeSource(LargeMap(layer, metadata.resolution, metadata.origin), (path, image))
        after = os.fstat(descriptor)
        if (after.st_size, after.st_mtime_ns) != (before.st_size, before.st_mtime_ns):
            raise FileAccessError("changed while it was read", source=image)


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


@dataclass(frozen=True)
class _Rows:
    """Reads rows of a picture and gives them a meaning."""

    descriptor: int
    located: GreyFile
    image: Path
    metadata: MapMetadata
    dialect: Dialect

    def occupancy(self, first: int, end: int) -> NDArray[np.int8]:
        """Return rows counted from the south."""
        picture = Picture("PNM", "grey", self._samples(first, end), maxval=self.located.maxval)
        return np.ascontiguousarray(DIALECTS[self.dialect](picture, self.metadata))

    def _samples(self, first: int, end: int) -> NDArray[np.uint8]:
        """Return pixels of rows counted from the south."""
        located = self.located
        north = located.height - end
        count = (end - first) * located.width
        start = located.start + north * located.width
        data = _read(self.descriptor, start, count, self.image)
        if len(data) < count:
            raise FileAccessError("changed while it was read", source=self.image)
        samples = np.frombuffer(data, dtype=np.uint8).reshape(end - first, located.width)
        check_pixels(samples, located.maxval, north * located.width, self.image)
        return samples[::-1]

    def warn_of_lost_values(self, together: int) -> None:
        """Warn of pixels of mode raw that hold no value of a map, as for maps in memory."""
        if self.located.maxval != 255:
            return
        lost, (least, most) = 0, _VALUES_OF_RAW
        for first in range(0, self.located.height, together):
            samples = self._samples(first, min(first + together, self.located.height))
            lost += int(np.count_nonzero((samples >= least) & (samples <= most)))
        if lost:
            text = f"{self.image}: {lost} pixels of mode raw hold 101..254, read as unknown"
            warnings.warn(MapdealWarning(text, "image.raw-values"), stacklevel=5)
