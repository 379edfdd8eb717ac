"""Layers of a grid: arrays, or blocks of rows that are made when they are asked for.

A stage is written once, on some rows of a layer. Of an array these are all rows, and the result
is an array; of a lazy layer the result is another lazy layer, which pulls its blocks through the
stages before it. So a map in memory is a map of one block.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Lock
from typing import Any, NoReturn, cast

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.arrays import Integers, Mask
from mapdeal.kernels.lookup import histogram, look_up
from mapdeal.kernels.threads import thread_count

Layer = NDArray[Any]  # an array of shape (H, W), or a `LazyLayer`, which stands for one

MakeRows = Callable[[slice], NDArray[Any]]

ReportRows = Callable[[int, int], object]
"""Called with how many rows of a layer have been gone through, and how many it has."""

_reported_to: ContextVar[ReportRows | None] = ContextVar("reported_to", default=None)

activities: ContextVar[list[str] | None] = ContextVar("activities", default=None)
"""Names of the work under way, see `activity`; set by whoever shows them."""

_LOOKED_AT_TOGETHER = 1 << 20


class CacheBudget:
    """Memory that layers may take to keep what they have made: one for all layers of a map."""

    def __init__(self, size: int = 0) -> None:
        self._left = size
        self._lock = Lock()

    def take(self, size: int) -> bool:
        """Take that many bytes if they are left; return whether they were."""
        with self._lock:
            if size > self._left:
                return False
            self._left -= size
            return True


class LazyLayer:
    """A two-dimensional array whose rows are made when they are asked for, block by block."""

    # Any rows can be requested; the whole array exists only for who asks for all of it.

    ndim = 2
    __array_ufunc__ = None  # arithmetic with arrays fails, rather than to work on the whole

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
        self._kept: OrderedDict[int, Future[NDArray[Any]]] = OrderedDict()
        self._lock = Lock()
        self.found: dict[Hashable, list[Any]] = {}
        """What `gathered` has found in the blocks already."""

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
            raise IndexError("rows of a lazy layer are requested one after the other")
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
        """Return a block, made here unless another thread has made it, or does so just now."""
        with self._lock:
            block = self._kept.get(number)
            is_mine = block is None
            if block is None:
                block = self._kept[number] = Future()
                while len(self._kept) > self._keep:
                    self._kept.popitem(last=False)
            else:
                self._kept.move_to_end(number)
        if is_mine:
            first = number * self.block_height
            try:
                rows = self._make(slice(first, min(first + self.block_height, self.shape[0])))
                rows.flags.writeable = False  # others are given the same
                block.set_result(rows)
            except BaseException as error:
                block.set_exception(error)
                with self._lock:
                    self._kept.pop(number, None)
                raise
        return block.result()


def is_lazy(layer: Layer) -> bool:
    return isinstance(layer, LazyLayer)


def lazy_layer(
    shape: tuple[int, int], dtype: Any, make: MakeRows,
    *, block_height: int, budget: CacheBudget | None = None,
) -> Layer:  # fmt: skip
    """Return the first lazy layer of a map, whose rows are read when they are asked for."""
    layer = LazyLayer(shape, dtype, make, block_height=block_height, budget=budget)
    return cast("Layer", layer)


def blocks_of(layer: Layer) -> Iterator[slice]:
    step = layer.block_height if isinstance(layer, LazyLayer) else max(len(layer), 1)
    for first in range(0, len(layer), step):
        yield slice(first, min(first + step, len(layer)))


@contextmanager
def rows_reported(report: ReportRows) -> Iterator[None]:
    """Have `swept` report its progress within a ``with`` block."""
    token = _reported_to.set(report)
    try:
        yield
    finally:
        _reported_to.reset(token)


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
    """Report to `rows_reported` that rows of a lazy layer have been processed."""
    report = _reported_to.get()
    if report is not None and is_lazy(layer):
        report(rows.stop - rows.start, layer.shape[0])


def swept(layer: Layer) -> Iterator[slice]:
    """Yield the rows of each block, as `blocks_of` does, and report those that are done."""
    for rows in blocks_of(layer):
        yield rows
        report_rows(layer, rows)


def gathered(layer: Layer, *looks: Callable[[NDArray[Any]], Any]) -> list[list[Any]]:
    """Return what functions find in the blocks of a layer, in one pass."""
    if not isinstance(layer, LazyLayer):
        return [[look(layer)] for look in looks]
    new: dict[Callable[[NDArray[Any]], Any], list[Any]] = {
        look: [] for look in looks if look not in layer.found
    }
    for rows in swept(cast("Layer", layer)) if new else ():
        values = layer[rows]
        for look, parts in new.items():
            parts.append(look(values))
    layer.found.update(new)
    return [layer.found[look] for look in looks]


def made_by_rows(
    source: Layer, dtype: Any, make: MakeRows,
    *, shape: tuple[int, int] | None = None, is_kept: bool = False,
) -> Layer:  # fmt: skip
    """Return a layer of the kind of `source`: made at once, or block by block when asked for."""
    shape = shape or source.shape
    if not isinstance(source, LazyLayer):
        return make(slice(0, shape[0]))
    # If its blocks are to be kept, they are all kept as long as the budget has room, and otherwise
    # one for each thread and one more.
    keep = 0
    if is_kept:
        keep = thread_count() + 1
        if source.budget.take(shape[0] * shape[1] * np.dtype(dtype).itemsize):
            keep = max(keep, -(-shape[0] // source.block_height))
    height, budget = source.block_height, source.budget
    made = LazyLayer(shape, dtype, make, block_height=height, keep=keep, budget=budget)
    return cast("Layer", made)


def made_by_windows(
    source: Layer, dtype: Any, change: Callable[[slice], NDArray[Any]], *, halo: int
) -> Layer:
    """Return what `change` makes of rows together with a halo on both sides."""
    height = source.shape[0]

    def make(rows: slice) -> NDArray[Any]:
        first, end = max(rows.start - halo, 0), min(rows.stop + halo, height)
        return change(slice(first, end))[rows.start - first : rows.stop - first]

    return made_by_rows(source, dtype, make, is_kept=True)


def mapped(layer: Layer, dtype: Any, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Layer:
    """Return the layer of what `change` makes of the values of any rows."""
    return made_by_rows(layer, dtype, lambda rows: change(layer[rows]))


def looked_up(layer: Layer, table: NDArray[Any]) -> Layer:
    return mapped(layer, table.dtype, lambda values: look_up(values, table))


def counts_of(layer: Layer) -> Integers:
    """Return how often each byte occurs, shape (256,)."""
    (parts,) = gathered(layer, histogram)
    return sum(parts, start=np.zeros(256, dtype=np.int64))


def holds_everywhere(layer: Layer, test: Callable[[NDArray[Any]], Mask]) -> bool:
    """Return whether a test holds for all cells; looks no further than it must."""
    step = max(1, _LOOKED_AT_TOGETHER // layer.shape[1])
    for block in blocks_of(layer):
        values = layer[block]
        bands = (values[first : first + step] for first in range(0, len(values), step))
        if not all(test(band).all() for band in bands):
            return False
    return True
