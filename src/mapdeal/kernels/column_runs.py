"""What blocks of rows must know of each other for distances to be exact across their borders.

The first pass of a distance transform counts along the columns to the nearest cell of the other
kind. A block, some rows of a grid, needs of all the others only how the runs of equal cells that
touch its borders go on there: two numbers a column, its halo. So a grid can be looked at block by
block, in any order or at the same time (`runs_of`), what was found makes the halos (`halos_of`),
and then every block is solved alone (`mapdeal.kernels.distance.signed_distance`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.records import dataclass

Mask = NDArray[np.bool_]
Runs = NDArray[np.uint32]

_MOST_ROWS = 1 << 16  # runs within a block are counted in 16 bits


@dataclass(frozen=True, eq=False)
class BlockRuns:
    """What the blocks beside must know of a block."""

    rows: int
    first: Mask
    last: Mask
    up: Runs
    down: Runs


@dataclass(frozen=True, eq=False)
class Halo:
    """What a block must know of the rows before and after it."""

    height: int
    before: tuple[Mask, Runs] | None
    after: tuple[Mask, Runs] | None


def runs_of(marked: Mask) -> BlockRuns:
    """Return what the blocks beside must know of a block, given its cells, shape (rows, W)."""
    if not 1 <= len(marked) < _MOST_ROWS:
        raise ValueError(f"a block must have between 1 and {_MOST_ROWS - 1} rows")
    return BlockRuns(
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


def halos_of(blocks: Sequence[BlockRuns]) -> list[Halo]:
    """Return what each block must know of those beside it; together they are the grid."""
    height = sum(block.rows for block in blocks)
    width = len(blocks[0].first)
    endless = np.full(width, np.iinfo(np.uint32).max - height - 1, dtype=np.uint32)
    before: list[tuple[Mask, Runs] | None] = [None]
    reaching = endless
    for block in blocks[:-1]:
        last = before[-1]
        is_equal = None if last is None else block.first == last[0]
        reaching = _going_on(block.down, block.rows, is_equal, reaching)
        before.append((block.last, reaching))
    after: list[tuple[Mask, Runs] | None] = [None]
    reaching = endless
    for block in reversed(blocks[1:]):
        last = after[-1]
        is_equal = None if last is None else block.last == last[0]
        reaching = _going_on(block.up, block.rows, is_equal, reaching)
        after.append((block.first, reaching))
    return [Halo(height, *pair) for pair in zip(before, reversed(after), strict=True)]


def _going_on(within: Runs, rows: int, is_equal: Mask | None, reaching: Runs) -> Runs:
    """Return the lengths of runs, those through the whole block with what reaches it added.

    `is_equal`: whether the block's border is as the row beside it; None where there is none.
    """
    through = within == rows
    if is_equal is not None:
        through &= is_equal
    return np.where(through, within + reaching, within)
