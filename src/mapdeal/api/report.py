"""One page of runs, maps, and what was found out about them, as ``mapdeal report`` makes it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from os import PathLike
from pathlib import Path

from mapdeal.errors import ParameterError
from mapdeal.formats.map_yaml import Dialect
from mapdeal.grid.display import OneLine
from mapdeal.pipeline.reports.write import LARGEST_PAGE
from mapdeal.pipeline.reports.write import write_report as write_page
from mapdeal.pipeline.settings import Settings, is_whole
from mapdeal.records import dataclass

File = str | PathLike[str]


@dataclass(frozen=True, repr=False)
class WrittenReport(OneLine):
    """A page that was written.

    Parameters
    ----------
    path : Path
        The page.
    maps : int
        How many maps it shows.
    size : int
        Bytes.
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
    """Write one HTML page of runs, maps, and what was found out about them.

    Parameters
    ----------
    path : path or str
        The page, ``.html``. Folders that are missing are made.
    sources : path or str, or a sequence of them
        Folders of runs or batches; maps, fields and costs; JSON of lint, reach, route, diff,
        align and score; shapes. How they come together is that of ``mapdeal report``.
    title : str, optional
        What stands above all; the map's name if there is one map.
    max_size : int
        Bytes that the page may have; maps that would make it larger are shown in larger cells.
    dialect, max_cells, max_memory
        As of `read_map`.
    force : bool
        Whether to replace a file that exists.
    threads : int, optional
        Threads to use; all processors if not given.

    Returns
    -------
    WrittenReport
        The page, how many maps it shows, and its size.

    Raises
    ------
    FileAccessError
        If a source cannot be read or a folder holds no run, or the page exists already or cannot
        be written; nothing is changed then.
    MalformedInputError
        If a source is malformed.
    ParameterError
        If a document belongs to no map, or an argument is not allowed.

    Warns
    -----
    MapdealWarning
        Of what is missing or does not match; the page says it, too.
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
