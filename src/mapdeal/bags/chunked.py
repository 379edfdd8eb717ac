"""Bags of ROS 1 (version 2.0) and MCAP: files of records, some in chunks; also truncated ones.

Records are read from the start, without the data of chunks. So a bag needs no index at its end,
which is missing after a recorder was killed.

References
----------
ROS wiki, "Bags/Format/2.0": records of a header of fields and of data. mcap.dev, "MCAP Format
Specification", version 0: records of an opcode, a length and fields.
"""

from __future__ import annotations

import os
import re
import struct
from abc import abstractmethod
from array import array
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from mapdeal.bags.bag import Bag, Connection, Encoding, MessageIndex, Place, decompress
from mapdeal.files.source import access_to, claim, status_of
from mapdeal.records import dataclass, field

_MOST_CACHED_BYTES = 1 << 25
_MOST_CACHED = 8

_TOGETHER = 1 << 16  # entries of an index record that are read at once
_OUTSIDE = -1  # stands for the chunk's number in places of messages outside of chunks


class ChunkCache:
    """Cache of the last few chunks: messages sorted by time alternate between two or three."""

    def __init__(self, read: Callable[[int], bytes]) -> None:
        self._read, self._bytes = read, 0
        self._chunks: OrderedDict[int, bytes] = OrderedDict()

    def __getitem__(self, number: int) -> bytes:
        if (chunk := self._chunks.get(number)) is not None:
            self._chunks.move_to_end(number)
            return chunk
        while len(self._chunks) >= _MOST_CACHED or self._bytes > _MOST_CACHED_BYTES:
            _, old = self._chunks.popitem(last=False)
            self._bytes -= len(old)
            del old  # frees the memory before reading another chunk
        chunk = self._chunks[number] = self._read(number)
        self._bytes += len(chunk)
        return chunk


@dataclass
class _Chunk:
    compression: str
    size: int
    start: int
    length: int
    crc: int = 0
    entries: list[tuple[int, int, int]] = field(default_factory=list)
    is_indexed: bool = False
    is_cut: bool = False


class _Record(NamedTuple):
    """A record in a chunk: its position, its opcode or fields, and the range of its data."""

    chunk: bytes
    position: int
    head: Any
    start: int
    end: int

    @property
    def data(self) -> bytes:
        return self.chunk[self.start : self.end]


class _CutError(Exception):
    """A record that is invalid, or extends beyond the end of the data."""


