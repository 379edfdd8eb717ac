"""Writing a set of output files so that a failure leaves nothing and a kill nothing torn."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import copy_context
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from mapdeal.errors import FileAccessError, ParameterError
from mapdeal.formats.source import holds
from mapdeal.kernels.threads import thread_count

try:
    import fcntl
except ImportError:  # not POSIX: temporary files of killed runs are then not cleaned up
    fcntl = None  # type: ignore[assignment]

_PREFIX = ".mapdeal-"
_SUFFIX = ".tmp"
_ATTEMPTS = 100

Writer = Callable[[BinaryIO], None]


class Transaction:
    """A set of output files that appear together, at the end.

    Parameters
    ----------
    outputs : iterable of Path
        All files that may be written. They are checked before any work is done.
    inputs : sequence of Path
        Files that no output may be, by whatever name or link.
    force : bool
        Whether existing outputs are replaced.
    hint : str
        What an error says of an output that exists.
    checksums : bool
        Whether `checksums` will be asked for: each file is read again for that.

    Raises
    ------
    FileAccessError
        If an output exists and `force` is not set, cannot be written, or is an input.

    Notes
    -----
    Each file is written under a temporary name in its own folder and renamed when the block
    ends without an error, in the order of the calls to `write`; as many at the same time as
    `mapdeal.kernels.threads` allows. The folders are locked meanwhile, so that the files of two
    processes do not mix. Temporary files are locked by their process, so that those
    of a killed run are told from those of a live one and removed.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> with Transaction([folder / "new" / "a.txt"]) as transaction:
    ...     transaction.write(folder / "new" / "a.txt", lambda file: file.write(b"hello"))
    >>> (folder / "new" / "a.txt").read_text()
    'hello'
    """

    def __init__(
        self,
        outputs: Iterable[Path],
        *,
        inputs: Sequence[Path] = (),
        force: bool = False,
        hint: str = "--force replaces it",
        checksums: bool = False,
    ) -> None:
        self._outputs = list(outputs)
        self._with_checksums = checksums
        self._pool = ThreadPoolExecutor(thread_count())
        self._temporaries: list[_Temporary] = []
        self._pending: list[tuple[Path, _Temporary, Future[str]]] = []
        self._made_folders: list[Path] = []
        places: set[Path] = set()
        for output in self._outputs:
            _check_output(output, inputs, None if force else hint)
            place = output.parent.resolve() / output.name
            if place in places:
                raise ParameterError("is the place of two outputs", source=output)
            places.add(place)

    def __enter__(self) -> Transaction:
        folders = dict.fromkeys(output.parent for output in self._outputs)
        try:
            for folder in folders:
                self._prepare(folder)
        except BaseException:
            self._discard()
            raise
        return self

    def write(self, path: Path, writer: Writer) -> None:
        """Have `writer` write the file that becomes `path`, in a thread."""
        self._finish(self._opened(path), writer)

    def fill_in_place(self, path: Path, filler: Callable[[Path], None]) -> None:
        """Have `filler` write the file that becomes `path`, in this thread, given its name now.

        It may be opened under that name by any number of processes at the same time.
        """
        temporary = self._opened(path)
        filler(temporary.path)
        self._finish(temporary, lambda _: None)

    def _opened(self, path: Path) -> _Temporary:
        if path not in self._outputs:
            raise ParameterError("was not announced as an output", source=path)
        temporary = _Temporary(path)
        self._temporaries.append(temporary)  # first, since Ctrl-C may come at any moment
        temporary.open()
        return temporary

    def _finish(self, temporary: _Temporary, writer: Writer) -> None:
        future = self._pool.submit(
            copy_context().run, temporary.fill, writer, self._with_checksums
        )  # fmt: skip
        self._pending.append((temporary.destination, temporary, future))

    def write_bytes(self, path: Path, data: bytes) -> None:
        """Have a file with these contents become `path`."""

        def write(file: BinaryIO) -> None:
            file.write(data)

        self.write(path, write)

    def checksums(self) -> dict[Path, str]:
        """Return the sha256 of each file so far, waiting for those that are being written."""
        if not self._with_checksums:
            raise ValueError("the transaction was begun without checksums")
        return self._finished()

    def _finished(self) -> dict[Path, str]:
        return {path: _result(future, path) for path, _, future in self._pending}

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            if error is None:
                self._finished()
                folders = dict.fromkeys(path.parent for path, _, _ in self._pending)
                with _locked(folders):
                    for _, temporary, _ in self._pending:
                        temporary.rename()
                for folder in folders:
                    _sync_folder(folder)
                self._made_folders.clear()
        finally:
            self._discard()

    def _prepare(self, folder: Path) -> None:
        """Make a folder that files can be written into, and remove what killed runs left there.

        Another process that fails takes the folders away again which it has made.
        """
        for _ in range(_ATTEMPTS):
            with contextlib.suppress(FileNotFoundError):
                self._make(folder)
                _remove_stale(folder)
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
                rule = f"the folder cannot be made: {error.strerror}"
                raise FileAccessError(rule, source=new) from None

    def _discard(self) -> None:
        """Remove what was not renamed; after a success that is nothing."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        for temporary in self._temporaries:
            temporary.remove()
        self._temporaries.clear()
        self._pending.clear()
        for folder in reversed(self._made_folders):
            with contextlib.suppress(OSError):  # somebody else has put a file there
                folder.rmdir()
        self._made_folders.clear()


