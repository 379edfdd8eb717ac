"""The methods of mapping compared on files of laser scans."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict
from itertools import combinations
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.checks.difference import STATES, changes_of, confusion_of, states_of
from mapdeal.errors import ParameterError, one_line
from mapdeal.formats.endings import MAPS
from mapdeal.formats.json_values import json_of
from mapdeal.formats.maps import output_paths, write_grid
from mapdeal.formats.png import write_indexed_png
from mapdeal.formats.scans.source import ScanSource
from mapdeal.formats.transaction import Transaction
from mapdeal.grid.frame import Frame
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OCCUPIED
from mapdeal.kernels.components import thickness_of
from mapdeal.mapping.build import METHODS, Method, all_parameters
from mapdeal.mapping.evidence import HitGroups
from mapdeal.pipeline.build import Advance, BuildSettings, Gathered, gather, warn_of_nothing
from mapdeal.pipeline.files import outputs_of
from mapdeal.pipeline.folder import write_picture
from mapdeal.pipeline.settings import Settings
from mapdeal.records import dataclass
from mapdeal.render.difference import difference_image
from mapdeal.render.overlay import RingOverlay
from mapdeal.render.shown import ImageExtent
from mapdeal.version import __version__

_FORMAT = "mapdeal-comparison/1"
DOCUMENT = "comparison.json"
_PER_CELL = 60
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
        gathered = gather(source, settings, options, _PER_CELL, advance)
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
