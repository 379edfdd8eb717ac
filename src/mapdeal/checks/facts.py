"""What checks look at, each found once, and the decorator of checks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray

from mapdeal.checks.findings import CHECKS, Check, Finding, Remark, Severity, add_check, places_of
from mapdeal.errors import (
    FileAccessError,
    MalformedInputError,
    MapdealWarning,
    emit_warning,
    kept_warnings,
)
from mapdeal.files.source import BIT_MAP, claim
from mapdeal.files.yaml_text import Entry, parse_mapping, read_mapping
from mapdeal.grid.costmap import Costmap, figures_of_costs
from mapdeal.grid.field import FieldView, ViewScale
from mapdeal.grid.filters import FilterInfo
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame, Point
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import Goal, Reach
from mapdeal.grid.values import FREE, OCCUPIED
from mapdeal.inputs.kinds import MAP, recognised
from mapdeal.kernels.arrays import Integers
from mapdeal.kernels.blocks import Layer, blocks_of
from mapdeal.kernels.components import MOST_PLACES, Components
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.lookup import histogram
from mapdeal.maps import map_server
from mapdeal.maps.dialects import (
    DIALECTS,
    Dialect,
    MapMetadata,
    cells_of,
    metadata_of,
    reader_of,
    yaml_of,
)
from mapdeal.maps.images import IMAGE_FORMATS, open_for_one_pass
from mapdeal.maps.npz import read_npz
from mapdeal.maps.picture import Picture, Samples, Strips
from mapdeal.maps.reading import as_occupancy, bare_image, open_map
from mapdeal.ros.filters import FilterServers
from mapdeal.ros.load import Name
from mapdeal.ros.robot import CostmapName, Flavour, ParameterValue, RobotParameters

Codes = NDArray[np.uint64]
Counts = NDArray[np.int64]

_PIXELS_TOGETHER = 1 << 18
"""Colours become wide numbers on the way to cells: not those of many pixels at once."""
_MOST_KEPT = 1 << 16
_BITS = 16


class DistinctPixels:
    """Counts the different pixels of pictures that are of one kind, such as strips of a picture."""

    def __init__(self, report: Callable[[Picture, Counts], None]) -> None:
        self.firsts: dict[int, int] = {}
        """The first pixel of each opaque 8-bit grey, or index of a palette, by its number."""
        self._seen = 0
        self._report = report
        self._kind: Picture | None = None
        self._greys = np.zeros(0, dtype=np.int64)
        self._others: list[tuple[Codes, Counts]] = []

    def add(self, picture: Picture) -> None:
        self._kind = picture
        for band in picture.bands(_PIXELS_TOGETHER):
            self._add_band(band)

    def finish(self) -> None:
        kind = self._kind
        if kind is None:
            return
        greys = np.flatnonzero(self._greys)
        if greys.size:
            channels = [greys] * (3 if kind.samples.ndim == 3 else 1)
            if kind.alpha is not None:
                channels.append(np.full_like(greys, kind.opaque))
            self._report(_row(channels, kind), self._greys[greys])
        self._greys = self._greys[:0]
        self._tell_of_others(kind)

    def _add_band(self, picture: Picture) -> None:
        """Count some pixels: grey and opaque ones, which are most, without sorting."""
        grey, exceptions = picture.greys_and_exceptions()
        counts = histogram(grey) if grey.dtype == np.uint8 else None
        if counts is not None:
            self._note_firsts(grey, exceptions, counts)
        self._seen += grey.size
        if exceptions.any():
            self._add_others(picture.only(exceptions))
            grey = grey[~exceptions][np.newaxis]
            counts = None if counts is None else histogram(grey)
        if counts is None:
            counts = np.bincount(grey.reshape(-1), minlength=256)
        if len(counts) > len(self._greys):
            counts, self._greys = self._greys, counts
        self._greys[: len(counts)] += counts

    def _note_firsts(self, grey: Samples, exceptions: NDArray[np.bool_], counts: Counts) -> None:
        """Note where the greys are that have not come up before, few as they are."""
        new = [value for value in np.flatnonzero(counts).tolist() if value not in self.firsts]
        for value in new:
            is_here = (grey == value).reshape(-1)
            first = int(is_here.argmax())
            if exceptions.reshape(-1)[first]:
                is_here &= ~exceptions.reshape(-1)
                first = int(is_here.argmax())
            if is_here[first]:
                self.firsts[value] = self._seen + first

    def _add_others(self, row: Picture) -> None:
        code = np.zeros(row.shape[1], dtype=np.uint64)
        channels = list(np.atleast_2d(row.samples[0].T))
        for channel in channels if row.alpha is None else [*channels, row.alpha[0]]:
            code <<= np.uint64(_BITS)
            code |= channel
        self._others.append(np.unique(code, return_counts=True))
        if sum(len(codes) for codes, _ in self._others) > _MOST_KEPT and self._kind is not None:
            self._tell_of_others(self._kind)

    def _tell_of_others(self, kind: Picture) -> None:
        if not self._others:
            return
        listed, times = (np.concatenate(parts) for parts in zip(*self._others, strict=True))
        self._others.clear()
        codes, places = np.unique(listed, return_inverse=True)
        counts = np.zeros(len(codes), dtype=np.int64)
        np.add.at(counts, places, times)
        count = (3 if kind.samples.ndim == 3 else 1) + (kind.alpha is not None)
        shifts = [np.uint64(_BITS * k) for k in reversed(range(count))]
        channels = [(codes >> shift) & np.uint64(0xFFFF) for shift in shifts]
        self._report(_row(channels, kind), counts)


def _row(channels: Sequence[NDArray[np.integer[Any]]], kind: Picture) -> Picture:
    alpha = None
    if kind.alpha is not None:
        alpha = channels[-1].astype(kind.alpha.dtype)[np.newaxis]
        channels = channels[:-1]
    samples = np.stack(channels, axis=-1).astype(kind.samples.dtype)[np.newaxis]
    samples = samples if kind.samples.ndim == 3 else samples[..., 0]
    return replace(kind, samples=samples, alpha=alpha)


def without_rounding_noise(value: float) -> float | None:
    """Return the decimal of a value with the noise of a 32-bit or 64-bit float; None without it."""
    plain = float(f"{value:.6g}")
    if plain != value and float(np.float32(plain)) == float(np.float32(value)):
        return plain
    return None


Place = tuple[int, int]  # row and column of a cell, row 0 in the south
_CELLS_TOGETHER = 1 << 18


class CellTallies:
    """Counts of the cells of a map, of which some rows come at a time, from whichever side."""

    def __init__(
        self, shape: tuple[int, int], *, from_north: bool = False,
        of_values: NDArray[np.int64] | None = None,
    ) -> None:  # fmt: skip
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
        self._last_free = np.zeros(width, dtype=np.bool_)
        self._free_pairs = 0  # of free cells that share an edge

    def add(self, occupancy: NDArray[np.int8]) -> None:
        """Count the cells of the next rows, shape (rows, W)."""
        step = max(1, _CELLS_TOGETHER // occupancy.shape[1])
        for first in range(0, len(occupancy), step):
            self._add_band(occupancy[first : first + step])

    def _add_band(self, band: NDArray[np.int8]) -> None:
        height, first = self.shape[0], self._rows
        stop = self._rows = first + len(band)
        if self._counts_values:
            self._of_values += histogram(band)
        free = band == FREE
        self._free.add(free)
        rows = (self._last_free, free[0]), (free[:-1], free[1:]), (free[:, :-1], free[:, 1:])
        self._free_pairs += sum(int(np.count_nonzero(a & b)) for a, b in rows)
        self._last_free = free[-1]
        if self._from_north:
            first, stop, band, free = height - stop, height - first, band[::-1], free[::-1]
        self._known_rows[first:stop] = band.max(axis=1) >= 0
        self._known_cols |= band.max(axis=0) >= 0
        self._free_cols[first:stop] = free[:, [0, -1]]
        for side, row in enumerate((0, height - 1)):
            if first <= row < stop:
                self._free_rows[side] = free[row - first]

    @cached_property
    def counts(self) -> dict[str, int]:
        """Number of occupied, free, unknown and other cells, once all rows have been counted."""
        return states_of(self._of_values)

    @property
    def mean_free_width(self) -> float:
        """Mean width of free space in cells, twice its area over its outline; 0 without any."""
        area = self.counts["free"]
        outline = 4 * area - 2 * self._free_pairs
        return 2 * area / outline if outline else 0.0

    @property
    def border(self) -> int:
        height, width = self.shape
        return self.size - max(height - 2, 0) * max(width - 2, 0)

    @cached_property
    def free_on_border(self) -> int:
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
    def _border(self) -> tuple[Integers, NDArray[np.bool_]]:
        height, width = self.shape
        rows, cols = np.arange(height), np.arange(width)
        bottom, top = self._free_rows
        left, right = self._free_cols.T
        sides = [(0 * cols, cols, bottom), (rows[1:], 0 * rows[1:] + width - 1, right[1:])]
        if height > 1:
            sides.append((0 * cols[1:] + height - 1, cols[-2::-1], top[-2::-1]))
        if width > 1:
            sides.append((rows[-2:0:-1], 0 * rows[-2:0:-1], left[-2:0:-1]))
        row, col, is_free = (np.concatenate(parts) for parts in zip(*sides, strict=True))
        return np.stack([row, col], axis=1), is_free

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
        return float(rows[0] + rows[-1]) / 2, float(cols[0] + cols[-1]) / 2

    @cached_property
    def free_components(self) -> tuple[Integers, Integers]:
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
    if marked.all():
        return [(0, len(marked))]
    edges = np.flatnonzero(np.diff(marked, prepend=False, append=False))
    found = [(start, stop - start) for start, stop in edges.reshape(-1, 2).tolist()]
    if is_closed and len(found) > 1 and marked[0] and marked[-1]:
        start, length = found.pop()
        found[0] = start, length + found[0][1]
    return found


def tallies_of(occupancy: Layer) -> CellTallies:
    tallies = CellTallies(occupancy.shape)
    for block in blocks_of(occupancy):
        tallies.add(occupancy[block])
    return tallies


class PixelTallies:
    """Counts of the pixels of a map's image, and of what each reader makes of them."""

    def __init__(self, metadata: MapMetadata) -> None:
        readers: tuple[Dialect, ...] = () if metadata.cost_scale is not None else tuple(DIALECTS)
        self.size = 0  # pixels
        self.coloured = 0  # pixels that are no grey
        self.not_opaque = 0
        self.lost = 0  # pixels of mode raw that hold no value of a map
        self.freed = {name: map_server.FreedCells(metadata, name) for name in readers}
        """Map_saver's unknown cells that are free, for each reader; none in mode raw."""
        self._metadata = metadata
        self.of_greys = np.zeros(256, dtype=np.int64)
        """Number of pixels of each grey, for 8-bit grey images."""
        self.of_values = {name: np.zeros(256, dtype=np.int64) for name in readers}
        """How often a reader has each byte, arrays that grow while pixels come."""
        self.differing = {name: 0 for name in readers if name != "nav2"}
        """Number of cells in which each other reader differs from nav2."""
        self.differing_greys: dict[Dialect, list[int]] = {name: [] for name in readers}
        """Greys that nav2 and each of the others have differently, the most frequent first."""
        self.freed_greys: list[int] = []
        """Map_saver's grey for unknown, if a reader has free cells of it."""
        self._pixels = DistinctPixels(self._tally)

    def add(self, picture: Picture) -> None:
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
        return {name: states_of(values) for name, values in self.of_values.items()}

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
            self.lost += map_server.count_of_lost(pixels, counts[np.newaxis])
        readings = {name: cells_of(pixels, self._metadata, name) for name in self.freed}
        for name, cells in readings.items():
            np.add.at(self.of_values[name], cells[0].view(np.uint8), counts)
            if name != "nav2":
                self.differing[name] += int(counts[cells[0] != readings["nav2"][0]].sum())
            if not is_raw:
                self.freed[name].add(pixels, cells, counts[np.newaxis])
        if pixels.samples.dtype == np.uint8 and readings:
            self._note_greys(pixels, readings, counts)

    def _note_greys(
        self, pixels: Picture, readings: dict[Dialect, NDArray[np.int8]], counts: Counts
    ) -> None:
        """Note the greys whose places are reported: those of opaque pixels."""
        grey, exceptions = pixels.greys_and_exceptions()
        order = np.flatnonzero(~exceptions[0])
        order = order[np.argsort(-counts[order], kind="stable")]
        for name, cells in readings.items():
            differs = cells[0, order] != readings["nav2"][0, order]
            self.differing_greys[name] += grey[0, order[differs]].tolist()
            is_freed = (grey[0, order] == map_server.MAP_SAVER_UNKNOWN) & (cells[0, order] == FREE)
            is_saved = pixels.palette is None and pixels.maxval == 255
            if is_saved and self._metadata.mode != "raw" and is_freed.any():
                self.freed_greys = [map_server.MAP_SAVER_UNKNOWN]


