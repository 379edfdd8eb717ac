"""The distance kernels on the compiled module, in threads; scipy_distance.py is their twin."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.distance import Halo, Mask, Runs, SquaredDistances, dtype_of_squares
from mapdeal.kernels.threads import CELLS_WORTH_A_THREAD, in_parallel, use_threads

if TYPE_CHECKING:
    from mapdeal.kernels._compiled import Transform


def longest_side() -> int:
    """Return the cells of the longest side that fits; longer ones are left to the twin."""
    from mapdeal.kernels import _compiled

    return _compiled.longest_side


def squares(
    marked: NDArray[np.bool_], *, both_kinds: bool, limit: int | None
) -> SquaredDistances:  # fmt: skip
    """Return squared distances; negative on marked cells if they are of both kinds, else 0."""
    squared = np.empty(marked.shape, dtype_of_squares(marked.shape))
    transform = _transform(marked, squared, limit)
    transform.to_squares(both_kinds)
    _run(transform, squared.size)
    return squared


def bytes_of_squares(
    marked: NDArray[np.bool_], table: NDArray[np.uint8]
) -> NDArray[np.uint8]:  # fmt: skip
    """Return the table's entry for each cell's square, the last one for all beyond."""
    looked_up = np.empty(marked.shape, np.uint8)
    transform = _transform(marked, looked_up, len(table) - 2)
    transform.to_bytes(table)
    _run(transform, looked_up.size)
    return looked_up


def metres(
    marked: NDArray[np.bool_],
    *,
    scale: float,
    outside_shift: float,
    inside_shift: float,
    clip: float,
    gain: float,
    halo: Halo | None = None,
) -> NDArray[np.float32]:
    distance = np.empty(marked.shape, np.float32)
    transform = _transform(
        marked, distance, _square_beyond(clip, scale, outside_shift, inside_shift)
    )
    if halo is not None:
        transform.place(halo.height, _row_of(halo.before), _row_of(halo.after))
    transform.to_metres(scale, outside_shift, inside_shift, clip, gain)
    _run(transform, distance.size)
    return distance


def _row_of(row: tuple[Mask, Runs] | None) -> tuple[NDArray[np.uint8], Runs] | None:
    return None if row is None else (np.ascontiguousarray(row[0]).view(np.uint8), row[1])


def _square_beyond(
    clip: float, scale: float, outside_shift: float, inside_shift: float
) -> int | None:  # fmt: skip
    cells = (clip + max(abs(outside_shift), abs(inside_shift))) / scale + 1
    return math.ceil(cells * cells) if cells < longest_side() else None


def _transform(marked: NDArray[np.bool_], result: NDArray[Any], limit: int | None) -> Transform:
    from mapdeal.kernels import _compiled

    most = _compiled.unlimited if limit is None else min(limit, _compiled.unlimited)
    mask = np.ascontiguousarray(marked).view(np.uint8)
    return _compiled.Transform(mask, result.view(np.uint8), most)


def _run(transform: Transform, cells: int) -> None:
    if cells < CELLS_WORTH_A_THREAD:
        with use_threads(1):
            _run_bands(transform)
    else:
        _run_bands(transform)


def _run_bands(transform: Transform) -> None:
    in_parallel(transform.scan, transform.bands)
    transform.join()
    in_parallel(transform.solve, transform.bands)
