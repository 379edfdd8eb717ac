"""PNG images, read by Pillow, with the facts that it smooths over from the file's chunks."""

from __future__ import annotations

import io
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.images.image_format import ImageFormat
from mapdeal.formats.images.memory import claim_pixels
from mapdeal.formats.images.pillow import (
    grey_and_alpha,
    load,
    open_image,
    picture_of,
    size_by_pillow,
    warn,
    wide_grey,
)
from mapdeal.formats.images.png_chunks import (
    SIGNATURE,
    PngFacts,
    read_png_facts,
    read_png_header,
)
from mapdeal.formats.picture import Picture, check_size


def read_png(data: bytes, path: Path, max_cells: int) -> Picture:
    """Return the picture in a PNG file, see `ImageFormat.read`."""
    _check_header(data, path)
    with open_image(io.BytesIO(data), "PNG", path, max_cells) as image:
        facts = read_png_facts(data, path)
        claim_pixels(image, data, path, bits=facts.bits)
        load(image, path)
        if facts.bit_depth == 16 and (facts.has_colour or facts.has_alpha):
            text = "16-bit colour was reduced to 8 bits; ROS 2 reads all 16"
            warn(path, text, "image.depth")
        picture = _picture_of(image, facts, path)
        return replace(picture, display=facts.display)


def _size(head: bytes, path: Path, max_cells: int) -> tuple[int, int]:
    _check_header(head, path)
    return _size_by_pillow(head, path, max_cells)


def _check_header(head: bytes, path: Path) -> None:
    """Refuse a header with numbers that Pillow does not take for a PNG file's.

    A file in which none comes first is left to Pillow.
    """
    if head[len(SIGNATURE) + 4 :].startswith(b"IHDR"):
        header = read_png_header(head, path)
        check_size(path, header.width, header.height, sys.maxsize)


_size_by_pillow = size_by_pillow("PNG")


def _picture_of(image: Any, facts: PngFacts, path: Path) -> Picture:
    if image.mode == "I":  # older Pillow's mode for 16-bit grey
        picture = wide_grey(image, "PNG")
    elif image.mode == "RGBA" and not facts.has_colour:
        picture = grey_and_alpha(image, "PNG")
    else:
        picture = picture_of(image, "PNG", path)
    if picture.palette is not None:
        return replace(picture, palette=_with_opacities(picture.palette, facts))
    return _with_key(picture, facts, path) if picture.alpha is None else picture


def _with_opacities(palette: NDArray[np.uint8], facts: PngFacts) -> NDArray[np.uint8]:
    """Return a palette with the opacities of chunk tRNS."""
    opacities = np.frombuffer(facts.transparency or b"", dtype=np.uint8)[:256]
    table = palette.copy()
    table[: len(opacities), 3] = opacities
    return table


def _with_key(picture: Picture, facts: PngFacts, path: Path) -> Picture:
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
        text = "one colour is transparent; read as ROS 2 does, where only black matches"
        warn(path, text, "image.transparent-colour")
    else:
        scale = 1 if facts.bit_depth == 16 else 255 // ((1 << facts.bit_depth) - 1)
        transparent = picture.samples == key[0] * scale
    full = np.array(picture.maxval, dtype=picture.samples.dtype)
    alpha = np.where(transparent, np.zeros_like(full), full)
    return replace(picture, alpha=alpha, alpha_from="key")


PNG = ImageFormat(
    name="PNG",
    suffixes=(".png",),
    recognises=lambda head: head.startswith(SIGNATURE),
    read=read_png,
    size=_size,
    size_is_in_head=False,
    suggested=("png",),
)
