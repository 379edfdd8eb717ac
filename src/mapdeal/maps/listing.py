"""Expansion of names, folders, patterns and lists to files."""

from __future__ import annotations

import fnmatch
import heapq
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from glob import has_magic
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

from mapdeal.errors import FileAccessError, MapdealError, ParameterError, emit_warning
from mapdeal.files import source as sources
from mapdeal.files.json_values import MANIFEST, document_kind, read_json
from mapdeal.maps import formats, kinds
from mapdeal.records import dataclass

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
    if sources.is_folder(path):
        suffixes = [suffix for suffix in suffixes if suffix not in not_in_folders]
        inside = [path / file for file in sources.contents_of(path)[1]]
    elif has_magic(name) and not sources.exists(path):
        inside = files_matching(name)
    else:
        sources.status_of(path)  # raises if it is missing
        return [path]
    if not (files := [file for file in inside if file.suffix.lower() in suffixes]):
        rule = f"no file that ends in {', '.join(suffixes)}"
        if sources.exists(path):
            raise FileAccessError(f"the folder holds {rule}", source=name)
        # a pattern is an argument, not a file: exit code 2
        raise ParameterError(f"matches {rule}", source=name)
    return sorted_naturally(files)


def files_matching(pattern: str) -> list[Path]:
    # The files are those of ``glob.glob(pattern, recursive=True)``, which visits a folder once for
    # each path to it: up to 2^40 times with two cyclic links. Here each part of the pattern maps a
    # set of folders to another set, so the time is linear in the entries of all folders.
    if pattern[-1] in (os.sep, os.altsep):  # matches only folders
        return []
    path = Path(pattern)
    *parts, last = path.parts[1:] if path.anchor else path.parts
    folders = [Path(path.anchor)]
    for part in parts:
        nearest: dict[tuple[int, int] | None, Path] = {}
        matches = _folders_matching(folders, part)
        for folder in sorted(matches, key=lambda folder: len(folder.parts)):
            nearest.setdefault(sources.identity_of(folder), folder)
        folders = list(nearest.values())
    if last == _ANY_FOLDERS:
        tree = folders_below(folders, _readable)
        return [folder / name for folder, files in tree for name in files]
    if has_magic(last):
        return [at / name for at in folders for name in _matching(_readable(at)[1], last)]
    files = (folder / last for folder in folders)
    return [file for file in files if os.path.lexists(file) and not sources.is_folder(file)]


def _folders_matching(folders: Iterable[Path], part: str) -> Iterator[Path]:
    if part == _ANY_FOLDERS:
        yield from (folder for folder, _ in folders_below(folders, _readable))
    elif has_magic(part):
        for folder in folders:
            yield from (folder / name for name in _matching(_readable(folder)[0], part))
    else:
        yield from (folder / part for folder in folders if sources.is_folder(folder / part))


def _matching(names: Iterable[str], part: str) -> list[str]:
    shows_hidden = part.startswith(".")
    return [n for n in fnmatch.filter(names, part) if shows_hidden or not n.startswith(".")]


def _readable(folder: Path) -> Contents:
    try:
        return sources.contents_of(folder)
    except FileAccessError as error:
        emit_warning(f"{error}; left out")
        return [], []


def folders_below(
    folders: Iterable[Path], look_into: Callable[[Path], Contents], *,
    leave_out: Callable[[Path], bool] = lambda _: False,
) -> Iterator[tuple[Path, list[str]]]:  # fmt: skip
    visited: set[tuple[int, int] | None] = set()
    waiting = [(len(folder.parts), k, folder) for k, folder in enumerate(folders)]
    heapq.heapify(waiting)
    count = len(waiting)
    while waiting:
        *_, folder = heapq.heappop(waiting)
        identity = sources.identity_of(folder)
        if identity in visited or leave_out(folder):
            continue
        visited.add(identity)
        subfolders, files = look_into(folder)
        yield folder, [name for name in files if not name.startswith(".")]
        for name in subfolders:
            if not name.startswith("."):
                count += 1
                heapq.heappush(waiting, (len(folder.parts) + 1, count, folder / name))


def numbered_folders(folder: Path) -> list[Path]:
    if not sources.is_folder(folder):
        return []
    numbered = [name for name in sources.contents_of(folder)[0] if name.isdecimal()]
    return [folder / name for name in sorted(numbered, key=natural_key)]


def sorted_naturally(files: Iterable[Path]) -> list[Path]:
    return sorted(files, key=lambda file: (natural_key(str(file.with_suffix(""))), file.suffix))


def natural_key(text: str) -> tuple[list[str | int], str]:
    parts = re.split(r"([0-9]+)", text)  # words and numbers alternate
    return [int(part) if k % 2 else part for k, part in enumerate(parts)], text


