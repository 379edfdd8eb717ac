"""Differences between the maps in two files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mapdeal.checks.selection import (
    STATES,
    Bound,
    Bounds,
    Difference,
    WallShift,
    compare,
    frame_around,
)
from mapdeal.errors import emit_warning, one_line
from mapdeal.files.budget import claim
from mapdeal.grid.values import OCCUPIED
from mapdeal.kernels.lookup import histogram
from mapdeal.kernels.threads import use_threads
from mapdeal.maps.png import write_indexed_png
from mapdeal.maps.reading import Source, as_occupancy
from mapdeal.pictures.comparisons import difference_image
from mapdeal.pipeline.inputs import bytes_of, errors_named, outputs_of, read_together
from mapdeal.pipeline.settings import Settings

_PER_CELL, _PER_WALL = 30, 75
"""Bytes for each cell of a grid around both maps, and for each occupied cell of one."""

NO_BOUNDS = Bounds()
"""Of a comparison that only equal maps pass."""

_METADATA = ("mode", "negate", "occupied_thresh", "free_thresh", "cost_scale")


@dataclass(frozen=True)
class ComparedMap:
    """A map that was compared."""

    file: str
    sha256: Mapping[str, str]

    @classmethod
    def of(cls, path: Path, source: Source) -> ComparedMap:
        return cls(str(path), dict(source.sums))


@dataclass(frozen=True)
class DiffReport:
    """Differences between two maps and between their YAML files.

    Parameters
    ----------
    found : Difference
        Differences between the cells.
    metadata : dict
        Both values of each key that differs between the YAML files.
    bounds : tuple of Bound
        Bounds on the difference; empty if none were set.
    maps : tuple of ComparedMap
        The first map and the second; empty if they were not files.
    """

    found: Difference
    metadata: dict[str, tuple[Any, Any]]
    bounds: tuple[Bound, ...] = ()
    maps: tuple[ComparedMap, ...] = ()

    @property
    def passes(self) -> bool:
        """Whether all bounds hold; without any, whether the maps are equal."""
        return all(bound.holds for bound in self.bounds) if self.bounds else self.found.is_equal

    def document(self) -> dict[str, Any]:
        """Return the report as values that JSON can represent."""
        found = self.found
        first, second = map(asdict, self.maps) if self.maps else (None, None)
        return {
            "first": first,
            "second": second,
            "equal": found.is_equal,
            "geometry": {name: list(pair) for name, pair in found.geometry.items()},
            "metadata": {name: list(pair) for name, pair in self.metadata.items()},
            "common_cells": found.common,
            "differing": found.differing,
            "beyond_tolerance": found.beyond,
            "known_only_in_first": found.not_compared,
            "confusion": {
                state: dict(zip(STATES, row, strict=True))
                for state, row in zip(STATES, found.confusion.tolist(), strict=True)
            },
            "symmetry": found.symmetry,
            "walls": {
                "first_to_second": _listed(found.walls[0]),
                "second_to_first": _listed(found.walls[1]),
            },
            "bounds": {
                bound.name.replace("-", "_"): {
                    "allowed": bound.allowed,
                    "found": bound.found if math.isfinite(bound.found) else None,
                    "holds": bound.holds,
                }
                for bound in self.bounds
            },
            "passes": self.passes,
        }


def diff_files(
    first: Path,
    second: Path,
    options: Settings,
    *,
    tolerance: float = 0.0,
    bounds: Bounds = NO_BOUNDS,
) -> DiffReport:
    """Return what differs between the maps in two files; draw it if a picture is asked for."""
    sources = read_together((first, second), options)
    grids = [
        as_occupancy(source.grid, path)
        for source, path in zip(sources, (first, second), strict=True)
    ]
    with options.memory(), errors_named(second):
        frame = frame_around(*(grid.frame for grid in grids))
        cells = frame.height * frame.width
        walls = sum(int(histogram(grid.occupancy)[OCCUPIED]) for grid in grids)
        held = sum(bytes_of(source.grid) for source in sources)
        claim(
            second,
            held + _PER_CELL * cells + _PER_WALL * walls,
            what=f"{frame.width} x {frame.height} cells",
        )
    files = [file for source in sources for file in source.files]
    with outputs_of([], files, options) as transaction:
        with use_threads(options.threads), errors_named(second):
            found = compare(*grids, tolerance=tolerance)
        if bounds and found.not_compared:
            text = f"does not cover {found.not_compared} known cells of {first}"
            emit_warning(f"{second}: {text}, which are not compared", stacklevel=2)
        if options.image is not None:
            title = one_line(f"{first.stem} and {second.stem}: what differs")
            image = difference_image(
                found.changes, found.frame, title=title, image_extent=options.image_extent
            )
            transaction.write(
                options.image, lambda file: write_indexed_png(file, image.indices, image.palette)
            )
    maps = tuple(map(ComparedMap.of, (first, second), sources))
    return DiffReport(found, _metadata(*sources), bounds.judged(found), maps)


def _metadata(first: Source, second: Source) -> dict[str, tuple[Any, Any]]:
    a, b = first.metadata, second.metadata
    if a is None or b is None:
        return {}
    pairs = {name: (getattr(a, name), getattr(b, name)) for name in _METADATA}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def _listed(shift: WallShift | None) -> dict[str, float] | None:
    return None if shift is None else asdict(shift)