class ChunkedBag(Bag):
    """A file of records; one pass finds its chunks, connections, indices and loose messages."""

    # Upper bounds of memory for an index record, a message outside of chunks, a chunk, etc.
    _ENTRY_BYTES, _LOOSE_BYTES, _CHUNK_BYTES, _CONNECTION_BYTES = 160, 40, 600, 1500
    _ENTRY: np.dtype[Any]  # of an index record

    def __init__(self, path: Path, form: str) -> None:
        super().__init__(path, form)
        self._chunks: list[_Chunk] = []
        self._found: dict[int, Connection] = {}
        self._loose = array("q")  # places, four numbers each
        self._noted = 0
        with access_to(path):
            self._file = path.open("rb")
        try:
            with access_to(path):
                self._size = status_of(path).st_size
                self._walk()
            for number, chunk in enumerate(self._chunks):
                known = {connection for connection, _, _ in chunk.entries}
                if not (chunk.is_indexed and known <= self._found.keys()):
                    for record in self._records_of(number):
                        self._note_described(record)
        except BaseException:
            self._file.close()
            raise
        self._cache = ChunkCache(self._chunk_data)
        self.connections = list(self._found.values())

    def close(self) -> None:
        self._file.close()

    def pieces(self, connections: Collection[int]) -> Iterator[MessageIndex]:
        selected = set(connections)
        if self._loose:
            index = MessageIndex.of(self._loose)
            yield index.select(np.isin(index.connections, list(selected)))
        for number, chunk in enumerate(self._chunks):
            if chunk.is_indexed:
                yield from self._indexed(number, selected)
                continue
            places = array("q")
            for record in self._records_of(number):
                place = self._place_of(record, number)
                if place is not None and place.connection in selected:
                    places.extend(place)
            if places:
                yield MessageIndex.of(places)

    @abstractmethod
    def _walk(self) -> None:
        """Read all records of the file, except the data of chunks."""

    @abstractmethod
    def _record(self, data: bytes, position: int) -> _Record:
        """Return the record at a position in a chunk."""

    @abstractmethod
    def _note_described(self, record: _Record) -> None:
        """Add the connection, if a record in a chunk describes one."""

    @abstractmethod
    def _place_of(self, record: _Record, number: int) -> Place | None:
        """Return the place of a record in a chunk; None unless it is a message."""

    def _records_of(self, number: int) -> Iterator[_Record]:
        data, position = self._chunk_data(number), 0
        while position < len(data):
            try:
                record = self._record(data, position)
            except _CutError:
                if not self._chunks[number].is_cut:
                    self.warn_once("a chunk is damaged; the intact part before it is read")
                return
            yield record
            position = record.end

    def _indexed(self, number: int, selected: set[int]) -> Iterator[MessageIndex]:
        for connection, start, count in self._chunks[number].entries:
            for first in range(0, count if connection in selected else 0, _TOGETHER):
                with access_to(self.path):
                    size = self._ENTRY.itemsize
                    self._file.seek(start + size * first)
                    data = self._read(size * min(count - first, _TOGETHER))
                entries = np.frombuffer(data, self._ENTRY)
                times, offsets = entries["time"].astype(np.int64), entries["offset"]
                if times.ndim == 2:  # seconds and nanoseconds
                    times = times[:, 0] * 10**9 + times[:, 1]
                connections, blocks = (np.full(len(times), k) for k in (connection, number))
                yield MessageIndex(connections, times, blocks, offsets.astype(np.int64))

    def _chunk_data(self, number: int) -> bytes:
        chunk = self._chunks[number]
        with access_to(self.path):
            self._file.seek(chunk.start)
            data = self._read(chunk.length)
        data = decompress(data, chunk.compression, chunk.size, self.path, partly=chunk.is_cut)
        if chunk.crc and not chunk.is_cut and crc32(data) != chunk.crc:
            raise self.malformed("a chunk is damaged: its checksum differs")
        return data

    def _warn_of_early_end(self, cause: str = "") -> None:
        """Warn that the file ends too early; ignore the last index, which may be truncated, too."""
        self.warn_once(f"ends too early{cause}; the intact part before it is read")
        if self._chunks:
            self._chunks[-1].is_indexed = False

    def _note_index(self, connection: int, start: int, count: int) -> None:
        self._note_memory(self._ENTRY_BYTES)
        self._chunks[-1].entries.append((connection, start, count))
        self._chunks[-1].is_indexed = True

    def _note_memory(self, count: int) -> None:
        self._noted += count
        claim(self.path, self._noted, what="its connections and chunks")

    def _read(self, length: int) -> bytes:
        claim(self.path, length, what=f"{length} bytes of a record")
        data = self._file.read(length)
        if len(data) < length:
            raise self.malformed("ends within a record, or was cut meanwhile")
        return data


_ROS1_MAGIC = re.compile(rb"#ROS(?:BAG|RECORD|LOG) V(\d+)\.(\d+)\n")
_ROS1_MESSAGE, _ROS1_BAG, _ROS1_INDEX = b"\2", b"\3", b"\4"
_ROS1_CHUNK, _ROS1_CHUNK_INFO, _ROS1_CONNECTION = b"\5", b"\6", b"\7"
_LONGEST_HEADER = 1 << 20
_MOST_DESCRIPTIONS = 100  # of connections; some writers' indices point to them, not the message
_U32 = struct.Struct("<I")

_Fields = Mapping[bytes, bytes]


