"""What decoding by Pillow takes of memory, asked for before it is taken."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mapdeal.formats.budget import BLANK_EXPANSION, check_expansion, claim

_BITS = {"1": 1, "L": 8, "P": 8, "I;16": 16, "I;16B": 16, "LA": 16, "RGB": 24}
_WIDE = 32
"""Bits of a pixel in files, by Pillow's modes, and those of all others at most."""

_KEPT = {"1": 1, "L": 1, "P": 1, "I;16": 2, "I;16B": 2}
_KEPT_OF_OTHERS = 4
"""Bytes of a pixel in Pillow's memory, by its modes."""

_COPIES = 2
"""Of a file that is decoded once more, with other bytes behind its data."""

_CONVERTED = 1
"""Bytes of a cell that is made of its pixel."""


def claim_pixels(
    image: Any,
    data: bytes,
    path: Path,
    *,
    bits: int | None = None,
    tile: int = 0,
    is_decoded_twice: bool = False,
) -> None:
    """Refuse an image whose pixels would take more memory than may be taken.

    Parameters
    ----------
    image : PIL.Image.Image
        The image, its pixels not yet decoded.
    data : bytes
        The file.
    path : Path
        Its name, for messages.
    bits : int, optional
        Bits of a pixel in the file, where Pillow's mode does not tell.
    tile : int
        Pixels of a tile, which may be larger than the picture.
    is_decoded_twice : bool
        Whether a check decodes the picture once more, and compares the two.

    Raises
    ------
    MalformedInputError
        If there is too little memory, or so few bytes cannot be such a large picture.
    """
    width, height, mode = image.width, image.height, image.mode
    in_file = bits or _BITS.get(mode, _WIDE)
    expanded = max(-(-width * in_file // 8) * height, -(-tile * in_file // 8))
    check_expansion(path, len(data), expanded, most=BLANK_EXPANSION, place="image size")
    samples = -(-_BITS.get(mode, _WIDE) // 8)
    # the samples leave Pillow in pieces that are joined: both are there for a moment
    decoding = _KEPT.get(mode, _KEPT_OF_OTHERS) + 2 * samples
    per_cell = decoding + _CONVERTED
    length = len(data)
    if is_decoded_twice:
        per_cell += decoding + samples
        length += _COPIES * len(data)
    count = length + per_cell * width * height + -(-tile * in_file // 8)
    what = f"{width} x {height} cells"
    claim(path, count, what=f"{what}, in tiles of {tile}," if tile > width * height else what)
