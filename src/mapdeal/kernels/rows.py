"""Arrays whose rows are made when they are asked for: layers of grids too large for memory.

Whatever takes a layer by slices of rows takes an array and a `MadeRows` alike.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.lookup import histogram, look_up
from mapdeal.kernels.threads import thread_count

MakeRows = Callable[[int, int], NDArray[Any]]


class Room:
    """Memory that layers may take to keep what they have made: one for all layers of a map.

    Parameters
    ----------
    size : int
        Bytes.
    """

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


class MadeRows:
    """An array of two axes of which any rows can be had, and nobody has all.

    Parameters
    ----------
    shape : tuple of int
        Rows and columns.
    dtype : numpy type
        Of the values.
    make : callable
        Returns the rows first..end, an array of shape (end - first, W), given both.
    together : int
        Rows that are best asked for at a time.
    keep : int
        0: `make` is cheap and is called for exactly the rows that are asked for. Otherwise rows
        are made `together`, and as many such slabs are kept as this says.
    room : Room, optional
        What layers made of this one may take to keep all their rows.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        dtype: Any,
        make: MakeRows,
        *,
        together: int,
        keep: int = 0,
        room: Room | None = None,
    ) -> None:
        self.shape = shape
        self.dtype = np.dtype(dtype)
        self.together = together
        self.room = Room() if room is None else room
        self._make = make
        self._keep = keep
        self._kept: OrderedDict[int, Future[NDArray[Any]]] = OrderedDict()
        self._lock = Lock()

    @property
    def ndim(self) -> int:
        """2."""
        return 2

    @property
    def nbytes(self) -> int:
        """Bytes that all the values would take."""
        height, width = self.shape
        return height * width * int(self.dtype.itemsize)

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        first, end, step = rows.indices(self.shape[0])
        if step != 1:
            raise IndexError("rows are had one after the other")
        end = max(first, end)
        if self._keep == 0:
            return self._make(first, end)
        parts = []
        for number in range(first // self.together, -(-end // self.together)):
            start = number * self.together
            parts.append(self._slab(number)[max(first - start, 0) : end - start])
        if not parts:
            return np.empty((0, self.shape[1]), dtype=self.dtype)
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def slabs(self) -> Iterator[slice]:
        """Yield the slices that are best asked for, from the first row to the last."""
        for first in range(0, self.shape[0], self.together):
            yield slice(first, min(first + self.together, self.shape[0]))

    def mapped(self, dtype: Any, change: Callable[[NDArray[Any]], NDArray[Any]]) -> MadeRows:
        """Return the array of what `change` makes of the values of any rows."""

        def make(first: int, end: int) -> NDArray[Any]:
            return change(self[first:end])

        return self.like(dtype, make)

    def like(
        self, dtype: Any, make: MakeRows, shape: tuple[int, int] | None = None
    ) -> MadeRows:  # fmt: skip
        """Return another layer of the same map, whose rows are cheap to make."""
        return MadeRows(
            shape or self.shape, dtype, make, together=self.together, room=self.room
        )  # fmt: skip

    def slab_by_slab(self, dtype: Any, make: MakeRows) -> MadeRows:
        """Return another layer of the same map, whose rows are made slab by slab.

        All are kept if there is room, else one for each thread and one more.
        """
        height, width = self.shape
        keep = thread_count() + 1
        if self.room.take(height * width * np.dtype(dtype).itemsize):
            keep = max(keep, -(-height // self.together))
        return MadeRows(
            self.shape, dtype, make, together=self.together, keep=keep, room=self.room
        )  # fmt: skip

    def _slab(self, number: int) -> NDArray[Any]:
        """Return a slab, made here unless another thread has made it, or does so just now."""
        with self._lock:
            slab = self._kept.get(number)
            is_mine = slab is None
            if slab is None:
                slab = self._kept[number] = Future()
                while len(self._kept) > self._keep:
                    self._kept.popitem(last=False)
            else:
                self._kept.move_to_end(number)
        if is_mine:
            first = number * self.together
            try:
                rows = self._make(first, min(first + self.together, self.shape[0]))
                rows.flags.writeable = False  # others are given the same
                slab.set_result(rows)
            except BaseException as error:
                slab.set_exception(error)
                with self._lock:
                    self._kept.pop(number, None)
                raise
        return slab.result()


Rows = NDArray[Any] | MadeRows
"""A layer by rows, in memory or not."""


def looked_up(values: Rows, table: NDArray[Any]) -> Rows:
    """Return the table's entry for each value, as `mapdeal.kernels.lookup.look_up` does."""
    if isinstance(values, MadeRows):
        return values.mapped(table.dtype, lambda part: look_up(part, table))
    return look_up(values, table)


def counts_of_rows(values: Rows) -> NDArray[np.int64]:
    """Return how often each value occurs, as `mapdeal.kernels.lookup.histogram` does."""
    parts = (histogram(values[slab]) for slab in slabs_of(values))
    return sum(parts, start=np.zeros(256, dtype=np.int64))


def slabs_of(values: Rows) -> Iterator[slice]:
    """Yield slices of rows that together are all: a single one of an array in memory."""
    if isinstance(values, MadeRows):
        yield from values.slabs()
    else:
        yield slice(0, len(values))
