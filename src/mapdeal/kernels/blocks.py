"""Layers of a grid: arrays, or blocks of rows that are computed on demand.

A stage is written once, for a range of rows. On an array the range is all rows and the result is an
array. On a lazy layer the result is another lazy layer, which pulls its blocks through the stages
before it. So a map in memory is a map of one block.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from threading import Lock
from typing import Any, NoReturn, cast

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels import lookup, threads
from mapdeal.kernels.arrays import Integers, Mask
from mapdeal.records import dataclass

Layer = NDArray[Any]  # an array of shape (H, W), or a `LazyLayer`, which stands for one
Runs = NDArray[np.uint32]
Border = tuple[Mask, Runs]  # a row of cells, and the lengths of the runs that end or start there
MakeRows = Callable[[slice], NDArray[Any]]
ReportRows = Callable[[int, int], object]  # rows processed, rows of the layer
_reported_to: ContextVar[ReportRows | None] = ContextVar("reported_to", default=None)
activities: ContextVar[list[str] | None] = ContextVar("activities", default=None)
"""Names of the work under way, see `activity`; a progress display sets the list."""
_CELLS_PER_TEST = 1 << 20


@dataclass(frozen=True, eq=False)
class Halo:
    """Neighbouring rows of a block with the lengths of their runs; None at the grid's edge."""

    height: int
    before: Border | None
    after: Border | None


class CacheBudget:
    """Memory for cached blocks, shared by all layers of a map."""

    def __init__(self, size: int = 0) -> None:
        self._available = size
        self._lock = Lock()

    def take(self, size: int) -> bool:
        with self._lock:
            if size > self._available:
                return False
            self._available -= size
            return True


