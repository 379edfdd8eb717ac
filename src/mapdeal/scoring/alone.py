"""Figures of a map on its own."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame
from mapdeal.kernels.components import thickness_of, touching_groups
from mapdeal.kernels.lookup import histogram
from mapdeal.kernels.threads import CELLS_WORTH_A_THREAD, in_parallel
from mapdeal.records import dataclass
from mapdeal.scoring.comparing import (
    FREE,
    LEAST_ROWS_ALONE,
    OCCUPIED,
    TOGETHER,
    States,
    Values,
    share,
)

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
    """Return the areas that the walls of a map enclose."""
    # Cells that are not occupied and touch over an edge belong together: a wall whose cells touch
    # over corners is closed. What reaches the border of the map is outside. Everything else is
    # enclosed; it counts if it has free cells, so that the inside of a thick wall, unknown
    # throughout, does not. An open door joins two rooms to one area, and one that leads outside
    # opens its room; unknown cells close nothing.
    # Filatov, Filatov, Krinkin, Chen and Molodan, "2D SLAM quality evaluation methods", 2017
    # (arXiv:1708.02354): the number of enclosed areas, there by contours. Walls that are doubled or
    # smeared enclose pockets that the place does not have.
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
        int(np.count_nonzero(is_area)), int(np.count_nonzero(~is_area)), float(sizes[is_area].sum())
    )


def label_sizes(labels: NDArray[np.integer[Any]], count: int) -> NDArray[np.int64]:
    """Return how many cells each label from 0 to `count` has, without a copy of them all."""
    sizes = np.zeros(count + 1, dtype=np.int64)
    step = max(1, _TOGETHER // labels.shape[1])
    for first in range(0, len(labels), step):
        found = np.bincount(labels[first : first + step].ravel())
        sizes[: len(found)] += found
    return sizes


_Floats = NDArray[np.floating[Any]]
_Mask = NDArray[np.bool_]

_SMOOTHING, _AROUND = 1.5, 2.5
"""Standard deviations, in cells: of the walls, and of what is near a cell."""

_SENSITIVITY = 0.1
"""Harris's k."""

_APART = 3
"""Cells up to which of two corners the weaker one is none."""

_LEAST_TRACE = 1e-4
"""A fifteenth of what the end of a slanted line of single cells has."""

_SAME = 1e-5
"""Of responses in 32 bits."""

_HALO = 20
"""Cells from which a cell's response is made, 6 + 1 + 10, and those of cells up to 3 away."""


def corners_of(walls: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return where walls have corners: bends, ends and crossings."""
    # Harris's detector. Walls are 1 and all else is 0, the map's surroundings, too, smoothed by a
    # Gaussian of 1.5 cells; g is the gradient by central differences, and M the mean of g g^T
    # around a cell, weighted by a Gaussian of 2.5 cells. The response is det M - 0.1 (tr M)^2. A
    # corner is where that is above 0, so that g has two directions, the weaker at least an eighth
    # of the stronger, and is the largest within 3 cells. No threshold depends on how strong a
    # response is: thin walls have corners as thick ones have. A thin wall has one at each bend and
    # at each free end; from 9 cells of thickness on the corners of an end are two. What turns
    # within some 10 cells is a corner as well.
    # Harris and Stephens, "A combined corner and edge detector", 1988; Filatov, Filatov, Krinkin,
    # Chen and Molodan, "2D SLAM quality evaluation methods", 2017 (arXiv:1708.02354): the number of
    # corners, which doubled walls raise.
    found = np.zeros(walls.shape, dtype=np.bool_)
    step = max(LEAST_ROWS_ALONE, TOGETHER // walls.shape[1])
    bands = -(-len(walls) // step)

    def some(first: int, end: int) -> None:
        for start in range(first * step, min(end * step, len(walls)), step):
            stop = min(start + step, len(walls))
            found[start:stop] = _corners_in(_with_halo(walls, start, stop))

    if walls.size < CELLS_WORTH_A_THREAD:
        some(0, bands)
    else:
        in_parallel(some, bands)
    return found


def _with_halo(walls: _Mask, start: int, stop: int) -> _Mask:
    """Return rows with what is around them; nothing is beyond the map."""
    height, width = walls.shape
    around = np.zeros((stop - start + 2 * _HALO, width + 2 * _HALO), dtype=np.bool_)
    first, last = max(start - _HALO, 0), min(stop + _HALO, height)
    at = first - start + _HALO
    around[at : at + last - first, _HALO:-_HALO] = walls[first:last]
    return around


def _corners_in(walls: _Mask) -> _Mask:
    core = (slice(_HALO, -_HALO),) * 2
    inner = np.zeros(walls.shape, dtype=np.bool_)
    if not walls.any():
        return inner[core]
    response, trace = _response(walls)
    inner[core] = (response[core] > 0) & (trace[core] > _LEAST_TRACE)
    at = np.flatnonzero(inner)
    flat = response.ravel()
    strongest = flat[at]
    reach = range(-_APART, _APART + 1)
    for row in reach:
        for col in reach:
            if row * row + col * col <= _APART * _APART:
                np.maximum(strongest, flat[at + (row * walls.shape[1] + col)], out=strongest)
    inner.ravel()[at] = flat[at] >= strongest * (1 - _SAME)
    return inner[core]


def _response(walls: _Mask) -> tuple[_Floats, _Floats]:
    """Return Harris's response, and the trace of M."""
    from scipy.ndimage import gaussian_filter

    smooth = gaussian_filter(walls.astype(np.float32), _SMOOTHING, mode="constant")
    down, across = np.zeros_like(smooth), np.zeros_like(smooth)
    np.subtract(smooth[2:], smooth[:-2], out=down[1:-1])
    np.subtract(smooth[:, 2:], smooth[:, :-2], out=across[:, 1:-1])
    down, across = down / 2, across / 2
    both, rows, cols = (
        gaussian_filter(product, _AROUND, mode="constant")
        for product in (down * across, down * down, across * across)
    )
    trace = rows + cols
    return rows * cols - both * both - _SENSITIVITY * trace * trace, trace


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
    """Return what a map says of its own quality."""
    # Filatov, Filatov, Krinkin, Chen and Molodan, "2D SLAM quality evaluation methods", 2017
    # (arXiv:1708.02354): shares of cells, corners and enclosed areas.
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
