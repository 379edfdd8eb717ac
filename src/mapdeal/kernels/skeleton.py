"""Skeletons: thin lines in the middle of an area, and shortest paths and areas over its cells.

Thinning removes cells by rising squared distance, so that the remaining lines lie in the middle. It
never removes a cell that would split a part, join parts, or open or close a loop: the lines have
the same parts and loops as the area.

References
----------
C. Pudney, "Distance-ordered homotopic thinning: a skeletonization algorithm for 3D digital images",
Computer Vision and Image Understanding 72, 1998.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels import distance, engine, lookup
from mapdeal.kernels.arrays import Bytes, Floats, Integers, Integers32, Mask

RING = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))
"""Steps to the neighbours of a cell, anticlockwise from the next column."""
STRAIGHT, DIAGONAL = 12, 17
"""Lengths of steps: 17 / 12 is 0.2 % more than the root of 2, so lengths are never too small."""
_FAR = (1 << 32) - 1


@cache
def _tables() -> tuple[Mask, Bytes]:
    """Return for each pattern of neighbours whether a cell can go, and the neighbour count."""
    bits = (np.arange(256)[:, np.newaxis] >> np.arange(8)) & 1
    off = 1 - bits
    # Yokoi's number: into how many parts the eight neighbours would fall without this cell
    parts = sum(off[:, k] - off[:, k] * off[:, k + 1] * off[:, (k + 2) % 8] for k in (0, 2, 4, 6))
    return np.asarray(parts == 1), bits.sum(axis=1).astype(np.uint8)


def skeleton(levels: Integers, stays: Mask, is_end: Mask) -> Mask:
    # Cells of the area have a level of at least 0 and are removed by rising level. Cells of `stays`
    # remain, and cells of `is_end` where a line ends in them.
    height, width = levels.shape
    area = np.zeros((height + 2, width + 2), dtype=np.uint8)
    area[1:-1, 1:-1] = levels >= 0
    flat = area.reshape(-1)
    offsets = [row * (width + 2) + col for row, col in RING]
    can_go, count = _tables()
    ends = np.zeros(area.shape, dtype=np.bool_)
    ends[1:-1, 1:-1] = is_end
    ends = ends.reshape(-1)

    def thin(parts: list[Integers]) -> None:
        """Remove cells, also from `parts`, until no further cell can go."""
        active = [True] * 4
        while any(active):
            for k, part in enumerate(parts):
                is_active, active[k] = active[k], False
                if not (is_active and len(part)):
                    continue
                code = np.zeros(len(part), dtype=np.uint8)
                for bit, offset in enumerate(offsets):
                    code |= flat[part + offset] << np.uint8(bit)
                goes = can_go[code] & ~((count[code] <= 1) & ends[part])
                if goes.any():
                    flat[part[goes]] = 0
                    parts[k] = part[~goes]
                    active = [True] * 4

    # Cells are divided into four fields by the parity of row and column.
    # Cells of the same field are never neighbours and can go together.
    may_go = area.view(np.bool_).copy()
    may_go[1:-1, 1:-1] &= ~stays
    cells = np.flatnonzero(may_go)
    keys = 4 * levels + np.add.outer(np.arange(height) % 2 * 2, np.arange(width) % 2)
    keys = keys[may_go[1:-1, 1:-1]]
    top = int(keys.max(initial=0)) // 4 + 1
    if 4 * top < 1 << 16:  # a radix sort
        keys = keys.astype(np.uint16)
    cells = cells[np.argsort(keys, kind="stable")]
    bounds = np.append(0, np.cumsum(np.bincount(keys, minlength=4 * top))).tolist()
    groups = [cells[first:stop] for first, stop in pairwise(bounds)]
    by_level = [groups[level : level + 4] for level in range(0, 4 * top, 4)]
    for parts in by_level:
        thin(parts)
    # removals of later levels may have freed cells of earlier ones
    thin([np.concatenate(parts) for parts in zip(*by_level, strict=True)])
    return area[1:-1, 1:-1].view(np.bool_)


def lengths_from(
    is_open: Mask, sources: Integers, *, start_lengths: Integers | None = None, limit: int | None
) -> Integers32:
    """Return the length of the shortest path to each open cell, -1 without a path."""
    # Sources are flat indices. Paths start with the length of their source, 0 by default, and step
    # to eight neighbours, but not diagonally between two closed cells; see `STRAIGHT` for units.
    return _flooded(is_open, sources, start_lengths, limit, with_origin=False)[0]


def nearest_from(
    is_open: Mask, sources: Integers,
    *, start_lengths: Integers | None = None, limit: int | None = None,
) -> tuple[Integers32, Integers32]:  # fmt: skip
    """Return the lengths of `lengths_from`, and the index of the nearest source or -1."""
    lengths, origin = _flooded(is_open, sources, start_lengths, limit, with_origin=True)
    return lengths, origin.reshape(is_open.shape[0] + 2, -1)[1:-1, 1:-1]


def _flooded(
    is_open: Mask, sources: Integers, start_lengths: Integers | None, limit: int | None,
    *, with_origin: bool,
) -> tuple[Integers32, Integers32]:  # fmt: skip
    height, width = is_open.shape
    wide = width + 2
    openness = np.zeros((height + 2, wide), dtype=np.bool_)
    openness[1:-1, 1:-1] = is_open
    flat = openness.reshape(-1)
    lengths = np.full(len(flat), _FAR, dtype=np.uint32)
    rows, cols = np.divmod(sources, width)
    cells = (rows + 1) * wide + cols + 1
    starts = np.zeros(len(cells), dtype=np.int64) if start_lengths is None else start_lengths
    order = np.lexsort((starts, cells))
    order = order[np.diff(cells[order], prepend=-1) != 0]
    order = order[flat[cells[order]]]
    order = order[np.argsort(starts[order], kind="stable")]
    cells, starts = cells[order], starts[order]
    lengths[cells] = starts
    origin = np.full(len(flat) if with_origin else 0, -1, dtype=np.int32)
    if with_origin:
        origin[cells] = order
    most = _FAR - 1 if limit is None else limit
    if engine.engine_name() == "compiled":
        from mapdeal.kernels import _compiled

        _compiled.flood(flat.view(np.uint8), wide, cells, starts, most, lengths, origin)
    else:
        _flood(flat, wide, cells, starts, most, lengths, origin)
    return lengths.view(np.int32).reshape(height + 2, wide)[1:-1, 1:-1], origin  # _FAR reads as -1


def _flood(
    is_open: Mask, width: int, sources: Integers, starts: Integers, limit: int,
    lengths: NDArray[np.uint32], origin: Integers32,
) -> None:  # fmt: skip
    """Compute the same as flood.h, for all cells of a length at once."""
    latest = np.empty(len(lengths), dtype=np.int32)
    values, firsts = np.unique(starts, return_index=True)
    parts_of = zip(values.tolist(), np.split(sources, firsts)[1:], strict=True)
    waiting: dict[int, list[Integers]] = {value: [cells] for value, cells in parts_of}
    length = 0
    while waiting:
        if length in waiting:
            parts = waiting.pop(length)
            now = np.concatenate(parts) if len(parts) > 1 else parts[0]
            now = now[lengths[now] == length]
            if len(parts) > 1:  # drop repeated cells
                number = np.arange(len(now), dtype=np.int32)
                latest[now] = number
                now = now[latest[now] == number]
            for row, col in RING:
                following = length + (DIAGONAL if row and col else STRAIGHT)
                if following > limit:
                    continue
                there = now + (row * width + col)
                better = is_open[there] & (lengths[there] > following)
                if row and col:
                    better &= is_open[now + row * width] | is_open[now + col]
                to = there[better]
                if len(to):
                    lengths[to] = following
                    if len(origin):
                        origin[to] = origin[now[better]]
                    waiting.setdefault(following, []).append(to)
        length += 1


def largest_of_blocks(values: NDArray[Any], step: int) -> NDArray[Any]:
    return values if step == 1 else np.ascontiguousarray(lookup.pooled(values, step, np.maximum))


def flat_cells(places: Floats, shape: tuple[int, ...], step: int = 1) -> Integers:
    """Return flat indices of the blocks of `step` x `step` cells that hold places."""
    cells = np.floor(places / step).astype(np.int64)
    return cells[:, 0] * -(-shape[1] // step) + cells[:, 1]


def far_from(is_open: Mask, places: Floats, limit: int) -> Mask:
    """Return open cells to which the paths from all places are longer than a limit."""
    # First over blocks of open cells, which are fewer: an upper bound for all cells of a block.
    step: int = max(1, min(limit // (15 * STRAIGHT), max(is_open.shape)))
    open_blocks = largest_of_blocks((~is_open).view(np.uint8), step) == 0
    rough = lengths_from(open_blocks, flat_cells(places, is_open.shape, step), limit=limit // step)
    most = rough.astype(np.int64) * step + 3 * step * STRAIGHT
    is_near = (rough >= 0) & (most <= limit)
    height, width = is_open.shape
    is_proven = is_near.repeat(step, axis=0)[:height].repeat(step, axis=1)[:, :width]
    unproven = is_open & ~is_proven
    if not unproven.any():
        return unproven
    around = distance.dilate_square(unproven, 1) & is_open
    rows, cols = np.nonzero(around & is_proven)
    sources = np.concatenate([flat_cells(places, is_open.shape), rows * width + cols])
    starts = np.concatenate([np.zeros(len(places), np.int64), most[rows // step, cols // step]])
    return unproven & (lengths_from(around, sources, start_lengths=starts, limit=limit) < 0)


class Neighbours(NamedTuple):
    firsts: Integers  # nodes
    seconds: Integers
    lengths: Integers


def neighbouring(lengths: Integers32, origin: Integers32, cells: Integers) -> Neighbours:
    """Return pairs of nodes with touching areas, and the shortest lengths over their borders."""
    # Of several nodes in a cell only the first has an area.
    order = np.argsort(cells, kind="stable")
    same = np.flatnonzero(np.diff(cells[order]) == 0)
    pairs = [np.stack([order[same], order[same + 1]])]
    totals = [np.zeros(len(same), dtype=np.int64)]
    for here, there in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1, :], np.s_[1:, :])):
        ends = np.stack([origin[here], origin[there]])
        at = np.nonzero((ends[0] != ends[1]) & (ends >= 0).all(axis=0))
        pairs.append(ends[:, at[0], at[1]].astype(np.int64))
        totals.append(lengths[here][at].astype(np.int64) + lengths[there][at] + STRAIGHT)
    both, total = np.concatenate(pairs, axis=1), np.concatenate(totals)
    keys = both.min(axis=0) * len(cells) + both.max(axis=0)
    order = np.argsort(keys)
    firsts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    least = np.minimum.reduceat(total[order], firsts) if len(firsts) else total
    first, second = np.divmod(keys[order[firsts]], len(cells))
    return Neighbours(first, second, least)
