"""Where several maps on one lattice contradict each other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.display import OneLine, count_text
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels.distance import within_distance
from mapdeal.kernels.lookup import look_up

NO_CONFLICT, BY_FIRST, BY_OTHERS, AMONG_OTHERS = range(4)
"""No conflict; the first map is occupied; it is free; it is neither, and others differ."""

OCCUPIED_FROM, FREE_UP_TO = 65, 25
"""Values at which Nav2's map_saver by default calls a cell occupied, and free."""

_NEAR = 2
"""Cells: walls that are farther from each other are not one wall that two maps have seen."""

_MANY = 0.05
"""Share of common cells: above, conflicts are worth a word."""

NOTHING, FREE, OCCUPIED, BETWEEN = range(4)

States = NDArray[np.uint8]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, repr=False)
class MapCounts(OneLine):
    """What one of several maps has to do with the others, in cells of the merged map.

    Parameters
    ----------
    known : int
        Cells that it knows.
    common : int
        Those of them that another map knows, too.
    added : int
        Cells that it knows and no map before it, and cells that are occupied in it and in no map
        before it.
    occupied_here : int
        Cells that are occupied in it and free in another map.
    free_here : int
        Cells that are free in it and occupied in another map.
    apart : int
        Those of both where the side that is free has no obstacle within two cells: no wall that
        two maps have seen a cell apart, but one that is elsewhere, or gone.
    """

    known: int
    common: int
    added: int
    occupied_here: int
    free_here: int
    apart: int

    def _told(self) -> Iterator[str]:
        yield f"{self.known} known"
        yield f"{self.common} in common"
        yield f"{self.added} added"
        yield f"{count_text(self.conflicts, 'conflict')}, {self.apart} apart"

    @property
    def conflicts(self) -> int:
        """Cells on which it and another map contradict each other."""
        return self.occupied_here + self.free_here

    @property
    def conflict_share(self) -> float:
        """Share of `conflicts` in `common`; 0 if nothing is."""
        return self.conflicts / self.common if self.common else 0.0

    @property
    def is_contradicted(self) -> bool:
        """Whether it is hardly aligned with the others: many conflicts, most of them apart.

        Of a wall that two maps have seen, a cell apart, both are free where the other has it.
        """
        return self.conflict_share > _MANY and 2 * self.apart > self.conflicts


def states_of(values: NDArray[np.int8]) -> States:
    """Return whether cells are `NOTHING` (unknown), `FREE`, `OCCUPIED` or `BETWEEN`."""
    table = np.full(256, BETWEEN, dtype=np.uint8)
    table[: FREE_UP_TO + 1] = FREE
    table[OCCUPIED_FROM:] = OCCUPIED
    table[UNKNOWN] = NOTHING
    states: States = look_up(values, table)
    return states


def compared(states: Sequence[States]) -> tuple[NDArray[np.uint8], tuple[MapCounts, ...]]:
    """Return the conflicts of maps, and the counts of each.

    Parameters
    ----------
    states : sequence of numpy.ndarray of uint8, shape (H, W)
        What the cells are in each map, as `states_of` returns it.

    Returns
    -------
    conflicts : numpy.ndarray of uint8, shape (H, W)
        `NO_CONFLICT`, `BY_FIRST`, `BY_OTHERS`, or `AMONG_OTHERS`.
    counts : tuple of MapCounts
        Of each map, in their order.

    Examples
    --------
    >>> a, b = (states_of(np.array([cells], np.int8)) for cells in ([100, 0, -1], [0, 100, 100]))
    >>> conflicts, counts = compared([a, b])
    >>> conflicts.tolist(), counts[1]
    ([[1, 2, 0]], MapCounts(3 known, 2 in common, 2 added, 2 conflicts, 0 apart))
    """
    shape = states[0].shape
    occupied = _Marks((one == OCCUPIED for one in states), shape)
    free = _Marks((one == FREE for one in states), shape)
    known = _Marks((one != NOTHING for one in states), shape)
    conflicts = np.where(occupied.once & free.once, np.uint8(AMONG_OTHERS), np.uint8(NO_CONFLICT))
    for state, kind in ((OCCUPIED, BY_FIRST), (FREE, BY_OTHERS)):
        conflicts[(conflicts != NO_CONFLICT) & (states[0] == state)] = kind
    return conflicts, tuple(_counts(states, occupied, free, known))


class _Marks:
    """Cells that are marked in one of several masks, and in more than one.

    Parameters
    ----------
    masks : iterable of numpy.ndarray of bool, shape (H, W)
        One at a time.
    shape : tuple of int
        Of each.
    """

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
        other_occupied = occupied.elsewhere(own_occupied)
        here, there = own_occupied & free.elsewhere(own_free), own_free & other_occupied
        yield MapCounts(
            known=int(np.count_nonzero(own_known)),
            common=int(np.count_nonzero(known.elsewhere(own_known) & own_known)),
            added=int(
                np.count_nonzero((own_known & ~known_before) | (own_occupied & ~occupied_before))
            ),
            occupied_here=int(np.count_nonzero(here)),
            free_here=int(np.count_nonzero(there)),
            apart=_far(here, other_occupied) + _far(there, own_occupied),
        )
        known_before |= own_known
        occupied_before |= own_occupied


def _far(cells: Mask, obstacles: Mask) -> int:
    """Return how many cells have no obstacle near."""
    if not cells.any():
        return 0
    return int(np.count_nonzero(cells & ~within_distance(obstacles, _NEAR**2)))