def states_of(values: NDArray[np.int64]) -> dict[str, int]:
    """Return how many cells are in each state, given how many have each byte."""
    occupied, free, unknown = int(values[OCCUPIED]), int(values[FREE]), int(values[128:].sum())
    between = int(values.sum()) - occupied - free - unknown
    return {"occupied": occupied, "free": free, "unknown": unknown, "between": between}


@dataclass(frozen=True, eq=False)
class ParameterFacts:
    """The values of one costmap, whatever they mean."""

    flavour: Flavour
    costmap: CostmapName
    values: Mapping[Name, ParameterValue]
    plugins: tuple[tuple[str, str], ...]

    def shown(self, *name: str) -> str:
        return ("." if self.flavour == "nav2" else "/").join(name)

    @cached_property
    def sections(self) -> dict[str, dict[Name, ParameterValue]]:
        """The values below each name right below the costmap that has some."""
        found: dict[str, dict[Name, ParameterValue]] = {}
        for path, value in self.values.items():
            if len(path) > 1:
                found.setdefault(path[0], {})[path] = value
        return found


@dataclass(frozen=True, eq=False)
class RobotFacts:
    """Effective parameters of one costmap."""

    robot: RobotParameters
    parameters: ParameterFacts
    other: RobotParameters | None = None
    map_resolutions: tuple[tuple[str, float], ...] = ()

    def value(self, *name: str) -> ParameterValue | None:
        return self.parameters.values.get(name)

    def of_layer(self, layer: str, parameter: str) -> ParameterValue | None:
        """Return a parameter of a layer, or that of the costmap that a layer of ROS 1 takes."""
        own = self.value(layer, parameter)
        above = self.value(parameter) if self.robot.flavour == "ros1" else None
        return above or own


