"""``mapdeal shift``: a map of the same size at another origin."""

from __future__ import annotations

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.commands.edit import edit_file
from mapdeal.editing.window import shift_origin
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("files")
def shift(
    source: opt.MapArgument,
    output: opt.GridOutput,
    origin: str,
    default: int | None = None,
    *,
    settings: Settings,
) -> None:
    """Move the window of a map or costmap to a new origin.

    As costmap_2d's updateOrigin: cells that both windows have in common are kept. The new origin
    is the corner of the cell that contains the given point.

    Options
    -------
    --origin X,Y: New origin, metres; the map moves by whole cells.
    --default V: Value of new cells.  [default: unknown: -1 for a map, 255 for costs]
    """
    to = opt.pair(origin, "--origin")
    shown = "unknown" if default is None else default
    terminal.detail(f"shift: origin {to[0]:.10g}, {to[1]:.10g}, default {shown}")
    figures = edit_file(
        source,
        output,
        settings,
        lambda grid: shift_origin(grid, to, default=default),
        what="shifted",
    )
    say_written(output, figures, with_origin=True)
