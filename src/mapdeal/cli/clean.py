"""``mapdeal clean``: a map without specks, pinholes and islands of free space."""

from __future__ import annotations

from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.commands.clean import clean_file
from mapdeal.editing.clean import MIN_FREE, MIN_HOLE, MIN_OBSTACLE, CleanCounts, Patches
from mapdeal.grid.display import count_text
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)

_OFF = "0 or 1 for none"


@app.command()
@shared_options("files", help_texts={"image": "Write a picture of the changed cells."})
def clean(
    source: opt.MapArgument,
    output: opt.GridOutput,
    min_obstacle: Annotated[
        int,
        typer.Option(
            metavar="CELLS",
            min=0,
            help=f"Remove obstacles with fewer cells from free space; {_OFF}.",
        ),
    ] = MIN_OBSTACLE,
    min_hole: Annotated[
        int,
        typer.Option(
            metavar="CELLS",
            min=0,
            help="Fill unknown areas with fewer cells that only free cells, or only occupied "
            f"cells, surround; {_OFF}.",
        ),
    ] = MIN_HOLE,
    min_free: Annotated[
        int,
        typer.Option(
            metavar="CELLS",
            min=0,
            help=f"Make free areas with fewer cells unknown, except the largest; {_OFF}.",
        ),
    ] = MIN_FREE,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
    *,
    settings: Settings,
) -> None:
    """Remove small components, pinholes and islands of free space.

    No wall is opened: an obstacle is removed only if all cells around it are free, and a hole is
    filled only if all cells around it are free or all are occupied. Values 1..99 stay.
    """
    if as_json:
        terminal.need_stdout("--json")
    limits = {"min_obstacle": min_obstacle, "min_hole": min_hole, "min_free": min_free}
    report = clean_file(source, output, settings, limits)
    if as_json:
        terminal.document(report, None)
        return
    say_written(output, report.cleaned.grid.figures())
    terminal.summary(_lines(report.cleaned.counts))


def _lines(counts: CleanCounts) -> list[str]:
    filled = f"{_told(counts.free_holes)} are now free, {_told(counts.wall_holes)} occupied"
    return [
        f"  pinholes          {filled}",
        f"  islands           {_told(counts.islands)} are now unknown",
        f"  small components  {_told(counts.specks)} are now free",
        f"  changed           {count_text(counts.changed, 'cell')}",
    ]


def _told(patches: Patches) -> str:
    return f"{patches.components} ({count_text(patches.cells, 'cell')})"
