"""Giving a set of files their names: all of them or none, whatever happens meanwhile.

Old files are kept aside under second names until the last new one is in place, and a journal in
each folder says beforehand what is going to be done there. A failure is undone at once. What a
killed process has left is undone by the next command that reads or writes in the folder, as data
bases do it with theirs.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import stat
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from mapdeal.errors import FileAccessError
from mapdeal.formats.file_state import FileState
from mapdeal.formats.signals import signals_put_off
from mapdeal.formats.temporary import PREFIX, Temporary, locked, sync_folder
from mapdeal.records import dataclass

JOURNAL = f"{PREFIX}journal"
_FORMAT = "mapdeal-journal/1"
_ASIDE = re.compile(r"\.mapdeal-[0-9a-f]{12}\.old")
_LARGEST_JOURNAL = 1 << 24


@dataclass(frozen=True)
class _Change:
    """Change to one name in a folder."""

    folder: Path
    name: str
    new: FileState | None
    aside: str | None

    @property
    def path(self) -> Path:
        return self.folder / self.name

    def keep_aside(self) -> None:
        """Link the old file to its second name, unless the file system has no links.

        Nor if nobody but its owner could take that name away again.
        """
        if self.aside is None:
            return
        with contextlib.suppress(OSError, NotImplementedError):  # it is renamed, later
            if _is_ours_to_remove(self.path):
                os.link(self.path, self.folder / self.aside, follow_symlinks=False)

    def make(self, source: Path | None) -> None:
        """Replace the file of this name by `source`, or remove it."""
        doing = "removed" if source is None else "replaced"
        try:
            if self.aside is not None and not os.path.lexists(self.folder / self.aside):
                self.path.rename(self.folder / self.aside)
            elif source is None:
                self.path.unlink()
            if source is not None:
                source.replace(self.path)
        except OSError as error:
            rule = f"cannot be {doing}: {error.strerror}"
            raise FileAccessError(rule, source=self.path) from None

    def undo(self) -> None:
        """Restore the old file under the name, unless somebody else has changed it since."""
        now = _what_stands_at(self.path)
        is_ours = now is None or now == self.new
        if self.aside is None:
            if now is not None and is_ours:
                self.path.unlink()
        elif os.path.lexists(self.folder / self.aside):
            if is_ours:
                (self.folder / self.aside).replace(self.path)
            else:  # nothing had been done yet, or somebody has gone on from there
                with contextlib.suppress(OSError):  # nobody misses it
                    (self.folder / self.aside).unlink()


def put_in_place(
    temporaries: Sequence[Temporary], *, removed: Iterable[Path] = (), replaces: bool = True
) -> None:
    """Rename temporary files to their own names, in order, and remove other files."""
    sources: dict[Path, Path | None] = {one.destination: one.path for one in temporaries}
    sources.update(dict.fromkeys(removed))
    folders = list(dict.fromkeys(path.parent for path in sources))
    while True:
        for folder in folders:
            settle(folder)
        with locked(folders) as is_alone, signals_put_off():
            if is_alone and any(os.path.lexists(folder / JOURNAL) for folder in folders):
                continue  # another process was killed just now
            for one in temporaries:
                one.close_to_move()
            _change_all(sources, folders, replaces=replaces, with_journal=is_alone)
            for one in temporaries:
                one.is_placed()
            return


def settle(folder: Path, name: str | None = None) -> None:
    """Undo what a killed process has done in a folder; wait for the end of what a live one does.

    To be called before anything in the folder is read or written. Where the disk has no locks,
    nobody can tell the two apart, and nothing is done.
    """
    if not os.path.lexists(folder / JOURNAL):
        return
    try:
        _settle(folder)
    except FileAccessError:
        journal = _read_journal(folder)
        if name is None or journal is None or name in {one.name for one in journal.changes}:
            raise


def _settle(folder: Path) -> None:
    folders = {folder}
    while True:
        with locked(folders) as is_alone, signals_put_off():
            journals = {one: _read_journal(one) for one in folders} if is_alone else {}
            own = journals.get(folder)
            if own is None:
                return
            others = {folder / other for other in own.folders}
            if others <= folders:
                # Journals are written before the first change and go after the last: if one is
                # missing, either nothing was done or everything.
                is_open = all(one is not None and one.key == own.key for one in journals.values())
                mine = {one: known for one, known in journals.items() if known == own or is_open}
                changes = [c for known in mine.values() if known for c in known.changes]
                if is_open:
                    _undo(changes)
                _forget(changes, mine)
                return
        folders |= others


def remove_kept(folder: Path) -> None:
    """Remove old files that were kept aside by processes that were killed at their very end."""
    if not any(_ASIDE.fullmatch(path.name) for path in _inside(folder)):
        return
    settle(folder)
    with locked([folder]) as is_alone:
        if not is_alone or os.path.lexists(folder / JOURNAL):
            return
        for path in _inside(folder):
            if _ASIDE.fullmatch(path.name):
                with contextlib.suppress(OSError):
                    path.unlink()


def _change_all(
    sources: dict[Path, Path | None], folders: list[Path], *, replaces: bool, with_journal: bool
) -> None:
    """Do it, alone in the folders."""
    existing = {path for path in sources if os.path.lexists(path)}
    for path in existing if not replaces else ():
        raise FileAccessError("the output exists", source=path, hint="--force replaces it")
    keeps = bool(existing) and len(sources) > 1  # one name changes at once, and new ones mix not
    try:
        changes = [
            _Change(
                path.parent, path.name, None if source is None else _what_stands_at(source),
                f"{PREFIX}{os.urandom(6).hex()}.old" if keeps and path in existing else None,
            )
            for path, source in sources.items()
        ]  # fmt: skip
    except OSError as error:  # a folder was closed, or has gone, meanwhile
        rule = f"cannot be written: {error.strerror}"
        raise FileAccessError(rule, source=folders[0]) from None
    journals = folders if keeps and with_journal else []
    try:
        _write_journals(changes, journals)
        for change in changes:
            change.keep_aside()
        for change in changes:
            change.make(sources[change.path])
        for folder in folders:
            sync_folder(folder)
        _forget(changes, journals)
    except BaseException:
        _undo(changes)
        _forget(changes, journals)
        raise


def _undo(changes: Sequence[_Change]) -> None:
    """Undo changes, the last one first."""
    problem: FileAccessError | None = None
    for change in reversed(changes):
        try:
            change.undo()
        except OSError as error:
            rule = f"cannot be put back as it was: {error.strerror}"
            hint = f"the old file is {change.folder / change.aside}" if change.aside else None
            problem = FileAccessError(rule, source=change.path, hint=hint)
    for folder in dict.fromkeys(change.folder for change in changes):
        sync_folder(folder)
    if problem is not None:
        raise problem


def _forget(changes: Sequence[_Change], folders: Iterable[Path]) -> None:
    """Remove journals, and then the old files: from the first one on all is there for good."""
    for folder in folders:
        try:
            (folder / JOURNAL).unlink(missing_ok=True)
        except OSError as error:
            rule = f"cannot be removed: {error.strerror}"
            raise FileAccessError(rule, source=folder / JOURNAL) from None
    for change in changes:
        if change.aside is not None:
            with contextlib.suppress(OSError):  # the next command that writes there tries again
                (change.folder / change.aside).unlink(missing_ok=True)


@dataclass(frozen=True)
class _Journal:
    """What a journal in a folder says: whose it is, where its others are, what is done here."""

    key: str
    folders: tuple[str, ...]
    changes: tuple[_Change, ...]


def _write_journals(changes: Sequence[_Change], folders: Sequence[Path]) -> None:
    """Write down in each folder what is going to be done there."""
    key = os.urandom(12).hex()
    for folder in folders:
        entries = [[c.name, c.new, c.aside] for c in changes if c.folder == folder]
        # relative, as the folders may be mounted elsewhere
        others = [os.path.relpath(os.path.realpath(one), os.path.realpath(folder))
                  for one in folders]  # fmt: skip
        document = {"format": _FORMAT, "key": key, "folders": others, "files": entries}
        _write_down(folder / JOURNAL, json.dumps(document).encode())
    for folder in folders:
        sync_folder(folder)


def _write_down(path: Path, data: bytes) -> None:
    def write(file: Any) -> None:
        file.write(data)

    journal = Temporary(path)
    try:
        journal.open()
        journal.fill(write, False)
        journal.sync()
        journal.rename()
    except OSError as error:
        raise FileAccessError(f"cannot be written: {error.strerror}", source=path) from None
    finally:
        journal.remove()


def _read_journal(folder: Path) -> _Journal | None:
    """Return what the journal in a folder says, None if there is none.

    It comes with the folder, from wherever that comes. So it has power over plain names beside
    itself, and over nothing else.
    """
    path = folder / JOURNAL
    try:
        with path.open("rb") as file:
            document = json.loads(file.read(_LARGEST_JOURNAL))
        if document["format"] != _FORMAT:
            raise ValueError
        changes = tuple(_change_of(folder, *entry) for entry in document["files"])
        return _Journal(str(document["key"]), tuple(map(str, document["folders"])), changes)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise FileAccessError(f"cannot be read: {error.strerror}", source=path) from None
    except (ValueError, TypeError, KeyError, RecursionError):
        rule, hint = "is not the journal of a killed command", "remove it"
        raise FileAccessError(rule, source=path, hint=hint) from None


def _change_of(folder: Path, name: object, new: object, aside: object) -> _Change:
    if not isinstance(name, str) or name != Path(name).name or name in ("", ".."):
        raise ValueError
    if aside is not None and not (isinstance(aside, str) and _ASIDE.fullmatch(aside)):
        raise ValueError
    state = None if new is None else FileState(*map(int, new))  # type: ignore[call-overload]
    return _Change(folder, name, state, aside)


def _what_stands_at(path: Path) -> FileState | None:
    """Return the state of the file of a name, which may be a link, and None if there is none."""
    try:
        return FileState.of_status(path.lstat())
    except (FileNotFoundError, NotADirectoryError):
        return None


def _is_ours_to_remove(path: Path) -> bool:
    """Return whether a sticky folder, if it is one, lets us remove and rename a file in it."""
    folder = path.parent.stat()
    if not folder.st_mode & stat.S_ISVTX or not hasattr(os, "geteuid"):
        return True
    return os.geteuid() in (folder.st_uid, path.lstat().st_uid)


def _inside(folder: Path) -> Iterator[Path]:
    with contextlib.suppress(OSError):
        yield from folder.glob(f"{PREFIX}*")
