"""PNG, BMP, TIFF and JPEG images, which Pillow decodes as wholes.

Pillow is imported by the functions that need it: most maps are PNM.
"""

from __future__ import annotations

import io
import os
import struct
import sys
import threading
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError, MapdealWarning, emit_warning
from mapdeal.files.budget import BLANK_EXPANSION, PIECES, check_expansion, claim
from mapdeal.maps.picture import (
    NOT_AN_IMAGE,
    ImageFormat,
    OpenFile,
    Picture,
    Strips,
    check_size,
    opened,
    rows_of_strip,
)

_EXIF_ORIENTATION = 0x0112

_DEPTHS = {"1": 1, "L;2": 2, "L;4": 4, "P;1": 1, "P;2": 2, "P;4": 4}
"""Bits of a sample in PNG files, by Pillow's raw modes, where they are fewer than 8."""

_BITS = {"1": 1, "L": 8, "P": 8, "I;16": 16, "I;16B": 16, "LA": 16, "RGB": 24}
_WIDE = 32
"""Bits of a pixel in files, by Pillow's modes, and those of all others at most."""

_KEPT = {"1": 1, "L": 1, "P": 1, "I;16": 2, "I;16B": 2}
_KEPT_OF_OTHERS = 4
"""Bytes of a pixel in Pillow's memory, by its modes."""

_RAW_BMP, _RAW_TIFF = 0, "raw"
_BITS_PER_SAMPLE, _SAMPLES, _ROWS_PER_STRIP, _PLANAR = 258, 277, 278, 284
_STRIPS, _TILES, _TILE = (273, 279), (324, 325), (322, 323)
"""Tags of a TIFF file: of offsets and sizes, and of a tile's width and height."""

# Pillow's limit, the filters of warnings and the terminal that libtiff writes to belong to the
# whole process: two threads that put them aside and back at once would leave them aside.
_LOCK = threading.RLock()
_OF_PILLOW = r"PIL\.|mapdeal\.formats\.pillow_images$"

_DAMAGE = (
    OSError,  # Pillow's own word for data that end early or cannot be decoded
    SyntaxError,  # and for headers that break their format's rules
    EOFError,  # a header without the frame that it announces
    LookupError,  # tables that are shorter than others say, tags that are not there
    TypeError,  # tags of another type than theirs, None for what is missing
    AttributeError,  # the same, where the missing is asked for more
    ValueError,  # numbers out of range; text that is no text (UnicodeDecodeError)
    ArithmeticError,  # numbers too large for C; rationals over 0; images 0 bytes wide
    AssertionError,  # what Pillow takes for granted of files
    RuntimeError,  # decoders that cannot be set up; directories nested without end
    MemoryError,  # lengths that a file claims and nobody has
    struct.error,  # records that end early
    zlib.error,  # compressed text and profiles
)
"""All that Pillow's readers raise on bytes that are no image."""


def _read(name: str, file: OpenFile, max_cells: int) -> Strips:
    """Return the strips of the picture in a file, see `ImageFormat.read`."""
    path = file.path
    with _opened(name, file, max_cells) as image:
        _check_room(name, image, file)
        if name == "TIFF":
            _check_parts(image, file)
        with damage_refused(path):
            image.verify()  # checksums and the end of a PNG, at which `load` does not look
    # libtiff wants all bytes, and where there is no standard error the file may be in its place
    data = io.BytesIO(file.read_whole()) if name == "TIFF" else file.stream()
    image = _opened(name, file, max_cells, data)
    (codec, _, offset, args), info = image.tile[0], dict(image.info)
    raw_mode = args if isinstance(args, str) else args[0]
    if name == "PNG" and image.mode == "P" and image.palette is None:
        raise MalformedInputError("has no palette", source=path, place="chunk PLTE")
    with damage_refused(path), _silent_stderr() if name == "TIFF" else nullcontext():
        if _has_opacity(name, image):
            from PIL import Image

            pixels = file.read(offset, 4 * image.width * image.height)
            image = Image.frombytes("RGBA", image.size, pixels, codec, "BGRA", *args[1:])
        image.load()
        orientation = image.getexif().get(_EXIF_ORIENTATION, 1)
    if orientation != 1:
        _warn(path, "the EXIF orientation was not applied, as in ROS", "image.orientation")
    _warn_of_loss(name, image, raw_mode, info, path)
    return _strips_of(image, partial(_picture_of, name=name, raw_mode=raw_mode, info=info,
                                     path=path))  # fmt: skip


