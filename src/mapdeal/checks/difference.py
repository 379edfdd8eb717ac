"""Differences between two maps."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import MOST_CELLS, Frame, Region, region_around
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.resample import sampled
from mapdeal.grid.values import OCCUPIED
from mapdeal.kernels.dilation import within_distance
from mapdeal.records import dataclass

STATES = ("occupied", "free", "unknown", "between")
"""States of a cell; ``between`` stands for the values 1..99."""

SYMMETRIES: dict[str, Callable[[NDArray[np.int8]], NDArray[np.int8]]] = {
    "mirrored upside down": np.flipud,
    "mirrored left to right": np.fliplr,
    "turned by 180 degrees": lambda cells: cells[::-1, ::-1],
    "turned by 90 degrees": np.rot90,
    "turned by -90 degrees": lambda cells: np.rot90(cells, -1),
    "transposed": np.transpose,
    "transposed and turned by 180 degrees": lambda cells: cells.T[::-1, ::-1],
}
"""Ways in which the cells of a map are often confused."""

# What a cell of the comparison shows; where cells share a pixel the largest does.
OUTSIDE, BOTH_UNKNOWN, BOTH_FREE, CHANGED, COMMON, REMOVED, ADDED = range(7)

_MOST_TOLERANCE = 1000.0


@dataclass(frozen=True)
class WallShift:
    """Distances from the obstacles of one map to the nearest of the other, metres."""

    largest: float
    percentile_95: float
    mean: float


@dataclass(frozen=True, eq=False)
class Difference:
    """Differences between two maps."""

    geometry: dict[str, tuple[Any, Any]]
    common: int
    confusion: NDArray[np.int64]
    differing: int
    beyond: int
    not_compared: int
    walls: tuple[WallShift | None, WallShift | None]
    symmetry: str | None
    frame: Frame
    changes: NDArray[np.uint8]

    @property
    def is_equal(self) -> bool:
        """Whether the maps have the same geometry and cells, within the tolerance."""
        return not self.geometry and self.beyond == 0


def compare(first: OccupancyGrid, second: OccupancyGrid, *, tolerance: float = 0.0) -> Difference:
    if not 0 <= tolerance <= _MOST_TOLERANCE:  # refuses nan too
        rule = f"must be 0 to {_MOST_TOLERANCE:g} cells"
        raise ParameterError(rule, place="tolerance", got=tolerance)
    frame = frame_around(first.frame, second.frame)
    a, in_a = sampled(frame, first.occupancy, first.frame)
    b, in_b = sampled(frame, second.occupancy, second.frame)
    both = in_a & in_b
    state_a, state_b = states_of(a), states_of(b)
    confusion = confusion_of(state_a[both], state_b[both])
    differs = both & (a != b)
    beyond = differs.copy()
    if tolerance > 0:
        beyond &= _is_beyond(state_a, state_b, both, math.floor(tolerance**2))
    return Difference(
        _geometry(first, second), int(np.count_nonzero(both)), confusion,
        int(np.count_nonzero(differs)), int(np.count_nonzero(beyond)),
        int(np.count_nonzero(first.occupancy >= 0) - np.count_nonzero(both & (a >= 0))),
        _wall_shifts(first, second, frame, (a == OCCUPIED) & both, (b == OCCUPIED) & both),
        _better_symmetry(first.occupancy, second.occupancy), frame,
        changes_of(state_a, state_b, both),
    )  # fmt: skip


def states_of(values: NDArray[np.int8]) -> NDArray[np.uint8]:
    """Return the states of cells, as indices into `STATES`."""
    table = np.full(256, STATES.index("between"), dtype=np.uint8)
    table[OCCUPIED] = STATES.index("occupied")
    table[0] = STATES.index("free")
    table[128:] = STATES.index("unknown")
    return table[values.view(np.uint8)]


def confusion_of(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the number of cells by state in one map (rows) and in the other, shape (4, 4)."""
    pairs = first.ravel().astype(np.int64) * len(STATES) + second.ravel()
    return np.bincount(pairs, minlength=len(STATES) ** 2).reshape(len(STATES), -1)


