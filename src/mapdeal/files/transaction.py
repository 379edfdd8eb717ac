"""Writing sets of output files: a failure removes them all, a kill leaves only complete files."""

from __future__ import annotations

import atexit
import contextlib
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
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from mapdeal import compatibility, records
from mapdeal.errors import FileAccessError, ParameterError, refuse_warnings
from mapdeal.files import json_values, source
from mapdeal.kernels import blocks, threads

try:
    import fcntl
except ImportError:  # not POSIX: temporary files of killed runs are then not cleaned up
    fcntl = None  # type: ignore[assignment]

PREFIX = ".mapdeal-"  # of the names of all temporary files
_NEW_SUFFIX, _OLD_SUFFIX = ".tmp", ".old"
# SIGINT comes first: once it is deferred, no exception interrupts deferring the others.
_ENDING_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
Writer = Callable[[BinaryIO], object]


class _File(io.BufferedRandom):
    """A file that a thread writes and another can stop."""

    is_discarded = False

    def write(self, data: Any) -> int:
        if self.is_discarded:
            raise FileAccessError("was discarded")
        return super().write(data)


class Temporary:
    """A locked temporary file beside its destination."""

    def __init__(self, destination: Path) -> None:
        self.destination = self.path = destination
        self._file: _File | None = None
        self._is_ours = False

    @property
    def file(self) -> io.BufferedRandom:
        if self._file is None:
            raise FileAccessError("was discarded", source=self.destination)
        return self._file

    def open(self) -> None:
        # Before the new file is locked, another run may take it for a leftover of a dead process
        # and remove it; then the loop creates another file.
        while True:
            self.path, self._is_ours = _name_beside(self.destination, _NEW_SUFFIX), True
            with source.access_to(self.destination, "written"):
                descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
            if fcntl is not None:
                # Some network file systems have no locks; then stale files are not removed.
                with contextlib.suppress(OSError):
                    fcntl.flock(descriptor, fcntl.LOCK_EX)
            if self.path.exists():
                break
            os.close(descriptor)
        self._file = _File(io.FileIO(descriptor, "r+b"))
        with contextlib.suppress(OSError):  # the permissions of the file that it replaces
            self.path.chmod(stat.S_IMODE(self.destination.stat().st_mode))

    def fill(self, writer: Writer, with_checksum: bool) -> str:
        file = self.file
        with blocks.activity(f"writing {self.destination.name}"):
            writer(file)
        file.flush()
        if not with_checksum:
            return ""
        file.seek(0)
        return compatibility.file_digest(file, "sha256").hexdigest()

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
        self._close_to_move()
        if self._is_ours:
            with contextlib.suppress(OSError):  # it is gone, or the next command removes it
                self.path.unlink()
            self._is_ours = False
        self._close()

    def _close_to_move(self) -> None:
        """Close the file on Windows, where open files cannot be renamed or removed."""
        # Elsewhere it stays open, and so locked, until it is renamed.
        if fcntl is None:
            self._close()

    def _close(self) -> None:
        if self._file is not None:
            with contextlib.suppress(OSError):  # a full disk has been reported before
                self._file.close()
            self._file = None


def _name_beside(path: Path, suffix: str) -> Path:
    return path.parent / f"{PREFIX}{os.urandom(6).hex()}{suffix}"


def back_up_beside(path: Path) -> Path:
    # A hard link, or a copy if there are no hard links or the file belongs to another user.
    backup = _name_beside(path, _OLD_SUFFIX)
    try:
        os.link(path, backup, follow_symlinks=False)
    except (OSError, NotImplementedError):
        try:
            shutil.copy2(path, backup, follow_symlinks=False)
        except BaseException:
            backup.unlink(missing_ok=True)
            raise
    return backup


def remove_stale(folder: Path) -> None:
    """Remove leftovers of killed processes: unlocked temporary files, and backups."""
    # Backups exist only while their folder is locked.
    with locked([folder]) as is_alone:
        for path in folder.glob(f"{PREFIX}*"):
            with contextlib.suppress(OSError):
                if path.suffix == _OLD_SUFFIX and is_alone:
                    path.unlink()
                elif path.suffix == _NEW_SUFFIX and fcntl is not None:
                    with path.open("r+b") as file:
                        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
                        path.unlink()


