"""Memory that scores take, so that too large a job is refused at the start."""

from __future__ import annotations

from mapdeal.kernels.threads import thread_count

TOGETHER = 1 << 16
"""Cells of a band of rows on which a thread works."""

_LIBRARIES = 28_000_000
"""scipy.ndimage, and what it loads."""

_PER_CELL, _PER_WALL = 9.2, 12
_OF_BAND, _AROUND = 90, 10
"""Of a comparison: bytes for each cell, each wall cell of both maps, and each cell of a band, with
the rows around it."""

_PER_CELL_ALONE, _PER_WALL_ALONE = 7.2, 52
_OF_BAND_ALONE, _AROUND_ALONE = 60, 40
"""The same of a map on its own."""

LEAST_ROWS_ALONE = 64
"""Rows of a band there: with fewer most of the work would be what lies around them."""

_PER_WALL_DRAWN = 40


def bytes_to_compare(shape: tuple[int, int], walls: int, *, is_drawn: bool = False) -> int:
    """Return about how many bytes it takes to compare a map with the truth, and to draw that."""
    per_wall = _PER_WALL_DRAWN if is_drawn else _PER_WALL
    return _bytes(shape, walls, _PER_CELL, per_wall, _OF_BAND, _AROUND, 1)


def bytes_alone(shape: tuple[int, int], walls: int) -> int:
    """Return about how many bytes it takes to score a map on its own, as `bytes_to_compare`."""
    return _bytes(
        shape, walls, _PER_CELL_ALONE, _PER_WALL_ALONE, _OF_BAND_ALONE, _AROUND_ALONE,
        LEAST_ROWS_ALONE,
    )  # fmt: skip


def _bytes(
    shape: tuple[int, int],
    walls: int,
    per_cell: float,
    per_wall: int,
    of_band: int,
    around: int,
    least_rows: int,
) -> int:
    height, width = shape
    rows = max(least_rows, TOGETHER // width)
    workers = min(thread_count(), -(-height // rows))
    band = of_band * (min(rows, height) + around) * (width + around)
    return int(_LIBRARIES + per_cell * height * width + per_wall * walls + workers * band)
