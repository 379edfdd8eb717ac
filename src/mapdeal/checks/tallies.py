"""Counts of a map's pixels and cells for the checks, taken row by row."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.dialects import DIALECTS, cells_of
from mapdeal.formats.distinct_pixels import Counts, DistinctPixels
from mapdeal.formats.map_remarks import MAP_SAVER_UNKNOWN, FreedCells, count_of_lost
from mapdeal.formats.map_yaml import Dialect, MapMetadata
from mapdeal.formats.picture import Picture
from mapdeal.grid.values import FREE, OCCUPIED
from mapdeal.kernels.blocks import Layer, blocks_of
from mapdeal.kernels.components import MOST_PLACES, Cells, Components
from mapdeal.kernels.lookup import histogram

Place = tuple[int, int]
"""Row and column of a cell, row 0 in the south."""

_CELLS_TOGETHER = 1 << 18


class CellTallies:
    """Counts of the cells of a map, of which some rows come at a time, from whichever side."""

    def __init__(
        self,
        shape: tuple[int, int],
        *,
        from_north: bool = False,
        of_values: NDArray[np.int64] | None = None,
    ) -> None:
        height, width = shape
        self.shape = shape
        self.size = height * width
        self._rows = 0
        self._counts_values = of_values is None
        self._of_values = np.zeros(256, dtype=np.int64) if of_values is None else of_values
        self._known_rows = np.zeros(height, dtype=np.bool_)
        self._known_cols = np.zeros(width, dtype=np.bool_)
        self._free = Components(last_row=height - 1 if from_north else None)
        self._from_north = from_north
        self._free_rows = np.zeros((2, width), dtype=np.bool_)
        self._free_cols = np.zeros((height, 2), dtype=np.bool_)

    def add(self, occupancy: NDArray[np.int8]) -> None:
        """Count the cells of the next rows, shape (rows, W)."""
        height, width = occupancy.shape
        step = max(1, _CELLS_TOGETHER // width)
        for first in range(0, height, step):
            self._add_band(occupancy[first : first + step])

    def _add_band(self, band: NDArray[np.int8]) -> None:
        first, stop = self._rows, self._rows + len(band)
        self._rows = stop
        if self._counts_values:
            self._of_values += histogram(band)
        self._known_rows[first:stop] = band.max(axis=1) >= 0
        self._known_cols |= band.max(axis=0) >= 0
        free = band == FREE
        self._free.add(free)
        self._free_cols[first:stop] = free[:, [0, -1]]
        for side, row in enumerate((0, self.shape[0] - 1)):
            if first <= row < stop:
                self._free_rows[side] = free[row - first]

    @cached_property
    def counts(self) -> dict[str, int]:
        """Number of occupied, free, unknown and other cells, once all rows have been counted."""
        return states_of(self._of_values)

    @property
    def border(self) -> int:
        """Number of cells on the border of the map."""
        height, width = self.shape
        return self.size - max(height - 2, 0) * max(width - 2, 0)

    @cached_property
    def free_on_border(self) -> int:
        """Cells on the border of the map that are free."""
        return int(np.count_nonzero(self._border[1]))

    @property
    def free_stretches(self) -> list[Place]:
        """The middles of the stretches of free cells along the border, of the longest first."""
        cells, is_free = self._border
        stretches = _stretches(is_free, is_closed=min(self.shape) > 1)
        stretches.sort(key=lambda one: (-one[1], one[0]))
        middles = [(start + (length - 1) // 2) % len(cells) for start, length in stretches]
        return [(row, col) for row, col in cells[middles[:MOST_PLACES]].tolist()]

    @cached_property
    def _border(self) -> tuple[Cells, NDArray[np.bool_]]:
        """Return the cells of the border, anticlockwise from (0, 0), and which of them are free."""
        height, width = self.shape
        rows, cols = np.arange(height), np.arange(width)
        sides = [(0 * cols, cols), (rows[1:], 0 * rows[1:] + width - 1)]
        if height > 1:
            sides.append((0 * cols[1:] + height - 1, cols[-2::-1]))
        if width > 1:
            sides.append((rows[-2:0:-1], 0 * rows[-2:0:-1]))
        cells = np.concatenate([np.stack(side, axis=1) for side in sides])
        bottom_and_top, left_and_right = self._free_rows, self._free_cols
        if self._from_north:
            bottom_and_top, left_and_right = bottom_and_top[::-1], left_and_right[::-1]
        row, col = cells.T
        on_side = left_and_right[row, (col > 0).astype(np.intp)]
        on_end = bottom_and_top[(row > 0).astype(np.intp), col]
        is_end = (row == 0) | (row == height - 1)
        return cells, np.where(is_end, on_end, on_side)

    @property
    def known_box(self) -> tuple[int, int]:
        """Rows and columns of the smallest box around all known cells, 0 and 0 without any."""
        rows, cols = np.flatnonzero(self._known_rows), np.flatnonzero(self._known_cols)
        if not rows.size:
            return 0, 0
        return int(np.ptp(rows)) + 1, int(np.ptp(cols)) + 1

    @property
    def middle_of_known(self) -> tuple[float, float]:
        """The middle of that box, in rows and columns as the centres of cells have them."""
        rows, cols = np.flatnonzero(self._known_rows), np.flatnonzero(self._known_cols)
        row, col = float(rows[0] + rows[-1]) / 2, float(cols[0] + cols[-1]) / 2
        return (self.shape[0] - 1 - row if self._from_north else row), col

    @cached_property
    def free_components(self) -> tuple[Cells, Cells]:
        """The sizes of the 8-connected components of free cells, and how many there are of each."""
        return self._free.sizes()

    def places_of_components(self, least: int, most: int) -> list[Place]:
        """Return a cell of each of the largest components of free cells but the very largest."""
        found = list(reversed(self._free.places().items()))
        if found:  # of several that are as large as the largest, one is that
            found[0] = found[0][0], found[0][1][1:]
        cells = [cell for size, listed in found if least <= size <= most for cell in listed]
        return [divmod(cell, self.shape[1]) for cell in cells[:MOST_PLACES]]


def _stretches(marked: NDArray[np.bool_], *, is_closed: bool) -> list[tuple[int, int]]:
    """Return where stretches of marked things begin, and how long they are.

    Examples
    --------
    >>> _stretches(np.array([True, True, False, True]), is_closed=True)
    [(3, 3)]
    """
    if marked.all():
        return [(0, len(marked))]
    edges = np.flatnonzero(np.diff(marked, prepend=False, append=False))
    found = [(start, stop - start) for start, stop in edges.reshape(-1, 2).tolist()]
    if is_closed and len(found) > 1 and marked[0] and marked[-1]:
        start, length = found.pop()
        found[0] = start, length + found[0][1]
    return found


def tallies_of(occupancy: Layer) -> CellTallies:
    """Return the counts of all cells of a layer, row 0 in the south."""
    tallies = CellTallies(occupancy.shape)
    for block in blocks_of(occupancy):
        tallies.add(occupancy[block])
    return tallies


class PixelTallies:
    """Counts of the pixels of a map's image, and of what each reader makes of them."""

    def __init__(self, metadata: MapMetadata) -> None:
        readers: tuple[Dialect, ...] = () if metadata.cost_scale is not None else tuple(DIALECTS)
        self.size = 0
        """Pixels."""
        self.coloured = 0
        """Pixels that are no grey."""
        self.not_opaque = 0
        self.lost = 0
        """Pixels of mode raw that hold no value of a map."""
        self.freed = {name: FreedCells(metadata, name) for name in readers}
        """Map_saver's unknown cells that are free, for each reader; none in mode raw."""
        self._metadata = metadata
        self.of_greys = np.zeros(256, dtype=np.int64)
        """Number of pixels of each grey, for 8-bit grey images."""
        self._of_values = {name: np.zeros(256, dtype=np.int64) for name in readers}
        self._differing = dict.fromkeys(readers, 0)
        self.differing_greys: dict[Dialect, list[int]] = {name: [] for name in readers}
        """Greys that nav2 and each of the others have differently, the most frequent first."""
        self.freed_greys: list[int] = []
        """Map_saver's grey for unknown, if a reader has free cells of it."""
        self._pixels = DistinctPixels(self._tally)

    def add(self, picture: Picture) -> None:
        """Count the pixels of some rows."""
        self._pixels.add(picture)

    def finish(self) -> None:
        """Be done with all rows: the counts are complete from now on."""
        self._pixels.finish()

    def first_pixels(self, greys: Iterable[int]) -> list[int]:
        """Return the first opaque pixel of each grey that has one, rows counted from the north."""
        firsts = self._pixels.firsts
        return [firsts[grey] for grey in greys if grey in firsts][:MOST_PLACES]

    @cached_property
    def greys(self) -> dict[int, int]:
        """The same, of those that there are; empty for other images."""
        return {grey: int(self.of_greys[grey]) for grey in np.flatnonzero(self.of_greys).tolist()}

    @cached_property
    def counts(self) -> dict[Dialect, dict[str, int]]:
        """Number of occupied, free, unknown and other cells for each reader."""
        return {name: states_of(values) for name, values in self._of_values.items()}

    def of_values(self, reader: Dialect) -> NDArray[np.int64]:
        """Return how often a reader has each byte, an array that grows while pixels come."""
        return self._of_values[reader]

    @property
    def differing(self) -> dict[Dialect, int]:
        """Number of cells in which each other reader differs from nav2."""
        return {name: count for name, count in self._differing.items() if name != "nav2"}

    def _tally(self, pixels: Picture, counts: Counts) -> None:
        """Count pixels that differ from each other, a row of them."""
        self.size += int(counts.sum())
        if pixels.colour == "grey" and pixels.maxval == 255:
            np.add.at(self.of_greys, pixels.samples[0], counts)
        elif pixels.colour == "rgb":
            is_coloured = (pixels.samples[0] != pixels.samples[0, :, :1]).any(axis=1)
            self.coloured += int(counts[is_coloured].sum())
        opacity = pixels.alpha
        if pixels.palette is not None:
            opacity = pixels.palette[:, 3][pixels.samples]
        if opacity is not None:
            self.not_opaque += int(counts[opacity[0] < pixels.opaque].sum())
        is_raw = self._metadata.mode == "raw"
        if is_raw and self.freed:
            self.lost += count_of_lost(pixels, counts[np.newaxis])
        readings = {name: cells_of(pixels, self._metadata, name) for name in self.freed}
        for name, cells in readings.items():
            np.add.at(self._of_values[name], cells[0].view(np.uint8), counts)
            self._differing[name] += int(counts[cells[0] != readings["nav2"][0]].sum())
            if not is_raw:
                self.freed[name].add(pixels, cells, counts[np.newaxis])
        if pixels.samples.dtype == np.uint8 and readings:
            self._note_greys(pixels, readings, counts)

    def _note_greys(
        self, pixels: Picture, readings: dict[Dialect, NDArray[np.int8]], counts: Counts
    ) -> None:
        """Note the greys whose places are reported: those of opaque pixels."""
        grey, others = pixels.greys_and_others()
        order = np.flatnonzero(~others[0])
        order = order[np.argsort(-counts[order], kind="stable")]
        for name, cells in readings.items():
            differs = cells[0, order] != readings["nav2"][0, order]
            self.differing_greys[name] += grey[0, order[differs]].tolist()
            is_freed = (grey[0, order] == MAP_SAVER_UNKNOWN) & (cells[0, order] == FREE)
            is_saved = pixels.palette is None and pixels.maxval == 255
            if is_saved and self._metadata.mode != "raw" and is_freed.any():
                self.freed_greys = [MAP_SAVER_UNKNOWN]


def states_of(values: NDArray[np.int64]) -> dict[str, int]:
    """Return how many cells are occupied, free, unknown and between, given how many of each byte.

    Examples
    --------
    >>> values = np.zeros(256, dtype=np.int64)
    >>> values[[100, 0, 255, 50]] = [4, 3, 2, 1]  # 255 is the byte of -1
    >>> states_of(values)
    {'occupied': 4, 'free': 3, 'unknown': 2, 'between': 1}
    """
    occupied, free, unknown = int(values[OCCUPIED]), int(values[FREE]), int(values[128:].sum())
    between = int(values.sum()) - occupied - free - unknown
    return {"occupied": occupied, "free": free, "unknown": unknown, "between": between}