_HEAD = 1 << 16

_OF_ROOMS = {"compiled": 22, "scipy": 106}
"""Bytes for each cell that looking for passages takes at its peak, by engine."""


@dataclass(frozen=True, eq=False)
class GridFacts:
    """The cells of a map, of whatever file, as dialect nav2 reads them."""

    frame: Frame
    cells: CellTallies

    @classmethod
    def of(cls, grid: OccupancyGrid) -> GridFacts:
        """Return the facts of a map in memory, or of one that is read by rows."""
        return cls(grid.frame, tallies_of(grid.occupancy))

    def places(self, cells_rowcol: Sequence[tuple[float, float]]) -> tuple[Point, ...]:
        """Return the centres of cells in the map frame, metres."""
        return places_of(self.frame.xy_from_rowcol(cells_rowcol).tolist())

    @property
    def other_components(self) -> tuple[Integers, Integers]:
        """The sizes of the components of free cells but the largest, and how many of each."""
        sizes, counts = self.cells.free_components
        others = counts.copy()
        others[-1:] -= 1
        return sizes, others


@dataclass(frozen=True, eq=False)
class RoomFacts:
    """A map in memory, and a robot that is to get through it."""

    grid: OccupancyGrid
    radius: float


@dataclass(frozen=True, eq=False)
class MaskFacts:
    """The mask of a costmap filter, the map that it is for, and the robot that is to get about."""

    pair: PairFacts | None  # none yet of a mask that is being made
    mask: OccupancyGrid
    info: FilterInfo
    grid: OccupancyGrid
    map_name: str
    closed: NDArray[np.bool_]
    """Which cells of the map the mask forbids."""

    covered: float
    """The share of the map's known cells that the mask covers, 0..1."""

    robot: Footprint | None = None
    start: tuple[float, ...] | None = None
    goals: tuple[Goal, ...] = ()
    name_of: Callable[[Point], str | None] = lambda _: None
    """Returns the name of the zone at a point, if it is known."""

    @property
    def start_is_closed(self) -> bool:
        if self.start is None or self.info.kind != "keepout":
            return False
        cells, inside = self.grid.frame.bounded_rowcol_from_xy([self.start[:2]])
        row, col = cells[0].tolist()
        return bool(inside[0] and self.closed[row, col])

    @cached_property
    def ways(self) -> tuple[Reach, Reach] | None:
        """What the robot reaches without the mask and with it; None if that cannot differ."""
        from mapdeal.grid.reaching import Ground, reach_on  # slow to import

        if self.info.kind != "keepout" or self.start_is_closed or not self.closed.any():
            return None

        def found(start: Sequence[float] | None, keepout: NDArray[np.bool_] | None) -> Reach:
            ground = Ground(np.asarray(self.grid.occupancy), self.grid.frame, False, keepout)
            return reach_on(
                ground, self.robot, start=start, goals=self.goals, headings=72, margin=0.0,
                min_area=1.0,
            )  # fmt: skip

        after = found(self.start, self.closed)  # whose start, if none is given, is in no zone
        return found(after.start if self.start is None else self.start, None), after


