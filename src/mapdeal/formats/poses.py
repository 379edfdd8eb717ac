"""Files of poses and of transforms."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, MapdealError, emit_warning
from mapdeal.formats.budget import PIECES, claim
from mapdeal.formats.json_values import JsonValue, read_document
from mapdeal.formats.kinds import NUMBERS, POSES, recognised
from mapdeal.formats.source import LARGEST_FILE, LONGEST_STREAM, chunks_of, is_regular
from mapdeal.formats.text_rows import delimiter_of, first_line, is_number, read_rows
from mapdeal.grid.frame import FARTHEST, Transform
from mapdeal.records import dataclass


@dataclass(frozen=True)
class TransformFile:
    transform: Transform
    first: Mapping[str, str]
    second: Mapping[str, str]


def transform_document(transform: Transform) -> dict[str, Any]:
    degrees = round(math.degrees(transform.yaw), 9)
    return {"x": transform.x, "y": transform.y, "yaw": transform.yaw, "yaw_deg": degrees}


def read_transform(path: Path) -> TransformFile:
    # The file is what ``mapdeal align`` has written, or an object with x, y (metres) and yaw
    # (radians) written by hand.
    document = read_document(path)
    place = document.get("transform")
    own = document if place is None else place
    sure = document.get("same_place")
    if sure is not None and not sure.flag():
        text = f"{path}: align was uncertain about this transform; it is used as it is"
        emit_warning(text, stacklevel=2)
    x, y, yaw = (own[key].number() for key in ("x", "y", "yaw"))
    return TransformFile(
        Transform(x, y, yaw), _sums_of(document, "first"), _sums_of(document, "second")
    )


def _sums_of(document: JsonValue, key: str) -> dict[str, str]:
    told = document.get(key)
    sums = None if told is None or told.is_null else told.get("sha256")
    if sums is None:
        return {}
    return {name: value.sha256() for name, value in sums.fields().items()}


TUM = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
"""Columns in files of the TUM benchmark tools."""

_PLANAR, _TUM = 3, len(TUM)
_UNIT = 1e-3
"""Tolerance of the length of a quaternion: files contain rounded numbers."""

_ROUNDED = 1e-2
"""The same where a longer or shorter one is refused: two decimals are enough."""

_LEVEL = math.radians(10)
"""Largest tilt of a robot at which its heading is still meaningful."""

_LATEST = 9e9
"""Seconds: what is later is in other units."""

_COPIES = 5
"""Arrays of the size of all numbers that are there at the same time, at most."""

_LEANS = "a robot that leans by more than 10 degrees; does w come last?"

Poses = NDArray[np.float64]


def read_poses(path: Path | str) -> Poses:
    """Read the poses in a text file.

    Parameters
    ----------
    path : path or str
        Text file with one pose per line: ``x y yaw`` in metres and radians, or, in the format of
        the TUM benchmark tools, ``t x y z qx qy qz qw``. Numbers are separated by white space,
        commas or semicolons; lines that begin with # and a line of column names are skipped.

    Returns
    -------
    numpy.ndarray of float64, shape (N, 3)
        x, y (metres) and yaw (radians); the yaw of a quaternion is the heading of its x axis in
        the plane. Times are not used.

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    MalformedInputError
        If a line has the wrong number of values, a value is not finite, or a quaternion is zero.

    Warns
    -----
    MapdealWarning
        If a quaternion is not of length 1, a pose is tilted by more than 10 degrees, a yaw
        exceeds a full turn, or times do not increase.
    """
    path = Path(path)
    with recognised(path, "a file of poses", POSES, NUMBERS):
        return _planar_poses(_rows_in(path), path)


def has_times(path: Path) -> bool:
    """Return whether a file has poses with times; one that cannot be read has none."""
    with suppress(MapdealError, OSError), path.open("rb") as file:
        _, _, line = first_line(file)
        return len(line.split(delimiter_of(line))) == _TUM
    return False


class Trajectory(NamedTuple):
    """Poses with their times."""

    times: NDArray[np.int64]
    translations: Poses
    quaternions: Poses


def read_trajectory(path: Path | str) -> Trajectory:
    """Return the poses in a file of TUM's benchmark tools, with their times."""
    path = Path(path)
    with recognised(path, "a file of poses", POSES, NUMBERS):
        rows = _rows_in(path)
        if rows.shape[1] != _TUM:
            rule = "has poses without times; scans of a bag need t x y z qx qy qz qw"
            raise MalformedInputError(rule, source=path)
        _planar_poses(rows, path)  # with its errors and warnings
    times = rows[:, 0]
    if not (np.abs(times) < _LATEST).all():
        rule = f"must be seconds, below {_LATEST:g}"
        raise MalformedInputError(rule, source=path, place="t", got=times[np.argmax(np.abs(times))])
    whole = np.floor(times)
    nanoseconds = whole.astype(np.int64) * 10**9 + np.rint((times - whole) * 1e9).astype(np.int64)
    return Trajectory(nanoseconds, rows[:, 1:4], rows[:, 4:])