@contextmanager
def locked(folders: Iterable[Path]) -> Iterator[bool]:
    # The locks end with their process. Yields whether all folders are locked: some network file
    # systems have no locks, and then the last rename of each file wins.
    with contextlib.ExitStack() as stack:
        are_locked = fcntl is not None
        for folder in sorted({folder.resolve() for folder in folders}):  # all in the same order
            if fcntl is not None:
                try:
                    descriptor = os.open(folder, os.O_RDONLY)
                    stack.callback(os.close, descriptor)
                    fcntl.flock(descriptor, fcntl.LOCK_EX)
                except OSError:
                    are_locked = False
        yield are_locked


@contextmanager
def signals_deferred() -> Iterator[None]:
    # Python handles signals in the main thread only: in other threads there is nothing to delay.
    # The effect of a signal, an exception or the end of the process, follows the block.
    if threading.get_ident() != threading.main_thread().ident:
        yield
        return
    handlers: dict[int, Any] = {}
    received: list[int] = []
    try:
        for number in (getattr(signal, name, None) for name in _ENDING_SIGNALS):
            handler = None if number is None else signal.getsignal(number)
            if number is None or handler in (None, signal.SIG_IGN):  # None: not set by Python
                continue
            handlers[number] = handler
            signal.signal(number, lambda received_number, _: received.append(received_number))
        yield
    finally:
        for number, handler in reversed(handlers.items()):
            signal.signal(number, handler)
        for number in dict.fromkeys(received):
            signal.raise_signal(number)


def sync_folder(folder: Path) -> None:
    # A file system without fsync for folders makes renames durable by its own rules.
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def folder_for_sockets() -> Path:
    import tempfile  # few commands need it

    return Path(tempfile.gettempdir())


def lasting_folder() -> Path:
    """Return a new private folder for temporary files, which is not removed at the end."""
    import tempfile

    try:
        return Path(tempfile.mkdtemp(prefix="mapdeal-"))
    except OSError as error:
        rule = f"no temporary folder can be made: {error.strerror or error}"
        raise FileAccessError(rule, hint="set TMPDIR to a writable folder") from None


@contextmanager
def temporary_folder() -> Iterator[Path]:
    with signals_deferred():
        folder = lasting_folder()
        remove = partial(shutil.rmtree, folder, ignore_errors=True)
        atexit.register(remove)
    try:
        yield folder
    finally:
        with signals_deferred():
            remove()
            atexit.unregister(remove)


_ATTEMPTS = 10_000
PutRows = Callable[[slice], object]
OpenOutput = tuple[Path, BinaryIO, Writer]  # its path, temporary file, and writer of its contents


@records.dataclass(frozen=True, eq=False)
class RowsWriter:
    """A writer that accepts rows in any order, so that one pass can serve several files."""

    layer: blocks.Layer
    begin: Callable[[BinaryIO], tuple[PutRows, Callable[[], object]]]

    def __call__(self, file: BinaryIO) -> None:
        write_rows, finish = self.begin(file)
        for rows in blocks.swept(self.layer):
            write_rows(rows)
        finish()


