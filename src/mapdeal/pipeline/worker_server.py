"""What the server that workers are forked from does at its own end; imported there, and only there.

It outlives the command that started it until the last worker is gone. So it can take away the
folder of its socket even if the command was killed.
"""

from __future__ import annotations

import atexit
import os
import shutil
import sys
from multiprocessing import forkserver
from pathlib import Path

_SERVER = os.getpid()
_has_failed = False


def _fail_silently(*_: object) -> None:
    """Keep a server that cannot fork from printing a traceback: the command says what it lacks."""
    global _has_failed
    _has_failed = True


def _remove_folder() -> None:
    """Remove the folder that multiprocessing has made for the socket, if it is known.

    Where the server has failed, the command is still there and does so itself.
    """
    server = getattr(forkserver, "_forkserver", None)
    address = getattr(server, "_forkserver_address", None)
    if _has_failed or os.getpid() != _SERVER or not isinstance(address, str):
        return
    folder = Path(address).parent
    if folder.name.startswith("pymp-"):
        shutil.rmtree(folder, ignore_errors=True)


sys.excepthook = _fail_silently
atexit.register(_remove_folder)
