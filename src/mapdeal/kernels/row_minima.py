"""Squared distances in a block of rows of a larger grid, on numpy: for scipy_distance.py.

scipy's transform knows nothing of rows beside those that it is given. So heights, the distances
within the columns, are counted here, and each cell's square is the smallest of (x - i)^2 +
height(i)^2 over all columns i. The best i never decreases with x. So the middle cells are solved
first, and those between them among the columns that are left, all rows at the same time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.column_runs import Halo, Mask, Runs

Squares = NDArray[np.int64]

_CELLS_TOGETHER = 1 << 18
_NONE = np.iinfo(np.int64).max


def squares_of_block(marked: Mask, halo: Halo) -> Squares:
    """Return each cell's squared distance to the nearest cell of the other kind in the grid."""
    heights = np.minimum(_counts(marked, halo.before), _counts(marked[::-1], halo.after)[::-1])
    has_none = heights > halo.height
    own = np.where(has_none, 0, heights) ** 2
    squares = np.empty(marked.shape, dtype=np.int64)
    step = max(1, _CELLS_TOGETHER // marked.shape[1])
    for first in range(0, len(marked), step):
        rows = slice(first, first + step)
        for kind in (False, True):
            of_kind = marked[rows] == kind
            minima = row_minima(np.where(of_kind, own[rows], 0), ~(of_kind & has_none[rows]))
            np.copyto(squares[rows], minima, where=of_kind)
    return squares


def _counts(marked: Mask, before: tuple[Mask, Runs] | None) -> Squares:
    """Return how many cells it is, up the columns, to the nearest cell of the other kind."""
    counts = np.empty(marked.shape, dtype=np.int64)
    last_row, last = (None, None) if before is None else (before[0], before[1].astype(np.int64))
    for k, row in enumerate(marked):
        if last_row is None or last is None:
            counts[k] = np.iinfo(np.uint32).max // 2  # above any height
        else:
            counts[k] = np.where(row == last_row, last + 1, 1)
        last_row, last = row, counts[k]
    return counts


def row_minima(values: Squares, exists: Mask) -> Squares:
    """Return the smallest (x - i)^2 + values[row, i] over all i that exist, for each row and x."""
    height, width = values.shape
    minima = np.full(values.shape, _NONE)
    has_sites = exists.any(axis=1)
    if not has_sites.all():
        if has_sites.any():
            minima[has_sites] = row_minima(values[has_sites], exists[has_sites])
        return minima
    # all columns that count, row after row; those of row r are sites[ends[r] : ends[r + 1]]
    sites, added = np.nonzero(exists)[1], values[exists]
    ends = np.concatenate([[0], np.cumsum(exists.sum(axis=1))])
    best = np.empty(values.shape, dtype=np.int64)  # indices of sites
    step = 1 << max(width - 1, 0).bit_length()
    cells = np.array([0])
    while step:
        low = ends[:-1, np.newaxis] + np.zeros_like(cells)
        high = ends[1:, np.newaxis] - 1 + np.zeros_like(cells)
        if step < width:
            np.copyto(low, best[:, np.maximum(cells - step, 0)], where=cells >= step)
            inner = cells + step < width
            np.copyto(high, best[:, np.minimum(cells + step, width - 1)], where=inner)
        found, lowest = _lowest_in(
            np.broadcast_to(cells, low.shape).ravel(), low.ravel(), high.ravel(), sites, added
        )
        best[:, cells] = found.reshape(height, -1)
        minima[:, cells] = lowest.reshape(height, -1)
        step //= 2
        cells = np.arange(step, width, 2 * step) if step else cells
    return minima


def _lowest_in(
    cells: Squares, low: Squares, high: Squares, sites: Squares, added: Squares
) -> tuple[Squares, Squares]:  # fmt: skip
    """Return, for each cell, the best of the sites low .. high, and what it gives."""
    lengths = high - low + 1
    starts = np.cumsum(lengths) - lengths
    candidates = np.arange(lengths.sum()) + np.repeat(low - starts, lengths)
    values = (np.repeat(cells, lengths) - sites[candidates]) ** 2 + added[candidates]
    lowest = np.minimum.reduceat(values, starts)
    hits = np.flatnonzero(values == np.repeat(lowest, lengths))
    return candidates[hits[np.searchsorted(hits, starts)]], lowest
