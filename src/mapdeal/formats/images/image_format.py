"""The record of an image format: everything that the other modules need to know about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mapdeal.formats.picture import LARGEST_COMPRESSED_CELLS, Picture


class OtherContentsError(Exception):
    """Raised by a reader if a file begins like its format but is of another."""


def _no_comments(_head: bytes) -> list[str]:
    return []


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
        ``read(data, path, max_cells)`` returns the picture in the bytes of a whole file. It
        raises MalformedInputError, naming `path`, if they are damaged or hold more than
        `max_cells` cells; the latter before memory is taken. It raises OtherContentsError if the
        file is of another format.
    size : callable
        ``size(head, path, max_cells)`` returns height and width, and raises as `read` does, as
        far as the header tells. It opens the file only if `size_is_in_head` is false.
    size_is_in_head : bool
        Whether the first bytes hold the size. Pictures above the limit are refused before the
        file is read as a whole then.
    max_cells : int
        The default limit: the lower one for formats in which a small file may hold a large
        picture.
    suggested : tuple of str
        What the error about a file of no known format calls this one. Empty for formats that
        are read but should not be used.
    comments : callable
        ``comments(head)`` returns the comments in the header.

    Notes
    -----
    The readers of ROS treat some formats differently, because their image libraries do: the
    modules in `mapdeal.formats.dialects` know these by name. In a format that they do not name,
    samples mean what `Picture` says.
    """

    name: str
    suffixes: tuple[str, ...]
    recognises: Callable[[bytes], bool]
    read: Callable[[bytes, Path, int], Picture]
    size: Callable[[bytes, Path, int], tuple[int, int]]
    size_is_in_head: bool = True
    max_cells: int = LARGEST_COMPRESSED_CELLS
    suggested: tuple[str, ...] = ()
    comments: Callable[[bytes], list[str]] = _no_comments
