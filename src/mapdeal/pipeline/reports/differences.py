"""Where two maps differ, as a report lists it and shows it on the map."""

from __future__ import annotations

import numpy as np

from mapdeal.checks.difference import ADDED, REMOVED, Difference
from mapdeal.grid.display import count_text
from mapdeal.kernels.groups import touching_groups
from mapdeal.report.document import Item

_MOST = 50
"""Groups that are listed of new walls, and of those that are gone."""


def difference_items(found: Difference) -> list[Item]:
    """Return groups of cells that touch where a wall is new, and where one is gone.

    The largest come first. A group is placed at that of its cells which is nearest to its middle.
    """
    return [
        *_groups_of(found, ADDED, "wall added"),
        *_groups_of(found, REMOVED, "wall removed"),
    ]


def _groups_of(found: Difference, kind: int, what: str) -> list[Item]:
    cells, groups = touching_groups(found.changes == kind)
    if not len(cells):
        return []
    sizes = np.bincount(groups)
    items = []
    for group in np.argsort(-sizes, kind="stable")[:_MOST].tolist():
        x, y = found.frame.xy_from_rowcol([_middle(cells[groups == group])])[0].tolist()
        text = f"{what}: {count_text(int(sizes[group]), 'cell')} at {x:.6g}, {y:.6g}"
        items.append(Item("finding", text, "warning", (x, y)))
    left = len(sizes) - _MOST
    if left > 0:
        items.append(Item("finding", f"{what}: {count_text(left, 'smaller group')} not listed"))
    return items


def _middle(cells: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> tuple[int, int]:
    """Return the cell that is nearest to the middle of some."""
    away = np.square(cells - cells.mean(axis=0)).sum(axis=1)
    row, col = cells[int(np.argmin(away))].tolist()
    return row, col
