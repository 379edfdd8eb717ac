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
    """Return each cell's squared distance to the nearest marked cell.

    Parameters
    ----------
    marked : numpy.ndarray of bool, shape (H, W)
        The cells to measure to.
    limit : int, optional
        The largest square of interest, at least 0; cells beyond count as unreachable, which
        makes a small limit fast.

    Returns
    -------
    numpy.ndarray of int32 or int64, shape (H, W)
        Squares of cells; 0 on marked cells; `mapdeal.kernels.squares.unreachable` where no
        marked cell is within the limit. int64 if a side is longer than 32,767 cells.

    Examples
    --------
    >>> squared_distance(np.array([[True, False, False], [False, False, False]]))
    array([[0, 1, 4],
           [1, 2, 5]], dtype=int32)
    """
    _check_limit(limit)
    return _engine(marked).squares(marked, both_kinds=False, limit=limit)  # type: ignore[no-any-return]


def signed_squared_distance(
    occupied: NDArray[np.bool_], *, limit: int | None = None
) -> SquaredDistances:  # fmt: skip
    """Return each cell's squared distance to the nearest cell of the other kind.

    Parameters
    ----------
    occupied : numpy.ndarray of bool, shape (H, W)
        The obstacle cells.
    limit : int, optional
        The largest square of interest, as for `squared_distance`.

    Returns
    -------
    numpy.ndarray of int32 or int64, shape (H, W)
        Squares of cells: positive on free cells, negative on occupied ones, never 0; plus or
        minus `mapdeal.kernels.squares.unreachable` where no cell of the other kind is within
        the limit.

    Examples
    --------
    >>> signed_squared_distance(np.array([[True, True, False, False]]))
    array([[-4, -1,  1,  4]], dtype=int32)
    """
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
    """Return each cell's signed distance to the nearest cell of the other kind.

    Parameters
    ----------
    occupied : numpy.ndarray of bool, shape (H, W)
        The obstacle cells.
    scale : float
        Length of a cell's side.
    outside_shift, inside_shift : float
        Added to the distances of free cells and, after their sign, of occupied cells.
    clip : float
        What both signs are then clipped to, above 0.
    gain : float
        Factor of the distances of free cells, applied last.
    halo : Halo, optional
        What lies before and after the rows, if they are a block of a grid, as
        `mapdeal.kernels.column_runs.halos_of` has it.

    Returns
    -------
    numpy.ndarray of float32, shape (H, W)
        With d the distance in float64, rounded once at the end: gain * (d + outside_shift) on
        free cells, inside_shift - d on occupied ones; d is infinite if there is no cell of the
        other kind.

    Examples
    --------
    >>> signed_distance(np.array([[True, True, False, False]]), scale=0.5, inside_shift=0.5)
    array([[-0.5,  0. ,  0.5,  1. ]], dtype=float32)
    """
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
    """Return for each cell what a table says of its squared distance to the nearest marked cell.

    Parameters
    ----------
    marked : numpy.ndarray of bool, shape (H, W)
        The cells to measure to.
    table : numpy.ndarray of uint8, shape (N,)
        The result for the squares 0 .. N - 2, and for all larger ones; at least 2 entries.

    Returns
    -------
    numpy.ndarray of uint8, shape (H, W)

    Examples
    --------
    >>> by_square = np.array([9, 8, 7, 7, 6, 0], dtype=np.uint8)
    >>> bytes_by_distance(np.array([[True, False, False, False]]), by_square)
    array([[9, 8, 6, 0]], dtype=uint8)
    """
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
