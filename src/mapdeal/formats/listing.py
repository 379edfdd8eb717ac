"""Files selected by names of files, folders and patterns."""

from __future__ import annotations

import fnmatch
import heapq
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from glob import has_magic
from pathlib import Path

from mapdeal.errors import FileAccessError, MapdealWarning, ParameterError, emit_warning
from mapdeal.formats.source import (
    contents_of,
    exists,
    identity_of,
    is_folder,
    status_of,
)

_ANY_FOLDERS = "**"

Contents = tuple[list[str], list[str]]
"""The names of the folders in a folder, and of its files."""


def list_files(
    names: Iterable[str], suffixes: Sequence[str], *, not_in_folders: Sequence[str] = ()
) -> list[Path]:
    """Return the files that names stand for."""
    return [path for name in names for path in _files_of(name, suffixes, not_in_folders)]


def _files_of(name: str, suffixes: Sequence[str], not_in_folders: Sequence[str]) -> list[Path]:
    if not name:
        raise ParameterError("the name of a file must not be empty")
    path = Path(name)
    if is_folder(path):
        suffixes = [suffix for suffix in suffixes if suffix not in not_in_folders]
        inside = [path / file for file in contents_of(path)[1]]
    elif has_magic(name) and not exists(path):
        inside = files_matching(name)
    else:
        status_of(path)  # which says why it is not there
        return [path]
    files = [one for one in inside if one.suffix.lower() in suffixes]
    if not files:
        endings = ", ".join(suffixes)
        if exists(path):
            rule = f"the folder holds no file that ends in {endings}"
            raise FileAccessError(rule, source=name)
        # a pattern is a word of the user's
        raise ParameterError(f"matches no file that ends in {endings}", source=name)
    return sorted_naturally(files)


def files_matching(pattern: str) -> list[Path]:
    """Return all but folders that a pattern stands for.

    Notes
    -----
    The files are those of ``glob.glob(pattern, recursive=True)``. But that follows each of the ways
    that links make to a folder, which can be 2 to the power of 40 with two links. Here each
    part of the pattern leads from some folders to others, and each folder is looked into once for
    each part, however many ways there are: the time is linear in the entries of all folders.
    """
    if pattern[-1] in (os.sep, os.altsep):  # folders alone
        return []
    path = Path(pattern)
    *parts, last = path.parts[1:] if path.anchor else path.parts
    folders = [Path(path.anchor)]
    for part in parts:
        folders = _shortest_ways(_one_part_on(folders, part))
    if last == _ANY_FOLDERS:
        return [one / name for one, files in folders_below(folders, _seen_in) for name in files]
    if has_magic(last):
        return [one / name for one in folders for name in _matching(_seen_in(one)[1], last)]
    named = (one / last for one in folders)
    return [one for one in named if os.path.lexists(one) and not is_folder(one)]


def _one_part_on(folders: Iterable[Path], part: str) -> Iterator[Path]:
    """Yield the folders that a part of a pattern leads to."""
    if part == _ANY_FOLDERS:
        for one, _ in folders_below(folders, _seen_in):
            yield one
    elif has_magic(part):
        for one in folders:
            yield from (one / name for name in _matching(_seen_in(one)[0], part))
    else:
        yield from (one / part for one in folders if is_folder(one / part))


def _matching(names: Iterable[str], part: str) -> Iterator[str]:
    for name in fnmatch.filter(names, part):
        if not name.startswith(".") or part.startswith("."):
            yield name


def _seen_in(folder: Path) -> Contents:
    """Return the names in a folder, none of one that cannot be read."""
    try:
        return contents_of(folder)
    except FileAccessError as error:
        emit_warning(MapdealWarning(f"{error}; left out"), stacklevel=2)
        return [], []


def _shortest_ways(folders: Iterable[Path]) -> list[Path]:
    """Return each real folder once."""
    nearest: dict[tuple[int, int] | None, Path] = {}
    for one in sorted(folders, key=lambda one: len(one.parts)):
        nearest.setdefault(identity_of(one), one)
    return list(nearest.values())


def folders_below(
    folders: Iterable[Path],
    look_into: Callable[[Path], Contents],
    *,
    leave_out: Callable[[Path], bool] = lambda _: False,
) -> Iterator[tuple[Path, list[str]]]:
    """Yield folders and all those below them, and the files in each."""
    seen: set[tuple[int, int] | None] = set()
    waiting = [(len(one.parts), k, one) for k, one in enumerate(folders)]
    heapq.heapify(waiting)
    count = len(waiting)
    while waiting:
        *_, folder = heapq.heappop(waiting)
        identity = identity_of(folder)
        if identity in seen or leave_out(folder):
            continue
        seen.add(identity)
        below, files = look_into(folder)
        yield folder, [name for name in files if not name.startswith(".")]
        for name in below:
            if not name.startswith("."):
                count += 1
                heapq.heappush(waiting, (len(folder.parts) + 1, count, folder / name))


def numbered_folders(folder: Path) -> list[Path]:
    """Return the folders in a folder, if there is one, whose names are numbers, in order."""
    if not is_folder(folder):
        return []
    numbered = [name for name in contents_of(folder)[0] if name.isdecimal()]
    return [folder / name for name in sorted(numbered, key=natural_key)]


def sorted_naturally(files: Iterable[Path]) -> list[Path]:
    """Return files in the order of their names, numbers by their value."""
    return sorted(files, key=lambda one: (natural_key(str(one.with_suffix(""))), one.suffix))


def natural_key(text: str) -> tuple[list[str | int], str]:
    """Return what to sort names by, so that their numbers are in order.

    Examples
    --------
    >>> sorted(["scan10.pcd", "scan9.pcd", "map.pcd"], key=natural_key)
    ['map.pcd', 'scan9.pcd', 'scan10.pcd']
    """
    parts = re.split(r"([0-9]+)", text)  # words and numbers take turns
    return [int(part) if k % 2 else part for k, part in enumerate(parts)], text
