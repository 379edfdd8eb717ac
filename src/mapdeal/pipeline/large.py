"""Maps in memory or by slabs of rows: which of the two a map needs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mapdeal.errors import MalformedInputError
from mapdeal.formats.free_memory import free_memory
from mapdeal.formats.large_maps import LargeSource, open_pair, shape_of_pair
from mapdeal.formats.maps import Source, read_source
from mapdeal.grid.large import LargeMap
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.engine import engine_name
from mapdeal.kernels.rows import MadeRows, Room
from mapdeal.kernels.threads import thread_count, use_threads
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.stage_list import Step

_PER_PIXEL = 10
"""Bytes that pictures take while they are drawn, two at the same time."""

_READ = 2.0
_PER_CELL = {"active": 1.5, "inflate": 2.0, "esdf": 6.0, "potential": 110.0, "cost": 3.0}
_PER_CELL_OF_MODEL = {"threshold": 9.0, "rings": 5.0}
"""Bytes that reading and each stage take in memory, outputs that wait to be written included.
Measured as the peak of whole commands on maps of 4000 and 8000 cells a side, and rounded up."""


@dataclass(frozen=True)
class _Demand:
    """What an engine takes of memory.

    Parameters
    ----------
    base : int
        Bytes of the interpreter and its libraries.
    more : float
        Bytes for each cell of a map in memory, beside its layers.
    slab : int
        Bytes for each cell of a slab, in each thread: all layers of a recipe, some twice.
    """

    base: int
    more: float
    slab: int


_DEMANDS = {
    "compiled": _Demand(50_000_000, 0.0, 40), "scipy": _Demand(100_000_000, 12.0, 90)
}  # fmt: skip

_PER_COLUMN_OF_SLAB = 20
"""Bytes for each column of each slab, until all are joined: `mapdeal.kernels.column_runs`."""

_SLAB_CELLS = 1 << 22
_LEAST = 128_000_000
_SMALL = 256_000_000
"""Small maps go by no slabs: all of little memory is taken, and the least in any case, also by
each of many jobs."""


def bytes_in_memory(
    shape: tuple[int, int], steps: Sequence[Step], image_max: int | None
) -> int:  # fmt: skip
    """Return about how many bytes of memory it takes to apply stages to a map in memory."""
    per_cell = (
        _DEMANDS[engine_name()].more
        + _READ
        + sum(_PER_CELL_OF_MODEL.get(step.model or "", _PER_CELL[step.name]) for step in steps)
    )
    return _base(shape, image_max) + int(per_cell * shape[0] * shape[1])


def bytes_of_slab(cells: int) -> int:
    """Return about how many bytes of memory it takes to work on one slab, and on no other."""
    demand = _DEMANDS[engine_name()]
    return demand.base + demand.slab * cells


def cells_of_slab(memory: int) -> int:
    """Return of how many cells such a slab may be; less than 1 if the memory is for none."""
    demand = _DEMANDS[engine_name()]
    return (memory - demand.base) // demand.slab


def _base(shape: tuple[int, int], image_max: int | None) -> int:
    """Return the bytes that are taken in either way."""
    base = _DEMANDS[engine_name()].base
    if image_max is None:
        return base
    height, width = shape
    step = max(1, -(-max(shape) // image_max)) if image_max else 1
    return base + _PER_PIXEL * -(-height // step) * -(-width // step)


@contextmanager
def opened_source(
    path: Path, steps: Sequence[Step], options: Settings, *, image_max: int | None
) -> Iterator[Source | LargeSource]:
    """Give a map to which stages are to be applied: in memory, or by slabs if that is too small.

    Parameters
    ----------
    path : Path
        The map.
    steps : sequence of Step
        The stages.
    options : Settings
        How it is read, and how much memory may be taken.
    image_max : int, optional
        Longest side of the pictures that will be drawn, 0 for a pixel per cell; None for none.

    Raises
    ------
    FileAccessError
        If a file cannot be read.
    MalformedInputError
        If a file is malformed, or the map is too large for the memory in either way.
    """
    budget = memory_budget(options.max_memory)
    by_slabs = _goes_by_slabs(steps)

    shape = shape_of_pair(path) if path.suffix.lower() != ".npz" else None
    if shape is not None and bytes_in_memory(shape, steps, image_max) > budget:
        if not by_slabs:
            raise too_large(path, shape, bytes_in_memory(shape, steps, image_max), budget)
        together, room = _cut(shape, budget, _base(shape, image_max), path)
        with open_pair(
            path, together=together, room=room, dialect=options.dialect,
            max_cells=options.max_cells,
        ) as opened:  # fmt: skip
            if opened is None:  # it was another file a moment ago
                raise MalformedInputError("changed while it was read", source=path)
            yield opened
        return
    source = read_source(path, dialect=options.dialect, max_cells=options.max_cells)
    grid = source.grid
    needed = bytes_in_memory(grid.shape, steps, image_max)
    if needed > budget and isinstance(grid, OccupancyGrid) and by_slabs:
        values = grid.occupancy
        together, room = _cut(
            grid.shape, budget, _base(grid.shape, image_max) + values.nbytes, path
        )
        layer = MadeRows(
            grid.shape, np.int8, lambda first, end: values[first:end], together=together, room=room
        )
        large = LargeMap(layer, grid.resolution, grid.origin)
        yield LargeSource(large, source.files)
        return
    if needed > budget:
        raise too_large(path, grid.shape, needed, budget)
    yield source


@dataclass(frozen=True)
class Need:
    """What a run takes of memory.

    Parameters
    ----------
    memory : int
        About how many bytes.
    by_slabs : bool
        Whether the map is worked on by slabs of rows, since the whole of it would need too much.
    """

    memory: int
    by_slabs: bool


def need_of(
    path: Path, shape: tuple[int, int], steps: Sequence[Step], *, image_max: int | None,
    max_memory: int | None, threads: int | None,
) -> Need:  # fmt: skip
    """Return the memory that `opened_source` and the stages will take, from the size alone.

    Raises
    ------
    MalformedInputError
        If there is too little.
    """
    budget = memory_budget(max_memory)
    needed = bytes_in_memory(shape, steps, image_max)
    if needed <= budget:
        return Need(needed, by_slabs=False)
    if not _goes_by_slabs(steps):
        raise too_large(path, shape, needed, budget)
    read = 0 if shape_of_pair(path) else shape[0] * shape[1]
    with use_threads(threads):
        _cut(shape, budget, _base(shape, image_max) + read, path)
    return Need(budget, by_slabs=True)  # layers are kept as long as there is room


def memory_budget(max_memory: int | None, jobs: int = 1) -> int:
    """Return the bytes that each job may take: those given, or its part of half of what is free."""
    if max_memory is not None:
        return max_memory
    free = free_memory()
    if free is None:
        return 1 << 62
    if jobs > 1:
        return max(free // 2 // jobs, _LEAST)
    return max(free // 2, min(free, _SMALL), _LEAST)


def _goes_by_slabs(steps: Sequence[Step]) -> bool:
    return all(step.name != "potential" for step in steps)


def _cut(shape: tuple[int, int], budget: int, base: int, path: Path) -> tuple[int, Room]:
    """Return how many rows make a slab, and what of the budget the layers may keep.

    Slabs, what is kept of each, and `base`, which is taken anyhow, fit the budget.
    """
    height, width = shape
    per_row = _DEMANDS[engine_name()].slab * width * (thread_count() + 1)

    def fitting(left: int) -> tuple[int, int]:
        """Return the least and the most rows, half of the memory for slabs, a quarter for runs."""
        least = -(-_PER_COLUMN_OF_SLAB * width * height // max(left // 4, 1))
        return max(least, 1), left // 2 // per_row

    left = budget - base
    least, most = fitting(left)
    if most < least:
        while most < least:
            left = max(left + left // 50, per_row)
            least, most = fitting(left)
        raise too_large(path, shape, int(1.01 * (base + left)), budget)
    together = int(min(max(_SLAB_CELLS // width, least), most, height, (1 << 16) - 1))
    runs = _PER_COLUMN_OF_SLAB * width * -(-height // together)
    return together, Room(left - per_row * together - runs)


def too_large(path: Path, shape: tuple[int, int], needed: int, budget: int) -> MalformedInputError:
    """Return the error of a map that takes more memory than it may."""
    height, width = shape
    rule = f"{width} x {height} cells need {_told(needed)} of memory, {_told(budget)} may be taken"
    hint = "raise --max-memory if there is more; .pgm maps take least"
    return MalformedInputError(rule, source=path, hint=hint)


def _told(count: int) -> str:
    return f"{count / 1e9:.3g} GB" if count >= 1e9 else f"{count / 1e6:.3g} MB"
