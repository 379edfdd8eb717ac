"""mapdeal route."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.streams import FROM_STDIN
from mapdeal.commands.route import (
    HEURISTIC_WEIGHT,
    PLACES_OF_FIELD,
    Heuristic,
    PairsReport,
    check_reached,
    compare_pairs,
    route_file,
)
from mapdeal.errors import ParameterError
from mapdeal.files.source import chunks_of
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.route import Method, Route
from mapdeal.pipeline.settings import Settings
from mapdeal.ros.robot import RobotParameters
from mapdeal.sensors.points import PairLine, read_pairs
from mapdeal.stages.potential import potential as potential_stage

_STDIN = Path("-")

_COLUMNS = {
    "mean clearance": ("mean_clearance", "{:.3f} m"),
    "min clearance": ("min_clearance", "{:.3f} m"),
    "length": ("length", "{:.2f} m"),
    "cost": ("cost", "{:.2f}"),
    "expanded": ("expanded", "{:.0f}"),
}


def report_on_pairs(
    source: Path,
    pairs: Path,
    output: Path | None,
    settings: Settings,
    *,
    methods: Sequence[str],
    footprint: Footprint | None,
    robot: RobotParameters | None,
    weights: Mapping[str, Any],
    of_field: Mapping[str, Any],
) -> None:
    """Find the routes, print or write a line for each, and print what they are on the mean."""
    name = "standard input" if pairs == _STDIN else pairs
    for option, method in (("field_weight", "cost"), ("heuristic_weight", "heuristic")):
        if option in of_field and method not in methods:
            rule = f"needs {method} among the methods of --compare"
            raise ParameterError(rule, source=f"--{option.replace('_', '-')}")
    report = compare_pairs(
        source, _asked(pairs, name), output, settings, asked_from=name, methods=methods,
        footprint=footprint, robot=robot, weights=weights, **of_field, show=_show,
    )  # fmt: skip
    if output is not None:
        terminal.summary([f"{output}: {report.pairs} pairs by {', '.join(methods)}"])
    terminal.remark(_table(report))
    report.check(name)


def _asked(path: Path, name: Path | str) -> Iterator[PairLine]:
    """Yield the pairs as long as there is somebody to read the answers."""
    chunks = terminal.input_chunks() if path == _STDIN else chunks_of(path)
    for pair in read_pairs(chunks, name):
        if not terminal.is_read():
            return
        yield pair


def _show(line: str) -> None:
    terminal.result(line)
    terminal.flush()


def _table(report: PairsReport) -> list[str]:
    """Return the means of each method's routes, as lines."""
    if not report.reached:
        return []
    plural = "s" if report.reached > 1 else ""
    rows = [[f"means of {report.reached} pair{plural}", *_COLUMNS]]
    rows += [
        [f"  {method}", *(_text(form, figures[key]) for key, form in _COLUMNS.values())]
        for method, figures in report.means.items()
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.rjust(width) if index else cell.ljust(width)
            for index, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]


def _text(form: str, value: float) -> str:
    return form.format(value) if math.isfinite(value) else "-"


