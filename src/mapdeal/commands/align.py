"""Where the map in one file lies in the frame of the map in another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.checks.selection import frame_around
from mapdeal.commands.diff import ComparedMap
from mapdeal.compare.align import Alignment, align, bytes_to_align
from mapdeal.errors import one_line
from mapdeal.files.budget import claim
from mapdeal.files.json_values import ALIGNMENT_FORMAT, json_of
from mapdeal.grid.frame import Transform
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.resample import obstacles_in, sampled
from mapdeal.kernels.threads import use_threads
from mapdeal.maps.png import write_indexed_png
from mapdeal.maps.reading import as_occupancy
from mapdeal.pictures.canvas import Image
from mapdeal.pictures.comparisons import difference_image
from mapdeal.pictures.styles import alignment_style
from mapdeal.pipeline.inputs import bytes_of, errors_named, outputs_of, read_together
from mapdeal.pipeline.settings import Settings
from mapdeal.sensors.points import transform_document

_OF_PICTURE = 16
"""Bytes for each cell of both maps while one is drawn on the other."""

_UNKNOWN, _FREE = 1, 2
"""Kinds of cells in a picture: 3 is a wall of the first map, 4 of the second, 5 of both."""


@dataclass(frozen=True)
class AlignReport:
    """Where a map lies in the frame of another."""

    found: Alignment
    maps: tuple[ComparedMap, ComparedMap]

    def document(self) -> dict[str, Any]:
        """Return the report as JSON can hold it."""
        # The transform stands in it as in a file that is written by hand, x, y and yaw at the top,
        # and once more as an object of its own, as that of the runner-up does.
        found, (first, second) = self.found, map(asdict, self.maps)
        other = found.runner_up_transform
        return {
            "format": ALIGNMENT_FORMAT,
            "first": first,
            "second": second,
            "same_place": found.same_place,
            "reason": found.reason,
            **transform_document(found.transform),
            "transform": transform_document(found.transform),
            "score": found.score,
            "runner_up": found.runner_up,
            "runner_up_transform": None if other is None else transform_document(other),
            "overlap": found.overlap,
            "agreement": found.agreement,
        }


def align_files(
    first: Path,
    second: Path,
    options: Settings,
    *,
    output: Path | None = None,
    prior: Transform | None = None,
    rotations: Sequence[float] | None = None,
) -> AlignReport:
    """Return where the map in a file lies in the frame of the map in another."""
    sources = read_together((first, second), options)
    own, other = (
        as_occupancy(source.grid, path)
        for source, path in zip(sources, (first, second), strict=True)
    )
    with options.memory():
        _claim(second, (own, other), sum(bytes_of(source.grid) for source in sources), options)
    outputs = [] if output is None else [output]
    files = [file for source in sources for file in source.files]
    with outputs_of(outputs, files, options) as transaction:
        with use_threads(options.threads), errors_named(second):
            found = align(own, other, prior=prior, rotations=rotations)
        maps = ComparedMap.of(first, sources[0]), ComparedMap.of(second, sources[1])
        report = AlignReport(found, maps)
        if output is not None:
            transaction.write_bytes(output, json_of(report.document()))
        if options.image is not None:
            with errors_named(first):
                image = alignment_image(own, other, found, (first.stem, second.stem), options)
            transaction.write(
                options.image, lambda file: write_indexed_png(file, image.indices, image.palette)
            )
    return report


def alignment_image(
    first: OccupancyGrid,
    second: OccupancyGrid,
    found: Alignment,
    names: tuple[str, str],
    options: Settings,
) -> Image:
    """Return a picture of the first map at its place over the second, on the second's cells."""
    moved = found.transform.frame(first.frame)
    lattice = frame_around(second.frame, moved)
    kinds = np.full(lattice.shape, _UNKNOWN, dtype=np.uint8)
    walls = np.zeros(lattice.shape, dtype=np.uint8)
    for k, (grid, frame) in enumerate(((first, moved), (second, second.frame))):
        values, is_inside = sampled(lattice, grid.occupancy, frame)
        kinds[is_inside & (values >= 0)] = _FREE
        walls += obstacles_in(lattice, grid.occupied(), frame) * np.uint8(k + 1)
    np.add(walls, _FREE, out=kinds, where=walls > 0)
    verdict = "the same place" if found.same_place else "not sure"
    named = names if names[0] != names[1] else ("the first map", "the second map")
    shown = one_line(named[0]), one_line(named[1])
    return difference_image(
        kinds,
        lattice,
        title=f"{shown[0]} on {shown[1]}: {verdict}",
        image_extent=options.image_extent,
        style=alignment_style(shown),
    )


def _claim(path: Path, grids: Sequence[OccupancyGrid], held: int, options: Settings) -> None:
    """Refuse what takes too much memory."""
    sizes = [grid.shape[0] * grid.shape[1] for grid in grids]
    needed = bytes_to_align(sizes)
    if options.image is not None:
        needed = max(needed, _OF_PICTURE * sum(sizes))
    claim(path, held + needed, what=f"maps of {sizes[0]} and {sizes[1]} cells")
