"""Putting signals off while something is done that must not be left in the middle."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# SIGINT comes first: once it is put off, nothing is raised in the middle of putting off the others.
_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")


@contextmanager
def signals_put_off() -> Iterator[None]:
    """Delay signals that end the process until the end of the block.

    Python handles signals in the main thread only: in other threads there is nothing to delay.
    The effect of a signal, an exception or the end of the process, then follows the block.
    SIGKILL cannot be delayed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers: dict[int, Any] = {}
    came: list[int] = []
    try:
        for number in (getattr(signal, name, None) for name in _ENDING):
            handler = None if number is None else signal.getsignal(number)
            if number is None or handler in (None, signal.SIG_IGN):  # None: not set by Python
                continue
            handlers[number] = handler
            signal.signal(number, lambda which, _: came.append(which))
        yield
    finally:
        for number, handler in reversed(handlers.items()):
            signal.signal(number, handler)
        for number in dict.fromkeys(came):
            signal.raise_signal(number)
