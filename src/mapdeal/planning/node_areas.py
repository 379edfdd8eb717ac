"""Areas of cells around nodes: cells far from all nodes, and neighbouring nodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.skeleton import STRAIGHT, largest_of_blocks, lengths_from

Cells = NDArray[np.int64]
Places = NDArray[np.float64]


def flat_cells(places: Places, shape: tuple[int, ...], step: int = 1) -> Cells:
    """Return flat indices of the blocks of `step` x `step` cells that hold places."""
    cells = np.floor(places / step).astype(np.int64)
    flat: Cells = cells[:, 0] * -(-shape[1] // step) + cells[:, 1]
    return flat


def far_from(is_open: NDArray[np.bool_], places: Places, limit: int) -> NDArray[np.bool_]:
    """Return open cells to which the paths from all places are longer than a limit."""
    # First over blocks of open cells, which are fewer: an upper bound for all cells of a block.
    step: int = max(1, min(limit // (15 * STRAIGHT), max(is_open.shape)))
    open_blocks = largest_of_blocks((~is_open).view(np.uint8), step) == 0
    cells = flat_cells(places, is_open.shape, step)
    rough = lengths_from(open_blocks, cells, limit=limit // step)
    most = rough.astype(np.int64) * step + 3 * step * STRAIGHT
    is_near = (rough >= 0) & (most <= limit)
    height, width = is_open.shape
    is_proven = is_near.repeat(step, axis=0)[:height].repeat(step, axis=1)[:, :width]
    unproven = is_open & ~is_proven
    if not unproven.any():
        return unproven
    around = unproven.copy()
    around[1:] |= unproven[:-1]
    around[:-1] |= unproven[1:]
    around[:, 1:] |= around[:, :-1].copy()
    around[:, :-1] |= around[:, 1:].copy()
    around &= is_open
    rows, cols = np.nonzero(around & is_proven)
    sources = np.concatenate([flat_cells(places, is_open.shape), rows * width + cols])
    known = most[rows // step, cols // step]
    starts = np.concatenate([np.zeros(len(places), np.int64), known])
    lengths = lengths_from(around, sources, start_lengths=starts, limit=limit)
    return unproven & (lengths < 0)


class Neighbours(NamedTuple):
    firsts: Cells  # nodes
    seconds: Cells
    lengths: Cells


def neighbouring(lengths: NDArray[np.int32], origin: NDArray[np.int32], cells: Cells) -> Neighbours:
    """Return pairs of nodes with touching areas, and the shortest lengths over their borders."""
    # Of several nodes in a cell only the first has an area.
    order = np.argsort(cells, kind="stable")
    same = np.flatnonzero(np.diff(cells[order]) == 0)
    pairs = [np.stack([order[same], order[same + 1]])]
    totals = [np.zeros(len(same), dtype=np.int64)]
    for here, there in (
        ((slice(None), slice(None, -1)), (slice(None), slice(1, None))),
        ((slice(None, -1), slice(None)), (slice(1, None), slice(None))),
    ):
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
