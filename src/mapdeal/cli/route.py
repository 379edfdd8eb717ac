"""``mapdeal route``: a way through a map."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.errors import ParameterError
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.route import Method, Route
from mapdeal.pipeline.route import check_reached, route_file
from mapdeal.pipeline.settings import Settings
from mapdeal.stages.potential import potential as potential_stage

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("robot", "files")
def route(
    source: Annotated[
        Path, typer.Argument(metavar="MAP", help="Costs (.npz), or a map to make costs of.")
    ],
    start: Annotated[str, typer.Option("--from", metavar="X,Y", help="The start, metres.")],
    goal: Annotated[str, typer.Option("--to", metavar="X,Y", help="The goal, metres.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="OUT.json", help="Write the answer to a file."),
    ] = None,
    method: Annotated[
        Method,
        typer.Option(help="The cheapest route, or the one that the potential leads down."),
    ] = "astar",
    through_unknown: Annotated[
        bool, typer.Option("--through-unknown", help="Open unknown cells, at the highest cost.")
    ] = False,
    cost_travel_multiplier: Annotated[
        float, typer.Option(metavar="K", help="How much costs count against length.")
    ] = 2.0,
    field_weight: Annotated[
        float | None,
        typer.Option(
            metavar="W",
            help="astar: how much nearness to obstacles, within 2 m, counts on top.  [default: 0]",
        ),
    ] = None,
    attractive_gain: Annotated[
        float | None,
        opt.stage_option(
            potential_stage, "attractive_gain", "descent: factor of the distance to the goal."),
    ] = None,
    repulsive_gain: Annotated[
        float | None,
        opt.stage_option(
            potential_stage, "repulsive_gain", "descent: factor of repulsion."),
    ] = None,
    repulsive_cap: Annotated[
        float | None,
        opt.stage_option(
            potential_stage, "repulsive_cap", "descent: the most that repulsion can be."),
    ] = None,
    *,
    settings: Settings,
    footprint: Footprint | None,
) -> None:  # fmt: skip
    """Find a route from point to point.

    Lethal, inscribed and unknown cells are closed. A map gets the costs of the recipe nav2; the
    shape of a robot replaces its radius of 0.22 m. Without -o the answer is printed, as JSON.
    """
    gains = opt.given(
        attractive_gain=attractive_gain, repulsive_gain=repulsive_gain, repulsive_cap=repulsive_cap
    )
    _refuse_options_of_others(method, gains, field_weight)
    weights: dict[str, object] = {
        "cost_travel_multiplier": cost_travel_multiplier,
        "through_unknown": through_unknown,
        **opt.given(field_weight=field_weight),
    }
    report = route_file(
        source,
        output,
        settings,
        start=opt.pair(start, "--from"),
        goal=opt.pair(goal, "--to"),
        method=method,
        footprint=footprint,
        weights=weights,
        gains=gains,
    )
    if output is None:
        terminal.result(report.text)
    else:
        terminal.summary([f"{output}: {_summary_of(report.route)}"])
    check_reached(report.route, source)


def _refuse_options_of_others(
    method: Method, gains: dict[str, object], field_weight: float | None
) -> None:
    names = list(gains) if method == "astar" else []
    if method == "descent" and field_weight is not None:
        names = ["field_weight"]
    for name in names:
        option = f"--{name.replace('_', '-')}"
        raise ParameterError(f"is not for --method {method}", source=option)


def _summary_of(route: Route) -> str:
    if not len(route.points_xy):
        return "not reached"
    text = f"{route.length:.2f} m, cost {route.cost:.2f}, {len(route.points_xy)} points"
    if math.isfinite(route.min_clearance):
        text += f", at least {route.min_clearance:.2f} m from obstacles"
    return text if route.reached else f"not reached: {text}"
