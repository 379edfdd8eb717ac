"""What slabs of rows must know of each other for distances to be exact across their borders.

The first pass of a distance transform counts along the columns to the nearest cell of the other
kind. A slab, some rows of a grid, needs of all the others only how the runs of equal cells that
touch its borders go on there: two numbers a column. So a grid can be looked at slab by slab, in
any order or at the same time (`runs_of`), what was found be joined (`joined`), and then every slab
be solved alone (`mapdeal.kernels.distance.signed_distance`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Runs = NDArray[np.uint32]

_MOST_ROWS = 1 << 16  # runs within a slab are counted in 16 bits


@dataclass(frozen=True, eq=False)
class SlabRuns:
    """What the slabs beside must know of a slab.

    Parameters
    ----------
    rows : int
        Rows of the slab.
    first, last : numpy.ndarray of bool, shape (W,)
        Its first and its last row.
    up, down : numpy.ndarray of uint32, shape (W,)
        Lengths of the runs of equal cells that start in the first row, and that end in the last.
    """

    rows: int
    first: Mask
    last: Mask
    up: Runs
    down: Runs


@dataclass(frozen=True, eq=False)
class Beside:
    """What a slab must know of the rows before and after it.

    Parameters
    ----------
    height : int
        Rows of the whole grid.
    before, after : tuple of numpy.ndarray, optional
        The row beside, bool, and the lengths of the runs of equal cells that reach it from
        farther off, uint32, both of shape (W,). Lengths above `height` stand for runs that start
        at the border of the grid. None: there is no such row.
    """

    height: int
    before: tuple[Mask, Runs] | None
    after: tuple[Mask, Runs] | None


def runs_of(marked: Mask) -> SlabRuns:
    """Return what the slabs beside must know of a slab, given its cells, shape (rows, W).

    Examples
    --------
    >>> runs = runs_of(np.array([[True, False], [False, False], [False, False]]))
    >>> runs.up.tolist(), runs.down.tolist()
    ([1, 3], [2, 3])
    """
    if not 1 <= len(marked) < _MOST_ROWS:
        raise ValueError(f"a slab must have between 1 and {_MOST_ROWS - 1} rows")
    return SlabRuns(
        len(marked), marked[0].copy(), marked[-1].copy(), _run(marked), _run(marked[::-1])
    )


def _run(marked: Mask) -> Runs:
    """Return for each column how many cells from the first row on are equal."""
    goes_on = np.ones(marked.shape[1], dtype=bool)
    count = np.ones(marked.shape[1], dtype=np.uint16)
    for row in marked[1:]:
        goes_on &= row == marked[0]
        count += goes_on
    return count.astype(np.uint32)


def joined(slabs: Sequence[SlabRuns]) -> list[Beside]:
    """Return what each slab must know of those beside it; together they are the grid.

    Examples
    --------
    >>> cells = np.array([[True, False], [False, False], [False, False]])
    >>> first, last = joined([runs_of(cells[:1]), runs_of(cells[1:])])
    >>> first.before is None, [part.tolist() for part in last.before]
    (True, [[True, False], [4294967292, 4294967292]])
    """
    height = sum(slab.rows for slab in slabs)
    width = len(slabs[0].first)
    endless = np.full(width, np.iinfo(np.uint32).max - height - 1, dtype=np.uint32)
    before: list[tuple[Mask, Runs] | None] = [None]
    reaching = endless
    for slab in slabs[:-1]:
        last = before[-1]
        reaching = _going_on(slab.down, slab.rows, None if last is None else slab.first == last[0],
                             reaching)  # fmt: skip
        before.append((slab.last, reaching))
    after: list[tuple[Mask, Runs] | None] = [None]
    reaching = endless
    for slab in reversed(slabs[1:]):
        last = after[-1]
        reaching = _going_on(slab.up, slab.rows, None if last is None else slab.last == last[0],
                             reaching)  # fmt: skip
        after.append((slab.first, reaching))
    return [Beside(height, *pair) for pair in zip(before, reversed(after), strict=True)]


def _going_on(within: Runs, rows: int, is_equal: Mask | None, reaching: Runs) -> Runs:
    """Return the lengths of runs, those through the whole slab with what reaches it added.

    `is_equal`: whether the slab's border is as the row beside it; None where there is none.
    """
    through = within == rows
    if is_equal is not None:
        through &= is_equal
    return np.where(through, within + reaching, within)