@dataclass(frozen=True, eq=False)
class FilterFacts:
    """The filters of a robot's costmap, and the servers for them in the same files."""

    robot: RobotFacts
    servers: FilterServers


@dataclass(frozen=True, eq=False)
class PlannerFacts:
    """The parameters of one planner server of Nav2, by their full names."""

    values: Mapping[str, ParameterValue]


@dataclass(frozen=True, eq=False)
class PairFacts:
    path: Path
    entries: dict[str, Entry]
    metadata: MapMetadata
    image_path: Path
    kind: Picture
    pixels: PixelTallies
    frame: Frame
    comments: list[str] = field(default_factory=list)

    def places_of_greys(self, greys: Iterable[int]) -> tuple[Point, ...]:
        """Return where the first pixel of each grey is, in the map frame, metres."""
        height, width = self.frame.shape
        at = [divmod(pixel, width) for pixel in self.pixels.first_pixels(greys)]
        cells = [(height - 1 - row, col) for row, col in at]  # pixels come from the north
        return places_of(self.frame.xy_from_rowcol(cells).tolist())


def gather(
    path: Path, *, max_cells: int | None = None
) -> tuple[PairFacts | None, GridFacts | None, list[Finding]]:
    """Return what there is to check of a file, and what was found while it was read."""
    findings: list[Finding] = []
    entries: dict[str, Entry] = {}
    pair: PairFacts | None = None
    cells: GridFacts | None = None
    try:
        bits = path if path.suffix.lower() == BIT_MAP else None
        path = path if bits is None else map_server.yaml_beside(bits)
        with _warnings_as_findings(findings, path, entries):
            if path.suffix.lower() == ".npz":
                cells = _of_npz(path, max_cells)
            else:
                pair, cells = _of_pair(path, max_cells, bits, entries)
    except (FileAccessError, MalformedInputError) as error:
        name = "file.access" if isinstance(error, FileAccessError) else "file.malformed"
        text = str(error) + (f" ({error.hint})" if error.hint else "")
        findings.append(_finding(name, path, text, entries))
    return pair, cells, findings


