"""Progress of maps that are processed block by block."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

from mapdeal.kernels.blocks import rows_reported
from mapdeal.pipeline.settings import Advance, ProgressCallback

_STEPS = 1000  # of one pass through a layer


class Told:
    """Reports how much of some passes through lazy layers is done."""

    def __init__(self, advance: Advance, passes: int) -> None:
        self._advance = advance
        self._passes = passes
        self._lock = Lock()
        self._done = 0.0
        self._taken = 0

    def tell(self, rows: int, height: int) -> None:
        """Take note of some rows of a layer of a height, from any thread."""
        with self._lock:
            self._done += rows / height
            self._reach(min(int(_STEPS * self._done + 1e-6), _STEPS * self._passes))

    def finish(self) -> None:
        """Report what is left: a pass that was not needed, since what it finds was known."""
        with self._lock:
            self._reach(_STEPS * self._passes)

    def _reach(self, steps: int) -> None:
        if steps > self._taken:
            self._advance(steps - self._taken)
            self._taken = steps


@contextmanager
def passes_reported(progress: ProgressCallback | None, passes: int) -> Iterator[None]:
    """Report the passes through lazy layers that are made within a ``with`` block."""
    if progress is None:
        yield
        return
    with progress(passes * _STEPS) as advance:
        told = Told(advance, passes)
        with rows_reported(told.tell):
            yield
        told.finish()


@contextmanager
def report_nothing(_: int) -> Iterator[Advance]:
    yield lambda _: None
