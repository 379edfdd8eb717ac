"""``mapdeal rescale``: a map with larger or smaller cells."""

from __future__ import annotations

from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.commands.edit import rescale_file
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("files")
def rescale(
    source: opt.MapArgument,
    output: opt.GridOutput,
    resolution: Annotated[float, typer.Option(metavar="R", help="Side of the new cells, metres.")],
    rule: opt.Rule = "area",
    *,
    settings: Settings,
) -> None:
    """Write a map or costmap with larger or smaller cells.

    Origin and yaw stay, and the new cells cover the whole map. With the rule area no obstacle is
    lost in a coarser map; nearest takes the value at the centre of each new cell.
    """
    terminal.detail(f"rescale: resolution {resolution:.10g} m, rule {rule}")
    figures = rescale_file(source, output, settings, resolution, rule=rule)
    say_written(output, figures, with_origin=True)
