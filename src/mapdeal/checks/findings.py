"""Checks, their findings, and the selection of findings by options, configuration and comments."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any, Literal

from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError, one_line
from mapdeal.files.source import exists, is_folder, normal_path, read_file
from mapdeal.files.yaml_text import OF_MAPS
from mapdeal.grid.frame import Point
from mapdeal.ros.robot import ParameterValue

Severity = Literal["error", "warning", "note"]
_DECIMALS = 9
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")


@dataclass(frozen=True)
class Finding:
    """Finding reported by a check.

    Parameters
    ----------
    check : str
        Name of the check, ``area.name``.
    severity : {'error', 'warning', 'note'}
        An error makes the map wrong or unsafe for some reader, a warning points out a trap, and
        a note is worth knowing.
    file : str
        File in which it was found.
    message : str
        Description, one line.
    line : int, optional
        Line number in the file, starting at 1.
    places : tuple of (x, y)
        Positions in the map frame, metres: a selection, the most important first.
    """

    check: str
    severity: Severity
    file: str
    message: str
    line: int | None = None
    places: tuple[Point, ...] = ()

    def __str__(self) -> str:
        """Return ``FILE:LINE: SEVERITY: CHECK: MESSAGE``, as ``mapdeal lint`` prints it."""
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return one_line(f"{place}: {self.severity}: {self.check}: {self.message}")


@dataclass(frozen=True)
class Remark:
    """Remark of a check about a map."""

    message: str
    key: str | None = None
    at: ParameterValue | None = None
    places: tuple[Point, ...] = ()


@dataclass(frozen=True)
class Check:
    name: str
    severity: Severity
    about: str
    run: Callable[[Any], Iterable[Remark | str]] = lambda _: ()
    facts: type | None = None

    def remarks(self, facts: Any) -> Iterator[Remark]:
        for remark in self.run(facts):
            yield remark if isinstance(remark, Remark) else Remark(remark)

    def finding(
        self, file: Path | str, message: str, line: int | None = None,
        places: tuple[Point, ...] = (),
    ) -> Finding:  # fmt: skip
        return Finding(self.name, self.severity, str(file), message, line, places)


def places_of(points_xy: Iterable[Sequence[float]]) -> tuple[Point, ...]:
    """Return points of the map frame as findings print them, without the rounding of floats."""
    return tuple((round(x, _DECIMALS) + 0.0, round(y, _DECIMALS) + 0.0) for x, y in points_xy)


CHECKS: dict[str, Check] = {}  # all checks by name, in the order in which they run


def add_check(check: Check) -> None:
    """Add a check to the list; raise ValueError if its name is not unique."""
    if check.name in CHECKS:
        raise ValueError(f"two checks are called {check.name}")
    CHECKS[check.name] = check


def declare_check(name: str, severity: Severity, about: str) -> None:
    """Add a check without a function: readers of files make its findings."""
    add_check(Check(name, severity, about))


declare_check("file.access", "error", "a file is missing or cannot be read")
declare_check("file.malformed", "error", "a file breaks its format's rules")
declare_check("yaml.defaults", "warning", "negate or a threshold is missing; ROS requires them")
declare_check("yaml.number-as-text", "warning", "a number such as 5e-2 that YAML 1.1 reads as text")
declare_check("yaml.nan-yaw", "error", "a yaw of nan, which some map savers write")
declare_check("yaml.legacy-mode", "warning", "the mode is in an outdated form")
declare_check("thresholds.equal", "warning", "free_thresh equals occupied_thresh")
declare_check("image.foreign-path", "warning", "the path of the image is that of another machine")
declare_check("image.lossy", "warning", "the image is a JPEG: greys may have changed")
declare_check("image.orientation", "warning", "an EXIF orientation that ROS does not apply")
declare_check("image.depth", "warning", "16-bit colour, of which 8 bits were read")
declare_check("image.transparent-colour", "warning", "a transparent colour (PNG tRNS)")
declare_check("image.dos-header", "warning", "DOS line ends in the header of a PNM image")
declare_check("image.trailing-bytes", "warning", "bytes after the picture")
declare_check("image.raw-values", "warning", "values without a meaning in mode raw")
declare_check(
    "image.yaml-not-read", "warning", "an image that --resolution reads without its .yaml"
)
declare_check("map.view", "warning", "a 0..100 view of a distance field, which is not a map")
declare_check("graph.refused", "error", "a graph that Nav2's route server refuses to load")
declare_check(
    "graph.missing-end", "error", "an edge without a start or end node: Nav2 refuses the file"
)
declare_check("graph.double-id", "error", "two nodes, or two edges, with the same id")
declare_check("graph.shared-id", "warning", "a node and an edge with the same id")
declare_check("graph.whole-number", "error", "an integer where a scorer reads a float: it throws")
declare_check("graph.mixed-limits", "warning", "speed_limit on some edges and not on all")
declare_check("graph.other-frame", "error", "coordinates of another frame than the map's")
declare_check("graph.node-closed", "error", "a node in an obstacle or unknown space, or too near")
declare_check("graph.edge-blocked", "error", "an edge along which the robot collides")
declare_check("graph.one-way", "warning", "nodes that can be only entered or only left")
declare_check("graph.parts", "warning", "parts of a graph that are not connected")
declare_check("lint.not-checked", "error", "a map that could not be checked: no memory, or a bug")
declare_check(
    "lint.unused-ignore", "note", "an ignore comment without effect, or with an unknown check"
)


OWN_FILE, PYPROJECT = "mapdeal.toml", "pyproject.toml"

_LARGEST = 1 << 20

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
    """Return the configuration in the nearest file, in a folder or above it, if there is one."""
    # A ``mapdeal.toml`` has precedence over a ``pyproject.toml`` beside it. A ``pyproject.toml``
    # without the table ``[tool.mapdeal.lint]`` is skipped.
    start = normal_path(folder)
    for place in (start, *start.parents):
        if exists(place / OWN_FILE):
            return read_lint_config(place / OWN_FILE) or LintConfig(place / OWN_FILE, "lint")
        if exists(place / PYPROJECT):
            config = read_lint_config(place / PYPROJECT)
            if config is not None:
                return config
    return None


def read_lint_config(path: Path) -> LintConfig | None:
    """Return the lint configuration in a file; None if its table is missing."""
    document = _document_of(path)
    if path.name == PYPROJECT:
        tool = document.get("tool", {})
        own_table = tool.get("mapdeal", {}) if isinstance(tool, dict) else {}
        table, prefix = "tool.mapdeal.lint", "tool.mapdeal."
    else:
        own_table, table, prefix = document, "lint", ""
    if not isinstance(own_table, dict):
        raise ParameterError("must be a table", source=path, place="tool.mapdeal", got=own_table)
    _check_keys(own_table, ("lint",), path, prefix)
    if "lint" not in own_table:
        return None
    entries = own_table["lint"]
    if not isinstance(entries, dict):
        raise ParameterError("must be a table", source=path, place=table, got=entries)
    _check_keys(entries, tuple(_KEYS), path, f"{table}.")
    values = {
        name: _KEYS[key](entries[key], path, f"{table}.{key}")
        for key, name in ((key, key.replace("-", "_")) for key in entries)
    }
    return LintConfig(path, table, **values)


def _document_of(path: Path) -> dict[str, Any]:
    from mapdeal.compatibility import tomllib

    data = read_file(path, limit=_LARGEST)
    try:
        return tomllib.loads(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise MalformedInputError("not UTF-8", source=path, place=f"byte {error.start}") from None
    except RecursionError:
        raise MalformedInputError("not valid TOML: nested too deeply", source=path) from None
    except ValueError as error:  # tomllib's own errors, or numbers of many thousand digits
        raise MalformedInputError(f"not valid TOML: {error}", source=path) from None


def _check_keys(
    table: Mapping[str, Any], known: Iterable[str], path: Path, prefix: str
) -> None:  # fmt: skip
    for key in table:
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {close[0]}?" if close else f"known keys: {', '.join(known)}"
            if key in _KEYS:  # a key of lint in the table above
                hint = f"it belongs in the table [{prefix}lint]"
            raise ParameterError("unknown key", source=path, place=f"{prefix}{key}", hint=hint)


def _names(value: Any, path: Path, place: str) -> Names:
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
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
        if severity not in SEVERITIES:
            rule = f"must be {', '.join(SEVERITIES[:-1])} or {SEVERITIES[-1]}"
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
    """Return the comments in a file that make lint ignore findings."""
    # The search needs no YAML parser, so comments count in malformed files, too. They start at the
    # beginning of a line or after white space.
    try:
        data = read_file(path, limit=limit)
    except (FileAccessError, MalformedInputError):
        return []
    lines = data.decode("utf-8-sig", "replace").splitlines()
    matches = ((n, line, _IGNORE.search(line)) for n, line in enumerate(lines, start=1))
    return [IgnoreComment(n, _names_in(line[m.end() :])) for n, line, m in matches if m]


def _names_in(text: str) -> Names:
    names = []
    for part in text.split(","):
        name = _NAME.match(part)
        names += [name[1]] if name else []
        if not name or name.end() < len(part):
            break
    return tuple(names)


UNUSED = "lint.unused-ignore"
EVERYTHING = "all"


@dataclass(frozen=True)
class Selection:
    """Selection of the findings that count, and their severities."""

    checks: frozenset[str]
    strict: bool = False
    folder: Path | None = None
    per_file: tuple[tuple[str, frozenset[str]], ...] = ()
    severity: Mapping[str, Severity] = field(default_factory=dict)

    def apply(
        self, file: Path, findings: Iterable[Finding], comments: Sequence[IgnoreComment] = (), *,
        skipped: Iterable[str] = (),
    ) -> tuple[tuple[Finding, ...], int]:  # fmt: skip
        """Return a map's remaining findings, worst first, and the number of suppressed ones."""
        # Suppressed means that the check is selected, but a comment or a pattern ignores it here.
        # A comment without effect is itself a finding, which comments cannot suppress.
        findings = list(findings)
        spared = self._ignored_in(file)
        selected = [found for found in findings if found.check in self.checks]
        texts = [text for comment in comments for text in comment.names]
        ignored = {name for text in texts for name in _matches(text)}
        ignored.discard(UNUSED)
        remaining = [found for found in selected if found.check not in ignored | spared]
        unused = []
        if UNUSED in self.checks - spared:
            unused = list(_unused(file, comments, {*skipped, *(found.check for found in findings)}))
        ranked = [
            replace(found, severity=self.severity.get(found.check, found.severity))
            for found in [*remaining, *unused]
        ]
        ranked.sort(key=lambda found: SEVERITIES.index(found.severity))
        return tuple(ranked), len(selected) - len(remaining)

    def _ignored_in(self, file: Path) -> frozenset[str]:
        if not self.per_file or self.folder is None:
            return frozenset()
        path, folder = normal_path(file), normal_path(self.folder)
        if folder not in path.parents:
            return frozenset()
        below = PurePosixPath(path.relative_to(folder).as_posix())
        names = [path.name, *map(str, (below, *below.parents[:-1]))]
        ignored: frozenset[str] = frozenset()
        for pattern, checks in self.per_file:
            if any(fnmatchcase(name, pattern.removesuffix("/")) for name in names):
                ignored |= checks
        return ignored


