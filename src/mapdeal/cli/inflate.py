"""``mapdeal inflate``: obstacles grown by the robot's radius."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import run_stage
from mapdeal.errors import ParameterError
from mapdeal.grid.footprint import Footprint
from mapdeal.pipeline.settings import Settings
from mapdeal.stages.inflate import inflate as inflate_stage

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("robot", "kernel", "lethal_threshold", "inflate_unknown", "files", "max_memory")
def inflate(
    source: opt.MapArgument,
    output: Annotated[Path, opt.output_argument("OUT", "The result: .yaml (with .pgm) or .npz.")],
    radius: Annotated[
        float | None,
        opt.stage_option(inflate_stage, "radius", "Metres to grow obstacles by.", metavar="M"),
    ] = None,
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
    *,
    settings: Settings,
    footprint: Footprint | None,
) -> None:
    """Grow obstacles by a radius or by a robot's shape."""
    if footprint is not None and radius is not None:
        raise ParameterError("cannot be given together with a robot's shape", source="--radius")
    parameters = opt.given(
        radius=radius,
        footprint=footprint,
        kernel=kernel,
        lethal_threshold=lethal_threshold,
        inflate_unknown=inflate_unknown,
    )
    run_stage("inflate", source, output, parameters, settings)
