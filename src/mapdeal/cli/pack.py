"""``mapdeal pack``: the obstacles of a map in one bit a cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.commands.pack import pack_file
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("files")
def pack(
    source: opt.MapArgument,
    output: Annotated[Path, opt.output_argument("OUT.pbm", "Bit map to write, with its .yaml.")],
    lethal_threshold: Annotated[int | None, typer.Option(min=1, max=100)] = None,
    *,
    settings: Settings,
) -> None:
    """Write the obstacles of a map as a bit map (PBM P4).

    Options
    -------
    --lethal-threshold N: Occupancy of an obstacle, 1..100; 100 for a map, a field's own for a
        field.
    """
    say_written(output, pack_file(source, output, settings, lethal_threshold=lethal_threshold))
