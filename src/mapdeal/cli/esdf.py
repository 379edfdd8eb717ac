"""``mapdeal esdf``: the signed distance field."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import run_stage, say_written
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import make_step
from mapdeal.stages.esdf import esdf as esdf_stage
from mapdeal.stages.esdf import field_view

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("files", "max_memory", "scheduler")
def esdf(
    source: opt.MapArgument,
    output: Annotated[
        Path,
        opt.output_argument(
            "OUT", "The field as .npz, as a bare .npy, or its 0..100 view as .yaml (with .pgm)."
        ),
    ],
    unknown: Annotated[
        str | None, opt.stage_option(esdf_stage, "unknown", "What unknown cells count as.")
    ] = None,
    convention: Annotated[
        str | None,
        opt.stage_option(esdf_stage, "convention", "Where zero lies; see the documentation."),
    ] = None,
    max_distance: Annotated[
        float | None,
        opt.stage_option(esdf_stage, "max_distance", "Clip both signs to this.", metavar="M"),
    ] = None,
    lethal_threshold: Annotated[
        int | None,
        opt.stage_option(
            esdf_stage, "lethal_threshold", "Occupancy of an obstacle, 1..100.", metavar="N"
        ),
    ] = None,
    strength: Annotated[
        float | None,
        opt.stage_option(esdf_stage, "strength", "Factor of positive distances.", metavar="K"),
    ] = None,
    view: Annotated[
        str | None, opt.stage_option(field_view, "view", "How distances become 0..100.")
    ] = None,
    view_range: Annotated[
        float | None,
        opt.stage_option(field_view, "view_range", "Where the metric view is 0.", metavar="M"),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="tcp://HOST:PORT",
            help="Have the workers of this dask scheduler compute an .npy, each some slabs of "
            "rows at a time.  [needs mapdeal[cluster]]",
        ),
    ] = None,
    *,
    settings: Settings,
) -> None:
    """Compute the exact signed distance field of a map."""
    parameters = opt.given(
        unknown=unknown,
        convention=convention,
        max_distance=max_distance,
        lethal_threshold=lethal_threshold,
        strength=strength,
        view=view,
        view_range=view_range,
    )
    if scheduler is None:
        run_stage("esdf", source, output, parameters, settings)
        return
    from mapdeal.pipeline.block_jobs import apply_by_workers  # slow to import

    figures = apply_by_workers(
        source.absolute(), output.absolute(), make_step("esdf", parameters), settings, scheduler
    )
    say_written(output, figures)
