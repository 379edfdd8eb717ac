"""``mapdeal cost``: a costmap from a map or from its distance field."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import run_stage
from mapdeal.errors import ParameterError
from mapdeal.formats.map_writer import Encoding
from mapdeal.grid.footprint import Footprint
from mapdeal.pipeline.settings import Settings
from mapdeal.stages.exponential_cost import exponential_cost
from mapdeal.stages.ring_cost import ring_cost
from mapdeal.stages.threshold_cost import threshold_cost

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options(
    "robot", "inflate_unknown", "inflate_around_unknown", "down", "up", "down_factor", "up_factor",
    "view", "view_range", "values", "lethal_threshold", "mask", "encoding", "files", "max_memory",
)  # fmt: skip
def cost(
    source: Annotated[
        Path, typer.Argument(metavar="MAP|ESDF.npz", help="A map, or the distance field of one.")
    ],
    output: Annotated[Path, opt.output_argument("OUT", "The costs: .yaml (with .pgm) or .npz.")],
    model: Annotated[
        str, typer.Option(metavar="exponential|threshold|rings", help="The rule of the costs.")
    ] = "exponential",
    inscribed_radius: Annotated[
        float | None,
        opt.stage_option(
            exponential_cost,
            "inscribed_radius",
            "exponential: cost 253 up to here.",
            metavar="M",
        ),
    ] = None,
    inflation_radius: Annotated[
        float | None,
        opt.stage_option(
            exponential_cost, "inflation_radius", "exponential: costs reach this far.", metavar="M"
        ),
    ] = None,
    cost_scaling_factor: Annotated[
        float | None,
        opt.stage_option(
            exponential_cost,
            "cost_scaling_factor",
            "exponential: steepness, per metre.",
            metavar="K",
        ),
    ] = None,
    inflate_unknown: Annotated[
        bool | None,
        opt.stage_option(
            exponential_cost, "inflate_unknown", "exponential: unknown cells take any cost."
        ),
    ] = None,
    inflate_around_unknown: Annotated[
        bool | None,
        opt.stage_option(
            exponential_cost,
            "inflate_around_unknown",
            "exponential: unknown cells are lethal and spread costs.",
        ),
    ] = None,
    down: Annotated[
        float | None,
        opt.stage_option(
            threshold_cost, "down", "threshold: view values up to here cost 0.", metavar="V"
        ),
    ] = None,
    up: Annotated[
        float | None,
        opt.stage_option(threshold_cost, "up", "threshold: end of the middle range.", metavar="V"),
    ] = None,
    down_factor: Annotated[
        float | None,
        opt.stage_option(
            threshold_cost, "down_factor", "threshold: factor of the middle range.", metavar="K"
        ),
    ] = None,
    up_factor: Annotated[
        float | None,
        opt.stage_option(
            threshold_cost, "up_factor", "threshold: factor of the near range.", metavar="K"
        ),
    ] = None,
    view: Annotated[
        str | None,
        opt.stage_option(threshold_cost, "view", "threshold: how distances become 0..100."),
    ] = None,
    view_range: Annotated[
        float | None,
        opt.stage_option(
            threshold_cost, "view_range", "threshold: where the metric view is 0.", metavar="M"
        ),
    ] = None,
    values: Annotated[
        str | None,
        opt.stage_option(
            ring_cost, "values", "rings: cost of each ring of cells, inside out.", metavar="N,N,..."
        ),
    ] = None,
    lethal_threshold: Annotated[
        int | None,
        opt.stage_option(
            exponential_cost,
            "lethal_threshold",
            "Occupancy of an obstacle, 1..100; 100 for a map, a field's own for a field.",
            metavar="N",
        ),
    ] = None,
    mask: Annotated[
        Path | None,
        typer.Option(
            metavar="MASK", help="A keepout mask, a map: costs are nowhere below its values."
        ),
    ] = None,
    encoding: Annotated[
        Encoding,
        typer.Option(help="Pixels of a .yaml: what ROS would publish, or costmap_2d's bytes."),
    ] = "occupancy",
    *,
    settings: Settings,
    footprint: Footprint | None,
) -> None:
    """Turn a map or its distance field into a costmap."""
    if footprint is not None and model != "exponential":
        rule = "only costs of model exponential depend on the robot's shape"
        raise ParameterError(rule, source="--model", got=model)
    if footprint is not None and inscribed_radius is not None:
        rule = "cannot be given together with a robot's shape"
        raise ParameterError(rule, source="--inscribed-radius")
    parameters = opt.given(
        model=model,
        inscribed_radius=footprint.inscribed_radius if footprint else inscribed_radius,
        circumscribed_radius=footprint.circumscribed_radius if footprint else None,
        inflation_radius=inflation_radius,
        cost_scaling_factor=cost_scaling_factor,
        inflate_unknown=inflate_unknown,
        inflate_around_unknown=inflate_around_unknown,
        down=down,
        up=up,
        down_factor=down_factor,
        up_factor=up_factor,
        view=view,
        view_range=view_range,
        values=values,
        lethal_threshold=lethal_threshold,
    )
    run_stage("cost", source, output, parameters, settings, encoding=encoding, mask=mask)
