"""KITTI's files of points: ``.bin``, four float32 for each point.

References
----------
The development kit of the KITTI odometry benchmark, ``readme.txt``.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError

_RECORD = 16  # bytes: x, y, z and the reflectance
_TOGETHER = 1 << 17
_FARTHEST = 1e5  # metres; a file with larger coordinates does not contain points


def kitti_points(file: BinaryIO, path: Path) -> Iterator[NDArray[np.float64]]:
    size = os.fstat(file.fileno()).st_size
    if size % _RECORD:
        rule = f"must have {_RECORD} bytes for each point: x, y, z and reflectance as float32"
        raise MalformedInputError(rule, source=path, got=f"{size} bytes")
    while data := file.read(_RECORD * _TOGETHER):
        singles = np.frombuffer(data, "<f4", 4 * (len(data) // _RECORD)).reshape(-1, 4)[:, :3]
        with np.errstate(invalid="ignore"):  # conversion of a signalling nan
            numbers = singles.astype(np.float64)
        if (np.abs(numbers) > _FARTHEST).any():
            rule = f"must be coordinates within {_FARTHEST:g} m, as float32"
            raise MalformedInputError(rule, source=path, got=float(np.nanmax(np.abs(numbers))))
        yield numbers