app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("robot", "files")
def route(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MAP", help=f"Costs (.npz), or a map to make costs of. {opt.OR_STDIN}"
        ),
        FROM_STDIN,
    ],
    start: Annotated[str | None, typer.Option("--from")] = None,
    goal: Annotated[str | None, typer.Option("--to")] = None,
    pairs: Path | None = None,
    compare: Annotated[
        str | None,
        typer.Option(
            metavar="METHOD,...",
            help="With --pairs: search without the distance field (plain), with it in the cost, "
            "or in the heuristic.  "
            f"[default: {','.join(PLACES_OF_FIELD)}]",
        ),
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o")] = None,
    method: Method = "astar",
    through_unknown: bool = False,
    cost_travel_multiplier: float = 2.0,
    field_weight: float | None = None,
    heuristic: Heuristic | None = None,
    heuristic_weight: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Penalty of the heuristic field at an obstacle, metres.  "
            f"[default: {HEURISTIC_WEIGHT:g}]",
        ),
    ] = None,
    attractive_gain: Annotated[
        float | None,
        opt.stage_option(
            potential_stage, "attractive_gain", "descent: weight of the distance to the goal."),
    ] = None,
    repulsive_gain: Annotated[
        float | None,
        opt.stage_option(
            potential_stage, "repulsive_gain", "descent: weight of the repulsion."),
    ] = None,
    repulsive_cap: Annotated[
        float | None,
        opt.stage_option(
            potential_stage, "repulsive_cap", "descent: upper bound of the repulsion."),
    ] = None,
    *,
    settings: Settings,
    footprint: Footprint | None,
    robot: RobotParameters | None,
) -> None:  # fmt: skip
    """Find a route between two points.

    Lethal, inscribed and unknown cells are closed. A map gets the costs of --params-file, or else
    those of the recipe nav2; the shape of a robot replaces its radius of 0.22 m. Without -o the
    result is printed as JSON. With --pairs, one line of JSON is printed for each pair and method,
    and their means on stderr.

    Options
    -------
    --pairs FILE|-: File of starts and goals, one x,y,x,y or JSON object per line; - reads standard
        input. Instead of --from and --to.
    --method: Cheapest route (astar), or steepest descent of the potential (descent).
    --through-unknown: Treat unknown cells as free, at the highest cost.
    --cost-travel-multiplier K: Weight of costs against length.
    --field-weight W: astar: weight of the distance field in the cost, within 2 m of obstacles.
        [default: 0; with --pairs, in the cost: 1]
    --heuristic: astar: estimate of the remaining cost: the octile distance, or that plus a penalty
        within 2 m of obstacles (field).  [default: octile]
    --from X,Y: Start, metres.
    --to X,Y: Goal, metres.
    --output OUT.json: Write the result to a file; with --pairs a .jsonl.
    """
    gains = opt.given(
        attractive_gain=attractive_gain, repulsive_gain=repulsive_gain, repulsive_cap=repulsive_cap
    )
    of_field = opt.given(field_weight=field_weight, heuristic_weight=heuristic_weight)
    weights: dict[str, object] = {
        "cost_travel_multiplier": cost_travel_multiplier,
        "through_unknown": through_unknown,
    }
    if pairs is not None:
        one = opt.given(**{"from": start, "to": goal}, heuristic=heuristic, **gains)
        _refuse(one, "applies to one route, not to --pairs")
        if method != "astar":
            raise ParameterError("compares routes of --method astar", source="--pairs")

        report_on_pairs(
            source,
            pairs,
            output,
            settings,
            methods=compare.split(",") if compare is not None else PLACES_OF_FIELD,
            footprint=footprint,
            robot=robot,
            weights=weights,
            of_field=of_field,
        )
        return
    _refuse(opt.given(compare=compare), "needs --pairs")
    if start is None or goal is None:
        raise ParameterError("both are required, or --pairs", source="--from, --to")
    if method == "astar":
        _refuse(gains, "does not apply to --method astar")
    else:
        _refuse(opt.given(**of_field, heuristic=heuristic), f"does not apply to --method {method}")
    if heuristic == "field":
        of_field.setdefault("heuristic_weight", HEURISTIC_WEIGHT)
    elif heuristic_weight is not None:
        raise ParameterError("needs --heuristic field", source="--heuristic-weight")
    report = route_file(
        source,
        output,
        settings,
        start=opt.pair(start, "--from"),
        goal=opt.pair(goal, "--to"),
        method=method,
        footprint=footprint,
        robot=robot,
        weights={**weights, **of_field},
        gains=gains,
    )
    terminal.answer(output, report.text, _summary_of(report.route))
    check_reached(report.route, source)


def _refuse(options: dict[str, object], rule: str) -> None:
    for name in options:
        raise ParameterError(rule, source=f"--{name.replace('_', '-')}")


def _summary_of(route: Route) -> str:
    if not len(route.points_xy):
        return "not reached"
    text = f"{route.length:.2f} m, cost {route.cost:.2f}, {len(route.points_xy)} points"
    if math.isfinite(route.min_clearance):
        text += f", at least {route.min_clearance:.2f} m from obstacles"
        text += f", {route.mean_clearance:.2f} m on average"
    return text if route.reached else f"not reached: {text}"
