"""Bags: their topics and messages."""

from __future__ import annotations

import bz2
import re
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError, emit_warning
from mapdeal.files import source as sources
from mapdeal.files.transaction import PREFIX
from mapdeal.kernels.arrays import Integers, Mask
from mapdeal.records import dataclass

BAG_OUTPUTS = (".bag", ".mcap", ".db3")
_TOPIC_PART = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_LONGEST_TOPIC = 247
_PLAIN_NAME = re.compile(r"[A-Za-z0-9_. +-]+")
METADATA = "metadata.yaml"


def bag_paths(output: Path) -> tuple[Path, ...]:
    """Return the files of a bag: one for ``.bag`` and ``.mcap``, a folder with two for ``.db3``."""
    if output.suffix != ".db3":
        return (output,)
    paths = output / f"{name_inside(output)}.db3", output / METADATA
    if sources.is_folder(output):
        folders, files = sources.contents_of(output)
        known = {path.name for path in paths}
        extra = [*folders, *(f for f in files if f not in known and not f.startswith(PREFIX))]
        if extra:
            rule = f"is a folder with more than the bag of a map in it: {extra[0]}"
            raise FileAccessError(rule, source=output, hint="choose another name")
    return paths


def name_inside(output: Path) -> str:
    # Not all readers accept names that a URI or YAML must escape.
    return output.stem if _PLAIN_NAME.fullmatch(output.stem) else "bag"


def check_topic(topic: str) -> str:
    # Sources: ROS wiki, "Names"; rmw's ``validate_full_topic_name``.
    name = topic if topic.startswith("/") else f"/{topic}"
    if not all(map(_TOPIC_PART.fullmatch, name[1:].split("/"))) or len(name) > _LONGEST_TOPIC:
        rule = "must be the name of a topic: letters, digits and _, with single slashes between"
        raise ParameterError(rule, source="--topic", got=topic)
    return name


Encoding = Literal["ros1", "cdr", ""]  # empty: of messages that cannot be read


@dataclass(frozen=True)
class Connection:
    """One recorded publisher of a topic."""

    id: int
    topic: str
    type: str
    encoding: Encoding
    definition: str = ""
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
class MessageSpan:
    """Number of messages, and times of the first and the last, nanoseconds."""

    count: int = 0
    first: int = 0
    last: int = 0

    def joined(self, second: MessageSpan) -> MessageSpan:
        if not (second.count and self.count):
            return self if self.count else second
        first = min(self.first, second.first)
        return MessageSpan(self.count + second.count, first, max(self.last, second.last))


@dataclass(frozen=True, eq=False)
class MessageIndex:
    """The places of messages, one row for each; 32 bytes per message."""

    connections: Integers
    times: Integers
    blocks: Integers
    offsets: Integers

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[Place]:
        for start in range(0, len(self), _ROWS_AT_ONCE):
            rows = slice(start, start + _ROWS_AT_ONCE)
            yield from map(Place, *(column[rows].tolist() for column in self.columns))

    def __getitem__(self, number: int) -> Place:
        return Place(*(int(column[number]) for column in self.columns))

    @property
    def columns(self) -> tuple[Integers, Integers, Integers, Integers]:
        return self.connections, self.times, self.blocks, self.offsets

    def select(self, selection: Mask | Integers) -> MessageIndex:
        return MessageIndex(*(column[selection] for column in self.columns))

    def sorted_by_time(self) -> MessageIndex:
        if len(self) < 2 or bool((self.times[1:] >= self.times[:-1]).all()):
            return self
        return self.select(np.argsort(self.times, kind="stable"))

    @classmethod
    def of(cls, numbers: Sequence[int] | Sequence[Place]) -> MessageIndex:
        """Return the index of a flat sequence with four numbers for each place."""
        return cls(*np.array(numbers, dtype=np.int64).reshape(-1, 4).T)

    @classmethod
    def joined(cls, parts: Sequence[MessageIndex]) -> MessageIndex:
        if not parts:
            return cls.of([])
        return cls(*map(np.concatenate, zip(*(part.columns for part in parts), strict=True)))


