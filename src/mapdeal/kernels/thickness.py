"""How thick marked structures are, cell by cell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Lengths = NDArray[np.int64]


def thickness_of(marked: NDArray[np.bool_]) -> Lengths:
    """Return how thick a structure is at each of its cells.

    Notes
    -----
    A straight wall has its thickness along its shorter axis, a slanted one of one cell is one
    cell thick. Where two walls cross, both runs may be long: the cells there count as thick.
    """
    height, width = marked.shape
    _, along = _runs(marked)
    cols, across = _runs(marked.T)
    # the second list goes through the cells column by column
    order = np.argsort(cols % height * width + cols // height, kind="stable")
    return np.minimum(along, across[order])


def _runs(marked: NDArray[np.bool_]) -> tuple[Lengths, Lengths]:
    """Return the marked cells as indices, row by row, and the length of each one's run."""
    width = marked.shape[1]
    at = np.flatnonzero(marked)
    if not len(at):
        return at, at
    begins = (np.diff(at, prepend=-2) > 1) | (at % width == 0)
    first = np.flatnonzero(begins)
    lengths = np.diff(first, append=len(at))
    return at, np.repeat(lengths, lengths)
