"""Temporary files, locks on folders, and signals put off: what leaves nothing behind."""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import io
import os
import shutil
import signal
import stat
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from mapdeal.errors import FileAccessError

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

try:
    import fcntl
except ImportError:  # not POSIX: temporary files of killed runs are then not cleaned up
    fcntl = None  # type: ignore[assignment]

PREFIX = ".mapdeal-"
"""Of the names of all files that are not there to stay."""

_SUFFIX, _KEPT = ".tmp", ".old"
_AT_ONCE = 1 << 18

# SIGINT comes first: once it is put off, nothing is raised in the middle of putting off the others.
_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")

Writer = Callable[[BinaryIO], None]


@contextmanager
def refused(path: Path, doing: str = "written") -> Iterator[None]:
    """Turn what the system raises within the block into one error about an output."""
    try:
        yield
    except OSError as error:
        rule = f"cannot be {doing}: {error.strerror or error}"
        raise FileAccessError(rule, source=path) from None


class _File(io.BufferedRandom):
    """A file whose writing, by a thread, can be stopped."""

    is_discarded = False

    def write(self, data: ReadableBuffer) -> int:
        if self.is_discarded:
            raise FileAccessError("was discarded")
        return super().write(data)


class Temporary:
    """A locked temporary file beside its destination."""

    def __init__(self, destination: Path) -> None:
        self.destination = destination
        self.path = destination
        self._file: _File | None = None
        self._is_ours = False

    @property
    def file(self) -> io.BufferedRandom:
        """File object to write to.

        Raises
        ------
        FileAccessError
            If the file was discarded.
        """
        if self._file is None:
            raise FileAccessError("was discarded", source=self.destination)
        return self._file

    def open(self) -> None:
        # Between its making and its locking another run may take it for one of a dead process and
        # remove it; then there is no file of that name any more, and another is made.
        while True:
            self.path, self._is_ours = _name_beside(self.destination, _SUFFIX), True
            descriptor = _locked_new_file(self.path, self.destination)
            if self.path.exists():
                break
            os.close(descriptor)
        self._file = _File(io.FileIO(descriptor, "r+b"))
        with contextlib.suppress(OSError):  # a replaced file that can be seen keeps its permissions
            self.path.chmod(stat.S_IMODE(self.destination.stat().st_mode))

    def fill(self, writer: Writer, with_checksum: bool) -> str:
        """Write the contents; return their sha256 if it is asked for."""
        file = self.file
        writer(file)
        file.flush()
        if not with_checksum:
            return ""
        is_small = os.fstat(file.fileno()).st_size <= _AT_ONCE
        file.seek(0)
        if is_small:  # without the buffer of file_digest, which takes longer than the file
            return hashlib.sha256(file.read()).hexdigest()
        return hashlib.file_digest(file, "sha256").hexdigest()

    def append(self, data: bytes) -> None:
        file = self.file
        with refused(self.destination):
            file.write(data)

    def sync(self) -> None:
        if self._file is not None:
            os.fsync(self._file.fileno())

    def rename(self) -> None:
        """Rename the file to its own name, replacing an old one."""
        self._close_to_move()
        self.path.replace(self.destination)
        self._is_ours = False
        self._close()

    def discard(self) -> None:
        """Stop whoever writes the file."""
        if self._file is not None:
            self._file.is_discarded = True

    def remove(self) -> None:
        """Remove the file, unless it has its own name already."""
        self._close_to_move()
        if self._is_ours:
            with contextlib.suppress(OSError):  # it is gone, or the next command takes it away
                self.path.unlink()
            self._is_ours = False
        self._close()

    def _close_to_move(self) -> None:
        """Close the file where open files cannot be renamed or removed, which is on Windows."""
        # Elsewhere it stays open, and locked, until it has its own name.
        if fcntl is None:
            self._close()

    def _close(self) -> None:
        if self._file is not None:
            with contextlib.suppress(OSError):  # a full disk says so once more
                self._file.close()
            self._file = None


