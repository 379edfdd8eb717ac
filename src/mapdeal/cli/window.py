"""``mapdeal window``: a part of a map."""

from __future__ import annotations

from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.stage_command import file_options, say_written
from mapdeal.editing.window import window as window_of
from mapdeal.pipeline.edit import change_file

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
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
    image: opt.Image = None,
    dialect: opt.Dialect = opt.DialectName.nav2,
    max_cells: opt.MaxCells = None,
    force: opt.Force = False,
    threads: opt.Threads = None,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Copy a part of a map, or more than the map.

    What lies beyond the map is unknown. The window is laid along the map's own axes and begins
    with the cell that holds its lower left corner, so that cells keep their places.
    """
    opt.start(quiet=quiet, verbose=verbose)
    region = opt.region(size, at, corner)
    files = file_options(dialect, max_cells, force, threads, image)
    figures = change_file(
        source,
        output,
        files,
        lambda grid: window_of(grid, default=default, **region),
        what="window",
    )
    say_written(output, figures, with_origin=True)
