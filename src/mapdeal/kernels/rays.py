"""Rays from a sensor's cell to another, and the evidence that they leave on their way.

A ray passes the cells of costmap_2d's line between both ends (`mapdeal.kernels.polygons`), the
first included, the last not: that is where it hits, or where it stops. Ends may lie outside of the
grid; what lies inside is then the same as it would be on a larger one.

Work is shared out by rows: each thread follows all rays, but only through its own rows, so that
beams come to every cell in their order, and nothing depends on the number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels import rays_numpy as ray_twin
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.threads import in_parallel, thread_count

Cells = NDArray[np.int64]
Counts = NDArray[np.int32]

DISTANCE_UNIT = ray_twin.DISTANCE_UNIT
"""What `measure_rays` adds for a distance of one truncation: sums of whole numbers are exact."""

SEEN, A_HIT, MOST_HITS = ray_twin.SEEN, ray_twin.A_HIT, ray_twin.MOST_HITS
"""What `weigh_rays` notes of cells beside their values: hits are counted up to a few."""

_PARTS_PER_THREAD = 2
"""Each part of the rows costs another look at every beam."""


class Odds(NamedTuple):
    """What beams add to a cell's value, and between what it is kept."""

    on_miss: int
    on_hit: int
    lowest: int
    highest: int


def count_rays(
    starts: Cells, ends: Cells, is_hit: NDArray[np.bool_], hits: Counts, misses: Counts
) -> None:
    starts, ends = _contiguous(starts, ends)
    if engine_name() != "compiled":
        ray_twin.count_rays(starts, ends, is_hit, hits, misses)
        return
    from mapdeal.kernels import _rays

    def work(bottom: int, top: int) -> None:
        _rays.count(starts, ends, is_hit.view(np.uint8), hits, misses, bottom, top)

    _by_rows(work, hits.shape[0])


def weigh_rays(
    starts: Cells,
    ends: Cells,
    is_hit: NDArray[np.bool_],
    odds: Odds,
    values: Counts,
    seen: NDArray[np.uint8],
) -> None:
    """Add to cells, in place, what each ray says of them, clamping after each."""
    starts, ends = _contiguous(starts, ends)
    if engine_name() != "compiled":
        ray_twin.weigh_rays(starts, ends, is_hit, odds, values, seen)
        return
    from mapdeal.kernels import _rays

    def work(bottom: int, top: int) -> None:
        _rays.weigh(starts, ends, is_hit.view(np.uint8), *odds, values, seen, bottom, top)

    _by_rows(work, values.shape[0])


def measure_rays(
    starts: Cells,
    ends: Cells,
    sensors_rowcol: NDArray[np.float64],
    ranges: NDArray[np.float64],
    truncation: float,
    behind: float,
    sums: NDArray[np.int64] | NDArray[np.float64],
    weights: Counts,
    cell: float = 1.0,
) -> None:
    """Add to cells, in place, their signed distances to what rays hit."""
    starts, ends = _contiguous(starts, ends)
    sensors_rowcol = np.ascontiguousarray(sensors_rowcol)
    ranges = np.ascontiguousarray(ranges)
    if engine_name() != "compiled":
        ray_twin.measure_rays(
            starts, ends, sensors_rowcol, ranges, truncation, behind, sums, weights, cell
        )
        return
    from mapdeal.kernels import _rays

    def work(bottom: int, top: int) -> None:
        _rays.measure(
            starts, ends, sensors_rowcol, ranges, truncation, behind, cell, sums, weights,
            bottom, top,
        )  # fmt: skip

    _by_rows(work, sums.shape[0])


def _contiguous(starts: Cells, ends: Cells) -> tuple[Cells, Cells]:
    return np.ascontiguousarray(starts), np.ascontiguousarray(ends)


def _by_rows(work: object, height: int) -> None:
    parts = min(height, 1 if thread_count() == 1 else _PARTS_PER_THREAD * thread_count())

    def some(first: int, end: int) -> None:
        for k in range(first, end):
            work(height * k // parts, height * (k + 1) // parts)  # type: ignore[operator]

    in_parallel(some, parts)
