"""Bags: their topics and messages."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError, emit_warning
from mapdeal.formats.budget import PIECES, claim
from mapdeal.formats.source import contents_of, is_folder
from mapdeal.formats.temporary import PREFIX
from mapdeal.records import dataclass

BAG_OUTPUTS = (".bag", ".mcap", ".db3")
"""Suffixes of bags."""

_PART = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_LONGEST_TOPIC = 247
_PLAIN = re.compile(r"[A-Za-z0-9_. +-]+")
_METADATA = "metadata.yaml"


def bag_paths(output: Path) -> tuple[Path, ...]:
    """Return the files of a bag: one for ``.bag`` and ``.mcap``, a folder with two for ``.db3``."""
    if output.suffix != ".db3":
        return (output,)
    paths = output / f"{name_inside(output)}.db3", output / _METADATA
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
    """Return the name of a topic, with its leading slash.

    References
    ----------
    ROS wiki, "Names"; rmw's ``validate_full_topic_name``.

    Examples
    --------
    >>> check_topic("robot_1/map")
    '/robot_1/map'
    """
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
            lists = (self.connections, self.times, self.blocks, self.offsets)
            yield from map(Place, *(one[some].tolist() for one in lists))

    def __getitem__(self, number: int) -> Place:
        lists = (self.connections, self.times, self.blocks, self.offsets)
        return Place(*(int(one[number]) for one in lists))

    def chosen(self, which: NDArray[np.bool_] | Integers) -> MessageIndex:
        """Return some of the places, by a mask or by numbers."""
        return MessageIndex(
            self.connections[which], self.times[which], self.blocks[which], self.offsets[which]
        )

    def in_time(self) -> MessageIndex:
        """Return the places in the order of their times; of equal ones as they were recorded."""
        if len(self) < 2 or bool((self.times[1:] >= self.times[:-1]).all()):
            return self
        return self.chosen(np.argsort(self.times, kind="stable"))

    @classmethod
    def of(cls, numbers: Sequence[int] | Sequence[Place]) -> MessageIndex:
        """Return the index of places that stand one behind the other, four numbers each."""
        table = np.array(numbers, dtype=np.int64).reshape(-1, 4)
        return cls(table[:, 0], table[:, 1], table[:, 2], table[:, 3])

    @classmethod
    def joined(cls, parts: Sequence[MessageIndex]) -> MessageIndex:
        if not parts:
            return cls.of([])
        return cls(
            *(
                np.concatenate([getattr(part, name) for part in parts])
                for name in ("connections", "times", "blocks", "offsets")
            )
        )


class Bag(ABC):
    """A recording of messages that is open for reading."""

    # An index of the messages that are wanted is small whatever the size of the bag; messages are
    # then read one by one, and memory holds some chunks at most.
    path: Path
    form: str
    """Type of the bag, with an article: ``a ROS 1 bag``."""

    def __init__(self, path: Path, form: str) -> None:
        self.path = path
        self.form = form
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self.close()


def normalised_topic(topic: str) -> str:
    """Return a topic's name with one leading slash."""
    return "/" + "/".join(part for part in topic.split("/") if part)


def normalised_type(name: str) -> str:
    """Return the name of a message type as ROS 2 spells it."""
    match = re.fullmatch(r"([^/]+)/([^/]+)", name)
    return f"{match[1]}/msg/{match[2]}" if match else name


_TOGETHER = 1 << 14
_PLACE = 32
"""Bytes of a place."""
