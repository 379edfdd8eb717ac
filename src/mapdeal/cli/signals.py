"""Signals, garbage collection and spare memory of the command line's process."""

from __future__ import annotations

import gc
import os
import signal
import time

_REPEAT_SECONDS = 5.0  # further signals within them count as the first: timeout(1) sends each twice
_reserve = [bytes(4 << 20)]  # released when memory runs out: reporting that needs some itself
_ended_by = signal.SIGINT
_ended_at = float("-inf")
_has_begun = False


def release_reserve() -> None:
    _reserve.clear()


def begin_work() -> None:
    """Turn signals into exceptions, and start garbage collection without the imported modules."""
    global _has_begun
    _has_begun = True
    if not gc.isenabled():
        gc.freeze()
        gc.enable()


def ending() -> tuple[str, int]:
    """Return how to report the signal that has ended the command, and the exit code for it."""
    cause = "interrupted" if _ended_by == signal.SIGINT else f"terminated by {_ended_by.name}"
    return cause, 128 + _ended_by


def end_on_signal(number: int, _: object) -> None:
    """Raise KeyboardInterrupt, or end the process if no work has begun."""
    # An exception in the middle of an import becomes an error that hides it.
    global _ended_by, _ended_at
    is_repeated = time.monotonic() - _ended_at <= _REPEAT_SECONDS
    if not is_repeated:
        _ended_by, _ended_at = signal.Signals(number), time.monotonic()
    cause, code = ending()
    if not _has_begun:
        try:
            os.write(2, f"error: {cause}\n".encode())
        finally:  # stderr may be closed
            os._exit(code)
    if not is_repeated:
        raise KeyboardInterrupt
