"""Ways of largest clearance: how wide the widest way between any two cells is, for all at once.

A way is a chain of traversable cells that touch over their edges; its bottleneck is the least
square on it. Squares are those of `mapdeal.kernels.distance.squared_distance`, so that all is
exact. The engine (see `mapdeal.kernels.engine`) makes no difference to any result.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.squares import SquaredDistances
from mapdeal.records import dataclass

Cell = tuple[int, int]


@dataclass(frozen=True, eq=False)
class ClearanceTree:
    """Basins of clearance, and the widest passages between them.

    Parameters
    ----------
    basins : numpy.ndarray of int32, shape (H, W)
        The basin of each traversable cell, 0 .. B - 1; -1 elsewhere. Each basin has one peak,
        and they are in the order of their peaks' flat indices.
    peaks : numpy.ndarray of int64, shape (B,)
        The largest square of each basin.
    peak_cells : numpy.ndarray of int64, shape (B,)
        Flat index of the cell that has it, the last of several; rising.
    one, other : numpy.ndarray of int32, shape (E,)
        The basins that each edge of a maximum spanning forest joins, the narrower cell's first.
    squares : numpy.ndarray of int64, shape (E,)
        The square of the narrower of the two cells between which the edge crosses the border of
        its basins, falling.
    cells : numpy.ndarray of int64, shape (E,)
        Flat index of that cell; falling where squares are equal.

    Notes
    -----
    Cells are ordered by square and, where squares are equal, by flat index. Each points to the
    largest of its four neighbours, if that is larger than the cell itself; so each has a way to the
    peak of its basin on which squares never fall, and the bottleneck of two cells is the least of
    their own squares and of the edges between their basins in the forest.
    """

    basins: NDArray[np.int32]
    peaks: NDArray[np.int64]
    peak_cells: NDArray[np.int64]
    one: NDArray[np.int32]
    other: NDArray[np.int32]
    squares: NDArray[np.int64]
    cells: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class RootedTree:
    """A clearance tree seen from one basin.

    Parameters
    ----------
    order : numpy.ndarray of int32, shape (N,)
        The basins that have a way to the root, breadth first: the root is the first, and each
        comes after its parent.
    parent_edges : numpy.ndarray of int32, shape (B,)
        Index of the edge towards the root; -1 for the root itself and where there is no way.
    bottlenecks : numpy.ndarray of int64, shape (B,)
        The least square on the widest way from the root's peak to that of each basin; -1 where
        there is no way.
    """

    order: NDArray[np.int32]
    parent_edges: NDArray[np.int32]
    bottlenecks: NDArray[np.int64]


def clearance_tree(squared: SquaredDistances, is_traversable: NDArray[np.bool_]) -> ClearanceTree:
    """Return the clearance tree of a grid.

    Parameters
    ----------
    squared : numpy.ndarray of int32 or int64, shape (H, W)
        Squared distance of each cell to the nearest obstacle.
    is_traversable : numpy.ndarray of bool, shape (H, W)
        The cells that ways may use. Cells of square 0 are obstacles and never used.

    Returns
    -------
    ClearanceTree

    Examples
    --------
    >>> squared = np.array([[1, 4, 1, 2, 9]], dtype=np.int32)
    >>> tree = clearance_tree(squared, squared > 0)
    >>> tree.basins.tolist(), tree.peak_cells.tolist()
    ([[0, 0, 0, 1, 1]], [1, 4])
    >>> tree.squares.tolist(), tree.cells.tolist()
    ([1], [2])
    """
    _check(squared, is_traversable)
    return _engine(squared).clearance_tree(squared, is_traversable)  # type: ignore[no-any-return]


def rooted(tree: ClearanceTree, root: int) -> RootedTree:
    """Return a clearance tree seen from one of its basins.

    Parameters
    ----------
    tree : ClearanceTree
        The tree.
    root : int
        The basin, 0 .. B - 1.

    Returns
    -------
    RootedTree

    Examples
    --------
    >>> squared = np.array([[1, 4, 1, 2, 9, 0, 1]], dtype=np.int32)
    >>> seen = rooted(clearance_tree(squared, squared > 0), 1)
    >>> seen.order.tolist(), seen.parent_edges.tolist(), seen.bottlenecks.tolist()
    ([1, 0], [0, -1, -1], [1, 9, -1])
    """
    if not 0 <= root < len(tree.peaks):
        raise IndexError(f"the tree has no basin {root}")
    return _engine(tree.basins).rooted(tree, root)  # type: ignore[no-any-return]


def widest_from(
    tree: ClearanceTree,
    squared: SquaredDistances,
    start: Cell,
    *,
    seen: RootedTree | None = None,
) -> SquaredDistances:
    """Return the bottleneck of the widest way from a cell to each cell.

    Parameters
    ----------
    tree : ClearanceTree
        The tree of `squared`.
    squared : numpy.ndarray of int32 or int64, shape (H, W)
        Squared distance of each cell to the nearest obstacle.
    start : tuple of int
        Row and column of a traversable cell.
    seen : RootedTree, optional
        The tree seen from that cell's basin, if it is known already.

    Returns
    -------
    numpy.ndarray of int32 or int64, shape (H, W)
        The least square along the path, both ends included; 0 where there is no path.

    Examples
    --------
    >>> squared = np.array([[1, 4, 1, 2, 9, 0, 1]], dtype=np.int32)
    >>> tree = clearance_tree(squared, squared > 0)
    >>> widest_from(tree, squared, (0, 4))
    array([[1, 1, 1, 2, 9, 0, 0]], dtype=int32)
    """
    limits = _limits_from(tree, squared, start, seen)
    return _engine(squared).widest_squares(tree.basins, squared, limits)  # type: ignore[no-any-return]


def widest_metres(
    tree: ClearanceTree,
    squared: SquaredDistances,
    start: Cell,
    resolution: float,
    *,
    seen: RootedTree | None = None,
    in_place: bool = False,
) -> NDArray[np.float32]:
    """Return the radius that the widest way from a cell to each cell has room for.

    Parameters
    ----------
    tree, squared, start, seen
        As for `widest_from`.
    resolution : float
        Side of a cell.
    in_place : bool
        Whether the result may take the memory of ``tree.basins``, which are lost then.

    Returns
    -------
    numpy.ndarray of float32, shape (H, W)
        The root of `widest_from` times `resolution`, rounded once; 0 where there is no way, +inf
        where nothing limits it.

    Examples
    --------
    >>> squared = np.array([[1, 4, 1, 2, 9, 0, 1]], dtype=np.int32)
    >>> tree = clearance_tree(squared, squared > 0)
    >>> widest_metres(tree, squared, (0, 4), 0.5).tolist()
    [[0.5, 0.5, 0.5, 0.7071067690849304, 1.5, 0.0, 0.0]]
    """
    limits = _limits_from(tree, squared, start, seen)
    metres = _floats_over(tree.basins, in_place=in_place)
    _engine(squared).widest_metres(tree.basins, squared, limits, resolution, metres)
    return metres


def clearance_metres(
    squared: SquaredDistances, resolution: float, *, in_place: bool = False
) -> NDArray[np.float32]:
    """Return distances in place of their squares.

    Parameters
    ----------
    squared : numpy.ndarray of int32 or int64, shape (H, W)
        Squared distance of each cell to the nearest obstacle.
    resolution : float
        Side of a cell.
    in_place : bool
        Whether the result may take the memory of the squares, which are lost then. Squares of 64
        bits, and parts of other arrays, stay.

    Returns
    -------
    numpy.ndarray of float32, shape (H, W)
        The root times `resolution`, rounded once; +inf where there is no obstacle.

    Examples
    --------
    >>> clearance_metres(np.array([[0, 1, 4, 2**31 - 1]], dtype=np.int32), 0.5)
    array([[0. , 0.5, 1. , inf]], dtype=float32)
    """
    metres = _floats_over(squared, in_place=in_place)
    _engine(squared).clearance_metres(squared, resolution, metres)
    return metres


def basin_areas(
    tree: ClearanceTree, squared: SquaredDistances, above: int = 0
) -> NDArray[np.int64]:
    """Return how many cells of each basin a robot may stand on.

    Parameters
    ----------
    tree : ClearanceTree
        The tree of `squared`.
    squared : numpy.ndarray of int32 or int64, shape (H, W)
        Squared distance of each cell to the nearest obstacle.
    above : int
        Cells with larger squares count.

    Returns
    -------
    numpy.ndarray of int64, shape (B,)

    Examples
    --------
    >>> squared = np.array([[1, 4, 1, 2, 9]], dtype=np.int32)
    >>> basin_areas(clearance_tree(squared, squared > 0), squared, 1).tolist()
    [1, 2]
    """
    return _engine(squared).basin_areas(  # type: ignore[no-any-return]
        tree.basins, squared, above, len(tree.peaks)
    )


def _limits_from(
    tree: ClearanceTree, squared: SquaredDistances, start: Cell, seen: RootedTree | None
) -> NDArray[np.int64]:
    """Return for each basin the largest square with which its peak has a way to the start.

    One more comes first, of the cells that are in no basin (-1): 0, as where there is no way.
    """
    basin = int(tree.basins[start])
    if basin < 0:
        raise ValueError("the start must be a traversable cell")
    if seen is None:
        seen = rooted(tree, basin)
    limits = np.zeros(len(tree.peaks) + 1, dtype=np.int64)
    np.clip(seen.bottlenecks, 0, int(squared[start]), out=limits[1:])
    return limits


def _floats_over(cells: SquaredDistances, *, in_place: bool) -> NDArray[np.float32]:
    if in_place and cells.dtype == np.int32 and cells.flags.c_contiguous and cells.flags.writeable:
        return cells.view(np.float32)
    return np.empty(cells.shape, np.float32)


def _check(squared: SquaredDistances, is_traversable: NDArray[np.bool_]) -> None:
    if squared.ndim != 2 or squared.dtype not in (np.int32, np.int64):
        rule = f"squares must be an integer array with two axes, not {squared.ndim} of"
        raise ValueError(f"{rule} {squared.dtype}")
    if is_traversable.dtype != np.bool_ or is_traversable.shape != squared.shape:
        raise ValueError("the mask of traversable cells must be bool, of the shape of the squares")


def _engine(cells: SquaredDistances) -> ModuleType:
    """Return the module that serves for squares, or other numbers, of cells."""
    if engine_name() == "compiled":
        from mapdeal.kernels import compiled_clearance

        if compiled_clearance.fits(cells):
            return compiled_clearance
    from mapdeal.kernels import clearance_twin

    return clearance_twin
