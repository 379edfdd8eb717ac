"""The cost curve of a rule on the 0..100 view of a distance field."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.cost_curve import CostCurve, squares_up_to
from mapdeal.grid.field_view import ViewScale
from mapdeal.grid.values import OCCUPIED


def view_curve(
    scale: ViewScale,
    strength: float,
    resolution: float,
    table: NDArray[np.int8],
    thresholds: Mapping[str, float],
) -> CostCurve:
    """Return the cost curve of a table of costs by values of the view.

    Parameters
    ----------
    scale : ViewScale
        How distances become the view.
    strength : float
        Factor of the field's distances.
    resolution : float
        Side of a cell, metres.
    table : numpy.ndarray of int8, shape (256,)
        The cost of each value, 0 for a view of 0.
    thresholds : mapping of str to float
        Values of the view, of which the farthest distance above each is marked.
    """
    cells = np.sqrt(squares_up_to(scale.end / strength / resolution + 1))
    view = scale.values_of(strength * (cells * resolution), resolution).astype(np.uint8)
    cost = table[view]
    cost[0] = OCCUPIED
    marks = []
    for name, value in thresholds.items():
        above = np.flatnonzero(view > value)
        if len(above):
            marks.append((f"{name}, view {value:g}", float(cells[above[-1]] * resolution)))
    end = int(np.flatnonzero(cost)[-1]) + 1
    return CostCurve(resolution, cells[:end], cost[:end], "occupancy", marks=tuple(marks))
