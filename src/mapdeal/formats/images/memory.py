"""Memory that decoding by Pillow takes, claimed before it is used."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mapdeal.formats.budget import BLANK_EXPANSION, PIECES, check_expansion, claim

_BITS = {"1": 1, "L": 8, "P": 8, "I;16": 16, "I;16B": 16, "LA": 16, "RGB": 24}
_WIDE = 32
"""Bits of a pixel in files, by Pillow's modes, and those of all others at most."""

_KEPT = {"1": 1, "L": 1, "P": 1, "I;16": 2, "I;16B": 2}
_KEPT_OF_OTHERS = 4
"""Bytes of a pixel in Pillow's memory, by its modes."""

_COPIES = 2
"""Of a file that is decoded once more, with other bytes behind its data."""

_CELL = 1
"""Bytes of a cell that is made of a pixel."""


def decoding_memory(
    mode: str,
    size: tuple[int, int],
    length: int,
    *,
    work: int = 0,
    is_decoded_twice: bool = False,
) -> int:
    """Return the bytes that decoding an image and making cells of it takes at its peak."""
    cells = size[0] * size[1]
    kept = _KEPT.get(mode, _KEPT_OF_OTHERS) * cells
    first = length + kept
    second = kept + work + _COPIES * length if is_decoded_twice else work
    return first + max(second, _CELL * cells) + min(PIECES, 16 * cells)


def check_pixels(image: Any, length: int, path: Path, *, bits: int = 0, tile: int = 0) -> None:
    """Refuse so many pixels that so few bytes cannot hold them."""
    expanded = max(bytes_in_file(image, bits=bits), tile_bytes(image, tile, bits=bits))
    check_expansion(path, length, expanded, most=BLANK_EXPANSION, place="image size")


def bytes_in_file(image: Any, *, bits: int = 0) -> int:
    """Return the bytes of the pixels of an image before they are compressed."""
    return int(-(-image.width * _bits_of(image, bits) // 8) * image.height)


def tile_bytes(image: Any, pixels: int, *, bits: int = 0) -> int:
    """Return the bytes of so many pixels of an image before they are compressed."""
    return -(-pixels * _bits_of(image, bits) // 8)


def claim_picture(image: Any, count: int, path: Path, *, tile: int = 0) -> None:
    """Refuse an image that would take more memory than may be used."""
    width, height = image.width, image.height
    what = f"{width} x {height} cells"
    claim(path, count, what=f"{what}, in tiles of {tile}," if tile > width * height else what)


def _bits_of(image: Any, bits: int) -> int:
    return bits or _BITS.get(image.mode, _WIDE)