def remove_if_unchanged(path: Path, sha256: str) -> None:
    """Remove a file of which only the checksum is known, unless somebody has changed it.

    Raises
    ------
    FileAccessError
        If it cannot be read or removed.
    """
    if not holds(path, sha256):
        return
    try:
        path.unlink()
    except OSError as error:
        raise FileAccessError(f"cannot be removed: {error.strerror}", source=path) from None


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, unless it is there.

    Raises
    ------
    FileAccessError
        If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        rule = f"the folder cannot be made: {error.strerror}"
        raise FileAccessError(rule, source=folder) from None


class _Temporary:
    """A locked temporary file beside its destination."""

    def __init__(self, destination: Path) -> None:
        self.destination = destination
        self.path = destination
        self._file: io.BufferedRandom | None = None
        self._is_ours = False

    def open(self) -> None:
        """Make the file, and lock it.

        Between its making and its locking another run may take it for one of a dead process and
        remove it; then there is no file of that name any more, and another is made.
        """
        while True:
            name = f"{_PREFIX}{os.urandom(6).hex()}{_SUFFIX}"
            self.path, self._is_ours = self.destination.parent / name, True
            descriptor = _locked_new_file(self.path, self.destination)
            if self.path.exists():
                break
            os.close(descriptor)
        self._file = os.fdopen(descriptor, "w+b")
        with contextlib.suppress(FileNotFoundError):  # a replaced file keeps its permissions
            self.path.chmod(stat.S_IMODE(self.destination.stat().st_mode))

    def fill(self, writer: Writer, with_checksum: bool) -> str:
        """Write the contents through to the disk; return their sha256 if it is asked for."""
        file = self._file
        if file is None:
            raise FileAccessError("was discarded", source=self.destination)
        writer(file)
        file.flush()
        os.fsync(file.fileno())
        if not with_checksum:
            return ""
        file.seek(0)
        return hashlib.file_digest(file, "sha256").hexdigest()

    def rename(self) -> None:
        try:
            self.path.replace(self.destination)
        except OSError as error:
            rule = f"cannot be replaced: {error.strerror}"
            raise FileAccessError(rule, source=self.destination) from None
        self._is_ours = False
        self._close()

    def remove(self) -> None:
        if self._is_ours:
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                self.path.unlink()
            self._is_ours = False
        self._close()

    def _close(self) -> None:
        if self._file is not None:
            with contextlib.suppress(OSError):  # a full disk says so once more
                self._file.close()
            self._file = None


def _locked_new_file(path: Path, destination: Path) -> int:
    """Make a file and lock it; return its descriptor."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    except OSError as error:
        rule = f"cannot be written: {error.strerror}"
        raise FileAccessError(rule, source=destination) from None
    if fcntl is not None:
        # Some network file systems have no locks; then stale files stay, no more.
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
    return descriptor


def _result(future: Future[str], path: Path) -> str:
    try:
        return future.result()
    except OSError as error:
        rule = f"cannot be written: {error.strerror or error}"
        raise FileAccessError(rule, source=path) from None


def _check_output(output: Path, inputs: Sequence[Path], hint: str | None) -> None:
    """Refuse an output that cannot be; one that exists only if there is a hint for that."""
    try:
        status = output.stat()
    except (FileNotFoundError, NotADirectoryError):
        _check_parents(output)
        return
    except ValueError:
        raise FileAccessError("no file can have such a name", source=output) from None
    except OSError as error:
        rule = f"cannot be written: {error.strerror}"
        raise FileAccessError(rule, source=output) from None
    for path in inputs:
        with contextlib.suppress(OSError):
            if os.path.samestat(status, path.stat()):
                raise FileAccessError("the output is the input", source=output)
    if stat.S_ISDIR(status.st_mode):
        raise FileAccessError("the output is a directory", source=output)
    if hint is not None:
        raise FileAccessError("the output exists", source=output, hint=hint)


def _check_parents(output: Path) -> None:
    for parent in output.parents:
        with contextlib.suppress(OSError):  # asked once: another process may be making it
            if stat.S_ISDIR(parent.stat().st_mode):
                return
            raise FileAccessError("is not a folder, outputs cannot go into it", source=parent)


def _remove_stale(folder: Path) -> None:
    """Remove temporary files whose process is gone: those that nobody holds locked."""
    if fcntl is None:
        return
    for path in folder.glob(f"{_PREFIX}*{_SUFFIX}"):
        with contextlib.suppress(OSError), path.open("r+b") as file:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink()


@contextmanager
def _locked(folders: Iterable[Path]) -> Iterator[None]:
    """Keep other transactions from renaming files in folders: sets must not mix.

    The locks die with their process. Where there are none, the last rename of each file wins.
    """
    with contextlib.ExitStack() as stack:
        for folder in sorted(folder.resolve() for folder in folders):  # all in the same order
            if fcntl is not None:
                with contextlib.suppress(OSError):
                    descriptor = os.open(folder, os.O_RDONLY)
                    stack.callback(os.close, descriptor)
                    fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield


def _sync_folder(folder: Path) -> None:
    # A file system that cannot sync a folder makes renames durable by its own rules.
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
