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
except KeyboardInterrupt:  # so early that there is nothing to say
    os._exit(130)

TYPE_CHECKING = False  # the module typing takes longer than the rest of this one
if TYPE_CHECKING:
    from typing import NoReturn

_INTERRUPTED = 130
_STDERR = 2


def run_process() -> NoReturn:
    """Run the command line and end the process with its exit code."""
    # Ctrl-C in the middle of an import ends in a traceback, or in an error that hides it. So long
    # as nothing has begun, the process just ends.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end_at_once)
    occupy_standard_streams()
    gc.disable()  # until the command is imported, see `begin_work`
    # numpy's linear algebra would start a thread per processor, for matrices of 3 x 3.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for name in ("stdout", "stderr"):  # None where the process was started without
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 - open to the end
    try:
        code = 0 if _version_is_printed() else _code_of_main()
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # it comes too late
    except KeyboardInterrupt:  # once more, while main tells of the first one
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        code = _INTERRUPTED
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:  # main has told of it; what is left is not to fail again
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    if "mapdeal.pipeline.processes" in sys.modules:
        # multiprocessing takes away its folder and its servers when the interpreter ends
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
    """End the start: Ctrl-C is an exception again, and garbage is looked for.

    What the start has made is left out of that search.
    """
    if signal.getsignal(signal.SIGINT) is _end_at_once:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if not gc.isenabled():
        gc.freeze()
        gc.enable()


def _end_at_once(*_: object) -> NoReturn:
    try:
        os.write(2, b"error: interrupted\n")
    finally:  # whether or not there is anybody to read it
        os._exit(_INTERRUPTED)
