"""Areas that walls enclose."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.scoring.states import FREE, OCCUPIED, States

LEAST_AREA = 0.25
"""Square metres of free cells below which what is enclosed is a pocket, not an area."""

_ROUNDING = 1e-9
_TOGETHER = 1 << 20


class Enclosed(NamedTuple):
    """Areas enclosed by walls."""

    areas: int
    pockets: int
    square_metres: float


def enclosed_areas(states: States, resolution: float) -> Enclosed:
    """Return the areas that the walls of a map enclose.

    Notes
    -----
    Cells that are not occupied and touch over an edge belong together: a wall whose cells touch
    over corners is closed. What reaches the border of the map is outside. Everything else is
    enclosed; it counts if it has free cells, so that the inside of a thick wall, unknown
    throughout, does not. An open door joins two rooms to one area, and one that leads outside
    opens its room; unknown cells close nothing.

    References
    ----------
    Filatov, Filatov, Krinkin, Chen and Molodan, "2D SLAM quality evaluation methods", 2017
    (arXiv:1708.02354): the number of enclosed areas, there by contours. Walls that are doubled
    or smeared enclose pockets that the place does not have.
    """
    from scipy.ndimage import label

    labels, count = label(states != OCCUPIED)
    border = np.unique(np.concatenate((labels[0], labels[-1], labels[:, 0], labels[:, -1])))
    labels *= states == FREE
    free = label_sizes(labels, count)
    free[border] = 0
    free[0] = 0
    sizes = free[free > 0] * resolution**2
    is_area = sizes >= LEAST_AREA * (1 - _ROUNDING)
    return Enclosed(
        int(np.count_nonzero(is_area)),
        int(np.count_nonzero(~is_area)),
        float(sizes[is_area].sum()),
    )


def label_sizes(labels: NDArray[np.integer[Any]], count: int) -> NDArray[np.int64]:
    """Return how many cells each label from 0 to `count` has, without a copy of them all."""
    sizes = np.zeros(count + 1, dtype=np.int64)
    step = max(1, _TOGETHER // labels.shape[1])
    for first in range(0, len(labels), step):
        found = np.bincount(labels[first : first + step].ravel())
        sizes[: len(found)] += found
    return sizes
