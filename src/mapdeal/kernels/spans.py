"""Runs of cells along rows: what shapes become before they are painted."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.int64]


class Spans(NamedTuple):
    """Cells as runs along rows; runs may overlap.

    Parameters
    ----------
    rows : numpy.ndarray of int64, shape (N,)
        The row of each run.
    starts, stops : numpy.ndarray of int64, shape (N,)
        Its first column, and the one behind its last.
    """

    rows: Indices
    starts: Indices
    stops: Indices

    def clipped(self, width: int) -> Spans:
        """Return what lies in columns 0 .. `width` - 1, without empty runs."""
        starts, stops = np.clip(self.starts, 0, width), np.clip(self.stops, 0, width)
        kept = starts < stops
        return Spans(self.rows[kept], starts[kept], stops[kept])


def joined(parts: list[Spans]) -> Spans:
    """Return the runs of all parts together."""
    empty = np.empty(0, dtype=np.int64)
    columns = zip(*[(empty, empty, empty), *parts], strict=True)
    return Spans(*(np.concatenate(column) for column in columns))


def paint(
    values: NDArray[Any], spans: Spans, value: int, *, over: NDArray[np.bool_] | None = None
) -> None:
    """Give the cells of `spans` a value, in place.

    Parameters
    ----------
    values : numpy.ndarray of uint8 or int8, shape (H, W)
        The cells.
    spans : Spans
        Which of them.
    value : int
        What they become.
    over : numpy.ndarray of bool, shape (256,), optional
        For the byte of each value whether it is painted over; all are by default.

    Examples
    --------
    >>> values = np.zeros((2, 5), dtype=np.int8)
    >>> paint(values, Spans(np.array([1]), np.array([1]), np.array([4])), 7)
    >>> values
    array([[0, 0, 0, 0, 0],
           [0, 7, 7, 7, 0]], dtype=int8)
    """
    for row, start, stop in _runs(spans):
        cells = values[row, start:stop]
        if over is None:
            cells[:] = value
        else:
            cells[over[cells.view(np.uint8)]] = value


def paint_bits(packed: NDArray[np.uint8], spans: Spans, value: bool) -> None:
    """Set or clear the bits of `spans`, in place.

    Parameters
    ----------
    packed : numpy.ndarray of uint8, shape (H, ceil(W / 8))
        Eight cells a byte, the first in the highest bit.
    spans : Spans
        Within the W columns.
    value : bool
        Whether bits become 1.

    Examples
    --------
    >>> packed = np.zeros((1, 3), dtype=np.uint8)
    >>> paint_bits(packed, Spans(np.array([0]), np.array([6]), np.array([18])), True)
    >>> [f"{byte:08b}" for byte in packed[0].tolist()]
    ['00000011', '11111111', '11000000']
    """
    whole = 0xFF if value else 0
    for row, start, stop in _runs(spans):
        first, last = start >> 3, (stop - 1) >> 3
        head, tail = 0xFF >> (start & 7), 0xFF & (0xFF << (7 - ((stop - 1) & 7)))
        if first == last:
            head = tail = head & tail
        packed[row, first + 1 : last] = whole
        for byte, mask in ((first, head), (last, tail)):
            old = int(packed[row, byte])
            packed[row, byte] = old | mask if value else old & ~mask


def _runs(spans: Spans) -> Any:
    return zip(*(column.tolist() for column in spans), strict=True)
