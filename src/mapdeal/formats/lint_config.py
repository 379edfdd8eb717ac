"""Configuration of lint: ``pyproject.toml`` or ``mapdeal.toml``, and comments in YAML files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import field
from pathlib import Path
from typing import Any

from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError
from mapdeal.formats.source import exists, normal_path, read_file
from mapdeal.formats.yaml_text import OF_MAPS
from mapdeal.records import dataclass

OWN_FILE, PYPROJECT = "mapdeal.toml", "pyproject.toml"

_LARGEST = 1 << 20
_SEVERITIES = ("error", "warning", "note")

_IGNORE = re.compile(r"(?:^|(?<=\s))#[ \t]{0,9}mapdeal:[ \t]{0,9}ignore(?![\w-]):?")
_NAME = re.compile(r"[ \t]*([\w.-]+)[ \t]*")

Names = tuple[str, ...]


@dataclass(frozen=True)
class LintConfig:
    source: Path
    table: str
    select: Names | None = None
    ignore: Names | None = None
    strict: bool = False
    per_file_ignores: tuple[tuple[str, Names], ...] = field(default=())
    severity: tuple[tuple[str, str], ...] = field(default=())


def find_lint_config(folder: Path) -> LintConfig | None:
    """Return what the nearest file says, in a folder or one above it; None if there is none."""
    # A ``mapdeal.toml`` comes before a ``pyproject.toml`` beside it; one of the latter without the
    # table ``[tool.mapdeal.lint]`` is passed over.
    start = normal_path(folder)
    for place in (start, *start.parents):
        if exists(place / OWN_FILE):
            return read_lint_config(place / OWN_FILE) or LintConfig(place / OWN_FILE, "lint")
        if exists(place / PYPROJECT):
            found = read_lint_config(place / PYPROJECT)
            if found is not None:
                return found
    return None


def read_lint_config(path: Path) -> LintConfig | None:
    """Return what a file says of lint; None if it has no such table."""
    document = _document_of(path)
    if path.name == PYPROJECT:
        tool = document.get("tool", {})
        ours = tool.get("mapdeal", {}) if isinstance(tool, dict) else {}
        table, ours_at = "tool.mapdeal.lint", "tool.mapdeal."
    else:
        ours, table, ours_at = document, "lint", ""
    if not isinstance(ours, dict):
        raise ParameterError("must be a table", source=path, place="tool.mapdeal", got=ours)
    _check_keys(ours, ("lint",), path, ours_at)
    if "lint" not in ours:
        return None
    entries = ours["lint"]
    if not isinstance(entries, dict):
        raise ParameterError("must be a table", source=path, place=table, got=entries)
    _check_keys(entries, tuple(_KEYS), path, f"{table}.")
    values = {
        name: _KEYS[key](entries[key], path, f"{table}.{key}")
        for key, name in ((key, key.replace("-", "_")) for key in entries)
    }
    return LintConfig(path, table, **values)


def _document_of(path: Path) -> dict[str, Any]:
    import tomllib

    data = read_file(path, limit=_LARGEST)
    try:
        return tomllib.loads(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise MalformedInputError("not UTF-8", source=path, place=f"byte {error.start}") from None
    except RecursionError:
        raise MalformedInputError("not valid TOML: nested too deeply", source=path) from None
    except ValueError as error:  # of tomllib, or numbers of many thousand digits
        raise MalformedInputError(f"not valid TOML: {error}", source=path) from None


def _check_keys(
    table: Mapping[str, Any], known: Iterable[str], path: Path, prefix: str
) -> None:  # fmt: skip
    for key in table:
        if key not in known:
            import difflib

            near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known keys: {', '.join(known)}"
            if key in _KEYS:  # of the table that it stands above
                hint = f"it belongs in the table [{prefix}lint]"
            raise ParameterError("unknown key", source=path, place=f"{prefix}{key}", hint=hint)


def _names(value: Any, path: Path, place: str) -> Names:
    if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
        raise ParameterError("must be a list of names", source=path, place=place, got=value)
    return tuple(value)


def _flag(value: Any, path: Path, place: str) -> bool:
    if not isinstance(value, bool):
        raise ParameterError("must be true or false", source=path, place=place, got=value)
    return value


def _per_file(value: Any, path: Path, place: str) -> tuple[tuple[str, Names], ...]:
    if not isinstance(value, dict):
        rule = "must be a table of patterns and lists of names"
        raise ParameterError(rule, source=path, place=place, got=value)
    return tuple(
        (pattern, _names(names, path, f'{place}."{pattern}"')) for pattern, names in value.items()
    )


def _severity(value: Any, path: Path, place: str) -> tuple[tuple[str, str], ...]:
    if not isinstance(value, dict):
        raise ParameterError("must be a table of names", source=path, place=place, got=value)
    for name, severity in value.items():
        if severity not in _SEVERITIES:
            rule = f"must be {', '.join(_SEVERITIES[:-1])} or {_SEVERITIES[-1]}"
            raise ParameterError(rule, source=path, place=f'{place}."{name}"', got=severity)
    return tuple(value.items())


_KEYS: dict[str, Callable[[Any, Path, str], Any]] = {
    "select": _names,
    "ignore": _names,
    "strict": _flag,
    "per-file-ignores": _per_file,
    "severity": _severity,
}
"""Reader of the value of each key."""


@dataclass(frozen=True)
class IgnoreComment:
    """A comment ``# mapdeal: ignore ID[, ID]``."""

    line: int
    names: Names


def read_ignore_comments(path: Path, limit: int = OF_MAPS.bytes) -> list[IgnoreComment]:
    """Return the comments of a file that name checks of lint which are to be ignored."""
    # A comment is recognised by its text, at the beginning of a line or behind white space. So it
    # counts in a file, too, that is no YAML.
    try:
        data = read_file(path, limit=limit)
    except (FileAccessError, MalformedInputError):
        return []
    lines = data.decode("utf-8-sig", "replace").splitlines()
    found = ((number, line, _IGNORE.search(line)) for number, line in enumerate(lines, start=1))
    return [IgnoreComment(number, _listed(line[one.end() :])) for number, line, one in found if one]


def _listed(text: str) -> Names:
    names = []
    for part in text.split(","):
        name = _NAME.match(part)
        names += [name[1]] if name else []
        if not name or name.end() < len(part):
            break
    return tuple(names)
