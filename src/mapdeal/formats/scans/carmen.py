"""CARMEN logs: lines of FLASER, ROBOTLASER1 or RAWLASER1, perhaps compressed with gzip.

References
----------
The Carnegie Mellon Robot Navigation Toolkit, "Logger message formats": the fields of each line.
"""

from __future__ import annotations

import gzip
import math
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from mapdeal.errors import FileAccessError, MalformedInputError, emit_warning
from mapdeal.formats.scans.source import FARTHEST_POSE, BadLines, Floats, ScanArrays, ScanSource
from mapdeal.formats.source import check_readable, status_of
from mapdeal.formats.text_rows import LONGEST_LINE
from mapdeal.kernels.numbers import numbers_in

_SCANS_TOGETHER = 512
_READINGS_TOGETHER = 1 << 18
_POSED = ("FLASER", "ROBOTLASER1")
_TAGS = (*_POSED, "RAWLASER1")
_LONGEST_TAG = max(map(len, _TAGS)) + 1
_GZIP = b"\x1f\x8b"
_EXPANSION = 200
"""Largest ratio of a log's length to that of its gzip file; 4 to 10 is usual."""

_SHORT_LINE = 20
"""Bytes that a line counts as at least: a log of empty lines takes as long as one of others."""

_BEFORE_TAG = b"\xef\xbb\xbf \t"
_LARGEST_ANGLE = 100.0

_FLASER_STEPS = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5}
"""Degrees between the readings of a half circle, by their number; the first is at -90."""

_FLASER_COUNTS = {str(count).encode() for count in _FLASER_STEPS}


class _Laser(NamedTuple):
    """The geometry of a scanner: first angle, step, number of readings."""

    start: float
    step: float
    readings: int

    def angles(self) -> list[float]:
        return [self.start + k * self.step for k in range(self.readings)]


class _Scan(NamedTuple):
    laser: _Laser
    pose: tuple[float, float, float]
    ranges: Floats
    time: float

    def repeats(self, other: _Scan) -> bool:
        """Return whether another scan says the same at the same time."""
        return (
            self.time == other.time
            and (self.pose, self.laser) == (other.pose, other.laser)
            and np.array_equal(self.ranges, other.ranges)
        )


class _BadLineError(Exception):
    """A line that is not what its first word says."""


