"""Exact squared distances, by either engine, whole or block by block.

Squares of distances are whole numbers of cells, and are kept so until the last step. The engine
(see `mapdeal.kernels.engine`) makes no difference to any result.

The first pass of a distance transform counts along the columns to the nearest cell of the other
kind. A block, some rows of a grid, needs of all the others only how the runs of equal cells that
touch its borders go on there: two numbers a column, its halo. So a grid can be looked at block by
block, in any order or at the same time (`runs_of`), what was found makes the halos (`halos_of`),
and then every block is solved alone (`signed_distance`).

scipy's transform knows nothing of a halo. For it heights, the distances within the columns, are
counted here, and each cell's square is the smallest of (x - i)^2 + height(i)^2 over all columns i.
The best i never decreases with x. So the middle cells are solved first, and those between them
among the columns that are left, all rows at the same time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name

SquaredDistances = NDArray[np.signedinteger[Any]]

_LONGEST_SIDE_IN_32_BITS = 32767
"""Twice its square stays below the largest int32, which is taken."""


def unreachable(squared: SquaredDistances) -> int:
    """Return the value that stands for "no such cell" in an array of squared distances."""
    return int(np.iinfo(squared.dtype).max)


def dtype_of_squares(shape: tuple[int, ...]) -> type[np.int32] | type[np.int64]:
    """Return int32 for sides of up to 32,767 cells, else int64."""
    return np.int32 if max(shape) <= _LONGEST_SIDE_IN_32_BITS else np.int64


def squares_between_cells(reach: int) -> NDArray[np.int64]:
    """Return the squared distances that occur between cell centres, up to `reach` cells.

    Examples
    --------
    >>> squares_between_cells(3).tolist()
    [0, 1, 2, 4, 5, 8, 9]
    """
    occurs = np.zeros(reach * reach + 1, dtype=np.bool_)
    squares = np.arange(reach + 1, dtype=np.int64) ** 2
    for row, square in enumerate(squares):
        sums = square + squares[: row + 1]
        occurs[sums[sums < len(occurs)]] = True
    return np.flatnonzero(occurs)


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
    """Return the lengths of runs, those through the whole block with what reaches it added."""
    # `is_equal`: whether the block's border is as the row beside it; None where there is none.
    through = within == rows
    if is_equal is not None:
        through &= is_equal
    return np.where(through, within + reaching, within)


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
    lengths = high - low + 1
    starts = np.cumsum(lengths) - lengths
    candidates = np.arange(lengths.sum()) + np.repeat(low - starts, lengths)
    values = (np.repeat(cells, lengths) - sites[candidates]) ** 2 + added[candidates]
    lowest = np.minimum.reduceat(values, starts)
    hits = np.flatnonzero(values == np.repeat(lowest, lengths))
    return candidates[hits[np.searchsorted(hits, starts)]], lowest


def squared_distance(
    marked: NDArray[np.bool_], *, limit: int | None = None
) -> SquaredDistances:  # fmt: skip
    """Return each cell's squared distance to the nearest marked cell."""
    _check_limit(limit)
    return _engine(marked).squares(marked, both_kinds=False, limit=limit)  # type: ignore[no-any-return]


def signed_squared_distance(
    occupied: NDArray[np.bool_], *, limit: int | None = None
) -> SquaredDistances:  # fmt: skip
    """Return each cell's squared distance to the nearest cell of the other kind."""
    _check_limit(limit)
    return _engine(occupied).squares(occupied, both_kinds=True, limit=limit)  # type: ignore[no-any-return]


def signed_distance(
    occupied: NDArray[np.bool_],
    *,
    scale: float = 1.0,
    outside_shift: float = 0.0,
    inside_shift: float = 0.0,
    clip: float = math.inf,
    gain: float = 1.0,
    halo: Halo | None = None,
) -> NDArray[np.float32]:
    """Return each cell's signed distance to the nearest cell of the other kind."""
    height = len(occupied) if halo is None else halo.height
    return _engine(occupied, height).metres(  # type: ignore[no-any-return]
        occupied, scale=scale, outside_shift=outside_shift, inside_shift=inside_shift, clip=clip,
        gain=gain, halo=halo,
    )  # fmt: skip


def bytes_by_distance(
    marked: NDArray[np.bool_], table: NDArray[np.uint8]
) -> NDArray[np.uint8]:  # fmt: skip
    """Return for each cell what a table says of its squared distance to the nearest marked cell."""
    if len(table) < 2:
        raise ValueError("the table needs at least two entries")
    table = np.ascontiguousarray(table, dtype=np.uint8)
    return _engine(marked).bytes_of_squares(marked, table)  # type: ignore[no-any-return]


def _check_limit(limit: int | None) -> None:
    if limit is not None and limit < 0:
        raise ValueError(f"limit must be at least 0, not {limit}")


def _engine(marked: NDArray[np.bool_], height: int = 0) -> ModuleType:
    """Return the module that serves for a grid, or a part of a grid of some height."""
    if marked.dtype != np.bool_ or marked.ndim != 2:
        rule = f"a mask must be a bool array with two axes, not {marked.ndim} of {marked.dtype}"
        raise ValueError(rule)
    if engine_name() == "compiled" and marked.size > 0:
        from mapdeal.kernels import distance_compiled as compiled_distance

        if max(*marked.shape, height) <= compiled_distance.longest_side():
            return compiled_distance
    from mapdeal.kernels import distance_numpy as scipy_distance

    return scipy_distance
