"""How far the writing of maps is that are processed block by block."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.npz import Grid
from mapdeal.kernels.blocks import mapped
from mapdeal.pipeline.settings import Advance, ProgressCallback

_STEPS = 1000  # of one pass through a layer


class Written:
    """Reports how much of lazy layers has been written.

    Parameters
    ----------
    advance : callable
        Called with the steps that were taken.
    """

    def __init__(self, advance: Advance) -> None:
        self._advance = advance
        self._lock = Lock()
        self._taken = 0

    def watched(self, grid: Grid) -> Grid:
        """Return the grid; if it is lazy, one that reports how many of its rows were made."""
        if not grid.is_lazy:
            return grid
        height, done = grid.shape[0], 0

        def count(part: NDArray[np.generic]) -> NDArray[np.generic]:
            nonlocal done
            with self._lock:  # files are written in several threads
                before = done * _STEPS // height
                done += len(part)
                steps = done * _STEPS // height - before
                if steps:
                    self._taken += steps
                    self._advance(steps)
            return part

        return grid.with_layer(mapped(grid.layer, grid.layer.dtype, count))

    def finish(self, total: int) -> None:
        """Report what is left: rows around the region of a field, which nobody asks for."""
        if self._taken < total:
            self._advance(total - self._taken)


@contextmanager
def written(progress: ProgressCallback | None, passes: int) -> Iterator[Written]:
    """Report the writing of layers that are gone through so many times."""
    with (progress or report_nothing)(passes * _STEPS) as advance:
        watch = Written(advance)
        yield watch
        watch.finish(passes * _STEPS)


@contextmanager
def report_nothing(_: int) -> Iterator[Advance]:
    """Give a callback that reports nothing."""
    yield lambda _: None
