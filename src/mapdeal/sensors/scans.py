"""Laser scans in files: text, npz, and CARMEN logs, which may be compressed with gzip.

References
----------
The Carnegie Mellon Robot Navigation Toolkit, "Logger message formats": the fields of each line.
"""

from __future__ import annotations

import gzip
import math
import zlib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import repeat, takewhile
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from mapdeal.errors import MalformedInputError, emit_warning
from mapdeal.files import source, text as texts
from mapdeal.grid.frame import FARTHEST
from mapdeal.kernels.arrays import Floats
from mapdeal.maps import kinds, npz
from mapdeal.records import dataclass, field
from mapdeal.sensors.points import read_poses, read_table

DEFAULT_MAX_BAD = 10
_MOST_NAMED = 3
FARTHEST_POSE = 1e11  # metres, and radians


class ScanArrays(NamedTuple):
    poses: Floats
    angles: Floats
    ranges: Floats
    sweeps: int | None = None


class ScanSource(ABC):
    """Source of scans from files; it can be read more than once."""

    files: tuple[Path, ...]
    named: Path  # file that errors about the scans refer to
    preparation = 0  # steps before the scans can be read, for a progress bar
    count: int  # approximate number of scans, for a progress bar

    def prepare(self, advance: Callable[[int], object] = lambda _: None) -> None:  # noqa: B027
        """Read data that all scans need, such as poses; call `advance` after each step."""

    @abstractmethod
    def scans(self) -> Iterator[ScanArrays]:
        """Yield all scans in their order, in groups with the same angles."""

    def warn(self) -> None:  # noqa: B027 - most sources have no warnings
        """Warn of skipped lines and scans, after all scans were read."""


@dataclass
class BadLines:
    path: Path
    most: int
    count: int = 0
    first: list[str] = field(default_factory=list)
    is_reported: bool = False

    def add(self, number: int, rule: str) -> None:
        self.count += 1
        if len(self.first) < _MOST_NAMED:
            self.first.append(f"line {number}: {rule}")
        if self.count > self.most:
            raise self.error()

    def error(self) -> MalformedInputError:
        self.is_reported = True
        others_text = f" (and {self.count - 1} more bad lines)" if self.count > 1 else ""
        hint = "--max-bad N skips up to N such lines"
        return MalformedInputError(f"{self.first[0]}{others_text}", source=self.path, hint=hint)

    def warn(self) -> None:
        if self.count and not self.is_reported:
            more = f" (and {self.count - len(self.first)} more)" if self.count > _MOST_NAMED else ""
            text = f"{self.count} malformed lines ignored: {'; '.join(self.first)}{more}"
            emit_warning(f"{self.path}: {text}")


class ScanTexts(ScanSource):
    def __init__(self, poses: Path, angles: Path, ranges: Path, *, flip_y: bool = False) -> None:
        self.files, self.named = (poses, angles, ranges), ranges
        for path in self.files:
            source.check_readable(path)
        self._poses = read_poses(poses)
        if flip_y:
            self._poses[:, 1] *= -1.0
        self._angles = _read_angles(angles)
        self.count = len(self._poses)

    def scans(self) -> Iterator[ScanArrays]:
        poses, angles, path = self.files
        start, width = 0, len(self._angles)
        with _open_at_numbers(path) as (file, number, delimiter, length):
            if length not in (0, width):
                rule = f"must have {width} numbers, one for each angle of {angles}"
                raise MalformedInputError(rule, source=path, place=f"line {number}", got=length)
            for rows in texts.read_rows(
                file, range(width), path=path, first_line=number, delimiter=delimiter, width=width
            ):
                if start + len(rows) > self.count:
                    rule = f"has more lines than {poses} has poses, {self.count}"
                    raise MalformedInputError(rule, source=path)
                yield ScanArrays(self._poses[start : start + len(rows)], self._angles, rows)
                start += len(rows)
        if start < self.count:
            rule = f"ends after {start} scans, {poses} has {self.count} poses"
            raise MalformedInputError(rule, source=path)


