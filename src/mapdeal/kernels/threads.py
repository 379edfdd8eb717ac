"""Threads that share the work of a kernel."""

from __future__ import annotations

import os
from _thread import start_new_thread
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from functools import partial
from itertools import pairwise, takewhile
from queue import Empty, SimpleQueue
from threading import Lock, Semaphore
from typing import Any, TypeVar

from mapdeal.kernels.engine import check_room

_PARTS_PER_THREAD = 8  # so that parts of uneven cost even out
CELLS_WORTH_A_THREAD = 1 << 18  # below, starting a thread takes longer than it saves
_ROWS_CELLS = 1 << 16
"""Cells that are worked on together: temporary arrays of so many stay in the cache."""

_MOST_THREADS = 1024
"""More are of no use anywhere, and libraries take no count that C cannot hold."""

_STACK = 16 << 20
"""Bytes to be free before a thread is started: its stack, and some more to begin with."""

_chosen: ContextVar[int | None] = ContextVar("threads", default=None)


def available_threads() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def thread_count() -> int:
    """Return the number of threads to use: what `use_threads` says, else `available_threads`."""
    return _chosen.get() or available_threads()


@contextmanager
def use_threads(count: int | None) -> Iterator[None]:
    """Have kernels and writers use at most `count` threads each within a ``with`` block."""
    token = _chosen.set(min(count, _MOST_THREADS) if count else _chosen.get())
    try:
        yield
    finally:
        _chosen.reset(token)


class Worker:
    """A thread; `threading.Thread` waits for ever for one that finds no memory to begin with."""

    def __init__(self, work: Callable[[], object]) -> None:
        self._work = work
        self._ended = Lock()
        self.has_begun = False

    def start(self) -> bool:
        """Return whether the system has a thread to give, and memory for it to begin with."""
        told = Lock()
        try:
            check_room(_STACK)
            told.acquire()
            start_new_thread(self._begin, ([_Releaser(told)],))
        except (OSError, RuntimeError, MemoryError):
            return False
        told.acquire()
        return self.has_begun

    def join(self) -> None:
        """Wait until a thread that has begun is done."""
        with self._ended:
            pass

    def _begin(self, token: list[_Releaser]) -> None:
        with self._ended:
            self.has_begun = True
            token.clear()
            self._work()


class _Releaser:
    """Releases a lock when nothing holds it: of a thread that failed at once, all that is seen."""

    def __init__(self, lock: Lock) -> None:
        self._lock = lock

    def __del__(self) -> None:
        self._lock.release()


def in_parallel(work: Callable[[int, int], object], count: int) -> None:
    """Call `work` on parts of ``range(count)`` that together are all of it."""
    threads = min(thread_count(), count)
    if threads <= 1:
        if count:
            work(0, count)
        return
    parts = min(count, _PARTS_PER_THREAD * threads)
    edges = [count * k // parts for k in range(parts + 1)]
    waiting = deque(pairwise(edges))
    errors: list[BaseException] = []

    def take_parts() -> None:
        while not errors:
            try:
                part = waiting.popleft()
            except IndexError:
                return
            try:
                work(*part)
            except BaseException as error:  # noqa: BLE001 - raised again in the caller's thread
                errors.append(error)

    others = [Worker(partial(copy_context().run, take_parts)) for _ in range(threads - 1)]
    others = list(takewhile(Worker.start, others))
    take_parts()
    for thread in others:
        thread.join()
    if errors:
        raise errors[0]


def for_rows(
    work: Callable[[slice], object], shape: tuple[int, ...], step: int | None = None
) -> None:
    """Call `work` on slices of rows that together are all of an array, in threads."""
    height, width = shape
    step = step or max(1, _ROWS_CELLS // max(width, 1))
    bands = -(-height // step)

    def some(first: int, end: int) -> None:
        for k in range(first, end):
            work(slice(k * step, min((k + 1) * step, height)))

    in_bands(some, bands, height * width)


def in_bands(work: Callable[[int, int], object], bands: int, cells: int) -> None:
    """Call `work` on parts of ``range(bands)``, in threads if so many cells are worth them."""
    if cells >= CELLS_WORTH_A_THREAD:
        in_parallel(work, bands)
    elif bands:
        work(0, bands)


_T = TypeVar("_T")


class ThreadPool(Executor):
    """Threads that do what they are given; fewer where the system has no more to give."""

    # `concurrent.futures.ThreadPoolExecutor` keeps work that it has refused for want of a thread.

    def __init__(self, size: int) -> None:
        self._size = size
        self._threads: list[Worker] = []
        self._waiting: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = SimpleQueue()
        self._idle = Semaphore(0)

    def submit(self, function: Callable[..., _T], /, *args: Any, **kwargs: Any) -> Future[_T]:
        future: Future[_T] = Future()
        work = partial(function, *args, **kwargs)
        if not self._idle.acquire(blocking=False) and len(self._threads) < self._size:
            thread = Worker(self._serve)
            self._threads.append(thread)  # first: Ctrl-C may come as soon as it runs
            if not thread.start():
                self._threads.remove(thread)
                self._size = len(self._threads)
        if self._threads:
            self._waiting.put((future, work))
        else:
            _do(future, work, Exception)  # Ctrl-C is for this thread's caller
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the threads once they have done what waits, or only what they have begun."""
        while cancel_futures:
            try:
                task = self._waiting.get_nowait()
            except Empty:
                break
            if task is not None:
                task[0].cancel()
        self._waiting.put(None)
        for thread in self._threads if wait else ():
            if thread.has_begun:  # else it had not begun when Ctrl-C came
                thread.join()

    def _serve(self) -> None:
        while (task := self._waiting.get()) is not None:
            _do(*task, BaseException)
            del task  # what it has made is not to be kept until there is another
            self._idle.release()
        self._waiting.put(None)  # for the other threads


def _do(future: Future[Any], work: Callable[[], Any], told: type[BaseException]) -> None:
    if not future.set_running_or_notify_cancel():
        return
    try:
        result = work()
    except told as error:
        future.set_exception(error)
    else:
        future.set_result(result)
