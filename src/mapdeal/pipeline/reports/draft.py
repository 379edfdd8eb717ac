"""What a page is to show, as it is gathered."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import field, replace
from itertools import islice
from pathlib import Path
from typing import TypeVar

from mapdeal.errors import FileAccessError, emit_warning, one_line
from mapdeal.formats.source import exists, head_of
from mapdeal.grid.cost_curve import CostCurve
from mapdeal.pipeline.heard import portable
from mapdeal.records import dataclass
from mapdeal.report.document import Entry, Item, PageLayer, Table
from mapdeal.report.tiles import extent_of

REPORT = "report.html"
"""The page of a run, in the folder that was named for its outputs."""

_GENERATOR = b'<meta name="generator" content="mapdeal'
_HEAD = 1 << 12


def check_replaceable(page: Path) -> None:
    """Refuse to replace what is in the place of a page, unless mapdeal has made it."""
    if exists(page) and _GENERATOR not in head_of(page, _HEAD):
        rule = "exists, and is not a page written by mapdeal"
        raise FileAccessError(rule, source=page, hint="move it: --report writes there")


Kind = TypeVar("Kind")

_MOST = 5000
"""Items, tables, rows of a table, and warnings of an entry: browsers get slow beyond that."""

_ABSOLUTE = re.compile(r"(?<![\w./\\-])(?=/|[A-Za-z]:[\\/]|\\\\)")
_SEPARATOR = re.compile(r"[\\/]")
_DEEPEST = 32
"""Folders in one another that are looked for in a text, so that this takes linear time."""


@dataclass
class Draft:
    """An entry of a report while it is being gathered."""

    name: str
    path: Path
    sums: set[str] = field(default_factory=set)
    paths: list[Path] = field(default_factory=list)
    names: set[str] = field(default_factory=set)
    files: set[str] = field(default_factory=set)
    status: str = ""
    layers: list[PageLayer] = field(default_factory=list)
    items: list[Item] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    warnings: dict[str, None] = field(default_factory=dict)
    figures: dict[str, str | float] = field(default_factory=dict)
    curve: CostCurve | None = None
    compared: tuple[str, str] | None = None

    @property
    def places(self) -> tuple[Path, ...]:
        return (self.path, *self.paths)

    def takes(self, sums: Collection[str]) -> bool:
        """Return whether a map whose files have these sums is what the run was made of."""
        return bool(sums) and self.sums >= set(sums)

    def warn(self, texts: Iterable[str], files: Iterable[Path] = ()) -> None:
        """Note what the page is to warn of, each text once, files by their names alone."""
        self.warnings |= dict.fromkeys(portable(texts, files))

    def miss(self, text: str, file: Path) -> None:
        """Warn of a file that is missing or does not match, on the page, too."""
        emit_warning(text, stacklevel=2)
        self.warn([text], [file])

    def free_name(self, name: str) -> str:
        taken = {layer.name for layer in self.layers}
        names = (name if number == 1 else f"{name}-{number}" for number in range(1, len(taken) + 2))
        return next(one for one in names if one not in taken)

    def entry(self, folders: Collection[str] = ()) -> Entry:
        """Return the entry as it is now; of very many items, tables and rows the first ones."""
        # Texts name files without the absolute `folders`, of this machine or of a document's.

        def shown(text: str) -> str:
            return without_folders(text, folders)

        items = _first(self.items, lambda rest: Item("finding", rest, "note"))
        short = [
            replace(one, rows=_first(one.rows, lambda rest: (rest, ""))) for one in self.tables
        ]
        tables = _first(short, lambda rest: Table(rest, ()))
        return Entry(
            shown(self.name),
            tuple(self.layers),
            tuple(replace(one, text=shown(one.text)) for one in items),
            tuple(
                Table(shown(one.title), tuple((shown(k), shown(v)) for k, v in one.rows))
                for one in tables
            ),
            tuple(map(shown, _first(tuple(self.warnings), str))),
            self.status,
            dict(self.figures),
            self.curve,
            self.compared,
            extent_of(self.layers, self.items),
        )


def folder_of(name: str) -> str | None:
    """Return the folder of a file that is named absolutely, as any system writes it."""
    end = max(name.rfind("/"), name.rfind("\\"))
    return one_line(name[:end]) if end > 0 and _ABSOLUTE.match(name) else None


def without_folders(text: str, folders: Collection[str]) -> str:
    """Return a text in which names of files lack the folders they begin with.

    Examples
    --------
    >>> without_folders("see /home/me/maps/a.pgm, /scan", {"/home/me", "/home/me/maps"})
    'see a.pgm, /scan'
    """
    shown, done = "", 0
    for start in (match.start() for match in _ABSOLUTE.finditer(text)):
        parts = islice(_SEPARATOR.finditer(text, start + 1), _DEEPEST)
        ends = [part.end() for part in parts if text[start : part.start()] in folders]
        if ends and start >= done:
            shown, done = shown + text[done:start], ends[-1]
    return shown + text[done:]


def _first(found: Sequence[Kind], told: Callable[[str], Kind]) -> tuple[Kind, ...]:
    """Return the first of very many, and one that counts the rest."""
    if len(found) <= _MOST:
        return tuple(found)
    return (*found[:_MOST], told(f"{len(found) - _MOST} more are not listed"))
