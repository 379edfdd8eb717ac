"""Images of every format that map_server reads, decoded to integer samples.

PNM is parsed here, PNG, BMP, TIFF and JPEG go through Pillow. The contents decide the format,
not the file's name.
"""

from __future__ import annotations

import io
import logging
import os
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, MapdealWarning
from mapdeal.formats.picture import (
    LARGEST_CELLS,
    LARGEST_COMPRESSED_CELLS,
    Picture,
    Samples,
    check_size,
)
from mapdeal.formats.png_chunks import PngFacts, read_png_facts
from mapdeal.formats.pnm import LONGEST_HEADER, check_pnm_header, decode_pnm, is_pnm, pnm_size
from mapdeal.formats.source import head_of, read_file

_PILLOW_FORMATS = ("PNG", "BMP", "TIFF", "JPEG")
_EXIF_ORIENTATION = 0x0112
_PILLOW_REMARKS = logging.NullHandler()


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
    plain_limit = LARGEST_CELLS if max_cells is None else max_cells

    def inspect(head: bytes) -> None:
        if is_pnm(head):
            check_pnm_header(head, path, max_cells=plain_limit)
        else:
            _refuse_other_contents(head, path)

    data = read_file(path, inspect=inspect)
    if is_pnm(data):
        return decode_pnm(data, path, max_cells=plain_limit)
    limit = LARGEST_COMPRESSED_CELLS if max_cells is None else max_cells
    return _decode_with_pillow(data, path, limit)


def read_image_size(path: Path, *, max_cells: int | None = None) -> tuple[int, int]:
    """Return height and width of the picture in an image file, of which the header is read.

    Raises
    ------
    FileAccessError, MalformedInputError
        As `read_image`, as far as the header tells.
    """
    head = head_of(path, LONGEST_HEADER)
    if is_pnm(head):
        plain_limit = LARGEST_CELLS if max_cells is None else max_cells
        check_pnm_header(head, path, max_cells=plain_limit)
        return pnm_size(head, path)
    _refuse_other_contents(head, path)
    limit = LARGEST_COMPRESSED_CELLS if max_cells is None else max_cells
    with path.open("rb") as file, _open(file, path, limit) as image:
        return image.height, image.width


def _refuse_other_contents(data: bytes, path: Path) -> None:
    if not data:
        raise MalformedInputError("the image file is empty", source=path)
    if data.startswith(b"version https://git-lfs"):
        hint = "fetch it with: git lfs pull"
        raise MalformedInputError("is a Git LFS pointer, not the image", source=path, hint=hint)


def _decode_with_pillow(data: bytes, path: Path, limit: int) -> Picture:
    image = _open(io.BytesIO(data), path, limit)
    with image:
        facts = read_png_facts(data, path) if image.format == "PNG" else None
        with _damage_named(path), _silent_libtiff(image.format):
            image.load()
            orientation = image.getexif().get(_EXIF_ORIENTATION, 1)
        if orientation != 1:
            _warn(path, "the EXIF orientation was not applied, as in ROS", "image.orientation")
        picture = _picture_of(image, data, path, facts)
        return replace(picture, display=facts.display) if facts is not None else picture


def _open(file: BinaryIO, path: Path, limit: int) -> Any:
    """Return the image, its header read and checked, its pixels not decoded yet."""
    from PIL import Image, UnidentifiedImageError

    try:
        with _no_size_limit(), _damage_named(path):
            image = Image.open(file, formats=_PILLOW_FORMATS)
            frames = getattr(image, "n_frames", 1)
    except UnidentifiedImageError:
        rule = "is no image of a format that maps have: pgm, pbm, ppm, png, bmp, tiff"
        raise MalformedInputError(rule, source=path) from None
    check_size(path, image.width, image.height, limit)
    if frames > 1:
        raise MalformedInputError("holds more than one picture", source=path)
    return image


