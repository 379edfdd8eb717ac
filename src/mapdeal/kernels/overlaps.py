"""Values of one lattice of cells in the cells of another, which may be turned and finer or coarser.

A `Lattice` describes where the other cells lie among those of an array, whose own cells have side 1
and whose coordinates are rows and columns with their fractions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.threads import for_rows

TOUCHING = 1e-6
"""In sides of the larger cell. Cells that overlap by less only touch: their borders are the same
on paper."""

_GATHERED = 2.0
"""Up to this side, neighbours are few: each cell looks at all that it may overlap."""

_TOGETHER = 1 << 16

Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Lattice:
    """Where the cells that are asked for lie among the cells of an array."""

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
        """How far cells may overlap that only touch, in cells of the array."""
        return min(TOUCHING * max(1.0, self.side), self.side / 4)

    def centres(self, rows: slice, width: int) -> tuple[Floats, Floats]:
        """Return rows and columns, with fractions, of the centres of some rows of cells."""
        i = (np.arange(rows.start, rows.stop)[:, np.newaxis] + 0.5) * self.side
        j = (np.arange(width) + 0.5) * self.side
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        return (i * cos + self.row) + j * sin, (self.col - i * sin) + j * cos

    def edges(self, first: float, count: int, size: int) -> tuple[Indices, Indices]:
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
    elif lattice.side <= _GATHERED:
        _gather(found, values, lattice)
    else:
        _scatter(found, values, lattice)
    return found


def nearest_under(
    values: Bytes, shape: tuple[int, int], lattice: Lattice
) -> tuple[Bytes, Mask]:  # fmt: skip
    found = np.zeros(shape, dtype=np.uint8)
    inside = np.zeros(shape, dtype=np.bool_)
    if 0 not in values.shape and 0 not in shape:
        (_copy_ranges if lattice.turn == 0.0 else _look_up)(found, inside, values, lattice)
    return found, inside


def _copy_ranges(found: Bytes, inside: Mask, values: Bytes, lattice: Lattice) -> None:
    """Set the values at centres: the lattice lies along the axes."""
    height, width = values.shape

    def look(part: slice) -> None:
        y, _ = lattice.centres(part, 1)
        _, x = lattice.centres(slice(0, 1), found.shape[1])
        row, col = _cells_of(y[:, 0], height, lattice.slack), _cells_of(x[0], width, lattice.slack)
        rows, cols = _span(row, height), _span(col, width)
        inside[part][rows, cols] = True
        found[part][rows, cols] = values[row[rows]][:, col[cols]]

    for_rows(look, found.shape)


def _look_up(found: Bytes, inside: Mask, values: Bytes, lattice: Lattice) -> None:
    """Set the values at centres, wherever they lie."""
    height, width = values.shape
    flat = np.ascontiguousarray(values).reshape(-1)

    def look(part: slice) -> None:
        y, x = lattice.centres(part, found.shape[1])
        for places in (y, x):
            places += lattice.slack
            np.floor(places, out=places)
        within = inside[part]
        np.logical_and(y >= 0, y < height, out=within)
        within &= (x >= 0) & (x < width)
        y *= width
        y += x
        found[part][within] = flat[y[within].astype(np.intp)]

    for_rows(look, found.shape)


def _cells_of(places: Floats, size: int, slack: float) -> Indices:
    """Return the cells that coordinates lie in; those beyond the array stay just beyond it."""
    return np.floor(np.clip(places + slack, -1, size)).astype(np.intp)


def _span(cells: Indices, size: int) -> slice:
    """Return which of some increasing numbers are cells of an axis."""
    first, end = np.searchsorted(cells, [0, size])
    return slice(int(first), int(end))


def _reduce_ranges(found: Bytes, values: Bytes, lattice: Lattice) -> None:
    """Set the largest values in ranges of rows and of columns: the lattice lies along the axes."""
    low, high = lattice.edges(lattice.row, found.shape[0], values.shape[0])
    left, right = lattice.edges(lattice.col, found.shape[1], values.shape[1])
    cols = np.flatnonzero(left < right)
    if not len(cols):
        return

    def look(part: slice) -> None:
        rows = part.start + np.flatnonzero(low[part] < high[part])
        if len(rows):
            lines = _largest_of_ranges(values, low[rows], high[rows])
            across = _largest_of_ranges(lines.T, left[cols], right[cols])
            found[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1] = across.T

    for_rows(look, found.shape)


def _largest_of_ranges(lines: Bytes, first: Indices, end: Indices) -> Bytes:
    found = lines[first]
    for step in range(1, int((end - first).max())):
        np.maximum(found, lines[np.minimum(first + step, end - 1)], out=found)
    return found


def _gather(found: Bytes, values: Bytes, lattice: Lattice) -> None:
    """Set the largest values by a look at all cells that a cell of the lattice may overlap."""
    # Most cells are done at once: where the largest value around a centre is that of the cell below
    # it, no other can count.
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
                overlap = _overlap(right - x_off[more], down - y_off[more], lattice)
                more = more[overlap]
                best[more] = value[more]
            own[which] = best
        found[part] = own.reshape(-1, found.shape[1])

    for_rows(look, found.shape)


def _largest_around(values: Bytes, reach: int) -> Bytes:
    """Return the largest value in the square of cells around each, `reach` cells far."""
    across = values.copy()
    for step in range(1, reach + 1):
        np.maximum(across[:, step:], values[:, :-step], out=across[:, step:])
        np.maximum(across[:, :-step], values[:, step:], out=across[:, :-step])
    found = across.copy()
    for step in range(1, reach + 1):
        np.maximum(found[step:], across[:-step], out=found[step:])
        np.maximum(found[:-step], across[step:], out=found[:-step])
    return found


def _overlap(right: Floats, up: Floats, lattice: Lattice) -> Mask:
    """Return which cells of the array overlap a cell of the lattice, given their distance."""
    # Two squares overlap unless a line along a side of one of them parts them.
    cos, sin = math.cos(lattice.turn), math.sin(lattice.turn)
    along = 0.5 + lattice.side / 2 * lattice.wide - lattice.touching
    across = lattice.side / 2 + 0.5 * lattice.wide - lattice.touching
    overlap: Mask = (np.abs(right) < along) & (np.abs(up) < along)
    overlap &= np.abs(right * cos + up * sin) < across
    overlap &= np.abs(up * cos - right * sin) < across
    return overlap


def _scatter(found: Bytes, values: Bytes, lattice: Lattice) -> None:
    """Set the largest values, those of small cells in the large ones that they overlap."""
    height, width = found.shape
    cos, sin = math.cos(lattice.turn), math.sin(lattice.turn)
    flat = found.reshape(-1)
    together = max(1, _TOGETHER // values.shape[1])
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
            held = (at_row >= 0) & (at_row < height) & (at_col >= 0) & (at_col < width)
            # the same distance in the array's cells and along its axes
            off_x, off_y = (x_off - aside) * lattice.side, (y_off - down) * lattice.side
            held &= _overlap(off_x * cos - off_y * sin, off_y * cos + off_x * sin, lattice)
            np.maximum.at(flat, at_row[held] * width + at_col[held], value[held])
