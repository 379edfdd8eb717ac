"""Bags in MCAP files, also cut ones and those without a summary.

References
----------
mcap.dev, "MCAP Format Specification", version 0: records of an opcode, a length and fields.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mapdeal.bags.bag import (
    IN_THE_FILE,
    Chunk,
    ChunkedBag,
    Connection,
    CutError,
    Encoding,
    MessageIndex,
    Place,
)
from mapdeal.files.source import access_to

MAGIC = b"\x89MCAP0\r\n"

_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX = 1, 2, 3, 4, 5, 6, 7
_DATA_END = 0x0F
_LONGEST_RECORD = 1 << 24
"""Bytes of a schema or a channel."""

_BEFORE_DATA = 22
"""Bytes of a message's record before its data."""

_ENCODINGS: dict[str, Encoding] = {"cdr": "cdr", "ros1": "ros1"}


class _Schema(NamedTuple):
    name: str
    encoding: str
    text: str


class McapBag(ChunkedBag):
    """An MCAP file with messages of ROS 1 or 2."""

    # Records are gone through from the start, and the data of chunks passed over: the summary at
    # the end is not needed. Chunks without index records are expanded to see what they hold.
    _ENTRY = 16

    def __init__(self, path: Path) -> None:
        self._schemas: dict[int, _Schema] = {}
        super().__init__(path, "a bag (MCAP)")

    def data(self, place: Place) -> bytes:
        with access_to(self.path):
            if place.block == IN_THE_FILE:
                self._file.seek(place.offset + 1)
                (length,) = struct.unpack("<Q", self._read(8))
                self._file.seek(_BEFORE_DATA, os.SEEK_CUR)
                return self._read(length - _BEFORE_DATA)
        chunk = self._kept[place.block]
        try:
            opcode, start, end = _record(chunk, place.offset)
        except CutError:
            opcode, start, end = 0, 0, 0
        if opcode != _MESSAGE or end - start < _BEFORE_DATA:
            raise self.malformed("an index record points to no message")
        return chunk[start + _BEFORE_DATA : end]

    def _walk(self) -> None:
        """Go through all records of the file."""
        if self._file.read(8) != MAGIC:
            raise self.malformed("is not an MCAP file: it must begin with its magic bytes")
        position, is_ended = 8, False
        while position + 9 <= self._size:
            self._file.seek(position)
            opcode, length = struct.unpack("<BQ", self._read(9))
            if is_ended and opcode not in (_SCHEMA, _CHANNEL):
                if opcode == _FOOTER:
                    return
            elif length > self._size - position - 9:
                if opcode == _CHUNK and not is_ended:
                    self._note_chunk(position + 9, self._size - position - 9, is_cut=True)
                break
            else:
                self._take(opcode, position, length)
                is_ended = is_ended or opcode == _DATA_END
                if opcode == _FOOTER:
                    return
            position += 9 + length
        if is_ended:
            self.remark("ends early, after its messages; all of them are read")
        else:
            self._remark_on_end()

    def _take(self, opcode: int, position: int, length: int) -> None:
        """Take in the record at a position, behind which the file stands."""
        start = position + 9
        if opcode in (_SCHEMA, _CHANNEL):
            self._note(opcode, self._read(min(length, _LONGEST_RECORD + 1)))
        elif opcode == _CHUNK:
            self._note_chunk(start, length)
        elif opcode == _INDEX and self._chunks:
            head = self._read(min(length, 6))
            channel, size = struct.unpack("<HI", head) if len(head) == 6 else (0, 1)
            if size % 16 or size > length - 6:
                raise self.malformed(f"an index record at byte {position} is damaged")
            self._note_index(channel, start + 6, size // 16)
        elif opcode == _MESSAGE and length >= _BEFORE_DATA:
            channel, _, time = struct.unpack("<HIQ", self._read(14))
            self._note_memory(self._OF_LOOSE)
            self._loose.extend((channel, _signed(time), IN_THE_FILE, position))

    def _note_chunk(self, start: int, length: int, *, is_cut: bool = False) -> None:
        head = self._file.read(min(length, 32))
        if len(head) < 32:
            return
        _, _, size, crc, name_length = struct.unpack("<QQQII", head)
        name = self._file.read(min(name_length, 64, length - 32))
        word = self._file.read(8)
        before = 40 + name_length
        if len(name) < name_length or len(word) < 8:
            if is_cut:
                return
            raise self.malformed("the head of a chunk is damaged")
        stored = int.from_bytes(word, "little")
        if not is_cut and stored > length - before:
            raise self.malformed("the head of a chunk is damaged")
        self._note_memory(self._OF_CHUNK)
        self._chunks.append(
            Chunk(
                name.decode("latin-1"), size, start + before, min(stored, length - before), crc,
                is_cut=is_cut,
            )
        )  # fmt: skip

    def _note(self, opcode: int, data: bytes) -> None:
        if len(data) > _LONGEST_RECORD:
            raise self.malformed("a schema or channel is too long")
        try:
            if opcode == _SCHEMA:
                (number,) = struct.unpack_from("<H", data)
                if number in self._schemas:
                    return
                self._note_memory(self._OF_CONNECTION + 2 * len(data))
                name, position = _text(data, 2)
                encoding, position = _text(data, position)
                text, _ = _text(data, position)
                self._schemas[number] = _Schema(name, encoding, text)
                return
            number, schema_number = struct.unpack_from("<HH", data)
            if number in self._found:
                return
            self._note_memory(self._OF_CONNECTION + 2 * len(data))
            topic, position = _text(data, 4)
            serialization, _ = _text(data, position)
        except (struct.error, CutError):
            raise self.malformed("a schema or channel is damaged") from None
        schema = self._schemas.get(schema_number, _Schema("", "", ""))
        self._found[number] = Connection(
            number, topic, schema.name, _ENCODINGS.get(serialization, ""),
            schema.text if schema.encoding in ("ros2msg", "ros1msg", *_IDL) else "",
            schema.encoding in _IDL, serialization,
        )  # fmt: skip

    def _find_connections_in(self, number: int) -> None:
        data = self._expanded(number)
        for opcode, start, end in self._records_of(number, data):
            if opcode in (_SCHEMA, _CHANNEL):
                self._note(opcode, data[start:end])

    def _messages_in(self, number: int) -> Iterator[Place]:
        data = self._expanded(number)
        for opcode, start, end in self._records_of(number, data):
            if opcode == _MESSAGE and end - start >= _BEFORE_DATA:
                channel, _, time = struct.unpack_from("<HIQ", data, start)
                yield Place(channel, _signed(time), number, start - 9)

    def _entries(self, data: bytes, number: int, connection: int) -> MessageIndex:
        rows = np.frombuffer(data, "<i8").reshape(-1, 2)
        count = len(rows)
        return MessageIndex(
            np.full(count, connection), rows[:, 0], np.full(count, number), rows[:, 1]
        )

    def _records_of(self, number: int, data: bytes) -> Iterator[tuple[int, int, int]]:
        """Yield opcode, start and end of the records in a chunk, as far as they are whole."""
        position = 0
        while position < len(data):
            try:
                opcode, start, end = _record(data, position)
            except CutError:
                self._remark_on_damage(number)
                return
            yield opcode, start, end
            position = end


_IDL = ("ros2idl", "omgidl")


def _record(data: bytes, position: int) -> tuple[int, int, int]:
    """Return the opcode of a record in a chunk, and where its fields begin and end."""
    if position < 0 or position + 9 > len(data):
        raise CutError
    opcode, length = struct.unpack_from("<BQ", data, position)
    if not opcode or length > len(data) - position - 9:  # there are no records of opcode 0
        raise CutError
    return opcode, position + 9, position + 9 + length


def _text(data: bytes, position: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", data, position)
    end = position + 4 + length
    if end > len(data):
        raise CutError
    return data[position + 4 : end].decode("utf-8", "replace"), end


def _signed(time: int) -> int:
    """Return a time that numpy can hold; what is beyond is no time of a recording."""
    return min(time, (1 << 63) - 1)
