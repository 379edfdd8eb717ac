"""Names of files, and reading a whole input file.

What the system raises on a name that is too long, in a private folder, in a circle of links, or
relative to a working folder that is gone, becomes one `FileAccessError` that names it. All other
modules ask here, and not `pathlib`, whose answers to such names differ between versions of Python.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import NamedTuple

from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.files.budget import claim

YAML, BIT_MAP = (".yaml", ".yml"), ".pbm"
MAPS = (*YAML, ".npz")
"""The likeliest first; a bit map is an image that stands for its YAML."""

NAMED_MAPS = (*MAPS, BIT_MAP)
LFS_POINTER = b"version https://git-lfs"

# Most maps need no parser: keys at the top of a mapping stand at the beginning of a line.
IMAGE_KEY = re.compile(rb"""(?m)^(\xef\xbb\xbf)?["']?image["']?[ \t]*:""")


LARGEST_FILE = 1 << 34
_HEAD = 1 << 20
_CHUNK = 1 << 18
LONGEST_STREAM = 1 << 28
"""Bytes that are taken from a pipe or a device: it may never end."""
CHANGED = "changed while it was read"
"""Error text for a file that was replaced or modified while it was read."""


class FileState(NamedTuple):
    """Properties that change when a file is replaced or written to."""

    inode: int
    size: int
    modified_ns: int

    @classmethod
    def of_status(cls, status: os.stat_result) -> FileState:
        return cls(status.st_ino, status.st_size, status.st_mtime_ns)


@contextmanager
def access_to(path: Path, action: str = "read") -> Iterator[None]:
    """Turn what the system raises within a ``with`` block into one error that names a file."""
    if not _can_be_name(path):
        raise FileAccessError(f"cannot be {action}: no file has such a name", source=path)
    try:
        yield
    except OSError as error:
        is_missing = isinstance(error, FileNotFoundError)
        is_link = is_missing and path.is_symlink()
        why = "it is a link to nothing" if is_link else error.strerror or error
        problem = FileAccessError(f"cannot be {action}: {why}", source=path)
        problem.is_missing = is_missing
        raise problem from None


def _can_be_name(path: Path) -> bool:
    """Return whether bytes stand for the name, none of them zero."""
    try:
        return b"\0" not in os.fsencode(path)
    except UnicodeEncodeError:  # half of a pair of surrogates
        return False


def status_of(path: Path) -> os.stat_result:
    with access_to(path):
        return path.stat()


def _status_or_none(path: Path) -> os.stat_result | None:
    try:
        return status_of(path)
    except FileAccessError:
        return None


def exists(path: Path) -> bool:
    """Return whether there is something at `path` that can be seen; whoever reads it says why not.

    A name that no file can have is not there, nor is a link to nothing.
    """
    return _status_or_none(path) is not None


def yaml_at(path: Path) -> Path | None:
    """Return the YAML file that has the name of another file but for the ending."""
    return next((p for p in map(path.with_suffix, YAML) if exists(p)), None)


def is_folder(path: Path) -> bool:
    status = _status_or_none(path)
    return status is not None and stat.S_ISDIR(status.st_mode)


def is_regular(path: Path) -> bool:
    """Return whether `path` is a file with contents, neither a folder nor a pipe nor a device."""
    status = _status_or_none(path)
    return status is not None and stat.S_ISREG(status.st_mode)


def identity_of(path: Path) -> tuple[int, int] | None:
    """Return the identity of a file or folder, whatever its name; None if there is none."""
    status = _status_or_none(path)
    return None if status is None else (status.st_dev, status.st_ino)


def is_same_file(one: Path, other: Path) -> bool:
    identity = identity_of(one)
    return identity is not None and identity == identity_of(other)


def absolute_path(path: Path) -> Path:
    if path.is_absolute():
        return path
    try:
        return Path(os.getcwd()) / path  # noqa: PTH109 - pathlib asks the same
    except OSError as error:
        rule = f"the working directory does not exist: {error.strerror}"
        raise FileAccessError(rule, source=path) from None


def normal_path(path: Path) -> Path:
    """Return the absolute path without ``..``, whatever links it contains."""
    return Path(os.path.normpath(absolute_path(path)))


def real_path(path: Path) -> Path:
    """Return the absolute path without ``..`` and links; links in a circle stay as they are."""
    whole = absolute_path(path)
    with access_to(path):
        return Path(os.path.realpath(whole))


def contents_of(folder: Path) -> tuple[list[str], list[str]]:
    """Return the names of the folders in a folder and of all else, each in order."""
    # Links count as what they lead to; one that leads to nothing that can be seen is no folder, and
    # whoever reads it says why not.
    folders: list[str] = []
    files: list[str] = []
    with access_to(folder), os.scandir(folder) as entries:
        for entry in entries:
            is_folder = False
            with suppress(OSError):  # of one entry: a circle of links, a link into a private folder
                is_folder = entry.is_dir()
            (folders if is_folder else files).append(entry.name)
    return sorted(folders), sorted(files)


_sums: ContextVar[dict[Path, str] | None] = ContextVar("sums", default=None)


@contextmanager
def sums_of_reads(*, is_wanted: bool = True) -> Iterator[dict[Path, str]]:
    """Yield a mapping that collects the SHA-256 of each file that `read_file` reads."""
    # It is that of the bytes that were read, even if the file changes later. The mapping stays
    # empty if it is not wanted, because it takes time.
    sums: dict[Path, str] = {}
    token = _sums.set(sums if is_wanted else None)
    try:
        yield sums
    finally:
        _sums.reset(token)


def read_file(
    path: Path, *, limit: int = LARGEST_FILE, inspect: Callable[[bytes], None] | None = None
) -> bytes:
    before = check_readable(path)
    try:
        with access_to(path), path.open("rb") as file:
            if inspect is not None:
                inspect(file.read(min(_HEAD, before.st_size)))
                file.seek(0)
            if before.st_size > LARGEST_FILE:  # sparse files claim any size
                rule = f"cannot be read: larger than {LARGEST_FILE} bytes"
                raise FileAccessError(rule, source=path, got=before.st_size)
            if before.st_size > limit:
                rule = f"must not be larger than {limit} bytes"
                raise MalformedInputError(rule, source=path, got=before.st_size)
            claim(path, before.st_size)
            data = file.read()
            after = os.fstat(file.fileno())
    except MemoryError:
        rule = "does not fit into memory"
        raise FileAccessError(rule, source=path, got=before.st_size) from None
    if FileState.of_status(after) != FileState.of_status(before):
        raise FileAccessError(CHANGED, source=path)
    note_sum(path, lambda: hashlib.sha256(data).hexdigest())
    return data


def check_readable(path: Path) -> os.stat_result:
    """Return the status of a regular file: a pipe or a device would block or never end."""
    status = status_of(path)
    if not stat.S_ISREG(status.st_mode):
        kind = "a directory" if stat.S_ISDIR(status.st_mode) else "no regular file"
        raise FileAccessError(f"cannot be read: it is {kind}", source=path)
    return status


def note_sum(path: Path, sum_of: Callable[[], str]) -> None:
    """Keep the sha256 of a file that was read piece by piece, if `sums_of_reads` wants it."""
    sums = _sums.get()
    if sums is not None:
        sums[path] = sum_of()


def chunks_of(path: Path) -> Iterator[bytes]:
    """Yield the contents of a file bit by bit; it may be a pipe."""
    status_of(path)
    with access_to(path), path.open("rb", buffering=0) as file:
        while chunk := file.read(_CHUNK):
            yield chunk


def state_of(path: Path) -> FileState:
    """Return what becomes another if the file of a name is replaced or written to."""
    return FileState.of_status(status_of(path))


def check_state(path: Path, state: FileState) -> None:
    if state_of(path) != state:
        raise FileAccessError(CHANGED, source=path)


def joined(chunks: Iterable[bytes], *, limit: int, source: Path | str) -> bytes:
    parts, length = [], 0
    for chunk in chunks:
        parts.append(chunk)
        length += len(chunk)
        if length > limit:
            raise MalformedInputError(f"must not be larger than {limit} bytes", source=source)
    return b"".join(parts)


def head_of(path: Path, length: int) -> bytes:
    """Return the first bytes of a regular file."""
    size = check_readable(path).st_size
    with access_to(path), path.open("rb") as file:
        return file.read(min(length, size))  # room for more takes longer to be had than the bytes


def ignores_case(folder: Path) -> bool:
    """Return whether names that differ in case alone are one to the disk of a folder."""
    # The nearest existing folder stands for one that is yet to be made.
    whole = absolute_path(folder)
    for known in (whole, *whole.parents):
        other = known.name.swapcase()
        if other != known.name and exists(known):
            return is_same_file(known, known.with_name(other))
    return False


def holds(path: Path, sha256: str) -> bool:
    """Return whether `path` is a file with exactly the contents of that checksum."""
    return is_regular(path) and sha256_of(path) == sha256


def sha256_of(path: Path) -> str:
    """Return the sha256 of a file's contents, as hexadecimal digits."""
    check_readable(path)
    with access_to(path), path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


_ALIKE = 0.8
"""Names are alike from this ratio on: office1.yaml and office.yaml."""


def file_meant(name: str) -> str | None:
    """Return a hint that asks for the file most like a name in its folder; None without any."""
    # A name without an ending means the map of that name.
    import difflib  # of use to mistakes alone

    path = Path(name)
    try:
        names = [one for one in contents_of(path.parent)[1] if one != path.name]
    except FileAccessError:
        return None
    near = [path.name + ending for ending in MAPS if path.name + ending in names]
    plain = {one.lower(): one for one in reversed(names)}
    near += [plain[one] for one in difflib.get_close_matches(path.name.lower(), plain, 1, _ALIKE)]
    return f"did you mean {path.with_name(near[0])}?" if near else None
