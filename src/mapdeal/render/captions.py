"""Short texts on a map, beside the places that they name, none over another."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.render.overlay import Brush
from mapdeal.render.pen import Pen, ascent, capital_height, printable, text_width

_DIRECTIONS = 16
_DISTANCES = (1.0, 1.7, 2.8, 4.5)
_FIRST_WITH_A_LINE = 1
"""From this distance on a line leads from the text to its place."""

Box = tuple[int, int, int, int]
"""First column and row, and those after the last."""


class Captions:
    """Writes texts on the pixels of a map, each in a box of its own."""

    def __init__(self, pixels: NDArray[np.uint8], size: int) -> None:
        self._pixels = pixels
        self._size = size
        self._taken = np.zeros_like(pixels)
        self.kept_free = Brush(self._taken)
        """Draws, with any index but 0, where no text may be."""

    def write(
        self, text: str, place: NDArray[np.float64], index: int, *, away: float,
        towards: Sequence[float] = (1.0, 0.0),
    ) -> bool:  # fmt: skip
        letters = self._letters(text)
        height, width = letters.shape
        found = self._free_box(place, width, height, away, towards)
        if found is None:
            return False
        box, distance = found
        left, bottom, right, top = box
        if distance >= _FIRST_WITH_A_LINE:
            nearest = np.clip(place, (left, bottom), (right, top))
            Brush(self._pixels).polyline(np.array([place, nearest]), index, thickness=2)
        self._pixels[bottom:top, left:right] = index
        self._pixels[bottom + 1 : top - 1, left + 1 : right - 1] = letters[::-1][1:-1, 1:-1]
        self._taken[bottom:top, left:right] = 1
        return True

    def _letters(self, text: str) -> NDArray[np.uint8]:
        """Return a text on white, row 0 at the top."""
        pad = max(2, self._size // 5)
        capitals = capital_height(self._size)
        pen = Pen(self._size)
        line = printable(text)
        below = (
            max(pad, ascent(self._size) // 4) if any(c in "gjpqy,;()[]|/" for c in line) else pad
        )
        pen.open(text_width(line, self._size) + 2 * pad + 1, capitals + pad + below + 2)
        pen.write(pad + 1, capitals + pad + 1, line, self._size)
        return pen.sheet

    def _free_box(
        self, place: NDArray[np.float64], width: int, height: int, away: float,
        towards: Sequence[float],
    ) -> tuple[Box, int] | None:  # fmt: skip
        """Return a box that lies on the map and on no other, and how many steps away it is."""
        first = math.atan2(towards[1], towards[0])
        turns = [(k + 1) // 2 * (-1) ** k for k in range(_DIRECTIONS)]  # to both sides by turns
        angles = [first + 2 * math.pi * turn / _DIRECTIONS for turn in turns]
        for step, factor in enumerate(_DISTANCES):
            for angle in angles:
                x, y = math.cos(angle), math.sin(angle)
                reach = away * factor + abs(x) * width / 2 + abs(y) * height / 2
                left = math.floor(place[0] + x * reach - width / 2 + 0.5)
                bottom = math.floor(place[1] + y * reach - height / 2 + 0.5)
                box = (left, bottom, left + width, bottom + height)
                if self._is_free(box):
                    return box, step
        return None

    def _is_free(self, box: Box) -> bool:
        left, bottom, right, top = box
        height, width = self._pixels.shape
        if left < 0 or bottom < 0 or right > width or top > height:
            return False
        return not self._taken[bottom:top, left:right].any()
