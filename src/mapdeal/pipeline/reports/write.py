"""A report as a file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from mapdeal.errors import BatchError, ParameterError
from mapdeal.formats.budget import size_text
from mapdeal.formats.transaction import Transaction
from mapdeal.grid.display import count_text
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.reports.gather import gathered
from mapdeal.pipeline.reports.grids import Grids
from mapdeal.pipeline.settings import DEFAULT_SETTINGS, Settings
from mapdeal.records import dataclass
from mapdeal.report.page import page_of

LARGEST_PAGE = 25_000_000
"""Bytes of a page: what goes into an e-mail."""

_SMALLEST_PAGE = 100_000
_ENDINGS = (".html", ".htm")


@dataclass(frozen=True)
class Made:
    """What has become of a report."""

    path: Path
    entries: int
    size: int

    @property
    def text(self) -> str:
        return f"{count_text(self.entries, 'map')}, {size_text(self.size)}"


def write_report(
    paths: Sequence[Path],
    output: Path,
    settings: Settings = DEFAULT_SETTINGS,
    *,
    title: str | None = None,
    size: int = LARGEST_PAGE,
    inputs: Sequence[Path] = (),
) -> Made:
    """Write one page of what is at some paths, see `gathered`.

    Parameters
    ----------
    paths : sequence of Path
        What it is of.
    output : Path
        The page, ``.html``.
    settings : Settings
        How files are read and written.
    title : str, optional
        What stands above all.
    size : int
        Bytes that the page may have; maps that would make it larger are shown in larger cells.
    inputs : sequence of Path
        Maps that join the runs that were made of them.

    Raises
    ------
    MapdealError
        If a path cannot be read, or the output exists; nothing is changed then.
    """
    if output.suffix.lower() not in _ENDINGS:
        raise ParameterError("the page must end in .html", source=output)
    if size < _SMALLEST_PAGE:
        rule = f"must be at least {size_text(_SMALLEST_PAGE)}"
        raise ParameterError(rule, place="max_size", got=size)
    with settings.memory(), use_threads(settings.threads), Grids(settings) as grids:
        report = gathered(paths, grids, title=title, inputs=inputs)
        with Transaction(
            [output], inputs=[*paths, *grids.files], force=settings.force
        ) as transaction:
            sizes: list[int] = []
            transaction.write_parts(output, _measured(page_of(report, size=size), sizes))
    return Made(output, len(report.entries), sum(sizes))


def _measured(parts: Iterable[bytes], sizes: list[int]) -> Iterator[bytes]:
    for part in parts:
        sizes.append(len(part))
        yield part


@contextmanager
def reported(
    page: Path,
    paths: Sequence[Path],
    inputs: Sequence[Path],
    settings: Settings,
    *,
    on_made: Callable[[Made], object],
) -> Iterator[None]:
    """Write a page of the runs that are made within a ``with`` block, even if some have failed."""
    # `on_made` is called with it.
    settings = replace(settings, force=True)
    try:
        yield
    except BatchError:
        on_made(write_report(paths, page, settings, inputs=inputs))
        raise
    on_made(write_report(paths, page, settings, inputs=inputs))