class Ros1Bag(ChunkedBag):
    _ENTRY = np.dtype([("time", "<u4", 2), ("offset", "<u4")])

    def __init__(self, path: Path) -> None:
        self._has_summary = False
        super().__init__(path, "a ROS 1 bag")

    def read_message(self, place: Place) -> bytes:
        with access_to(self.path):
            if place.block == _OUTSIDE:
                self._file.seek(place.offset)
                _, length = self._header_at(place.offset)
                return self._read(length)
        chunk = self._cache[place.block]
        with suppress(_CutError):
            record = self._record(chunk, place.offset)
            for _ in range(_MOST_DESCRIPTIONS):
                if record.head.get(b"op") != _ROS1_CONNECTION:
                    break
                record = self._record(chunk, record.end)
            if record.head.get(b"op") == _ROS1_MESSAGE:
                return record.data
        raise self.malformed("an index record points to no message")

    def _walk(self) -> None:
        magic = self._file.readline(64)
        if (match := _ROS1_MAGIC.fullmatch(magic)) is None:
            raise self.malformed("is not a ROS 1 bag: it must begin with #ROSBAG V2.0")
        if match[1] != b"2":
            version = f"{int(match[1])}.{int(match[2])}"
            error = self.malformed(f"is a bag of version {version}; 2.0 is read")
            error.hint = "rosbag migrates old bags: rosbag fix"
            raise error
        position = len(magic)
        while position < self._size:
            try:
                position = self._walk_record(position)
            except _CutError as error:
                self._warn_of_early_end(f" ({error})")
                return
        if not self._has_summary and self._chunks:
            cause = "as left by a recorder that was killed"
            self.warn_once(f"has no index, {cause}; all records are read")

    def _walk_record(self, position: int) -> int:
        self._file.seek(position)
        fields, length = self._header_at(position)
        start = self._file.tell()
        op, end = fields.get(b"op", b"")[:1], start + length
        if op == _ROS1_INDEX:  # some writers declare a wrong length
            count = _number(fields, b"count")
            end = start + self._ENTRY.itemsize * count
            if end > self._size or not self._chunks:
                raise _CutError(f"an index record at byte {start}")
            if _number(fields, b"ver") == 1:
                self._note_index(_number(fields, b"conn"), start, count)
            return end
        is_cut = end > self._size
        if op == _ROS1_CHUNK:
            compression = fields.get(b"compression", b"").decode("latin-1")
            available = min(length, self._size - start)
            size = _number(fields, b"size")
            self._note_memory(self._CHUNK_BYTES)
            self._chunks.append(_Chunk(compression, size, start, available, is_cut=is_cut))
        if is_cut:
            raise _CutError(f"a record of {length} bytes at byte {position}")
        if op == _ROS1_BAG and fields.get(b"encryptor", b""):
            raise self.malformed("is encrypted")
        if op == _ROS1_CONNECTION:
            self._note_connection(fields, self._read(length))
        elif op == _ROS1_MESSAGE:
            self._note_memory(self._LOOSE_BYTES)
            self._loose.extend((_number(fields, b"conn"), _time(fields), _OUTSIDE, position))
        elif op == _ROS1_CHUNK_INFO:
            self._has_summary = True
        return end

    def _note_connection(self, fields: _Fields, data: bytes) -> None:
        number = _number(fields, b"conn")
        if number in self._found:
            return
        self._note_memory(self._CONNECTION_BYTES + 4 * len(data))
        details = _fields_in(data)
        topic = fields.get(b"topic", details.get(b"topic", b""))
        texts = topic, details.get(b"type", b""), details.get(b"message_definition", b"")
        topic_name, name, text = (value.decode("utf-8", "replace") for value in texts)
        self._found[number] = Connection(number, topic_name, name, "ros1", text, "ros1")

    def _note_described(self, record: _Record) -> None:
        if record.head.get(b"op") == _ROS1_CONNECTION:
            try:
                self._note_connection(record.head, record.data)
            except _CutError:
                self.warn_once("the description of a connection is damaged")

    def _place_of(self, record: _Record, number: int) -> Place | None:
        fields = record.head
        if fields.get(b"op") == _ROS1_MESSAGE:
            try:
                return Place(_number(fields, b"conn"), _time(fields), number, record.position)
            except _CutError:
                self.warn_once("the head of a message is damaged; it is left out")
        return None

    def _record(self, data: bytes, position: int) -> _Record:
        try:
            start = position + 4 + _U32.unpack_from(data, position)[0]
            end = start + 4 + _U32.unpack_from(data, start)[0]
        except struct.error:
            raise _CutError("a chunk") from None
        if end > len(data):
            raise _CutError("a chunk")
        return _Record(data, position, _fields_in(data[position + 4 : start]), start + 4, end)

    def _header_at(self, position: int) -> tuple[_Fields, int]:
        place = f"a record at byte {position}"
        word = self._file.read(4)
        length = int.from_bytes(word, "little")
        if len(word) < 4 or length > min(_LONGEST_HEADER, self._size - position):
            raise _CutError(place)
        header, word = self._file.read(length), self._file.read(4)
        if len(header) < length or len(word) < 4:
            raise _CutError(place)
        return _fields_in(header), _U32.unpack(word)[0]


