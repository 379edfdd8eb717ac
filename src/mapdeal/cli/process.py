"""The command line as a process of its own: a quick start and a quick end.

A run over a small map is over in a tenth of a second, less than what an interpreter takes to
look for garbage among a thousand modules and to take them apart.
"""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from pathlib import Path
from typing import NoReturn

_INTERRUPTED = 130


def run_process() -> NoReturn:
    """Run the command line and end the process with its exit code."""
    gc.disable()  # until the command is imported, see `collect_from_here`
    # numpy's linear algebra would start a thread per processor, for matrices of 3 x 3.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for name in ("stdout", "stderr"):  # None where the process was started without
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115 - open to the end
    try:
        from mapdeal.cli.main import main

        code = main()
    except KeyboardInterrupt:  # before main could care
        code = _INTERRUPTED
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):  # main has told of it
            stream.flush()
    # All files are closed and all threads have ended: there is nothing to take apart.
    os._exit(code)


def collect_from_here() -> None:
    """Turn the search for garbage on again, and leave out what the start has made."""
    if not gc.isenabled():
        gc.freeze()
        gc.enable()
