"""Scans by their files' names, and those of npz files.

An npz has arrays poses (N, 3), angles (M,) and ranges (N, M).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mapdeal.errors import MalformedInputError
from mapdeal.formats.kinds import SCANS, recognised
from mapdeal.formats.npz_reader import NpzReader
from mapdeal.formats.scans.carmen import CarmenLog
from mapdeal.formats.scans.source import DEFAULT_MAX_BAD, FARTHEST_POSE, ScanArrays, ScanSource

_MOST_ELEMENTS = 1 << 31


class ScanNpz(ScanSource):
    def __init__(self, path: Path) -> None:
        self.files = (path,)
        self._path = path
        with NpzReader(path, _MOST_ELEMENTS) as reader:
            self._angles = reader.numbers("angles", 1)
            self._poses = reader.numbers("poses", 2)
        if self._poses.shape[1] != 3:
            rule = f"must have shape (N, 3), has {self._poses.shape}"
            raise MalformedInputError(rule, source=path, place="poses")
        for name, array in (("poses", self._poses), ("angles", self._angles)):
            if not array.size:
                raise MalformedInputError("holds none", source=path, place=name)
            if not (np.abs(array) <= FARTHEST_POSE).all():  # refuses nan too
                rule = f"must be finite and within {FARTHEST_POSE:g}"
                raise MalformedInputError(rule, source=path, place=name)

    @property
    def count(self) -> int:
        return len(self._poses)

    def scans(self) -> Iterator[ScanArrays]:
        """Yield all scans in their order, some at a time; see `ScanSource.scans`."""
        expected = (self.count, len(self._angles))
        done = 0
        with NpzReader(self._path, _MOST_ELEMENTS) as reader:
            for rows in reader.rows("ranges", len(self._angles), shape=expected):
                yield ScanArrays(self._poses[done : done + len(rows)], self._angles, rows)
                done += len(rows)


def open_log(path: Path, *, max_bad: int = DEFAULT_MAX_BAD) -> ScanSource:
    """Return the scans of an ``.npz``, or of a CARMEN log under any other name."""
    with recognised(path, "a log of laser scans", SCANS):
        if path.suffix.lower() == ".npz":
            return ScanNpz(path)
        return CarmenLog(path, max_bad=max_bad)
