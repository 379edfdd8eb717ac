"""Writing a set of output files so that a failure leaves nothing and a kill nothing torn."""

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
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from contextvars import copy_context
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, BinaryIO

from mapdeal.compatibility import file_digest
from mapdeal.errors import FileAccessError, ParameterError, refuse_warnings
from mapdeal.files.source import holds, is_same_file, real_path
from mapdeal.kernels.blocks import Layer, swept
from mapdeal.kernels.threads import ThreadPool, thread_count

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

try:
    import fcntl
except ImportError:  # not POSIX: temporary files of killed runs are then not cleaned up
    fcntl = None  # type: ignore[assignment]

PREFIX = ".mapdeal-"  # of the names of all files that are not there to stay
_SUFFIX, _KEPT = ".tmp", ".old"
_AT_ONCE = 1 << 18

# SIGINT comes first: once it is put off, nothing is raised in the middle of putting off the others.
_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")

Writer = Callable[[BinaryIO], object]


@contextmanager
def refused(path: Path, problem: str = "cannot be written") -> Iterator[None]:
    """Turn what the system raises within the block into one error about an output."""
    try:
        yield
    except OSError as error:
        rule = f"{problem}: {error.strerror or error}"
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
        return file_digest(file, "sha256").hexdigest()

    def sync(self) -> None:
        if self._file is not None:
            os.fsync(self._file.fileno())

    def rename(self) -> None:
        self._close_to_move()
        self.path.replace(self.destination)
        self._is_ours = False
        self._close()

    def discard(self) -> None:
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
    if threading.get_ident() != threading.main_thread().ident:
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
    import tempfile  # of use to few

    return Path(tempfile.gettempdir())


def lasting_folder() -> Path:
    """Return a new private folder among temporary files, which stays."""
    import tempfile

    try:
        return Path(tempfile.mkdtemp(prefix="mapdeal-"))
    except OSError as error:
        raise _no_folder(error) from None


def _no_folder(error: OSError) -> FileAccessError:
    rule = f"no temporary folder can be made: {error.strerror or error}"
    return FileAccessError(rule, hint="TMPDIR names where")


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
        raise _no_folder(error) from None
    try:
        yield Path(folder)
    finally:
        with signals_put_off():
            remove()
            atexit.unregister(remove)


_ATTEMPTS = 10_000

PutRows = Callable[[slice], object]

Begun = tuple[Path, BinaryIO, Writer]
"""A file that is to be written: its name, what is written to, and what writes it."""


@dataclass(frozen=True, eq=False)
class RowsWriter:
    """A writer that takes rows as they come: one pass can serve several such files."""

    layer: Layer
    begin: Callable[[BinaryIO], tuple[PutRows, Callable[[], object]]]

    def __call__(self, file: BinaryIO) -> None:
        put, finish = self.begin(file)
        for rows in swept(self.layer):
            put(rows)
        finish()


