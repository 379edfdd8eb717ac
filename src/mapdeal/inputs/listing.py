"""Files that names, folders, patterns and lists stand for."""

from __future__ import annotations

import fnmatch
import heapq
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from glob import has_magic
from itertools import takewhile
from pathlib import Path
from typing import Any

from mapdeal.errors import FileAccessError, MapdealError, ParameterError, emit_warning
from mapdeal.files.source import (
    BIT_MAP,
    IMAGE_KEY,
    NAMED_MAPS,
    YAML,
    claim,
    contents_of,
    exists,
    head_of,
    identity_of,
    is_folder,
    joined,
    normal_path,
    read_file,
    real_path,
    status_of,
    yaml_at,
)
from mapdeal.files.yaml_text import read_mapping
from mapdeal.inputs.kinds import kind_of, other_kind

_ANY_FOLDERS = "**"

Contents = tuple[list[str], list[str]]  # the names of the folders in a folder, and of its files


def list_files(
    names: Iterable[str], suffixes: Sequence[str], *, not_in_folders: Sequence[str] = ()
) -> list[Path]:
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
            raise FileAccessError(f"the folder holds no file that ends in {endings}", source=name)
        # a pattern is a word of the user's
        raise ParameterError(f"matches no file that ends in {endings}", source=name)
    return sorted_naturally(files)


def files_matching(pattern: str) -> list[Path]:
    """Return all but folders that a pattern stands for."""
    # The files are those of ``glob.glob(pattern, recursive=True)``. But that follows each of the
    # ways that links make to a folder, which can be 2 to the power of 40 with two links. Here each
    # part of the pattern leads from some folders to others, and each folder is looked into once for
    # each part, however many ways there are: the time is linear in the entries of all folders.
    if pattern[-1] in (os.sep, os.altsep):  # folders alone
        return []
    path = Path(pattern)
    *parts, last = path.parts[1:] if path.anchor else path.parts
    folders = [Path(path.anchor)]
    for part in parts:
        nearest: dict[tuple[int, int] | None, Path] = {}
        for one in sorted(_one_part_on(folders, part), key=lambda one: len(one.parts)):
            nearest.setdefault(identity_of(one), one)
        folders = list(nearest.values())
    if last == _ANY_FOLDERS:
        return [one / name for one, files in folders_below(folders, _seen_in) for name in files]
    if has_magic(last):
        return [one / name for one in folders for name in _matching(_seen_in(one)[1], last)]
    named = (one / last for one in folders)
    return [one for one in named if os.path.lexists(one) and not is_folder(one)]


def _one_part_on(folders: Iterable[Path], part: str) -> Iterator[Path]:
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
    try:
        return contents_of(folder)
    except FileAccessError as error:
        emit_warning(f"{error}; left out", stacklevel=2)
        return [], []


def folders_below(
    folders: Iterable[Path], look_into: Callable[[Path], Contents], *,
    leave_out: Callable[[Path], bool] = lambda _: False,
) -> Iterator[tuple[Path, list[str]]]:  # fmt: skip
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
    return sorted(files, key=lambda one: (natural_key(str(one.with_suffix(""))), one.suffix))


def natural_key(text: str) -> tuple[list[str | int], str]:
    """Return what to sort names by, so that their numbers are in order."""
    parts = re.split(r"([0-9]+)", text)  # words and numbers take turns
    return [int(part) if k % 2 else part for k, part in enumerate(parts)], text


_HEAD = 1 << 20
_LARGEST_LIST = 1 << 26
_PER_NAME = 400  # bytes that the name of a map takes in memory, and what is made of it


@dataclass(frozen=True)
class ListedMap:
    path: Path
    name: str
    error: MapdealError | None = None
    """Why a folder or pattern among several names has no map."""

    @property
    def place(self) -> Path:
        """The folder for what is made of it, below that of all: the name without its ending."""
        return Path(self.name).parent / self.path.stem


@dataclass(frozen=True)
class WholeFolders:
    """Folders that count as one thing, listed as they are, rather than searched for maps."""

    # Other folders in one, and the files in those, are listed as everywhere. A folder that cannot
    # be read, or holds nothing to be listed, is listed, too: whoever looks at it says so.
    mark: str
    is_one: Callable[[Path], bool]
    summary: str
    parts: tuple[str, ...] = ()


