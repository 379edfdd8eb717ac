"""Images of every format that maps may have, decoded to integer samples.

The contents decide the format, not the file's name. `pnm` parses the format of nearly all maps, and
`pillow_images` has the others decoded by Pillow.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mapdeal.errors import MalformedInputError
from mapdeal.files.budget import holding
from mapdeal.files.source import LFS_POINTER, head_of, note_sum
from mapdeal.maps.picture import HEAD, NOT_AN_IMAGE, ImageFormat, OpenFile, Picture, Strips, opened
from mapdeal.maps.pillow_images import PILLOW_FORMATS
from mapdeal.maps.pnm import PNM, BinaryRows, binary_rows

IMAGE_FORMATS = {entry.name: entry for entry in (PNM, *PILLOW_FORMATS)}
"""The formats that maps may have, by name."""

IMAGE_SUFFIXES = tuple(suffix for entry in IMAGE_FORMATS.values() for suffix in entry.suffixes)
"""The endings of their file names."""


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
    """Open an image file to go through its picture once, without keeping any cells."""
    # Takes and raises what `open_strips` does.
    with opened(path) as file:
        image_format, head = _format_of(file)
        height, width = image_format.size(head, path, _limit(image_format, max_cells))
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
    yield image_format.read(file, _limit(image_format, max_cells))
    note_sum(file.path, file.sha256)


def read_image(path: Path, *, max_cells: int | None = None) -> Picture:
    """Return the decoded picture of an image file; takes and raises what `open_strips` does."""
    with open_strips(path, max_cells=max_cells) as strips:
        return strips.whole()


@contextmanager
def open_pixel_rows(path: Path) -> Iterator[BinaryRows | None]:
    """Open an image file whose rows can be read in any order; return None for every other."""
    with opened(path) as file:
        head = file.read(0, HEAD)
        yield binary_rows(file, head) if PNM.recognises(head) else None


def memory_to_read(path: Path) -> int:
    """Return the bytes that reading an image and making cells of it takes, from its header."""
    with opened(path) as file:
        image_format, head = _format_of(file)
        return image_format.memory(file, head)


def read_image_size(path: Path, *, max_cells: int | None = None) -> tuple[int, int]:
    """Return height and width of the picture in an image file, of which the header is read."""
    head = head_of(path, HEAD)
    image_format = _recognised(head, path)
    return image_format.size(head, path, _limit(image_format, max_cells))


def recognised_format(head: bytes) -> ImageFormat | None:
    """Return the format of a file with these first bytes, None if maps have none like it."""
    return next((entry for entry in IMAGE_FORMATS.values() if entry.recognises(head)), None)


def _format_of(file: OpenFile) -> tuple[ImageFormat, bytes]:
    head = file.read(0, HEAD)
    return _recognised(head, file.path), head


def _recognised(head: bytes, path: Path) -> ImageFormat:
    image_format = recognised_format(head)
    if image_format is None:
        _refuse_other_contents(head, path)
        raise MalformedInputError(NOT_AN_IMAGE, source=path)
    return image_format


def _limit(image_format: ImageFormat, max_cells: int | None) -> int:
    return image_format.max_cells if max_cells is None else max_cells


def _refuse_other_contents(head: bytes, path: Path) -> None:
    if not head:
        raise MalformedInputError("the image file is empty", source=path)
    if head.startswith(LFS_POINTER):
        hint = "fetch it with: git lfs pull"
        raise MalformedInputError("is a Git LFS pointer, not the image", source=path, hint=hint)
