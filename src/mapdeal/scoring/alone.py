"""The score of a map on its own: what needs no truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame
from mapdeal.kernels.groups import touching_groups
from mapdeal.kernels.lookup import histogram
from mapdeal.kernels.thickness import thickness_of
from mapdeal.records import dataclass
from mapdeal.scoring.compare import Values
from mapdeal.scoring.corners import corners_of
from mapdeal.scoring.enclosed import enclosed_areas, label_sizes
from mapdeal.scoring.overlap import share
from mapdeal.scoring.states import OCCUPIED, States

LEAST_PIECE = 5
"""Cells below which a piece of wall is a speck."""


@dataclass(frozen=True)
class Thickness:
    """Thickness of the walls at each of their cells, metres; None if there are no walls."""

    mean: float | None = None
    median: float | None = None
    p95: float | None = None
    max: float | None = None


def score_alone(states: States, frame: Frame) -> Values:
    """Return what a map says of its own quality.

    References
    ----------
    Filatov, Filatov, Krinkin, Chen and Molodan, "2D SLAM quality evaluation methods", 2017
    (arXiv:1708.02354): shares of cells, corners and enclosed areas.
    """
    unknown, free, occupied = histogram(states)[: OCCUPIED + 1].tolist()
    walls = states == OCCUPIED
    sizes = _pieces(walls)
    thick = thickness_of(states == OCCUPIED)
    corners = touching_groups(corners_of(walls))[1]
    enclosed = enclosed_areas(states, frame.resolution)
    return {
        "cells": list(frame.shape),
        "resolution_m": frame.resolution,
        "share_occupied": share(occupied, states.size),
        "share_free": share(free, states.size),
        "share_unknown": share(unknown, states.size),
        "share_occupied_of_known": share(occupied, occupied + free),
        "wall_cells": occupied,
        "wall_pieces": int(np.count_nonzero(sizes >= LEAST_PIECE)),
        "specks": int(np.count_nonzero(sizes < LEAST_PIECE)),
        "wall_thickness_m": vars(_thickness(thick, frame.resolution)),
        "share_one_cell_thick": share(int(np.count_nonzero(thick == 1)), len(thick)),
        "corners": int(corners.max() + 1) if len(corners) else 0,
        "enclosed_areas": enclosed.areas,
        "enclosed_pockets": enclosed.pockets,
        "enclosed_m2": enclosed.square_metres,
    }


def _pieces(walls: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the sizes of pieces of wall, and take the specks out of `walls`."""
    from scipy.ndimage import label

    labels, count = label(walls, np.ones((3, 3)))
    sizes = label_sizes(labels, count)
    sizes[0] = 0
    walls &= (sizes >= LEAST_PIECE)[labels]
    return sizes[sizes > 0]


def _thickness(cells: NDArray[np.int64], resolution: float) -> Thickness:
    if not len(cells):
        return Thickness()
    median, p95 = np.percentile(cells, [50, 95])
    figures = (cells.mean(), median, p95, cells.max())  # of whole numbers, in whatever order
    return Thickness(*(float(figure * resolution) for figure in figures))