_IN_FOLDERS = tuple(e for entry in formats.FORMATS if entry.in_folders for e in entry.endings)
_NO_MAP, _NO_MAP_IN_FOLDER = (
    ", ".join(f"no {entry.sign}" for entry in formats.FORMATS if entry.in_folders or with_all)
    for with_all in (True, False)
)
_LARGEST_LIST = 1 << 26
_PER_NAME = 400  # bytes in memory for the name of a map and its entry in the listing


class ListedMap(NamedTuple):
    path: Path
    name: str
    error: MapdealError | None = None
    """Reason why a folder or pattern, one of several names, has no map."""

    @property
    def place(self) -> Path:
        """Folder for the map's outputs, relative to that of all maps: its name without ending."""
        return Path(self.name).parent / self.path.stem


class ListedFolders(NamedTuple):
    """Folders that are listed themselves instead of searched for maps, such as those of runs."""

    # Their subfolders are searched as usual. A folder that is unreadable or has no map is listed as
    # well, so that the command can report it.
    mark: str
    is_listed_itself: Callable[[Path], bool]
    summary: str
    has_failures: Callable[[Path], bool]  # of a folder with a summary, which is searched as well
    parts: tuple[str, ...] = ()


@dataclass(frozen=True)
class MapListing:
    maps: tuple[ListedMap, ...]
    is_set: bool
    left_out: tuple[Path, ...]
    repeated: tuple[Path, ...]

    def print_notes(self, terminal: Any, participle: str) -> None:
        no_maps = "YAML file{} without the key image {} left out"
        duplicates = f"map{{}} {{}} named more than once, and {{}} {participle} once"
        for paths, template in ((self.left_out, no_maps), (self.repeated, duplicates)):
            if len(paths) == 1:
                terminal.remark([f"note: 1 {template.format('', 'was', 'is')}: {paths[0]}"])
            elif paths:
                text = template.format("s", "were", "are")
                terminal.remark([f"note: {len(paths)} {text}, such as {paths[0]}; -v names all"])
                for path in paths:
                    terminal.detail(f"{text.rsplit(' ', 2)[0]}: {path}")


class _Expansion(NamedTuple):
    """Files of one argument; `root` is None if the argument is a map's own name."""

    root: Path | None
    files: list[Path]
    left_out: list[Path]
    error: MapdealError | None = None


def list_maps(
    names: Iterable[str], output: Path | None, standard_input: Callable[[], Iterable[bytes]], *,
    exempt: ListedFolders | None = None, lists_empty: bool = False,
) -> MapListing:  # fmt: skip
    """Return the maps of names, folders, patterns and lists; the output folder is not searched."""
    # With `lists_empty`, one of several folders or patterns without a map is listed with its error.
    output = None if output is None else sources.real_path(output)
    expansions: list[_Expansion] = []
    for name in names:
        is_list = name.startswith("@")
        for line in _lines_of(name[1:], standard_input) if is_list else [name]:
            try:
                expansions.append(_expand(line, output, exempt, is_listed=is_list))
            except MapdealError as error:
                if not lists_empty or not line:
                    raise
                expansions.append(_Expansion(None, [Path(line)], [], error))
    errors = [expansion.error for expansion in expansions if expansion.error is not None]
    if errors and len(errors) == len(expansions):
        raise errors[0]
    root = _common_root(expansions)
    maps: dict[tuple[Path, str], ListedMap] = {}
    repeated: dict[tuple[Path, str], Path] = {}
    for expansion in expansions:
        for path in expansion.files:
            is_bits = path.suffix.lower() == sources.BIT_MAP
            file = (sources.yaml_at(path) if is_bits else None) or path
            key = (sources.real_path(file.parent), file.name)
            name = path.name or str(path)
            if expansion.root is not None:
                name = sources.normal_path(path).relative_to(root).as_posix()
            if key in maps:
                repeated[key] = path
            else:
                maps[key] = ListedMap(path, name, expansion.error)
    ignored = (path for expansion in expansions for path in expansion.left_out)
    left_out = tuple({sources.real_path(path): path for path in ignored}.values())
    is_set = any(expansion.root is not None for expansion in expansions)
    return MapListing(tuple(maps.values()), is_set, left_out, tuple(repeated.values()))


def _lines_of(name: str, standard_input: Callable[[], Iterable[bytes]]) -> list[str]:
    source = f"@{name}"
    try:
        if name == "-":
            data = sources.joined(standard_input(), limit=_LARGEST_LIST, source="standard input")
        else:
            data = sources.read_file(Path(name), limit=_LARGEST_LIST)
        sources.claim(source, 4 * len(data) + _PER_NAME * data.count(b"\n"))
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        rule = "a list of maps must be UTF-8 text"
        raise ParameterError(rule, source=source, place=f"line {line}") from None
    lines = [line for line in map(str.strip, text.split("\n")) if line and not line.startswith("#")]
    if not lines:
        raise ParameterError("the list names no map", source=source)
    if any("\0" in line for line in lines):
        raise ParameterError("a list of maps must be UTF-8 text", source=source)
    return lines


