"""Worker processes on this machine, which end with the process that started them.

They hold the reading end of a pipe of which that process alone has the other end. When it is
closed, whether on purpose or because the process is gone, a worker stops: what it does ends as
by an exception, so that temporary files are removed.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.context import BaseContext
from typing import NoReturn

from mapdeal.kernels.engine import VARIABLE
from mapdeal.pipeline.dispatch import Submit, Work
from mapdeal.pipeline.jobs import Job, Outcome

_SECONDS_TO_CLEAN_UP = 10.0
_STOPPED = 128 + signal.SIGTERM

_PRELOADED = (
    "mapdeal.pipeline.jobs", "mapdeal.pipeline.processes", "mapdeal.render.layers",
    "PIL.Image", "PIL.ImageDraw", "PIL.ImageFont", "PIL.PngImagePlugin", "tokenize",
)  # fmt: skip
"""What a run imports, some of it late: imported once, where workers are forked from."""


class ProcessWorkers:
    """Worker processes on this machine.

    Parameters
    ----------
    size : int
        How many.
    """

    def __init__(self, size: int) -> None:
        self.size = size

    @contextmanager
    def started(self, size: int, work: Work) -> Iterator[Submit]:
        """Have processes within a ``with`` block, stopped early if an exception leaves it."""
        context = _context()
        lifeline, held = multiprocessing.Pipe(duplex=False)
        executor = ProcessPoolExecutor(
            size, context, initializer=_set_up, initargs=(lifeline, os.environ.get(VARIABLE))
        )

        def submit(job: Job) -> Future[Outcome]:
            with _interrupted_later():  # it starts processes, which are not to be lost
                return executor.submit(_stoppable, work, job)

        try:
            yield submit
        except BaseException:
            held.close()
            raise
        finally:
            executor.shutdown(cancel_futures=True)
            held.close()
            lifeline.close()


def _context() -> BaseContext:
    """Return how processes are started: forked from one that has imported everything.

    Never from this one: it may have threads, whose locks a fork would copy as they are.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    from multiprocessing import forkserver, resource_tracker

    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(_PRELOADED))
    # Ctrl-C goes to all processes of a terminal. Here it is this one's to answer; a worker that
    # is only starting would print a traceback. It inherits that the signal is blocked. The
    # tracker comes first, since its start unblocks it again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return context


@contextmanager
def _interrupted_later() -> Iterator[None]:
    """Put a Ctrl-C off to the end of the block."""
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler or not _is_main_thread():
        yield
        return
    pressed: list[int] = []
    signal.signal(signal.SIGINT, lambda *_: pressed.append(1))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if pressed:
        raise KeyboardInterrupt


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


class _StoppedError(BaseException):
    """The worker is to stop; no Exception, so that nothing takes it for a failure."""


_is_busy = False
_is_stopping = False


def _set_up(lifeline: Connection, engine: str | None) -> None:
    """Make the process a worker."""
    if engine is not None:  # the server's environment may be older
        os.environ[VARIABLE] = engine
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _stop)
    threading.Thread(target=_watch, args=(lifeline,), daemon=True).start()


def _watch(lifeline: Connection) -> NoReturn:
    """Stop the worker when the pipe's other end is closed."""
    wait([lifeline])
    with contextlib.suppress(OSError):
        if hasattr(signal, "pthread_kill"):  # the main thread may wait in a system call
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
            time.sleep(_SECONDS_TO_CLEAN_UP)
    os._exit(_STOPPED)


def _stop(*_: object) -> None:
    """Answer SIGTERM: end at once, or unwind what is being done, which is not to be disturbed."""
    global _is_stopping
    if not _is_busy:
        os._exit(_STOPPED)
    if not _is_stopping:
        _is_stopping = True
        raise _StoppedError


def _stoppable(work: Work, job: Job) -> Outcome:
    """Do a job; end the process if it is to stop meanwhile."""
    global _is_busy
    try:
        _is_busy = True
        try:
            return work(job)
        finally:
            _is_busy = False
    except _StoppedError:
        os._exit(_STOPPED)
