"""Input files: their names, their contents, and the memory that these may take.

System errors about names (too long, in a private folder, in a cycle of links, relative to a deleted
working folder) become one `FileAccessError` that contains the name. All other modules look names up
here instead of in `pathlib`, which treats such names differently from version to version.

A small file can demand any amount of memory, by the numbers in its header or by compression. So
every reader claims the memory it needs before it allocates, and the claim may be refused.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mapdeal import compatibility, records
from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError
from mapdeal.kernels.threads import set_within, tables_claimed

YAML, BIT_MAP = (".yaml", ".yml"), ".pbm"
LFS_POINTER = b"version https://git-lfs"

# Recognises most maps without a parser: keys of the top mapping begin a line.
IMAGE_KEY = re.compile(rb"""(?m)^(\xef\xbb\xbf)?["']?image["']?[ \t]*:""")
LARGEST_FILE = 1 << 34
_HEAD, _CHUNK = 1 << 20, 1 << 18
LONGEST_STREAM = 1 << 28  # most bytes read from a pipe or a device, which may be endless
CHANGED = "changed while it was read"  # of a file that was replaced or modified


@contextmanager
def access_to(path: Path, action: str = "read") -> Iterator[None]:
    """Turn system errors within a ``with`` block into one error that names the file."""
    try:
        is_name = b"\0" not in os.fsencode(path)
    except UnicodeEncodeError:  # half of a pair of surrogates
        is_name = False
    if not is_name:
        raise FileAccessError(f"cannot be {action}: no file has such a name", source=path)
    try:
        yield
    except OSError as error:
        # An exception in a variable of its own traceback would live until garbage is collected,
        # and with it the grids of all callers.
        raise _access_error(path, action, error) from None


def _access_error(path: Path, action: str, error: OSError) -> FileAccessError:
    is_missing = isinstance(error, FileNotFoundError)
    why = "it is a link to nothing" if is_missing and path.is_symlink() else error.strerror or error
    problem = FileAccessError(f"cannot be {action}: {why}", source=path)
    problem.is_missing = is_missing
    return problem


def status_of(path: Path) -> os.stat_result:
    with access_to(path):
        return path.stat()


def _status_or_none(path: Path) -> os.stat_result | None:
    with suppress(FileAccessError):
        return status_of(path)
    return None


def exists(path: Path) -> bool:
    return _status_or_none(path) is not None


def yaml_at(path: Path) -> Path | None:
    """Return the YAML file beside a file with the same stem, if it exists."""
    return next(filter(exists, map(path.with_suffix, YAML)), None)


def is_folder(path: Path) -> bool:
    status = _status_or_none(path)
    return status is not None and stat.S_ISDIR(status.st_mode)


def is_regular(path: Path) -> bool:
    status = _status_or_none(path)
    return status is not None and stat.S_ISREG(status.st_mode)


def identity_of(path: Path) -> tuple[int, int] | None:
    status = _status_or_none(path)
    return None if status is None else (status.st_dev, status.st_ino)


def is_same_file(first: Path, second: Path) -> bool:
    identity = identity_of(first)
    return identity is not None and identity == identity_of(second)


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
    with access_to(path):
        return Path(os.path.realpath(absolute_path(path)))


def contents_of(folder: Path) -> tuple[list[str], list[str]]:
    """Return the names of the subfolders and of the files in a folder, both sorted."""
    # A link counts as its target, a broken one as a file, so that reading it reports the error.
    folders: set[str] = set()
    with access_to(folder), os.scandir(folder) as found:
        entries = list(found)
    for entry in entries:
        with suppress(OSError):  # a cyclic link, or one into a private folder
            folders |= {entry.name} if entry.is_dir() else set()
    return sorted(folders), sorted({entry.name for entry in entries} - folders)


def ignores_case(folder: Path) -> bool:
    # The nearest existing parent stands for a folder that does not exist yet.
    absolute = absolute_path(folder)
    for existing in (absolute, *absolute.parents):
        swapped = existing.name.swapcase()
        if swapped != existing.name and exists(existing):
            return is_same_file(existing, existing.with_name(swapped))
    return False


_SIMILAR = 0.8  # smallest difflib ratio of similar names, such as office1.yaml and office.yaml


def similar_file_hint(name: str, endings: Iterable[str]) -> str | None:
    # For a name without an ending, the map of that name with one of `endings` is suggested.
    import difflib  # only mistakes need it

    path = Path(name)
    try:
        names = [file for file in contents_of(path.parent)[1] if file != path.name]
    except FileAccessError:
        return None
    similar = [path.name + ending for ending in endings if path.name + ending in names]
    by_lower = {file.lower(): file for file in reversed(names)}
    close = difflib.get_close_matches(path.name.lower(), by_lower, 1, _SIMILAR)
    similar += [by_lower[file] for file in close]
    return f"did you mean {path.with_name(similar[0])}?" if similar else None


class FileState(NamedTuple):
    """Properties that change when a file is replaced or written to."""

    inode: int
    size: int
    modified_ns: int

    @classmethod
    def of_status(cls, status: os.stat_result) -> FileState:
        return cls(status.st_ino, status.st_size, status.st_mtime_ns)


def state_of(path: Path) -> FileState:
    return FileState.of_status(status_of(path))


def check_state(path: Path, state: FileState) -> None:
    if state_of(path) != state:
        raise FileAccessError(CHANGED, source=path)


def read_file(
    path: Path, *, limit: int = LARGEST_FILE, inspect: Callable[[bytes], None] | None = None
) -> bytes:
    before = check_readable(path)
    try:
        with access_to(path), path.open("rb") as file:
            if inspect is not None:
                inspect(file.read(min(_HEAD, before.st_size)))
                file.seek(0)
            if before.st_size > LARGEST_FILE:  # sparse files can claim any size
                rule = f"cannot be read: larger than {LARGEST_FILE} bytes"
                raise FileAccessError(rule, source=path, got=before.st_size)
            if before.st_size > limit:
                rule = f"must not be larger than {limit} bytes"
                raise MalformedInputError(rule, source=path, got=before.st_size)
            claim(path, before.st_size)
            data = file.read()
            after = os.fstat(file.fileno())
    except MemoryError:
        raise FileAccessError("does not fit into memory", source=path, got=before.st_size) from None
    if FileState.of_status(after) != FileState.of_status(before):
        raise FileAccessError(CHANGED, source=path)
    note_sum(path, lambda: hashlib.sha256(data).hexdigest())
    return data


def check_readable(path: Path) -> os.stat_result:
    """Return the status of a regular file; refuse pipes and devices, which may never end."""
    status = status_of(path)
    if not stat.S_ISREG(status.st_mode):
        kind = "a directory" if stat.S_ISDIR(status.st_mode) else "not a regular file"
        raise FileAccessError(f"cannot be read: it is {kind}", source=path)
    return status


def head_of(path: Path, length: int) -> bytes:
    size = check_readable(path).st_size
    with access_to(path), path.open("rb") as file:
        return file.read(min(length, size))  # allocating a longer buffer takes longer than reading


def chunks_of(path: Path) -> Iterator[bytes]:
    status_of(path)
    with access_to(path), path.open("rb", buffering=0) as file:
        while chunk := file.read(_CHUNK):
            yield chunk


def joined(chunks: Iterable[bytes], *, limit: int, source: Path | str) -> bytes:
    parts, length = [], 0
    for chunk in chunks:
        parts.append(chunk)
        length += len(chunk)
        if length > limit:
            raise MalformedInputError(f"must not be larger than {limit} bytes", source=source)
        claim(source, 2 * length)
    return b"".join(parts)


@contextmanager
def binary_file(path: Path) -> Iterator[BinaryIO]:
    """Yield an open file; errors about its contents get its name."""
    try:
        with access_to(path), path.open("rb") as file:
            yield file
    except MalformedInputError as error:
        raise error.found_in(path) from None


def sha256_of(path: Path) -> str:
    check_readable(path)
    with access_to(path), path.open("rb") as file:
        return compatibility.file_digest(file, "sha256").hexdigest()


def holds(path: Path, sha256: str) -> bool:
    return is_regular(path) and sha256_of(path) == sha256


_sums: ContextVar[dict[Path, str] | None] = ContextVar("sums", default=None)


@contextmanager
def sums_of_reads(*, is_wanted: bool = True) -> Iterator[dict[Path, str]]:
    """Yield a mapping that collects the SHA-256 of each file that `read_file` reads."""
    # The sums are of the bytes that were read, even if the file changes later. Without `is_wanted`
    # the mapping stays empty, because hashing takes time.
    sums: dict[Path, str] = {}
    with set_within(_sums, sums if is_wanted else None):
        yield sums


def note_sum(path: Path, sum_of: Callable[[], str]) -> None:
    """Add the sha256 of a file that was read in pieces to the mapping of `sums_of_reads`."""
    if (sums := _sums.get()) is not None:
        sums[path] = sum_of()


_MEMINFO, _OWN_GROUP = Path("/proc/meminfo"), Path("/proc/self/cgroup")
_GROUPS = Path("/sys/fs/cgroup")


def free_memory(
    meminfo: Path = _MEMINFO, own_group: Path = _OWN_GROUP, groups: Path = _GROUPS
) -> int | None:
    """Return the bytes that can be allocated before the system swaps or kills processes."""
    # It is the smaller of the machine's free memory and the unused memory of the control groups
    # (version 2) around the process, by which containers limit it.
    if (match := re.search(r"^MemAvailable:\s+(\d+) kB", _text(meminfo), re.MULTILINE)) is None:
        return None
    free = int(match[1]) * 1024
    group = re.search(r"^0::/(.*)$", _text(own_group), re.MULTILINE)
    folder = groups / (group[1] if group else "")
    while True:
        limit, used = _text(folder / "memory.max").strip(), _text(folder / "memory.current").strip()
        if limit.isdecimal() and used.isdecimal():
            # the cache of files counts as used although it can be freed
            cached = re.search(r"^inactive_file (\d+)", _text(folder / "memory.stat"), re.MULTILINE)
            free = min(free, int(limit) - int(used) + (int(cached[1]) if cached else 0))
        if folder in (groups, folder.parent):
            return max(free, 0)
        folder = folder.parent


def _text(path: Path) -> str:
    with suppress(OSError, UnicodeDecodeError):  # systems without this file
        return path.read_text()
    return ""


MOST_EXPANSION = 1000  # largest ratio of expanded to compressed size
BLANK_EXPANSION = 1400  # the same of images: empty maps reach 1032 with deflate and 1366 with LZW
_HARMLESS = 1 << 25  # bytes to which any data may expand: an empty fax page shrinks to nothing
PIECES = 1 << 24  # bytes that readers need for pieces of a file that they never load at once
OF_JSON = 30  # largest ratio of a parsed JSON document in memory to its text
INTERPRETER = 50_000_000  # bytes in use before any file is read
_LITTLE = 1 << 22  # bytes that are always granted
_LEAST = 128_000_000
_SMALL = 256_000_000
"""Defaults: up to _SMALL bytes of free memory are used in full, and _LEAST by each job at least."""


@records.dataclass(frozen=True)
class Budget:
    limit: int | None  # bytes; None for unlimited
    origin: str = ""  # of the limit, for messages; empty if it was chosen
    used: int = 0


SHARE_OF_JOB = " (by default this job's share of the memory)"  # it could use more if it ran alone
_current: ContextVar[Budget | None] = ContextVar("budget", default=None)


def default_limit(jobs: int = 1) -> int | None:
    if (free := free_memory()) is None:
        return None
    return max(free // 2 // jobs, _LEAST, min(free, _SMALL) if jobs == 1 else 0)


def use_memory(
    limit: int | None, *, is_chosen: bool = True, anew: bool = False
) -> AbstractContextManager[None]:
    """Limit the memory of readers within a ``with`` block; None leaves the limit unchanged."""
    if limit is not None:
        return set_within(_current, Budget(limit, "" if is_chosen else SHARE_OF_JOB))
    return set_within(_current, current_budget(anew=anew))


def current_budget(*, anew: bool = False) -> Budget:
    current = None if anew else _current.get()
    return current or Budget(default_limit(), " (by default half of what is free now)")


def holding(count: int) -> AbstractContextManager[None]:
    # A negative count cancels claims of readers whose results do not stay in memory.
    budget = current_budget()
    return set_within(_current, records.replace(budget, used=budget.used + count))


def room() -> int | None:
    """Return the most bytes that `claim` grants now; None for unlimited."""
    budget = current_budget()
    used = INTERPRETER + budget.used
    return None if budget.limit is None else max(budget.limit - used, _LITTLE)


def claim(path: Path | str, count: int, *, what: str = "", hint: str = "") -> None:
    if count <= _LITTLE:  # without a look at the system's memory, which takes longer
        return
    available, budget = room(), current_budget()
    if available is None or budget.limit is None or count <= available:
        return
    size = size_text(INTERPRETER + budget.used + count)
    amounts = f"{size} of memory, {size_text(budget.limit)} may be used{budget.origin}"
    rule = f"{what} need {amounts}" if what else f"needs {amounts}"
    more = f"--max-memory {size.replace(' ', '')} allows more, if that much is available"
    raise MalformedInputError(rule, source=path, hint=f"{more}; {hint}" if hint else more)


_FEW_LINES = 1 << 14


def bytes_of_lines(shape: tuple[int, int], of_each: int) -> int:
    """Return the bytes of tables for each row and column of a map; 0 for a few thousand lines."""
    return of_each * max(sum(shape) - _FEW_LINES, 0)


@contextmanager
def claimed(path: Path | str, count: int, *, what: str = "") -> Iterator[None]:
    """Claim bytes, and the tables that kernels claim within a ``with`` block."""
    claim(path, count, what=what)
    with tables_claimed(lambda size: claim(path, count + size, what=what)):
        yield


def most_expanded(stored: int) -> int:
    """Return the limit for expanding compressed data whose expanded size is unknown, in bytes."""
    available, by_rule = room(), max(_HARMLESS, MOST_EXPANSION * stored)
    if available is None:
        return by_rule
    return min(by_rule, available // 2) if current_budget().origin else available // 2


def check_expansion(
    path: Path | str, stored: int, expanded: int, *, most: int = MOST_EXPANSION, place: str = "",
    on_disk: bool = False,
) -> None:  # fmt: skip
    if expanded <= max(_HARMLESS, most * stored):
        return
    budget = current_budget()
    if budget.limit is not None and not budget.origin and not on_disk:  # the limit was chosen
        return
    rule = f"{stored} bytes would expand to {expanded}, more than {most} times as many"
    hint = "--max-memory SIZE reads it within that size, if you trust the file"
    if on_disk:
        hint = "if you trust the file, expand it first: zstd -d"
    raise MalformedInputError(rule, source=path, place=place or None, hint=hint)


def size_text(count: int) -> str:
    """Return a number of bytes as text, rounded up so that the printed limit suffices."""
    step = 10 ** max(len(str(count)) - 3, 0)
    rounded = -(-count // step) * step
    unit, name = (10**9, "GB") if rounded >= 10**9 else (10**6, "MB")
    return f"{rounded / unit:.6f}".rstrip("0").rstrip(".") + f" {name}"


def size_of(text: str, name: str | None = None) -> int:
    """Return the bytes of a size: ``500M`` and ``4GiB`` use powers of 1024, ``4GB`` of 1000."""
    match = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]*)?)\s*([kmgt]?)(i?b)?", text.strip().lower())
    if match is None:
        raise ParameterError("must be a size such as 4G or 500M", place=name, got=text)
    base = 1000 if match[3] == "b" else 1024
    size = int(float(match[1]) * base ** " kmgt".index(match[2] or " "))
    if size < 1:
        raise ParameterError("must be above 0", place=name, got=text)
    return size
