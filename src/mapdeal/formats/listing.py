"""Which files are meant by names of files, folders and patterns."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from glob import glob, has_magic
from pathlib import Path

from mapdeal.errors import FileAccessError, ParameterError
from mapdeal.formats.source import exists


def list_files(
    names: Iterable[str], suffixes: Sequence[str], *, not_in_folders: Sequence[str] = ()
) -> list[Path]:
    """Return the files that names stand for.

    Parameters
    ----------
    names : iterable of str
        Each a file; a folder, for all files directly in it that end in one of the suffixes; or
        a pattern of ``*``, ``?``, ``[...]``, and ``**`` for folders below, for all such files
        that match it.
    suffixes : sequence of str
        Endings, in small letters.
    not_in_folders : sequence of str
        Those of them that a folder's name alone does not stand for.

    Returns
    -------
    list of Path
        In the order of the names; those of a folder or pattern sorted, numbers by their value,
        so that ``9.pcd`` comes before ``10.pcd``.

    Raises
    ------
    ParameterError
        If a name is empty, or a pattern matches none.
    FileAccessError
        If there is nothing of a name, a folder holds none, or a folder cannot be read.
    """
    return [path for name in names for path in _files_of(name, suffixes, not_in_folders)]


def _files_of(name: str, suffixes: Sequence[str], not_in_folders: Sequence[str]) -> list[Path]:
    if not name:
        raise ParameterError("the name of a file must not be empty")
    path = Path(name)
    is_there = exists(path)
    if is_there and path.is_dir():
        suffixes = [suffix for suffix in suffixes if suffix not in not_in_folders]
        try:
            inside = list(path.iterdir())
        except OSError as error:
            rule = f"cannot be read: {error.strerror or error}"
            raise FileAccessError(rule, source=path) from None
        rule = f"the folder holds no file that ends in {', '.join(suffixes)}"
    elif has_magic(name) and not is_there:
        inside = [Path(match) for match in glob(name, recursive=True)]  # noqa: PTH207 - of any root
        rule = f"matches no file that ends in {', '.join(suffixes)}"
    else:
        if not is_there:
            raise FileAccessError("cannot be read: no such file or folder", source=name)
        return [path]
    files = [one for one in inside if one.suffix.lower() in suffixes and one.is_file()]
    if not files:
        if is_there:
            raise FileAccessError(rule, source=name)
        raise ParameterError(rule, source=name)  # a pattern is a word of the user's
    # a link to a folder above leads to each file again and again: the shortest way counts
    nearest: dict[tuple[Path, str], Path] = {}
    for one in sorted(files, key=lambda one: len(one.parts)):
        nearest.setdefault((one.parent.resolve(), one.name), one)
    return sorted_naturally(nearest.values())


def numbered_folders(folder: Path) -> list[Path]:
    """Return the folders in a folder, if there is one, whose names are numbers, in order."""
    if not folder.is_dir():
        return []
    numbered = [one for one in folder.iterdir() if one.name.isdecimal() and one.is_dir()]
    return sorted(numbered, key=lambda one: natural_key(one.name))


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
