"""``mapdeal unpack``: a bit map as an ordinary map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.commands.pack import unpack_file
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("image", "max_cells", "force", "threads", "max_memory")
def unpack(
    source: Annotated[
        Path, typer.Argument(metavar="IN.pbm", help="A bit map, with its .yaml in the same folder.")
    ],
    output: opt.GridOutput,
    *,
    settings: Settings,
) -> None:
    """Convert a bit map to an ordinary map: 1 is occupied, 0 free."""
    say_written(output, unpack_file(source, output, settings))