class Transaction:
    """A set of output files that appear together at the end."""

    # Each file is written under a temporary name in its own folder, as many at the same time as
    # `mapdeal.kernels.threads` allows. When the block ends without an error, all are renamed in the
    # order of the calls to `write`: the folders are locked meanwhile, signals wait, and a rename
    # that fails undoes those before it. Live processes lock their temporary files, so that
    # leftovers of killed ones can be recognised and removed.
    def __init__(
        self, outputs: Iterable[Path], *, inputs: Sequence[Path] = (), force: bool = False,
        hint: str = "--force replaces it", checksums: bool = False,
    ) -> None:  # fmt: skip
        self._outputs, self._inputs = list(outputs), tuple(inputs)
        self._replaces, self._with_checksums = force, checksums
        self._removed: list[Path] = []
        # with one thread allowed, this thread writes, too
        self._pool = threads.ThreadPool(threads.thread_count() if threads.thread_count() > 1 else 0)
        self._temporaries: list[Temporary] = []
        self._pending: list[tuple[Temporary, Future[str]]] = []
        self._together: list[tuple[Temporary, Writer]] | None = None
        self._created_folders: list[Path] = []
        places: set[Path] = set()
        for output in self._outputs:
            _check_output(output, inputs, None if force else hint)
            if (place := source.real_path(output.parent) / output.name) in places:
                raise ParameterError("is the place of two outputs", source=output)
            places.add(place)

    def __enter__(self) -> Transaction:
        atexit.register(self._discard)  # a signal may keep `__exit__` from being called
        try:
            for folder in dict.fromkeys(output.parent for output in self._outputs):
                self._prepare(folder)
        except BaseException:
            self._discard()
            raise
        return self

    def write(self, path: Path, writer: Writer) -> None:
        temporary = self._open_output(path)
        if self._together is not None:
            self._together.append((temporary, writer))
        else:
            self._finish(temporary, writer)

    @contextmanager
    def together(self, write_all: Callable[[Sequence[OpenOutput]], None]) -> Iterator[None]:
        self._together = []
        try:
            yield
            started = self._together
        finally:
            self._together = None
        files = [(temporary.destination, temporary.file, writer) for temporary, writer in started]
        writing = self._pool.submit(copy_context().run, write_all, files)
        for temporary, _ in started:
            self._finish(temporary, lambda _: writing.result())

    def write_parts(self, path: Path, parts: Iterable[bytes]) -> None:
        temporary = self._open_output(path)
        for part in parts:
            with source.access_to(path, "written"):
                temporary.file.write(part)
        self._finish(temporary, lambda _: None)

    def _open_output(self, path: Path) -> Temporary:
        if path not in self._outputs:
            raise ParameterError("was not announced as an output", source=path)
        temporary = Temporary(path)
        self._temporaries.append(temporary)  # first, since Ctrl-C may come at any moment
        temporary.open()
        return temporary

    def _finish(self, temporary: Temporary, writer: Writer) -> None:
        future = self._pool.submit(copy_context().run, temporary.fill, writer, self._with_checksums)
        self._pending.append((temporary, future))

    def write_bytes(self, path: Path, data: bytes) -> None:
        self.write(path, lambda file: file.write(data))

    def write_json(self, path: Path, document: Any) -> None:
        self.write_bytes(path, json_values.encode_json(document))

    def wait(self) -> dict[Path, str]:
        """Wait until all files so far are written; return their sha256, if it is wanted."""
        sums = {}
        for temporary, future in self._pending:
            with source.access_to(temporary.destination, "written"):
                sums[temporary.destination] = future.result()
        return sums

    def remove_if_unchanged(self, path: Path, sha256: str) -> None:
        """Mark a file for removal at the end if its sha256 is given and it is no input."""
        if not _is_input(path, self._inputs) and source.holds(path, sha256):
            self._removed.append(path)

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        try:
            if error is None:
                self.wait()
                refuse_warnings()
                temporaries = [temporary for temporary, _ in self._pending]
                # all at once after the last write: the first fsync flushes most of the data
                syncs = [self._pool.submit(temporary.sync) for temporary in temporaries]
                for temporary, future in zip(temporaries, syncs, strict=True):
                    with source.access_to(temporary.destination, "written"):
                        future.result()
                _rename_all(temporaries, self._removed, replaces=self._replaces)
                self._created_folders.clear()
        finally:
            self._discard()

    def _prepare(self, folder: Path) -> None:
        """Create an output folder, and remove leftovers of killed runs from it."""
        # Another process may remove the folder between the steps, if it created it and failed.
        for _ in range(_ATTEMPTS):
            with contextlib.suppress(FileNotFoundError):
                self._create_folder(folder)
                remove_stale(folder)
                return
        raise FileAccessError("the folder is removed again and again", source=folder)

    def _create_folder(self, folder: Path) -> None:
        missing = []
        while not folder.exists():
            missing.append(folder)
            folder = folder.parent
        for new in reversed(missing):
            self._created_folders.append(new)
            try:
                new.mkdir(exist_ok=True)
            except FileNotFoundError:
                raise
            except OSError as error:
                if isinstance(error, FileExistsError) and not os.path.lexists(new):
                    # another process removed it before mkdir checked that it is a folder
                    raise FileNotFoundError(new) from None
                with source.access_to(new, "made"):
                    raise

    def _discard(self) -> None:
        """Remove the files that were not renamed, which exist only after a failure."""
        with signals_deferred():
            for temporary in self._temporaries:
                temporary.discard()
            self._pool.shutdown(wait=True, cancel_futures=True)
            for temporary in self._temporaries:
                temporary.remove()
            self._temporaries.clear()
            self._pending.clear()
            for folder in reversed(self._created_folders):
                with contextlib.suppress(OSError):  # another process has put a file there
                    folder.rmdir()
            self._created_folders.clear()
            atexit.unregister(self._discard)


