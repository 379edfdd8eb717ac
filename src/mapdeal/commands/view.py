"""``mapdeal view``: a report, made in a temporary place and opened in the browser."""

from __future__ import annotations

import webbrowser
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

from mapdeal.command import Result, Words, command
from mapdeal.commands.info import maps_in
from mapdeal.commands.report import ENDINGS, WrittenReport, write_report
from mapdeal.files import source, transaction
from mapdeal.pipeline.inputs import InShell
from mapdeal.records import dataclass


@dataclass(frozen=True, repr=False)
class Viewed(Result):
    path: Path
    is_opened: bool
    is_wanted: bool
    report: WrittenReport | None = None  # unless the page was there already

    def document(self) -> dict[str, Any]:
        return {"path": str(self.path), "opened": self.is_opened}

    def lines(self) -> Iterator[str]:
        yield str(self.path)

    def remarks(self) -> Iterator[str]:
        if self.is_wanted and not self.is_opened:
            yield "no browser was found; open the page by hand"

    def check(self) -> None:
        if self.report is not None:
            self.report.check()


@command(
    group="Questions about a map",
    shared=("dialect", "resolution", "origin", "max_cells", "threads", "max_memory"),
    example="""\
mapdeal view examples/maps/office.yaml --no-browser
mapdeal run examples/maps/office.yaml -o out
mapdeal view out/office --no-browser""",
)
def view(
    sources: Annotated[Sequence[Path], Words("MAP|RUN|REPORT...", typed=list[Path])], *,
    browser: bool = True, work: InShell,
) -> Viewed:  # fmt: skip
    """Show maps, runs and results in the browser.

    Writes the page that `mapdeal report` writes to a temporary folder, and opens it. An existing
    report is opened unchanged. If a verdict on the page is Problem, the exit code is 1.

    Parameters
    ----------
    sources : sequence of path
        Maps, folders of runs, JSON of reach, route, lint or diff; or one report.
    browser : bool
        Open the page; otherwise only its path is printed.
    """
    for path in sources:
        source.status_of(path)
    paths = [path for folder in sources for path in maps_in(folder, work)]
    report: WrittenReport | None = None
    # maps come first, then the JSON that belongs to them
    first, *following = sorted(paths, key=lambda path: path.suffix.lower() == ".json")
    if first.suffix.lower() in ENDINGS and not following:
        page = source.absolute_path(first)
    else:
        name = first.name if source.is_folder(first) else first.stem
        page = transaction.lasting_folder() / f"{name or 'report'}.html"
        limits: Any = {key: getattr(work.settings, key) for key in ("dialect", "max_cells")}
        report = write_report(page, [first, *following], **limits)
    return Viewed(page, browser and webbrowser.open(page.as_uri()), browser, report)