class CarmenLog(ScanSource):
    """The scans of a CARMEN log.

    Notes
    -----
    FLASER lines have 180, 181, 360 or 361 readings over a half circle, and the laser's pose.
    ROBOTLASER1 lines contain their angles and their maximum range, from which on a reading means
    that nothing was hit. RAWLASER1 lines do, too, but have no pose: that of the last ODOM line is
    taken. A log may have several kinds for the same scans; the one with a pose that has the most
    lines counts. All other lines are passed over.
    """

    def __init__(self, path: Path, *, max_bad: int) -> None:
        check_readable(path)
        self.files = (path,)
        self._path = path
        self._bad = BadLines(path, max_bad)
        self._late = self._without_pose = self._repeated = 0
        self._has_times = False
        self._tags = Counter(_tag_of(line) for _, line in self._lines(_TAGS))
        if not self._tags:
            rule = f"no line begins with {', '.join(_TAGS)}"
            raise MalformedInputError(rule, source=path, hint="CARMEN logs have such lines")
        posed = [tag for tag in _POSED if tag in self._tags]
        self._tag = max(posed, key=self._tags.__getitem__) if posed else "RAWLASER1"

    @property
    def count(self) -> int:
        """Number of scans."""
        return self._tags[self._tag]

    def scans(self) -> Iterator[ScanArrays]:
        """Yield all scans in their order, some at a time; see `ScanSource.scans`."""
        self._bad = BadLines(self._path, self._bad.most)
        self._late = self._without_pose = self._repeated = 0
        self._has_times = False  # one time for all, mostly 0, is none
        together: list[_Scan] = []
        latest = -math.inf
        before: _Scan | None = None
        first_time: float | None = None
        for scan in self._parsed():
            if before is not None and scan.repeats(before):
                self._repeated += 1
                continue
            before = scan
            first_time = scan.time if first_time is None else first_time
            self._has_times |= scan.time != first_time
            self._late += scan.time <= latest
            latest = max(latest, scan.time)
            most = max(1, min(_SCANS_TOGETHER, _READINGS_TOGETHER // max(1, len(scan.ranges))))
            if together and (scan.laser != together[0].laser or len(together) == most):
                yield _arrays(together)
                together = []
            together.append(scan)
        if 2 * self._without_pose > self.count:
            rule = f"{self._without_pose} of {self.count} RAWLASER1 lines have no ODOM line before"
            raise MalformedInputError(rule, source=self._path)
        if together:
            yield _arrays(together)
        elif self._bad.count:
            raise self._bad.error()

    def warn(self) -> None:
        """Warn of what was passed over."""
        self._bad.warn()
        for tag, count in self._tags.items():
            if tag != self._tag:
                self._say(f"{count} lines of {tag} are not used beside those of {self._tag}")
        if self._without_pose:
            self._say(f"{self._without_pose} scans have no ODOM line before them, dropped")
        if self._repeated:
            self._say(f"{self._repeated} of {self.count} scans repeat the one before, dropped")
        if self._late and self._has_times:
            text = f"{self._late} of {self.count} scans are not later than those before"
            self._say(f"{text}, kept in this order")

    def _say(self, text: str) -> None:
        emit_warning(f"{self._path}: {text}", stacklevel=3)

    def _parsed(self) -> Iterator[_Scan]:
        odometry: tuple[float, float, float] | None = None
        parse, parse_at_once = _PARSERS[self._tag]
        needs_pose = self._tag not in _POSED
        wanted = (self._tag, "ODOM") if needs_pose else (self._tag,)
        for number, line in self._lines(wanted):
            try:
                if line.startswith(b"ODOM"):
                    odometry = _pose(line.split()[1:4])
                    continue
                scan = parse_at_once(line) or parse(line.split())
            except _BadLineError as error:
                self._bad.add(number, str(error))
                continue
            if not needs_pose:
                yield scan
            elif odometry is not None:
                yield scan._replace(pose=odometry)
            else:
                self._without_pose += 1

    def _lines(self, tags: tuple[str, ...]) -> Iterator[tuple[int, bytes]]:
        """Yield the lines that begin with one of some words, and their numbers."""
        wanted = tuple(f"{tag}{blank}".encode() for tag in tags for blank in (" ", "\t"))
        most = _EXPANSION * status_of(self._path).st_size + LONGEST_LINE
        number = length = 0
        is_start = True
        with self._opened() as file:
            while line := file.readline(LONGEST_LINE):
                length += max(len(line), _SHORT_LINE)
                if length > most:
                    rule = f"the gzip data expand to more than {_EXPANSION} times their size"
                    raise MalformedInputError(rule, source=self._path)
                number += is_start
                if is_start and (text := line.lstrip(_BEFORE_TAG)).startswith(wanted):
                    yield number, text
                is_start = line.endswith(b"\n")  # else more of the same line follows

    @contextmanager
    def _opened(self) -> Iterator[BinaryIO]:
        try:
            with self._path.open("rb") as file:
                if file.read(2) == _GZIP:
                    file.seek(0)
                    with gzip.open(file) as expanded:
                        yield expanded  # type: ignore[misc]
                else:
                    file.seek(0)
                    yield file
        except (gzip.BadGzipFile, EOFError, zlib.error) as error:
            rule = f"the gzip data are damaged: {error}"
            raise MalformedInputError(rule, source=self._path) from None
        except OSError as error:
            rule = f"cannot be read: {error.strerror or error}"
            raise FileAccessError(rule, source=self._path) from None


def _tag_of(line: bytes) -> str:
    # not of the whole line, all of which would be copied
    return line[:_LONGEST_TAG].split(maxsplit=1)[0].decode()


def _arrays(scans: list[_Scan]) -> ScanArrays:
    return ScanArrays(
        np.array([scan.pose for scan in scans]),
        np.array(scans[0].laser.angles()),
        np.array([scan.ranges for scan in scans]),
    )


def _parse_flaser(words: list[bytes]) -> _Scan:
    count = _whole(words, 1)
    if count not in _FLASER_STEPS:
        raise _BadLineError(f"FLASER must have 180, 181, 360 or 361 readings, has {count}")
    _check_length(words, count + 11)
    pose = _pose(words[2 + count : 5 + count])
    ranges = np.array(_numbers(words[2 : 2 + count]))
    return _Scan(_flaser(count), pose, ranges, _time(words[8 + count]))


@cache
def _flaser(count: int) -> _Laser:
    return _Laser(-math.pi / 2, math.radians(_FLASER_STEPS[count]), count)


def _flaser_at_once(line: bytes) -> _Scan | None:
    """Return the scan of a line that is plainly well-formed, None of any other."""
    head = line.split(None, 2)
    if len(head) < 3 or head[1] not in _FLASER_COUNTS:
        return None
    count = int(head[1])
    found = numbers_in(head[2], 0, count + 7)  # readings, two poses, and the time
    if found is None or len(head[2][found[1] :].split()) != 2:
        return None
    numbers, _ = found
    pose = _pose_of(numbers[count : count + 3].tolist())
    return (
        None if pose is None else _Scan(_flaser(count), pose, numbers[:count], float(numbers[-1]))
    )


def _parse_robotlaser(words: list[bytes]) -> _Scan:
    laser, ranges, behind = _parse_laser(words)
    _check_length(words, behind + 14)
    return _Scan(laser, _pose(words[behind : behind + 3]), ranges, _time(words[behind + 11]))


def _parse_rawlaser(words: list[bytes]) -> _Scan:
    laser, ranges, behind = _parse_laser(words)
    _check_length(words, behind + 3)
    return _Scan(laser, (0.0, 0.0, 0.0), ranges, _time(words[behind]))


def _robotlaser_at_once(line: bytes) -> _Scan | None:
    """As `_flaser_at_once`, of a line of ROBOTLASER1."""
    found = _laser_at_once(line)
    if found is None:
        return None
    laser, ranges, behind = found
    # two poses, five numbers about the robot, and the time; a host and another time
    tail = numbers_in(behind, 0, 12)
    if tail is None or len(behind[tail[1] :].split()) != 2:
        return None
    pose = _pose_of(tail[0][:3].tolist())
    return None if pose is None else _Scan(laser, pose, ranges, float(tail[0][-1]))


def _rawlaser_at_once(line: bytes) -> _Scan | None:
    """As `_flaser_at_once`, of a line of RAWLASER1."""
    found = _laser_at_once(line)
    if found is None:
        return None
    laser, ranges, behind = found
    tail = numbers_in(behind, 0, 1)
    if tail is None or len(behind[tail[1] :].split()) != 2:
        return None
    return _Scan(laser, (0.0, 0.0, 0.0), ranges, float(tail[0][0]))


def _laser_at_once(line: bytes) -> tuple[_Laser, Floats, bytes] | None:
    """Return what both new kinds begin with, and the text behind it; None if it is not plain."""
    words = line.split(None, 9)
    if len(words) < 10 or not _is_whole(words[8]):
        return None
    head = numbers_in(b" ".join(words[2:6]), 0, 4)
    readings = numbers_in(words[9], 0, int(words[8]))
    if head is None or readings is None:
        return None
    behind = words[9][readings[1] :].split(None, 1)
    if len(behind) < 2 or not _is_whole(behind[0]):
        return None
    remissions = numbers_in(behind[1], 0, int(behind[0]))
    if remissions is None:
        return None
    start, field, step, longest = head[0].tolist()
    laser = _laser(start, field, step, len(readings[0]))
    return laser, _within(longest, readings[0]), behind[1][remissions[1] :]


def _parse_laser(words: list[bytes]) -> tuple[_Laser, Floats, int]:
    """Return what both new kinds begin with, and the index of the word behind it."""
    count = _whole(words, 8)
    if len(words) < 10 + count:
        raise _BadLineError(f"must have {count} readings and more, ends before")
    start, field, step, longest = _numbers(words[2:6])
    laser = _laser(start, field, step, count)
    ranges = np.array(_numbers(words[9 : 9 + count]))
    return laser, _within(longest, ranges), 10 + count + _whole(words, 9 + count)


def _laser(start: float, field: float, step: float, count: int) -> _Laser:
    if not (abs(start) <= _LARGEST_ANGLE and 0 < abs(step) <= _LARGEST_ANGLE):  # nan too
        raise _BadLineError("start angle and resolution must be angles in radians, and not 0")
    span = abs(step) * (count - 1)
    if field > 0 and count > 1 and abs(span - field) > 1.5 * abs(step):
        raise _BadLineError(
            f"{count} readings span {span:.4g} rad, not the field of view of {field:.4g}"
        )
    return _Laser(start, step, count)


def _within(longest: float, ranges: Floats) -> Floats:
    """Return ranges without those at the scanner's maximum, if it has one: these hit nothing."""
    return np.where(ranges >= longest, math.inf, ranges) if longest > 0 else ranges


_PARSERS = {
    "FLASER": (_parse_flaser, _flaser_at_once),
    "ROBOTLASER1": (_parse_robotlaser, _robotlaser_at_once),
    "RAWLASER1": (_parse_rawlaser, _rawlaser_at_once),
}
"""Parsers of the words of a line, and of plain lines, which are read much faster."""


def _check_length(words: list[bytes], count: int) -> None:
    if len(words) != count:
        raise _BadLineError(f"{words[0].decode()} must have {count} words here, has {len(words)}")


def _whole(words: list[bytes], index: int) -> int:
    word = words[index] if index < len(words) else b""
    if not _is_whole(word):
        raise _BadLineError("the number of readings is missing or no whole number")
    return int(word)


def _is_whole(word: bytes) -> bool:
    return word.isdigit() and len(word) < 6


def _numbers(words: list[bytes]) -> list[float]:
    try:
        if any(b"_" in word for word in words):  # which Python reads past
            raise ValueError
        return [float(word) for word in words]
    except ValueError:
        raise _BadLineError("a number is missing or malformed") from None


def _pose(words: list[bytes]) -> tuple[float, float, float]:
    pose = _pose_of(_numbers(words))
    if pose is None:
        raise _BadLineError("the pose must be three finite numbers")
    return pose


def _pose_of(numbers: list[float]) -> tuple[float, float, float] | None:
    if len(numbers) != 3:
        return None
    x, y, yaw = numbers
    is_near = max(abs(x), abs(y), abs(yaw)) <= FARTHEST_POSE and not math.isnan(x + y + yaw)
    return (x, y, yaw) if is_near else None


def _time(word: bytes) -> float:
    (time,) = _numbers([word])
    return time
