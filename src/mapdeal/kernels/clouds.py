"""The points of a cloud into the cells of a window, in one pass."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name

Floats = NDArray[np.float64]

_TURN = 2 * math.pi


class CloudRule(NamedTuple):
    """How points become cells: numbers in the order in which the compiled code takes them."""

    x: float
    y: float
    cos: float
    sin: float
    offset_x: float
    offset_y: float
    least_height: float
    most_height: float
    least_range: float
    most_range: float
    corner_x: float
    corner_y: float
    frame_cos: float
    frame_sin: float
    resolution: float
    farthest: float
    rounding: float
    tolerance: float


def marks_clouds() -> bool:
    """Return whether `mark_cloud` is there: without a compiler it is not."""
    return engine_name() == "compiled"


def mark_cloud(
    points: Floats, rule: CloudRule, hit: NDArray[np.bool_], *, is_placed: bool
) -> tuple[NDArray[np.int64], Floats]:
    from mapdeal.kernels import _clouds

    counts = np.zeros(6, dtype=np.int64)
    counts[0] = len(points)
    if not len(points):
        return counts, np.empty((0, 2))
    seen = np.empty((len(points), 2))
    bytes_ = hit.view(np.uint8)
    found = _clouds.mark(np.ascontiguousarray(points), rule, is_placed, bytes_, seen, counts)
    return counts, seen[:found]


def cover_angles(angles: Floats, first: Floats, last: Floats) -> None:
    """Put angles into equal bins of a turn, from -pi, and keep the first and last of each."""
    if engine_name() == "compiled":
        from mapdeal.kernels import _clouds

        _clouds.cover(np.ascontiguousarray(angles), _TURN, math.pi, first, last)
        return
    angles = angles - _TURN * np.ceil((angles - math.pi) / _TURN)
    angles = np.minimum(angles, math.pi)  # rounding may have passed it
    bins = ((angles + math.pi) * (len(first) / _TURN)).astype(np.int64)
    np.clip(bins, 0, len(first) - 1, out=bins)
    np.minimum.at(first, bins, angles)
    np.maximum.at(last, bins, angles)


class Precision(NamedTuple):
    """How exactly coordinates are known."""

    rounding: float
    tolerance: float
    farthest: float


def cells_of_points(
    points_xy: NDArray[np.float64],
    origin: tuple[float, float, float],
    resolution: float,
    precision: Precision,
) -> NDArray[np.int64] | None:
    """Return row and column of points, as if the grid went on for ever."""
    if engine_name() != "compiled":
        return None
    from mapdeal.kernels import _rays

    x, y, yaw = origin
    cells = np.empty(points_xy.shape, dtype=np.int64)
    is_near = _rays.cells(
        np.ascontiguousarray(points_xy), cells, x, y, math.cos(-yaw), math.sin(-yaw),
        resolution, *precision,
    )  # fmt: skip
    return cells if is_near else None


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
