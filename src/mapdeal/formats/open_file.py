"""Files that are read piece by piece and must stay the same meanwhile."""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import field
from pathlib import Path
from typing import BinaryIO

from mapdeal.errors import FileAccessError
from mapdeal.formats.budget import claim
from mapdeal.formats.source import CHANGED, LARGEST_FILE, FileState, access_to, check_readable
from mapdeal.records import dataclass

HEAD = 1 << 19
"""Bytes at the start of a file that identify it: headers of images are not longer."""

_CHUNK = 1 << 20


@dataclass(frozen=True)
class OpenFile:
    """A regular file that is open, of which any bytes can be read, by several threads at once."""

    path: Path
    size: int
    _descriptor: int
    _state: FileState
    _head: list[bytes] = field(default_factory=list)

    def read(self, offset: int, count: int) -> bytes:
        """Return some bytes, fewer at the end, which are those of the file that was opened."""
        # Not through a memory map: a file that gets shorter would end the process.
        if offset < HEAD and self._head:  # small files are no more than that
            known = self._head[0]
            if offset + count <= len(known) or len(known) == self.size:
                self._check_state()
                return known if count >= len(known) and not offset else known[offset:][:count]
        parts = self._parts(offset, count)
        data = parts[0] if len(parts) == 1 else b"".join(parts)
        if offset == 0 and count == HEAD:
            self._head.append(data)
        return data

    def _check_state(self) -> None:
        with access_to(self.path):
            after = os.fstat(self._descriptor)
        if FileState.of_status(after) != self._state:
            raise FileAccessError(CHANGED, source=self.path)

    def _parts(self, offset: int, count: int) -> list[bytes]:
        parts = []
        # no larger than the file: room that is not needed takes longer to be had than the bytes
        count = min(count, self.size - offset)
        with access_to(self.path):
            while count > 0 and (part := os.pread(self._descriptor, count, offset)):
                parts.append(part)
                offset, count = offset + len(part), count - len(part)
        self._check_state()
        return parts

    def check_length(self) -> None:
        """Refuse more than any file has: sparse ones claim any size."""
        if self.size > LARGEST_FILE:
            rule = f"cannot be read: larger than {LARGEST_FILE} bytes"
            raise FileAccessError(rule, source=self.path, got=self.size)

    def read_whole(self) -> bytes:
        self.check_length()
        claim(self.path, self.size)
        try:
            return self.read(0, self.size)
        except MemoryError:
            rule = "does not fit into memory"
            raise FileAccessError(rule, source=self.path, got=self.size) from None

    def sha256(self) -> str:
        """Return the checksum of the whole file, as hexadecimal digits."""
        checksum, offset = hashlib.sha256(), 0
        while chunk := self.read(offset, _CHUNK):
            checksum.update(chunk)
            offset += len(chunk)
        return checksum.hexdigest()

    def stream(self) -> BinaryIO:
        """Return what reads the file from its start on, as libraries want it."""
        return io.BufferedReader(_Stream(self))


class _Stream(io.RawIOBase):
    """The bytes of an open file, one after the other."""

    def __init__(self, file: OpenFile) -> None:
        self._file = file
        self._offset = 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._offset, os.SEEK_END: self._file.size}[whence]
        if base + offset < 0:
            raise ValueError("a place before the file")
        self._offset = base + offset
        return self._offset

    def readinto(self, buffer: bytearray | memoryview) -> int:  # type: ignore[override]
        data = self._file.read(self._offset, len(buffer))
        buffer[: len(data)] = data
        self._offset += len(data)
        return len(data)


@contextmanager
def opened(path: Path) -> Iterator[OpenFile]:
    """Open a regular file to read it piece by piece."""
    check_readable(path)
    with access_to(path):
        descriptor = os.open(path, os.O_RDONLY)
    try:
        with access_to(path):
            status = os.fstat(descriptor)
        yield OpenFile(path, status.st_size, descriptor, FileState.of_status(status))
    finally:
        os.close(descriptor)
