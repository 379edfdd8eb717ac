"""Values of cells: by table, between centres, and under the cells of another lattice.

All functions run in threads, in one pass, without temporary arrays of the size of the grid.
"""

from __future__ import annotations

import math
from contextlib import suppress
from itertools import product

import numpy as np

from mapdeal.kernels.arrays import Array, Bytes, Floats, Integers, Mask, Metres, SignedBytes
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.threads import for_rows, thread_count
from mapdeal.records import dataclass

with suppress(ImportError):  # then `engine_name` is never compiled
    from mapdeal.kernels import _compiled

EitherBytes = Bytes | SignedBytes
TOUCHING = 1e-6  # in sides of the larger cell: exact borders coincide
_LARGEST_GATHERED = 2.0  # up to this side each cell checks all that it may overlap
_CELLS_TOGETHER = 1 << 16


def look_up(values: EitherBytes, table: Array) -> Array:
    source, entries = values.view(np.uint8), np.ascontiguousarray(table).view(np.uint8)
    result = np.empty(values.shape, dtype=np.uint8)
    # numpy handles views with gaps within rows
    compiled = engine_name() == "compiled" and source.strides[1] == 1

    def part(rows: slice) -> None:
        if compiled:
            _compiled.look_up(source[rows], entries, result[rows])
        else:
            result[rows] = entries[source[rows]]

    for_rows(part, values.shape)
    return result.view(table.dtype)


def set_where(values: EitherBytes, mask: Mask, value: int) -> None:
    for_rows(lambda rows: np.copyto(values[rows], value, where=mask[rows]), values.shape)


def raise_bytes(costs: Bytes, requested: Bytes, *, least: int, unknown: int) -> None:
    is_compiled = engine_name() == "compiled" and unknown == np.iinfo(np.uint8).max
    is_compiled = is_compiled and costs.flags.c_contiguous and requested.flags.c_contiguous

    def raise_rows(rows: slice) -> None:
        current, raised = costs[rows], requested[rows]
        if is_compiled:
            _compiled.raise_costs(current, raised, least)
            return
        overwritten = current == unknown
        overwritten &= raised >= least
        np.maximum(current, raised, out=current)
        np.copyto(current, raised, where=overwritten)

    for_rows(raise_rows, costs.shape)


def level_rows(
    distance: Metres, obstacles: Mask, unknown: Mask,
    *, low: float, factor: float, levels: int, first: int, below: int, faded_by: int,
) -> Bytes:  # fmt: skip
    """Return the levels of distances on an even scale; obstacles get levels under `below`."""
    result = np.empty(distance.shape, dtype=np.uint8)
    compiled = engine_name() == "compiled"

    def part(rows: slice) -> None:
        if compiled:
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


def histogram(values: EitherBytes) -> Integers:
    """Return how often each value occurs, shape (256,); index -1 is 255."""
    source = np.ascontiguousarray(values).view(np.uint8)
    parts: list[Integers] = []
    compiled = engine_name() == "compiled"

    def part(rows: slice) -> None:
        if compiled:
            counts = np.zeros(256, dtype=np.int64)
            _compiled.count_bytes(source[rows], counts)
            parts.append(counts)
        else:
            parts.append(np.bincount(source[rows].ravel(), minlength=256))

    for_rows(part, values.shape)
    return sum(parts, start=np.zeros(256, dtype=np.int64))


def pooled(cells: Array, step: int, choose: np.ufunc) -> Array:
    """Return one value per square of `step` x `step` cells; squares at the end may be smaller."""
    return _pooled_rows(_pooled_rows(cells, step, choose).T, step, choose).T


def _pooled_rows(cells: Array, step: int, choose: np.ufunc) -> Array:
    merged = cells[::step].copy(order="K")  # of a transposed array, too
    for k in range(1, step):
        more = cells[k::step]
        choose(merged[: len(more)], more, out=merged[: len(more)])
    return merged


def squares_of_distances(
    distance: Metres, obstacles: Mask, *, scale: float, shift: float, gain: float, clip: float
) -> Floats:
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
    distance: Metres, obstacles: Mask, table: Bytes,
    *, scale: float, shift: float, gain: float, clip: float,
) -> Bytes:  # fmt: skip
    """Return the table entries of the squares from `squares_of_distances`."""
    result = np.empty(distance.shape, dtype=np.uint8)
    compiled = engine_name() == "compiled"
    distance, obstacles = np.ascontiguousarray(distance), np.ascontiguousarray(obstacles)
    table = np.ascontiguousarray(table)

    def part(rows: slice) -> None:
        if compiled:
            _compiled.bytes_of_distances(
                distance[rows], obstacles[rows].view(np.uint8), table, result[rows],
                scale, shift, gain, clip,
            )  # fmt: skip
            return
        squares = squares_of_distances(
            distance[rows], obstacles[rows], scale=scale, shift=shift, gain=gain, clip=clip
        )
        np.minimum(squares, len(table) - 1, out=squares)
        result[rows] = table[squares.astype(np.intp)]

    for_rows(part, distance.shape)
    return result


