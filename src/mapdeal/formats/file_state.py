"""Whether a name still stands for the same bytes."""

from __future__ import annotations

import os
from typing import NamedTuple

CHANGED = "changed while it was read"
"""Error text for a file that was replaced or modified while it was read."""


class FileState(NamedTuple):
    """Properties that change when a file is replaced or written to.

    The device is not part of it: machines that share a folder number devices by themselves.
    """

    inode: int
    size: int
    modified_ns: int

    @classmethod
    def of_status(cls, status: os.stat_result) -> FileState:
        """Return the state of the file that has this status."""
        return cls(status.st_ino, status.st_size, status.st_mtime_ns)
