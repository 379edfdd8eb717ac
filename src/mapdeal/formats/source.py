"""Reading a whole input file, with its troubles told apart."""

from __future__ import annotations

import hashlib
import os
import stat
from pathlib import Path

from mapdeal.errors import FileAccessError

_GIBIBYTE = 1 << 30
LARGEST_FILE = 16 * _GIBIBYTE


def read_file(path: Path, *, limit: int = LARGEST_FILE) -> bytes:
    """Return the contents of a regular file.

    Raises
    ------
    FileAccessError
        If it is missing, not a regular file, not readable, longer than `limit` bytes, or
        changed while it was read.
    """
    try:
        # Only a regular file is opened: a pipe or a device would block or never end.
        before = path.stat()
        if not stat.S_ISREG(before.st_mode):
            kind = "a directory" if stat.S_ISDIR(before.st_mode) else "no regular file"
            raise FileAccessError(f"cannot be read: it is {kind}", source=path)
        if before.st_size > limit:
            rule = f"is larger than {limit} bytes"
            raise FileAccessError(rule, source=path, got=before.st_size)
        with path.open("rb") as file:
            data = file.read()
            after = os.fstat(file.fileno())
    except MemoryError:
        rule = "does not fit into memory"
        raise FileAccessError(rule, source=path, got=before.st_size) from None
    except OSError as error:
        rule = f"cannot be read: {error.strerror or error}"
        raise FileAccessError(rule, source=path) from None
    if (after.st_size, after.st_mtime_ns) != (before.st_size, before.st_mtime_ns):
        raise FileAccessError("changed while it was read", source=path)
    return data


def holds(path: Path, sha256: str) -> bool:
    """Return whether `path` is a file with exactly the contents of that checksum."""
    return path.is_file() and sha256_of(path) == sha256


def sha256_of(path: Path) -> str:
    """Return the sha256 of a file's contents, as hexadecimal digits.

    Raises
    ------
    FileAccessError
        If it cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise FileAccessError(f"cannot be read: {error.strerror}", source=path) from None
