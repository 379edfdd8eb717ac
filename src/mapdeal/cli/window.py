"""``mapdeal window``: a part of a map."""

from __future__ import annotations

from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.editing.window import window as window_of
from mapdeal.grid.region import region_of
from mapdeal.pipeline.edit import change_file
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("files")
def window(
    source: opt.MapArgument,
    output: opt.GridOutput,
    size: opt.Size,
    at: opt.At = None,
    corner: opt.Corner = None,
    default: Annotated[
        int | None,
        typer.Option(
            metavar="V",
            help="Value of cells beyond the map.  [default: unknown, -1 of a map, 255 of costs]",
        ),
    ] = None,
    *,
    settings: Settings,
) -> None:
    """Copy a part of a map, or more than the map.

    What lies beyond the map is unknown. The window is laid along the map's own axes and begins
    with the cell that holds its lower left corner, so that cells keep their places.
    """
    region = opt.region(size, at, corner)
    figures = change_file(
        source,
        output,
        settings,
        lambda grid: window_of(grid, default=default, **region),
        what="window",
        cells=lambda grid: region_of(grid.frame, **region).cells,
    )
    say_written(output, figures, with_origin=True)
