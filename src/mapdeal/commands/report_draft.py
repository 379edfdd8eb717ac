"""Grids of files: read when they are asked for, and let go when others need the room."""

from __future__ import annotations

import re
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from mapdeal.commands.report_documents import Part, Results
from mapdeal.errors import FileAccessError, MapdealError, emit_warning, kept_warnings, one_line
from mapdeal.files.budget import memory_limit
from mapdeal.files.source import CHANGED, sums_of_reads
from mapdeal.grid.costmap import CostCurve
from mapdeal.kernels.blocks import Layer, is_lazy, lazy_layer
from mapdeal.maps.npz import Grid, holds_reach, open_npz, read_reach
from mapdeal.maps.reading import MapFile, open_map
from mapdeal.pipeline.inputs import bytes_of
from mapdeal.pipeline.settings import Settings, heard, portable
from mapdeal.report.document import Entry, Item, PageLayer, Table, kinds_of
from mapdeal.report.tiles import extent_of

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

    def lacks(self, what: str, file: Path, error: MapdealError) -> None:
        """Warn of what is not shown because of an error."""
        self.miss(f"{one_line(str(error))}, so {what} is not shown", file)

    def compare_sums(
        self, file: Path, found: Collection[object], told: Collection[object], what: str
    ) -> None:  # fmt: skip
        """Warn of a map that is not what a document is of, given the checksums of both."""
        if told and found != told:
            self.miss(f"{file}: is not the map that {what}: its checksum differs", file)

    def add(self, one: Part | Results) -> None:
        """Add what a document says."""
        self.items += one.items
        self.tables += one.tables

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


_SHARE = 4
"""Of the memory that may be used the part that grids may take which are kept."""
_ROWS = 512
_NO_LIMIT = 1 << 62


@dataclass(frozen=True)
class Opened:
    """What there is to know of a file with a grid."""

    path: Path
    kind: type[Any]
    files: tuple[Path, ...]
    sums: Mapping[str, str]
    heard: tuple[str, ...]


class Grids:
    """The grids of files, as many of them in memory as there is room for."""

    # Within a ``with`` block: those that are read row by row stay open until its end.

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        limit, _ = memory_limit()
        self._room = _NO_LIMIT if limit is None else limit // _SHARE
        self._stack = ExitStack()
        self._opened: dict[Path, Opened] = {}
        self._kept: OrderedDict[Path, Grid] = OrderedDict()
        self._made: tuple[tuple[Path, int], Layer] | None = None

    def __enter__(self) -> Grids:
        return self

    def __exit__(self, *_: object) -> None:
        self._kept.clear()
        self._made = None
        self._stack.close()

    @property
    def files(self) -> tuple[Path, ...]:
        return tuple(file for opened in self._opened.values() for file in opened.files)

    def open(self, path: Path, *, quietly: bool = False) -> Opened:
        """Read a file for the first time; what reading warns of is given, unless `quietly`."""
        if path not in self._opened:
            texts: list[str] = []
            with ExitStack() as stack:
                if quietly:
                    stack.enter_context(kept_warnings())
                stack.enter_context(heard(texts))
                read = stack.enter_context(sums_of_reads())
                grid, file = self._read(path)
                sums = file.sums_by_name(read)
            self._keep(path, grid)
            self._opened[path] = Opened(path, type(grid), file.files, sums, tuple(texts))
        return self._opened[path]

    def is_there(self, path: Path, draft: Draft, what: str, *, quietly: bool = False) -> bool:
        """Open a file as `open` does; if it cannot be read, warn that `what` is not shown."""
        try:
            self.open(path, quietly=quietly)
        except MapdealError as error:
            draft.lacks(what, path, error)
            return False
        return True

    def grid(self, path: Path) -> Grid:
        """Return the grid of a file that was opened."""
        # A `FileAccessError` if it has changed since.
        if path not in self._kept:
            with kept_warnings(), sums_of_reads() as read:  # they were given when it was opened
                grid, file = self._read(path)
                sums = file.sums_by_name(read)
            if sums != self._opened[path].sums:
                raise FileAccessError(CHANGED, source=path)
            self._keep(path, grid)
        self._kept.move_to_end(path)
        return self._kept[path]

    def layers(self, path: Path, name: str, title: str) -> list[PageLayer]:
        """Return the layers of a page that the grid of a file becomes, read when asked for."""
        grid = self.grid(path)
        return [
            self._reread(kind.of(grid, name, title), path, index)
            for index, kind in enumerate(kinds_of(grid))
        ]

    def _read(self, path: Path) -> tuple[Grid, MapFile]:
        """Return the grid in a file, by rows if the whole would take too much memory."""
        settings = self.settings
        with ExitStack() as stack:
            file = stack.enter_context(
                open_map(path, dialect=settings.dialect, max_cells=settings.max_cells)
            )
            is_npz = path.suffix.lower() == ".npz"
            if is_npz and holds_reach(path):
                return read_reach(path, max_cells=settings.max_cells), file
            if file.memory_to_read() <= self._room:
                return file.read().grid, file
            if is_npz:
                opened = open_npz(path, block_height=_ROWS, max_cells=settings.max_cells)
                return self._stack.enter_context(opened), file
            if file.shape_by_rows is None:
                return file.read().grid, file
            self._stack.enter_context(stack.pop_all())
            return file.by_rows(block_height=_ROWS).grid, file

    def _reread(self, layer: PageLayer, path: Path, index: int) -> PageLayer:
        if is_lazy(layer.values):
            return layer

        def rows(some: slice) -> Any:
            if self._made is None or self._made[0] != (path, index):
                grid = self.grid(path)
                self._made = (path, index), kinds_of(grid)[index].values(grid)
            return self._made[1][some]

        values = lazy_layer(layer.frame.shape, layer.values.dtype, rows, block_height=_ROWS)
        return replace(layer, values=values)

    def _keep(self, path: Path, grid: Grid) -> None:
        """Keep a grid, and let those go that were asked for longest ago."""
        self._kept[path] = grid
        held = {one: 0 if own.is_lazy else bytes_of(own) for one, own in self._kept.items()}
        while len(held) > 1 and sum(held.values()) > self._room:
            del held[self._kept.popitem(last=False)[0]]
