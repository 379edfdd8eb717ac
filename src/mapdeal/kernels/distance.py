"""Exact distances to marked cells, and the cells near them, by either engine.

Squared distances are integers, in cells, until the last step. A grid is transformed at once, or
block by block (`runs_of`, `halos_of`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels import engine, lookup, threads
from mapdeal.kernels.arrays import Bytes, Integers, Mask, Metres, SquaredDistances, unreachable
from mapdeal.kernels.blocks import Border, Halo, Runs
from mapdeal.records import dataclass

with suppress(ImportError):  # then `engine_name` is never compiled
    from mapdeal.kernels import _dilation, _updates

_LARGEST_TABLE = 1 << 20
_BAND_ROWS = 64
_HALOS_OF_A_BAND = 2  # rows of a band in reaches: those around it are read twice


def squares_between_cells(reach: int) -> Integers:
    occurs = np.zeros(reach * reach + 1, dtype=np.bool_)
    squares = np.arange(reach + 1, dtype=np.int64) ** 2
    for row, square in enumerate(squares):
        sums = square + squares[: row + 1]
        occurs[sums[sums < len(occurs)]] = True
    return np.flatnonzero(occurs)


# The first pass of a distance transform counts along the columns to the nearest cell of the other
# kind. A block of rows needs from the other blocks only how far the runs of equal cells at its
# borders continue: two numbers per column, its halo. So `runs_of` measures the blocks in any order
# or in parallel, `halos_of` joins these lengths, and then each block is solved alone.


@dataclass(frozen=True, eq=False)
class BlockRuns:
    """Border rows of a block, and the lengths of the runs that start there."""

    rows: int
    first: Mask
    last: Mask
    up: Runs
    down: Runs


def runs_of(marked: Mask) -> BlockRuns:
    first, last = marked[0].copy(), marked[-1].copy()
    return BlockRuns(len(marked), first, last, _run(marked), _run(marked[::-1]))


def _run(marked: Mask) -> Runs:
    """Return the length of the run of equal cells at the top of each column."""
    continues = np.ones(marked.shape[1], dtype=bool)
    count = np.ones(marked.shape[1], dtype=np.uint16)
    for row in marked[1:]:
        continues &= row == marked[0]
        count += continues
    return count.astype(np.uint32)


def halos_of(blocks: Sequence[BlockRuns]) -> list[Halo]:
    height = sum(block.rows for block in blocks)
    endless = np.full(len(blocks[0].first), np.iinfo(np.uint32).max - height - 1, dtype=np.uint32)
    before = _reaching([(b.rows, b.first, b.last, b.down) for b in blocks], endless)
    after = _reaching([(b.rows, b.last, b.first, b.up) for b in reversed(blocks)], endless)
    return [Halo(height, *pair) for pair in zip(before, reversed(after), strict=True)]


def _reaching(
    blocks: Sequence[tuple[int, Mask, Mask, Runs]], reaching: Runs
) -> list[Border | None]:
    """Return the last row before each block, and the lengths of the runs that end there."""
    found: list[Border | None] = [None]
    for rows, first, last, within in blocks[:-1]:
        through = within == rows
        if found[-1] is not None:
            through &= first == found[-1][0]
        reaching = np.where(through, within + reaching, within)
        found.append((last, reaching))
    return found


def squared_distance(marked: Mask, *, limit: int | None = None) -> SquaredDistances:
    """Return squared distances to marked cells; those above the limit are `unreachable`."""
    return _engine(marked).squares(marked, limit)  # type: ignore[no-any-return]


def signed_distance(
    occupied: Mask, *, scale: float = 1.0, outside_shift: float = 0.0, inside_shift: float = 0.0,
    clip: float = math.inf, gain: float = 1.0, halo: Halo | None = None,
) -> Metres:  # fmt: skip
    """Return each cell's signed distance to the nearest cell of the other kind."""
    height = len(occupied) if halo is None else halo.height
    return _engine(occupied, height).metres(  # type: ignore[no-any-return]
        occupied, scale, outside_shift, inside_shift, clip, gain, halo
    )


def bytes_by_distance(marked: Mask, table: Bytes) -> Bytes:
    table = np.ascontiguousarray(table, dtype=np.uint8)
    return _engine(marked).bytes_of_squares(marked, table)  # type: ignore[no-any-return]


def _engine(marked: Mask, height: int = 0) -> ModuleType:
    if engine.engine_name() == "compiled" and marked.size > 0:
        from mapdeal.kernels import compiled

        if max(*marked.shape, height) <= compiled.LONGEST_SIDE:
            return compiled
    from mapdeal.kernels import scipy_twins

    return scipy_twins


# The compiled engine draws squares, discs and rings of up to 62 cells around all marked cells at
# once, with a few byte operations for each cell and row of the shape. Larger discs are drawn by
# distance, larger squares by shifted copies.


def dilate_square(marked: Mask, reach: int) -> Mask:
    if _can_draw(marked, reach):
        return _covered(marked, reach, None)
    return _widened(_widened(marked, reach).T, reach).T


def beside(cells: Mask) -> Mask:
    """Return the cells that share an edge with a cell of a mask."""
    found = np.zeros_like(cells)
    found[1:] |= cells[:-1]
    found[:-1] |= cells[1:]
    found[:, 1:] |= cells[:, :-1]
    found[:, :-1] |= cells[:, 1:]
    return found


def within_distance(marked: Mask, square: int) -> Mask:
    reach = math.isqrt(square)
    if _can_draw(marked, reach):
        return _covered(marked, reach, square)
    if square > _LARGEST_TABLE:
        squared = squared_distance(marked, limit=square)
        return squared != unreachable(squared)  # type: ignore[no-any-return]
    table = np.ones(square + 2, dtype=np.uint8)
    table[-1] = 0
    return bytes_by_distance(marked, table).view(np.bool_)