def gather_rooms(path: Path, radius: float, *, max_cells: int | None = None) -> RoomFacts:
    """Return a map that `gather` has gone through, for checks that need all of it in memory."""
    with kept_warnings(), open_map(path, max_cells=max_cells) as file:
        height, width = file.shape()
        count = file.memory_to_read() + _OF_ROOMS[engine_name()] * height * width
        claim(path, count, what=f"{width} x {height} cells")
        return RoomFacts(as_occupancy(file.read().grid, path), radius)


def _of_npz(path: Path, max_cells: int | None) -> GridFacts | None:
    """Return the facts of the map in an npz, None if it holds costs or a view."""
    grid = read_npz(path, max_cells=max_cells)
    if isinstance(grid, Costmap):
        map_server.warn_if_uniform(path, grid)
        return None
    if isinstance(grid, FieldView):
        _warn_of_view(path, grid.scale)
        return None
    return GridFacts.of(grid if isinstance(grid, OccupancyGrid) else grid.grid)


def _of_pair(
    path: Path, max_cells: int | None, bits: Path | None, entries: dict[str, Entry]
) -> tuple[PairFacts, GridFacts | None]:
    """Return the facts of a YAML file, which must name the bit map that was asked for, if any."""
    # Its keys are put into `entries` as soon as they are known, for what is found after that.
    bare = None if bits is not None else bare_image(path)
    with recognised(path, "a map", MAP):
        entries.update(read_mapping(path) if bare is None else parse_mapping(path, yaml_of(bare)))
        metadata = metadata_of(entries, path, mend=True)
    if bits is None:
        image = map_server.find_image(path, metadata.image)
    else:
        image = map_server.find_bits(bits, path, metadata)
    with open_for_one_pass(image, max_cells=max_cells) as (strips, head):
        kind, pixels, cells = _counted(strips, metadata, image)
    if pixels.lost:
        text = f"{image}: {map_server.remark_on_lost(pixels.lost)}"
        emit_warning(MapdealWarning(text, "image.raw-values"), stacklevel=2)
    comments = IMAGE_FORMATS[kind.file_format].comments(head[:_HEAD])
    frame = Frame(*strips.shape, metadata.resolution, metadata.origin)
    pair = PairFacts(path, entries, metadata, image, kind, pixels, frame, comments)
    if cells is None:
        map_server.warn_of_cost_figures(path, figures_of_costs(pixels.of_greys, "costmap2d"))
        return pair, None
    if metadata.view is not None:
        _warn_of_view(path, metadata.view)
        return pair, None
    return pair, GridFacts(frame, cells)