def frame_around(first: Frame, second: Frame) -> Frame:
    """Return the cells of the first lattice that both maps lie in."""
    other = region_around(first, second)
    row, col = min(other.row, 0), min(other.col, 0)
    height = max(other.row + other.height, first.height) - row
    width = max(other.col + other.width, first.width) - col
    if height * width > MOST_CELLS:
        rule = f"the maps lie too far apart: {width} x {height} cells hold both"
        raise ParameterError(rule, place="origin")
    return Region(row, col, height, width).frame_in(first)


def _is_beyond(
    first: NDArray[np.uint8], second: NDArray[np.uint8], both: NDArray[np.bool_], square: int
) -> NDArray[np.bool_]:
    """Return cells of which one of the maps has no like within a distance in the other."""
    beyond = np.zeros(both.shape, dtype=np.bool_)
    for state in range(len(STATES)):
        of_first, of_second = (first == state) & both, (second == state) & both
        for own, other in ((of_first, of_second), (of_second, of_first)):
            if own.any():
                beyond |= own & ~within_distance(other, square)
    return beyond


def _geometry(first: OccupancyGrid, second: OccupancyGrid) -> dict[str, tuple[Any, Any]]:
    pairs = {
        "width": (first.shape[1], second.shape[1]),
        "height": (first.shape[0], second.shape[0]),
        "resolution": (first.resolution, second.resolution),
        "origin": (list(first.origin), list(second.origin)),
    }
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def _better_symmetry(first: NDArray[np.int8], second: NDArray[np.int8]) -> str | None:
    """Return the symmetry that makes at least half of the differing cells agree, if any."""
    if first.shape not in (second.shape, second.shape[::-1]):
        return None
    as_it_is = int((first == second).sum()) if first.shape == second.shape else 0
    best, most = None, as_it_is + (first.size - as_it_is) // 2
    for name, turn in SYMMETRIES.items():
        turned = turn(second)
        if turned.shape == first.shape:
            agreeing = int((first == turned).sum())
            if agreeing > most:
                best, most = name, agreeing
    return best


def _wall_shifts(
    first: OccupancyGrid, second: OccupancyGrid, frame: Frame, walls_a: NDArray[np.bool_],
    walls_b: NDArray[np.bool_],
) -> tuple[WallShift | None, WallShift | None]:  # fmt: skip
    points = [grid.frame.xy_from_rowcol(np.argwhere(grid.occupied())) for grid in (first, second)]
    common = [frame.xy_from_rowcol(np.argwhere(walls)) for walls in (walls_a, walls_b)]
    return _shift(common[0], points[1]), _shift(common[1], points[0])


def _shift(walls: NDArray[np.float64], others: NDArray[np.float64]) -> WallShift | None:
    if not len(walls) or not len(others):
        return None
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(others).query(walls)
    clean = np.where(distance < 1e-9, 0.0, distance)
    return WallShift(float(clean.max()), float(np.percentile(clean, 95)), float(clean.mean()))


def changes_of(
    first: NDArray[np.uint8], second: NDArray[np.uint8], both: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """Return what each cell shows, `OUTSIDE` to `ADDED`, given its states and if both have it."""
    occupied, unknown = STATES.index("occupied"), STATES.index("unknown")
    changes = np.where(first == second, np.uint8(BOTH_FREE), np.uint8(CHANGED))
    changes[(first == unknown) & (second == unknown)] = BOTH_UNKNOWN
    changes[(first == occupied) & (second == occupied)] = COMMON
    changes[(first == occupied) & (second != occupied)] = REMOVED
    changes[(first != occupied) & (second == occupied)] = ADDED
    changes[~both] = OUTSIDE
    return changes
