"""Bags: their topics and messages."""

from __future__ import annotations

import bz2
import re
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.compatibility import Self
from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError, emit_warning
from mapdeal.files.source import (
    PIECES,
    check_expansion,
    claim,
    contents_of,
    is_folder,
    most_expanded,
)
from mapdeal.files.transaction import PREFIX

BAG_OUTPUTS = (".bag", ".mcap", ".db3")  # suffixes of bags
_PART = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_LONGEST_TOPIC = 247
_PLAIN = re.compile(r"[A-Za-z0-9_. +-]+")
METADATA = "metadata.yaml"


def bag_paths(output: Path) -> tuple[Path, ...]:
    """Return the files of a bag: one for ``.bag`` and ``.mcap``, a folder with two for ``.db3``."""
    if output.suffix != ".db3":
        return (output,)
    paths = output / f"{name_inside(output)}.db3", output / METADATA
    if is_folder(output):
        folders, files = contents_of(output)
        own = {path.name for path in paths}
        others = [*folders, *(f for f in files if f not in own and not f.startswith(PREFIX))]
        if others:
            rule = f"is a folder with more than the bag of a map in it: {others[0]}"
            raise FileAccessError(rule, source=output, hint="choose another name")
    return paths


def name_inside(output: Path) -> str:
    """Return what a bag calls its file, without the ending."""
    # Names that a URI or YAML would have to escape are no names for all readers.
    return output.stem if _PLAIN.fullmatch(output.stem) else "bag"


def check_topic(topic: str) -> str:
    """Return the name of a topic, with its leading slash."""
    # Sources: ROS wiki, "Names"; rmw's ``validate_full_topic_name``.
    name = topic if topic.startswith("/") else f"/{topic}"
    if not all(map(_PART.fullmatch, name[1:].split("/"))) or len(name) > _LONGEST_TOPIC:
        rule = "must be the name of a topic: letters, digits and _, with single slashes between"
        raise ParameterError(rule, source="--topic", got=topic)
    return name


def check_frame(frame: str) -> str:
    if not frame or not frame.isprintable() or frame.startswith("/"):
        rule = "must be the name of a frame, without a slash in front"
        raise ParameterError(rule, source="--frame-id", got=frame)
    return frame


Encoding = Literal["ros1", "cdr", ""]

CAN_BE_READ: tuple[Encoding, ...] = ("ros1", "cdr")

Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Connection:
    """One recorded publisher of a topic."""

    id: int
    topic: str
    type: str
    encoding: Encoding
    definition: str = ""
    is_idl: bool = False
    serialization: str = ""
    spelled: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "spelled", self.spelled or self.type)
        object.__setattr__(self, "topic", normalised_topic(self.topic))
        object.__setattr__(self, "type", normalised_type(self.type))


class Place(NamedTuple):
    connection: int
    time: int
    block: int
    offset: int


@dataclass(frozen=True)
class Recorded:
    """Number of messages, and times of the first and the last, nanoseconds."""

    count: int = 0
    first: int = 0
    last: int = 0

    def joined(self, other: Recorded) -> Recorded:
        if not (other.count and self.count):
            return self if self.count else other
        first, last = min(self.first, other.first), max(self.last, other.last)
        return Recorded(self.count + other.count, first, last)


@dataclass(frozen=True, eq=False)
class MessageIndex:
    """The places of messages, 32 bytes for each."""

    connections: Integers
    times: Integers
    blocks: Integers
    offsets: Integers

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[Place]:
        for start in range(0, len(self), _TOGETHER):
            some = slice(start, start + _TOGETHER)
            yield from map(Place, *(one[some].tolist() for one in self.columns))

    def __getitem__(self, number: int) -> Place:
        return Place(*(int(one[number]) for one in self.columns))

    @property
    def columns(self) -> tuple[Integers, Integers, Integers, Integers]:
        return self.connections, self.times, self.blocks, self.offsets

    def chosen(self, which: NDArray[np.bool_] | Integers) -> MessageIndex:
        return MessageIndex(*(one[which] for one in self.columns))

    def in_time(self) -> MessageIndex:
        """Return the places in the order of their times; of equal ones as they were recorded."""
        if len(self) < 2 or bool((self.times[1:] >= self.times[:-1]).all()):
            return self
        return self.chosen(np.argsort(self.times, kind="stable"))

    @classmethod
    def of(cls, numbers: Sequence[int] | Sequence[Place]) -> MessageIndex:
        """Return the index of places that stand one behind the other, four numbers each."""
        return cls(*np.array(numbers, dtype=np.int64).reshape(-1, 4).T)

    @classmethod
    def joined(cls, parts: Sequence[MessageIndex]) -> MessageIndex:
        if not parts:
            return cls.of([])
        return cls(*map(np.concatenate, zip(*(part.columns for part in parts), strict=True)))


