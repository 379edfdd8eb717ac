"""``mapdeal report``: one page of runs, maps, and what was found out about them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.commands.report import LARGEST_PAGE, write_report
from mapdeal.files.budget import size_text
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("dialect", "max_cells", "force", "threads", "max_memory")
def report(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="PATH...",
            help="Folders of runs or batches; maps, fields and costs; JSON of lint, reach, "
            "route, diff, align and score; shapes.",
        ),
    ],
    output: Annotated[Path, opt.output_argument("OUT.html", "Page to write.")],
    title: str | None = None,
    max_size: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE",
            help="Size of the page, like 25M: maps that would make it larger are shown in larger "
            f"cells.  [default: {size_text(LARGEST_PAGE)}]",
        ),
    ] = None,
    *,
    settings: Settings,
) -> None:
    """Write one HTML page about runs, maps, findings and routes.

    The page is a single file that needs no network: all layers to zoom and pan, with the values
    under the pointer; findings, passages and routes in their places; parameters, figures and
    checksums. Several maps become a table with thumbnails.

    Each run and each map is an entry of its own. The map that a run was made from joins that run;
    a field or costmap joins the entry named before it, if it covers the same cells. JSON of reach
    and route, and shapes, belong to the entry named before them; findings of lint belong to the
    maps that they name; a diff shows its two maps one over the other.

    Options
    -------
    --title TEXT: Title of the page.  [default: the map's name]
    """
    size = LARGEST_PAGE if max_size is None else opt.size_of(max_size, "--max-size")
    made = write_report(paths, output, settings, title=title, size=size)
    terminal.summary([f"{output}: {made.text}"])
