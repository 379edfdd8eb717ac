"""Layers of npz files whose rows are read when they are asked for, from the first one on."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from threading import Lock
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.formats.budget import PIECES, claim
from mapdeal.formats.npz_reader import NpzReader, fill
from mapdeal.grid.values import OCCUPIED, UNKNOWN
from mapdeal.kernels.blocks import Layer, LazyLayer

_SKIPPED_TOGETHER = 1 << 22


class NpzRows(NpzReader):
    """The entries of an npz file, of which layers are lazy.

    Notes
    -----
    What is compressed has but one order: rows before those that were read last are read by
    starting again. Memory is taken for the rows that are asked for, so data that expand a
    thousand times do no harm. What is damaged is found when its rows are read, a wrong checksum
    with the last row. A layer that is stored column by column is held in memory as a whole.
    """

    def __init__(self, path: Path, max_cells: int, block_height: int) -> None:
        super().__init__(path, max_cells)
        self._block_height = block_height
        self._files = ExitStack()

    def __exit__(self, *details: object) -> None:
        self._files.close()
        super().__exit__(*details)

    def layer(self, name: str, dtype: type[np.generic]) -> Layer:
        """Return a lazy layer with values of that type."""
        with self._opened(name) as entry:
            if entry.is_fortran:
                return super().layer(name, dtype)
            self._check_layer(name, entry, dtype)
            height, width = entry.shape
        rows = _Rows(self, name, (height, width), np.dtype(dtype))
        self._files.callback(rows.close)
        layer = LazyLayer((height, width), dtype, rows.read, block_height=self._block_height)
        return cast("Layer", layer)


class _Rows:
    """The rows of a layer, read one after the other."""

    def __init__(
        self, reader: NpzRows, name: str, shape: tuple[int, int], dtype: np.dtype[Any]
    ) -> None:
        self._reader = reader
        self._name = name
        self._shape = shape
        self._dtype = dtype
        self._file: Any = None
        self._next = 0
        self._lock = Lock()

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def read(self, rows: slice) -> NDArray[Any]:
        """Return the values of some rows."""
        height, width = self._shape
        size = (rows.stop - rows.start) * width * self._dtype.itemsize
        claim(self._reader.path, size + min(PIECES, size))
        with self._lock, self._reader.damage_told(self._name):
            if self._file is None or rows.start < self._next:
                self._begin()
            self._skip((rows.start - self._next) * width * self._dtype.itemsize)
            values = np.empty((rows.stop - rows.start, width), dtype=self._dtype)
            fill(self._file, values)
            self._next = rows.stop
            if self._next == height:
                self._file.read(1)  # so that the checksum is verified
        self._check(values)
        return values

    def _begin(self) -> None:
        self.close()
        self._file, self._next = self._reader.opened_behind_header(self._name), 0

    def _skip(self, count: int) -> None:
        while count:
            part = self._file.read(min(count, _SKIPPED_TOGETHER))
            if not part:
                raise EOFError("the data end early")
            count -= len(part)

    def _check(self, values: NDArray[Any]) -> None:
        """Refuse what a map or costs in memory would be refused for."""
        if self._dtype != np.int8 or not values.size:
            return
        lowest, highest = int(values.min()), int(values.max())
        if lowest < UNKNOWN or highest > OCCUPIED:
            rule = f"{self._name} must lie in -1..100"
            raise ParameterError(rule, got=(lowest, highest)).in_file(self._reader.path)
