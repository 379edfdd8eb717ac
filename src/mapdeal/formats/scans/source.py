"""Common base of sources of scans, and their malformed lines."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, emit_warning
from mapdeal.records import dataclass

Floats = NDArray[np.float64]

DEFAULT_MAX_BAD = 10
FARTHEST_POSE = 1e11
"""Metres, and radians."""


class ScanArrays(NamedTuple):
    """Some scans with the same angles."""

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
        """Pass over a line."""
        self.count += 1
        if len(self.first) < _NAMED:
            self.first.append(f"line {number}: {rule}")
        if self.count > self.most:
            raise self.error()

    def error(self) -> MalformedInputError:
        """Return the error for lines that are wrong: it names the first."""
        self.is_told = True
        more = f" (and {self.count - 1} more bad lines)" if self.count > 1 else ""
        hint = "--max-bad N lets N such lines pass"
        return MalformedInputError(f"{self.first[0]}{more}", source=self.path, hint=hint)

    def warn(self) -> None:
        """Warn of the lines that were ignored, if there are any that no error has named."""
        if self.count and not self.is_told:
            more = f" (and {self.count - len(self.first)} more)" if self.count > _NAMED else ""
            text = (
                f"{self.path}: {self.count} malformed lines ignored: {'; '.join(self.first)}{more}"
            )
            emit_warning(text, stacklevel=2)


_NAMED = 3