def inflated(
    values: NDArray[np.int8], threshold: int,
    *, reach: int = 0, square: int | None = None, value: int, protected: int | None = None,
) -> NDArray[np.int8]:  # fmt: skip
    protected = value if protected is None else protected  # writing `value` over it has no effect
    reach = math.isqrt(square) if square is not None else reach
    if _can_draw(values, reach):
        cells, found = np.ascontiguousarray(values), np.empty(values.shape, np.int8)
        _draw(
            _dilation.put, values.shape, reach, cells, threshold, _half_widths(reach, square),
            square is None, value, protected, found,
        )  # fmt: skip
        return found
    occupied = values >= threshold
    if square is None:
        covered = dilate_square(occupied, reach)
    else:
        covered = within_distance(occupied, square)
    covered &= (values != protected) | occupied
    found = values.copy()
    lookup.set_where(found, covered, value)
    return found


def ringed(values: NDArray[np.int8], marked: Mask, costs: Sequence[int]) -> NDArray[np.int8]:
    """Return values with the cells around marked ones replaced by the cost of their ring."""
    reach = len(costs) - 1
    found = np.empty(values.shape, np.int8)
    if _can_draw(marked, reach):
        cells, table = np.ascontiguousarray(values), np.array(costs, np.int8)
        bytes_, halves = _bytes_of(marked), _half_widths(reach, None)
        _draw(_dilation.ring, marked.shape, reach, bytes_, halves, table, cells, found)
        return found
    found[...] = values
    inner = marked
    found[inner] = costs[0]
    for cost in costs[1:]:
        outer = dilate_square(inner, 1)
        found[outer & ~inner] = cost
        inner = outer
    return found


def _can_draw(cells: NDArray[np.generic], reach: int) -> bool:
    if engine.engine_name() != "compiled" or cells.size == 0 or reach < 0:
        return False
    return reach <= _dilation.most_reach


def _half_widths(reach: int, square: int | None) -> Bytes:
    """Return the half widths of a shape's rows, by their distance from the middle."""
    if square is None:
        return np.full(reach + 1, reach, np.uint8)
    return np.array([math.isqrt(square - row * row) for row in range(reach + 1)], np.uint8)


def _covered(marked: Mask, reach: int, square: int | None) -> Mask:
    bytes_, covered = _bytes_of(marked), np.empty(marked.shape, np.uint8)
    halves = _half_widths(reach, square)
    _draw(_dilation.cover, marked.shape, reach, bytes_, halves, square is None, covered)
    return covered.view(np.bool_)


def _bytes_of(marked: Mask) -> Bytes:
    return np.ascontiguousarray(marked).view(np.uint8)


def _draw(
    work: Callable[..., None], shape: tuple[int, ...], reach: int, *arguments: object
) -> None:
    step = max(_BAND_ROWS, _HALOS_OF_A_BAND * reach)
    threads.for_rows(lambda rows: work(*arguments, rows.start, rows.stop), shape, step)


def _widened(marked: Mask, reach: int) -> Mask:
    reach = min(reach, len(marked))
    grown, covered = marked.copy(), 0
    while covered < reach:
        # c covered cells leave no gap when shifted by c + 1, even if a border cuts off one side
        step = min(covered + 1, reach - covered)
        before = grown.copy()
        grown[step:] |= before[:-step]
        grown[:-step] |= before[step:]
        covered += step
    return grown


def queued_squares(seeds: Mask, reach: int) -> NDArray[np.int32]:
    """Return the squared distance to the seed from which the queue reaches a cell."""
    # updateCosts in inflation_layer.cpp of ROS 1 and legacy_inflation_layer.cpp of Nav2. Rarely,
    # this is not the nearest seed, because each cell passes on only its own.
    most = reach * reach
    if engine.engine_name() == "compiled":
        found = np.full(seeds.shape, most + 1, dtype=np.int32)
        ends = np.full((2, most + 1), -1, dtype=np.int32)
        queue = np.empty((5 * seeds.size, 3), dtype=np.int32)
        _updates.spread(seeds.view(np.uint8), found, queue, ends, most)
        return found
    width = seeds.shape[1]
    squares = np.full(seeds.size, most + 1, dtype=np.int32)
    is_new = np.ones(seeds.size, dtype=np.bool_)
    start = np.flatnonzero(seeds)
    bins: dict[int, list[Integers]] = {0: [np.array([start, start])]}
    while bins:
        square = min(bins)
        cells, sources = np.concatenate(bins.pop(square), axis=1)
        _, first = np.unique(cells, return_index=True)
        first = np.sort(first[is_new[cells[first]]])
        cells, sources = cells[first], sources[first]
        is_new[cells], squares[cells] = False, square
        col = cells % width
        nearby = np.stack([cells - 1, cells - width, cells + 1, cells + width], axis=1)
        below, above = cells >= width, cells < seeds.size - width
        inside = np.stack([col > 0, below, col < width - 1, above], axis=1)
        nearby, origins = nearby[inside], np.repeat(sources[:, np.newaxis], 4, axis=1)[inside]
        rows, cols = nearby // width - origins // width, nearby % width - origins % width
        reached = rows * rows + cols * cols
        useful = is_new[nearby] & (reached <= most) & (reached > square)
        nearby, origins, reached = nearby[useful], origins[useful], reached[useful]
        for value in np.unique(reached).tolist():
            bins.setdefault(value, []).append(np.array([nearby, origins])[:, reached == value])
    return squares.reshape(seeds.shape)
