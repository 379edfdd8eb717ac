"""Groups of cells that beams have hit again and again, and that a map nevertheless lacks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.display import OneLine, count_text
from mapdeal.grid.frame import Frame
from mapdeal.kernels.groups import touching_groups
from mapdeal.kernels.rays import MOST_HITS
from mapdeal.records import dataclass

Cells = NDArray[np.int64]
Mask = NDArray[np.bool_]

OFTEN = MOST_HITS
"""Hits from which on a cell counts: fewer may be noise."""

LEAST_CELLS = 3
"""Cells of a group: fewer may be people who walk by."""

NEAR = 2
"""Cells, along both axes, within which an occupied one stands for what was hit."""


@dataclass(frozen=True, eq=False, repr=False)
class HitGroups(OneLine):
    """Groups of touching cells, the largest first."""

    cells: Cells
    sizes: Cells

    @classmethod
    def none(cls) -> HitGroups:
        """Return an empty set of groups."""
        return cls(np.empty((0, 2), dtype=np.int64), np.empty(0, dtype=np.int64))

    def _told(self) -> Iterator[str]:
        yield count_text(len(self), "group")
        yield count_text(len(self.cells), "cell")

    def __len__(self) -> int:
        """Return the number of groups."""
        return len(self.sizes)

    @property
    def starts(self) -> Cells:
        """Index in `cells` at which each group begins, shape (M,)."""
        return np.cumsum(self.sizes) - self.sizes

    def middles_xy(self, frame: Frame) -> NDArray[np.float64]:
        """Return the mean cell centre of each group in the map frame, shape (M, 2), metres."""
        if not len(self):
            return np.empty((0, 2))
        means = np.add.reduceat(self.cells, self.starts, axis=0) / self.sizes[:, np.newaxis]
        return frame.xy_from_continuous_rowcol(means + 0.5)


def hit_groups(often_hit: Mask) -> HitGroups:
    """Return the groups of `LEAST_CELLS` cells and more that were hit often."""
    return _chosen(*touching_groups(often_hit))


def vanished_groups(often_hit: Mask, occupied: Mask) -> HitGroups:
    """Return the groups of hits that a map has nothing of."""
    # the cells in question are few: they are listed, and looked around from one by one
    at = np.flatnonzero(often_hit & ~occupied)
    candidates = np.stack(np.divmod(at, occupied.shape[1]), axis=1)
    lost = np.zeros(occupied.shape, dtype=np.bool_)
    lost.reshape(-1)[at[~_has_within(occupied, candidates, NEAR)]] = True
    cells, groups = touching_groups(lost)
    is_kept = np.zeros(len(cells), dtype=np.bool_)  # by group: it goes on in cells not lost
    is_kept[groups[_has_within(often_hit & ~lost, cells, 1)]] = True
    left = ~is_kept[groups]
    return _chosen(cells[left], groups[left])


def _has_within(marked: Mask, cells: Cells, reach: int) -> Mask:
    """Return for each cell whether a marked one lies within a reach along both axes."""
    found = np.zeros(len(cells), dtype=np.bool_)
    steps = range(-reach, reach + 1)
    rows = [np.clip(cells[:, 0] + step, 0, marked.shape[0] - 1) for step in steps]
    cols = [np.clip(cells[:, 1] + step, 0, marked.shape[1] - 1) for step in steps]
    for row in rows:
        for col in cols:
            found |= marked[row, col]
    return found


def _chosen(cells: Cells, groups: Cells) -> HitGroups:
    """Return the groups that are large enough, of cells row by row."""
    sizes = np.bincount(groups)
    numbers = np.flatnonzero(sizes >= LEAST_CELLS)
    numbers = numbers[np.argsort(-sizes[numbers], kind="stable")]
    place = np.full(len(sizes), len(sizes))
    place[numbers] = np.arange(len(numbers))
    order = np.argsort(place[groups], kind="stable")[: sizes[numbers].sum()]
    return HitGroups(cells[order], sizes[numbers])
