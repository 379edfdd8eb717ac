"""The command line as a process: a quick start and a quick end.

A run over a small map takes a tenth of a second. The interpreter would take longer to look for
garbage among a thousand modules and to take them apart.
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

_ENDING = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, n)]


def run_process() -> NoReturn:
    own = [number for number in _ENDING if signal.getsignal(number) != signal.SIG_IGN]
    for number in own:
        signal.signal(number, end_on_signal)
    # A stream that was closed at the start is None; files must not get its number.
    if sys.stdin is None:
        os.open(os.devnull, os.O_RDONLY)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    # a thread without memory could not call a function of Python
    unraisables: deque[sys.UnraisableHookArgs] = deque(maxlen=32)
    sys.unraisablehook = unraisables.append
    gc.disable()  # until the command is imported, see `begin_work`
    try:
        from mapdeal.kernels.engine import prepare_libraries

        prepare_libraries()
        if _version_is_printed():
            code = 0
        else:
            from mapdeal.cli.main import main

            code = main()
    except KeyboardInterrupt:  # a second one, while main reports the first
        code = ending()[1]
    except (MemoryError, SystemError) as error:  # main had no memory to report it
        release_reserve()
        from mapdeal.errors import refusal_of_the_system

        refusal = refusal_of_the_system(error)
        if refusal is None:
            raise
        print(f"error: {refusal}", file=sys.stderr)  # noqa: T201
        code = refusal.exit_code
    for unraisable in unraisables:
        _report_unless_a_thread_lacks_memory(unraisable)
    for number in own:  # from here on they come too late
        signal.signal(number, signal.SIG_IGN)
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # main has reported it
            stream.flush()
    # All files are closed and all threads have ended. The exit functions remove what
    # multiprocessing has created, and what a signal has left behind.
    atexit._run_exitfuncs()  # noqa: SLF001
    os._exit(code)


def _report_unless_a_thread_lacks_memory(unraisable: sys.UnraisableHookArgs) -> None:
    # The threads that have memory do the work of a thread that ends before it begins.
    is_of_thread = "thread" in (unraisable.err_msg or "")
    if unraisable.exc_type is not MemoryError or not is_of_thread:
        sys.__unraisablehook__(unraisable)


def _version_is_printed() -> bool:
    """Print the version if nothing else is requested; without typer that takes half as long."""
    if sys.argv[1:] != ["--version"]:
        return False
    try:
        from mapdeal.kernels.engine import version_text

        print(version_text(), flush=True)  # noqa: T201
    except Exception:  # noqa: BLE001 - the command line reports it when it prints the version
        return False
    return True
