"""Maps drawn as text, north at the top as people draw them."""

import numpy as np

from mapdeal import OccupancyGrid

_VALUES = {"#": 100, ".": 0, "?": -1, "+": 50}


def cells(text):
    """Return the int8 array of a drawing: # occupied, . free, ? unknown, + 50; row 0 south."""
    rows = [line.strip() for line in text.strip().splitlines()]
    return np.array([[_VALUES[c] for c in row] for row in rows[::-1]], dtype=np.int8)


def grid_from_text(text, resolution=0.25, origin=(1.5, -2.0, 0.4)):
    """Return the map of a drawing; by default nothing about its geometry is 0 or 1."""
    return OccupancyGrid(cells(text), resolution, origin)
