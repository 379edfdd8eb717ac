"""Connected components.

Marked cells are runs along their rows. Runs of neighbouring rows that touch are joined; of what is
behind, only the components that reach the last row can still grow. Of each size some components are
remembered by a cell of theirs: the middle of the longest run, which is well inside of most.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


def drop_small_groups(marked: NDArray[np.bool_], min_cells: int) -> NDArray[np.bool_]:
    """Return `marked` without its 8-connected groups of fewer than `min_cells` cells."""
    if min_cells <= 1:
        return marked
    from scipy import ndimage

    groups, _ = ndimage.label(marked, structure=np.ones((3, 3), dtype=bool))
    sizes = np.bincount(groups.ravel())
    keep = sizes >= min_cells
    keep[0] = False
    kept: NDArray[np.bool_] = keep[groups]
    return kept


Mask = NDArray[np.bool_]

_LABELS_TOGETHER = 1 << 20


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
    step = max(1, _LABELS_TOGETHER // width)
    return [slice(row, row + step) for row in range(0, height, step)]


Cells = NDArray[np.int64]


def touching_groups(marked: NDArray[np.bool_]) -> tuple[Cells, Cells]:
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


Lengths = NDArray[np.int64]


def thickness_of(marked: NDArray[np.bool_]) -> Lengths:
    """Return how thick a structure is at each of its cells."""
    # A straight wall has its thickness along its shorter axis, a slanted one of one cell is one
    # cell thick. Where two walls cross, both runs may be long: the cells there count as thick.
    height, width = marked.shape
    _, along = _runs_along(marked)
    cols, across = _runs_along(marked.T)
    # the second list goes through the cells column by column
    order = np.argsort(cols % height * width + cols // height, kind="stable")
    return np.minimum(along, across[order])


def _runs_along(marked: NDArray[np.bool_]) -> tuple[Lengths, Lengths]:
    """Return the marked cells as indices, row by row, and the length of each one's run."""
    width = marked.shape[1]
    at = np.flatnonzero(marked)
    if not len(at):
        return at, at
    begins = (np.diff(at, prepend=-2) > 1) | (at % width == 0)
    first = np.flatnonzero(begins)
    lengths = np.diff(first, append=len(at))
    return at, np.repeat(lengths, lengths)


MOST_PLACES = 20
"""Components of a size of which a cell is kept."""

_CELLS_TOGETHER = 1 << 18
_NOWHERE = np.iinfo(np.int64).max


class _Front(NamedTuple):
    """The runs of the last row, shape (N,), and the components that they belong to."""

    starts: Cells
    stops: Cells
    components: Cells
    """Of each run, 0 .. K - 1."""
    sizes: Cells
    """Cells so far of each component, shape (K,)."""
    longest: Cells
    """The longest run so far of each component, cells."""
    middles: Cells
    """The cell in the middle of that."""


class Components:
    """Measures the 8-connected components of marked cells, of which some rows come at a time."""

    def __init__(self, last_row: int | None = None) -> None:
        nothing = np.zeros(0, dtype=np.int64)
        self._front = _Front(nothing, nothing, nothing, nothing, nothing, nothing)
        self._closed: Counter[int] = Counter()
        self._places: dict[int, list[int]] = {}
        self._row, self._step = (0, 1) if last_row is None else (last_row, -1)

    def add(self, marked: NDArray[np.bool_]) -> None:
        """Take the next rows."""
        height, width = marked.shape
        step = max(1, _CELLS_TOGETHER // width)
        for first in range(0, height, step):
            self._add_band(marked[first : first + step])

    def sizes(self) -> tuple[Cells, Cells]:
        found = self._closed + Counter(self._front.sizes.tolist())
        listed = sorted(found.items())
        sizes, counts = np.array(listed, dtype=np.int64).reshape(-1, 2).T
        return sizes, counts

    def places(self) -> dict[int, list[int]]:
        """Return a cell of some components of each size, those with the lowest of such cells."""
        found = {size: list(listed) for size, listed in self._places.items()}
        for size, middle in zip(
            self._front.sizes.tolist(), self._front.middles.tolist(), strict=True
        ):
            found.setdefault(size, []).append(middle)
        return {size: sorted(found[size])[:MOST_PLACES] for size in sorted(found)}

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
        lengths = stops - starts
        cells = np.concatenate([front.sizes, lengths])
        sizes = np.zeros(len(cells), dtype=np.int64)
        np.add.at(sizes, least, cells)
        longest, middles = _middles(
            least,
            np.concatenate([front.longest, lengths]),
            np.concatenate([front.middles, self._middles_of(starts, lengths, marked.shape)]),
        )
        self._row += self._step * height
        in_last_row = before + int(np.searchsorted(starts, (height - 1) * stride))
        reached, components = np.unique(least[nodes[in_last_row:]], return_inverse=True)
        shift = height * stride
        self._front = _Front(
            all_starts[in_last_row:] - shift, all_stops[in_last_row:] - shift, components,
            sizes[reached], longest[reached], middles[reached],
        )  # fmt: skip
        sizes[reached] = 0
        closed = np.flatnonzero(sizes)
        self._close(sizes[closed], middles[closed])

    def _middles_of(self, starts: Cells, lengths: Cells, shape: tuple[int, int]) -> Cells:
        """Return the cell in the middle of each run of a band, as the whole grid counts cells."""
        height, width = shape
        rows = np.arange(height)
        bounds = np.searchsorted(starts, np.append(rows, height) * (width + 1))
        in_whole = (self._row + self._step * rows) * width
        shifts = np.repeat(in_whole - rows * (width + 1), np.diff(bounds))
        return starts + shifts + ((lengths - 1) >> 1)

    def _close(self, sizes: Cells, middles: Cells) -> None:
        """Count components that grow no more."""
        if not len(sizes):
            return
        short = sizes.astype(np.uint16) if sizes.max() < 1 << 16 else sizes  # sorted in one go
        order = np.argsort(short, kind="stable")
        sizes, middles = sizes[order], middles[order]
        firsts = np.flatnonzero(np.diff(sizes, prepend=0))
        stops = np.append(firsts[1:], len(sizes))
        for size, first, stop in zip(
            sizes[firsts].tolist(), firsts.tolist(), stops.tolist(), strict=True
        ):
            self._closed[size] += stop - first
            some = middles[first:stop]
            if len(some) > MOST_PLACES:
                some = np.partition(some, MOST_PLACES)[:MOST_PLACES]
            kept = self._places.get(size, [])
            self._places[size] = sorted(kept + some.tolist())[:MOST_PLACES]


def _middles(least: Cells, lengths: Cells, middles: Cells) -> tuple[Cells, Cells]:
    longest = np.zeros(len(least), dtype=np.int64)
    np.maximum.at(longest, least, lengths)
    is_longest = lengths == longest[least]
    found = np.full(len(least), _NOWHERE)
    np.minimum.at(found, least[is_longest], middles[is_longest])
    return longest, found


def _runs(marked: NDArray[np.bool_]) -> tuple[Cells, Cells]:
    """Return where runs of marked cells begin and end, as numbers of cells."""
    # Rows are counted as one cell wider than they are, so that no run touches one of the next row.
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