def _read_angles(path: Path) -> Floats:
    with _open_at_numbers(path) as (file, number, delimiter, length):
        table = read_table(file, path, number, delimiter, length)
    if table is None:
        raise MalformedInputError("holds no angles", source=path)
    if 1 not in table.shape:
        rule = "must be one line of angles, or one angle a line"
        raise MalformedInputError(rule, source=path, got=f"{len(table)} lines of {length}")
    angles = table.reshape(-1)
    is_good = np.abs(angles) <= FARTHEST  # refuses nan too
    if not is_good.all():
        index, rule = int(np.argmin(is_good)), "must be finite numbers"
        place, got = f"angle {index + 1}", angles[index]
        raise MalformedInputError(rule, source=path, place=place, got=got)
    return angles


@contextmanager
def _open_at_numbers(path: Path) -> Iterator[tuple[BinaryIO, int, str | None, int]]:
    """Yield a file at its first line of numbers, and that line's number, delimiter and length."""
    with source.access_to(path), path.open("rb") as file:
        number, start, line = texts.first_line(file)
        delimiter = texts.delimiter_of(line)
        file.seek(start)
        yield file, number, delimiter, len(line.split(delimiter)) if line else 0


_SCANS_TOGETHER = 512
_READINGS_TOGETHER = 1 << 18
_POSE_TAGS = ("FLASER", "ROBOTLASER1")
_TAGS = (*_POSE_TAGS, "RAWLASER1")
_LONGEST_TAG = max(map(len, _TAGS)) + 1
_EXPANSION = 200  # largest ratio of a log's length to that of its gzip file; 4 to 10 is usual
_SHORT_LINE = 20  # bytes added to the length of each line: many empty lines take long, too
_LARGEST_ANGLE = 100.0

# Degrees between the readings of a half circle, by their number; the first is at -90 degrees.
_FLASER_STEPS = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5}
_LINES_TOGETHER, _BYTES_TOGETHER = 512, 1 << 20
_TYPES = {"head": "S40", "middle": "S40", "ranges": "f8", "pose": "f8", "time": "f8"}
_NO_POSE = (0.0, 0.0, 0.0)

_Laser = tuple[float, float, int]
"""Angle of the first reading and between readings, radians, and their number."""


class _Layout(NamedTuple):
    """Layout of a line: the number of words of each part, in their order."""

    laser: _Laser
    longest: float
    parts: dict[str, int]

    def part(self, name: str, words: list[bytes]) -> list[bytes]:
        start = sum(self.parts[part] for part in takewhile(lambda part: part != name, self.parts))
        return words[start : start + self.parts[name]]

    def record(self) -> np.dtype[np.void]:
        """Return numpy's type of a line; unused words are truncated to one letter."""
        parts = [(name, count) for name, count in self.parts.items() if count]
        return np.dtype([(name, _TYPES.get(name, "S1"), (count,)) for name, count in parts])


class _Scan(NamedTuple):
    laser: _Laser
    pose: tuple[float, float, float]
    ranges: Floats
    time: float

    def repeats(self, previous: _Scan) -> bool:
        heads = [(scan.time, scan.pose, scan.laser) for scan in (self, previous)]
        return heads[0] == heads[1] and np.array_equal(self.ranges, previous.ranges)