@dataclass(frozen=True)
class MapListing:
    maps: tuple[ListedMap, ...]
    is_set: bool
    left_out: tuple[Path, ...]
    repeated: tuple[Path, ...]

    def say(self, terminal: Any, done: str) -> None:
        """Say on a terminal what is left out, and what is `done` once though named more often."""
        no_maps = "YAML file{} without the key image {} left out"
        often = f"map{{}} {{}} named more than once, and {{}} {done} once"
        for paths, told in ((self.left_out, no_maps), (self.repeated, often)):
            if len(paths) == 1:
                terminal.remark([f"note: 1 {told.format('', 'was', 'is')}: {paths[0]}"])
            elif paths:
                many = told.format("s", "were", "are")
                terminal.remark([f"note: {len(paths)} {many}, such as {paths[0]}; -v names all"])
                for path in paths:
                    terminal.detail(f"{many.rsplit(' ', 2)[0]}: {path}")


@dataclass
class _Found:
    """Files that one name stands for; `root` is None if it is a map's own."""

    root: Path | None
    files: list[Path]
    left_out: list[Path]
    error: MapdealError | None = None


def list_maps(
    names: Iterable[str], output: Path | None, standard_input: Callable[[], Iterable[bytes]], *,
    whole_folders: WholeFolders | None = None, lists_empty: bool = False,
) -> MapListing:  # fmt: skip
    """Return the maps of names: folders but for what lies in the output, patterns, and lists."""
    # With `lists_empty`, a folder or pattern without a map among others is listed with its error.
    output = None if output is None else real_path(output)
    found: list[_Found] = []
    for name in names:
        is_list = name.startswith("@")
        lines = _lines_of(name[1:], standard_input) if is_list else [name]
        for line in lines:
            try:
                found.append(_found_by(line, output, whole_folders, is_listed=is_list))
            except MapdealError as error:
                if not lists_empty or not line:
                    raise
                found.append(_Found(None, [Path(line)], [], error))
    errors = [named.error for named in found if named.error is not None]
    if errors and len(errors) == len(found):
        raise errors[0]
    root = _common_root(found)
    maps: dict[tuple[Path, str], ListedMap] = {}
    repeated: dict[tuple[Path, str], Path] = {}
    for one in found:
        for path in one.files:
            file = (yaml_at(path) if path.suffix.lower() == BIT_MAP else None) or path
            key = (real_path(file.parent), file.name)
            name = path.name or str(path)
            if one.root is not None:
                name = normal_path(path).relative_to(root).as_posix()
            if key in maps:
                repeated[key] = path
            else:
                maps[key] = ListedMap(path, name, one.error)
    left_out = {real_path(path): path for one in found for path in one.left_out}
    is_set = any(one.root is not None for one in found)
    return MapListing(
        tuple(maps.values()), is_set, tuple(left_out.values()), tuple(repeated.values())
    )


def _lines_of(name: str, standard_input: Callable[[], Iterable[bytes]]) -> list[str]:
    what = f"@{name}"
    try:
        if name == "-":
            data = joined(standard_input(), limit=_LARGEST_LIST, source="standard input")
        else:
            data = read_file(Path(name), limit=_LARGEST_LIST)
        claim(what, 4 * len(data) + _PER_NAME * data.count(b"\n"))
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        rule = "a list of maps must be UTF-8 text"
        raise ParameterError(rule, source=what, place=f"line {line}") from None
    stripped = map(str.strip, text.split("\n"))
    lines = [line for line in stripped if line and not line.startswith("#")]
    if not lines:
        raise ParameterError("the list names no map", source=what)
    if any("\0" in line for line in lines):
        raise ParameterError("a list of maps must be UTF-8 text", source=what)
    return lines


