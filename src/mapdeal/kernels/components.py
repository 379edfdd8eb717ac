"""Sizes of connected components, found while rows go by: no labels of the whole are kept.

Marked cells are runs along their rows. Runs of neighbouring rows that touch are joined; of what is
behind, only the components that reach the last row can still grow.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.groups import least_joined

Cells = NDArray[np.int64]

_CELLS_TOGETHER = 1 << 18


class _Front(NamedTuple):
    """The runs of the last row, shape (N,), and the components that they belong to."""

    starts: Cells
    stops: Cells
    components: Cells
    """Of each run, 0 .. K - 1."""
    sizes: Cells
    """Cells so far of each component, shape (K,)."""


class Components:
    """Measures the 8-connected components of marked cells, of which some rows come at a time.

    Examples
    --------
    >>> components = Components()
    >>> components.add(np.array([[True, False, True], [False, True, False]]))
    >>> components.add(np.array([[False, False, False], [True, True, False]]))
    >>> [listed.tolist() for listed in components.sizes()]
    [[2, 3], [1, 1]]
    """

    def __init__(self) -> None:
        nothing = np.zeros(0, dtype=np.int64)
        self._front = _Front(nothing, nothing, nothing, nothing)
        self._closed: Counter[int] = Counter()

    def add(self, marked: NDArray[np.bool_]) -> None:
        """Take the next rows.

        Parameters
        ----------
        marked : numpy.ndarray of bool, shape (H, W)
            They follow those before, from one side of the grid to the other; W is always the same.
        """
        height, width = marked.shape
        step = max(1, _CELLS_TOGETHER // width)
        for first in range(0, height, step):
            self._add_band(marked[first : first + step])

    def sizes(self) -> tuple[Cells, Cells]:
        """Return the sizes of the components so far, and how many there are of each.

        Returns
        -------
        sizes : numpy.ndarray of int64, shape (N,)
            Cells, each size once, the smallest first.
        counts : numpy.ndarray of int64, shape (N,)
            A million specks of a cell are one number here.
        """
        found = self._closed + Counter(self._front.sizes.tolist())
        listed = sorted(found.items())
        sizes, counts = np.array(listed, dtype=np.int64).reshape(-1, 2).T
        return sizes, counts

    def _add_band(self, marked: NDArray[np.bool_]) -> None:
        height, width = marked.shape
        front, stride = self._front, width + 1
        starts, stops = _runs(marked)
        # the last row of the band before comes first, as row 0
        before, live = len(front.starts), len(front.sizes)
        all_starts = np.concatenate([front.starts, starts + stride])
        all_stops = np.concatenate([front.stops, stops + stride])
        nodes = np.concatenate([front.components, live + np.arange(len(starts))])
        one, other = _touching(all_starts, all_stops, stride)
        least = least_joined(nodes[one], nodes[other], live + len(starts))
        cells = np.concatenate([front.sizes, stops - starts])
        sizes = np.zeros(len(cells), dtype=np.int64)
        np.add.at(sizes, least, cells)
        in_last_row = before + int(np.searchsorted(starts, (height - 1) * stride))
        reached, components = np.unique(least[nodes[in_last_row:]], return_inverse=True)
        shift = height * stride
        self._front = _Front(
            all_starts[in_last_row:] - shift, all_stops[in_last_row:] - shift, components,
            sizes[reached],
        )  # fmt: skip
        sizes[reached] = 0
        closed, counts = np.unique(sizes[sizes > 0], return_counts=True)
        for size, count in zip(closed.tolist(), counts.tolist(), strict=True):
            self._closed[size] += count


def _runs(marked: NDArray[np.bool_]) -> tuple[Cells, Cells]:
    """Return where runs of marked cells begin and end, as numbers of cells.

    Rows are counted as one cell wider than they are, so that no run touches one of the next row.
    """
    height, width = marked.shape
    edges = np.empty((height, width + 1), dtype=np.bool_)
    edges[:, 0], edges[:, -1] = marked[:, 0], marked[:, -1]
    np.not_equal(marked[:, 1:], marked[:, :-1], out=edges[:, 1:-1])
    at = np.flatnonzero(edges)
    return at[::2], at[1::2]


def _touching(starts: Cells, stops: Cells, stride: int) -> tuple[Cells, Cells]:
    """Return pairs of runs, as positions in the list, that touch over an edge or a corner."""
    first = np.searchsorted(stops, starts + stride)
    behind = np.searchsorted(starts, stops + stride, side="right")
    counts = np.maximum(behind - first, 0)
    one = np.repeat(np.arange(len(starts)), counts)
    ends = np.cumsum(counts)
    other = np.arange(len(one)) + np.repeat(first - ends + counts, counts)
    return one, other
