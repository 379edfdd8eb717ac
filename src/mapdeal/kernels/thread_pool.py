"""Threads that do what they are given, as many as the system has to give."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from functools import partial
from queue import Empty, SimpleQueue
from threading import Semaphore, Thread
from typing import Any, TypeVar

from mapdeal.kernels.threads import is_started

_T = TypeVar("_T")


class ThreadPool(Executor):
    """Threads that do what they are given; fewer where the system has no more to give.

    Notes
    -----
    `concurrent.futures.ThreadPoolExecutor` keeps work that it has refused for want of a thread.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._threads: list[Thread] = []
        self._waiting: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = SimpleQueue()
        self._idle = Semaphore(0)

    def submit(self, function: Callable[..., _T], /, *args: Any, **kwargs: Any) -> Future[_T]:
        """Have a thread call a function; return the future of its result."""
        future: Future[_T] = Future()
        work = partial(function, *args, **kwargs)
        if not self._idle.acquire(blocking=False) and len(self._threads) < self._size:
            thread = Thread(target=self._serve, daemon=True)
            self._threads.append(thread)  # first: Ctrl-C may come as soon as it runs
            if not is_started(thread):
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
            if thread.ident is not None:  # else it had not begun when Ctrl-C came
                thread.join()

    def _serve(self) -> None:
        while (task := self._waiting.get()) is not None:
            _do(*task, BaseException)
            del task  # what it has made is not to be kept until there is another
            self._idle.release()
        self._waiting.put(None)  # for the other threads


def _do(
    future: Future[Any], work: Callable[[], Any], told: type[BaseException]
) -> None:  # fmt: skip
    """Work, and set the result of the future, or its error."""
    if not future.set_running_or_notify_cancel():
        return
    try:
        result = work()
    except told as error:
        future.set_exception(error)
    else:
        future.set_result(result)
