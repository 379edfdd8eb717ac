"""The record of an image format: everything that the other modules need to know about it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mapdeal.formats.open_file import OpenFile
from mapdeal.formats.picture import LARGEST_COMPRESSED_CELLS
from mapdeal.formats.strips import PixelRows, Strips
from mapdeal.records import dataclass


class OtherContentsError(Exception):
    """Raised by a reader if a file begins like its format but is of another."""


def _no_comments(_head: bytes) -> list[str]:
    return []


def _no_rows(_file: OpenFile, _head: bytes) -> PixelRows | None:
    return None


@dataclass(frozen=True)
class ImageFormat:
    """An image format that maps may have.

    Parameters
    ----------
    name : str
        Unique; pictures carry it as `Picture.file_format`.
    suffixes : tuple of str
        Endings of its file names, lower case, with the dot.
    recognises : callable
        ``recognises(head)`` returns whether a file with these first bytes, 64 KiB or more unless
        the file is shorter, is of this format. Formats must not overlap.
    read : callable
        ``read(file, max_cells)`` returns the strips of the picture in an open file. It raises
        MalformedInputError, naming the file, if it is damaged or holds more than `max_cells`
        cells; the latter before memory is taken. So do the strips, as they are gone through. It
        raises OtherContentsError if the file is of another format.
    memory : callable
        ``memory(file, head)`` returns the bytes that reading takes at its peak, with a byte for
        each cell that is made of a pixel, as far as the header shows; it raises as `size` does.
        This is what `read` claims.
    size : callable
        ``size(head, path, max_cells)`` returns height and width, and raises as `read` does, as
        far as the header shows. It opens the file only if its first bytes do not suffice.
    max_cells : int
        The default limit: the lower one for formats in which a small file may hold a large
        picture.
    suggested : tuple of str
        What the error about a file of no known format calls this one. Empty for formats that
        are read but should not be used.
    comments : callable
        ``comments(head)`` returns the comments in the header.
    rows : callable
        ``rows(file, head)`` returns the pixels of an open file if its rows can be read in any
        order, else None. It looks at no more than the header, and raises as `read` does.

    Notes
    -----
    The readers of ROS treat some formats differently, because their image libraries do: the
    modules in `mapdeal.formats.dialects` know these by name. In a format that they do not name,
    samples mean what `Picture` says.
    """

    name: str
    suffixes: tuple[str, ...]
    recognises: Callable[[bytes], bool]
    read: Callable[[OpenFile, int], Strips]
    memory: Callable[[OpenFile, bytes], int]
    size: Callable[[bytes, Path, int], tuple[int, int]]
    max_cells: int = LARGEST_COMPRESSED_CELLS
    suggested: tuple[str, ...] = ()
    comments: Callable[[bytes], list[str]] = _no_comments
    rows: Callable[[OpenFile, bytes], PixelRows | None] = _no_rows
