"""The command line as a process: a quick start and a quick end.

A run over a small map takes a tenth of a second. Garbage collection and interpreter shutdown over
a thousand modules would take longer, so both are skipped.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
from collections import deque
from contextlib import suppress

from mapdeal.cli.signals import end_on_signal, ending, release_reserve

TYPE_CHECKING = False  # the module typing takes longer than the rest of this one
if TYPE_CHECKING:
    from typing import NoReturn


def run_process() -> NoReturn:
    names = ("SIGINT", "SIGTERM", "SIGHUP")
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    handled = [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]
    for number in handled:
        signal.signal(number, end_on_signal)
    # A stream that was closed at the start is None; files must not get its number.
    if sys.stdin is None:
        os.open(os.devnull, os.O_RDONLY)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    # append runs in C: it works even in a thread that lacks memory for a Python frame
    unraisables: deque[sys.UnraisableHookArgs] = deque(maxlen=32)
    sys.unraisablehook = unraisables.append
    gc.disable()  # until the command is imported, see `begin_work`
    try:
        from mapdeal.kernels.engine import prepare_libraries

        prepare_libraries()
        code = 0
        if not _print_version_if_requested():
            from mapdeal.cli.main import main

            code = main()
    except KeyboardInterrupt:  # a second one, while main reports the first
        code = ending()[1]
    except (MemoryError, SystemError) as error:  # main had no memory to report it
        release_reserve()
        from mapdeal.errors import refusal_of_the_system

        if (refusal := refusal_of_the_system(error)) is None:
            raise
        print(f"error: {refusal}", file=sys.stderr)  # noqa: T201
        code = refusal.exit_code
    for unraisable in unraisables:
        _report_unless_a_thread_lacks_memory(unraisable)
    for number in handled:  # from here on they come too late
        signal.signal(number, signal.SIG_IGN)
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # main has reported it
            stream.flush()
    # All files are closed and all threads have ended. The exit functions remove what
    # multiprocessing has created, and what a signal has left behind.
    atexit._run_exitfuncs()  # noqa: SLF001
    os._exit(code)


def _report_unless_a_thread_lacks_memory(unraisable: sys.UnraisableHookArgs) -> None:
    # A thread that fails to start for lack of memory does no harm: other threads do its work.
    is_of_thread = "thread" in (unraisable.err_msg or "")
    if unraisable.exc_type is not MemoryError or not is_of_thread:
        sys.__unraisablehook__(unraisable)


def _print_version_if_requested() -> bool:
    """Print the version if only that is requested, without importing typer; return if it was."""
    if sys.argv[1:] != ["--version"]:
        return False
    try:
        from mapdeal.kernels.engine import version_text

        print(version_text(), flush=True)  # noqa: T201
    except Exception:  # noqa: BLE001 - the command line reports it when it prints the version
        return False
    return True