def _size(name: str, _head: bytes, path: Path, max_cells: int) -> tuple[int, int]:
    with opened(path) as file, _opened(name, file, max_cells) as image:
        return image.height, image.width


def _memory(name: str, file: OpenFile, _head: bytes) -> int:
    with _opened(name, file, sys.maxsize) as image, damage_refused(file.path):
        return _memory_of(name, image, file)


def _opened(name: str, file: OpenFile, max_cells: int, data: BinaryIO | None = None) -> Any:
    """Return Pillow's image of a file, its header read and checked, its pixels not yet decoded."""
    from PIL import Image, UnidentifiedImageError

    path = file.path
    if name == "PNG":
        claim(path, file.size)  # a chunk before the pixels, which is read at once, may be as long
    with damage_refused(path):
        try:
            image = Image.open(data or file.stream(), formats=(name,))
        except UnidentifiedImageError:
            raise MalformedInputError(NOT_AN_IMAGE, source=path) from None
        frames = getattr(image, "n_frames", 1)
    check_size(path, image.width, image.height, max_cells)
    if frames > 1:
        raise MalformedInputError("holds more than one picture", source=path)
    if not image.tile:
        raise MalformedInputError("holds no pixels", source=path)
    return image


def _check_parts(image: Any, file: OpenFile) -> None:
    """Refuse a TIFF that lacks strips or tiles, whose cells decoders leave black."""
    tags, path = image.tag_v2, file.path
    with damage_refused(path):  # tags may be of any type
        is_tiled = _TILES[0] in tags
        offsets, sizes = (tags.get(tag, ()) for tag in (_TILES if is_tiled else _STRIPS))
        across, down = _part_of(image)
        planes = tags.get(_SAMPLES, 1) if tags.get(_PLANAR) == 2 else 1
        expected = -(-image.width // across) * -(-image.height // down) * planes
        rows = expected * down if is_tiled else image.height * planes
        is_raw = image.info.get("compression") == _RAW_TIFF
        least = -(-across * (_bits_of("TIFF", image) // planes) // 8) * rows if is_raw else 1
        end = max(map(sum, zip(offsets, sizes, strict=False)), default=0)
    if {len(offsets), len(sizes)} != {expected}:
        rule = f"must list {expected} strips or tiles, as many as cover the picture"
        got = min(len(offsets), len(sizes))
        raise MalformedInputError(rule, source=path, place="strips", got=got)
    if sum(sizes) < least:
        rule = f"the pixels end early: expected {least} bytes"
        raise MalformedInputError(rule, source=path, got=sum(sizes))
    if end > file.size:
        rule = f"the pixels end early: expected a file of {end} bytes"
        raise MalformedInputError(rule, source=path, got=file.size)


def _part_of(image: Any) -> tuple[int, int]:
    """Return width and height of the strips or tiles of a TIFF."""
    tags = image.tag_v2
    if _TILES[0] in tags:
        return int(tags[_TILE[0]]), int(tags[_TILE[1]])
    rows = tags.get(_ROWS_PER_STRIP, image.height)
    return image.width, min(int(rows), image.height)


def _check_room(name: str, image: Any, file: OpenFile) -> None:
    """Refuse more pixels than so few bytes can hold, or than fit the memory, before decoding."""
    width, height = image.size
    with damage_refused(file.path):
        across, down = _part_of(image) if name == "TIFF" else (0, 0)
        tile = across * down
        expanded = -(-max(tile, width * height) * _bits_of(name, image) // 8)
        needed = _memory_of(name, image, file)
    check_expansion(file.path, file.size, expanded, most=BLANK_EXPANSION, place="image size")
    what = f"{width} x {height} cells"
    claim(file.path, needed, what=f"{what}, in tiles of {tile}," if tile > width * height else what)


def _memory_of(name: str, image: Any, file: OpenFile) -> int:
    """Return the bytes that decoding an image and making cells of it takes at its peak."""
    cells, bits = int(image.width) * int(image.height), _bits_of(name, image)
    held = file.size if name == "TIFF" else 0
    work = 0
    if name == "JPEG" and "progressive" in image.info:
        work = cells * bits // 4  # the scans, which are collected before there are pixels
    elif name == "TIFF" and image.info.get("compression") != _RAW_TIFF:
        across, down = _part_of(image)
        work = max(4, bits // 8) * across * down
    elif name == "BMP" and (image.info["compression"] != _RAW_BMP or _has_opacity(name, image)):
        work = 4 * cells
    taken = held + _KEPT.get(image.mode, _KEPT_OF_OTHERS) * cells + max(work, cells)
    return max(taken + min(PIECES, 16 * cells), 2 * file.size if name == "PNG" else 0)


def _bits_of(name: str, image: Any) -> int:
    if name == "TIFF":
        return max(1, int(sum(image.tag_v2.get(_BITS_PER_SAMPLE, (1,)))))
    raw_mode = image.tile[0][3] if name == "PNG" else ""
    return int(_DEPTHS.get(raw_mode, _BITS.get(image.mode, _WIDE)))


def _has_opacity(name: str, image: Any) -> bool:
    """Return whether a BMP has a fourth byte that Pillow drops and ROS reads as opacity."""
    raw_mode = image.tile[0][3][0] if name == "BMP" and image.tile else ""
    return raw_mode == "BGRX" and image.info["compression"] == _RAW_BMP


def _warn_of_loss(
    name: str, image: Any, raw_mode: str, info: Mapping[str, Any], path: Path
) -> None:
    if name == "JPEG":
        text = "JPEG is lossy: greys may have moved across the thresholds"
        _warn(path, text, "image.lossy")
    if name == "PNG" and raw_mode.endswith(";16B") and not raw_mode.startswith("I"):
        text = "16-bit colour was reduced to 8 bits; ROS 2 reads all 16"
        _warn(path, text, "image.depth")
    if name == "PNG" and image.mode == "RGB" and isinstance(info.get("transparency"), tuple):
        text = "one colour is transparent; read as ROS 2 does, where only black matches"
        _warn(path, text, "image.transparent-colour")


def _warn(path: Path, text: str, check: str) -> None:
    emit_warning(MapdealWarning(f"{path}: {text}", check), stacklevel=4)


def _strips_of(image: Any, to_picture: Callable[[Any], Picture]) -> Strips:
    """Return the strips of a decoded image, which are copied out of Pillow's memory one by one."""
    width, height = image.size
    step = rows_of_strip(width, 4 * width)

    def parts() -> Iterator[Picture]:
        for top in range(0, height, step):
            yield to_picture(image.crop((0, top, width, min(top + step, height))))

    return Strips((height, width), parts)


def _picture_of(
    image: Any, *, name: str, raw_mode: str, info: Mapping[str, Any], path: Path
) -> Picture:
    """Return the samples of a decoded image, with what a PNG says of them besides."""
    mode, pixels = image.mode, np.asarray(image)
    if mode == "1" and name == "BMP":  # Pillow's name for a palette of black and white
        palette = np.array([[0, 0, 0, 255], [255, 255, 255, 255]], dtype=np.uint8)
        picture = Picture(name, "palette", pixels.astype(np.uint8), palette=palette)
    elif mode == "1":
        picture = Picture(name, "grey", pixels.astype(np.uint8) * np.uint8(255))
    elif mode == "L":
        picture = Picture(name, "grey", pixels)
    elif mode.startswith("I;16") or raw_mode == "I;16B":  # of older Pillow "I"
        picture = Picture(name, "grey", pixels.astype(np.uint16), maxval=65535)
    elif mode == "P":
        picture = Picture(name, "palette", pixels, palette=_palette(image, info))
    elif mode == "RGB":
        picture = Picture(name, "rgb", pixels)
    elif mode == "LA" or raw_mode.startswith("LA"):  # of 16 bits in older Pillow "RGBA"
        picture = Picture(name, "grey", pixels[..., 0], alpha=pixels[..., -1])
    elif mode == "RGBA":
        picture = Picture(name, "rgb", pixels[..., :3], alpha=pixels[..., 3])
    else:
        raise MalformedInputError("pixels of this kind make no map", source=path, got=mode)
    return _with_facts_of_png(picture, raw_mode, info) if name == "PNG" else picture


def _palette(image: Any, info: Mapping[str, Any]) -> NDArray[np.uint8]:
    """Return red, green, blue, opacity of all 256 indices; those not defined are black."""
    colours = np.array(image.getpalette("RGB"), dtype=np.uint8).reshape(-1, 3)
    table = np.zeros((256, 4), dtype=np.uint8)
    table[:, 3] = 255
    table[: len(colours), :3] = colours
    clear = info.get("transparency")
    if isinstance(clear, int):  # the one index that is not opaque
        table[clear, 3] = 0
    elif isinstance(clear, bytes):
        opacities = np.frombuffer(clear, dtype=np.uint8)[:256]
        table[: len(opacities), 3] = opacities
    return table


def _with_facts_of_png(picture: Picture, raw_mode: str, info: Mapping[str, Any]) -> Picture:
    """Return a picture with its gamma and profile, and the opacity of a transparent colour."""
    # texts are there by names that the file chooses
    said = [(key, value) for key, value in info.items() if not isinstance(value, str)]
    display = [f"a gamma of {value:g}" if key == "gamma" else "a colour profile"
               for key, value in said if key in ("gamma", "icc_profile")]  # fmt: skip
    picture = replace(picture, display=tuple(display))
    key = info.get("transparency")
    if picture.palette is not None or picture.alpha is not None or not isinstance(key, int | tuple):
        return picture
    if picture.colour == "rgb":
        # The ROS 2 readers compare an 8-bit key with 16-bit samples: only black ever matches.
        transparent = np.all(picture.samples == 0, axis=2) & (key == (0, 0, 0))
    elif raw_mode == "1":  # of which newer Pillow makes 0 or 255
        transparent = picture.samples == (255 if key else 0)
    else:
        transparent = picture.samples == key * (255 // ((1 << _DEPTHS.get(raw_mode, 8)) - 1))
    full = np.array(picture.maxval, dtype=picture.samples.dtype)
    alpha = np.where(transparent, np.zeros_like(full), full)
    return replace(picture, alpha=alpha, alpha_from="key")


def one_at_a_time() -> AbstractContextManager[Any]:
    return _LOCK


@contextmanager
def damage_refused(path: Path) -> Iterator[None]:
    """Turn whatever damage leads Pillow's readers to into one clear error."""
    # Around calls of Pillow, and what it says of a file: in other code the same exceptions are
    # bugs.
    import logging

    from PIL import Image, UnidentifiedImageError

    # Pillow warns of odd tags and logs what it cannot decode; neither decides anything here.
    log = logging.getLogger("PIL")
    if not log.handlers:
        log.addHandler(logging.NullHandler())
    try:
        with one_at_a_time(), warnings.catch_warnings():
            # by module: warnings of other threads must pass
            warnings.filterwarnings("ignore", module=_OF_PILLOW)
            limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None  # ours is checked before
            try:
                yield
            finally:
                Image.MAX_IMAGE_PIXELS = limit
    except (*_DAMAGE, Image.DecompressionBombError) as error:  # if others set the limit meanwhile
        if isinstance(error, OSError) and error.errno is not None:
            rule = f"cannot be read: {error.strerror}"
            raise FileAccessError(rule, source=path) from None
        told = str(error) or type(error).__name__
        if isinstance(error, UnidentifiedImageError):  # it names an address in memory
            told = "a part of it is not an image"
        raise MalformedInputError(f"the image is damaged: {told}", source=path) from None


@contextmanager
def _silent_stderr() -> Iterator[None]:
    """Keep libtiff from writing to the terminal by itself."""
    with one_at_a_time():
        try:
            saved = os.dup(2)
        except OSError:  # there is none: whoever called has closed it
            saved = None
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            if saved is not None:
                os.dup2(saved, 2)
                os.close(saved)
            else:
                os.close(2)
            if nowhere != 2:
                os.close(nowhere)


def _format(name: str, suffixes: tuple[str, ...], *signatures: bytes) -> ImageFormat:
    return ImageFormat(
        name=name, suffixes=suffixes, recognises=lambda head: head.startswith(signatures),
        read=partial(_read, name), memory=partial(_memory, name), size=partial(_size, name),
    )  # fmt: skip


PILLOW_FORMATS = (
    _format("PNG", (".png",), b"\x89PNG\r\n\x1a\n"),
    _format("BMP", (".bmp",), b"BM"),
    # Either byte order, the mark of either in the wrong one, and BigTIFF: what Pillow opens.
    _format("TIFF", (".tif", ".tiff"), b"MM\0*", b"II*\0", b"MM*\0", b"II\0*", b"MM\0+", b"II+\0"),
    _format("JPEG", (".jpg", ".jpeg"), b"\xff\xd8\xff"),
)  # fmt: skip
