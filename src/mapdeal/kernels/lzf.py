"""LZF decompression, as PCD files need it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name

MOST_EXPANSION = 132
"""No LZF data expand to more than so many times their length: 264 bytes are a copy of 2."""


def lzf_expanded(data: bytes, size: int) -> NDArray[np.uint8] | None:
    if size > MOST_EXPANSION * len(data):
        return None
    expanded = np.empty(size, dtype=np.uint8)
    if engine_name() == "compiled":
        from mapdeal.kernels import _compiled

        return expanded if _compiled.lzf_expand(data, expanded) else None
    return expanded if _expand(data, memoryview(expanded.data)) else None


def _expand(data: bytes, to: memoryview) -> bool:
    place = filled = 0
    while place < len(data):
        control = data[place]
        place += 1
        if control < 32:
            run = control + 1
            if run > len(data) - place or run > len(to) - filled:
                return False
            to[filled : filled + run] = data[place : place + run]
            place += run
            filled += run
            continue
        run = control >> 5
        if run == 7:
            if place >= len(data):
                return False
            run += data[place]
            place += 1
        if place >= len(data):
            return False
        back = filled - ((control & 31) << 8) - data[place] - 1
        place += 1
        run += 2
        if back < 0 or run > len(to) - filled:
            return False
        while run > 0:  # what is copied may be what was copied just now
            part = min(run, filled - back)
            to[filled : filled + part] = to[back : back + part]
            filled, run = filled + part, run - part
    return filled == len(to)