def planar_pose(numbers: Sequence[float]) -> tuple[float, float, float]:
    """Return x, y and yaw of a pose as TUM's tools have it."""
    _, x, y, _, *quaternion = numbers
    length = math.hypot(*quaternion)
    if not math.isfinite(length):
        return x, y, math.nan
    if abs(length - 1) > _ROUNDED:
        raise MalformedInputError("the quaternion must be of length 1")
    qx, qy, qz, qw = (part / length for part in quaternion)
    if 1 - 2 * (qx * qx + qy * qy) < math.cos(_LEVEL):
        raise MalformedInputError("the robot leans by more than 10 degrees; w must come last")
    return x, y, math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))


def _rows_in(path: Path) -> Poses:
    """Return all numbers in a file, shape (N, 3) or (N, 8)."""
    file = io.BytesIO(_contents_of(path))
    number, start, line = first_line(file)
    delimiter = delimiter_of(line)
    width = len(line.split(delimiter))
    if line and width not in (_PLANAR, _TUM):
        rule = "must be x y yaw, or t x y z qx qy qz qw"
        raise MalformedInputError(rule, source=path, place=f"line {number}", got=line)
    if line and not any(map(is_number, line.split(delimiter))):
        number += 1  # the names of the columns
    else:
        file.seek(start)
    columns = range(width)
    parts: list[Poses] = []
    taken = file.getbuffer().nbytes
    for part in read_rows(
        file, columns, path=path, first_line=number, delimiter=delimiter, width=width
    ):
        taken += _COPIES * part.nbytes
        claim(path, taken + PIECES)
        parts.append(part)
    if not parts:
        raise MalformedInputError("holds no poses", source=path)
    return np.concatenate(parts)


def _planar_poses(rows: Poses, path: Path) -> Poses:
    """Return x, y and yaw of each row."""
    width = rows.shape[1]
    used = rows if width == _PLANAR else rows[:, 1:]  # times may be in nanoseconds
    good = (np.abs(used) <= FARTHEST).all(axis=1) & np.isfinite(rows[:, 0])  # refuses nan too
    if not good.all():
        first = int(np.argmin(good))
        rule = f"must be finite numbers within {FARTHEST:g}"
        raise MalformedInputError(
            rule, source=path, place=f"pose {first + 1}", got=rows[first].tolist()
        )
    if width == _PLANAR:
        odd = np.abs(rows[:, 2]) > 2 * math.pi
        _warn_of(odd, "a yaw of more than a turn; is it in degrees?", path)
        turns = np.where(odd, np.round(rows[:, 2] / (2 * math.pi)), 0.0)
        return np.column_stack([rows[:, :2], rows[:, 2] - turns * 2 * math.pi])
    headings = _headings(rows[:, 4:], path)
    times = rows[:, 0]
    if (times != times[0]).any():  # one time for all, mostly 0, is none
        is_late = np.concatenate([[False], times[1:] <= times[:-1]])
        _warn_of(is_late, "a time that is not after the last", path)
    return np.column_stack([rows[:, 1:3], headings])


def _contents_of(path: Path) -> bytes:
    """Return what stands in a file, which may be a pipe without an end."""
    most = LARGEST_FILE if is_regular(path) else LONGEST_STREAM
    chunks, length = [], 0
    for chunk in chunks_of(path):
        length += len(chunk)
        if length > most:
            raise MalformedInputError(f"must not be larger than {most} bytes", source=path)
        claim(path, 2 * length)
        chunks.append(chunk)
    return b"".join(chunks)


def _headings(quaternions: NDArray[np.float64], path: Path) -> NDArray[np.float64]:
    lengths = np.linalg.norm(quaternions, axis=1)
    if not lengths.all():
        place = f"pose {int(np.argmin(lengths)) + 1}"
        raise MalformedInputError("the quaternion is zero", source=path, place=place)
    _warn_of(np.abs(lengths - 1) > _UNIT, "a quaternion that is not of length 1", path)
    x, y, z, w = (quaternions / lengths[:, np.newaxis]).T
    upright = 1 - 2 * (x * x + y * y)  # the cosine of the angle between both z axes
    _warn_of(upright < math.cos(_LEVEL), _LEANS, path)
    yaw: NDArray[np.float64] = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return yaw


def _warn_of(which: NDArray[np.bool_], what: str, path: Path) -> None:
    count = int(np.count_nonzero(which))
    if count:
        first = int(np.argmax(which)) + 1
        text = f"{path}: {count} of {len(which)} poses, the first of them pose {first}, have {what}"
        emit_warning(text, stacklevel=4)