def _found_by(
    name: str, output: Path | None, whole: WholeFolders | None, *, is_listed: bool
) -> _Found:
    if not name:
        raise ParameterError("the name of a map must not be empty")
    path = Path(name)
    if whole is not None and path.name in (whole.mark, whole.summary):
        path = path.parent
    if is_folder(path):
        candidates, folders = _below_folder(path, output, whole)
        maps = [one for one in candidates if _is_map(one)]
        kind = None if maps or whole is not None else kind_of(path)
        if kind is not None:
            raise other_kind(path, kind, "a folder of maps")
        if not maps and whole is None:
            rule = f"is a directory without a map: no .yaml with the key image{_outside_of(output)}"
            raise FileAccessError(rule, source=name)
        maps = [*maps, *folders] or [path]
        root = path
    elif has_magic(name) and not exists(path):
        matches = list_files([name], NAMED_MAPS)
        candidates = [one for one in matches if not _lies_in(one.parent, output)]
        candidates = _without_images(candidates, keep_all=path.suffix.lower() == BIT_MAP)
        maps = [one for one in candidates if one.suffix.lower() not in YAML or _is_map(one)]
        if not maps:
            rule = "matches no map: no .npz or .pbm, no .yaml with the key image"
            raise ParameterError(rule + _outside_of(output), source=name)
        # the folder that the pattern names before its first sign
        root = Path(*takewhile(lambda part: not has_magic(part), path.parts))
    else:
        return _Found(path.parent if is_listed else None, [path], [])
    known = set(maps)
    return _Found(root, maps, [one for one in candidates if one not in known])


def _without_images(files: list[Path], *, keep_all: bool) -> list[Path]:
    """Return the files without the bit maps that are the image of a YAML file's map."""
    # Of a pair both match most patterns, and are one map. One that has no YAML file of its name
    # beside it is another's image, unless it was asked for.
    yamls = {one.with_suffix("") for one in files if one.suffix.lower() in YAML}

    def is_map(path: Path) -> bool:
        if path.suffix.lower() != BIT_MAP:
            return True
        return path.with_suffix("") not in yamls if yaml_at(path) else keep_all

    return [one for one in files if is_map(one)]


def _outside_of(output: Path | None) -> str:
    is_there = output is not None and exists(output)
    return f" outside of {output}, where outputs go" if is_there else ""


def _lies_in(folder: Path, output: Path | None) -> bool:
    if output is None:
        return False
    real = real_path(folder)
    return real == output or output in real.parents


def _below_folder(
    folder: Path, output: Path | None, whole: WholeFolders | None
) -> tuple[list[Path], list[Path]]:
    """Return what may be maps in a folder and below, and the folders that are listed themselves."""
    # Hidden ones and outputs are left aside.
    listed: list[Path] = []

    def look_into(one: Path) -> Contents:
        try:
            folders, files = contents_of(one)
        except FileAccessError:
            if whole is None:
                raise
            listed.append(one)
            return [], []
        if whole is not None and whole.mark in files and whole.is_one(one):
            listed.append(one)
            return [name for name in folders if name not in whole.parts], []
        return folders, files

    walk = folders_below([folder], look_into, leave_out=lambda one: _lies_in(one, output))
    files = [one / name for one, names in walk for name in names]
    # a link to nothing may have been a folder
    yamls = (one for one in files if one.suffix.lower() in YAML or not (one.suffix or exists(one)))
    return sorted_naturally(yamls), sorted(listed, key=lambda one: natural_key(str(one)))


def _is_map(path: Path) -> bool:
    """Return whether a YAML file is a map's: it has the key image, broken though it may be."""
    try:
        return bool(IMAGE_KEY.search(head_of(path, _HEAD))) or "image" in read_mapping(path)
    except FileAccessError:
        return True  # whoever reads it says why not
    except MapdealError:
        return False


def _common_root(found: Iterable[_Found]) -> Path:
    sets = [one for one in found if one.root is not None]
    # a pattern can lead upwards behind its fixed part, so the files count, too
    folders = {one.root for one in sets} | {path.parent for one in sets for path in one.files}
    if not folders:
        return Path()
    try:
        return Path(os.path.commonpath([normal_path(folder) for folder in folders if folder]))
    except ValueError:  # Windows
        raise ParameterError("folders on several drives have no common root") from None
