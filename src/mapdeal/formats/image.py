"""Images of every format that maps may have, decoded to integer samples.

The contents decide the format, not the file's name; `images.catalogue` lists the formats.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mapdeal.errors import MalformedInputError
from mapdeal.formats.images.catalogue import IMAGE_FORMATS, recognised
from mapdeal.formats.images.image_format import ImageFormat, OtherContentsError
from mapdeal.formats.picture import Picture
from mapdeal.formats.source import head_of, read_file
from mapdeal.formats.strips import Strips, strips_of

_HEAD = 1 << 16


def read_image(path: Path, *, max_cells: int | None = None) -> Picture:
    """Return the decoded picture of an image file.

    Parameters
    ----------
    path : Path
        The file.
    max_cells : int, optional
        Cells up to which an image is read; 2e8 for compressed formats and 1e9 for others if
        not given. Held before memory is taken.

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    MalformedInputError
        If it is no image, damaged, too large, or of a kind that maps are not made of.
    """

    def inspect(head: bytes) -> None:
        image_format = recognised(head)
        if image_format is None:
            _refuse_other_contents(head, path)
        elif image_format.size_is_in_head:
            image_format.size(head, path, _limit(image_format, max_cells))

    data = read_file(path, inspect=inspect)
    image_format = recognised(data)
    if image_format is None:
        raise _unknown_format(path)
    try:
        return image_format.read(data, path, _limit(image_format, max_cells))
    except OtherContentsError:
        raise _unknown_format(path) from None


@contextmanager
def open_strips(path: Path, *, max_cells: int | None = None) -> Iterator[Strips]:
    """Open an image file to go through its picture some rows at a time.

    Parameters
    ----------
    path, max_cells
        As for `read_image`.

    Raises
    ------
    FileAccessError, MalformedInputError
        As `read_image`: on opening, or while the strips are gone through.
    """
    yield strips_of(read_image(path, max_cells=max_cells))


def read_image_size(path: Path, *, max_cells: int | None = None) -> tuple[int, int]:
    """Return height and width of the picture in an image file, of which the header is read.

    Raises
    ------
    FileAccessError, MalformedInputError
        As `read_image`, as far as the header tells.
    """
    head = head_of(path, _HEAD)
    image_format = recognised(head)
    if image_format is None:
        _refuse_other_contents(head, path)
        raise _unknown_format(path)
    try:
        return image_format.size(head, path, _limit(image_format, max_cells))
    except OtherContentsError:
        raise _unknown_format(path) from None


def _limit(image_format: ImageFormat, max_cells: int | None) -> int:
    return image_format.max_cells if max_cells is None else max_cells


def _refuse_other_contents(head: bytes, path: Path) -> None:
    if not head:
        raise MalformedInputError("the image file is empty", source=path)
    if head.startswith(b"version https://git-lfs"):
        hint = "fetch it with: git lfs pull"
        raise MalformedInputError("is a Git LFS pointer, not the image", source=path, hint=hint)


def _unknown_format(path: Path) -> MalformedInputError:
    names = [name for entry in IMAGE_FORMATS.values() for name in entry.suggested]
    rule = f"is no image of a format that maps have: {', '.join(names)}"
    return MalformedInputError(rule, source=path)
