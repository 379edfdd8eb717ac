"""Distances from the walls of one map to those of another."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.squares import unreachable
from mapdeal.records import dataclass

_Mask = NDArray[np.bool_]

_NEAR = 0.1
"""Metres within which a wall counts as found."""
_ROUNDING = 1e-9


@dataclass(frozen=True)
class WallDistances:
    """Distances of the wall cells of one map to the nearest wall cell of another, metres."""

    n: int
    mean: float | None = None
    median: float | None = None
    p95: float | None = None
    max: float | None = None
    share_lt_0p1: float | None = None
    share_le_0p1: float | None = None


def wall_distances(squares: NDArray[np.signedinteger], resolution: float) -> WallDistances:
    """Return what there is to say of distances.

    Notes
    -----
    Distances are those between cell centres: the root of a whole number of cells, times the
    resolution. The median and the percentile are numpy's (linear). Squares are compared with
    (0.1 / resolution) squared, so that two cells of 0.05 m are exactly 0.1 m.

    Examples
    --------
    >>> found = wall_distances(np.array([0, 1, 4, 9], dtype=np.int32), 0.05)
    >>> found.n, round(found.mean, 3), found.share_lt_0p1, found.share_le_0p1
    (4, 0.075, 0.5, 0.75)
    """
    if not len(squares) or int(squares[0]) == unreachable(squares):
        return WallDistances(len(squares))
    metres = metres_of(squares, resolution)
    limit = (_NEAR / resolution) ** 2
    if math.isclose(limit, round(limit), rel_tol=_ROUNDING):
        limit = round(limit)
    median, p95 = np.percentile(metres, [50, 95])
    return WallDistances(
        len(squares),
        float(metres.mean()),
        float(median),
        float(p95),
        float(metres.max()),
        float(np.count_nonzero(squares < limit) / len(squares)),
        float(np.count_nonzero(squares <= limit) / len(squares)),
    )


def metres_of(squares: NDArray[np.signedinteger], resolution: float) -> NDArray[np.float64]:
    """Return squared distances in cells as metres; infinite where there is nothing to reach."""
    metres = np.sqrt(squares.astype(np.float64))
    metres *= resolution
    metres[squares == unreachable(squares)] = math.inf
    return metres
