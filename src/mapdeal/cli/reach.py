"""``mapdeal reach``: where a robot can go on a map, and what stops it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.streams import FROM_STDIN
from mapdeal.commands.reach import check_reached, reach_file
from mapdeal.errors import MalformedInputError, ParameterError, emit_warning
from mapdeal.files.source import chunks_of
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import Goal
from mapdeal.pipeline.folder import summary_of
from mapdeal.pipeline.settings import Settings
from mapdeal.ros.robot import RobotParameters
from mapdeal.sensors.points import read_named_points
from mapdeal.stages.reach import reach as reach_stage

app = typer.Typer(rich_markup_mode=None, add_completion=False)

_STDIN = Path("-")


@app.command()
@shared_options("robot", "files")
def reach(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MAP",
            help=f"A map, a distance field of one, or costs (.npz). {opt.OR_STDIN}",
        ),
        FROM_STDIN,
    ],
    start: Annotated[str | None, typer.Option("--from")] = None,
    goals: Annotated[list[str] | None, typer.Option("--to")] = None,
    points: Annotated[
        Path | None, opt.points_option("File of goals, one [NAME=]x,y or JSON object per line")
    ] = None,
    headings: Annotated[
        int | None,
        opt.stage_option(reach_stage, "headings", "Number of headings for a robot with "
                                                  "corners, 4..255."),
    ] = None,
    through_unknown: bool = False,
    margin: Annotated[
        float | None,
        opt.stage_option(
            reach_stage, "margin",
            "Also report passages that leave less than this on either side of the robot, metres."),
    ] = None,
    min_area: Annotated[
        float | None,
        opt.stage_option(
            reach_stage, "min_area", "Leave out passages that cut off less than this, square "
                                     "metres."),
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o")] = None,
    layers: Path | None = None,
    lethal_threshold: Annotated[
        int | None,
        opt.stage_option(
            reach_stage, "lethal_threshold", "With a map: least occupancy of an obstacle, "
                                             "1..100."),
    ] = None,
    *,
    settings: Settings,
    footprint: Footprint | None,
    robot: RobotParameters | None,
) -> None:  # fmt: skip
    """Show where a robot can go from a start, and which passages stop it.

    A round robot fits where the nearest obstacle is farther away than its radius; a robot with
    corners is tried in many headings. Unknown cells and all that lies outside the map are closed.
    Without -o the result is printed
    as JSON: areas; for each goal, whether it can be reached, by how wide a robot, and what limits
    it; and the passages that stop the robot, or nearly do. Exit code 1 if a goal cannot be
    reached.

    Options
    -------
    --through-unknown: Treat unknown cells as free.
    --layers OUT.npz: Write reachable, headings, clearance and widest for every cell.
    --from X,Y[,YAW]: Start, metres and radians; without a yaw, every heading that is free there.
        [default: the widest place of the largest free area]
    --to [NAME=]X,Y: Goal, metres; more may follow.
    --output OUT.json: Write the result to a file.
    """
    parameters = opt.given(
        headings=headings, margin=margin, min_area=min_area, lethal_threshold=lethal_threshold
    )
    if through_unknown:
        parameters["through_unknown"] = True
    if start is not None:
        form = "X,Y,YAW" if start.count(",") > 1 else "X,Y"
        parameters["start"] = tuple(opt.numbers(start, form.count(",") + 1, form, "--from"))
    if footprint is None and robot is None:
        emit_warning(
            "no robot is given, by --robot-radius, --footprint or --params-file: the result is "
            "that of a point; widest_radius_m is the radius of the largest round robot"
        )
    asked = [_goal_of(text) for text in goals or []]
    if points is not None:
        asked += _goals_in(points)
    report = reach_file(
        source,
        output,
        settings,
        layers=layers,
        robot=robot,
        footprint=footprint,
        parameters={**parameters, "goals": tuple(asked)},
        also_read=() if points in (None, _STDIN) else (points,),
    )
    terminal.answer(output, report.text, summary_of(report.reach.figures()))
    check_reached(report.reach, source)


def _goal_of(text: str) -> Goal:
    name, equals, place = text.rpartition("=")
    x, y = opt.pair(place, "--to")
    if "," in name:  # several goals that are joined by commas would be one with an odd name
        rule = "must be [NAME=]X,Y, and a name has no comma"
        hint = "several goals are separated by blanks: --to kitchen=3,-4 lab=9,4"
        raise ParameterError(rule, source="--to", got=text, hint=hint)
    return Goal(x, y, name if equals else None)


def _goals_in(path: Path) -> list[Goal]:
    """Return the points of a file; a line that holds none is an error."""
    chunks = terminal.input_chunks() if path == _STDIN else chunks_of(path)
    name = "standard input" if path == _STDIN else path
    found: list[Goal] = []
    for one in read_named_points(chunks, name):
        if one.point is None:
            raise MalformedInputError(one.error or "", source=name, place=f"line {one.line}")
        found.append(Goal(*one.point, one.name))
    if not found:
        raise MalformedInputError("holds no points", source=name)
    return found
