"""Checksums of an MCAP file whose writer left them out."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO
from zlib import crc32

_MAGIC = 8  # bytes
_CHUNK, _DATA_END, _FOOTER = 0x06, 0x0F, 0x02
_TIMES_AND_SIZE = 24  # bytes of a chunk before its checksum
_OFFSETS = 16  # bytes of the footer before that of the summary
_PIECE = 1 << 20


def add_checksums(path: Path) -> None:
    """Write the checksums of the chunks, which must be uncompressed, the data and the summary."""
    # mcap.dev, "MCAP Format Specification": CRC-32 of a chunk's records; of all bytes before the
    # record DataEnd; and of those from the summary to the footer's own checksum. DataEnd's checksum
    # covers those of the chunks, which therefore come first.
    with path.open("r+b") as file:
        for opcode, start, length in _records(file):
            if opcode == _CHUNK:
                file.seek(start + _TIMES_AND_SIZE + 4)
                (name,) = struct.unpack("<I", file.read(4))
                first = start + _TIMES_AND_SIZE + 4 + 4 + name + 8
                _write(file, start + _TIMES_AND_SIZE, _crc(file, first, start + length))
            elif opcode == _DATA_END:
                _write(file, start, _crc(file, 0, start - 9))
            elif opcode == _FOOTER:
                file.seek(start)
                (summary,) = struct.unpack("<Q", file.read(8))
                if summary:
                    _write(file, start + _OFFSETS, _crc(file, summary, start + _OFFSETS))


def _records(file: IO[bytes]) -> Iterator[tuple[int, int, int]]:
    position = _MAGIC
    opcode = 0
    while opcode != _FOOTER:
        file.seek(position)
        opcode, length = struct.unpack("<BQ", file.read(9))
        yield opcode, position + 9, length
        position += 9 + length


def _write(file: IO[bytes], position: int, checksum: int) -> None:
    file.seek(position)
    file.write(struct.pack("<I", checksum))


def _crc(file: IO[bytes], start: int, end: int) -> int:
    file.seek(start)
    checksum = 0
    while start < end:
        piece = file.read(min(_PIECE, end - start))
        checksum = crc32(piece, checksum)
        start += len(piece)
    return checksum
