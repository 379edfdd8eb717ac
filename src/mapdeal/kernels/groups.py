"""Groups of touching cells, listed: for few cells on a large grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Cells = NDArray[np.int64]


def touching_groups(marked: NDArray[np.bool_]) -> tuple[Cells, Cells]:
    """Return marked cells, and which of the groups each of them is in."""
    width = marked.shape[1]
    at = np.flatnonzero(marked)
    cells = np.stack([at // width, at % width], axis=1)
    pairs = [_beside(at, cells, step, width) for step in ((0, 1), (1, -1), (1, 0), (1, 1))]
    first, second = np.concatenate(pairs, axis=1)
    return cells, np.unique(least_joined(first, second, len(at)), return_inverse=True)[1]


def least_joined(first: Cells, second: Cells, count: int) -> Cells:
    """Return for each of some things the least of all that it is joined to, by whatever way.

    Examples
    --------
    >>> least_joined(np.array([1, 4]), np.array([4, 3]), 5).tolist()
    [0, 1, 2, 1, 1]
    """
    least = np.arange(count)  # of those known to be joined
    while True:
        one, other = least[first], least[second]
        apart = one != other
        if not apart.any():
            return least
        first, second, one, other = first[apart], second[apart], one[apart], other[apart]
        np.minimum.at(least, np.maximum(one, other), np.minimum(one, other))
        while not np.array_equal(nearer := least[least], least):
            least = nearer


def _beside(at: Cells, cells: Cells, step: tuple[int, int], width: int) -> Cells:
    """Return pairs of marked cells a step apart, shape (2, M), as positions in the list."""
    col = cells[:, 1] + step[1]
    inside = np.flatnonzero((col >= 0) & (col < width))
    wanted = at[inside] + step[0] * width + step[1]
    found = np.minimum(np.searchsorted(at, wanted), len(at) - 1)
    is_marked = at[found] == wanted
    return np.stack([inside[is_marked], found[is_marked]])
