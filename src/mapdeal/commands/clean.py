"""Maps cleaned of small components, file to file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.checks.selection import STATES, changes_of, states_of
from mapdeal.editing.clean import Cleaned, clean
from mapdeal.errors import one_line
from mapdeal.files.transaction import Transaction
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.maps.png import write_indexed_png
from mapdeal.maps.reading import output_paths, write_grid
from mapdeal.pictures.comparisons import difference_image
from mapdeal.pictures.styles import cleaning_style
from mapdeal.pipeline.inputs import errors_named, outputs_of, read_summed
from mapdeal.pipeline.settings import Settings

_PER_CELL, _LIBRARY = 16, 25_000_000
"""Bytes for each cell: a label of 4, sizes of up to half as many components, and masks. Beside
them, those of the library that labels components."""

_FILLED = 7
"""Of the picture: unknown cells that are now free; see `cleaning_style`."""


@dataclass(frozen=True, eq=False)
class CleanReport:
    """A map that was cleaned, and what has changed."""

    file: str
    sha256: Mapping[str, str]
    limits: Mapping[str, int]
    cleaned: Cleaned

    def document(self) -> dict[str, Any]:
        return {
            "map": {"file": self.file, "sha256": dict(self.sha256)},
            "limits": dict(self.limits),
            **self.cleaned.counts.document(),
        }


def clean_file(
    path: Path, output: Path, settings: Settings, limits: Mapping[str, int]
) -> CleanReport:
    """Read a map, remove its small components, and write it."""
    outputs = output_paths(output)
    source = read_summed(path, settings, _PER_CELL, _LIBRARY)
    with outputs_of(outputs, source.files, settings) as transaction:
        with errors_named(path):
            cleaned = clean(source.grid, **limits)  # type: ignore[arg-type]  # which refuses others
        extra = dict(source.metadata.extra) if source.metadata else {}
        write_grid(transaction, output, cleaned.grid, extra=extra)
        if settings.image is not None and isinstance(source.grid, OccupancyGrid):
            title = one_line(f"{path.stem}: cleaned")
            _draw(transaction, settings.image, settings, title, source.grid, cleaned.grid)
    return CleanReport(str(path), source.sums, limits, cleaned)


def _draw(
    transaction: Transaction,
    path: Path,
    settings: Settings,
    title: str,
    before: OccupancyGrid,
    after: OccupancyGrid,
) -> None:
    """Draw the cleaned map, with the cells that have changed in colours of their own."""
    was, now = (states_of(np.asarray(grid.occupancy)) for grid in (before, after))
    changes = changes_of(was, now, np.ones(before.shape, dtype=np.bool_))
    changes[(was == STATES.index("unknown")) & (now == STATES.index("free"))] = _FILLED
    picture = difference_image(
        changes,
        before.frame,
        title=title,
        image_extent=settings.image_extent,
        style=cleaning_style(),
    )
    transaction.write(path, lambda file: write_indexed_png(file, picture.indices, picture.palette))
