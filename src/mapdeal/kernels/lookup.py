"""Whole arrays through small tables, in threads: one pass, no temporary arrays of that size."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.threads import for_rows, thread_count

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


Floats = NDArray[np.float64]


def interpolate(values: NDArray[np.float32], places_rowcol: Floats) -> tuple[Floats, Floats]:
    """Return the bilinear interpolant of a grid, and its slopes, at places between cells."""
    # Beyond the outermost centres the nearest cells go on, so that the slope across the border is
    # 0. The slopes are those of the interpolant itself: they jump where a line of centres is
    # crossed.
    between = np.empty(len(places_rowcol))
    slopes = np.empty((len(places_rowcol), 2))
    if engine_name() == "compiled":
        from mapdeal.kernels import _compiled

        _compiled.interpolate(
            np.ascontiguousarray(values), np.ascontiguousarray(places_rowcol), between, slopes
        )
        return between, slopes
    height, width = values.shape
    with np.errstate(invalid="ignore"):
        near = np.all((places_rowcol >= -1) & (places_rowcol <= (height + 1, width + 1)), axis=1)
    places = np.where(near[:, np.newaxis], places_rowcol, 0.5)
    south, north, v = _corners(places[:, 0], height - 1)
    west, east, u = _corners(places[:, 1], width - 1)
    a, b = (values[south, col].astype(np.float64) for col in (west, east))
    c, d = (values[north, col].astype(np.float64) for col in (west, east))
    finite = np.isfinite(a) & np.isfinite(b) & np.isfinite(c) & np.isfinite(d)
    with np.errstate(invalid="ignore"):
        between[:] = (1.0 - v) * ((1.0 - u) * a + u * b) + v * ((1.0 - u) * c + u * d)
        slopes[:, 0] = (1.0 - u) * (c - a) + u * (d - b)
        slopes[:, 1] = (1.0 - v) * (b - a) + v * (d - c)
    nearest = values[np.where(v < 0.5, south, north), np.where(u < 0.5, west, east)]
    between[~finite] = nearest[~finite]
    slopes[~finite] = np.nan
    between[~near] = np.nan
    slopes[~near] = np.nan
    return between, slopes


def _corners(
    places: Floats, last: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:  # fmt: skip
    """Return the indices that places lie between, within the grid, and the share of the way."""
    from_centre = places - 0.5
    below = np.floor(from_centre)
    index = below.astype(np.int64)
    return np.clip(index, 0, last), np.clip(index + 1, 0, last), from_centre - below


def sum_of_inverse_distances(
    marked: NDArray[np.bool_], *, scale: float = 1.0, least: float = 0.0
) -> NDArray[np.float64]:
    """Return for each cell the sum of 1 / distance over all marked cells."""
    # The sum is the convolution of the mask with 1 / distance, taken as a product of Fourier
    # transforms: H W log(H W) steps rather than H W times the number of marked cells. 1 / distance
    # is symmetric along both axes, so that its transform is a real cosine transform of a quarter of
    # it. What rounding adds is about 1e-16 of the largest values.
    if not marked.any():
        return np.zeros(marked.shape)
    # scipy.fft takes longer to import than most maps to transform
    from scipy import fft

    workers = thread_count()
    height, width = marked.shape
    # The periods must leave room for the farthest offsets on both sides, to be apart.
    half_height, half_width = (int(fft.next_fast_len(length, real=True)) for length in marked.shape)
    rows = np.arange(half_height + 1, dtype=np.float64)[:, np.newaxis]
    inverse = np.hypot(rows, np.arange(half_width + 1, dtype=np.float64))
    inverse *= scale
    far = inverse > least  # never so for a cell and itself
    np.divide(1.0, inverse, out=inverse, where=far)
    inverse[~far] = 0.0
    try:
        response = fft.dctn(inverse, type=1, overwrite_x=True, workers=workers)
    except RuntimeError:  # no threads to be had: it has not begun
        workers = 1
        response = fft.dctn(inverse, type=1, overwrite_x=True, workers=workers)
    del inverse, far
    spectrum = fft.rfft2(
        marked.astype(np.float64), s=(2 * half_height, 2 * half_width), workers=workers
    )
    spectrum[: half_height + 1] *= response
    spectrum[half_height + 1 :] *= response[half_height - 1 : 0 : -1]
    del response  # the peak of memory is that of what follows
    total: NDArray[np.float64] = fft.irfft2(
        spectrum, s=(2 * half_height, 2 * half_width), overwrite_x=True, workers=workers
    )
    # no sum is negative; rounding may make it so, far from everything
    return np.maximum(total[:height, :width], 0.0)
