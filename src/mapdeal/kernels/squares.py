"""Arrays of squared distances: their type, and the value for "there is no such cell"."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

SquaredDistances = NDArray[np.signedinteger[Any]]

_LONGEST_SIDE_IN_32_BITS = 32767
"""Twice its square stays below the largest int32, which is taken."""


def unreachable(squared: SquaredDistances) -> int:
    """Return the value that stands for "no such cell" in an array of squared distances."""
    return int(np.iinfo(squared.dtype).max)


def dtype_of_squares(shape: tuple[int, ...]) -> type[np.int32] | type[np.int64]:
    """Return int32 for sides of up to 32,767 cells, else int64."""
    return np.int32 if max(shape) <= _LONGEST_SIDE_IN_32_BITS else np.int64


def squares_between_cells(reach: int) -> NDArray[np.int64]:
    """Return the squared distances that occur between cell centres, up to `reach` cells.

    Examples
    --------
    >>> squares_between_cells(3).tolist()
    [0, 1, 2, 4, 5, 8, 9]
    """
    occurs = np.zeros(reach * reach + 1, dtype=np.bool_)
    squares = np.arange(reach + 1, dtype=np.int64) ** 2
    for row, square in enumerate(squares):
        sums = square + squares[: row + 1]
        occurs[sums[sums < len(occurs)]] = True
    return np.flatnonzero(occurs)