class LazyLayer:
    """A two-dimensional array whose rows are computed on demand, block by block."""

    # Any rows can be requested; the full array exists only after ``layer[:]``.

    ndim = 2
    __array_ufunc__ = None  # arithmetic with arrays fails instead of computing all rows

    def __init__(
        self, shape: tuple[int, int], dtype: Any, make: MakeRows,
        *, block_height: int, keep: int = 0, budget: CacheBudget | None = None,
    ) -> None:  # fmt: skip
        self.shape = shape
        self.dtype = np.dtype(dtype)
        self.block_height = block_height
        self.budget = CacheBudget() if budget is None else budget
        self._make = make
        self._keep = keep
        self._cached: OrderedDict[int, Future[NDArray[Any]]] = OrderedDict()
        self._lock = Lock()
        self.found: dict[Hashable, list[Any]] = {}
        """Results of `gathered` for the blocks, by function."""

    @property
    def nbytes(self) -> int:
        return self.size * int(self.dtype.itemsize)

    @property
    def size(self) -> int:
        return self.shape[0] * self.shape[1]

    def __len__(self) -> int:
        return self.shape[0]

    def __eq__(self, _: object) -> NoReturn:
        raise TypeError("a lazy layer is compared rows by rows")

    __hash__ = object.__hash__

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return self[:].astype(dtype or self.dtype, copy=bool(copy))

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        first, end, step = rows.indices(self.shape[0])
        if step != 1:
            raise IndexError("rows of a lazy layer can be sliced only with step 1")
        end = max(first, end)
        if self._keep == 0:
            return self._make(slice(first, end))
        parts = []
        for number in range(first // self.block_height, -(-end // self.block_height)):
            start = number * self.block_height
            parts.append(self._block(number)[max(first - start, 0) : end - start])
        if not parts:
            return np.empty((0, self.shape[1]), dtype=self.dtype)
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def _block(self, number: int) -> NDArray[Any]:
        """Return a block; wait for it if another thread is computing it."""
        with self._lock:
            block = self._cached.get(number)
            is_mine = block is None
            if block is None:
                block = self._cached[number] = Future()
                while len(self._cached) > self._keep:
                    self._cached.popitem(last=False)
            else:
                self._cached.move_to_end(number)
        if is_mine:
            first = number * self.block_height
            try:
                rows = self._make(slice(first, min(first + self.block_height, self.shape[0])))
                rows.flags.writeable = False  # all callers share this array
                block.set_result(rows)
            except BaseException as error:
                block.set_exception(error)
                with self._lock:
                    self._cached.pop(number, None)
                raise
        return block.result()


def is_lazy(layer: Layer) -> bool:
    return isinstance(layer, LazyLayer)


def lazy_layer(
    shape: tuple[int, int], dtype: Any, make: MakeRows,
    *, block_height: int, budget: CacheBudget | None = None,
) -> Layer:  # fmt: skip
    return cast("Layer", LazyLayer(shape, dtype, make, block_height=block_height, budget=budget))


def blocks_of(layer: Layer) -> Iterator[slice]:
    step = layer.block_height if isinstance(layer, LazyLayer) else max(len(layer), 1)
    for first in range(0, len(layer), step):
        yield slice(first, min(first + step, len(layer)))


def rows_reported(report: ReportRows) -> AbstractContextManager[None]:
    return threads.set_within(_reported_to, report)


@contextmanager
def activity(name: str) -> Iterator[None]:
    """Name the work of a ``with`` block, such as a stage, for a line of progress."""
    names = activities.get()
    names = [] if names is None else names
    names.append(name)
    try:
        yield
    finally:
        names.remove(name)


def report_rows(layer: Layer, rows: slice) -> None:
    report = _reported_to.get()
    if report is not None and is_lazy(layer):
        report(rows.stop - rows.start, layer.shape[0])


def swept(layer: Layer) -> Iterator[slice]:
    """Yield the rows of each block, as `blocks_of` does, and report it afterwards."""
    for rows in blocks_of(layer):
        yield rows
        report_rows(layer, rows)


def gathered(layer: Layer, *looks: Callable[[NDArray[Any]], Any]) -> list[list[Any]]:
    if not isinstance(layer, LazyLayer):
        return [[look(layer)] for look in looks]
    new: dict[Callable[[NDArray[Any]], Any], list[Any]]
    new = {look: [] for look in looks if look not in layer.found}
    for rows in swept(cast("Layer", layer)) if new else ():
        values = layer[rows]
        for look, parts in new.items():
            parts.append(look(values))
    layer.found.update(new)
    return [layer.found[look] for look in looks]


def made_by_rows(
    source: Layer, dtype: Any, make: MakeRows,
    *, shape: tuple[int, int] | None = None, is_cached: bool = False,
) -> Layer:  # fmt: skip
    """Return an array if `source` is one, else a layer whose blocks are computed on demand."""
    shape = shape or source.shape
    if not isinstance(source, LazyLayer):
        return make(slice(0, shape[0]))
    # All blocks are cached if the budget has room, else one for each thread and one more.
    keep = 0
    if is_cached:
        keep = threads.thread_count() + 1
        if source.budget.take(shape[0] * shape[1] * np.dtype(dtype).itemsize):
            keep = max(keep, -(-shape[0] // source.block_height))
    height, budget = source.block_height, source.budget
    layer = LazyLayer(shape, dtype, make, block_height=height, keep=keep, budget=budget)
    return cast("Layer", layer)


def made_by_windows(source: Layer, dtype: Any, change: MakeRows, *, halo: int) -> Layer:
    """Return a layer of the rows that `change` computes from rows with a halo on both sides."""
    height = source.shape[0]

    def make(rows: slice) -> NDArray[Any]:
        first, end = max(rows.start - halo, 0), min(rows.stop + halo, height)
        return change(slice(first, end))[rows.start - first : rows.stop - first]

    return made_by_rows(source, dtype, make, is_cached=True)


def mapped(layer: Layer, dtype: Any, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Layer:
    return made_by_rows(layer, dtype, lambda rows: change(layer[rows]))


def looked_up(layer: Layer, table: NDArray[Any]) -> Layer:
    return mapped(layer, table.dtype, lambda values: lookup.look_up(values, table))


def counts_of(layer: Layer) -> Integers:
    (parts,) = gathered(layer, lookup.histogram)
    return sum(parts, start=np.zeros(256, dtype=np.int64))


def holds_everywhere(layer: Layer, test: Callable[[NDArray[Any]], Mask]) -> bool:
    step = max(1, _CELLS_PER_TEST // layer.shape[1])
    for block in blocks_of(layer):
        values = layer[block]
        bands = (values[first : first + step] for first in range(0, len(values), step))
        if not all(test(band).all() for band in bands):
            return False
    return True