def interpolate(values: Metres, places_rowcol: Floats) -> tuple[Floats, Floats]:
    # Beyond the outermost centres the border cells are repeated: the slope across the border is 0.
    # The slopes are those of the interpolant itself, and jump at the lines of centres.
    between, slopes = np.empty(len(places_rowcol)), np.empty((len(places_rowcol), 2))
    if engine_name() == "compiled":
        values, places_rowcol = map(np.ascontiguousarray, (values, places_rowcol))
        _compiled.interpolate(values, places_rowcol, between, slopes)
        return between, slopes
    height, width = values.shape
    with np.errstate(invalid="ignore"):
        near = np.all((places_rowcol >= -1) & (places_rowcol <= (height + 1, width + 1)), axis=1)
    places = np.where(near[:, np.newaxis], places_rowcol, 0.5)
    south, north, v = _corners(places[:, 0], height - 1)
    west, east, u = _corners(places[:, 1], width - 1)
    around = [values[row, col] for row in (south, north) for col in (west, east)]
    a, b, c, d = corners = np.stack(around).astype(np.float64)
    finite = np.isfinite(corners).all(axis=0)
    with np.errstate(invalid="ignore"):
        between[:] = (1.0 - v) * ((1.0 - u) * a + u * b) + v * ((1.0 - u) * c + u * d)
        slopes[:, 0] = (1.0 - u) * (c - a) + u * (d - b)
        slopes[:, 1] = (1.0 - v) * (b - a) + v * (d - c)
    nearest = values[np.where(v < 0.5, south, north), np.where(u < 0.5, west, east)]
    between[~finite] = nearest[~finite]
    between[~near] = np.nan
    slopes[~(finite & near)] = np.nan
    return between, slopes


def _corners(places: Floats, last: int) -> tuple[Integers, Integers, Floats]:
    """Return the indices around places, clipped to the grid, and the share from low to high."""
    from_centre = places - 0.5
    below = np.floor(from_centre)
    index = below.astype(np.int64)
    return np.clip(index, 0, last), np.clip(index + 1, 0, last), from_centre - below


def places_along(
    starts: Floats, ends: Floats, counts: Integers
) -> tuple[Floats, Integers, Integers]:
    """Return places spread over lines, shape (M, 2), the line of each, and the first of each."""
    firsts = np.cumsum(counts) - counts
    lines = np.repeat(np.arange(len(counts)), counts)
    shares = (np.arange(len(lines)) - firsts[lines]) / np.maximum(counts - 1, 1)[lines]
    return starts[lines] + shares[:, np.newaxis] * (ends - starts)[lines], lines, firsts


def least_along(
    values: Integers, is_open: Mask, starts: Floats, ends: Floats, counts: Integers, *, near: float
) -> tuple[Integers, Mask]:
    """Return the least value of the cells on each line, and whether all of them are open."""
    # Lines connect places within the grid, continuous rows and columns of shape (N, 2), and are
    # sampled evenly at `counts` places each. A place within `near` of an edge of its cell is open
    # only if the cell beyond that edge is open, too.
    if engine_name() == "compiled" and values.dtype == np.int32:
        least, found = np.empty(len(counts), np.int64), np.empty(len(counts), np.uint8)
        opened = is_open.view(np.uint8)
        _compiled.look_along_lines(values, opened, starts, ends, counts, near, least, found)
        return least, found.view(np.bool_)
    places, _, firsts = places_along(starts, ends, counts)
    rows, cols = places.astype(np.int64).T
    free = is_open[rows, cols]
    is_near = (np.abs(places - np.floor(places) - 0.5) > 0.5 - near).any(axis=1)
    edges = np.flatnonzero(free & is_near)
    low, high = (np.clip(places[edges] + by, 0, np.array(values.shape) - 1).astype(np.int64)
                 for by in (-near, near))  # fmt: skip
    for by_row, by_col in product((low, high), repeat=2):
        free[edges] &= is_open[by_row[:, 0], by_col[:, 1]]
    least = np.minimum.reduceat(values[rows, cols], firsts).astype(np.int64)
    return least, np.logical_and.reduceat(free, firsts)


