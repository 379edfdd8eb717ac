"""States of cells in a score: unknown, free or occupied."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.values import FREE as FREE_VALUE
from mapdeal.grid.values import OCCUPIED as OCCUPIED_VALUE
from mapdeal.kernels.lookup import look_up

States = NDArray[np.uint8]
"""`UNKNOWN`, `FREE` or `OCCUPIED`, shape (H, W)."""

UNKNOWN, FREE, OCCUPIED = 0, 1, 2


def states_of(values: NDArray[np.int8]) -> States:
    """Return what cells are.

    Examples
    --------
    >>> states_of(np.array([[-1, 0, 1, 99, 100]], np.int8)).tolist()
    [[0, 1, 0, 0, 2]]
    """
    table = np.full(256, UNKNOWN, dtype=np.uint8)
    table[[FREE_VALUE, OCCUPIED_VALUE]] = FREE, OCCUPIED
    states: States = look_up(values, table)
    return states