def selection_of(
    select: Sequence[str] = (), ignore: Sequence[str] = (), *, strict: bool = False,
    config: LintConfig | None = None,
) -> Selection:  # fmt: skip
    everything = frozenset(CHECKS)
    checks = everything
    per_file: tuple[tuple[str, frozenset[str]], ...] = ()
    severity: dict[str, Severity] = {}
    if config is not None:
        source, table = config.source, config.table
        checks = _refine(
            checks,
            _ranks(config.select or (), source, f"{table}.select"),
            _ranks(config.ignore or (), source, f"{table}.ignore"),
            selects=config.select is not None,
        )
        per_file = tuple(
            (pattern, frozenset(_ranks(names, source, f'{table}.per-file-ignores."{pattern}"')))
            for pattern, names in config.per_file_ignores
        )
        ranks: dict[str, int] = {}
        for text, level in config.severity:
            for name, rank in _ranks([text], source, f"{table}.severity").items():
                if rank >= ranks.get(name, 0):
                    ranks[name] = rank
                    severity[name] = level  # type: ignore[assignment]
    checks = _refine(
        checks, _ranks(select, "--select"), _ranks(ignore, "--ignore"), selects=bool(select)
    )
    return Selection(
        checks, strict=strict or (config is not None and config.strict),
        folder=None if config is None else config.source.parent, per_file=per_file,
        severity=severity,
    )  # fmt: skip


