"""Facts about files, gathered once for all checks, and the decorator of checks."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import numpy as np

from mapdeal import errors, records
from mapdeal.checks.findings import CHECKS, Finding, Remark, Severity, add_check
from mapdeal.files.source import bytes_of_lines, claim, claimed
from mapdeal.files.yaml_text import Entry, parse_mapping, read_mapping
from mapdeal.grid import field, footprint
from mapdeal.grid.costmap import Costmap, figures_of_costs
from mapdeal.grid.filters import FilterInfo
from mapdeal.grid.frame import Frame, Point
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import Goal, Passage, Reach
from mapdeal.grid.values import FREE, OCCUPIED
from mapdeal.kernels import blocks, components, engine, lookup
from mapdeal.kernels.arrays import Integers, Mask, SignedBytes
from mapdeal.maps import dialects, formats, images, kinds, map_file, map_server, picture, reading
from mapdeal.ros import filters, load
from mapdeal.ros.robot import ParameterValue, RobotParameters

_PIXELS_PER_BAND = 1 << 18  # as colours are widened to 64 bits when they become cells


def without_rounding_noise(value: float) -> float | None:
    """Return the short decimal that a value is a rounding of; None for an exact value."""
    plain = float(f"{value:.6g}")
    return plain if plain != value and np.float32(plain) == np.float32(value) else None


Place = tuple[int, int]  # row and column of a cell, row 0 in the south
_CELLS_PER_BAND = 1 << 18
_COARSE = 200  # most blocks of a side in which a map is compared with itself


class CellTallies:
    """Counts of a map's cells, which are added in bands of rows from the south or the north."""

    def __init__(
        self, shape: tuple[int, int], *, from_north: bool = False,
        byte_counts: Integers | None = None,
    ) -> None:  # fmt: skip
        height, width = self.shape = shape
        self.size, self._rows = height * width, 0
        self._counts_bytes = byte_counts is None
        self._byte_counts = np.zeros(256, dtype=np.int64) if byte_counts is None else byte_counts
        self._known_rows, self._known_cols = (np.zeros(side, dtype=np.bool_) for side in shape)
        self._free = components.Components(last_row=height - 1 if from_north else None)
        self._from_north = from_north
        self._free_rows = np.zeros((2, width), dtype=np.bool_)
        self._free_cols = np.zeros((height, 2), dtype=np.bool_)
        self._last_free = np.zeros(width, dtype=np.bool_)
        self._free_pairs = 0  # of free cells that share an edge
        self.pooling = math.ceil(max(shape) / _COARSE)
        pooled_shape = (math.ceil(side / self.pooling) for side in shape)
        self._pooled = np.zeros((2, *pooled_shape), dtype=np.int32)  # of obstacles, and free

    def add(self, occupancy: SignedBytes) -> None:
        """Count the cells of the next rows, shape (rows, W)."""
        step = max(1, _CELLS_PER_BAND // occupancy.shape[1])
        for first in range(0, len(occupancy), step):
            self._add_band(occupancy[first : first + step])

    def _add_band(self, band: SignedBytes) -> None:
        height, first = self.shape[0], self._rows
        stop = self._rows = first + len(band)
        if self._counts_bytes:
            self._byte_counts += lookup.histogram(band)
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
        pooled_rows = np.arange(first, stop) // self.pooling
        for pooled, layer in zip(self._pooled, (band == OCCUPIED, free), strict=True):
            starts = np.arange(0, self.shape[1], self.pooling)
            np.add.at(pooled, pooled_rows, np.add.reduceat(layer, starts, axis=1, dtype=np.int32))
        for side, row in enumerate((0, height - 1)):
            if first <= row < stop:
                self._free_rows[side] = free[row - first]

    @cached_property
    def counts(self) -> dict[str, int]:
        """Number of occupied, free, unknown and other cells, after all rows were added."""
        return cell_states(self._byte_counts)

    @cached_property
    def pooled(self) -> Mask:
        """Which blocks of `pooling` cells a side hold an obstacle, and are mostly free."""
        walls, free = self._pooled[0] > 0, self._pooled[1] > self.pooling**2 / 2
        rows, cols = (np.flatnonzero((walls | free).any(axis=axis)) for axis in (1, 0))
        box = (slice(int(k[0]), int(k[-1]) + 1) if len(k) else slice(0) for k in (rows, cols))
        return np.stack([walls, free])[(slice(None), *box)]

    @property
    def mean_free_width(self) -> float:
        """Mean width of free space in cells: twice its area divided by its outline, or 0."""
        area = self.counts["free"]
        outline = 4 * area - 2 * self._free_pairs
        return 2 * area / outline if outline else 0.0

    @property
    def border(self) -> int:
        return self.size - math.prod(max(side - 2, 0) for side in self.shape)

    @property
    def free_on_border(self) -> int:
        height, width = self.shape
        rows, cols = self._free_rows[: min(height, 2)], self._free_cols[1:-1, : min(width, 2)]
        return int(np.count_nonzero(rows) + np.count_nonzero(cols))

    @property
    def known_box(self) -> tuple[int, int]:
        """Rows and columns of the smallest box around all known cells; 0 and 0 if none is known."""
        sides = np.flatnonzero(self._known_rows), np.flatnonzero(self._known_cols)
        rows, cols = (int(np.ptp(side)) + 1 if side.size else 0 for side in sides)
        return rows, cols

    @property
    def middle_of_known(self) -> tuple[float, float]:
        """Row and column of the middle of `known_box`; whole numbers are centres of cells."""
        rows, cols = np.flatnonzero(self._known_rows), np.flatnonzero(self._known_cols)
        return float(rows[0] + rows[-1]) / 2, float(cols[0] + cols[-1]) / 2

    @cached_property
    def free_components(self) -> tuple[Integers, Integers]:
        """Sizes of the 8-connected components of free cells, and the number of each size."""
        return self._free.sizes()

    def places_of_components(self, least: int, most: int) -> list[Place]:
        """Return one cell of each of the largest free components, except the very largest."""
        # of several equally large components, the first counts as the largest
        groups = reversed(self._free.places().items())
        _, *cells = [(size, cell) for size, members in groups for cell in members] or [(0, 0)]
        fitting = [cell for size, cell in cells if least <= size <= most]
        return [divmod(cell, self.shape[1]) for cell in fitting[: components.MOST_PLACES]]


class PixelTallies:
    """Counts of the pixels of a map's image, and of the cells that each reader gets from them."""

    def __init__(self, metadata: dialects.MapMetadata) -> None:
        has_costs = metadata.cost_scale is not None
        readers: tuple[dialects.Dialect, ...] = () if has_costs else tuple(dialects.DIALECTS)
        self.size = 0  # pixels
        self.coloured = 0  # pixels other than grey
        self.not_opaque = 0
        self.lost = 0  # pixels of mode raw outside of the range of occupancy values
        self.freed = {name: map_server.FreedCells(metadata, name) for name in readers}
        """Map_saver's unknown cells that are free, for each reader; none in mode raw."""
        self._metadata = metadata
        self.grey_counts = np.zeros(256, dtype=np.int64)  # pixels of each grey, if it has 8 bits
        self.byte_counts = {name: np.zeros(256, dtype=np.int64) for name in readers}
        """Number of cells of each byte, by reader."""
        self.differing = {name: 0 for name in readers if name != "nav2"}  # cells read otherwise
        self.differing_greys: dict[dialects.Dialect, list[int]] = {name: [] for name in readers}
        """Greys that nav2 and each other reader read differently, the most frequent first."""
        self.freed_greys: list[int] = []  # map_saver's grey for unknown, if a reader frees it
        self.firsts: dict[int, int] = {}
        """The first pixel of each opaque 8-bit grey, or index of a palette: a number from north."""
        self._pixel_count = 0
        self._greys = np.zeros(256, dtype=np.int64)  # pixels of each opaque grey or index

    def add(self, strip: picture.Picture) -> None:
        """Count the pixels of the next rows; all opaque ones of a grey are read at the end."""
        self._kind = strip
        grey, is_other = strip.greys_and_exceptions()
        opaque = grey
        if is_other.any():
            exceptions = strip.only(is_other)
            self._tally(exceptions, np.ones(exceptions.shape[1], dtype=np.int64))
            opaque = grey[~is_other][np.newaxis]
        if grey.dtype == np.uint8:
            counts = lookup.histogram(opaque)
            for value in set(np.flatnonzero(counts).tolist()) - self.firsts.keys():
                self.firsts[value] = self._pixel_count + int(((grey == value) & ~is_other).argmax())
        else:
            counts = np.bincount(opaque.reshape(-1), minlength=256)
        self._pixel_count += grey.size
        if len(counts) > len(self._greys):
            counts, self._greys = self._greys, counts
        self._greys[: len(counts)] += counts

    def finish(self) -> None:
        row = picture.opaque_greys(self._kind)
        is_used = np.zeros(row.shape, dtype=np.bool_)
        is_used[0, : len(self._greys)] = self._greys[: row.shape[1]] > 0
        if is_used.any():
            self._tally(row.only(is_used), self._greys[self._greys > 0])

    @cached_property
    def greys(self) -> dict[int, int]:
        """Number of pixels of each grey that occurs; empty for all but 8-bit grey images."""
        return {grey: count for grey, count in enumerate(self.grey_counts.tolist()) if count}

    @cached_property
    def counts(self) -> dict[dialects.Dialect, dict[str, int]]:
        return {name: cell_states(values) for name, values in self.byte_counts.items()}

    def _tally(self, pixels: picture.Picture, counts: Integers) -> None:
        """Add a row of pixels, each as often as its count."""
        self.size += int(counts.sum())
        if pixels.colour == "grey" and pixels.maxval == 255:
            np.add.at(self.grey_counts, pixels.samples[0], counts)
        elif pixels.colour == "rgb":
            is_coloured = (pixels.samples[0] != pixels.samples[0, :, :1]).any(axis=1)
            self.coloured += int(counts[is_coloured].sum())
        palette, opacity = pixels.palette, pixels.alpha
        opacity = opacity if palette is None else palette[:, 3][pixels.samples]
        if opacity is not None:
            self.not_opaque += int(counts[opacity[0] < pixels.opaque].sum())
        is_raw = self._metadata.mode == "raw"
        if is_raw and self.freed:
            self.lost += map_server.count_of_lost(pixels, counts[np.newaxis])
        readings = {name: dialects.cells_of(pixels, self._metadata, name) for name in self.freed}
        for name, cells in readings.items():
            np.add.at(self.byte_counts[name], cells[0].view(np.uint8), counts)
            if name != "nav2":
                self.differing[name] += int(counts[cells[0] != readings["nav2"][0]].sum())
            if not is_raw:
                self.freed[name].add(pixels, cells, counts[np.newaxis])
        if pixels.samples.dtype != np.uint8 or not readings:
            return
        grey, is_other = pixels.greys_and_exceptions()  # places of opaque greys are reported
        order = np.flatnonzero(~is_other[0])
        order = order[np.argsort(-counts[order], kind="stable")]
        is_saved = palette is None and pixels.maxval == 255 and not is_raw
        for name, cells in readings.items():
            differs = cells[0, order] != readings["nav2"][0, order]
            self.differing_greys[name] += grey[0, order[differs]].tolist()
            is_freed = (grey[0, order] == map_server.MAP_SAVER_UNKNOWN) & (cells[0, order] == FREE)
            if is_saved and is_freed.any():
                self.freed_greys = [map_server.MAP_SAVER_UNKNOWN]


def cell_states(counts: Integers) -> dict[str, int]:
    """Return the number of cells in each state, from the number of cells of each byte."""
    occupied, free, unknown = int(counts[OCCUPIED]), int(counts[FREE]), int(counts[128:].sum())
    between = int(counts.sum()) - occupied - free - unknown
    return {"occupied": occupied, "free": free, "unknown": unknown, "between": between}


@records.dataclass(frozen=True, eq=False)
class RobotFacts:
    robot: RobotParameters
    parameters: load.ParameterFacts
    sibling: RobotParameters | None = None
    map_frames: tuple[tuple[str, Frame], ...] = ()

    def value(self, *name: str) -> ParameterValue | None:
        return self.parameters.values.get(name)

    def of_layer(self, layer: str, *parameters: str) -> ParameterValue | None:
        """Return a layer's first parameter that is set; in ROS 1 the costmap's own goes before."""
        for parameter in parameters:
            costmap_value = self.value(parameter) if self.robot.flavour == "ros1" else None
            if (value := costmap_value or self.value(layer, parameter)) is not None:
                return value
        return None


_HEAD = 1 << 16
_LEAST_CUT_OFF = 4.0  # m2 of positions of the robot's centre; smaller areas are niches
_LINE_BYTES = 120  # of runs, per row and column: a band has at least one row
_BAND_BYTES = 10_000_000  # of runs in a band, and of the checks' modules
_ROOM_BYTES = {"compiled": 22, "scipy": 106}  # per cell, at the peak of the search for passages


@records.dataclass(frozen=True, eq=False)
class GridFacts:
    """The cells of a map file of any format, as dialect nav2 reads them."""

    frame: Frame
    cells: CellTallies

    @classmethod
    def of(cls, grid: OccupancyGrid) -> GridFacts:
        tallies = CellTallies(grid.shape)
        for block in blocks.blocks_of(grid.occupancy):
            tallies.add(grid.occupancy[block])
        return cls(grid.frame, tallies)

    def places(self, cells_rowcol: Sequence[tuple[float, float]]) -> list[Point]:
        places: list[Point] = self.frame.xy_from_rowcol(cells_rowcol).tolist()
        return places

    @property
    def other_components(self) -> tuple[Integers, Integers]:
        """Sizes of the free components and the number of each, without the largest component."""
        sizes, counts = self.cells.free_components
        return sizes, np.append(counts[:-1], counts[-1:] - 1)


@records.dataclass(frozen=True, eq=False)
class RoomFacts:
    """The passages of a map that stop a robot, each with a room on both sides."""

    passages: Sequence[Passage]
    radius: float

    @classmethod
    def of(cls, grid: OccupancyGrid, radius: float) -> RoomFacts:
        from mapdeal.grid.reaching import disconnected  # of use to few, and slow to import

        return cls(disconnected(grid, radius, _LEAST_CUT_OFF), radius)


@records.dataclass(frozen=True, eq=False)
class MaskFacts:
    pair: PairFacts | None  # None until the mask is written
    mask: OccupancyGrid
    info: FilterInfo
    grid: OccupancyGrid
    map_name: str
    closed: Mask  # which cells of the map the mask forbids
    covered: float  # the share of the map's known cells that the mask covers, 0..1
    robot: footprint.Footprint | None = None
    start: tuple[float, ...] | None = None
    goals: tuple[Goal, ...] = ()
    name_of: Callable[[Point], str | None] = lambda _: None  # of the zone at a point, if known

    @property
    def start_is_closed(self) -> bool:
        if self.start is None or self.info.kind != "keepout":
            return False
        (cell,), (inside,) = self.grid.frame.bounded_rowcol_from_xy([self.start[:2]])
        return bool(inside and self.closed[tuple(cell)])

    @cached_property
    def reaches(self) -> tuple[Reach, Reach] | None:
        """Reach without the mask and with it; None if the mask cannot change it."""
        from mapdeal.grid.reaching import Ground, reach_on  # slow to import

        if self.info.kind != "keepout" or self.start_is_closed or not self.closed.any():
            return None

        def reach(start: Sequence[float] | None, keepout: Mask | None) -> Reach:
            ground = Ground(np.asarray(self.grid.occupancy), self.grid.frame, False, keepout)
            numbers: Any = {"headings": 72, "margin": 0.0, "min_area": 1.0}
            return reach_on(ground, self.robot, start=start, goals=self.goals, **numbers)

        after = reach(self.start, self.closed)  # a default start lies outside of all zones
        return reach(after.start if self.start is None else self.start, None), after


@records.dataclass(frozen=True, eq=False)
class FilterFacts:
    robot: RobotFacts
    servers: filters.FilterServers


@records.dataclass(frozen=True, eq=False)
class PlannerFacts:
    """The parameters of one planner server of Nav2, by their full names, and frames of maps."""

    values: Mapping[str, ParameterValue]
    map_frames: Sequence[tuple[str, Frame]]


@records.dataclass(frozen=True, eq=False)
class PairFacts:
    path: Path
    entries: dict[str, Entry]
    metadata: dialects.MapMetadata
    image_path: Path
    kind: picture.Picture
    pixels: PixelTallies
    frame: Frame
    comments: list[str] = records.field(default_factory=list)

    def places_of_greys(self, greys: Iterable[int]) -> list[Point]:
        """Return the positions of the first pixel of each grey in the map frame, metres."""
        height, width = self.frame.shape
        firsts = [self.pixels.firsts[grey] for grey in greys if grey in self.pixels.firsts]
        pixels = [divmod(first, width) for first in firsts[: components.MOST_PLACES]]
        cells = [(height - 1 - row, col) for row, col in pixels]  # pixels come from the north
        places: list[Point] = self.frame.xy_from_rowcol(cells).tolist()
        return places


def gather(
    path: Path, *, max_cells: int | None = None
) -> tuple[PairFacts | None, GridFacts | None, list[Finding]]:
    entries: dict[str, Entry] = {}
    pair, cells = None, None
    texts: list[tuple[str, str]] = []  # names of checks, and messages
    with errors.capture_warnings() as warnings:
        try:
            named, path = path, formats.format_of(path).header(path)
            if formats.format_of(path).is_yaml:
                bits = named if named != path else None
                pair, cells = _gather_pair(path, max_cells, bits, entries)
            else:
                cells = _gather_grid(path, max_cells)
        except (errors.FileAccessError, errors.MalformedInputError) as error:
            name = "file.access" if isinstance(error, errors.FileAccessError) else "file.malformed"
            texts = [(name, str(error) + (f" ({error.hint})" if error.hint else ""))]
    texts = [*((str(warning.check), str(warning)) for warning in warnings), *texts]
    return pair, cells, [_finding(name, path, text, entries) for name, text in texts]


def gather_rooms(path: Path, radius: float, *, max_cells: int | None = None) -> RoomFacts:
    """Return facts of a map's rooms, for which all its cells are read; `gather` has checked it."""
    with errors.capture_warnings(), reading.open_map(path, max_cells=max_cells) as file:
        height, width = file.shape()
        needed = file.memory_to_read() + _ROOM_BYTES[engine.engine_name()] * height * width
        needed += bytes_of_lines((height, width), _LINE_BYTES)
        with claimed(path, needed, what=f"{width} x {height} cells"):
            return RoomFacts.of(reading.as_occupancy(file.read().grid, path), radius)


def _gather_grid(path: Path, max_cells: int | None) -> GridFacts | None:
    """Return the facts of a map without a YAML file, None if it holds costs or a view."""
    with reading.open_map(path, max_cells=max_cells) as file:
        claim(path, _BAND_BYTES + bytes_of_lines(file.shape(), _LINE_BYTES))
        grid = file.cells()
    if isinstance(grid, Costmap):
        map_file.warn_of_cost_figures(path, grid.figures())
    elif isinstance(grid, field.FieldView):
        _warn_of_view(path, grid.scale)
    else:
        return GridFacts.of(grid if isinstance(grid, OccupancyGrid) else grid.grid)
    return None


def _gather_pair(
    path: Path, max_cells: int | None, bits: Path | None, entries: dict[str, Entry]
) -> tuple[PairFacts, GridFacts | None]:
    """Return the facts of a YAML file and its image; `bits` is the bit map it must name, if any."""
    # `entries` gets the keys as soon as they are read, so that later findings can name their lines.
    bare = None if bits is not None else map_server.bare_image(path)
    with kinds.recognised(path, "a map", kinds.MAP):
        keys = read_mapping(path) if bare is None else parse_mapping(path, dialects.yaml_of(bare))
        entries.update(keys)
        metadata = dialects.metadata_of(entries, path, mend=True)
    image = map_server.image_of(path, metadata, bits)
    with images.open_for_one_pass(image, max_cells=max_cells) as (strips, head):
        claim(path, _BAND_BYTES + bytes_of_lines(strips.shape, _LINE_BYTES))
        kind, pixels, cells = _count_pixels(strips, metadata, image)
    if pixels.lost:
        text = f"{image}: {map_server.remark_on_lost(pixels.lost)}"
        errors.emit_warning(errors.MapdealWarning(text, "image.raw-values"))
    comments = images.IMAGE_FORMATS[kind.file_format].comments(head[:_HEAD])
    frame = Frame(*strips.shape, metadata.resolution, metadata.origin)
    pair = PairFacts(path, entries, metadata, image, kind, pixels, frame, comments)
    if cells is None:
        map_file.warn_of_cost_figures(path, figures_of_costs(pixels.grey_counts, "costmap2d"))
    elif metadata.view is not None:
        _warn_of_view(path, metadata.view)
    else:
        return pair, GridFacts(frame, cells)
    return pair, None


def _warn_of_view(path: Path, scale: field.ViewScale) -> None:
    text = f"{path}: is the 0..100 view of a distance field ({scale.described()}), not a map"
    errors.emit_warning(errors.MapdealWarning(text, "map.view"))


def _count_pixels(
    strips: picture.Strips, metadata: dialects.MapMetadata, image: Path
) -> tuple[picture.Picture, PixelTallies, CellTallies | None]:
    """Return a picture's kind, the tallies of its pixels and, unless it has costs, of its cells."""
    pixels = PixelTallies(metadata)
    cells = None
    if metadata.cost_scale is None:  # share the counts of cell bytes, which follow from the pixels
        cells = CellTallies(strips.shape, from_north=True, byte_counts=pixels.byte_counts["nav2"])
    for strip in strips.pictures():
        read = None if cells is None else dialects.reader_of(strip, metadata, "nav2")
        for part in strip.bands(_PIXELS_PER_BAND):
            pixels.add(part)
            if read is None or cells is None:
                map_server.costs_of(part, image)
            else:
                cells.add(read(part))
    pixels.finish()
    alpha = None if strip.alpha is None else strip.alpha[:0]
    return records.replace(strip, samples=strip.samples[:0], alpha=alpha), pixels, cells


def _finding(name: str, path: Path, text: str, entries: Mapping[str, Entry]) -> Finding:
    """Return a finding for a reader's ``PATH: PLACE: TEXT``, with the line of the place."""
    line = None
    if text.startswith(f"{path}: "):
        text = text.removeprefix(f"{path}: ")
        place, colon, message = text.partition(": ")
        if place.startswith("line "):  # line 3; line 3, column 7
            number, _, key = place.removeprefix("line ").partition(", ")
        else:  # origin (line 3)
            key, _, number = place.removesuffix(")").rpartition(" (line ")
        line, place = (int(number), key) if number.isdecimal() else (None, place)
        if line is None and place in entries:
            line = entries[place].line
        text = f"{place}{colon}{message}" if place else message
    return CHECKS[name].finding(path, text, line)


_FACTS = (
    PairFacts, GridFacts, RoomFacts, MaskFacts, load.ParameterFacts, RobotFacts, FilterFacts,
    PlannerFacts,
)  # fmt: skip
CheckFunction = TypeVar("CheckFunction", bound=Callable[[Any], Iterator[Remark | str]])


def check(
    name: str, severity: Severity, *, on_request: bool = False
) -> Callable[[CheckFunction], CheckFunction]:
    """Add a function to the list of checks; its parameter's annotation selects the facts."""
    # Its docstring explains the check, in the form that `parse_explanation` reads.

    def register(function: CheckFunction) -> CheckFunction:
        hints = get_type_hints(function)
        facts = [kind for parameter, kind in hints.items() if parameter != "return"]
        if len(facts) != 1 or facts[0] not in _FACTS:
            known = " or ".join(kind.__name__ for kind in _FACTS)
            raise TypeError(f"check {name} must have one parameter, annotated {known}, got {facts}")
        text = function.__doc__ or ""
        add_check(name, severity, text, run=function, facts=facts[0], on_request=on_request)
        return function

    return register
