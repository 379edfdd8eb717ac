"""Where several maps on one lattice contradict each other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.display import OneLine, count_text
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels.dilation import within_distance
from mapdeal.kernels.lookup import look_up
from mapdeal.records import dataclass

NO_CONFLICT, BY_FIRST, BY_OTHERS, AMONG_OTHERS = range(4)
"""No conflict; the first map is occupied; it is free; it is neither, and others differ."""

OCCUPIED_FROM, FREE_UP_TO = 65, 25
"""Values at which Nav2's map_saver by default calls a cell occupied, and free."""

_NEAR = 2
"""Cells: an obstacle that is farther is not the same, seen by another map."""

_MANY = 0.01
"""Share of common cells: maps whose walls lie on each other have fewer conflicts, or meet."""

NOTHING, FREE, OCCUPIED, BETWEEN = range(4)

States = NDArray[np.uint8]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, repr=False)
class MapCounts(OneLine):
    """Comparison of one map with the others in a merge, in cells of the merged map.

    Parameters
    ----------
    known : int
        Number of cells known in this map.
    common : int
        Known cells that are known in another map as well.
    added : int
        Cells known in this map but in none before it, or occupied in this map but in none
        before it.
    occupied_here : int
        Cells occupied in this map and free in another.
    free_here : int
        Cells free in this map and occupied in another.
    walls : int
        Cells occupied in this map and known in another.
    met : int
        Cells of `walls` with an obstacle of another map within two cells; most of them, if the
        maps are aligned.
    """

    known: int
    common: int
    added: int
    occupied_here: int
    free_here: int
    walls: int
    met: int

    def _told(self) -> Iterator[str]:
        yield f"{self.known} known"
        yield f"{self.common} in common"
        yield f"{self.added} added"
        yield count_text(self.conflicts, "conflict")
        yield f"{self.met} of {self.walls} walls met"

    @property
    def conflicts(self) -> int:
        """Number of cells in which this map and another contradict each other."""
        return self.occupied_here + self.free_here

    @property
    def conflict_share(self) -> float:
        """Conflicts as a share of `common`; 0 if no cell is common."""
        return self.conflicts / self.common if self.common else 0.0

    @property
    def is_contradicted(self) -> bool:
        """Whether the map is probably misaligned: many conflicts, and few walls met.

        Conflicts alone prove nothing: moved furniture causes some, and if two maps have the same
        wall one cell apart, each is free where the other has the wall.
        """
        return self.conflict_share > _MANY and 2 * self.met < self.walls


def states_of(values: NDArray[np.int8]) -> States:
    """Return whether cells are `NOTHING` (unknown), `FREE`, `OCCUPIED` or `BETWEEN`."""
    table = np.full(256, BETWEEN, dtype=np.uint8)
    table[: FREE_UP_TO + 1] = FREE
    table[OCCUPIED_FROM:] = OCCUPIED
    table[UNKNOWN] = NOTHING
    states: States = look_up(values, table)
    return states


def compared(
    states: Sequence[States],
) -> tuple[NDArray[np.uint8], tuple[MapCounts, ...], int]:  # fmt: skip
    """Return the conflicts of maps, the counts of each, and how many cells several know."""
    shape = states[0].shape
    occupied = _Marks((one == OCCUPIED for one in states), shape)
    free = _Marks((one == FREE for one in states), shape)
    known = _Marks((one != NOTHING for one in states), shape)
    conflicts = np.where(occupied.once & free.once, np.uint8(AMONG_OTHERS), np.uint8(NO_CONFLICT))
    for state, kind in ((OCCUPIED, BY_FIRST), (FREE, BY_OTHERS)):
        conflicts[(conflicts != NO_CONFLICT) & (states[0] == state)] = kind
    counts = tuple(_counts(states, occupied, free, known))
    return conflicts, counts, int(np.count_nonzero(known.twice))


class _Marks:
    """Cells that are marked in one of several masks, and in more than one."""

    def __init__(self, masks: Iterable[Mask], shape: tuple[int, ...]) -> None:
        self.once, self.twice = np.zeros((2, *shape), dtype=np.bool_)
        for mask in masks:
            self.twice |= self.once & mask
            self.once |= mask

    def elsewhere(self, own: Mask) -> Mask:
        """Return which cells are marked in another mask than this one of them."""
        found: Mask = self.twice | (self.once & ~own)
        return found


def _counts(
    states: Sequence[States], occupied: _Marks, free: _Marks, known: _Marks
) -> Iterator[MapCounts]:
    known_before, occupied_before = np.zeros((2, *states[0].shape), dtype=np.bool_)
    for one in states:
        own_known, own_occupied, own_free = one != NOTHING, one == OCCUPIED, one == FREE
        shared = own_known & known.elsewhere(own_known)
        other_occupied = occupied.elsewhere(own_occupied)
        walls = own_occupied & shared
        yield MapCounts(
            known=int(np.count_nonzero(own_known)),
            common=int(np.count_nonzero(shared)),
            added=int(
                np.count_nonzero((own_known & ~known_before) | (own_occupied & ~occupied_before))
            ),
            occupied_here=int(np.count_nonzero(own_occupied & free.elsewhere(own_free))),
            free_here=int(np.count_nonzero(own_free & other_occupied)),
            walls=int(np.count_nonzero(walls)),
            met=int(np.count_nonzero(walls & within_distance(other_occupied, _NEAR**2))),
        )
        known_before |= own_known
        occupied_before |= own_occupied