class Transaction:
    """A set of output files that appear together, at the end."""

    # Each file is written under a temporary name in its own folder, as many at the same time as
    # `mapdeal.kernels.threads` allows. When the block ends without an error, all are renamed in the
    # order of the calls to `write`: the folders are locked meanwhile, signals wait, and a rename
    # that fails undoes those before it. Temporary files are locked by their process, so that those
    # of a killed run are told from those of a live one and removed.
    def __init__(
        self, outputs: Iterable[Path], *, inputs: Sequence[Path] = (), force: bool = False,
        hint: str = "--force replaces it", checksums: bool = False,
    ) -> None:  # fmt: skip
        self._outputs = list(outputs)
        self._inputs = tuple(inputs)
        self._replaces = force
        self._removed: list[Path] = []
        self._with_checksums = checksums
        # one thread is one, not another one that writes
        self._pool = ThreadPool(thread_count() if thread_count() > 1 else 0)
        self._temporaries: list[Temporary] = []
        self._pending: list[tuple[Temporary, Future[str]]] = []
        self._together: list[tuple[Temporary, Writer]] | None = None
        self._made_folders: list[Path] = []
        places: set[Path] = set()
        for output in self._outputs:
            _check_output(output, inputs, None if force else hint)
            place = real_path(output.parent) / output.name
            if place in places:
                raise ParameterError("is the place of two outputs", source=output)
            places.add(place)

    def __enter__(self) -> Transaction:
        atexit.register(self._discard)  # a signal may keep `__exit__` from being called
        folders = dict.fromkeys(output.parent for output in self._outputs)
        try:
            for folder in folders:
                self._prepare(folder)
        except BaseException:
            self._discard()
            raise
        return self

    def write(self, path: Path, writer: Writer) -> None:
        """Write the file that becomes `path` by calling `writer` in a thread."""
        temporary = self._opened(path)
        if self._together is not None:
            self._together.append((temporary, writer))
        else:
            self._finish(temporary, writer)

    @contextmanager
    def together(self, write_all: Callable[[Sequence[Begun]], None]) -> Iterator[None]:
        """Write all files passed to `write` within a ``with`` block by a single call."""
        self._together = []
        try:
            yield
            begun = self._together
        finally:
            self._together = None
        files = [(one.destination, one.file, writer) for one, writer in begun]
        done = self._pool.submit(copy_context().run, write_all, files)
        for temporary, _ in begun:
            self._finish(temporary, lambda _: done.result())

    def write_parts(self, path: Path, parts: Iterable[bytes]) -> None:
        """Write the file that becomes `path` in this thread, each part as soon as it is there."""
        temporary = self._opened(path)
        for part in parts:
            with refused(path):
                temporary.file.write(part)
        self._finish(temporary, lambda _: None)

    def _opened(self, path: Path) -> Temporary:
        if path not in self._outputs:
            raise ParameterError("was not announced as an output", source=path)
        temporary = Temporary(path)
        self._temporaries.append(temporary)  # first, since Ctrl-C may come at any moment
        temporary.open()
        return temporary

    def _finish(self, temporary: Temporary, writer: Writer) -> None:
        fill, context = temporary.fill, copy_context()
        future = self._pool.submit(context.run, fill, writer, self._with_checksums)
        self._pending.append((temporary, future))

    def write_bytes(self, path: Path, data: bytes) -> None:
        self.write(path, lambda file: file.write(data))

    def write_json(self, path: Path, document: Any) -> None:
        from mapdeal.files.json_values import json_of  # few outputs are JSON

        self.write_bytes(path, json_of(document))

    def wait(self) -> dict[Path, str]:
        """Wait for the files whose writing has begun, so that what they are made of can go."""
        sums = {}
        for one, future in self._pending:
            with refused(one.destination):
                sums[one.destination] = future.result()
        return sums

    def remove_if_unchanged(self, path: Path, sha256: str) -> None:
        """Remove a file with the old ones, if it has exactly these contents and is not an input."""
        if not _is_input(path, self._inputs) and holds(path, sha256):
            self._removed.append(path)

    def checksums(self) -> dict[Path, str]:
        """Return the sha256 of each file so far, waiting for those that are being written."""
        if not self._with_checksums:
            raise ValueError("the transaction was begun without checksums")
        return self.wait()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:  # fmt: skip
        try:
            if error is None:
                self.wait()
                refuse_warnings()
                temporaries = [temporary for temporary, _ in self._pending]
                # for the disk once all files are written: the first wait is for most of all
                syncs = [self._pool.submit(one.sync) for one in temporaries]
                for one, future in zip(temporaries, syncs, strict=True):
                    with refused(one.destination):
                        future.result()
                _put_in_place(temporaries, self._removed, replaces=self._replaces)
                self._made_folders.clear()
        finally:
            self._discard()

    def _prepare(self, folder: Path) -> None:
        """Make a folder that files can be written into, and remove what killed runs left there."""
        # Another process that fails takes the folders away again which it has made.
        for _ in range(_ATTEMPTS):
            with contextlib.suppress(FileNotFoundError):
                self._make(folder)
                remove_stale(folder)
                return
        raise FileAccessError("the folder is removed again and again", source=folder)

    def _make(self, folder: Path) -> None:
        missing = []
        while not folder.exists():
            missing.append(folder)
            folder = folder.parent
        for new in reversed(missing):
            self._made_folders.append(new)
            try:
                new.mkdir(exist_ok=True)
            except FileNotFoundError:
                raise
            except OSError as error:
                if isinstance(error, FileExistsError) and not os.path.lexists(new):
                    # it was there, and was gone when mkdir looked whether it is a folder
                    raise FileNotFoundError(new) from None
                with refused(new, "the folder cannot be made"):
                    raise

    def _discard(self) -> None:
        """Remove what was not renamed; after a success that is nothing."""
        with signals_put_off():
            for temporary in self._temporaries:
                temporary.discard()
            self._pool.shutdown(wait=True, cancel_futures=True)
            for temporary in self._temporaries:
                temporary.remove()
            self._temporaries.clear()
            self._pending.clear()
            for folder in reversed(self._made_folders):
                with contextlib.suppress(OSError):  # somebody else has put a file there
                    folder.rmdir()
            self._made_folders.clear()
            atexit.unregister(self._discard)


