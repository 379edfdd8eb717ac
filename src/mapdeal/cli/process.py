"""The command line as a process of its own: a quick start and a quick end.

A run over a small map is over in a tenth of a second, less than what an interpreter takes to
look for garbage among a thousand modules and to take them apart.
"""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from typing import NoReturn


def run_process() -> NoReturn:
    """Run the command line and end the process with its exit code."""
    gc.disable()  # until the command is imported, see `collect_from_here`
    # numpy's linear algebra, which nothing here uses, would start a thread per processor.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from mapdeal.cli.main import main

    code = main()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # closed: main has dealt with it
            stream.flush()
    # All files are closed and all threads have ended: there is nothing to take apart.
    os._exit(code)


def collect_from_here() -> None:
    """Turn the search for garbage on again, and leave out what the start has made."""
    if not gc.isenabled():
        gc.freeze()
        gc.enable()
