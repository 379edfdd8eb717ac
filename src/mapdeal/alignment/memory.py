"""Memory that aligning two maps takes."""

from __future__ import annotations

from collections.abc import Sequence

from mapdeal.alignment.walls import MOST_CELLS_A_SIDE

_PER_CELL = 6
"""Bytes for each cell of a map while it is put on the cells that are looked at, one at a time."""

_PER_LOOKED_AT, _LOOKED_AT = 40, 2 * MOST_CELLS_A_SIDE**2
"""Bytes for each of those cells, and how many there are at most of both maps."""


def bytes_to_align(cells: Sequence[int]) -> int:
    """Return the bytes that aligning two maps takes, besides the maps."""
    return _PER_CELL * max(cells) + _PER_LOOKED_AT * min(sum(cells), _LOOKED_AT)