def _fields_in(data: bytes) -> _Fields:
    fields: dict[bytes, bytes] = {}
    position = 0
    while position < len(data):
        start = position + 4
        position = start + int.from_bytes(data[position:start], "little")
        name, equals, value = data[start:position].partition(b"=")
        if not equals or position > len(data):
            raise _CutError("a header of fields")
        fields[name] = value
    return fields


def _number(fields: _Fields, name: bytes) -> int:
    value = fields.get(name, b"")
    if len(value) not in (4, 8):
        raise _CutError(f"a header without {name.decode()}")
    return int.from_bytes(value, "little")


def _time(fields: _Fields) -> int:
    value = fields.get(b"time", b"")
    if len(value) != 8:
        raise _CutError("a message without time")
    return int.from_bytes(value[:4], "little") * 10**9 + int.from_bytes(value[4:], "little")


MCAP_MAGIC = b"\x89MCAP0\r\n"

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX, _DATA_END = 2, 3, 4, 5, 6, 7, 15
_LONGEST_RECORD = 1 << 24  # bytes of a schema or a channel
_BEFORE_DATA = 22  # bytes of a message's record before its data
_LATEST = (1 << 63) - 1  # time; later ones occur in damaged files only
_ENCODINGS: dict[str, Encoding] = {"cdr": "cdr", "ros1": "ros1"}


