"""The clouds that local maps are made of: files, and messages of bags."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.clouds.reader import cloud_chunks
from mapdeal.formats.source import FileState, check_state, sha256_of, state_of
from mapdeal.pipeline.files import errors_named
from mapdeal.records import dataclass

Points = NDArray[np.float64]


@dataclass(frozen=True)
class SummedCloud:
    """A cloud as it was when its checksum was made."""

    cloud: Cloud
    sums: Mapping[str, str]
    options: Mapping[str, str]
    states: Mapping[Path, FileState]

    def points(self) -> Iterator[Points]:
        """Yield the points, some at a time; an error names the cloud, also if it was replaced."""
        with errors_named(self.cloud.path):
            yield from self.cloud.chunks()
        for path, state in self.states.items():
            check_state(path, state)

    @property
    def identity(self) -> list[str]:
        """What tells it from all others."""
        return [*self.sums.values(), *self.options.values()]


class Cloud(ABC):
    """A cloud that can be read more than once."""

    @property
    @abstractmethod
    def path(self) -> Path:
        """What errors and pictures name."""

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that it is read from."""
        return (self.path,)

    @property
    def name(self) -> str:
        """What summaries call it."""
        return self.path.name

    @abstractmethod
    def summed(self) -> SummedCloud:
        """Return the cloud with its checksum."""

    @abstractmethod
    def chunks(self) -> Iterator[Points]:
        """Yield the points, shape (N, 2) or (N, 3), some at a time."""


@dataclass(frozen=True)
class FileCloud(Cloud):
    """A cloud in a file of its own."""

    file: Path

    @property
    def path(self) -> Path:
        """The file."""
        return self.file

    def summed(self) -> SummedCloud:
        """Return the cloud with its checksum; see `Cloud`."""
        state = state_of(self.path)  # of what its sum is of, and then its points
        return SummedCloud(self, {self.path.name: sha256_of(self.path)}, {}, {self.path: state})

    def chunks(self) -> Iterator[Points]:
        """Yield the points; see `Cloud`."""
        return cloud_chunks(self.path)