def sum_of_inverse_distances(marked: Mask, *, scale: float = 1.0, least: float = 0.0) -> Floats:
    # The sum is the convolution of the mask with 1 / distance, computed as a product of Fourier
    # transforms: H W log(H W) steps instead of H W times the number of marked cells. 1 / distance
    # is symmetric along both axes, so its transform is a real cosine transform of one quarter.
    # Rounding errors are about 1e-16 of the largest values.
    if not marked.any():
        return np.zeros(marked.shape)
    # imported here: this takes longer than the transform of most maps
    from scipy import fft

    workers = thread_count()
    height, width = marked.shape
    # Periods must be long enough to separate the farthest offsets on both sides.
    half_height, half_width = (int(fft.next_fast_len(length, real=True)) for length in marked.shape)
    rows = np.arange(half_height + 1, dtype=np.float64)[:, np.newaxis]
    inverse = np.hypot(rows, np.arange(half_width + 1, dtype=np.float64))
    inverse *= scale
    far = inverse > least  # False for the offset 0
    np.divide(1.0, inverse, out=inverse, where=far)
    inverse[~far] = 0.0
    try:
        response = fft.dctn(inverse, type=1, overwrite_x=True, workers=workers)
    except RuntimeError:  # the system refused threads before the transform began
        workers = 1
        response = fft.dctn(inverse, type=1, overwrite_x=True, workers=workers)
    del inverse, far
    periods = (2 * half_height, 2 * half_width)
    spectrum = fft.rfft2(marked.astype(np.float64), s=periods, workers=workers)
    spectrum[: half_height + 1] *= response
    spectrum[half_height + 1 :] *= response[half_height - 1 : 0 : -1]
    del response  # the next call uses the most memory
    total: Floats = fft.irfft2(spectrum, s=periods, overwrite_x=True, workers=workers)
    # far from marked cells rounding may make sums negative
    return np.maximum(total[:height, :width], 0.0)


@dataclass(frozen=True)
class Lattice:
    """Position of the requested cells, which may be turned, among the cells of an array."""

    # The array's own cells have side 1; its coordinates are rows and columns with fractions.

    row: float
    col: float
    side: float
    turn: float = 0.0
    slack: float = 1e-9

    @property
    def wide(self) -> float:
        """Extent of a turned square along the axes, in its sides."""
        return abs(math.cos(self.turn)) + abs(math.sin(self.turn))

    @property
    def touching(self) -> float:
        """Overlap up to which cells only touch, in cells of the array."""
        return min(TOUCHING * max(1.0, self.side), self.side / 4)

    def centres(self, rows: slice, width: int) -> tuple[Floats, Floats]:
        """Return rows and columns, with fractions, of the centres of some rows of cells."""
        i = (np.arange(rows.start, rows.stop)[:, np.newaxis] + 0.5) * self.side
        j = (np.arange(width) + 0.5) * self.side
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        return (i * cos + self.row) + j * sin, (self.col - i * sin) + j * cos

    def edges(self, first: float, count: int, size: int) -> tuple[Integers, Integers]:
        """Return the array's cells along one axis, first and end, under each untilted cell."""
        steps = first + self.side * np.arange(count + 1)
        low = np.clip(np.floor(steps[:-1] + self.touching), 0, size).astype(np.int64)
        high = np.clip(np.ceil(steps[1:] - self.touching), 0, size).astype(np.int64)
        return low, high


def largest_under(values: Bytes, shape: tuple[int, int], lattice: Lattice) -> Bytes:
    found = np.zeros(shape, dtype=np.uint8)
    if 0 in values.shape or 0 in shape or not values.any():
        return found
    if lattice.turn == 0.0:
        _reduce_ranges(found, values, lattice)
    elif lattice.side <= _LARGEST_GATHERED:
        _gather(found, values, lattice)
    else:
        _scatter(found, values, lattice)
    return found


def nearest_under(values: Bytes, shape: tuple[int, int], lattice: Lattice) -> tuple[Bytes, Mask]:
    found, inside = np.zeros(shape, dtype=np.uint8), np.zeros(shape, dtype=np.bool_)
    height, width = values.shape
    flat = np.ascontiguousarray(values).reshape(-1)

    def look(part: slice) -> None:
        y, x = lattice.centres(part, shape[1])
        for places in (y, x):
            places += lattice.slack
            np.floor(places, out=places)
        within = inside[part]
        np.logical_and(y >= 0, y < height, out=within)
        within &= (x >= 0) & (x < width)
        y *= width
        y += x
        found[part][within] = flat[y[within].astype(np.intp)]

    for_rows(look, shape)
    return found, inside


def _reduce_ranges(found: Bytes, values: Bytes, lattice: Lattice) -> None:
    """Set the largest values in ranges of rows and columns, for a lattice along the axes."""
    low, high = lattice.edges(lattice.row, found.shape[0], values.shape[0])
    low_col, high_col = lattice.edges(lattice.col, found.shape[1], values.shape[1])
    cols = np.flatnonzero(low_col < high_col)
    if not len(cols):
        return

    def look(part: slice) -> None:
        rows = part.start + np.flatnonzero(low[part] < high[part])
        if len(rows):
            lines = _largest_of_ranges(values, low[rows], high[rows])
            across = _largest_of_ranges(lines.T, low_col[cols], high_col[cols])
            found[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1] = across.T

    for_rows(look, found.shape)


