"""Exact squared Euclidean distances between cell centres, as integers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

SquaredDistances = NDArray[np.signedinteger[Any]]


def unreachable(squared: SquaredDistances) -> int:
    """Return the value that stands for "no such cell" in an array of squared distances."""
    return int(np.iinfo(squared.dtype).max)


def squared_distance(marked: NDArray[np.bool_]) -> SquaredDistances:
    """Return each cell's squared distance to the nearest marked cell.

    Parameters
    ----------
    marked : numpy.ndarray of bool, shape (H, W)
        The cells to measure to.

    Returns
    -------
    numpy.ndarray of int32 or int64, shape (H, W)
        Squares of cells; 0 on marked cells; `unreachable` everywhere if none is marked.
        int64 where the diagonal's square does not fit into int32.

    Examples
    --------
    >>> squared_distance(np.array([[True, False, False], [False, False, False]]))
    array([[0, 1, 4],
           [1, 2, 5]], dtype=int32)
    """
    from scipy import ndimage

    height, width = marked.shape
    dtype = _dtype_of_squares(height, width)
    if not marked.any():  # scipy would measure to a cell that is not there
        return np.full(marked.shape, np.iinfo(dtype).max, dtype=dtype)
    # scipy's distances are float64 square roots: the nearest cell's index is exact.
    nearest = ndimage.distance_transform_edt(~marked, return_distances=False, return_indices=True)
    rows, cols = nearest.astype(dtype, copy=False)
    rows -= np.arange(height, dtype=dtype)[:, np.newaxis]
    cols -= np.arange(width, dtype=dtype)
    rows *= rows
    cols *= cols
    rows += cols
    squared: SquaredDistances = rows
    return squared


def signed_squared_distance(occupied: NDArray[np.bool_]) -> SquaredDistances:
    """Return each cell's squared distance to the nearest cell of the other kind.

    Parameters
    ----------
    occupied : numpy.ndarray of bool, shape (H, W)
        The obstacle cells.

    Returns
    -------
    numpy.ndarray of int32 or int64, shape (H, W)
        Squares of cells: positive on free cells, negative on occupied ones, never 0; plus or
        minus `unreachable` everywhere if there is no cell of the other kind.

    Examples
    --------
    >>> signed_squared_distance(np.array([[True, True, False, False]]))
    array([[-4, -1,  1,  4]], dtype=int32)
    """
    squared = squared_distance(occupied)
    inside = squared_distance(~occupied)
    np.negative(inside, out=squared, where=occupied)
    return squared


def _dtype_of_squares(height: int, width: int) -> type[np.int32] | type[np.int64]:
    # strictly below: the largest int32 is taken as "unreachable"
    fits = height * height + width * width < np.iinfo(np.int32).max
    return np.int32 if fits else np.int64
