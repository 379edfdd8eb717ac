"""A map from files of laser scans."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.checks.selection import STATES, changes_of, confusion_of, states_of
from mapdeal.errors import MalformedInputError, ParameterError, emit_warning, one_line
from mapdeal.files.budget import claim
from mapdeal.files.json_values import json_of
from mapdeal.files.source import MAPS, check_state, is_regular, state_of
from mapdeal.files.transaction import Transaction
from mapdeal.grid.frame import Frame, Point
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OCCUPIED
from mapdeal.kernels.components import thickness_of
from mapdeal.mapping.beams import BeamCounts, BeamLimits, Beams, Scans, beams_of
from mapdeal.mapping.build import (
    METHODS,
    BuiltMap,
    Extent,
    MapBuilder,
    Method,
    all_parameters,
    frame_of,
    reach_behind,
)
from mapdeal.mapping.evidence import NEAR, OFTEN, HitGroups
from mapdeal.maps.npz import write_npz
from mapdeal.maps.png import write_indexed_png
from mapdeal.maps.reading import output_paths, write_grid
from mapdeal.pictures.comparisons import difference_image
from mapdeal.pictures.overlay import ImageExtent, RingOverlay
from mapdeal.pipeline.folder import write_picture
from mapdeal.pipeline.inputs import add_picture, errors_named, outputs_of
from mapdeal.pipeline.settings import Settings
from mapdeal.sensors.scans import ScanSource
from mapdeal.version import __version__

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


_FORMAT = "mapdeal-comparison/1"
DOCUMENT = "comparison.json"
_COMPARE_PER_CELL = 60
"""Bytes for each cell: the evidence of all methods, and the map that is made of one of them."""

_MOST_PLACES = 100
_STATES = STATES[:3]
"""States of a cell; there is none for values 1..99, since values are not compared."""


@dataclass(frozen=True, eq=False)
class MethodResult:
    """Result of one mapping method."""

    grid: OccupancyGrid
    vanished: HitGroups
    bytes_per_cell: int
    seconds: float


@dataclass(frozen=True)
class Comparison:
    """Comparison of several mapping methods on the same scans."""

    document: dict[str, Any]
    seconds: dict[Method, float]

    def timed_document(self) -> dict[str, Any]:
        """Return the figures of the document with the seconds of each method."""
        methods = {
            method: {**figures, "seconds": round(self.seconds[method], 4)}
            for method, figures in self.document["methods"].items()
        }
        return {**self.document, "methods": methods}


def compare_methods(
    source: ScanSource,
    folder: Path,
    settings: BuildSettings,
    options: Settings,
    *,
    advance: Advance = lambda _: None,
) -> Comparison:
    """Make maps of scans by several methods on one grid; write them, and what differs."""
    if folder.suffix in (*MAPS, ".pgm", ".png", ".json"):
        rule = "must be a folder: a comparison writes several maps"
        raise ParameterError(rule, source="--output", got=str(folder))
    methods = tuple(settings.methods)
    pairs = tuple(combinations(methods, 2))
    outputs = [path for method in methods for path in _files_of(folder, method)]
    outputs += [_picture_of(folder, pair) for pair in pairs]
    shown = options.image_extent
    with outputs_of([*outputs, folder / DOCUMENT], source.files, options) as transaction:
        gathered = gather(source, settings, options, _COMPARE_PER_CELL, advance)
        hit_cells, groups = next(iter(gathered.builders.values())).hit_groups()
        made = _results(gathered)
        warn_of_nothing(made[methods[0]].grid, source.named)
        name = Path(source.named.name.removesuffix(".gz")).stem
        for method, result in made.items():
            write_grid(transaction, folder / f"{method}.yaml", result.grid)
            count = len(result.vanished)
            rings = RingOverlay(
                result.vanished.middles_xy(result.grid.frame),
                "hits that vanished",
                f"{count} group{'' if count == 1 else 's'} of hits vanished",
            )
            path, title = folder / f"{method}.png", one_line(f"{name}: {method}")
            write_picture(transaction, path, result.grid, title, image_extent=shown, overlay=rings)
        found = []
        for pair in pairs:
            first, second = (states_of(made[method].grid.occupancy) for method in pair)
            found.append(_pair_figures(pair, first, second))
            path, title = _picture_of(folder, pair), f"{name}: {pair[0]} and {pair[1]}"
            frame = made[pair[0]].grid.frame
            _write_difference(
                transaction, path, pair, frame, first, second, title=title, image_extent=shown
            )
        document = {
            "format": _FORMAT,
            "version": __version__,
            "inputs": [file.name for file in source.files],
            "limits": asdict(settings.limits),
            **_lattice(made[methods[0]].grid),
            **asdict(gathered.counts),
            "cells_hit_three_times": hit_cells,
            "groups_hit_three_times": len(groups),
            "methods": {
                method: {
                    "parameters": all_parameters(method, settings.methods[method]),
                    **_method_figures(result),
                }
                for method, result in made.items()
            },
            "pairs": found,
        }
        transaction.write_bytes(folder / DOCUMENT, json_of(document))
    return Comparison(document, {method: result.seconds for method, result in made.items()})


def _files_of(folder: Path, method: Method) -> list[Path]:
    return [*output_paths(folder / f"{method}.yaml"), folder / f"{method}.png"]


def _picture_of(folder: Path, pair: tuple[Method, Method]) -> Path:
    return folder / f"{pair[0]}_{pair[1]}.png"


def _results(gathered: Gathered) -> dict[Method, MethodResult]:
    """Return the maps; what a method has gathered is let go of when its map is made."""
    made = {}
    # the method whose evidence is largest comes first, so that it is gone when others need room
    order = sorted(gathered.builders, key=lambda m: -gathered.builders[m].bytes_per_cell)
    for method in order:
        builder, started = gathered.builders.pop(method), time.perf_counter()
        built = builder.result(with_layers=False)
        seconds = gathered.seconds[method] + time.perf_counter() - started
        made[method] = MethodResult(built.grid, built.vanished, builder.bytes_per_cell, seconds)
        del builder, built
    return {method: made[method] for method in METHODS if method in made}


def _lattice(grid: OccupancyGrid) -> dict[str, Any]:
    height, width = grid.shape
    return {
        "width": width, "height": height, "resolution": grid.resolution,
        "origin": list(grid.origin),
    }  # fmt: skip


def _method_figures(result: MethodResult) -> Figures:
    grid, vanished = result.grid, result.vanished
    figures = grid.figures()
    thickness = thickness_of(grid.occupancy == OCCUPIED)
    one_wide = int(np.count_nonzero(thickness == 1))
    mean = float(thickness.mean()) if len(thickness) else None
    return {
        **{state: figures[state] for state in _STATES},
        "one_cell_wide": one_wide,
        "one_cell_wide_share": round(one_wide / len(thickness), 6) if len(thickness) else None,
        "mean_thickness_cells": None if mean is None else round(mean, 6),
        "mean_thickness_m": None if mean is None else round(mean * grid.resolution, 6),
        "vanished_groups": len(vanished),
        "vanished_cells": len(vanished.cells),
        "vanished": list(_places(result)),
        "bytes_per_cell": result.bytes_per_cell,
        "memory_bytes": result.bytes_per_cell * grid.occupancy.size,
    }


def _places(result: MethodResult) -> Iterator[dict[str, Any]]:
    middles = result.vanished.middles_xy(result.grid.frame)[:_MOST_PLACES].tolist()
    for (x, y), cells in zip(middles, result.vanished.sizes.tolist(), strict=False):
        yield {"x": round(x, 4), "y": round(y, 4), "cells": cells}


def _pair_figures(
    pair: tuple[Method, Method], first: NDArray[np.uint8], second: NDArray[np.uint8]
) -> Figures:
    table = confusion_of(first, second)[:3, :3]
    return {
        "first": pair[0],
        "second": pair[1],
        "differing": int(table.sum() - table.trace()),
        "cells": {
            state: dict(zip(_STATES, row, strict=True))
            for state, row in zip(_STATES, table.tolist(), strict=True)
        },
    }


def _write_difference(
    transaction: Transaction,
    path: Path,
    pair: tuple[Method, Method],
    frame: Frame,
    first: NDArray[np.uint8],
    second: NDArray[np.uint8],
    *,
    title: str,
    image_extent: ImageExtent,
) -> None:
    def write(file: BinaryIO) -> None:
        changes = changes_of(first, second, np.ones(first.shape, dtype=np.bool_))
        image = difference_image(
            changes, frame, title=one_line(title), image_extent=image_extent, only_in=pair
        )
        write_indexed_png(file, image.indices, image.palette)

    transaction.write(path, write)
