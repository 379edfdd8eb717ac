"""``mapdeal unpack``: a bit map as an ordinary map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.stage_command import file_options, say_written
from mapdeal.pipeline.bits import unpack_file

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
def unpack(
    source: Annotated[
        Path, typer.Argument(metavar="IN.pbm", help="A bit map with its .yaml beside it.")
    ],
    output: opt.GridOutput,
    image: opt.Image = None,
    max_cells: opt.MaxCells = None,
    force: opt.Force = False,
    threads: opt.Threads = None,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Write a bit map as an ordinary map: 1 is occupied, 0 free."""
    opt.start(quiet=quiet, verbose=verbose)
    files = file_options(opt.DialectName.nav2, max_cells, force, threads, image)
    say_written(output, unpack_file(source, output, files))
