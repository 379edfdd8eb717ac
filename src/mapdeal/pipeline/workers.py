"""Processes that work for this one.

They hold the reading end of a pipe of which that process alone has the other end. When it is
closed, whether on purpose or because the process is gone, a worker stops: what it does ends as
by an exception, so that temporary files are removed.
"""

from __future__ import annotations

import atexit
import contextlib
import errno
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures import wait as wait_for
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.context import BaseContext
from typing import Any, NoReturn, TypeVar

from mapdeal.errors import FileAccessError
from mapdeal.files.transaction import folder_for_sockets, signals_put_off
from mapdeal.kernels.engine import VARIABLE
from mapdeal.kernels.threads import is_started
from mapdeal.pipeline.batch import Job, Outcome, Submit, Work

_T = TypeVar("_T")

_SECONDS_TO_CLEAN_UP = 10.0
_SECONDS_BETWEEN_LOOKS = 0.1
_STOPPED = 128 + signal.SIGTERM

_LONGEST_FOLDER = 107 - len("/pymp-12345678/listener-12345678")
"""Bytes that the name of the folder for temporary files may have, so that of a socket fits."""

_PRELOADED = (
    "mapdeal.pipeline.worker_server",
    "mapdeal.pipeline.batch", "mapdeal.pipeline.workers", "mapdeal.pictures.layers",
    "PIL.Image", "PIL.ImageDraw", "PIL.ImageFont", "PIL.PngImagePlugin", "tokenize",
)  # fmt: skip
"""What a run imports, some of it late: imported once, where workers are forked from."""


class ProcessWorkers:
    """Worker processes on this machine."""

    def __init__(self, size: int) -> None:
        self.size = size

    @contextmanager
    def started(self, size: int, work: Work) -> Iterator[Submit]:
        """Run processes within a ``with`` block, stopped early if an exception leaves it."""
        with ExitStack() as stack:
            with _start_told():
                context = _context()
                lifeline, held = multiprocessing.Pipe(duplex=False)
                stack.callback(lifeline.close)
                stack.callback(held.close)
                executor = ProcessPoolExecutor(
                    size, context, initializer=_set_up,
                    initargs=(lifeline, os.environ.get(VARIABLE)),
                )  # fmt: skip
                stack.callback(_shut_down, executor)

            is_lost = threading.Event()

            def look_at(future: Future[Outcome]) -> None:
                if not future.cancelled() and isinstance(future.exception(), BrokenProcessPool):
                    is_lost.set()

            def submit(job: Job) -> Future[Outcome]:
                try:
                    future = _sent(executor, _stoppable, work, job)
                except (OSError, EOFError) as error:  # of another process that it needs
                    is_lost.set()
                    raise BrokenProcessPool(str(error)) from None
                except BrokenProcessPool:
                    is_lost.set()
                    raise
                future.add_done_callback(look_at)
                return future

            try:
                with _start_told():
                    _wait_for_first(executor)
                yield submit
            except BaseException:
                held.close()
                raise
            if is_lost.is_set():
                # A pool that has lost a process ends the others, but not one that is started at
                # that moment, and would wait for it for ever.
                held.close()


@contextmanager
def _start_told() -> Iterator[None]:
    """Turn what the system says to the start of processes within a block into one error."""
    try:
        yield
    except (OSError, EOFError, RuntimeError, ImportError, NotImplementedError) as error:
        # a pool is broken, and a server gone, because of what they could not be given
        why = getattr(error, "strerror", None) or "the system has no more to give"
        rule = f"cannot be started: {why}"
        hint = "--jobs 1 needs none; ulimit -a shows the limits"
        raise FileAccessError(rule, source="worker processes", hint=hint) from None


def _sent(executor: ProcessPoolExecutor, function: Callable[..., _T], *given: Any) -> Future[_T]:
    """Send work to a pool, which may start a process for it, not to be lost by a Ctrl-C."""
    with signals_put_off(), _terminal_blocked():
        return executor.submit(function, *given)


def _shut_down(executor: ProcessPoolExecutor) -> None:
    """Wait until the processes of a pool have ended, without the jobs that are not begun."""
    with contextlib.suppress(RuntimeError):  # of a pool whose own thread could not be started
        executor.shutdown(cancel_futures=True)


def _wait_for_first(executor: ProcessPoolExecutor) -> None:
    """Wait until the first process has started, and the threads that serve the pool."""
    failures: list[object] = []
    before, threading.excepthook = threading.excepthook, failures.append
    try:
        first = _sent(executor, int)
        while not first.done():  # without its threads a pool never comes to do it
            if failures:
                raise RuntimeError
            wait_for([first], timeout=_SECONDS_BETWEEN_LOOKS)
        first.result()
    finally:
        threading.excepthook = before


def _context() -> BaseContext:
    """Return how processes are started: forked from one that has imported everything."""
    # Never from this one: it may have threads, whose locks a fork would copy as they are. Where the
    # server cannot have its socket, as the folder for temporary files has too long a name or is
    # none, each process starts afresh.
    if "forkserver" in multiprocessing.get_all_start_methods():
        from multiprocessing import forkserver, resource_tracker

        # Ctrl-C goes to all processes of a terminal. Here it is this one's to answer; a worker
        # that is only starting would print a traceback. It inherits that the signal is blocked.
        # The tracker comes first, since its start unblocks it again; it ignores all but SIGHUP.
        with _terminal_blocked():
            resource_tracker.ensure_running()
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(list(_PRELOADED))
        try:
            if len(os.fsencode(folder_for_sockets())) > _LONGEST_FOLDER:
                raise OSError("AF_UNIX path too long")  # before a folder is made, to be left there
            with _terminal_blocked():
                forkserver.ensure_running()
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EMFILE, errno.ENFILE, errno.ENOMEM):
                raise
        else:
            return context
    return multiprocessing.get_context("spawn")


@contextmanager
def _terminal_blocked() -> Iterator[None]:
    """Block what a terminal sends to all its processes, here and in processes started within."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGHUP])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _StoppedError(BaseException):
    """The worker is to stop; no Exception, so that nothing takes it for a failure."""


_is_busy = False
_is_stopping = False


def _set_up(lifeline: Connection, engine: str | None) -> None:
    if engine is not None:  # the server's environment may be older
        os.environ[VARIABLE] = engine
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _stop)
    if not is_started(threading.Thread(target=_watch, args=(lifeline,), daemon=True)):
        os._exit(_STOPPED)  # rather than outlive the command


def _watch(lifeline: Connection) -> NoReturn:
    """Stop the worker when the pipe's other end is closed."""
    wait([lifeline])
    with contextlib.suppress(OSError):
        if hasattr(signal, "pthread_kill"):  # the main thread may wait in a system call
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
            time.sleep(_SECONDS_TO_CLEAN_UP)
    os._exit(_STOPPED)


def _stop(*_: object) -> None:
    """End at once, or unwind what is being done, which is not to be disturbed."""
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
        # removes what the exception came too early for, as multiprocessing itself does
        atexit._run_exitfuncs()  # noqa: SLF001
        os._exit(_STOPPED)