class McapBag(ChunkedBag):
    # The summary at the end is ignored. Chunks without index records are decompressed to find their
    # messages.
    _ENTRY = np.dtype([("time", "<i8"), ("offset", "<i8")])

    def __init__(self, path: Path) -> None:
        self._schemas: dict[int, tuple[str, ...]] = {}  # names, encodings and texts
        super().__init__(path, "a bag (MCAP)")

    def read_message(self, place: Place) -> bytes:
        with access_to(self.path):
            if place.block == _OUTSIDE:
                self._file.seek(place.offset + 1)
                (length,) = struct.unpack("<Q", self._read(8))
                self._file.seek(_BEFORE_DATA, os.SEEK_CUR)
                return self._read(length - _BEFORE_DATA)
        with suppress(_CutError):
            record = self._record(self._cache[place.block], place.offset)
            if record.head == _MESSAGE and len(record.data) >= _BEFORE_DATA:
                return record.data[_BEFORE_DATA:]
        raise self.malformed("an index record points to no message")

    def _walk(self) -> None:
        if self._file.read(8) != MCAP_MAGIC:
            raise self.malformed("is not an MCAP file: it must begin with its magic bytes")
        position, is_ended = 8, False
        while position + 9 <= self._size:
            self._file.seek(position)
            opcode, length = struct.unpack("<BQ", self._read(9))
            remaining = self._size - position - 9
            if is_ended and opcode not in (_SCHEMA, _CHANNEL):
                if opcode == _FOOTER:
                    return
            elif length > remaining:
                if opcode == _CHUNK and not is_ended:
                    self._add_chunk(position + 9, remaining, is_cut=True)
                break
            else:
                self._add_record(opcode, position, length)
                is_ended = is_ended or opcode == _DATA_END
                if opcode == _FOOTER:
                    return
            position += 9 + length
        if is_ended:
            self.warn_once("ends early, after its messages; all of them are read")
        else:
            self._warn_of_early_end()

    def _add_record(self, opcode: int, position: int, length: int) -> None:
        start = position + 9
        if opcode in (_SCHEMA, _CHANNEL):
            self._note(opcode, self._read(min(length, _LONGEST_RECORD + 1)))
        elif opcode == _CHUNK:
            self._add_chunk(start, length)
        elif opcode == _INDEX and self._chunks:
            head = self._read(min(length, 6))
            channel, size = struct.unpack("<HI", head) if len(head) == 6 else (0, 1)
            if size % self._ENTRY.itemsize or size > length - 6:
                raise self.malformed(f"an index record at byte {position} is damaged")
            self._note_index(channel, start + 6, size // self._ENTRY.itemsize)
        elif opcode == _MESSAGE and length >= _BEFORE_DATA:
            channel, _, time = struct.unpack("<HIQ", self._read(14))
            self._note_memory(self._LOOSE_BYTES)
            self._loose.extend((channel, min(time, _LATEST), _OUTSIDE, position))

    def _add_chunk(self, start: int, length: int, *, is_cut: bool = False) -> None:
        head = self._file.read(min(length, 32))
        if len(head) < 32:
            return
        _, _, size, crc, name_length = struct.unpack("<QQQII", head)
        name, word = self._file.read(min(name_length, 64)), self._file.read(8)
        stored, available = int.from_bytes(word, "little"), length - 40 - name_length
        is_complete = len(name) == name_length and len(word) == 8
        if not is_cut and (not is_complete or stored > available):
            raise self.malformed("the head of a chunk is damaged")
        if is_complete:
            first, stored = start + 40 + name_length, min(stored, available)
            chunk = _Chunk(name.decode("latin-1"), size, first, stored, crc, is_cut=is_cut)
            self._note_memory(self._CHUNK_BYTES)
            self._chunks.append(chunk)

    def _note(self, opcode: int, data: bytes) -> None:
        if len(data) > _LONGEST_RECORD:
            raise self.malformed("a schema or channel is too long")
        try:
            if opcode == _SCHEMA:
                (number,) = struct.unpack_from("<H", data)
                if number not in self._schemas:
                    self._note_memory(self._CONNECTION_BYTES + 2 * len(data))
                    self._schemas[number] = tuple(_texts(data, 2, 3))
                return
            number, schema_number = struct.unpack_from("<HH", data)
            if number in self._found:
                return
            self._note_memory(self._CONNECTION_BYTES + 2 * len(data))
            topic, serialization = _texts(data, 4, 2)
        except (struct.error, _CutError):
            raise self.malformed("a schema or channel is damaged") from None
        name, encoding, text = self._schemas.get(schema_number, ("", "", ""))
        self._found[number] = Connection(
            number, topic, name, _ENCODINGS.get(serialization, ""),
            text if encoding in ("ros2msg", "ros1msg") else "", serialization,
        )  # fmt: skip

    def _note_described(self, record: _Record) -> None:
        if record.head in (_SCHEMA, _CHANNEL):
            self._note(record.head, record.data)

    def _place_of(self, record: _Record, number: int) -> Place | None:
        if record.head != _MESSAGE or record.end - record.start < _BEFORE_DATA:
            return None
        channel, _, time = struct.unpack_from("<HIQ", record.chunk, record.start)
        return Place(channel, min(time, _LATEST), number, record.position)

    def _record(self, data: bytes, position: int) -> _Record:
        if position < 0 or position + 9 > len(data):
            raise _CutError
        opcode, length = struct.unpack_from("<BQ", data, position)
        end = position + 9 + length
        if not opcode or end > len(data):  # there are no records of opcode 0
            raise _CutError
        return _Record(data, position, opcode, position + 9, end)


def _texts(data: bytes, position: int, count: int) -> Iterator[str]:
    for _ in range(count):
        (length,) = struct.unpack_from("<I", data, position)
        position += 4 + length
        if position > len(data):
            raise _CutError
        yield data[position - length : position].decode("utf-8", "replace")
