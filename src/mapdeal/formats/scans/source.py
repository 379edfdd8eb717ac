"""Sources of laser scans, from arrays and text.

Texts are comma separated, without a header: a pose and the ranges of a scan a line, all angles on
one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import field
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError, emit_warning
from mapdeal.formats.budget import PIECES, claim
from mapdeal.formats.poses import read_poses
from mapdeal.formats.source import check_readable
from mapdeal.formats.text_rows import delimiter_of, first_line, read_rows
from mapdeal.grid.frame import FARTHEST
from mapdeal.records import dataclass

Floats = NDArray[np.float64]

DEFAULT_MAX_BAD = 10
FARTHEST_POSE = 1e11
"""Metres, and radians."""


class ScanArrays(NamedTuple):
    poses: Floats
    angles: Floats
    ranges: Floats
    sweeps: int | None = None


class ScanSource(ABC):
    """Scans in files, which can be read more than once."""

    files: tuple[Path, ...]

    @property
    def preparation(self) -> int:
        """Number of steps before the scans can be read, for a progress bar."""
        return 0

    def prepare(self, advance: Callable[[int], object] = lambda _: None) -> None:  # noqa: B027
        """Read what scans need, once, before any of them; `advance` is called for each step."""

    @abstractmethod
    def scans(self) -> Iterator[ScanArrays]:
        """Yield all scans in their order, some at a time."""

    @property
    @abstractmethod
    def count(self) -> int:
        """Approximate number of scans, for a progress bar."""

    @property
    def named(self) -> Path:
        """The file that errors about the scans name."""
        return self.files[-1]

    def warn(self) -> None:  # noqa: B027 - most have nothing to say
        """Warn of what was passed over, once all scans were read."""


@dataclass
class BadLines:
    """Lines that are wrong, up to so many."""

    path: Path
    most: int
    count: int = 0
    first: list[str] = field(default_factory=list)
    is_told: bool = False

    def add(self, number: int, rule: str) -> None:
        self.count += 1
        if len(self.first) < _NAMED:
            self.first.append(f"line {number}: {rule}")
        if self.count > self.most:
            raise self.error()

    def error(self) -> MalformedInputError:
        self.is_told = True
        more = f" (and {self.count - 1} more bad lines)" if self.count > 1 else ""
        hint = "--max-bad N lets N such lines pass"
        return MalformedInputError(f"{self.first[0]}{more}", source=self.path, hint=hint)

    def warn(self) -> None:
        if self.count and not self.is_told:
            more = f" (and {self.count - len(self.first)} more)" if self.count > _NAMED else ""
            text = (
                f"{self.path}: {self.count} malformed lines ignored: {'; '.join(self.first)}{more}"
            )
            emit_warning(text, stacklevel=2)


_NAMED = 3


_PLANAR = 3
_COPIES = 4
"""Arrays of the size of all angles that are there at the same time, at most."""


class ScanTexts(ScanSource):
    def __init__(self, poses: Path, angles: Path, ranges: Path, *, flip_y: bool = False) -> None:
        self.files = (poses, angles, ranges)
        for path in self.files:
            check_readable(path)
        self._poses = read_poses(poses)
        if flip_y:
            self._poses[:, 1] *= -1.0
        self._angles = _read_angles(angles)

    @property
    def count(self) -> int:
        return len(self._poses)

    def scans(self) -> Iterator[ScanArrays]:
        """Yield all scans in their order, some at a time; see `ScanSource.scans`."""
        poses, angles, path = self.files
        done = 0
        with _opened(path) as (file, number, delimiter, found):
            if found not in (0, len(self._angles)):
                rule = f"must have {len(self._angles)} numbers, one for each angle of {angles}"
                raise MalformedInputError(rule, source=path, place=f"line {number}", got=found)
            for rows in read_rows(
                file,
                range(len(self._angles)),
                path=path,
                first_line=number,
                delimiter=delimiter,
                width=len(self._angles),
            ):
                some = self._poses[done : done + len(rows)]
                done += len(rows)
                if done > self.count:
                    rule = f"has more lines than {poses} has poses, {self.count}"
                    raise MalformedInputError(rule, source=path)
                yield ScanArrays(some, self._angles, rows)
        if done < self.count:
            rule = f"ends after {done} scans, {poses} has {self.count} poses"
            raise MalformedInputError(rule, source=path)


def _read_angles(path: Path) -> NDArray[np.float64]:
    with _opened(path) as (file, number, delimiter, found):
        rows, taken = [], 0
        for part in read_rows(
            file, range(found), path=path, first_line=number, delimiter=delimiter, width=found
        ):
            taken += _COPIES * part.nbytes
            claim(path, taken + PIECES)
            rows.append(part)
    if not rows:
        raise MalformedInputError("holds no angles", source=path)
    table = np.concatenate(rows)
    if 1 not in table.shape:
        rule = "must be one line of angles, or one angle a line"
        raise MalformedInputError(rule, source=path, got=f"{len(table)} lines of {found}")
    angles = table.reshape(-1)
    if not (np.abs(angles) <= FARTHEST).all():  # refuses nan too
        index = int(np.argmin(np.abs(angles) <= FARTHEST))
        rule = "must be finite numbers"
        raise MalformedInputError(rule, source=path, place=f"angle {index + 1}", got=angles[index])
    return angles


@contextmanager
def _opened(path: Path) -> Iterator[tuple[BinaryIO, int, str | None, int]]:
    """Yield a file at its first line of numbers, with that line's number, delimiter and length."""
    try:
        with path.open("rb") as file:
            number, start, line = first_line(file)
            delimiter = delimiter_of(line)
            file.seek(start)
            yield file, number, delimiter, len(line.split(delimiter)) if line else 0
    except OSError as error:
        rule = f"cannot be read: {error.strerror or error}"
        raise FileAccessError(rule, source=path) from None