def _warn_of_view(path: Path, scale: ViewScale) -> None:
    text = f"{path}: is the 0..100 view of a distance field ({scale.described()}), not a map"
    emit_warning(MapdealWarning(text, "map.view"), stacklevel=3)


def _counted(
    strips: Strips, metadata: MapMetadata, image: Path
) -> tuple[Picture, PixelTallies, CellTallies | None]:
    """Go through a picture; return its kind, what its pixels come to, and its cells, if any."""
    pixels = PixelTallies(metadata)
    cells = None
    if (
        metadata.cost_scale is None
    ):  # a reader makes the same of equal pixels: these are counted already
        of_values = pixels.of_values["nav2"]
        cells = CellTallies(strips.shape, from_north=True, of_values=of_values)
    for strip in strips.pictures():
        read = None if cells is None else reader_of(strip, metadata, "nav2")
        for part in strip.bands(_PIXELS_TOGETHER):
            pixels.add(part)
            if read is None or cells is None:
                map_server.costs_of(part, image)
            else:
                cells.add(read(part))
    pixels.finish()
    alpha = None if strip.alpha is None else strip.alpha[:0]
    return replace(strip, samples=strip.samples[:0], alpha=alpha), pixels, cells


@contextmanager
def _warnings_as_findings(
    findings: list[Finding], path: Path, entries: Mapping[str, Entry]
) -> Iterator[None]:
    """Turn mapdeal's warnings in the block into findings."""
    with kept_warnings() as kept:
        try:
            yield
        finally:
            for one in kept:
                name = one.check
                if name is None:
                    raise TypeError(f"a warning of the readers has no check: {one}")
                findings.append(_finding(name, path, str(one), entries))


def _finding(name: str, path: Path, text: str, entries: Mapping[str, Entry]) -> Finding:
    """Return a finding of what a reader says, ``PATH: PLACE: TEXT``, with the line of the place."""
    line = None
    if text.startswith(f"{path}: "):
        text = text.removeprefix(f"{path}: ")
        place, colon, rest = text.partition(": ")
        line, place = _line_in(place)
        if line is None and place in entries:
            line = entries[place].line
        text = f"{place}{colon}{rest}" if place else rest
    return CHECKS[name].finding(path, text, line)


def _line_in(place: str) -> tuple[int | None, str]:
    if place.startswith("line "):  # line 3; line 3, column 7
        number, _, others = place.removeprefix("line ").partition(", ")
    else:  # origin (line 3)
        others, _, number = place.removesuffix(")").rpartition(" (line ")
    return (int(number), others) if number.isdecimal() else (None, place)


_FACTS = (
    PairFacts, GridFacts, RoomFacts, MaskFacts, ParameterFacts, RobotFacts, FilterFacts,
    PlannerFacts,
)  # fmt: skip
CheckFunction = TypeVar("CheckFunction", bound=Callable[[Any], Iterator[Remark | str]])


def check(name: str, severity: Severity, about: str) -> Callable[[CheckFunction], CheckFunction]:
    """Add a function to the list of checks; it gets the facts that its parameter is annotated."""

    def added(function: CheckFunction) -> CheckFunction:
        hints = get_type_hints(function)
        facts = [kind for parameter, kind in hints.items() if parameter != "return"]
        if len(facts) != 1 or facts[0] not in _FACTS:
            known = " or ".join(one.__name__ for one in _FACTS)
            rule = f"check {name} must have one parameter, annotated {known}"
            raise TypeError(f"{rule}, got {facts}")
        add_check(Check(name, severity, about, function, facts[0]))
        return function

    return added
