"""The distance kernels on numpy and scipy: the twin of compiled_distance.py."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.distance import (
    Halo,
    SquaredDistances,
    dtype_of_squares,
    squares_of_block,
    unreachable,
)


def squares(
    marked: NDArray[np.bool_], *, both_kinds: bool, limit: int | None
) -> SquaredDistances:  # fmt: skip
    """Return squared distances; negative on marked cells if they are of both kinds, else 0."""
    squared = _squares_to(marked)
    if both_kinds:
        np.negative(_squares_to(~marked), out=squared, where=marked)
    if limit is not None:
        endless = unreachable(squared)
        squared[squared > limit] = endless
        squared[squared < -limit] = -endless
    return squared


def bytes_of_squares(
    marked: NDArray[np.bool_], table: NDArray[np.uint8]
) -> NDArray[np.uint8]:  # fmt: skip
    """Return the table's entry for each cell's square, the last one for all beyond."""
    squared = _squares_to(marked)
    looked_up: NDArray[np.uint8] = table[np.minimum(squared, len(table) - 1)]
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
    """Return signed distances; the steps are those of `metres_of` in distance_columns.h."""
    if halo is None:
        squared = np.abs(squares(marked, both_kinds=True, limit=None))
    else:
        squared = squares_of_block(marked, halo)
    endless = squared == unreachable(squared)
    distance = np.sqrt(squared, dtype=np.float64)
    distance *= scale
    distance[endless] = math.inf
    np.subtract(inside_shift, distance, out=distance, where=marked)
    np.add(distance, outside_shift, out=distance, where=~marked)
    np.clip(distance, -clip, clip, out=distance)
    np.multiply(distance, gain, out=distance, where=~marked)
    return distance.astype(np.float32)


def _squares_to(marked: NDArray[np.bool_]) -> SquaredDistances:
    """Return squared distances to the nearest marked cell."""
    from scipy import ndimage

    height, width = marked.shape
    dtype = dtype_of_squares(marked.shape)
    if not marked.any():  # scipy would measure to a cell that is not there
        return np.full(marked.shape, np.iinfo(dtype).max, dtype=dtype)
    # scipy's distances are float64 square roots: the nearest cell's index is exact.
    nearest = ndimage.distance_transform_edt(~marked, return_distances=False, return_indices=True)
    rows, cols = nearest.astype(dtype, copy=False)
    rows -= np.arange(height, dtype=dtype)[:, np.newaxis]
    cols -= np.arange(width, dtype=dtype)
    rows *= rows
    cols *= cols
    rows += cols
    squared: SquaredDistances = rows
    return squared
