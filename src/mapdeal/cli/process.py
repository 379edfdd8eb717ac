"""The command line as a process of its own: a quick start and a quick end.

A run over a small map is over in a tenth of a second, less than what an interpreter takes to
look for garbage among a thousand modules and to take them apart.
"""

from __future__ import annotations

import os

try:
    import gc
    import signal
    import sys
    import time
except KeyboardInterrupt:  # so early that there is nothing to say
    os._exit(130)

TYPE_CHECKING = False  # the module typing takes longer than the rest of this one
if TYPE_CHECKING:
    from typing import Any, NoReturn

_ENDING = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, n)]
_AT_ONCE = 5.0
"""Seconds within which further signals count as the first: timeout(1) sends each twice."""
_STDERR = 2

_ended_by = signal.SIGINT
_ended_at = float("-inf")


def run_process() -> NoReturn:
    """Run the command line and end the process with its exit code."""
    # Ctrl-C in the middle of an import ends in a traceback, or in an error that hides it. So long
    # as nothing has begun, the process just ends.
    _answer(_end_at_once, (signal.default_int_handler, signal.SIG_DFL))
    occupy_standard_streams()
    gc.disable()  # until the command is imported, see `begin_work`
    for name in ("stdout", "stderr"):  # None where the process was started without
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 - open to the end
    try:
        from mapdeal.kernels.room import prepare_libraries

        prepare_libraries()
        code = 0 if _version_is_printed() else _code_of_main()
        _answer(signal.SIG_IGN, (_interrupt, _end_at_once))  # they come too late
    except KeyboardInterrupt:  # such as once more, while main tells of the first one
        _answer(signal.SIG_IGN, (_interrupt, _end_at_once))
        code = ending()[1]
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:  # main has told of it; what is left is not to fail again
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    if "mapdeal.pipeline.processes" in sys.modules or _ended_at > 0:
        # The end of the interpreter removes what multiprocessing has made, and what a signal has
        # kept from being removed. Interrupted in a text that `exec` runs, as libraries do, Python
        # would then die by SIGINT, whatever the code: running another text makes it forget that.
        exec("")  # noqa: S102
        sys.exit(code)
    # All files are closed and all threads have ended: there is nothing to take apart.
    os._exit(code)


def _code_of_main() -> int:
    from mapdeal.cli.main import main

    return main()


def _version_is_printed() -> bool:
    """Print the version, if that is all that is asked for: scripts do so before each use.

    Without typer that takes half as long. Errors are left to the command line.
    """
    if sys.argv[1:] != ["--version"]:
        return False
    try:
        from mapdeal.kernels.engine import version_text

        print(version_text(), flush=True)  # noqa: T201
    except Exception:  # noqa: BLE001 - told by whoever prints it then
        return False
    return True


def occupy_standard_streams() -> None:
    """Open what is closed of stdin, stdout and stderr onto nothing.

    Otherwise the next file that is opened, perhaps an output, gets the number 2, and what libraries
    in C print goes into it.
    """
    try:
        while (descriptor := os.open(os.devnull, os.O_RDWR)) <= _STDERR:
            os.set_inheritable(descriptor, True)
        os.close(descriptor)
    except OSError:  # no descriptors to be had: nor are there for outputs
        pass


def begin_work() -> None:
    """End the start: signals become exceptions, and garbage is looked for.

    What the start has made is left out of that search.
    """
    _answer(_interrupt, (_end_at_once,))
    if not gc.isenabled():
        gc.freeze()
        gc.enable()


def ending() -> tuple[str, int]:
    """Return how to report the signal that has ended the command, and the exit code for it."""
    what = "interrupted" if _ended_by == signal.SIGINT else f"terminated by {_ended_by.name}"
    return what, 128 + _ended_by


def _answer(handler: Any, those: tuple[Any, ...]) -> None:
    """Set the handler of those signals that have one of the given handlers now."""
    for number in _ENDING:
        if signal.getsignal(number) in those:
            signal.signal(number, handler)


def _interrupt(number: int, _: object) -> None:
    global _ended_by, _ended_at
    if time.monotonic() - _ended_at > _AT_ONCE:
        _ended_by, _ended_at = signal.Signals(number), time.monotonic()
        raise KeyboardInterrupt


def _end_at_once(number: int, _: object) -> NoReturn:
    global _ended_by
    _ended_by = signal.Signals(number)
    what, code = ending()
    try:
        os.write(2, f"error: {what}\n".encode())
    finally:  # whether or not there is anybody to read it
        os._exit(code)