def _expand(
    name: str, output: Path | None, exempt: ListedFolders | None, *, is_listed: bool
) -> _Expansion:
    if not name:
        raise ParameterError("the name of a map must not be empty")
    path = Path(name)
    if exempt is not None and path.name in (exempt.mark, exempt.summary):
        path = path.parent
    if sources.is_folder(path):
        candidates, folders = _below_folder(path, output, exempt)
        maps = [file for file in candidates if formats.format_of(file).holds_map(file)]
        kind = None if maps or exempt is not None else kinds.kind_of(path)
        if kind is not None:
            raise kinds.other_kind(path, kind, "a folder of maps")
        if not maps and exempt is None:
            rule = f"is a directory without a map: {_NO_MAP_IN_FOLDER}{_outside_of(output)}; "
            rule += "folders of runs are left out"
            raise FileAccessError(rule, source=name)
        maps = [*maps, *folders] or [path]
        root = path
    elif has_magic(name) and not sources.exists(path):
        matches = list_files([name], formats.MAP_ENDINGS)
        candidates = [file for file in matches if not _lies_in(file.parent, output)]
        candidates = _without_images(candidates, keep_all=path.suffix.lower() == sources.BIT_MAP)
        if not (maps := [file for file in candidates if formats.format_of(file).holds_map(file)]):
            raise ParameterError(f"matches no map: {_NO_MAP}{_outside_of(output)}", source=name)
        # the fixed folders before the first wildcard
        root = Path(*takewhile(lambda part: not has_magic(part), path.parts))
    else:
        return _Expansion(path.parent if is_listed else None, [path], [])
    known = set(maps)
    left_out = [f for f in candidates if f not in known and f.suffix.lower() in sources.YAML]
    yamls = {f.with_suffix("") for f in candidates if f in known and formats.format_of(f).is_yaml}
    maps = [
        file for file in maps
        if not (formats.format_of(file).yields_to_yaml and file.with_suffix("") in yamls)
    ]  # fmt: skip
    return _Expansion(root, maps, left_out)


def _without_images(files: list[Path], *, keep_all: bool) -> list[Path]:
    """Return the files without bit maps that are the image of a YAML file."""
    # Most patterns match both files of a pair, which are one map. A bit map without a YAML file of
    # its name is the image of another YAML file, unless the pattern names bit maps.
    yamls = {file.with_suffix("") for file in files if file.suffix.lower() in sources.YAML}

    def is_map(path: Path) -> bool:
        if path.suffix.lower() != sources.BIT_MAP:
            return True
        return path.with_suffix("") not in yamls if sources.yaml_at(path) else keep_all

    return [file for file in files if is_map(file)]


def _outside_of(output: Path | None) -> str:
    return " outside of the folder of outputs" if output and sources.exists(output) else ""


def _lies_in(folder: Path, output: Path | None) -> bool:
    if output is None:
        return False
    real = sources.real_path(folder)
    return real == output or output in real.parents


def _below_folder(
    folder: Path, output: Path | None, exempt: ListedFolders | None
) -> tuple[list[Path], list[Path]]:
    """Return possible maps in a folder and below, and the folders that are listed themselves."""
    # Hidden folders, the output folder and, for all but lint, folders of runs are left out.
    listed: list[Path] = []

    def look_into(subfolder: Path) -> Contents:
        try:
            folders, files = sources.contents_of(subfolder)
        except FileAccessError:
            if exempt is None:
                raise
            listed.append(subfolder)
            return [], []
        manifest = subfolder / "manifest.json"
        may_be_run = exempt is None and subfolder != folder and manifest.name in files
        if may_be_run and document_kind(read_json(manifest)) == MANIFEST:
            return [], []
        if exempt is not None and exempt.mark in files and exempt.is_listed_itself(subfolder):
            listed.append(subfolder)
            return [name for name in folders if name not in exempt.parts], []
        if exempt is not None and exempt.summary in files and exempt.has_failures(subfolder):
            listed.append(subfolder)
        return folders, files

    walk = folders_below([folder], look_into, leave_out=lambda path: _lies_in(path, output))
    files = [subfolder / name for subfolder, names in walk for name in names]
    # a broken link may have been a folder
    maps = [
        f for f in files if f.suffix.lower() in _IN_FOLDERS or not (f.suffix or sources.exists(f))
    ]
    return sorted_naturally(maps), sorted(listed, key=lambda path: natural_key(str(path)))


def _common_root(expansions: Iterable[_Expansion]) -> Path:
    sets = [expansion for expansion in expansions if expansion.root is not None]
    # a pattern can contain .. after its fixed part, so the folders of the files count as well
    folders = {part.root for part in sets} | {path.parent for part in sets for path in part.files}
    if not folders:
        return Path()
    try:
        return Path(os.path.commonpath([sources.normal_path(f) for f in folders if f]))
    except ValueError:  # only on Windows
        raise ParameterError("folders on several drives have no common root") from None
