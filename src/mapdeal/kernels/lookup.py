"""Whole arrays through small tables, in threads: one pass, no temporary arrays of that size."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.threads import for_rows

Bytes = NDArray[np.uint8] | NDArray[np.int8]


def look_up(values: Bytes, table: NDArray[Any]) -> NDArray[Any]:
    source, entries = values.view(np.uint8), np.ascontiguousarray(table).view(np.uint8)
    if entries.shape != (256,):
        raise ValueError("the table must have 256 entries of one byte")
    result = np.empty(values.shape, dtype=np.uint8)
    # a view with gaps within its rows is left to numpy
    if engine_name() == "compiled" and source.strides[1] == 1:
        from mapdeal.kernels import _compiled

        def part(rows: slice) -> None:
            _compiled.look_up(source[rows], entries, result[rows])
    else:

        def part(rows: slice) -> None:
            result[rows] = entries[source[rows]]

    for_rows(part, values.shape)
    return result.view(table.dtype)


def set_where(values: Bytes, mask: NDArray[np.bool_], value: int) -> None:
    for_rows(lambda rows: np.copyto(values[rows], value, where=mask[rows]), values.shape)


def raise_bytes(
    costs: NDArray[np.uint8], asked: NDArray[np.uint8], *, least: int, unknown: int
) -> None:
    is_compiled = engine_name() == "compiled" and unknown == np.iinfo(np.uint8).max
    is_compiled = is_compiled and costs.flags.c_contiguous and asked.flags.c_contiguous

    def raise_rows(rows: slice) -> None:
        before, wanted = costs[rows], asked[rows]
        if is_compiled:
            from mapdeal.kernels import _compiled

            _compiled.raise_costs(before, wanted, least)
            return
        overwritten = before == unknown
        overwritten &= wanted >= least
        np.maximum(before, wanted, out=before)
        np.copyto(before, wanted, where=overwritten)

    for_rows(raise_rows, costs.shape)


def level_rows(
    distance: NDArray[np.float32],
    obstacles: NDArray[np.bool_],
    unknown: NDArray[np.bool_],
    *,
    low: float,
    factor: float,
    levels: int,
    first: int,
    below: int,
    faded_by: int,
) -> NDArray[np.uint8]:
    """Return the levels of distances on an even scale, on the side of zero where the cell is."""
    result = np.empty(distance.shape, dtype=np.uint8)
    compiled = engine_name() == "compiled"

    def part(rows: slice) -> None:
        if compiled:
            from mapdeal.kernels import _compiled

            layers = (distance[rows], obstacles[rows], unknown[rows])
            metres, inner, faded = map(np.ascontiguousarray, layers)
            _compiled.levels(
                metres, inner.view(np.uint8), faded.view(np.uint8), result[rows],
                low, factor, levels - 1, first, below, faded_by,
            )  # fmt: skip
            return
        steps = (distance[rows] - np.float32(low)) * np.float32(factor)
        level = np.clip(steps, 0, levels - 1).astype(np.uint8)
        level += np.uint8(first)
        inside = np.minimum(level, np.uint8(below - 1))
        np.maximum(level, np.uint8(below), out=level)
        np.copyto(level, inside, where=obstacles[rows])
        result[rows] = level + np.uint8(faded_by) * unknown[rows].view(np.uint8)

    for_rows(part, distance.shape)
    return result


def histogram(values: Bytes) -> NDArray[np.int64]:
    """Return how often each value occurs, shape (256,); negative ones count from the end."""
    source = np.ascontiguousarray(values).view(np.uint8)
    parts: list[NDArray[np.int64]] = []
    compiled = engine_name() == "compiled"

    def part(rows: slice) -> None:
        if compiled:
            from mapdeal.kernels import _compiled

            counts = np.zeros(256, dtype=np.int64)
            _compiled.count_bytes(source[rows], counts)
            parts.append(counts)
        else:
            parts.append(np.bincount(source[rows].ravel(), minlength=256))

    for_rows(part, values.shape)
    return sum(parts, start=np.zeros(256, dtype=np.int64))


def squares_of_distances(
    distance: NDArray[np.float32],
    obstacles: NDArray[np.bool_],
    *,
    scale: float,
    shift: float,
    gain: float,
    clip: float,
) -> NDArray[np.float64]:
    """Return the squared distances in cells that a field's distances stand for."""
    metres = distance.astype(np.float64)
    metres /= gain
    clipped = metres >= clip
    metres += shift
    metres /= scale
    metres *= metres
    np.rint(metres, out=metres)
    metres[clipped] = math.inf
    metres[obstacles] = 0.0
    return metres


def bytes_of_distances(
    distance: NDArray[np.float32],
    obstacles: NDArray[np.bool_],
    table: NDArray[np.uint8],
    *,
    scale: float,
    shift: float,
    gain: float,
    clip: float,
) -> NDArray[np.uint8]:
    """Return what a table says of the squares that `squares_of_distances` gives."""
    result = np.empty(distance.shape, dtype=np.uint8)
    if engine_name() == "compiled":
        from mapdeal.kernels import _compiled

        source, mask = np.ascontiguousarray(distance), np.ascontiguousarray(obstacles)
        table = np.ascontiguousarray(table)

        def part(rows: slice) -> None:
            _compiled.bytes_of_distances(
                source[rows], mask[rows].view(np.uint8), table, result[rows],
                scale, shift, gain, clip,
            )  # fmt: skip
    else:

        def part(rows: slice) -> None:
            squares = squares_of_distances(
                distance[rows], obstacles[rows], scale=scale, shift=shift, gain=gain, clip=clip
            )
            np.minimum(squares, len(table) - 1, out=squares)
            result[rows] = table[squares.astype(np.intp)]

    for_rows(part, distance.shape)
    return result
