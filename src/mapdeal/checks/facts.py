"""Facts about a map's files for the checks, gathered in one pass for all readers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field, replace
from pathlib import Path

from mapdeal.checks.finding import CHECKS, Finding, places_of
from mapdeal.checks.tallies import CellTallies, PixelTallies, tallies_of
from mapdeal.errors import (
    FileAccessError,
    MalformedInputError,
    MapdealWarning,
    emit_warning,
    kept_warnings,
)
from mapdeal.formats.budget import claim
from mapdeal.formats.dialects import reader_of
from mapdeal.formats.image import IMAGE_FORMATS, open_passing
from mapdeal.formats.kinds import MAP, recognised
from mapdeal.formats.map_remarks import remark_on_lost, warn_of_cost_figures, warn_of_one_cost
from mapdeal.formats.map_server import BIT_MAP, costs_of, find_bits, find_image, yaml_beside
from mapdeal.formats.map_yaml import MapMetadata, metadata_of
from mapdeal.formats.maps import as_occupancy, open_map
from mapdeal.formats.npz import read_npz
from mapdeal.formats.picture import Picture
from mapdeal.formats.strips import Strips
from mapdeal.formats.yaml_text import Entry, read_mapping
from mapdeal.grid.coordinates import Point
from mapdeal.grid.costmap import Costmap, figures_of_costs
from mapdeal.grid.field_view import FieldView, ViewScale
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.components import Cells
from mapdeal.kernels.engine import engine_name
from mapdeal.records import dataclass

_HEAD = 1 << 16

_OF_ROOMS = {"compiled": 22, "scipy": 106}
"""Bytes for each cell that looking for passages takes at its peak, by engine."""

_PIXELS_TOGETHER = 1 << 18
"""Colours become wide numbers on the way to cells: not those of many pixels at once."""


@dataclass(frozen=True, eq=False)
class GridFacts:
    """The cells of a map, of whatever file, as dialect nav2 reads them."""

    frame: Frame
    cells: CellTallies

    @classmethod
    def of(cls, grid: OccupancyGrid) -> GridFacts:
        """Return the facts of a map in memory, or of one that is read by rows."""
        return cls(grid.frame, tallies_of(grid.occupancy))

    @property
    def counts(self) -> dict[str, int]:
        """Number of cells in each state."""
        return self.cells.counts

    def places(self, cells_rowcol: Sequence[tuple[float, float]]) -> tuple[Point, ...]:
        """Return the centres of cells in the map frame, metres."""
        return places_of(self.frame.xy_from_rowcol(cells_rowcol).tolist())

    @property
    def other_components(self) -> tuple[Cells, Cells]:
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
class PairFacts:
    """A map_server pair."""

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
    pair: PairFacts | None = None
    cells: GridFacts | None = None
    entries: dict[str, Entry] = {}
    try:
        bits = path if path.suffix.lower() == BIT_MAP else None
        path = path if bits is None else yaml_beside(bits)
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
        warn_of_one_cost(path, grid)
        return None
    if isinstance(grid, FieldView):
        _warn_of_view(path, grid.scale)
        return None
    return GridFacts.of(grid if isinstance(grid, OccupancyGrid) else grid.grid)


def _of_pair(
    path: Path, max_cells: int | None, bits: Path | None, entries: dict[str, Entry]
) -> tuple[PairFacts, GridFacts | None]:
    """Return the facts of a YAML file, which must name the bit map that was asked for, if any.

    Its keys are put into `entries` as soon as they are known, for what is found after that.
    """
    with recognised(path, "a map", MAP):
        entries.update(read_mapping(path))
        metadata = metadata_of(entries, path, mend=True)
    image = find_image(path, metadata.image) if bits is None else find_bits(bits, path, metadata)
    with open_passing(image, max_cells=max_cells) as (strips, head):
        kind, pixels, cells = _counted(strips, metadata, image)
    if pixels.lost:
        text = f"{image}: {remark_on_lost(pixels.lost)}"
        emit_warning(MapdealWarning(text, "image.raw-values"), stacklevel=2)
    comments = IMAGE_FORMATS[kind.file_format].comments(head[:_HEAD])
    frame = Frame(*strips.shape, metadata.resolution, metadata.origin)
    pair = PairFacts(path, entries, metadata, image, kind, pixels, frame, comments)
    if cells is None:
        warn_of_cost_figures(path, figures_of_costs(pixels.of_greys, "costmap2d"))
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
    holds_costs = metadata.cost_scale is not None
    pixels = PixelTallies(metadata)
    cells = None
    if not holds_costs:  # a reader makes the same of equal pixels: these are counted already
        of_values = pixels.of_values("nav2")
        cells = CellTallies(strips.shape, from_north=True, of_values=of_values)
    for strip in strips.pictures():
        read = None if cells is None else reader_of(strip, metadata, "nav2")
        for part in strip.bands(_PIXELS_TOGETHER):
            pixels.add(part)
            if read is None or cells is None:
                costs_of(part, image)
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
    return Finding(name, CHECKS[name].severity, str(path), text, line)


def _line_in(place: str) -> tuple[int | None, str]:
    """Return the line that a place names, if any, and what is left of the place."""
    if place.startswith("line "):  # line 3; line 3, column 7
        number, _, others = place.removeprefix("line ").partition(", ")
    else:  # origin (line 3)
        others, _, number = place.removesuffix(")").rpartition(" (line ")
    return (int(number), others) if number.isdecimal() else (None, place)