def _rename_all(temporaries: list[Temporary], removed: list[Path], *, replaces: bool) -> None:
    # Backups of old files exist until the end, so that a failure can be undone.
    paths = [*(temporary.destination for temporary in temporaries), *removed]
    folders = dict.fromkeys(path.parent for path in paths)
    backups: dict[Path, Path] = {}
    changed: list[Path] = []
    with locked(folders), signals_deferred():
        existing = [path for path in paths if os.path.lexists(path)]
        if existing and not replaces:
            hint = "--force replaces it"
            raise FileAccessError("the output exists", source=existing[0], hint=hint)
        try:
            for path in existing if len(paths) > 1 else ():
                with source.access_to(path, "replaced"):
                    backups[path] = back_up_beside(path)
            for temporary in temporaries:
                with source.access_to(temporary.destination, "replaced"):
                    temporary.rename()
                changed.append(temporary.destination)
            for path in removed:
                with source.access_to(path, "removed"):
                    path.unlink()
                changed.append(path)
        except BaseException:
            _roll_back(changed, backups)
            raise
        else:
            for folder in folders:
                sync_folder(folder)
        finally:
            for path in backups.values():
                with contextlib.suppress(OSError):  # the next command that writes there tries again
                    path.unlink(missing_ok=True)


def _roll_back(changed: Sequence[Path], backups: dict[Path, Path]) -> None:
    """Undo changes, the last one first; a backup that cannot be restored is not removed."""
    problem: FileAccessError | None = None
    for path in reversed(changed):
        backup = backups.pop(path, None)
        try:
            if backup is None:
                path.unlink()
            else:
                backup.replace(path)
        except OSError as error:
            rule = f"cannot be restored: {error.strerror}"
            hint = None if backup is None else f"its backup is {backup}"
            problem = FileAccessError(rule, source=path, hint=hint)
    for folder in dict.fromkeys(path.parent for path in changed):
        sync_folder(folder)
    if problem is not None:
        raise problem


def make_folder(folder: Path) -> None:
    with source.access_to(folder, "made"):
        folder.mkdir(parents=True, exist_ok=True)


def _check_output(output: Path, inputs: Sequence[Path], hint: str | None) -> None:
    """Refuse an impossible output; with a hint, also an output that exists."""
    try:
        status = output.lstat()
    except (FileNotFoundError, NotADirectoryError):
        _check_parents(output)
        return
    except ValueError:
        raise FileAccessError("no file can have such a name", source=output) from None
    except OSError as error:
        raise FileAccessError(f"cannot be written: {error.strerror}", source=output) from None
    if _is_input(output, inputs):
        raise FileAccessError("the output is the input", source=output)
    with contextlib.suppress(OSError):  # a broken link exists, too
        status = output.stat()
    if stat.S_ISDIR(status.st_mode):
        raise FileAccessError("the output is a directory", source=output)
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISLNK(status.st_mode)):
        rule = "the output is a pipe, a device or a socket, not a regular file"
        raise FileAccessError(rule, source=output)
    if hint is not None:
        raise FileAccessError("the output exists", source=output, hint=hint)


def _is_input(path: Path, inputs: Sequence[Path]) -> bool:
    return any(source.is_same_file(path, input_path) for input_path in inputs)


def _check_parents(output: Path) -> None:
    for parent in output.parents:
        with contextlib.suppress(OSError):  # one call only: another process may be creating it
            if stat.S_ISDIR(parent.stat().st_mode):
                return
            raise FileAccessError("is not a folder", source=parent)
