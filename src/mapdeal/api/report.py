"""One page of runs, maps, and what was found out about them, as ``mapdeal report`` makes it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from mapdeal.commands.report import LARGEST_PAGE
from mapdeal.commands.report import write_report as write_page
from mapdeal.errors import ParameterError
from mapdeal.grid.display import OneLine
from mapdeal.maps.map_yaml import Dialect
from mapdeal.pipeline.settings import Settings, is_whole

File = str | PathLike[str]


@dataclass(frozen=True, repr=False)
class WrittenReport(OneLine):
    """Result of `write_report`.

    Parameters
    ----------
    path : Path
        Path of the page.
    maps : int
        Number of maps on the page.
    size : int
        File size, bytes.
    """

    path: Path
    maps: int
    size: int

    def _told(self) -> Iterator[str]:
        yield str(self.path)
        yield "1 map" if self.maps == 1 else f"{self.maps} maps"
        yield f"{self.size} bytes"


def write_report(
    path: File,
    sources: File | Sequence[File],
    *,
    title: str | None = None,
    max_size: int = LARGEST_PAGE,
    dialect: Dialect = "nav2",
    max_cells: int | None = None,
    force: bool = False,
    threads: int | None = None,
    max_memory: int | None = None,
) -> WrittenReport:
    """Write a single HTML page about runs, maps and the results for them.

    Parameters
    ----------
    path : path or str
        Output path, ``.html``. Missing folders are created.
    sources : path or str, or a sequence of them
        Folders of runs or batches; maps, fields and costs; JSON from lint, reach, route, diff,
        align and score; shapes. They are combined as by ``mapdeal report``.
    title : str, optional
        Title of the page; by default the map's name if there is only one map.
    max_size : int
        Maximum size of the page, bytes; maps that would exceed it are shown with larger cells.
    dialect, max_cells, max_memory
        As for `read_map`.
    force : bool
        Whether to replace an existing file.
    threads : int, optional
        Number of threads; by default one per core.

    Returns
    -------
    WrittenReport
        Path and size of the page, and the number of maps on it.

    Raises
    ------
    FileAccessError
        If a source cannot be read, a folder contains no run, or the page already exists or cannot
        be written. No file is changed then.
    MalformedInputError
        If a source is malformed.
    ParameterError
        If a document belongs to none of the maps, or an argument is invalid.

    Warns
    -----
    MapdealWarning
        If something is missing or does not match; the page shows the same warning.
    """
    if title is not None and not isinstance(title, str):
        raise ParameterError("must be a text", place="title", got=title)
    if not is_whole(max_size):
        raise ParameterError("must be a whole number of bytes", place="max_size", got=max_size)
    settings = Settings(
        dialect=dialect, max_cells=max_cells, force=force, threads=threads, max_memory=max_memory
    )
    named = [sources] if isinstance(sources, str | PathLike) else sources
    paths = [Path(one) for one in named]
    if not paths:
        raise ParameterError("needs at least one", place="sources")
    made = write_page(paths, Path(path), settings, title=title, size=max_size)
    return WrittenReport(made.path, made.entries, made.size)
