"""The command line as a process of its own: a quick start and a quick end.

A run over a small map is over in a tenth of a second, less than what an interpreter takes to
look for garbage among a thousand modules and to take them apart.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
import time
from contextlib import suppress

TYPE_CHECKING = False  # the module typing takes longer than the rest of this one
if TYPE_CHECKING:
    from typing import NoReturn

_ENDING = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, n)]
_AT_ONCE = 5.0
"""Seconds within which further signals count as the first: timeout(1) sends each twice."""

_reserve = [bytes(4 << 20)]
"""Address space that is released when memory runs out: reporting that needs some itself."""

_ended_by = signal.SIGINT
_ended_at = float("-inf")
_has_begun = False


def run_process() -> NoReturn:
    """Run the command line and end the process with its exit code."""
    own = [number for number in _ENDING if signal.getsignal(number) != signal.SIG_IGN]
    for number in own:
        signal.signal(number, _end)
    # None where the process was started without; files are not to get these numbers
    if sys.stdin is None:
        os.open(os.devnull, os.O_RDONLY)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    gc.disable()  # until the command is imported, see `begin_work`
    try:
        from mapdeal.kernels.engine import prepare_libraries

        prepare_libraries()
        if _version_is_printed():
            code = 0
        else:
            from mapdeal.cli.main import main

            code = main()
    except KeyboardInterrupt:  # once more, while main tells of the first one
        code = ending()[1]
    except (MemoryError, SystemError) as error:  # main had no memory to report it
        release_reserve()
        from mapdeal.errors import refusal_of_the_system

        refusal = refusal_of_the_system(error)
        if refusal is None:
            raise
        print(f"error: {refusal}", file=sys.stderr)  # noqa: T201
        code = refusal.exit_code
    for number in own:  # from here on they come too late
        signal.signal(number, signal.SIG_IGN)
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # main has told of it
            stream.flush()
    # All files are closed and all threads have ended. So there is nothing to take apart but what
    # multiprocessing has made, and what a signal has kept from being removed.
    atexit._run_exitfuncs()  # noqa: SLF001
    os._exit(code)


def _version_is_printed() -> bool:
    """Print the version, if that is all that is asked for: without typer that takes half as long.

    Errors are left to the command line.
    """
    if sys.argv[1:] != ["--version"]:
        return False
    try:
        from mapdeal.kernels.engine import version_text

        print(version_text(), flush=True)  # noqa: T201
    except Exception:  # noqa: BLE001 - told by whoever prints it then
        return False
    return True


def release_reserve() -> None:
    """Release the memory that is reserved for reporting errors."""
    _reserve.clear()


def begin_work() -> None:
    """End the start: signals become exceptions, and garbage is looked for, but not in imports."""
    global _has_begun
    _has_begun = True
    if not gc.isenabled():
        gc.freeze()
        gc.enable()


def ending() -> tuple[str, int]:
    """Return how to report the signal that has ended the command, and the exit code for it."""
    what = "interrupted" if _ended_by == signal.SIGINT else f"terminated by {_ended_by.name}"
    return what, 128 + _ended_by


def _end(number: int, _: object) -> None:
    """Answer a signal.

    An exception in the middle of an import becomes an error that hides it. So long as nothing has
    begun, the process just ends.
    """
    global _ended_by, _ended_at
    is_repeated = time.monotonic() - _ended_at <= _AT_ONCE
    if not is_repeated:
        _ended_by, _ended_at = signal.Signals(number), time.monotonic()
    what, code = ending()
    if not _has_begun:
        try:
            os.write(2, f"error: {what}\n".encode())
        finally:  # whether or not there is anybody to read it
            os._exit(code)
    if not is_repeated:
        raise KeyboardInterrupt
