"""Connected components of marked cells, with a label for each cell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.records import dataclass

Mask = NDArray[np.bool_]

_CELLS_TOGETHER = 1 << 20


@dataclass(frozen=True, eq=False)
class Labels:
    """The connected components of marked cells."""

    cells: NDArray[np.int32]
    sizes: NDArray[np.int64]

    def touched_by(self, marked: Mask) -> Mask:
        """Return which components have a cell that is marked, shape (N + 1,)."""
        touched = np.zeros(len(self.sizes), dtype=np.bool_)
        touched[self.cells[marked]] = True
        touched[0] = False
        return touched

    def cells_of(self, chosen: Mask) -> Mask:
        """Return the cells of chosen components, shape (H, W)."""
        found = np.empty(self.cells.shape, dtype=np.bool_)
        for rows in _bands(self.cells.shape):
            np.take(chosen, self.cells[rows], out=found[rows])
        return found


def labelled(marked: Mask, *, corners: bool) -> Labels:
    """Return the connected components of marked cells."""
    from scipy import ndimage

    cells, count = ndimage.label(marked, structure=np.ones((3, 3)) if corners else None)
    sizes = np.zeros(count + 1, dtype=np.int64)
    for rows in _bands(cells.shape):
        labels = cells[rows][marked[rows]]
        if len(labels):  # labels are in the order of cells: those of a band lie close together
            first = labels.min()
            counts = np.bincount(labels - first)
            sizes[first : first + len(counts)] += counts
    return Labels(cells, sizes)


def _bands(shape: tuple[int, int]) -> list[slice]:
    """Return slices of rows that hold no more cells than fit the processor's caches."""
    height, width = shape
    step = max(1, _CELLS_TOGETHER // width)
    return [slice(row, row + step) for row in range(0, height, step)]