def _largest_of_ranges(lines: Bytes, first: Integers, end: Integers) -> Bytes:
    found = lines[first]
    for step in range(1, int((end - first).max())):
        np.maximum(found, lines[np.minimum(first + step, end - 1)], out=found)
    return found


def _gather(found: Bytes, values: Bytes, lattice: Lattice) -> None:
    """Set the largest values by checking all cells that a cell of the lattice may overlap."""
    # Most cells need no check: the cell under their centre has the largest value around.
    height, width = values.shape
    reach = math.ceil(1 + lattice.side / 2 * lattice.wide) - 1
    rim = 2 * reach + 1
    around = np.zeros((height + 2 * rim, width + 2 * rim), dtype=np.uint8)
    around[rim:-rim, rim:-rim] = values
    peaks = _largest_around(around, reach)
    stride = around.shape[1]
    flat, flat_peaks = around.ravel(), peaks.ravel()
    steps = [step for step in product(range(-reach, reach + 1), repeat=2) if step != (0, 0)]

    def look(part: slice) -> None:
        y, x = lattice.centres(part, found.shape[1])
        row = np.floor(np.clip(y, -reach - 1, height + reach))
        col = np.floor(np.clip(x, -reach - 1, width + reach))
        place = ((row + rim) * stride + (col + rim)).astype(np.intp).ravel()
        own = flat[place]
        which = np.flatnonzero(flat_peaks[place] > own)
        if len(which):
            place = place[which]
            x_off, y_off = ((at - cell).ravel()[which] - 0.5 for at, cell in ((x, col), (y, row)))
            best = own[which]
            for down, right in steps:
                value = flat[place + (down * stride + right)]
                more = np.flatnonzero(value > best)
                more = more[_overlap(right - x_off[more], down - y_off[more], lattice)]
                best[more] = value[more]
            own[which] = best
        found[part] = own.reshape(-1, found.shape[1])

    for_rows(look, found.shape)


def _largest_around(values: Bytes, reach: int) -> Bytes:
    for _ in range(2):  # across the columns, then across the rows
        values, before = values.T.copy(), values.T
        for step in range(1, reach + 1):
            np.maximum(values[step:], before[:-step], out=values[step:])
            np.maximum(values[:-step], before[step:], out=values[:-step])
    return values


def _overlap(right: Floats, up: Floats, lattice: Lattice) -> Mask:
    """Return which cells of the array overlap a cell of the lattice, given their distance."""
    # Two squares overlap unless a line along one of their sides separates them.
    cos, sin = math.cos(lattice.turn), math.sin(lattice.turn)
    along = 0.5 + lattice.side / 2 * lattice.wide - lattice.touching
    across = lattice.side / 2 + 0.5 * lattice.wide - lattice.touching
    overlap: Mask = (np.abs(right) < along) & (np.abs(up) < along)
    overlap &= np.abs(right * cos + up * sin) < across
    overlap &= np.abs(up * cos - right * sin) < across
    return overlap


def _scatter(found: Bytes, values: Bytes, lattice: Lattice) -> None:
    """Set the largest values by adding each small cell to the large cells that it overlaps."""
    height, width = found.shape
    cos, sin = math.cos(lattice.turn), math.sin(lattice.turn)
    flat = found.reshape(-1)
    together = max(1, _CELLS_TOGETHER // values.shape[1])
    for first in range(0, values.shape[0], together):
        band = values[first : first + together]
        row, col = np.nonzero(band)
        value = band[row, col]
        up, right = row + (first + 0.5 - lattice.row), col + (0.5 - lattice.col)
        y = (up * cos - right * sin) / lattice.side
        x = (up * sin + right * cos) / lattice.side
        near = (y > -1) & (y < height + 1) & (x > -1) & (x < width + 1)
        y, x, value = y[near], x[near], value[near]
        row, col = np.floor(y).astype(np.intp), np.floor(x).astype(np.intp)
        y_off, x_off = y - row - 0.5, x - col - 0.5
        for down, aside in product((-1, 0, 1), repeat=2):
            at_row, at_col = row + down, col + aside
            overlaps = (at_row >= 0) & (at_row < height) & (at_col >= 0) & (at_col < width)
            # the offset in the array's cells and along its axes
            off_x, off_y = (x_off - aside) * lattice.side, (y_off - down) * lattice.side
            overlaps &= _overlap(off_x * cos - off_y * sin, off_y * cos + off_x * sin, lattice)
            np.maximum.at(flat, at_row[overlaps] * width + at_col[overlaps], value[overlaps])
