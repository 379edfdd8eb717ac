"""What a distance field says of the distance between cell centres, whatever its convention."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.field import DistanceField
from mapdeal.kernels.lookup import bytes_of_distances, squares_of_distances
from mapdeal.kernels.threads import for_rows

_LARGEST_TABLE = 1 << 22
_CLIP_TOLERANCE = 2.0**-23
"""Relative: distances are float32, the clip is not."""


def squares_in(
    field: DistanceField, obstacles: NDArray[np.bool_], rows: slice = slice(None)
) -> NDArray[np.float64]:
    """Return the squared distance to the nearest obstacle centre, in cells."""
    # Undoes convention and strength, then rounds: distances between cell centres are square roots
    # of whole numbers n of cells. A float32 is off by 2**-24 of its value at most, so its square by
    # n * 2**-23, which is less than one half, and so exact, below n = 2**22: 2048 cells. Beyond,
    # the result is within one part in 2**22.
    return squares_of_distances(field.distance[rows], obstacles[rows], **_measure(field))


def bytes_in(
    field: DistanceField, obstacles: NDArray[np.bool_], table: NDArray[np.uint8]
) -> NDArray[np.uint8]:  # fmt: skip
    """Return a table's entry for each cell's square, the last one for all beyond."""
    # Takes what `squares_in` takes, and gives what indexing with its result would.
    return bytes_of_distances(field.distance, obstacles, table, **_measure(field))


def bytes_of_metres(
    field: DistanceField,
    obstacles: NDArray[np.bool_],
    value_of: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    *,
    constant_from: float,
    shape: tuple[int, int],
) -> NDArray[np.int8]:
    """Return a function's values of each cell's distance between centres."""
    furthest = furthest_kept(field)
    cells = min(constant_from, furthest, math.hypot(*shape) * field.resolution) / field.resolution
    if cells * cells < _LARGEST_TABLE:
        squares = np.arange(math.ceil(cells * cells) + 2, dtype=np.float64)
        squares[-1] = math.inf
        metres = np.minimum(np.sqrt(squares) * field.resolution, furthest)
        return bytes_in(field, obstacles, value_of(metres).astype(np.uint8)).view(np.int8)
    values = np.empty(field.shape, dtype=np.int8)

    def part(rows: slice) -> None:
        metres = np.sqrt(squares_in(field, obstacles, rows)) * field.resolution
        values[rows] = value_of(np.minimum(metres, furthest))

    for_rows(part, field.shape)
    return values


def largest_distance_in(field: DistanceField, obstacles: NDArray[np.bool_]) -> float:
    """Return the largest distance between centres, in metres, as far as the field has kept it."""
    squares: list[float] = []
    for_rows(lambda rows: squares.append(squares_in(field, obstacles, rows).max()), field.shape)
    return min(math.sqrt(max(squares)) * field.resolution, furthest_kept(field))


def deepest_in(field: DistanceField, obstacles: NDArray[np.bool_]) -> float:
    """Return the metres from the centre of the deepest obstacle cell to the nearest free one's."""
    depth = -float(field.distance.min(where=obstacles, initial=math.inf))
    shift = {"fast-planner": field.resolution, "center": 0.0, "border": 0.5 * field.resolution}
    if field.max_distance is not None and depth >= field.max_distance * (1 - _CLIP_TOLERANCE):
        return shift[field.convention] + field.max_distance
    cells = max(shift[field.convention] + depth, 0.0) / field.resolution
    return math.sqrt(round(cells * cells)) * field.resolution if math.isfinite(cells) else cells


def furthest_kept(field: DistanceField) -> float:
    """Return the metres between centres beyond which the field was clipped."""
    if field.max_distance is None:
        return math.inf
    return field.max_distance + (0.5 * field.resolution if field.convention == "border" else 0.0)


def _measure(field: DistanceField) -> dict[str, Any]:
    clip = math.inf
    if field.max_distance is not None:
        clip = field.max_distance * (1 - _CLIP_TOLERANCE)
    return {
        "scale": field.resolution,
        "shift": 0.5 * field.resolution if field.convention == "border" else 0.0,
        "gain": field.strength,
        "clip": clip,
    }
