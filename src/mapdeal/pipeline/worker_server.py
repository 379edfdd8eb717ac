"""Clean-up of the server that workers are forked from; imported there alone.

The server outlives the command that started it until the last worker is gone. So it can remove the
folder of its socket even if the command was killed.
"""

from __future__ import annotations

import atexit
import os
import shutil
import sys
from multiprocessing import forkserver
from pathlib import Path

from mapdeal.kernels.engine import prepare_libraries

_SERVER, _COMMAND = os.getpid(), os.getppid()


def _remove_folder() -> None:
    # A living command removes the folder itself, and fails if it is missing.
    address = getattr(getattr(forkserver, "_forkserver", None), "_forkserver_address", None)
    if os.getpid() != _SERVER or os.getppid() == _COMMAND or not isinstance(address, str):
        return
    folder = Path(address).parent
    if folder.name.startswith("pymp-"):
        shutil.rmtree(folder, ignore_errors=True)


def _fail_silently(*_: object) -> None:
    """Print no traceback if the server cannot fork: the command reports the error."""


prepare_libraries()
sys.excepthook = _fail_silently
atexit.register(_remove_folder)