class CarmenLog(ScanSource):
    # FLASER lines have 180, 181, 360 or 361 readings over a half circle, and the laser's pose.
    # ROBOTLASER1 lines contain angles, a pose and a maximum range, at which nothing is hit.
    # RAWLASER1 lines have no pose: the last ODOM line supplies it. Different kinds of lines
    # describe the same scans, so only the most frequent kind with a pose is used.
    def __init__(self, path: Path, *, max_bad: int) -> None:
        source.check_readable(path)
        self.files, self.named = (path,), path
        self._start_over(max_bad)
        # split only the beginning, because splitting copies the whole line
        words = (line[:_LONGEST_TAG].split(maxsplit=1)[0] for _, line in self._lines(_TAGS))
        self._tags = Counter(word.decode() for word in words)
        if not self._tags:
            rule = f"no line begins with {', '.join(_TAGS)}"
            raise MalformedInputError(rule, source=path, hint="CARMEN logs have such lines")
        posed = [tag for tag in _POSE_TAGS if tag in self._tags]
        self._tag = max(posed, key=self._tags.__getitem__) if posed else "RAWLASER1"
        self.count = self._tags[self._tag]

    def _start_over(self, max_bad: int) -> None:
        self._bad = BadLines(self.named, max_bad)
        self._late = self._without_pose = self._repeated = 0
        self._has_times = False  # a constant time, usually 0, means that times are missing
        self._odometry: tuple[float, float, float] | None = None

    def scans(self) -> Iterator[ScanArrays]:
        self._start_over(self._bad.most)
        group: list[_Scan] = []
        latest = -math.inf
        previous: _Scan | None = None
        for scan in self._parse():
            if previous is not None and scan.repeats(previous):
                self._repeated += 1
                continue
            self._has_times |= previous is not None and scan.time != previous.time
            previous = scan
            self._late += scan.time <= latest
            latest = max(latest, scan.time)
            most = max(1, min(_SCANS_TOGETHER, _READINGS_TOGETHER // max(1, len(scan.ranges))))
            if group and (scan.laser != group[0].laser or len(group) == most):
                yield _arrays(group)
                group = []
            group.append(scan)
        if 2 * self._without_pose > self.count:
            rule = f"{self._without_pose} of {self.count} RAWLASER1 lines have no ODOM line before"
            raise MalformedInputError(rule, source=self.named)
        if group:
            yield _arrays(group)
        elif self._bad.count:
            raise self._bad.error()

    def warn(self) -> None:
        self._bad.warn()
        for tag, count in self._tags.items():
            if tag != self._tag:
                self._warn(f"{count} lines of {tag} are not used beside those of {self._tag}")
        if self._without_pose:
            self._warn(f"{self._without_pose} scans have no ODOM line before them, dropped")
        if self._repeated:
            self._warn(f"{self._repeated} of {self.count} scans repeat the one before, dropped")
        if self._late and self._has_times:
            text = f"{self._late} of {self.count} scans are not later than those before"
            self._warn(f"{text}, kept in this order")

    def _warn(self, text: str) -> None:
        emit_warning(f"{self.named}: {text}")

    def _parse(self) -> Iterator[_Scan]:
        tags = (self._tag,) if self._tag in _POSE_TAGS else (self._tag, "ODOM")
        numbered: list[tuple[int, bytes]] = []
        length = 0
        for number, line in self._lines(tags):
            numbered.append((number, line))
            length += len(line)
            if len(numbered) == _LINES_TOGETHER or length > _BYTES_TOGETHER:
                yield from self._scans_of(numbered)
                numbered, length = [], 0
        yield from self._scans_of(numbered)

    def _scans_of(self, numbered: list[tuple[int, bytes]]) -> Iterator[_Scan]:
        """Yield the scans of lines; RAWLASER1 scans get the latest pose of odometry."""
        lines = [line for _, line in numbered if not line.startswith(b"ODOM")]
        scans = iter(_scans_at_once(lines) or repeat(None))
        for number, line in numbered:
            try:
                if line.startswith(b"ODOM"):
                    self._odometry = _pose(line.split()[1:4])
                    continue
                scan = next(scans) or _scan_of(line.split())
            except MalformedInputError as error:
                self._bad.add(number, error.rule)
                continue
            if self._tag in _POSE_TAGS:
                yield scan
            elif self._odometry is not None:
                yield scan._replace(pose=self._odometry)
            else:
                self._without_pose += 1

    def _lines(self, tags: tuple[str, ...]) -> Iterator[tuple[int, bytes]]:
        """Yield number and text of the lines that begin with one of the tags."""
        starts = tuple(f"{tag}{blank}".encode() for tag in tags for blank in (" ", "\t"))
        most = _EXPANSION * source.status_of(self.named).st_size + texts.LONGEST_LINE
        number = length = 0
        is_start = True
        with self._open() as file:
            while line := file.readline(texts.LONGEST_LINE):
                length += len(line) + _SHORT_LINE
                if length > most:
                    rule = f"the gzip data expand to more than {_EXPANSION} times their size"
                    raise MalformedInputError(rule, source=self.named)
                number += is_start
                if is_start and (text := line.lstrip(b"\xef\xbb\xbf \t")).startswith(starts):
                    yield number, text
                is_start = line.endswith(b"\n")  # False if the line continues

    @contextmanager
    def _open(self) -> Iterator[BinaryIO]:
        with source.access_to(self.named), self.named.open("rb") as file:
            is_compressed = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            if not is_compressed:
                yield file
                return
            try:
                with gzip.open(file) as text:
                    yield text  # type: ignore[misc]
            except (gzip.BadGzipFile, EOFError, zlib.error) as error:
                rule = f"the gzip data are damaged: {error}"
                raise MalformedInputError(rule, source=self.named) from None


def _arrays(scans: list[_Scan]) -> ScanArrays:
    poses, ranges = [scan.pose for scan in scans], [scan.ranges for scan in scans]
    start, step, count = scans[0].laser
    angles = start + step * np.arange(count, dtype=np.float64)
    return ScanArrays(np.array(poses), angles, np.array(ranges))


def _layout_of(words: list[bytes]) -> _Layout:
    if words[0] == b"FLASER":
        count = _reading_count(words, 1)
        if count not in _FLASER_STEPS:
            rule = f"FLASER must have 180, 181, 360 or 361 readings, has {count}"
            raise MalformedInputError(rule)
        laser = -math.pi / 2, math.radians(_FLASER_STEPS[count]), count
        longest = 0.0
        parts = {"head": 2, "ranges": count, "pose": 3, "robot": 3}
    else:
        count = _reading_count(words, 8)
        if len(words) < 10 + count:
            raise MalformedInputError(f"must have {count} readings and more, ends before")
        start, field, step, longest = _numbers(words[2:6])
        if not (abs(start) <= _LARGEST_ANGLE and 0 < abs(step) <= _LARGEST_ANGLE):  # nan too
            rule = "start angle and resolution must be angles in radians, and not 0"
            raise MalformedInputError(rule)
        span = abs(step) * (count - 1)
        if field > 0 and count > 1 and abs(span - field) > 1.5 * abs(step):
            rule = f"{count} readings span {span:.4g} rad, not the field of view of {field:.4g}"
            raise MalformedInputError(rule)
        laser = start, step, count
        remissions = _reading_count(words, 9 + count)
        parts = {"head": 9, "ranges": count, "middle": 1, "remissions": remissions}
        if words[0] == b"ROBOTLASER1":
            parts |= {"pose": 3, "robot": 8}
    parts |= {"time": 1, "logger": 2}
    length = sum(parts.values())
    if len(words) != length:
        rule = f"{words[0].decode()} must have {length} words here, has {len(words)}"
        raise MalformedInputError(rule)
    return _Layout(laser, longest, parts)


def _scan_of(words: list[bytes]) -> _Scan:
    layout = _layout_of(words)
    pose = _pose(layout.part("pose", words)) if "pose" in layout.parts else _NO_POSE
    ranges = np.array(_numbers(layout.part("ranges", words)))
    (time,) = _numbers(layout.part("time", words))
    return _Scan(layout.laser, pose, _without_maxima(layout.longest, ranges), time)


def _scans_at_once(lines: list[bytes]) -> list[_Scan] | None:
    """Return the scans of lines with the same layout; None if the layouts differ."""
    if not lines:
        return None
    try:
        layout = _layout_of(lines[0].split())
        table = np.loadtxt(lines, layout.record(), comments=None, encoding="ascii", ndmin=1)
    except (MalformedInputError, ValueError):
        return None
    for name in {"head", "middle"}.intersection(layout.parts):
        if (table[name] != table[name][0]).any():
            return None
    times = table["time"][:, 0].tolist()
    poses = [_NO_POSE] * len(times)
    if "pose" in layout.parts:
        if not (np.abs(table["pose"]) <= FARTHEST_POSE).all():  # refuses nan too
            return None
        poses = list(map(tuple, table["pose"].tolist()))
    ranges = _without_maxima(layout.longest, table["ranges"])
    return [_Scan(layout.laser, *fields) for fields in zip(poses, ranges, times, strict=True)]


def _without_maxima(longest: float, ranges: Floats) -> Floats:
    """Return ranges with inf, no hit, in place of the scanner's maximum; 0 means no maximum."""
    return np.where(ranges >= longest, math.inf, ranges) if longest > 0 else ranges


def _reading_count(words: list[bytes], index: int) -> int:
    word = words[index] if index < len(words) else b""
    if not (word.isdigit() and len(word) < 6):
        raise MalformedInputError("the number of readings is missing or no whole number")
    return int(word)


def _numbers(words: list[bytes]) -> list[float]:
    try:
        if any(b"_" in word for word in words):  # Python's float accepts underscores
            raise ValueError
        return [float(word) for word in words]
    except ValueError:
        raise MalformedInputError("a number is missing or malformed") from None


def _pose(words: list[bytes]) -> tuple[float, float, float]:
    numbers = _numbers(words)
    if len(numbers) == 3 and all(abs(n) <= FARTHEST_POSE for n in numbers):  # refuses nan too
        return numbers[0], numbers[1], numbers[2]
    raise MalformedInputError("the pose must be three finite numbers")


def carmen_lines(
    scans: ScanArrays, times: Floats, robot_poses: Floats, longest: float
) -> Iterator[bytes]:  # fmt: skip
    """Yield the ROBOTLASER1 lines of scans; beams without a return are longer than `longest`."""
    count = len(scans.angles)
    start, last = scans.angles[[0, -1]].tolist()
    step = (last - start) / (count - 1)
    head = f"ROBOTLASER1 0 {start!r} {last - start!r} {step!r} {longest!r} 0.0 0 {count}"
    readings = " %.7f" * count
    for row, pose, robot, time in zip(
        scans.ranges, scans.poses.tolist(), robot_poses.tolist(), times.tolist(), strict=True
    ):
        ranges = tuple(np.nan_to_num(row, posinf=longest + 1, neginf=0.0).tolist())
        poses = " ".join(map(repr, [*pose, *robot]))
        line = f"{head}{readings % ranges} 0 {poses} 0 0 0 0 0 {time:.6f} mapdeal {time:.6f}"
        yield f"{line}\n".encode()


_MOST_ELEMENTS = 1 << 31


class ScanNpz(ScanSource):
    def __init__(self, path: Path) -> None:
        self.files, self.named = (path,), path
        with npz.NpzReader(path, _MOST_ELEMENTS) as reader:
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
        self.count = len(self._poses)

    def scans(self) -> Iterator[ScanArrays]:
        expected = (self.count, len(self._angles))
        start = 0
        with npz.NpzReader(self.named, _MOST_ELEMENTS) as reader:
            for rows in reader.rows("ranges", len(self._angles), shape=expected):
                yield ScanArrays(self._poses[start : start + len(rows)], self._angles, rows)
                start += len(rows)


def open_log(path: Path, *, max_bad: int = DEFAULT_MAX_BAD) -> ScanSource:
    with kinds.recognised(path, "a log of laser scans", kinds.SCANS):
        return ScanNpz(path) if path.suffix.lower() == ".npz" else CarmenLog(path, max_bad=max_bad)
