"""Exact Euclidean distances between cell centres.

Squares of distances are whole numbers of cells, and are kept so until the last step. The engine
(see `mapdeal.kernels.engine`) makes no difference to any result.
"""

from __future__ import annotations

import math
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.column_runs import Halo
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.squares import SquaredDistances


def squared_distance(
    marked: NDArray[np.bool_], *, limit: int | None = None
) -> SquaredDistances:  # fmt: skip
    """Return each cell's squared distance to the nearest marked cell."""
    _check_limit(limit)
    return _engine(marked).squares(marked, both_kinds=False, limit=limit)  # type: ignore[no-any-return]


def signed_squared_distance(
    occupied: NDArray[np.bool_], *, limit: int | None = None
) -> SquaredDistances:  # fmt: skip
    """Return each cell's squared distance to the nearest cell of the other kind."""
    _check_limit(limit)
    return _engine(occupied).squares(occupied, both_kinds=True, limit=limit)  # type: ignore[no-any-return]


def signed_distance(
    occupied: NDArray[np.bool_],
    *,
    scale: float = 1.0,
    outside_shift: float = 0.0,
    inside_shift: float = 0.0,
    clip: float = math.inf,
    gain: float = 1.0,
    halo: Halo | None = None,
) -> NDArray[np.float32]:
    """Return each cell's signed distance to the nearest cell of the other kind."""
    height = len(occupied) if halo is None else halo.height
    return _engine(occupied, height).metres(  # type: ignore[no-any-return]
        occupied,
        scale=scale,
        outside_shift=outside_shift,
        inside_shift=inside_shift,
        clip=clip,
        gain=gain,
        halo=halo,
    )


def bytes_by_distance(
    marked: NDArray[np.bool_], table: NDArray[np.uint8]
) -> NDArray[np.uint8]:  # fmt: skip
    """Return for each cell what a table says of its squared distance to the nearest marked cell."""
    if len(table) < 2:
        raise ValueError("the table needs at least two entries")
    table = np.ascontiguousarray(table, dtype=np.uint8)
    return _engine(marked).bytes_of_squares(marked, table)  # type: ignore[no-any-return]


def _check_limit(limit: int | None) -> None:
    if limit is not None and limit < 0:
        raise ValueError(f"limit must be at least 0, not {limit}")


def _engine(marked: NDArray[np.bool_], height: int = 0) -> ModuleType:
    """Return the module that serves for a grid, or a part of a grid of some height."""
    if marked.dtype != np.bool_ or marked.ndim != 2:
        rule = f"a mask must be a bool array with two axes, not {marked.ndim} of {marked.dtype}"
        raise ValueError(rule)
    if engine_name() == "compiled" and marked.size > 0:
        from mapdeal.kernels import compiled_distance

        if max(*marked.shape, height) <= compiled_distance.longest_side():
            return compiled_distance
    from mapdeal.kernels import scipy_distance

    return scipy_distance