def _locked_new_file(path: Path, destination: Path) -> int:
    """Make a file and lock it; return its descriptor."""
    with refused(destination):
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    if fcntl is not None:
        # Some network file systems have no locks; then stale files stay, no more.
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
    return descriptor


def _name_beside(path: Path, suffix: str) -> Path:
    return path.parent / f"{PREFIX}{os.urandom(6).hex()}{suffix}"


def keep_beside(path: Path) -> Path:
    """Give a file, or a link, a second name beside its own; return that."""
    # It is a copy where there can be no second name: on file systems without hard links, and of a
    # file that belongs to somebody else.
    kept = _name_beside(path, _KEPT)
    try:
        os.link(path, kept, follow_symlinks=False)
    except (OSError, NotImplementedError):
        try:
            shutil.copy2(path, kept, follow_symlinks=False)
        except BaseException:
            kept.unlink(missing_ok=True)
            raise
    return kept


def remove_stale(folder: Path) -> None:
    """Remove what killed processes have left: files that nobody holds locked, and kept old ones."""
    # Old files are kept only while their folder is locked.
    with locked([folder]) as is_alone:
        for path in folder.glob(f"{PREFIX}*"):
            with contextlib.suppress(OSError):
                if path.suffix == _KEPT and is_alone:
                    path.unlink()
                elif path.suffix == _SUFFIX and fcntl is not None:
                    with path.open("r+b") as file:
                        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
                        path.unlink()


@contextmanager
def locked(folders: Iterable[Path]) -> Iterator[bool]:
    """Keep other transactions from renaming files in folders: sets must not mix."""
    # The locks die with their process. Gives whether they were to be had: some network file systems
    # have none, and then the last rename of each file wins.
    with contextlib.ExitStack() as stack:
        are_had = fcntl is not None
        for folder in sorted({folder.resolve() for folder in folders}):  # all in the same order
            if fcntl is not None:
                try:
                    descriptor = os.open(folder, os.O_RDONLY)
                    stack.callback(os.close, descriptor)
                    fcntl.flock(descriptor, fcntl.LOCK_EX)
                except OSError:
                    are_had = False
        yield are_had


@contextmanager
def signals_put_off() -> Iterator[None]:
    """Delay signals that end the process until the end of the block."""
    # Python handles signals in the main thread only: in other threads there is nothing to delay.
    # The effect of a signal, an exception or the end of the process, then follows the block.
    # SIGKILL cannot be delayed.
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers: dict[int, Any] = {}
    came: list[int] = []
    try:
        for number in (getattr(signal, name, None) for name in _ENDING):
            handler = None if number is None else signal.getsignal(number)
            if number is None or handler in (None, signal.SIG_IGN):  # None: not set by Python
                continue
            handlers[number] = handler
            signal.signal(number, lambda which, _: came.append(which))
        yield
    finally:
        for number, handler in reversed(handlers.items()):
            signal.signal(number, handler)
        for number in dict.fromkeys(came):
            signal.raise_signal(number)


def sync_folder(folder: Path) -> None:
    # A file system that cannot do that makes renames durable by its own rules.
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def folder_for_sockets() -> Path:
    """Return the system's folder for temporary files."""
    import tempfile  # of use to few

    return Path(tempfile.gettempdir())


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Yield a private folder in the system's folder for temporary files, removed at the end."""
    import tempfile

    try:
        with signals_put_off():
            folder = tempfile.mkdtemp(prefix="mapdeal-")
            remove = partial(shutil.rmtree, folder, ignore_errors=True)
            atexit.register(remove)
    except OSError as error:
        rule = f"no temporary folder can be made: {error.strerror or error}"
        raise FileAccessError(rule, hint="TMPDIR names where") from None
    try:
        yield Path(folder)
    finally:
        with signals_put_off():
            remove()
            atexit.unregister(remove)
