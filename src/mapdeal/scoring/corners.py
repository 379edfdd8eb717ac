"""Corners of walls."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.threads import CELLS_WORTH_A_THREAD, in_parallel
from mapdeal.scoring.memory import LEAST_ROWS_ALONE, TOGETHER

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
    """Return where walls have corners: bends, ends and crossings.

    Notes
    -----
    Harris's detector. Walls are 1 and all else is 0, the map's surroundings, too, smoothed by a
    Gaussian of 1.5 cells; g is the gradient by central differences, and M the mean of g g^T
    around a cell, weighted by a Gaussian of 2.5 cells. The response is det M - 0.1 (tr M)^2. A
    corner is where that is above 0, so that g has two directions, the weaker at least an eighth
    of the stronger, and is the largest within 3 cells. No threshold depends on how strong a
    response is: thin walls have corners as thick ones have. A thin wall has one at each bend
    and at each free end; from 9 cells of thickness on the corners of an end are two. What turns
    within some 10 cells is a corner as well.

    References
    ----------
    Harris and Stephens, "A combined corner and edge detector", 1988; Filatov, Filatov, Krinkin,
    Chen and Molodan, "2D SLAM quality evaluation methods", 2017 (arXiv:1708.02354): the number
    of corners, which doubled walls raise.
    """
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
    """Return the corners of walls, without the halo that is around them."""
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
