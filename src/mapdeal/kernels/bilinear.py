"""Values and slopes between the centres of cells, by bilinear interpolation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name

Floats = NDArray[np.float64]


def interpolate(values: NDArray[np.float32], places_rowcol: Floats) -> tuple[Floats, Floats]:
    """Return the bilinear interpolant of a grid, and its slopes, at places between cells."""
    # Beyond the outermost centres the nearest cells go on, so that the slope across the border is
    # 0. The slopes are those of the interpolant itself: they jump where a line of centres is
    # crossed.
    between = np.empty(len(places_rowcol))
    slopes = np.empty((len(places_rowcol), 2))
    if engine_name() == "compiled":
        from mapdeal.kernels import _compiled

        _compiled.interpolate(
            np.ascontiguousarray(values), np.ascontiguousarray(places_rowcol), between, slopes
        )
        return between, slopes
    height, width = values.shape
    with np.errstate(invalid="ignore"):
        near = np.all((places_rowcol >= -1) & (places_rowcol <= (height + 1, width + 1)), axis=1)
    places = np.where(near[:, np.newaxis], places_rowcol, 0.5)
    south, north, v = _corners(places[:, 0], height - 1)
    west, east, u = _corners(places[:, 1], width - 1)
    a, b = (values[south, col].astype(np.float64) for col in (west, east))
    c, d = (values[north, col].astype(np.float64) for col in (west, east))
    finite = np.isfinite(a) & np.isfinite(b) & np.isfinite(c) & np.isfinite(d)
    with np.errstate(invalid="ignore"):
        between[:] = (1.0 - v) * ((1.0 - u) * a + u * b) + v * ((1.0 - u) * c + u * d)
        slopes[:, 0] = (1.0 - u) * (c - a) + u * (d - b)
        slopes[:, 1] = (1.0 - v) * (b - a) + v * (d - c)
    nearest = values[np.where(v < 0.5, south, north), np.where(u < 0.5, west, east)]
    between[~finite] = nearest[~finite]
    slopes[~finite] = np.nan
    between[~near] = np.nan
    slopes[~near] = np.nan
    return between, slopes


def _corners(
    places: Floats, last: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:  # fmt: skip
    """Return the indices that places lie between, within the grid, and the share of the way."""
    from_centre = places - 0.5
    below = np.floor(from_centre)
    index = below.astype(np.int64)
    return np.clip(index, 0, last), np.clip(index + 1, 0, last), from_centre - below
