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
    """Return the table's entry for each value.

    Parameters
    ----------
    values : numpy.ndarray of uint8 or int8, shape (H, W)
        A negative value counts from the table's end, so -1 reads the last entry.
    table : numpy.ndarray of uint8 or int8, shape (256,)
        The result for each value.

    Returns
    -------
    numpy.ndarray of the table's type, shape (H, W)

    Examples
    --------
    >>> table = np.zeros(256, dtype=np.uint8)
    >>> table[[0, 100, -1]] = [254, 1, 205]
    >>> look_up(np.array([[0, 100, -1, 50]], dtype=np.int8), table)
    array([[254,   1, 205,   0]], dtype=uint8)
    """
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
    """Set the values that a mask marks, in place.

    Examples
    --------
    >>> values = np.array([[0, -1, 50]], dtype=np.int8)
    >>> set_where(values, np.array([[True, False, True]]), 100)
    >>> values
    array([[100,  -1, 100]], dtype=int8)
    """
    for_rows(lambda rows: np.copyto(values[rows], value, where=mask[rows]), values.shape)


def raise_bytes(
    costs: NDArray[np.uint8], asked: NDArray[np.uint8], *, least: int, unknown: int
) -> None:
    """Raise costs, in place, to those that are asked for.

    Parameters
    ----------
    costs, asked : numpy.ndarray of uint8, shape (H, W)
        The costs; the larger of both is kept.
    least : int
        The cost from which on an unknown cell takes what is asked for.
    unknown : int
        The cost of unknown cells: 255, the largest.

    Examples
    --------
    >>> costs = np.array([[0, 255, 255, 9]], dtype=np.uint8)
    >>> raise_bytes(
    ...     costs, np.array([[5, 100, 253, 7]], dtype=np.uint8), least=253, unknown=255
    ... )
    >>> costs
    array([[  5, 255, 253,   9]], dtype=uint8)
    """
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
    """Return the levels of distances on an even scale, on the side of zero where the cell is.

    Parameters
    ----------
    distance : numpy.ndarray of float32, shape (H, W)
        Distances, none of which is nan.
    obstacles, unknown : numpy.ndarray of bool, shape (H, W)
        Cells that get a level below `below`, whatever rounding says, while others get one from
        there on; and cells whose level is raised by `faded_by`.
    low, factor : float
        In float32, the level of a distance is ``(distance - low) * factor``, without its fraction.
    levels : int
        How many there are. What is beyond either end gets the level there.
    first : int
        The lowest level.

    Returns
    -------
    numpy.ndarray of uint8, shape (H, W)
    """
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
    """Return how often each value occurs, shape (256,); negative ones count from the end.

    Examples
    --------
    >>> histogram(np.array([[0, 7, -1, 7]], dtype=np.int8))[[0, 7, -1]]
    array([1, 2, 1])
    """
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
    """Return the squared distances in cells that a field's distances stand for.

    Parameters
    ----------
    distance : numpy.ndarray of float32, shape (H, W)
        ``gain * (d - shift)`` with d the metres between the centres of cells.
    obstacles : numpy.ndarray of bool, shape (H, W)
        The cells that the distances are to.
    scale : float
        Side of a cell, metres.
    shift, gain : float
        What the distances were made with.
    clip : float
        Metres, before `gain`, from which on distances were clipped.

    Returns
    -------
    numpy.ndarray of float64, shape (H, W)
        Whole numbers; 0 on obstacles, +inf where the clip has hidden the distance.
    """
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
    """Return what a table says of the squares that `squares_of_distances` gives.

    Parameters
    ----------
    distance, obstacles, scale, shift, gain, clip
        As for `squares_of_distances`.
    table : numpy.ndarray of uint8, shape (N,)
        The result for the squares 0 .. N - 2, and for all larger ones.

    Returns
    -------
    numpy.ndarray of uint8, shape (H, W)

    Examples
    --------
    >>> bytes_of_distances(
    ...     np.array([[0.0, 0.5, 1.0, 1.5]], dtype=np.float32),
    ...     np.array([[True, False, False, False]]),
    ...     np.array([99, 80, 70, 60, 50, 0], dtype=np.uint8),
    ...     scale=0.5, shift=0.0, gain=1.0, clip=np.inf,
    ... )
    array([[99, 80, 50,  0]], dtype=uint8)
    """
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
