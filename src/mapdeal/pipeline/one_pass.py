"""One pass through the rows of a lazy layer for all files that are made of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError
from mapdeal.formats.npz import Grid
from mapdeal.formats.transaction import Begun, PutRows, RowsWriter, Transaction
from mapdeal.kernels.blocks import blocks_of, made_by_rows, report_rows


@contextmanager
def one_pass(transaction: Transaction, grid: Grid) -> Iterator[Grid]:
    """Write all files of a grid within a ``with`` block in one pass.

    Its rows are then made once for all of them, where layers have no room to be kept. Files of a
    grid in memory are written as ever, at the same time.
    """
    if not grid.is_lazy:
        yield grid
        return
    rows = _Pass(grid)
    with transaction.together(rows.write_all):
        yield rows.asked


class _Pass:
    """A pass through the rows of a grid, from the first to the last."""

    def __init__(self, grid: Grid) -> None:
        layer = grid.layer

        def handed_on(rows: slice) -> NDArray[np.generic]:
            values = layer[rows]
            self._hand_on(rows)
            return values

        self._layer = layer
        self._next = 0
        self._puts: list[PutRows] = []
        self.asked: Grid = grid.with_layer(made_by_rows(layer, layer.dtype, handed_on))

    def write_all(self, files: Sequence[Begun]) -> None:
        """Write all files."""
        finishes = []
        for path, file, writer in files:
            if isinstance(writer, RowsWriter):
                with _failing_at(path):
                    put, finish = writer.begin(file)
                self._puts.append(_named(path, put))
                finishes.append((path, finish))
        for path, file, writer in files:
            if not isinstance(writer, RowsWriter):
                with _failing_at(path):
                    writer(file)
        for block in blocks_of(self._layer):
            if block.stop > self._next:
                self._hand_on(slice(self._next, block.stop))
        for path, finish in finishes:
            with _failing_at(path):
                finish()

    def _hand_on(self, rows: slice) -> None:
        if rows.start != self._next:  # asked for once more
            return
        for put in self._puts:
            put(rows)
        self._next = rows.stop
        report_rows(self._layer, rows)


def _named(path: Path, put: PutRows) -> PutRows:
    def put_here(rows: slice) -> None:
        with _failing_at(path):
            put(rows)

    return put_here


@contextmanager
def _failing_at(path: Path) -> Iterator[None]:
    """Name the file that cannot be written, for instance on a full disk."""
    try:
        yield
    except OSError as error:
        rule = f"cannot be written: {error.strerror or error}"
        raise FileAccessError(rule, source=path) from None
