"""What a map file holds, as figures."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.formats.map_yaml import Dialect
from mapdeal.formats.maps import read_source
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.values import UNKNOWN
from mapdeal.pipeline.memory import claim_work

_OF_POTENTIAL, _OF_OTHERS = 33.0, 2.0
"""Bytes for each cell that figures take; those of a potential are of layers that it does not have
until they are asked for."""

_SHOWN_KEYS = ("image", "mode", "negate", "occupied_thresh", "free_thresh")


def describe_file(
    path: Path, *, dialect: Dialect = "nav2", max_cells: int | None = None
) -> dict[str, Any]:
    """Return what there is to know of a map, costmap or field, as JSON can hold it.

    ``known_box`` is row, column, height and width of the known cells' bounding box, row 0 in
    the south; ``sha256`` is of the layer's bytes in that order.
    """
    source = read_source(path, dialect=dialect, max_cells=max_cells)
    grid = source.grid
    claim_work(path, grid, _OF_POTENTIAL if isinstance(grid, PotentialField) else _OF_OTHERS)
    report: dict[str, Any] = {"file": str(path), "kind": grid.kind}
    report |= {name: getattr(grid, name) for name in grid.parameter_names}
    report |= grid.figures()
    if source.metadata is not None:
        report["dialect"] = dialect
        report |= {key: getattr(source.metadata, key) for key in _SHOWN_KEYS}
    if not isinstance(grid, Costmap):
        report["known_box"] = _known_box(grid.occupancy)
    report["sha256"] = hashlib.sha256(grid.layer.data).hexdigest()
    return report


def _known_box(occupancy: Any) -> list[int] | None:
    known = occupancy != UNKNOWN
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if rows.size == 0:
        return None
    row, col = int(rows[0]), int(cols[0])
    return [row, col, int(rows[-1]) - row + 1, int(cols[-1]) - col + 1]