def _put_in_place(
    temporaries: Sequence[Temporary], removed: Sequence[Path], *, replaces: bool
) -> None:
    """Rename temporary files to their own names, in order, and remove other files."""
    # Old files are kept under second names until the end, so that a failure can be undone.
    paths = [*(one.destination for one in temporaries), *removed]
    folders = dict.fromkeys(path.parent for path in paths)
    kept: dict[Path, Path] = {}
    done: list[Path] = []
    with locked(folders), signals_put_off():
        existing = [path for path in paths if os.path.lexists(path)]
        if existing and not replaces:
            hint = "--force replaces it"
            raise FileAccessError("the output exists", source=existing[0], hint=hint)
        try:
            for path in existing if len(paths) > 1 else ():
                with refused(path, "cannot be replaced"):
                    kept[path] = keep_beside(path)
            for one in temporaries:
                with refused(one.destination, "cannot be replaced"):
                    one.rename()
                done.append(one.destination)
            for path in removed:
                with refused(path, "cannot be removed"):
                    path.unlink()
                done.append(path)
        except BaseException:
            _put_back(done, kept)
            raise
        else:
            for folder in folders:
                sync_folder(folder)
        finally:
            for path in kept.values():
                with contextlib.suppress(OSError):  # the next command that writes there tries again
                    path.unlink(missing_ok=True)


def _put_back(done: Sequence[Path], kept: dict[Path, Path]) -> None:
    """Undo changes, the last one first; an old file that cannot go back stays where it is kept."""
    problem: FileAccessError | None = None
    for path in reversed(done):
        old = kept.pop(path, None)
        try:
            if old is None:
                path.unlink()
            else:
                old.replace(path)
        except OSError as error:
            rule = f"cannot be put back as it was: {error.strerror}"
            hint = None if old is None else f"the old file is {old}"
            problem = FileAccessError(rule, source=path, hint=hint)
    for folder in dict.fromkeys(path.parent for path in done):
        sync_folder(folder)
    if problem is not None:
        raise problem


def make_folder(folder: Path) -> None:
    with refused(folder, "the folder cannot be made"):
        folder.mkdir(parents=True, exist_ok=True)


def _check_output(output: Path, inputs: Sequence[Path], hint: str | None) -> None:
    """Refuse an output that cannot be; one that exists only if there is a hint for that."""
    try:
        status = output.lstat()
    except (FileNotFoundError, NotADirectoryError):
        _check_parents(output)
        return
    except ValueError:
        raise FileAccessError("no file can have such a name", source=output) from None
    except OSError as error:
        rule = f"cannot be written: {error.strerror}"
        raise FileAccessError(rule, source=output) from None
    if _is_input(output, inputs):
        raise FileAccessError("the output is the input", source=output)
    with contextlib.suppress(OSError):  # a link that leads nowhere is there, too
        status = output.stat()
    if stat.S_ISDIR(status.st_mode):
        raise FileAccessError("the output is a directory", source=output)
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISLNK(status.st_mode)):
        rule = "the output is a pipe, a device or a socket, no regular file"
        raise FileAccessError(rule, source=output)
    if hint is not None:
        raise FileAccessError("the output exists", source=output, hint=hint)


def _is_input(path: Path, inputs: Sequence[Path]) -> bool:
    return any(is_same_file(path, one) for one in inputs)


def _check_parents(output: Path) -> None:
    for parent in output.parents:
        with contextlib.suppress(OSError):  # asked once: another process may be making it
            if stat.S_ISDIR(parent.stat().st_mode):
                return
            raise FileAccessError("is not a folder, outputs cannot go into it", source=parent)
