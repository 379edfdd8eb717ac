"""``mapdeal active``: the part of a map that anything is known of."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import run_stage
from mapdeal.pipeline.settings import Settings
from mapdeal.stages.active import active_region

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("files", "max_memory")
def active(
    source: opt.MapArgument,
    output: Annotated[Path, opt.output_argument("OUT", "The result: .yaml (with .pgm) or .npz.")],
    margin: Annotated[
        float | None,
        opt.stage_option(active_region, "margin", "Metres to grow the box by.", metavar="M"),
    ] = None,
    canvas: Annotated[
        str | None,
        opt.stage_option(active_region, "canvas", "Crop, or blank the rest of the full canvas."),
    ] = None,
    min_component: Annotated[
        int | None,
        opt.stage_option(
            active_region,
            "min_component",
            "Known cells in smaller groups don't count for the box.",
            metavar="CELLS",
        ),
    ] = None,
    *,
    settings: Settings,
) -> None:
    """Cut out the known part of a map, its active region."""
    parameters = opt.given(margin=margin, canvas=canvas, min_component=min_component)
    run_stage("active", source, output, parameters, settings)