class Bag(ABC):
    """A recording of messages that is open for reading."""

    # An index of the messages that are wanted is small whatever the size of the bag; messages are
    # then read one by one, and memory holds some chunks at most.
    def __init__(self, path: Path, form: str) -> None:
        self.path = path
        self.form = form
        """Type of the bag, with an article: ``a ROS 1 bag``."""
        self._remarks: list[str] = []

    @property
    def files(self) -> tuple[Path, ...]:
        return (self.path,)

    @property
    @abstractmethod
    def connections(self) -> Sequence[Connection]:
        """All connections, also those without messages."""

    @abstractmethod
    def pieces(self, connections: Collection[int]) -> Iterator[MessageIndex]:
        """Yield the places of all messages of some connections, some at a time, as recorded."""

    @abstractmethod
    def data(self, place: Place) -> bytes:
        """Return a message as it was serialized."""

    def index(self, connections: Collection[int]) -> MessageIndex:
        """Return the places of all messages of some connections, in the order of their times."""
        parts, taken = [], 0
        for part in self.pieces(connections):
            taken += len(part)
            claim(self.path, 2 * _PLACE * taken + PIECES, what=f"the places of {taken} messages")
            parts.append(part)
        return MessageIndex.joined(parts).in_time()

    def summary(self) -> dict[int, Recorded]:
        """Return how many messages each connection has, and when the first and last came."""
        found = {one.id: Recorded() for one in self.connections}
        for piece in self.pieces(found.keys()):
            for number in np.unique(piece.connections).tolist():
                times = piece.times[piece.connections == number]
                told = Recorded(len(times), int(times.min()), int(times.max()))
                found[number] = found[number].joined(told)
        return found

    def remark(self, text: str) -> None:
        """Note what is wrong with the bag; each thing is warned of once."""
        if text not in self._remarks:
            self._remarks.append(text)
            emit_warning(f"{self.path}: {text}", stacklevel=3)

    def of_types(self, *types: str) -> list[Connection]:
        return [one for one in self.connections if one.type in types]

    def malformed(self, rule: str, place: str | None = None) -> MalformedInputError:
        return MalformedInputError(rule, source=self.path, place=place)

    def close(self) -> None:  # noqa: B027 - most have a file
        ...

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def normalised_topic(topic: str) -> str:
    return "/" + "/".join(part for part in topic.split("/") if part)


def normalised_type(name: str) -> str:
    """Return the name of a message type as ROS 2 spells it."""
    match = re.fullmatch(r"([^/]+)/([^/]+)", name)
    return f"{match[1]}/msg/{match[2]}" if match else name


_TOGETHER = 1 << 14
_PLACE = 32  # bytes of a place


def expanded(
    data: bytes, compression: str, size: int | None, path: Path, *, partly: bool = False
) -> bytes:
    if compression in ("", "none"):
        return data
    if compression not in _EXPANDERS:
        rule = "chunks can be compressed with bz2, lz4 or zstd"
        raise MalformedInputError(rule, source=path, got=compression)
    if size is not None:
        check_expansion(path, len(data), size)
        claim(path, len(data) + 2 * size, what=f"the {size} bytes of a chunk")
    most = most_expanded(len(data)) if size is None else size
    try:
        # one byte more than it claims, so that a lie shows, and a bomb stays small
        found = bytes(_EXPANDERS[compression]().decompress(data, most + 1))
    except MemoryError:  # what it expands to has been claimed: the chunk is not to blame
        raise
    except Exception as error:  # noqa: BLE001 - each library has errors of its own
        if partly:
            return b""
        rule = f"a chunk is damaged: {error}"
        raise MalformedInputError(rule, source=path) from None
    if size is None and len(found) > most:
        rule = f"{len(data)} bytes of a message would expand to more than {most}"
        hint = "--max-memory SIZE allows more, if that much is available"
        raise MalformedInputError(rule, source=path, hint=hint)
    if size is not None and len(found) != size and not (partly and len(found) < size):
        rule = f"a chunk must expand to {size} bytes, and does not"
        raise MalformedInputError(rule, source=path)
    return found


def zstd_module() -> Any:
    """Return what reads zstd: Python's own module, or that of rosbags' dependencies before 3.14."""
    return import_module("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")


_EXPANDERS: dict[str, Callable[[], Any]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lambda: import_module("lz4.frame").LZ4FrameDecompressor(),
    "zstd": lambda: zstd_module().ZstdDecompressor(),
}
