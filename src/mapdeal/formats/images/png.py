"""PNG images, read row by row with the facts that Pillow smooths over; if interlaced, by Pillow."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.budget import BLANK_EXPANSION, PIECES, check_expansion, claim
from mapdeal.formats.images.image_format import ImageFormat
from mapdeal.formats.images.memory import decoding_memory
from mapdeal.formats.images.pillow import (
    grey_and_alpha,
    load,
    open_image,
    picture_of,
    size_by_pillow,
    strips_of_image,
    warn,
    wide_grey,
)
from mapdeal.formats.images.png_chunks import (
    SIGNATURE,
    PngFacts,
    PngHeader,
    claim_before_pixels,
    read_png_facts,
    read_png_header,
)
from mapdeal.formats.images.png_rows import (
    PngBytes,
    check_passes,
    marks_memory,
    strip_memory,
)
from mapdeal.formats.open_file import HEAD, OpenFile
from mapdeal.formats.picture import LARGEST_COMPRESSED_CELLS, Picture, check_size
from mapdeal.formats.strips import Strips

NAME = "PNG"


class PngRows:
    """The pixels of an open PNG file, see `mapdeal.formats.strips.PixelRows`."""

    max_cells = LARGEST_COMPRESSED_CELLS
    is_compressed = True

    def __init__(self, file: OpenFile, height: int, width: int, memory: int) -> None:
        self.image = file.path
        self.shape = (height, width)
        self.memory = memory
        self._file = file
        self._pictures: _Pictures | None = None

    def strips(self) -> Strips:
        """Return all rows, of which those that `part` goes on from are remembered."""
        facts = _checked_facts(self._file, sys.maxsize)
        pictures = self._pictures = _Pictures(self._file, facts)
        return Strips(self.shape, lambda: pictures.all(leaves_marks=True))

    def part(self, rows: slice) -> Strips:
        """Return some rows, which are counted from the south."""
        pictures, (height, width) = self._pictures, self.shape
        if pictures is None:
            raise ValueError("all strips must be gone through before")
        shape = (rows.stop - rows.start, width)
        return Strips(shape, lambda: pictures.some(height - rows.stop, height - rows.start))

    def sha256(self) -> str:
        """Return the checksum of the whole file."""
        return self._file.sha256()


class _Pictures:
    """Turns the bytes of rows into pictures."""

    def __init__(self, file: OpenFile, facts: PngFacts) -> None:
        self._facts = facts
        self._bytes = PngBytes(file, facts)

    def all(self, *, leaves_marks: bool = False) -> Iterator[Picture]:
        return map(self._picture, self._bytes.all(leaves_marks=leaves_marks))

    def some(self, first: int, end: int) -> Iterator[Picture]:
        return map(self._picture, self._bytes.some(first, end))

    def _picture(self, rows: NDArray[np.uint8]) -> Picture:
        return _with_facts(_picture_of_bytes(rows, self._facts), self._facts)


def read_png(file: OpenFile, max_cells: int) -> Strips:
    """Return the strips of the picture in a PNG file, see `ImageFormat.read`."""
    facts = _checked_facts(file, max_cells)
    shape = (facts.height, facts.width)
    what = f"{facts.width} x {facts.height} cells"
    claim(file.path, _memory_of(facts), what=what)
    if facts.is_interlaced:
        return _interlaced(file, facts, max_cells)
    pictures = _Pictures(file, facts)
    return Strips(shape, pictures.all)


def _interlaced(file: OpenFile, facts: PngFacts, max_cells: int) -> Strips:
    """Return the strips of a picture that comes in passes: of what Pillow makes of it."""
    image = open_image(file.stream(), NAME, file.path, max_cells)
    check_passes(file, facts)
    load(image, file.path)
    return strips_of_image(
        image, lambda part: _with_facts(_picture_of_image(part, facts, file.path), facts)
    )


def _checked_facts(file: OpenFile, max_cells: int) -> PngFacts:
    """Return what the chunks of a file say, all that is wrong with them refused or warned of."""
    path = file.path
    _check_header(file.read(0, HEAD), path)
    claim_before_pixels(file)
    with open_image(file.stream(), NAME, path, max_cells):
        facts = read_png_facts(file)
    expanded = -(-facts.width * facts.bits // 8) * facts.height
    check_expansion(path, file.size, expanded, most=BLANK_EXPANSION, place="image size")
    if any(facts.texts) and not facts.is_interlaced:
        # the same chunks around a single pixel, for Pillow to find an orientation in
        with open_image(io.BytesIO(facts.around_a_pixel()), NAME, path, max_cells) as image:
            load(image, path)
    if facts.bit_depth == 16 and (facts.has_colour or facts.has_alpha):
        text = "16-bit colour was reduced to 8 bits; ROS 2 reads all 16"
        warn(path, text, "image.depth")
    if facts.key() is not None and facts.has_colour:
        text = "one colour is transparent; read as ROS 2 does, where only black matches"
        warn(path, text, "image.transparent-colour")
    return facts


def _size(head: bytes, path: Path, max_cells: int) -> tuple[int, int]:
    _check_header(head, path)
    return _size_by_pillow(head, path, max_cells)


def _check_header(head: bytes, path: Path) -> None:
    """Refuse a header with numbers that Pillow does not take for a PNG file's.

    A file in which none comes first is left to Pillow.
    """
    if _has_header(head):
        header = read_png_header(head, path)
        check_size(path, header.width, header.height, sys.maxsize)


def _has_header(head: bytes) -> bool:
    return head[len(SIGNATURE) + 4 :].startswith(b"IHDR")


_size_by_pillow = size_by_pillow(NAME)


def _memory(file: OpenFile, head: bytes) -> int:
    _check_header(head, file.path)
    return _memory_of(read_png_header(head, file.path)) if _has_header(head) else 0


def _memory_of(facts: PngFacts | PngHeader) -> int:
    cells = facts.width * facts.height
    if facts.is_interlaced:
        return decoding_memory(facts.mode, (facts.width, facts.height), 0)
    return cells + _memory_of_strips(facts)


def _memory_of_strips(facts: PngFacts | PngHeader) -> int:
    return strip_memory(facts) + min(3 * PIECES // 4, 100 * facts.width * facts.height)


def _rows(file: OpenFile, head: bytes) -> PngRows | None:
    if not _has_header(head):
        return None
    header = read_png_header(head, file.path)
    check_size(file.path, header.width, header.height, sys.maxsize)
    if header.is_interlaced:
        return None
    memory = marks_memory(header) + _memory_of_strips(header)
    return PngRows(file, header.height, header.width, memory)


def _picture_of_bytes(rows: NDArray[np.uint8], facts: PngFacts) -> Picture:
    """Return the picture of rows of bytes, those of `PngBytes`."""
    depth, shape = facts.bit_depth, (len(rows), facts.width)
    if facts.has_palette:
        return Picture(NAME, "palette", _unpacked(rows, facts), palette=_palette(facts))
    if facts.has_colour and facts.has_alpha:
        pixels = rows.reshape(*shape, 4)
        return Picture(NAME, "rgb", pixels[..., :3], alpha=pixels[..., 3])
    if facts.has_colour:
        return Picture(NAME, "rgb", rows.reshape(*shape, 3))
    if facts.has_alpha:
        pixels = rows.reshape(*shape, 2)
        return Picture(NAME, "grey", pixels[..., 0], alpha=pixels[..., 1])
    if depth == 16:
        wide = np.ascontiguousarray(rows).view(">u2").astype(np.uint16)
        return Picture(NAME, "grey", wide, maxval=65535)
    return Picture(NAME, "grey", _unpacked(rows, facts) * np.uint8(255 // ((1 << depth) - 1)))


def _unpacked(rows: NDArray[np.uint8], facts: PngFacts) -> NDArray[np.uint8]:
    """Return the samples of rows, eight or fewer bits each, the first in the highest bits."""
    depth = facts.bit_depth
    if depth == 8:
        return rows
    if depth == 1:
        return np.unpackbits(rows, axis=1, count=facts.width)
    shifts = np.arange(8 - depth, -1, -depth, dtype=np.uint8)
    samples = rows[..., np.newaxis] >> shifts & np.uint8((1 << depth) - 1)
    return samples.reshape(len(rows), -1)[:, : facts.width]


def _palette(facts: PngFacts) -> NDArray[np.uint8]:
    """Return red, green, blue, opacity of all 256 indices; those not defined are black."""
    colours = np.frombuffer(facts.palette, dtype=np.uint8).reshape(-1, 3)
    table = np.zeros((256, 4), dtype=np.uint8)
    table[:, 3] = 255
    table[: len(colours), :3] = colours
    return table


def _picture_of_image(image: Any, facts: PngFacts, path: Path) -> Picture:
    if image.mode == "I":  # older Pillow's mode for 16-bit grey
        return wide_grey(image, NAME)
    if image.mode == "RGBA" and not facts.has_colour:
        return grey_and_alpha(image, NAME)
    return picture_of(image, NAME, path)


def _with_facts(picture: Picture, facts: PngFacts) -> Picture:
    """Return a picture with what other chunks say of its pixels."""
    if picture.palette is not None:
        return replace(
            picture, palette=_with_opacities(picture.palette, facts), display=facts.display
        )
    if picture.alpha is None:
        picture = _with_key(picture, facts)
    return replace(picture, display=facts.display)


def _with_opacities(palette: NDArray[np.uint8], facts: PngFacts) -> NDArray[np.uint8]:
    """Return a palette with the opacities of chunk tRNS."""
    opacities = np.frombuffer(facts.transparency or b"", dtype=np.uint8)[:256]
    table = palette.copy()
    table[: len(opacities), 3] = opacities
    return table


def _with_key(picture: Picture, facts: PngFacts) -> Picture:
    """Return `picture` with the opacity that a transparent colour (chunk tRNS) asks for."""
    key = facts.key()
    if key is None:
        return picture
    if picture.colour == "rgb":
        # The ROS 2 readers compare an 8-bit key with 16-bit samples: only black ever matches.
        transparent = (
            np.all(picture.samples == 0, axis=2)
            if key == (0, 0, 0)
            else np.zeros(picture.shape, dtype=bool)
        )
    else:
        scale = 1 if facts.bit_depth == 16 else 255 // ((1 << facts.bit_depth) - 1)
        transparent = picture.samples == key[0] * scale
    full = np.array(picture.maxval, dtype=picture.samples.dtype)
    alpha = np.where(transparent, np.zeros_like(full), full)
    return replace(picture, alpha=alpha, alpha_from="key")


PNG = ImageFormat(
    name=NAME,
    suffixes=(".png",),
    recognises=lambda head: head.startswith(SIGNATURE),
    read=read_png,
    memory=_memory,
    size=_size,
    suggested=("png",),
    rows=_rows,
)
