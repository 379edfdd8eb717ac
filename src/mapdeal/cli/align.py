"""``mapdeal align``: where one map lies in the frame of another."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.streams import FROM_STDIN, TO_STDOUT
from mapdeal.commands.align import AlignReport, align_files
from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Transform
from mapdeal.mapping.transforms import check_pose
from mapdeal.pipeline.settings import Settings
from mapdeal.stages.definition import is_plain

_DECIMALS = 4

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options(
    "files", help_texts={"image": "Write a picture of the first map, placed on the second."}
)
def align(
    first: Annotated[
        Path,
        typer.Argument(metavar="A", help=f"The map to place: .yaml, .pbm or .npz. {opt.OR_STDIN}"),
        FROM_STDIN,
    ],
    second: Annotated[
        Path,
        typer.Argument(metavar="B", help="The map to place it on; one of the two can be -."),
        FROM_STDIN,
    ],
    output: Annotated[
        Path | None,
        opt.output_argument("OUT.json", "Write the transform and the figures as JSON."),
        TO_STDOUT,
    ] = None,
    prior: str | None = None,
    rotation: str | None = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
    *,
    settings: Settings,
) -> None:
    """Find where a map lies in the frame of another map of the same place.

    The transform brings points of A into the frame of B: p_b = R(yaw) p_a + (x, y). Size,
    resolution, origin and yaw of the maps may differ, the maps may overlap only in part, and
    things may have moved. Exit code 0 if the match is certain; 1 if the walls agree too little, or
    nearly as well elsewhere.

    Options
    -------
    --prior X,Y,YAW: Rough transform, metres and radians: only places within 30 degrees and 5 m of
        it are searched.
    --rotation DEG,...: Rotations to search, degrees, such as 0,90,180,270, each with a tolerance
        of 3 degrees.
    """
    report = align_files(
        first,
        second,
        settings,
        output=output,
        prior=None if prior is None else _prior(prior),
        rotations=None if rotation is None else _rotations(rotation),
    )
    terminal.document(report, None if as_json else _lines(first, second, report))
    if not report.found.same_place:
        raise typer.Exit(1)


def _prior(text: str) -> Transform:
    return Transform(*check_pose(opt.numbers(text, 3, "X,Y,YAW", "--prior"), "--prior"))


def _rotations(text: str) -> list[float]:
    parts = text.split(",")
    try:
        if not is_plain(text):
            raise ValueError
        turns = [math.radians(float(part)) for part in parts]
    except ValueError:
        rule = "must be degrees such as 0,90,180,270"
        raise ParameterError(rule, source="--rotation", got=text) from None
    if not all(map(math.isfinite, turns)):
        raise ParameterError("must be finite", source="--rotation", got=text)
    return turns


def _lines(first: Path, second: Path, report: AlignReport) -> list[str]:
    found = report.found
    verdict = "the same place" if found.same_place else f"not sure: {found.reason}"
    lines = [f"{first}, {second}: {verdict}"]
    if found.score == 0 and not found.same_place and found.overlap == 0:
        return lines
    lines.append(f"  transform  {_told(found.transform)}")
    lines.append(f"  score      {found.score:.2f}{_elsewhere(report)}")
    lines.append(
        f"  overlap    {100 * found.overlap:.0f} % of the free space of the map that has less"
    )
    lines.append(
        f"  walls      {100 * found.agreement:.0f} % of those in common agree within 0.25 m"
    )
    return lines


def _elsewhere(report: AlignReport) -> str:
    found = report.found
    if found.runner_up_transform is None:
        return ", and no other place was found"
    return f", the best place elsewhere {found.runner_up:.2f}: {_told(found.runner_up_transform)}"


def _told(transform: Transform) -> str:
    x, y, yaw = (round(value, _DECIMALS) + 0.0 for value in transform.pose)  # there is no -0
    degrees = round(math.degrees(transform.yaw), 2) + 0.0
    return f"x {x:.3f} m, y {y:.3f} m, yaw {yaw:.4f} rad ({degrees:.2f} degrees)"
