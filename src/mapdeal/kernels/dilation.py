"""Cells near marked ones: squares, discs, and rings.

Shapes of up to 62 cells are drawn around all marked cells at once by the compiled engine, at a few
bytes' work for each cell and row of the shape; larger discs are a matter of distances
(`mapdeal.kernels.distance`), larger squares of moved copies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.distance import bytes_by_distance, squared_distance, unreachable
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.lookup import set_where
from mapdeal.kernels.threads import CELLS_WORTH_A_THREAD, in_parallel

Mask = NDArray[np.bool_]
Bytes = NDArray[np.uint8]

_LARGEST_TABLE = 1 << 20
_BAND_ROWS = 64
_HALOS_OF_A_BAND = 2
"""Rows of a band, in reaches: those around it are looked at again for the next."""


def dilate_square(marked: Mask, reach: int) -> Mask:
    """Return the cells within `reach` cells of a marked one along both axes."""
    _check_mask(marked)
    if _is_drawn(marked, reach):
        return _covered(marked, np.full(reach + 1, reach, np.uint8), is_square=True)
    by_columns = _widened(marked, reach)
    return _widened(by_columns.T, reach).T


def within_distance(marked: NDArray[np.bool_], square: int) -> NDArray[np.bool_]:
    _check_mask(marked)
    if _is_drawn(marked, math.isqrt(square)):
        return _covered(marked, _half_widths(square), is_square=False)
    if square > _LARGEST_TABLE:
        squared = squared_distance(marked, limit=square)
        return squared != unreachable(squared)  # type: ignore[no-any-return]
    table = np.ones(square + 2, dtype=np.uint8)
    table[-1] = 0
    return bytes_by_distance(marked, table).view(np.bool_)


def inflated(
    values: NDArray[np.int8],
    threshold: int,
    *,
    reach: int = 0,
    square: int | None = None,
    value: int,
    kept: int | None = None,
) -> NDArray[np.int8]:
    kept = value if kept is None else kept  # which then makes no difference
    reach = math.isqrt(square) if square is not None else reach
    if _is_drawn(values, reach):
        from mapdeal.kernels import _dilation

        given, found = np.ascontiguousarray(values), np.empty(values.shape, np.int8)
        is_square = square is None
        halves = np.full(reach + 1, reach, np.uint8) if square is None else _half_widths(square)

        def fill(bottom: int, top: int) -> None:
            _dilation.put(given, threshold, halves, is_square, value, kept, found, bottom, top)

        _by_bands(fill, values.shape, reach)
        return found
    occupied = values >= threshold
    covered = (
        dilate_square(occupied, reach) if square is None else within_distance(occupied, square)
    )
    covered &= (values != kept) | occupied
    found = values.copy()
    set_where(found, covered, value)
    return found


def ringed(values: NDArray[np.int8], marked: Mask, costs: Sequence[int]) -> NDArray[np.int8]:
    """Return values with those of cells near marked ones replaced by the cost of their ring."""
    reach = len(costs) - 1
    found = np.empty(values.shape, np.int8)
    if _is_drawn(marked, reach):
        from mapdeal.kernels import _dilation

        bytes_, given = _bytes_of(marked), np.ascontiguousarray(values)
        halves, table = np.full(reach + 1, reach, np.uint8), np.array(costs, np.int8)

        def fill(bottom: int, top: int) -> None:
            _dilation.ring(bytes_, halves, table, given, found, bottom, top)

        _by_bands(fill, marked.shape, reach)
        return found
    found[...] = values
    inner = marked
    found[inner] = costs[0]
    for cost in costs[1:]:
        outer = dilate_square(inner, 1)
        found[outer & ~inner] = cost
        inner = outer
    return found


def _check_mask(marked: Mask) -> None:
    if marked.dtype != np.bool_ or marked.ndim != 2:
        rule = f"a mask must be a bool array with two axes, not {marked.ndim} of {marked.dtype}"
        raise ValueError(rule)


def _is_drawn(cells: NDArray[np.generic], reach: int) -> bool:
    """Return whether the compiled engine draws shapes of a reach around cells."""
    if engine_name() != "compiled" or cells.size == 0 or reach < 0:
        return False
    from mapdeal.kernels import _dilation

    return reach <= _dilation.most_reach


def _half_widths(square: int) -> Bytes:
    """Return the half widths of a disc's rows, by their distance from the middle."""
    reach = math.isqrt(square)
    return np.array([math.isqrt(square - row * row) for row in range(reach + 1)], np.uint8)


def _covered(marked: Mask, half_widths: Bytes, *, is_square: bool) -> Mask:
    from mapdeal.kernels import _dilation

    bytes_, covered = _bytes_of(marked), np.empty(marked.shape, np.uint8)

    def fill(bottom: int, top: int) -> None:
        _dilation.cover(bytes_, half_widths, is_square, covered, bottom, top)

    _by_bands(fill, marked.shape, len(half_widths) - 1)
    return covered.view(np.bool_)


def _bytes_of(marked: Mask) -> Bytes:
    return np.ascontiguousarray(marked).view(np.uint8)


def _by_bands(fill: Callable[[int, int], object], shape: tuple[int, ...], reach: int) -> None:
    """Call a function for all rows, some at a time, in threads if they are worth it."""
    height, width = shape
    step = max(_BAND_ROWS, _HALOS_OF_A_BAND * reach)
    bands = -(-height // step)

    def some(first: int, end: int) -> None:
        for k in range(first, end):
            fill(k * step, min((k + 1) * step, height))

    if height * width < CELLS_WORTH_A_THREAD:
        some(0, bands)
    else:
        in_parallel(some, bands)


def _widened(marked: Mask, reach: int) -> Mask:
    """Return `marked` grown along its first axis."""
    reach = min(reach, len(marked))
    grown, covered = marked.copy(), 0
    while covered < reach:
        # at a border, where one side is cut off, c cells leave no gap when moved by c + 1
        step = min(covered + 1, reach - covered)
        before = grown.copy()
        grown[step:] |= before[:-step]
        grown[:-step] |= before[step:]
        covered += step
    return grown
