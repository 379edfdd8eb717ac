"""Where a field changes its sign from cell to cell, and walls one cell thick along it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Field = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Crossings(NamedTuple):
    """Pairs of neighbours of different sign, and cells that are exactly zero."""

    along_rows: Mask
    along_cols: Mask
    at_zero: Mask
    field: Field

    def places(self) -> Field:
        """Return where the field is zero, continuous row and column, shape (N, 2).

        Between two centres the field is taken for linear.
        """
        parts = [np.argwhere(self.at_zero) + 0.5]
        for axis, changes in ((1, self.along_rows), (0, self.along_cols)):
            cells = np.argwhere(changes)
            near = self.field[tuple(cells.T)]
            cells[:, axis] += 1
            far = self.field[tuple(cells.T)]
            places = cells + 0.5
            places[:, axis] += near / (near - far) - 1.0  # from the second cell's centre back
            parts.append(places)
        return np.concatenate(parts)


def crossings_of(field: Field) -> Crossings:
    """Return where a field, nan where there are no values, changes its sign."""
    with np.errstate(invalid="ignore"):
        positive, negative = field > 0, field < 0
    along_rows = positive[:, :-1] & negative[:, 1:] | negative[:, :-1] & positive[:, 1:]
    along_cols = positive[:-1] & negative[1:] | negative[:-1] & positive[1:]
    return Crossings(along_rows, along_cols, field == 0, field)


def thin_surface(field: Field, crossings: Crossings) -> Mask:
    """Return cells that part positive from negative ones, as few as leave no gap.

    Of each pair that the sign changes between at least one cell is chosen: the one nearer to
    zero. Where a cell's partners are all chosen themselves it is not needed, and is left out, those
    farthest from zero first.
    """
    size = np.abs(field)
    chosen = crossings.at_zero.copy()
    for changes, first, second in _sides(crossings):
        # of equal ones that behind the surface, so that free space stays
        nearer = (size[first] < size[second]) | (size[first] == size[second]) & (field[first] < 0)
        chosen[first] |= changes & nearer
        chosen[second] |= changes & ~nearer
    needed = np.zeros(field.shape, dtype=np.int64)  # partners that are not chosen
    partners = np.zeros(field.shape, dtype=np.int64)
    for changes, first, second in _sides(crossings):
        needed[first] += changes & ~chosen[second]
        needed[second] += changes & ~chosen[first]
        partners[first] += changes
        partners[second] += changes
    spare = np.argwhere(chosen & (needed == 0) & (partners > 0) & ~crossings.at_zero)
    for index in np.argsort(-size[tuple(spare.T)], kind="stable").tolist():
        row, col = spare[index].tolist()
        if needed[row, col] == 0:
            chosen[row, col] = False
            for other in _partners_of(crossings, row, col):
                needed[other] += 1
    thin_blocks(chosen, size)
    return chosen


def thin_blocks(chosen: Mask, size: Field) -> None:
    """Take cells out of blocks of 2 x 2, in place, that the wall is as connected without.

    Noise leaves such blocks where the sign changes to and fro. Those farthest from zero go first.
    """
    padded = np.pad(chosen, 1)
    blocks = padded[1:, 1:] & padded[1:, :-1] & padded[:-1, 1:] & padded[:-1, :-1]
    in_block = blocks[1:, 1:] | blocks[1:, :-1] | blocks[:-1, 1:] | blocks[:-1, :-1]
    cells = np.argwhere(in_block)
    for index in np.argsort(-size[tuple(cells.T)], kind="stable").tolist():
        row, col = cells[index].tolist()
        ring = [bool(padded[row + 1 + y, col + 1 + x]) for y, x in _RING]
        if _has_corner(ring) and _is_simple(ring):
            padded[row + 1, col + 1] = chosen[row, col] = False


_RING = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))
"""The neighbours of a cell, one after the other."""


def _has_corner(ring: list[bool]) -> bool:
    """Return whether three neighbours in a row, a diagonal one in the middle, are all set."""
    return any(ring[k] and ring[k + 1] and ring[(k + 2) % 8] for k in (0, 2, 4, 6))


def _is_simple(ring: list[bool]) -> bool:
    """Return whether what a cell connects is connected without it, diagonal steps included.

    That is so if Yokoi's connectivity number is 1.
    """
    free = [not value for value in ring]
    return sum(free[k] - (free[k] and free[k + 1] and free[(k + 2) % 8]) for k in (0, 2, 4, 6)) == 1


_Slices = tuple[slice, slice]


def _sides(crossings: Crossings) -> list[tuple[Mask, _Slices, _Slices]]:
    """Return for both directions the changes, and where their first and second cells are."""
    every = slice(None)
    return [
        (crossings.along_rows, (every, slice(None, -1)), (every, slice(1, None))),
        (crossings.along_cols, (slice(None, -1), every), (slice(1, None), every)),
    ]


def _partners_of(crossings: Crossings, row: int, col: int) -> list[tuple[int, int]]:
    rows, cols = crossings.along_rows, crossings.along_cols
    found = []
    if col < rows.shape[1] and rows[row, col]:
        found.append((row, col + 1))
    if col > 0 and rows[row, col - 1]:
        found.append((row, col - 1))
    if row < cols.shape[0] and cols[row, col]:
        found.append((row + 1, col))
    if row > 0 and cols[row - 1, col]:
        found.append((row - 1, col))
    return found