@contextmanager
def _damage_named(path: Path) -> Iterator[None]:
    """Turn whatever damage leads Pillow's decoders to into one clear error."""
    from PIL import UnidentifiedImageError

    # Pillow remarks on odd tags and logs what it cannot decode; neither decides anything here.
    logging.getLogger("PIL").addHandler(_PILLOW_REMARKS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except UnidentifiedImageError:
        raise
    except (OSError, SyntaxError, ValueError, EOFError, IndexError, KeyError, TypeError,
            OverflowError, struct.error) as error:  # fmt: skip
        rule = f"the image is damaged: {error}"
        raise MalformedInputError(rule, source=path) from None


@contextmanager
def _silent_libtiff(file_format: str | None) -> Iterator[None]:
    """Keep libtiff, which writes to the terminal by itself, from doing so."""
    if file_format != "TIFF":
        yield
        return
    saved, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(nowhere)


@contextmanager
def _no_size_limit() -> Iterator[None]:
    """Put Pillow's own, lower limit aside: ours is checked before anything is decoded."""
    from PIL import Image

    before = Image.MAX_IMAGE_PIXELS
    Image.MAX_IMAGE_PIXELS = None
    try:
        yield
    finally:
        Image.MAX_IMAGE_PIXELS = before


def _warn(path: Path, text: str, check: str) -> None:
    warnings.warn(MapdealWarning(f"{path}: {text}", check), stacklevel=4)


def _picture_of(image: Any, data: bytes, path: Path, facts: PngFacts | None) -> Picture:
    mode = image.mode
    kind = image.format
    if kind == "JPEG":
        _warn(path, "JPEG is lossy: greys may have moved across the thresholds", "image.lossy")
    if kind == "BMP" and data[28:30] == b"\x20\x00" and data[30:34] == b"\0\0\0\0":
        bgra = _bmp_32_bit(data, path, image.width, image.height)
        return Picture("BMP", "rgb", bgra[..., 2::-1], alpha=bgra[..., 3])
    if mode == "1":
        bits = np.asarray(image, dtype=np.uint8)
        if kind == "BMP":  # Pillow's name for a palette of black and white
            palette = np.array([[0, 0, 0, 255], [255, 255, 255, 255]], dtype=np.uint8)
            return Picture("BMP", "palette", bits, palette=palette)
        grey = bits * np.uint8(255)
        return _with_key(Picture(kind, "grey", grey), facts, path)
    if mode == "L":
        return _with_key(Picture(kind, "grey", np.asarray(image)), facts, path)
    if mode.startswith("I;16") or (mode == "I" and facts is not None):
        samples = np.asarray(image).astype(np.uint16)
        return _with_key(Picture(kind, "grey", samples, maxval=65535), facts, path)
    if facts is not None and facts.bit_depth == 16:
        _warn(path, "16-bit colour was reduced to 8 bits; ROS 2 reads all 16", "image.depth")
    if mode == "P":
        return Picture(kind, "palette", np.asarray(image), palette=_palette(image, facts))
    if mode == "RGB":
        return _with_key(Picture(kind, "rgb", np.asarray(image)), facts, path)
    if mode == "LA" or (mode == "RGBA" and facts is not None and not facts.has_colour):
        pixels = np.asarray(image)
        return Picture(kind, "grey", pixels[..., 0], alpha=pixels[..., -1])
    if mode == "RGBA":
        pixels = np.asarray(image)
        return Picture(kind, "rgb", pixels[..., :3], alpha=pixels[..., 3])
    raise MalformedInputError("pixels of this kind make no map", source=path, got=mode)


def _palette(image: Any, facts: PngFacts | None) -> NDArray[np.uint8]:
    """Return red, green, blue, opacity of all 256 indices; those not defined are black."""
    colours = np.array(image.getpalette("RGB"), dtype=np.uint8).reshape(-1, 3)
    table = np.zeros((256, 4), dtype=np.uint8)
    table[:, 3] = 255
    table[: len(colours), :3] = colours
    if facts is not None and facts.transparency is not None:
        opacities = np.frombuffer(facts.transparency, dtype=np.uint8)
        table[: len(opacities), 3] = opacities[:256]
    return table


def _with_key(picture: Picture, facts: PngFacts | None, path: Path) -> Picture:
    """Return `picture` with the opacity that a transparent colour (PNG tRNS) asks for."""
    key = facts.key() if facts is not None else None
    if facts is None or key is None:
        return picture
    if picture.colour == "rgb":
        # The ROS 2 readers compare an 8-bit key with 16-bit samples: only black ever matches.
        transparent = (
            np.all(picture.samples == 0, axis=2)
            if key == (0, 0, 0)
            else np.zeros(picture.shape, dtype=bool)
        )
        text = "one colour is transparent; read as ROS 2 does, where only black matches"
        _warn(path, text, "image.transparent-colour")
    else:
        scale = 1 if facts.bit_depth == 16 else 255 // ((1 << facts.bit_depth) - 1)
        transparent = picture.samples == key[0] * scale
    full = np.array(picture.maxval, dtype=picture.samples.dtype)
    alpha: Samples = np.where(transparent, np.zeros_like(full), full)
    return Picture(
        picture.file_format, picture.colour, picture.samples, picture.maxval, alpha, "key"
    )  # fmt: skip


def _bmp_32_bit(data: bytes, path: Path, width: int, height: int) -> NDArray[np.uint8]:
    """Return blue, green, red, opacity: Pillow drops the fourth byte, ROS reads it as opacity."""
    (offset,) = struct.unpack_from("<I", data, 10)
    (signed_height,) = struct.unpack_from("<i", data, 22)
    if offset + 4 * width * height > len(data):
        raise MalformedInputError("the image file ends early", source=path)
    pixels = np.frombuffer(data, dtype=np.uint8, count=4 * width * height, offset=offset)
    pixels = pixels.reshape(height, width, 4)
    return pixels if signed_height < 0 else pixels[::-1]