class Selections:
    """The selection for each map; `config` is as for `mapdeal.lint`."""

    def __init__(
        self, select: Sequence[str], ignore: Sequence[str], *, strict: bool, config: Path | bool
    ) -> None:
        self._make = partial(selection_of, select, ignore, strict=strict)
        self._is_nearest = config is True
        self._config = None if isinstance(config, bool) else _config_in(config)
        self._by_folder: dict[Path, Selection] = {}
        self._make(config=self._config)  # refuses unknown names before any work

    def of(self, path: Path) -> Selection:
        folder = normal_path(path if is_folder(path) else path.parent)
        if folder not in self._by_folder:
            config = find_lint_config(folder) if self._is_nearest else self._config
            self._by_folder[folder] = self._make(config=config)
        return self._by_folder[folder]


def _config_in(path: Path) -> LintConfig:
    config = read_lint_config(path)
    if config is None:
        table = "[tool.mapdeal.lint]" if path.name == PYPROJECT else "[lint]"
        raise ParameterError(f"has no table {table}", source=path)
    return config


def _refine(
    before: frozenset[str], select: Mapping[str, int], ignore: Mapping[str, int], *, selects: bool
) -> frozenset[str]:
    """Return the checks that are selected more precisely than they are ignored."""
    ranks = select if selects else dict.fromkeys(before, -1)
    return frozenset(name for name, rank in ranks.items() if rank > ignore.get(name, -2))


