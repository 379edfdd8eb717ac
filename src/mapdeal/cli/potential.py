"""``mapdeal potential``: the artificial potential field."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import run_stage
from mapdeal.pipeline.settings import Settings
from mapdeal.stages.potential import potential as potential_stage

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("files", "max_memory")
def potential(
    source: opt.MapArgument,
    output: Annotated[Path, opt.output_argument("OUT.npz", "The field, with all its layers.")],
    goal: Annotated[
        str | None,
        opt.stage_option(
            potential_stage, "goal", "Attraction to a point of the map frame.", metavar="X,Y"
        ),
    ] = None,
    attractive_gain: Annotated[
        float | None,
        opt.stage_option(
            potential_stage, "attractive_gain", "Factor of the distance to the goal.", metavar="K"
        ),
    ] = None,
    repulsive_gain: Annotated[
        float | None,
        opt.stage_option(potential_stage, "repulsive_gain", "Factor of repulsion.", metavar="K"),
    ] = None,
    repulsive_cap: Annotated[
        float | None,
        opt.stage_option(
            potential_stage, "repulsive_cap", "The most that repulsion can be.", metavar="V"
        ),
    ] = None,
    lethal_threshold: Annotated[
        int | None,
        opt.stage_option(
            potential_stage,
            "lethal_threshold",
            "Occupancy of an obstacle, 1..100.  [default: 100, or the field's]",
            metavar="N",
        ),
    ] = None,
    *,
    settings: Settings,
) -> None:
    """Compute repulsion from all obstacles, and attraction to a goal.

    Repulsion is the sum of 1 / distance to every obstacle cell. MAP may also be a distance
    field, whose obstacles then count.
    """
    parameters = opt.given(
        goal=None if goal is None else opt.pair(goal, "--goal"),
        attractive_gain=attractive_gain,
        repulsive_gain=repulsive_gain,
        repulsive_cap=repulsive_cap,
        lethal_threshold=lethal_threshold,
    )
    run_stage("potential", source, output, parameters, settings)
