"""Bags: their topics and messages."""

from __future__ import annotations

import bz2
import re
import sys
from abc import ABC, abstractmethod
from array import array
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, NamedTuple, Self
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError, emit_warning
from mapdeal.files.budget import PIECES, check_expansion, claim, most_expanded
from mapdeal.files.source import access_to, contents_of, is_folder, status_of
from mapdeal.files.transaction import PREFIX

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


_KEPT_BYTES = 1 << 25
_KEPT = 8


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
        found = _EXPANDERS[compression](data, most + 1)
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
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd


def _with_lz4(data: bytes, most: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    return bytes(LZ4FrameDecompressor().decompress(data, most))


_EXPANDERS: dict[str, Callable[[bytes, int], bytes]] = {
    "bz2": lambda data, most: bz2.BZ2Decompressor().decompress(data, most),
    "lz4": _with_lz4,
    "zstd": lambda data, most: bytes(zstd_module().ZstdDecompressor().decompress(data, most)),
}


class KeptChunks:
    """The last few chunks: messages in order of time alternate between two or three."""

    def __init__(self, read: Callable[[int], bytes]) -> None:
        self._read = read
        self._kept: OrderedDict[int, bytes] = OrderedDict()
        self._bytes = 0

    def __getitem__(self, number: int) -> bytes:
        found = self._kept.get(number)
        if found is not None:
            self._kept.move_to_end(number)
            return found
        while len(self._kept) >= _KEPT or self._bytes > _KEPT_BYTES:
            _, old = self._kept.popitem(last=False)
            self._bytes -= len(old)
            del old  # before another is read
        chunk = self._read(number)
        self._kept[number] = chunk
        self._bytes += len(chunk)
        return chunk


_CHUNKED_TOGETHER = 1 << 16
"""Entries of an index record that are read at once."""

IN_THE_FILE = -1
"""The number of no chunk: a message that stands between them."""


@dataclass
class Chunk:
    compression: str
    size: int
    start: int
    length: int
    crc: int = 0
    entries: list[tuple[int, int, int]] = field(default_factory=list)
    is_indexed: bool = False
    is_cut: bool = False


class CutError(Exception):
    """A record that does not end before the data do, or is none."""


class ChunkedBag(Bag):
    """A file of records, which are gone through once to find chunks, connections, and the rest."""

    _OF_ENTRY, _OF_LOOSE, _OF_CHUNK, _OF_CONNECTION = 160, 40, 600, 1500
    """Bytes that are kept of an index record, a message outside of chunks, and so on, at most."""

    def __init__(self, path: Path, form: str) -> None:
        super().__init__(path, form)
        self._chunks: list[Chunk] = []
        self._found: dict[int, Connection] = {}
        self._loose = array("q")  # places, four numbers each
        self._noted = 0
        with access_to(path):
            self._file = path.open("rb")
        try:
            with access_to(path):
                self._size = status_of(path).st_size
                self._walk()
            self._find_connections()
        except BaseException:
            self._file.close()
            raise
        self._kept = KeptChunks(self._expanded)

    @property
    def connections(self) -> Sequence[Connection]:
        return list(self._found.values())

    def close(self) -> None:
        self._file.close()

    def pieces(self, connections: Collection[int]) -> Iterator[MessageIndex]:
        wanted = set(connections)
        if self._loose:
            index = MessageIndex.of(self._loose)
            yield index.chosen(np.isin(index.connections, list(wanted)))
        for number, chunk in enumerate(self._chunks):
            if chunk.is_indexed:
                yield from self._indexed(number, wanted)
                continue
            found = array("q")
            for one in self._messages_in(number):
                if one.connection in wanted:
                    found.extend(one)
            if found:
                yield MessageIndex.of(found)

    @abstractmethod
    def _walk(self) -> None:
        """Go through all records of the file."""

    @abstractmethod
    def _find_connections_in(self, number: int) -> None:
        """Take in the connections that a chunk describes."""

    @abstractmethod
    def _messages_in(self, number: int) -> Iterator[Place]:
        """Yield the places of the messages in a chunk, as far as they are whole."""

    @abstractmethod
    def _entries(self, data: bytes, number: int, connection: int) -> MessageIndex:
        """Return the places that the entries of an index record stand for."""

    _ENTRY: int
    """Bytes of an entry."""

    def _find_connections(self) -> None:
        """Look into chunks for connections that no record behind them describes."""
        for number, chunk in enumerate(self._chunks):
            known = {one for one, _, _ in chunk.entries}
            if not (chunk.is_indexed and known <= self._found.keys()):
                self._find_connections_in(number)

    def _indexed(self, number: int, wanted: set[int]) -> Iterator[MessageIndex]:
        for connection, start, count in self._chunks[number].entries:
            for first in range(0, count if connection in wanted else 0, _CHUNKED_TOGETHER):
                with access_to(self.path):
                    self._file.seek(start + self._ENTRY * first)
                    data = self._read(self._ENTRY * min(count - first, _CHUNKED_TOGETHER))
                yield self._entries(data, number, connection)

    def _expanded(self, number: int) -> bytes:
        chunk = self._chunks[number]
        with access_to(self.path):
            self._file.seek(chunk.start)
            data = self._read(chunk.length)
        data = expanded(data, chunk.compression, chunk.size, self.path, partly=chunk.is_cut)
        if chunk.crc and not chunk.is_cut and crc32(data) != chunk.crc:
            raise self.malformed("a chunk is damaged: its checksum differs")
        return data

    def _remark_on_damage(self, number: int) -> None:
        """Warn of a chunk of which the rest cannot be read, unless it is known to be cut."""
        if not self._chunks[number].is_cut:
            self.remark("a chunk is damaged; the intact part before it is read")

    def _remark_on_end(self, why: str = "") -> None:
        """Warn of a file that ends too early, and do without the last index: it may be cut, too."""
        self.remark(f"ends too early{why}; the intact part before it is read")
        if self._chunks:
            self._chunks[-1].is_indexed = False

    def _note_index(self, connection: int, start: int, count: int) -> None:
        self._note_memory(self._OF_ENTRY)
        self._chunks[-1].entries.append((connection, start, count))
        self._chunks[-1].is_indexed = True

    def _note_memory(self, count: int) -> None:
        """Refuse a file of which more is to be kept than there is memory for."""
        self._noted += count
        claim(self.path, self._noted, what="its connections and chunks")

    def _read(self, length: int) -> bytes:
        claim(self.path, length, what=f"{length} bytes of a record")
        data = self._file.read(length)
        if len(data) < length:
            raise self.malformed("ends within a record, or was cut meanwhile")
        return data
