"""Threads that share the work of a kernel, and claims of memory for its tables."""

from __future__ import annotations

import os
from _thread import start_new_thread
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar, copy_context
from functools import partial
from itertools import pairwise, takewhile
from queue import Empty, SimpleQueue
from threading import Lock, Semaphore
from typing import Any, TypeVar

from mapdeal.kernels.engine import check_room

_PARTS_PER_THREAD = 8  # so that parts of uneven cost even out
CELLS_WORTH_A_THREAD = 1 << 18  # below, starting a thread takes longer than it saves
_ROWS_CELLS = 1 << 16  # of a part: temporary arrays of this size stay in the cache
_MOST_THREADS = 1024  # more never help, and libraries refuse counts above C integers
_STACK = 16 << 20  # bytes free before a thread starts: its stack, and some more
_LONGEST_START = 2.0  # seconds
_T = TypeVar("_T")
_chosen: ContextVar[int | None] = ContextVar("threads", default=None)
_claim: ContextVar[Callable[[int], object]] = ContextVar("claim", default=lambda _: None)


def available_threads() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def thread_count() -> int:
    return _chosen.get() or available_threads()


@contextmanager
def set_within(variable: ContextVar[_T], value: _T) -> Iterator[None]:
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


def use_threads(count: int | None) -> AbstractContextManager[None]:
    """Limit kernels and writers to `count` threads each within a ``with`` block."""
    return set_within(_chosen, min(count, _MOST_THREADS) if count else _chosen.get())


class Worker:
    """A thread; unlike `threading.Thread`, its start never hangs if memory runs out."""

    def __init__(self, work: Callable[[], object]) -> None:
        self._work = work
        self._ended = Lock()
        self._decided = Lock()  # acquired by the thread as it begins, or by `start` to abandon it

    @property
    def has_begun(self) -> bool:
        return self._decided.locked()

    def start(self) -> bool:
        """Return whether the system has started a thread, and the thread its work."""
        starting = Lock()
        try:
            check_room(_STACK)
            starting.acquire()
            start_new_thread(self._begin, (starting,))
        except (OSError, RuntimeError, MemoryError):
            return False
        # A thread without memory for its first call ends silently.
        return starting.acquire(timeout=_LONGEST_START) or not self._decided.acquire(False)

    def join(self) -> None:
        with self._ended:
            pass

    def _begin(self, starting: Lock) -> None:
        with self._ended:
            if self._decided.acquire(False):
                starting.release()
                self._work()


def in_parallel(work: Callable[[int, int], object], count: int) -> None:
    """Call `work` in threads on the first and end of parts that together are ``range(count)``."""
    threads = min(thread_count(), count)
    if threads <= 1:
        if count:
            work(0, count)
        return
    parts = min(count, _PARTS_PER_THREAD * threads)
    waiting = deque(pairwise([count * k // parts for k in range(parts + 1)]))
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

    workers = [Worker(partial(copy_context().run, take_parts)) for _ in range(threads - 1)]
    started = list(takewhile(Worker.start, workers))
    take_parts()
    for thread in started:
        thread.join()
    if errors:
        raise errors[0]


def for_rows(work: Callable[[slice], object], shape: tuple[int, ...], step: int = 0) -> None:
    """Call `work` in threads on slices that together are all rows of an array."""
    height, width = shape
    step = step or max(1, _ROWS_CELLS // max(width, 1))

    def work_on(first: int, end: int) -> None:
        for k in range(first, end):
            work(slice(k * step, min((k + 1) * step, height)))

    in_bands(work_on, -(-height // step), height * width)


def in_bands(work: Callable[[int, int], object], bands: int, cells: int) -> None:
    if cells >= CELLS_WORTH_A_THREAD:
        in_parallel(work, bands)
    elif bands:
        work(0, bands)


class ThreadPool(Executor):
    """Executor with up to `size` threads; with fewer if the system refuses to start more."""

    # `concurrent.futures.ThreadPoolExecutor` raises if it cannot start a thread, but still queues
    # the work.

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
            self._threads.append(thread)  # before the start, which Ctrl-C may interrupt
            if not thread.start():
                self._threads.remove(thread)
                self._size = len(self._threads)
        if self._threads:
            self._waiting.put((future, work))
        else:
            _do(future, work, Exception)  # Ctrl-C is raised in the caller of submit
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the threads after all queued work, or after work begun if futures are cancelled."""
        while cancel_futures:
            try:
                task = self._waiting.get_nowait()
            except Empty:
                break
            if task is not None:
                task[0].cancel()
        self._waiting.put(None)
        for thread in self._threads if wait else ():
            if thread.has_begun:  # Ctrl-C may have come before the thread began
                thread.join()

    def _serve(self) -> None:
        while (task := self._waiting.get()) is not None:
            _do(*task, BaseException)
            del task  # frees the result while this thread waits
            self._idle.release()
        self._waiting.put(None)  # for the other threads


def _do(future: Future[Any], work: Callable[[], Any], caught: type[BaseException]) -> None:
    if not future.set_running_or_notify_cancel():
        return
    try:
        result = work()
    except caught as error:
        future.set_exception(error)
    else:
        future.set_result(result)


def tables_claimed(claim: Callable[[int], object]) -> AbstractContextManager[None]:
    return set_within(_claim, claim)


def claim_tables(size: int) -> None:
    """Report the bytes of tables before they are allocated; the caller's limit may refuse them."""
    _claim.get()(size)
