"""Scans by their files' names."""

from __future__ import annotations

from pathlib import Path

from mapdeal.formats.kinds import SCANS, recognised
from mapdeal.formats.scans.arrays import ScanNpz
from mapdeal.formats.scans.carmen import CarmenLog
from mapdeal.formats.scans.source import DEFAULT_MAX_BAD, ScanSource


def open_log(path: Path, *, max_bad: int = DEFAULT_MAX_BAD) -> ScanSource:
    """Return the scans of an ``.npz``, or of a CARMEN log under any other name."""
    with recognised(path, "a log of laser scans", SCANS):
        if path.suffix.lower() == ".npz":
            return ScanNpz(path)
        return CarmenLog(path, max_bad=max_bad)
