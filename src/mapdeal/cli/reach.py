"""``mapdeal reach``: where a robot can go on a map, and what stops it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.streams import FROM_STDIN
from mapdeal.errors import MalformedInputError
from mapdeal.formats.points import read_named_points
from mapdeal.formats.source import chunks_of
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import Goal
from mapdeal.pipeline.figures import summary_of
from mapdeal.pipeline.reach import check_reached, reach_file
from mapdeal.pipeline.settings import Settings
from mapdeal.robot.parameters import RobotParameters
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
    start: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="X,Y[,YAW]",
            help="The start, metres and radians; without a yaw every heading that is open "
            "there.  [default: the widest place of the largest open area]",
        ),
    ] = None,
    goals: Annotated[
        list[str] | None,
        typer.Option(
            "--to",
            metavar="[NAME=]X,Y",
            help="A goal, metres; more may follow.",
        ),
    ] = None,
    points: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|-",
            help="Goals in lines [NAME=]x,y or of JSON, from a file, or - for standard input.",
        ),
    ] = None,
    headings: Annotated[
        int | None,
        opt.stage_option(reach_stage, "headings", "Headings of a robot with corners, 4..255."),
    ] = None,
    through_unknown: Annotated[
        bool, typer.Option("--through-unknown", help="Open unknown cells.")
    ] = False,
    margin: Annotated[
        float | None,
        opt.stage_option(
            reach_stage, "margin",
            "Passages that leave less than this on either side of the robot are told, too."),
    ] = None,
    min_area: Annotated[
        float | None,
        opt.stage_option(
            reach_stage, "min_area", "Passages that cut off less than this are not told."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="OUT.json", help="Write the answer to a file."),
    ] = None,
    layers: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT.npz",
            help="Write reachable, headings, clearance and widest of every cell.",
        ),
    ] = None,
    lethal_threshold: Annotated[
        int | None,
        opt.stage_option(
            reach_stage, "lethal_threshold", "Of a map: occupancy of an obstacle, 1..100."),
    ] = None,
    *,
    settings: Settings,
    footprint: Footprint | None,
    robot: RobotParameters | None,
) -> None:  # fmt: skip
    """Tell where a robot can go from a start, and which passages stop it.

    A round robot fits where the nearest obstacle is farther away than its radius; one with corners
    is tried in many headings. Unknown cells are closed. Without -o the answer is printed, as
    JSON: areas, whether each goal can be reached, by how wide a robot, and what limits that; and
    the passages where the robot is stopped, or all but stopped. Exit 1 if a goal cannot be reached.
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
        terminal.warn(
            "no robot is given, by --robot-radius, --footprint or --params-file: the answer is "
            "that of a point; widest_radius_m tells how large a round robot may be"
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
    if start is None:
        x, y = report.reach.start[:2]
        terminal.warn(
            f"no start is given: it is {x:.10g},{y:.10g}, the widest place of the largest open area"
        )
    if output is None:
        terminal.result(report.text)
    else:
        terminal.summary([f"{output}: {summary_of(report.reach.figures())}"])
    check_reached(report.reach, source)


def _goal_of(text: str) -> Goal:
    name, equals, place = text.rpartition("=")
    x, y = opt.pair(place, "--to")
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
