"""``mapdeal convert``: a map, costmap or field in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.stage_command import file_options
from mapdeal.pipeline.figures import summary_of
from mapdeal.pipeline.single import convert_file

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
def convert(
    source: opt.MapArgument,
    output: Annotated[
        Path,
        opt.output_argument(
            "OUT", "The result: .yaml or .pgm (a pgm pair), .png (a png pair), or .npz."
        ),
    ],
    encoding: Annotated[
        opt.EncodingName | None,
        typer.Option(
            help="Pixels of a costmap: what ROS would publish, or costmap_2d's bytes.  "
            "[default: occupancy]",
        ),
    ] = None,
    mode: Annotated[
        opt.ModeName | None,
        typer.Option(
            help="How values become pixels.  [default: raw if a value lies in 1..99, else trinary]",
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
    """Write a map, costmap or field in another format."""
    opt.start(quiet=quiet, verbose=verbose)
    files = file_options(dialect, max_cells, force, threads, image)
    figures = convert_file(
        source,
        output,
        files,
        encoding=encoding.value if encoding else None,
        mode=mode.value if mode else None,
    )
    size = f"{figures['width']} x {figures['height']}"
    terminal.summary([f"{output}: {size} cells, {summary_of(figures)}"])