class Bag(ABC):
    # Only an index of the requested messages is in memory. Messages are read one by one, with a
    # few chunks in memory at most.
    connections: Sequence[Connection]  # also those without messages

    def __init__(self, path: Path, form: str) -> None:
        self.path = path
        self.files: tuple[Path, ...] = (path,)
        self.form = form  # type of the bag, with an article: ``a ROS 1 bag``
        self._warnings: list[str] = []

    @abstractmethod
    def pieces(self, connections: Collection[int]) -> Iterator[MessageIndex]:
        """Yield the places of all messages of connections, in parts, in the order of recording."""

    @abstractmethod
    def read_message(self, place: Place) -> bytes:
        """Return a message as it was serialized."""

    def index(self, connections: Collection[int]) -> MessageIndex:
        parts, count = [], 0
        for part in self.pieces(connections):
            count += len(part)
            needed = 2 * _PLACE_BYTES * count + sources.PIECES
            sources.claim(self.path, needed, what=f"the places of {count} messages")
            parts.append(part)
        return MessageIndex.joined(parts).sorted_by_time()

    def summary(self) -> dict[int, MessageSpan]:
        spans = {connection.id: MessageSpan() for connection in self.connections}
        for piece in self.pieces(spans.keys()):
            for number in np.unique(piece.connections).tolist():
                times = piece.times[piece.connections == number]
                in_piece = MessageSpan(len(times), int(times.min()), int(times.max()))
                spans[number] = spans[number].joined(in_piece)
        return spans

    def warn_once(self, text: str) -> None:
        if text not in self._warnings:
            self._warnings.append(text)
            emit_warning(f"{self.path}: {text}")

    def of_types(self, *types: str) -> list[Connection]:
        return [connection for connection in self.connections if connection.type in types]

    def malformed(self, rule: str, place: str | None = None) -> MalformedInputError:
        return MalformedInputError(rule, source=self.path, place=place)

    @abstractmethod
    def close(self) -> None: ...


def normalised_topic(topic: str) -> str:
    return "/" + "/".join(part for part in topic.split("/") if part)


def normalised_type(name: str) -> str:
    """Return the name of a message type in the spelling of ROS 2."""
    match = re.fullmatch(r"([^/]+)/([^/]+)", name)
    return f"{match[1]}/msg/{match[2]}" if match else name


_ROWS_AT_ONCE = 1 << 14
_PLACE_BYTES = 32


def decompress(
    data: bytes, compression: str, size: int | None, path: Path, *, partly: bool = False
) -> bytes:
    if compression in ("", "none"):
        return data
    if compression not in _EXPANDERS:
        rule = "chunks can be compressed with bz2, lz4 or zstd"
        raise MalformedInputError(rule, source=path, got=compression)
    if size is not None:
        sources.check_expansion(path, len(data), size)
        sources.claim(path, len(data) + 2 * size, what=f"the {size} bytes of a chunk")
    size_limit = sources.most_expanded(len(data)) if size is None else size
    expander = _EXPANDERS[compression](path)
    try:  # one byte above the declared size reveals a wrong size, and limits decompression bombs
        content = bytes(expander.decompress(data, size_limit + 1))
    except MemoryError:  # the memory was claimed above, so the chunk is not the cause
        raise
    except Exception as error:  # noqa: BLE001 - each library has errors of its own
        if partly:
            return b""
        raise MalformedInputError(f"a chunk is damaged: {error}", source=path) from None
    if size is None and len(content) > size_limit:
        rule = f"{len(data)} bytes of a message would expand to more than {size_limit}"
        hint = "--max-memory SIZE allows more, if that much is available"
        raise MalformedInputError(rule, source=path, hint=hint)
    if size is not None and (len(content) > size or (len(content) < size and not partly)):
        raise MalformedInputError(f"a chunk must expand to {size} bytes, and does not", source=path)
    return content


def import_rosbags(source: Path | str, *modules: str) -> Any:
    """Return the last of some modules of rosbags; refuse to go on if it is not installed."""
    try:
        return [import_module(module) for module in modules][-1]
    except ImportError as error:
        if error.path and not error.path.endswith(".py"):
            raise  # a compiled module that fails to load, for example without memory
        missing = (error.name or "").partition(".")[0] in ("rosbags", "lz4", "backports", "")
        reason = "" if missing else f" ({error})"
        hint = "pip install 'rosbags>=0.11'"
        raise ParameterError(f"needs the extra 'bags'{reason}", source=source, hint=hint) from None


def zstd_module(path: Path) -> Any:
    """Return the module that reads zstd: Python's since 3.14, before that rosbags' dependency."""
    is_in_python = sys.version_info >= (3, 14)
    return import_rosbags(path, "compression.zstd" if is_in_python else "backports.zstd")


_EXPANDERS: dict[str, Callable[[Path], Any]] = {
    "bz2": lambda _: bz2.BZ2Decompressor(),
    "lz4": lambda path: import_rosbags(path, "lz4.frame").LZ4FrameDecompressor(),
    "zstd": lambda path: zstd_module(path).ZstdDecompressor(),
}