def _ranks(names: Iterable[str], source: Path | str, place: str | None = None) -> dict[str, int]:
    """Return how precisely each check is named, at best: 0 by all, 1 by its area, 2 by name."""
    ranks: dict[str, int] = {}
    for text in names:
        matching = _matches(text)
        if not matching:
            raise ParameterError(
                "unknown check", source=source, place=place, got=text, hint=hint_for(text)
            )
        for name, rank in matching.items():
            ranks[name] = max(rank, ranks.get(name, 0))
    return ranks


def _matches(text: str) -> dict[str, int]:
    """Return the precision of each check that a name selects; empty if the name is unknown."""
    if text in CHECKS:
        return {text: 2}
    if text.lower() == EVERYTHING:
        return dict.fromkeys(CHECKS, 0)
    area = text.removesuffix(".")
    return dict.fromkeys((name for name in CHECKS if name.partition(".")[0] == area), 1)


def hint_for(text: str) -> str:
    """Return a hint with the check or area that is most similar to an unknown name."""
    areas = dict.fromkeys(name.partition(".")[0] for name in CHECKS)
    close = difflib.get_close_matches(text.lower(), [*CHECKS, *areas], n=1)
    if not close:  # a check's name without its area
        close = [name for name in CHECKS if name.partition(".")[2] == text.lower()][:1]
    return f"did you mean {close[0]}?" if close else f"areas are {', '.join(areas)}"


def _unused(file: Path, comments: Iterable[IgnoreComment], active: set[str]) -> Iterator[Finding]:
    """Yield a finding for each ignore comment without effect or with an unknown check."""
    for comment in comments:
        messages = [] if comment.names else ["names no check: write # mapdeal: ignore AREA.NAME"]
        for text in comment.names:
            matching = _matches(text)
            if not matching:
                messages.append(f"unknown check {text}; {hint_for(text)}")
            elif active.isdisjoint(matching) or text == UNUSED:
                messages.append(f"{text} ignores nothing here")
        for message in messages:
            yield Finding(UNUSED, CHECKS[UNUSED].severity, str(file), message, comment.line)
