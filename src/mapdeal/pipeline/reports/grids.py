"""Grids of files: read when they are asked for, and let go when others need the room."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from mapdeal.errors import FileAccessError, kept_warnings
from mapdeal.formats.budget import memory_limit
from mapdeal.formats.maps import MapFile, open_map
from mapdeal.formats.npz import Grid, holds_reach, open_npz, read_reach
from mapdeal.formats.source import CHANGED, sums_of_reads
from mapdeal.kernels.blocks import Layer, is_lazy, lazy_layer
from mapdeal.pipeline.heard import heard
from mapdeal.pipeline.memory import bytes_of
from mapdeal.pipeline.settings import Settings
from mapdeal.records import dataclass
from mapdeal.report.document import PageLayer
from mapdeal.report.layers import kinds_of

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

    def is_lazy(self, path: Path) -> bool:
        """Return whether a file that was opened is read row by row."""
        return self.grid(path).is_lazy

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
