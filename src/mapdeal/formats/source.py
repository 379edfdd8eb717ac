"""Reading a whole input file, with its troubles told apart."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.formats.commit import settle
from mapdeal.formats.identity import CHANGED, FileIdentity

_GIBIBYTE = 1 << 30
LARGEST_FILE = 16 * _GIBIBYTE
_HEAD = 1 << 20
_CHUNK = 1 << 18


def exists(path: Path) -> bool:
    """Return whether there is something at `path`; a name that no file can have is not there."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def real_path(path: Path) -> Path:
    """Return where links lead to; the path itself if they lead in circles, or too far."""
    try:
        return path.resolve()
    except (OSError, ValueError, RuntimeError):
        return path


_sums: ContextVar[dict[Path, str] | None] = ContextVar("sums", default=None)


@contextmanager
def sums_of_reads(*, is_wanted: bool = True) -> Iterator[dict[Path, str]]:
    """Give a mapping that gets the sha256 of each file that `read_file` reads meanwhile.

    It is of the very bytes that were read, whatever becomes of the file after that. Empty if it
    is not wanted, since it takes time.
    """
    sums: dict[Path, str] = {}
    token = _sums.set(sums if is_wanted else None)
    try:
        yield sums
    finally:
        _sums.reset(token)


def read_file(
    path: Path, *, limit: int = LARGEST_FILE, inspect: Callable[[bytes], None] | None = None
) -> bytes:
    """Return the contents of a regular file.

    Parameters
    ----------
    path : Path
        The file.
    limit : int
        Bytes that it may have.
    inspect : callable, optional
        Is shown the first MiB, or the whole if that is less, before memory is taken for the
        rest; raises if the file is not wanted.

    Raises
    ------
    FileAccessError
        If it is missing, not a regular file, not readable, or changed while it was read.
    MalformedInputError
        If it is longer than `limit` bytes.
    """
    try:
        # Only a regular file is opened: a pipe or a device would block or never end.
        before = status_of(path)
        if not stat.S_ISREG(before.st_mode):
            kind = "a directory" if stat.S_ISDIR(before.st_mode) else "no regular file"
            raise FileAccessError(f"cannot be read: it is {kind}", source=path)
        with path.open("rb") as file:
            if inspect is not None:
                inspect(file.read(_HEAD))
                file.seek(0)
            if before.st_size > LARGEST_FILE:  # sparse files claim any size
                rule = f"cannot be read: larger than {LARGEST_FILE} bytes"
                raise FileAccessError(rule, source=path, got=before.st_size)
            if before.st_size > limit:
                rule = f"must not be larger than {limit} bytes"
                raise MalformedInputError(rule, source=path, got=before.st_size)
            data = file.read()
            after = os.fstat(file.fileno())
    except MemoryError:
        rule = "does not fit into memory"
        raise FileAccessError(rule, source=path, got=before.st_size) from None
    except OSError as error:
        rule = f"cannot be read: {error.strerror or error}"
        raise FileAccessError(rule, source=path) from None
    if FileIdentity.of_status(after) != FileIdentity.of_status(before):
        raise FileAccessError(CHANGED, source=path)
    sums = _sums.get()
    if sums is not None:
        sums[path] = hashlib.sha256(data).hexdigest()
    return data


def chunks_of(path: Path) -> Iterator[bytes]:
    """Yield the contents of a file bit by bit; it may be a pipe.

    Raises
    ------
    FileAccessError
        If it cannot be read.
    """
    status_of(path)
    try:
        with path.open("rb", buffering=0) as file:
            while chunk := file.read(_CHUNK):
                yield chunk
    except OSError as error:
        rule = f"cannot be read: {error.strerror or error}"
        raise FileAccessError(rule, source=path) from None


def identity_of(path: Path) -> FileIdentity:
    """Return what becomes another if the file of a name is replaced or written to.

    Raises
    ------
    FileAccessError
        If there is none.
    """
    return FileIdentity.of_status(status_of(path))


def check_identity(path: Path, identity: FileIdentity) -> None:
    """Raise FileAccessError if the file of a name is not the one that it was."""
    if identity_of(path) != identity:
        raise FileAccessError(CHANGED, source=path)


def check_regular(path: Path) -> None:
    """Raise FileAccessError if a file is not there or no regular one: a pipe would block."""
    if not stat.S_ISREG(status_of(path).st_mode):
        raise FileAccessError("cannot be read: it is no regular file", source=path)


def head_of(path: Path, length: int) -> bytes:
    """Return the first bytes of a regular file.

    Raises
    ------
    FileAccessError
        If it cannot be read.
    """
    check_regular(path)
    try:
        with path.open("rb") as file:
            return file.read(length)
    except OSError as error:
        rule = f"cannot be read: {error.strerror or error}"
        raise FileAccessError(rule, source=path) from None


def is_same_file(one: Path, other: Path) -> bool:
    """Return whether two names are of one file that there is."""
    return exists(one) and exists(other) and one.samefile(other)


def ignores_case(folder: Path) -> bool:
    """Return whether names that differ in case alone are one to the disk of a folder.

    The nearest folder that there is tells for one that is yet to be made.
    """
    for known in (folder.absolute(), *folder.absolute().parents):
        other = known.name.swapcase()
        if other != known.name and exists(known):
            return is_same_file(known, known.with_name(other))
    return False


def holds(path: Path, sha256: str) -> bool:
    """Return whether `path` is a file with exactly the contents of that checksum."""
    return exists(path) and path.is_file() and sha256_of(path) == sha256


def status_of(path: Path) -> os.stat_result:
    """Return the status of a file, once what a killed process has left beside it is undone.

    Raises
    ------
    FileAccessError
        If there is none, or no file can have such a name.
    """
    try:
        settle(path.parent)
        return path.stat()
    except ValueError:
        raise FileAccessError("cannot be read: no file has such a name", source=path) from None
    except OSError as error:
        rule = f"cannot be read: {error.strerror or error}"
        raise FileAccessError(rule, source=path) from None


def sha256_of(path: Path) -> str:
    """Return the sha256 of a file's contents, as hexadecimal digits.

    Raises
    ------
    FileAccessError
        If it cannot be read, or is no regular file.
    """
    check_regular(path)
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise FileAccessError(f"cannot be read: {error.strerror}", source=path) from None
