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
