"""Bags whose messages lie in chunks."""

from __future__ import annotations

import bz2
import sys
from abc import abstractmethod
from array import array
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from mapdeal.errors import MalformedInputError
from mapdeal.formats.bags.bag import Bag, Connection, MessageIndex, Place
from mapdeal.formats.budget import check_expansion, claim, most_expanded
from mapdeal.formats.source import access_to, status_of
from mapdeal.records import dataclass

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


_TOGETHER = 1 << 16
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
            for first in range(0, count if connection in wanted else 0, _TOGETHER):
                with access_to(self.path):
                    self._file.seek(start + self._ENTRY * first)
                    data = self._read(self._ENTRY * min(count - first, _TOGETHER))
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
