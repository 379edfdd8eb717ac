"""Part of the map frame that a page shows initially."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mapdeal.grid.frame import Frame
from mapdeal.kernels.blocks import blocks_of
from mapdeal.report.document import Item, PageLayer

_MARGIN = 0.04
"""Of the longer side: what is shown around the known cells."""

_UNKNOWN = 255
"""Of maps and of costs, as bytes."""


def extent_of(
    layers: Sequence[PageLayer], items: Sequence[Item]
) -> tuple[float, float, float, float] | None:
    """Return the box in the map frame of the known cells of all layers, and of all items."""
    points = []
    seen: set[Frame] = set()
    for layer in layers:
        if layer.frame not in seen and layer.style.labels.get(_UNKNOWN) == "unknown":
            seen.add(layer.frame)
            box = _known_box(layer)
            if box is not None:
                points.append(layer.frame.xy_from_continuous_rowcol(_corners(*box)))
    if not points:
        return None
    for item in items:
        points += [line for line in item.lines if len(line)]
        if item.place is not None:
            points.append(np.array([item.place], dtype=np.float64))
    every = np.vstack(points)
    low, high = every.min(axis=0), every.max(axis=0)
    margin = _MARGIN * float((high - low).max())
    left, bottom = (low - margin).tolist()
    right, top = (high + margin).tolist()
    return left, bottom, right, top


def _corners(row: int, col: int, end_row: int, end_col: int) -> list[tuple[int, int]]:
    return [(r, c) for r in (row, end_row) for c in (col, end_col)]


def _known_box(layer: PageLayer) -> tuple[int, int, int, int] | None:
    """Return the first row and column with known cells, and those behind the last."""
    rows: list[int] = []
    cols = np.zeros(layer.frame.width, dtype=np.bool_)
    for block in blocks_of(layer.values):
        known = layer.values[block] != _UNKNOWN
        rows += (block.start + np.flatnonzero(known.any(axis=1))).tolist()
        cols |= known.any(axis=0)
    if not rows:
        return None
    columns = np.flatnonzero(cols)
    return rows[0], int(columns[0]), rows[-1] + 1, int(columns[-1]) + 1
