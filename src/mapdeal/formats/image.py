"""Images of every format that maps may have, decoded to integer samples.

The contents decide the format, not the file's name; `images.catalogue` lists the formats. Nearly
all maps are of the first one, PNM: to import the others would take longer than to read a small map.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mapdeal.errors import MalformedInputError
from mapdeal.formats.budget import holding
from mapdeal.formats.images import pnm
from mapdeal.formats.images.image_format import ImageFormat, OtherContentsError
from mapdeal.formats.open_file import HEAD, OpenFile, opened
from mapdeal.formats.picture import Picture
from mapdeal.formats.source import head_of, note_sum
from mapdeal.formats.strips import PixelRows, Strips


@contextmanager
def open_strips(path: Path, *, max_cells: int | None = None) -> Iterator[Strips]:
    """Open an image file to go through its picture some rows at a time."""
    with opened(path) as file:
        image_format, _ = _format_of(file)
        with _strips_in(file, image_format, max_cells) as strips:
            yield strips


@contextmanager
def open_passing(
    path: Path, *, max_cells: int | None = None
) -> Iterator[tuple[Strips, bytes]]:  # fmt: skip
    """Open an image file to go through its picture once, without keeping any cells.

    Takes and raises what `open_strips` does.
    """
    with opened(path) as file:
        image_format, head = _format_of(file)
        try:
            height, width = image_format.size(head, path, _limit(image_format, max_cells))
        except OtherContentsError:
            raise _unknown_format(path) from None
        with (
            holding(-height * width),
            _strips_in(file, image_format, max_cells) as strips,
        ):  # fmt: skip
            yield strips, head


@contextmanager
def _strips_in(
    file: OpenFile, image_format: ImageFormat, max_cells: int | None
) -> Iterator[Strips]:  # fmt: skip
    file.check_length()  # its checksum is of all of it
    try:
        strips = image_format.read(file, _limit(image_format, max_cells))
    except OtherContentsError:
        raise _unknown_format(file.path) from None
    yield strips
    note_sum(file.path, file.sha256)


def read_image(path: Path, *, max_cells: int | None = None) -> Picture:
    """Return the decoded picture of an image file; takes and raises what `open_strips` does."""
    with open_strips(path, max_cells=max_cells) as strips:
        return strips.whole()


@contextmanager
def open_pixel_rows(path: Path) -> Iterator[PixelRows | None]:
    """Open an image file whose rows can be read in any order; return None for every other.

    `strips_of_rows` must be gone through before rows are asked for if the image is compressed.
    """
    with opened(path) as file:
        head = file.read(0, HEAD)
        image_format = recognised_format(head)
        yield None if image_format is None else image_format.rows(file, head)


def strips_of_rows(pixels: PixelRows) -> Strips:
    """Return all rows of an image, see `PixelRows.strips`; raises what `open_strips` does."""
    try:
        return pixels.strips()
    except OtherContentsError:
        raise _unknown_format(pixels.image) from None


def memory_to_read(path: Path) -> int:
    """Return the bytes that reading an image and making cells of it takes, from its header."""
    with opened(path) as file:
        image_format, head = _format_of(file)
        try:
            return image_format.memory(file, head)
        except OtherContentsError:
            raise _unknown_format(path) from None


def read_image_size(path: Path, *, max_cells: int | None = None) -> tuple[int, int]:
    """Return height and width of the picture in an image file, of which the header is read."""
    head = head_of(path, HEAD)
    image_format = _recognised(head, path)
    try:
        return image_format.size(head, path, _limit(image_format, max_cells))
    except OtherContentsError:
        raise _unknown_format(path) from None


def recognised_format(head: bytes) -> ImageFormat | None:
    """Return the format of a file with these first bytes, None if maps have none like it."""
    if pnm.PNM.recognises(head):
        return pnm.PNM
    from mapdeal.formats.images.catalogue import recognised

    return recognised(head)


def _format_of(file: OpenFile) -> tuple[ImageFormat, bytes]:
    """Return the format of an open file, and its first bytes."""
    head = file.read(0, HEAD)
    return _recognised(head, file.path), head


def _recognised(head: bytes, path: Path) -> ImageFormat:
    image_format = recognised_format(head)
    if image_format is None:
        _refuse_other_contents(head, path)
        raise _unknown_format(path)
    return image_format


def _limit(image_format: ImageFormat, max_cells: int | None) -> int:
    return image_format.max_cells if max_cells is None else max_cells


def _refuse_other_contents(head: bytes, path: Path) -> None:
    if not head:
        raise MalformedInputError("the image file is empty", source=path)
    if head.startswith(b"version https://git-lfs"):
        hint = "fetch it with: git lfs pull"
        raise MalformedInputError("is a Git LFS pointer, not the image", source=path, hint=hint)


def _unknown_format(path: Path) -> MalformedInputError:
    from mapdeal.formats.images.catalogue import IMAGE_FORMATS

    names = [name for entry in IMAGE_FORMATS.values() for name in entry.suggested]
    rule = f"is not an image in a supported format: {', '.join(names)}"
    return MalformedInputError(rule, source=path)
