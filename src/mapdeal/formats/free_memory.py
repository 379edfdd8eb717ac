"""Amount of free memory, from the system's own files."""

from __future__ import annotations

import re
from pathlib import Path

_MEMINFO = Path("/proc/meminfo")
_OWN_GROUP = Path("/proc/self/cgroup")
_GROUPS = Path("/sys/fs/cgroup")


def free_memory(
    meminfo: Path = _MEMINFO, own_group: Path = _OWN_GROUP, groups: Path = _GROUPS
) -> int | None:
    """Return the bytes that are available before anything is swapped out or killed.

    The smaller of what the machine has and what is left of the limits of the control groups
    (version 2) that the process is in, as containers set them.
    """
    match = re.search(r"^MemAvailable:\s+(\d+) kB", _text(meminfo), re.MULTILINE)
    if match is None:
        return None
    free = int(match[1]) * 1024
    group = re.search(r"^0::/(.*)$", _text(own_group), re.MULTILINE)
    folder = groups / (group[1] if group else "")
    while True:
        limit, used = _text(folder / "memory.max").strip(), _text(folder / "memory.current").strip()
        if limit.isdecimal() and used.isdecimal():
            # files that were read stay in memory as long as nobody else needs it
            cached = re.search(r"^inactive_file (\d+)", _text(folder / "memory.stat"), re.MULTILINE)
            free = min(free, int(limit) - int(used) + (int(cached[1]) if cached else 0))
        if folder in (groups, folder.parent):
            return max(free, 0)
        folder = folder.parent


def _text(path: Path) -> str:
    """Return what a file says, nothing if it cannot be read: it may not be there."""
    try:
        return path.read_text()
    except (OSError, UnicodeDecodeError):
        return ""
