"""A map from files of laser scans."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mapdeal.errors import MalformedInputError, ParameterError, emit_warning
from mapdeal.formats.budget import claim
from mapdeal.formats.maps import output_paths, write_grid
from mapdeal.formats.npz import write_npz
from mapdeal.formats.scans.source import ScanSource
from mapdeal.formats.source import check_state, is_regular, state_of
from mapdeal.grid.frame import Frame, Point
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.mapping.beams import BeamCounts, BeamLimits, Beams, Scans, beams_of
from mapdeal.mapping.build import BuiltMap, Extent, MapBuilder, Method, frame_of, reach_behind
from mapdeal.mapping.evidence import NEAR, OFTEN, HitGroups
from mapdeal.pipeline.files import add_picture, errors_named, outputs_of
from mapdeal.pipeline.settings import Settings
from mapdeal.records import dataclass

_PER_CELL: dict[Method, int] = {"log-odds": 22, "counting": 22, "tsdf": 43}
"""Bytes for each cell: the evidence, and the map that is made of it."""

_MOST_KEPT = 1 << 26
"""Bytes of beams that are kept rather than read twice."""

Advance = Callable[[int], object]


@dataclass(frozen=True)
class BuildSettings:
    """How maps are made of scans."""

    methods: Mapping[Method, Mapping[str, Any]]
    limits: BeamLimits
    resolution: float
    size: Point | None
    origin: Point | None

    def __post_init__(self) -> None:
        if (self.size is None) != (self.origin is None):
            raise ParameterError("must be given together", source="--size, --origin")
        self.reach_behind()  # what is wrong with a parameter is said before anything is read
        if self.size is not None and self.origin is not None:
            frame_of(self.size, self.origin, self.resolution)

    @property
    def sizes_itself(self) -> bool:
        """Whether the grid is to hold all that beams reach: scans are then read twice."""
        return self.size is None

    def reach_behind(self) -> float:
        """Return how far behind hits any of the methods has an effect, metres."""
        methods = self.methods.items()
        return max(reach_behind(method, self.resolution, given) for method, given in methods)


@dataclass(frozen=True)
class Gathered:
    """What scans have said of the cells of one grid."""

    builders: dict[Method, MapBuilder]
    seconds: dict[Method, float]
    counts: BeamCounts


def build_file(
    source: ScanSource,
    output: Path,
    settings: BuildSettings,
    options: Settings,
    *,
    layers: Path | None = None,
    advance: Advance = lambda _: None,
) -> Figures:
    """Make a map of scans in files, and write it, and its evidence if `layers` is given."""
    if layers is not None and layers.suffix != ".npz":
        raise ParameterError("layers are written as .npz", source=layers)
    (method,) = settings.methods
    outputs = [*output_paths(output), *([layers] if layers is not None else [])]
    with outputs_of(outputs, source.files, options) as transaction:
        built = build(source, settings, options, with_layers=layers is not None, advance=advance)
        write_grid(transaction, output, built.grid)
        if layers is not None:
            transaction.write(layers, lambda file: write_npz(file, built.grid, more=built.layers))
        title = f"{output.stem}: map, {method}"
        add_picture(transaction, options, built.grid, title)
    return {**built.grid.figures(), **asdict(built.counts)}


def build(
    source: ScanSource,
    settings: BuildSettings,
    options: Settings,
    *,
    with_layers: bool = True,
    advance: Advance = lambda _: None,
) -> BuiltMap:
    """Return the map of scans in files, with its evidence or without; as `build_file`."""
    (method,) = settings.methods
    gathered = gather(source, settings, options, _PER_CELL[method], advance)
    builder = gathered.builders[method]
    built = builder.result(with_layers=with_layers)
    warn_of_nothing(built.grid, source.named)
    if built.vanished:
        _warn_of_vanished(built.vanished, built.grid.frame, builder, source.named)
    return built


def gather(
    source: ScanSource, settings: BuildSettings, options: Settings, per_cell: int, advance: Advance
) -> Gathered:
    """Return what the scans in files say, by all methods that are asked for."""
    # All files are read twice, or one after the other; a pipe can be read but once.
    states = {path: state_of(path) for path in source.files if is_regular(path)}
    try:
        with errors_named(source.named):
            source.prepare(advance)
            frame, kept = _frame(source, settings, advance)
            _claim(source.named, frame, per_cell, options)
            gathered = _gathered(source, frame, settings, kept, advance)
    finally:
        source.warn()  # what was passed over may be why there is no map
    for path, state in states.items():
        check_state(path, state)
    if not gathered.counts.scans:
        raise MalformedInputError("holds no scans", source=source.named)
    return gathered


class _Part(NamedTuple):
    """Some beams, and how many scans were read with them."""

    beams: Beams
    scans: int


def _frame(
    source: ScanSource, settings: BuildSettings, advance: Advance
) -> tuple[Frame, list[_Part] | None]:
    """Return the cells, and all beams if they were read for that and are not too many to keep."""
    if settings.size is not None and settings.origin is not None:
        return frame_of(settings.size, settings.origin, settings.resolution), None
    extent = Extent(settings.limits, settings.reach_behind())
    kept: list[_Part] | None = []
    taken = 0
    for part in _parts(source, settings.limits):
        extent.add_beams(part.beams)
        taken += part.beams.nbytes
        if taken > _MOST_KEPT:
            kept = None
        elif kept is not None:
            kept.append(part)
        advance(part.scans)
    return extent.frame(settings.resolution), kept


def _claim(named: Path, frame: Frame, per_cell: int, options: Settings) -> None:
    with options.memory():
        what = f"{frame.width} x {frame.height} cells"
        hint = "a pose may be wrong; --size and --origin bound the map"
        claim(named, per_cell * frame.height * frame.width, what=what, hint=hint)


def _gathered(
    source: ScanSource,
    frame: Frame,
    settings: BuildSettings,
    kept: list[_Part] | None,
    advance: Advance,
) -> Gathered:
    builders = {
        method: MapBuilder(frame, method, settings.limits, **parameters)
        for method, parameters in settings.methods.items()
    }
    seconds = dict.fromkeys(builders, 0.0)
    parts: Iterable[_Part] | None = kept
    if parts is None:
        parts = _parts(source, settings.limits, is_told=settings.sizes_itself)
    for part in parts:
        for method, builder in builders.items():
            started = time.perf_counter()
            builder.add_beams(part.beams)
            seconds[method] += time.perf_counter() - started
        advance(part.scans)
    counts = next(iter(builders.values())).counts
    return Gathered(builders, seconds, counts)


def _parts(source: ScanSource, limits: BeamLimits, *, is_told: bool = False) -> Iterator[_Part]:
    """Yield the beams of scans, some at a time; warn of odd angles, unless that was done."""
    for arrays in source.scans():
        if not is_told and np.abs(arrays.angles).max(initial=0.0) > 2 * math.pi:
            is_told = True
            largest = np.abs(arrays.angles).max()
            text = f"{source.named}: angles of up to {largest:.6g} rad: are they in degrees?"
            emit_warning(text, stacklevel=2)
        for scans in Scans(*arrays).parts():
            yield _Part(beams_of(scans, limits), scans.count)


def warn_of_nothing(grid: OccupancyGrid, path: Path) -> None:
    if not np.any(grid.occupancy >= 0):
        text = f"{path}: no beam reaches the grid: the whole map is unknown"
        emit_warning(text, stacklevel=2)


def _warn_of_vanished(vanished: HitGroups, frame: Frame, builder: MapBuilder, path: Path) -> None:
    x, y = vanished.middles_xy(frame)[0]
    is_one = len(vanished) == 1
    told = "1 group of cells" if is_one else f"{len(vanished)} groups of cells"
    told += f" hit {OFTEN} times and more left nothing occupied within {NEAR} cells; "
    told += "it has" if is_one else "the largest has"
    told += f" {vanished.sizes[0]} cells, around {x:.2f}, {y:.2f}; {builder.advice(vanished)}"
    hint = "--compare shows what each method loses"
    emit_warning(f"{path}: {told}; {hint}", stacklevel=2)
