"""``mapdeal pack``: the obstacles of a map in one bit a cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.stage_command import file_options, say_written
from mapdeal.pipeline.bits import pack_file

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
def pack(
    source: opt.MapArgument,
    output: Annotated[
        Path, opt.output_argument("OUT.pbm", "The bit map; its .yaml is written beside it.")
    ],
    lethal_threshold: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            max=100,
            help="Occupancy of an obstacle, 1..100; 100 for a map, a field's own for a field.",
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
    """Write the obstacles of a map as a bit map (PBM P4)."""
    opt.start(quiet=quiet, verbose=verbose)
    files = file_options(dialect, max_cells, force, threads, image)
    say_written(output, pack_file(source, output, files, lethal_threshold=lethal_threshold))
