"""How far the writing of grids is that are too large for memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock

from mapdeal.formats.npz import AnyGrid
from mapdeal.grid.large import LargeCosts, LargeField, LargeMap, told_of_rows
from mapdeal.pipeline.settings import ProgressCallback
from mapdeal.pipeline.stage_list import Step

_STEPS = 1000  # of one pass through a layer


class Written:
    """Tells how much of large grids has been written.

    Parameters
    ----------
    advance : callable
        Told of steps.
    """

    def __init__(self, advance: Callable[[int], object]) -> None:
        self._advance = advance
        self._lock = Lock()

    def watched(self, grid: AnyGrid) -> AnyGrid:
        """Return the grid; of one that is too large for memory, one that tells of its rows."""
        if not isinstance(grid, (LargeMap, LargeField, LargeCosts)):
            return grid
        height, done = grid.shape[0], 0

        def tell(rows: int) -> None:
            nonlocal done
            with self._lock:  # files are written in several threads
                before = done * _STEPS // height
                done += rows
                steps = done * _STEPS // height - before
                if steps:
                    self._advance(steps)

        return told_of_rows(grid, tell)


@contextmanager
def written(watch: ProgressCallback | None, passes: int) -> Iterator[Written]:
    """ProgressCallback the writing of layers that are gone through so many times."""
    with (watch or nobody)(passes * _STEPS) as advance:
        yield Written(advance)


@contextmanager
def nobody(_: int) -> Iterator[Callable[[int], object]]:
    """Give what tells nobody of the steps: a `ProgressCallback` where none was given."""
    yield lambda _: None


def passes_of(step: Step, suffix: str) -> int:
    """Return how often what a step has made is gone through to write a file of that kind."""
    if suffix in (".npz", ".npy"):
        return 1
    if suffix == ".png":  # a field's colours depend on its range
        return 2 if step.name == "esdf" else 1
    if suffix not in (".yaml", ".yml"):
        return 0  # the image is written with its YAML
    if step.name == "esdf":  # and so do the values of this view
        return 2 if step.view["view"] == "seed" else 1
    return 1 if step.name == "cost" else 2  # trinary, unless a value lies in between
