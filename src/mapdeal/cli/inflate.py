"""``mapdeal inflate``: obstacles grown by the robot's radius."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.stage_command import file_options, run_stage
from mapdeal.errors import ParameterError
from mapdeal.stages.inflate import inflate as inflate_stage

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
def inflate(
    source: opt.MapArgument,
    output: Annotated[Path, opt.output_argument("OUT", "The result: .yaml (with .pgm) or .npz.")],
    radius: Annotated[
        float | None,
        opt.stage_option(inflate_stage, "radius", "Metres to grow obstacles by.", metavar="M"),
    ] = None,
    footprint: opt.FootprintText = None,
    robot_radius: opt.RobotRadius = None,
    footprint_padding: opt.FootprintPadding = 0.0,
    robot_16_gon: opt.Robot16Gon = False,
    kernel: Annotated[
        str | None,
        opt.stage_option(inflate_stage, "kernel", "Grow to a disc, or to a square of cells."),
    ] = None,
    lethal_threshold: Annotated[
        int | None,
        opt.stage_option(
            inflate_stage, "lethal_threshold", "Occupancy of an obstacle, 1..100.", metavar="N"
        ),
    ] = None,
    inflate_unknown: Annotated[
        bool | None,
        opt.stage_option(inflate_stage, "inflate_unknown", "Whether unknown cells are covered."),
    ] = None,
    image: opt.Image = None,
    dialect: opt.Dialect = opt.DialectName.nav2,
    max_cells: opt.MaxCells = None,
    force: opt.Force = False,
    threads: opt.Threads = None,
    max_memory: opt.MaxMemory = None,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Grow obstacles by a radius or by a robot's shape."""
    opt.start(quiet=quiet, verbose=verbose)
    shape = opt.robot_shape(footprint, robot_radius, footprint_padding, as_16_gon=robot_16_gon)
    if shape is not None and radius is not None:
        raise ParameterError("cannot be given together with a robot's shape", source="--radius")
    parameters = opt.given(
        radius=radius,
        footprint=shape,
        kernel=kernel,
        lethal_threshold=lethal_threshold,
        inflate_unknown=inflate_unknown,
    )
    files = file_options(dialect, max_cells, force, threads, image, max_memory)
    run_stage("inflate", source, output, parameters, files)
