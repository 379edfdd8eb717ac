"""Bags of ROS 1, version 2.0, also unindexed and cut ones.

References
----------
ROS wiki, "Bags/Format/2.0": records of a header of fields and of data. A bag without an index, as
a recorder leaves it that was killed, has the same chunks as one with it.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from mapdeal.bags.bag import (
    IN_THE_FILE,
    Chunk,
    ChunkedBag,
    Connection,
    CutError,
    MessageIndex,
    Place,
)
from mapdeal.files.source import access_to

_MAGIC = re.compile(rb"#ROSBAG V(\d+)\.(\d+)\n")
_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_LONGEST_HEADER = 1 << 20
_MOST_BEFORE = 100
"""Descriptions of connections before a message that some writers count to it."""

_SECOND = 10**9
_U32 = struct.Struct("<I")

Fields = Mapping[bytes, bytes]


class Ros1Bag(ChunkedBag):
    # Records are gone through from the start, and the data of chunks passed over; so neither the
    # position of the index nor a killed recorder matters. The entries of an index record are
    # counted by its field ``count``, since some writers have a wrong length there.
    _ENTRY = 12

    def __init__(self, path: Path) -> None:
        self._has_summary = False
        super().__init__(path, "a ROS 1 bag")

    def data(self, place: Place) -> bytes:
        with access_to(self.path):
            if place.block == IN_THE_FILE:
                self._file.seek(place.offset)
                _, length = self._header_at(place.offset)
                return self._read(length)
        chunk = self._kept[place.block]
        try:
            fields, start, end = _record(chunk, place.offset)
            for _ in range(_MOST_BEFORE):
                if fields.get(b"op") != bytes([_CONNECTION]):
                    break
                fields, start, end = _record(chunk, end)
        except CutError:
            raise self.malformed("an index record points to no message") from None
        if fields.get(b"op") != bytes([_MESSAGE]):
            raise self.malformed("an index record points to no message")
        return chunk[start:end]

    def _walk(self) -> None:
        """Go through all records of the file."""
        magic = self._file.readline(64)
        match = _MAGIC.fullmatch(magic)
        if match is None:
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
            except CutError as error:
                self._remark_on_end(f" ({error})")
                return
        if not self._has_summary and self._chunks:
            self.remark("has no index, as left by a recorder that was killed; it is read all")

    def _walk_record(self, position: int) -> int:
        self._file.seek(position)
        fields, length = self._header_at(position)
        start = self._file.tell()
        op = fields.get(b"op", b"\0")[0]
        end = start + length
        if op == _INDEX:
            return self._note_entries(fields, start)
        is_cut = end > self._size
        if op == _CHUNK:
            compression = fields.get(b"compression", b"").decode("latin-1")
            size = _number(fields, b"size")
            there = min(length, self._size - start)
            self._note_memory(self._OF_CHUNK)
            self._chunks.append(Chunk(compression, size, start, there, is_cut=is_cut))
        if is_cut:
            raise CutError(f"a record of {length} bytes at byte {position}")
        if op == _BAG and fields.get(b"encryptor", b""):
            raise self.malformed("is encrypted")
        if op == _CONNECTION:
            self._note_connection(fields, self._read(length))
        elif op == _MESSAGE:
            connection, time = _number(fields, b"conn"), _time(fields)
            self._note_memory(self._OF_LOOSE)
            self._loose.extend((connection, time, IN_THE_FILE, position))
        elif op == _CHUNK_INFO:
            self._has_summary = True
        return end

    def _note_entries(self, fields: Fields, start: int) -> int:
        count = _number(fields, b"count")
        end = start + 12 * count
        if end > self._size or not self._chunks:
            raise CutError(f"an index record at byte {start}")
        if _number(fields, b"ver") == 1:
            self._note_index(_number(fields, b"conn"), start, count)
        return end

    def _note_connection(self, fields: Fields, data: bytes) -> None:
        number = _number(fields, b"conn")
        if number in self._found:
            return
        self._note_memory(self._OF_CONNECTION + 4 * len(data))
        told = _fields_in(data)
        topic = fields.get(b"topic", told.get(b"topic", b""))
        texts = topic, told.get(b"type", b""), told.get(b"message_definition", b"")
        topic_name, name, text = (one.decode("utf-8", "replace") for one in texts)
        self._found[number] = Connection(number, topic_name, name, "ros1", text, False, "ros1")

    def _find_connections_in(self, number: int) -> None:
        for fields, data, _ in self._records_of(number):
            if fields.get(b"op") == bytes([_CONNECTION]):
                try:
                    self._note_connection(fields, data)
                except CutError:
                    self.remark("the description of a connection is damaged")

    def _entries(self, data: bytes, number: int, connection: int) -> MessageIndex:
        rows = np.frombuffer(data, "<u4").reshape(-1, 3).astype(np.int64)
        times = rows[:, 0] * _SECOND + rows[:, 1]
        count = len(rows)
        return MessageIndex(np.full(count, connection), times, np.full(count, number), rows[:, 2])

    def _messages_in(self, number: int) -> Iterator[Place]:
        """Yield the places of the messages in a chunk, as far as they are whole."""
        for fields, _, offset in self._records_of(number):
            if fields.get(b"op") != bytes([_MESSAGE]):
                continue
            try:
                yield Place(_number(fields, b"conn"), _time(fields), number, offset)
            except CutError:
                self.remark("the head of a message is damaged; it is left out")

    def _records_of(self, number: int) -> Iterator[tuple[Fields, bytes, int]]:
        """Yield fields, data and offset of the records in a chunk, as far as they are whole."""
        chunk = self._expanded(number)
        position = 0
        while position < len(chunk):
            try:
                fields, start, end = _record(chunk, position)
            except CutError:
                self._remark_on_damage(number)
                return
            yield fields, chunk[start:end], position
            position = end

    def _header_at(self, position: int) -> tuple[Fields, int]:
        """Return fields of the record that the file stands at, and the length of its data."""
        where = f"a record at byte {position}"
        word = self._file.read(4)
        if len(word) < 4:
            raise CutError(where)
        (length,) = _U32.unpack(word)
        if length > min(_LONGEST_HEADER, self._size - position):
            raise CutError(where)
        header, word = self._file.read(length), self._file.read(4)
        if len(header) < length or len(word) < 4:
            raise CutError(where)
        return _fields_in(header), _U32.unpack(word)[0]


def _fields_in(data: bytes) -> Fields:
    """Return the fields of a header: lengths, and ``name=value``."""
    fields: dict[bytes, bytes] = {}
    position = 0
    while position < len(data):
        if position + 4 > len(data):
            raise CutError("a header of fields")
        (length,) = _U32.unpack_from(data, position)
        position += 4
        name, equals, value = data[position : position + length].partition(b"=")
        if not equals or position + length > len(data):
            raise CutError("a header of fields")
        fields[name] = value
        position += length
    return fields


def _record(data: bytes, position: int) -> tuple[Fields, int, int]:
    if position + 4 > len(data):
        raise CutError("a chunk")
    start = position + 4 + _U32.unpack_from(data, position)[0]
    if start + 4 > len(data):
        raise CutError("a chunk")
    fields = _fields_in(data[position + 4 : start])
    end = start + 4 + _U32.unpack_from(data, start)[0]
    if end > len(data):
        raise CutError("a chunk")
    return fields, start + 4, end


def _number(fields: Fields, name: bytes) -> int:
    value = fields.get(name, b"")
    if len(value) not in (4, 8):
        raise CutError(f"a header without {name.decode()}")
    return int.from_bytes(value, "little")


def _time(fields: Fields) -> int:
    value = fields.get(b"time", b"")
    if len(value) != 8:
        raise CutError("a message without time")
    return int.from_bytes(value[:4], "little") * _SECOND + int.from_bytes(value[4:], "little")
