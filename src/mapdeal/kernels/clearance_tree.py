"""Ways of largest clearance: how wide the widest way between any two cells is, for all at once.

A way is a chain of traversable cells that touch over their edges; its bottleneck is the least
square on it. Squares are those of `mapdeal.kernels.distance.squared_distance`, so that all is
exact. The engine (see `mapdeal.kernels.engine`) makes no difference to any result.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.distance import SquaredDistances
from mapdeal.kernels.engine import engine_name

Cell = tuple[int, int]


@dataclass(frozen=True, eq=False)
class ClearanceTree:
    """Basins of clearance, and the widest passages between them."""

    # Cells are ordered by square and, where squares are equal, by flat index. Each points to the
    # largest of its four neighbours, if that is larger than the cell itself; so each has a way to
    # the peak of its basin on which squares never fall, and the bottleneck of two cells is the
    # least of their own squares and of the edges between their basins in the forest.

    basins: NDArray[np.int32]
    peaks: NDArray[np.int64]
    peak_cells: NDArray[np.int64]
    one: NDArray[np.int32]
    other: NDArray[np.int32]
    squares: NDArray[np.int64]
    cells: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class RootedTree:
    """A clearance tree seen from one basin."""

    order: NDArray[np.int32]
    parent_edges: NDArray[np.int32]
    bottlenecks: NDArray[np.int64]


def clearance_tree(squared: SquaredDistances, is_traversable: NDArray[np.bool_]) -> ClearanceTree:
    _check(squared, is_traversable)
    return _engine(squared).clearance_tree(squared, is_traversable)  # type: ignore[no-any-return]


def rooted(tree: ClearanceTree, root: int) -> RootedTree:
    if not 0 <= root < len(tree.peaks):
        raise IndexError(f"the tree has no basin {root}")
    return _engine(tree.basins).rooted(tree, root)  # type: ignore[no-any-return]


def widest_metres(
    tree: ClearanceTree,
    squared: SquaredDistances,
    start: Cell,
    resolution: float,
    *,
    seen: RootedTree | None = None,
    in_place: bool = False,
) -> NDArray[np.float32]:
    limits = _limits_from(tree, squared, start, seen)
    metres = _floats_over(tree.basins, in_place=in_place)
    _engine(squared).widest_metres(tree.basins, squared, limits, resolution, metres)
    return metres


def clearance_metres(
    squared: SquaredDistances, resolution: float, *, in_place: bool = False
) -> NDArray[np.float32]:
    metres = _floats_over(squared, in_place=in_place)
    _engine(squared).clearance_metres(squared, resolution, metres)
    return metres


def basin_areas(
    tree: ClearanceTree, squared: SquaredDistances, above: int = 0
) -> NDArray[np.int64]:
    """Return how many cells of each basin a robot may stand on."""
    return _engine(squared).basin_areas(  # type: ignore[no-any-return]
        tree.basins, squared, above, len(tree.peaks)
    )


def _limits_from(
    tree: ClearanceTree, squared: SquaredDistances, start: Cell, seen: RootedTree | None
) -> NDArray[np.int64]:
    """Return for each basin the largest square with which its peak has a way to the start."""
    # One more comes first, of the cells that are in no basin (-1): 0, as where there is no way.
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
    if engine_name() == "compiled":
        from mapdeal.kernels import clearance_compiled as compiled_clearance

        if compiled_clearance.fits(cells):
            return compiled_clearance
    from mapdeal.kernels import clearance_numpy as clearance_twin

    return clearance_twin
