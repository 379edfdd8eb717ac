"""``mapdeal query``: what a distance field says of points, and costs of a robot at poses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.streams import FROM_STDIN
from mapdeal.commands.query import Answers, answers_at_poses, answers_of, costs_to_ask, field_to_ask
from mapdeal.errors import FindingError, ParameterError, emit_warning
from mapdeal.files.source import chunks_of
from mapdeal.grid.footprint import Footprint, FootprintRule
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.settings import Settings
from mapdeal.ros.robot import RobotParameters
from mapdeal.sensors.points import NumberLines, read_points, read_pose_lines
from mapdeal.stages.esdf import esdf as esdf_stage

app = typer.Typer(rich_markup_mode=None, add_completion=False)

_STDIN = Path("-")
_TURN = 2 * math.pi


class _Kind(NamedTuple):
    """What is asked for: points, or poses."""

    name: str
    what: str
    form: str
    read: Callable[[Iterable[bytes], Path | str], Iterator[NumberLines]]


_POINTS = _Kind("points", "point", "X,Y", read_points)
_POSES = _Kind("poses", "pose", "X,Y,YAW", read_pose_lines)


@app.command()
@shared_options(
    "footprint",
    "robot_radius",
    "footprint_padding",
    "params_file",
    "costmap",
    "namespace",
    "dialect",
    "max_cells",
    "threads",
    "max_memory",
    help_texts={
        "footprint": "Report the cost of a robot at poses: its corners around its centre, metres.",
        "robot_radius": "The same for a round robot, metres: a polygon of 16 corners as in "
        "costmap_2d.",
        "params_file": "The same for a robot's own parameters: a Nav2 file, or ROS 1's costmap "
        "files, which also define the costs of a map.",
        "strict": "Exit with 1 if a point or a robot lies outside the map, or if there is a "
        "warning.",
    },
)
def query(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MAP",
            help="A distance field (.npz), or a map to make one of; for a footprint costs (.npz), "
            f"or a map. {opt.OR_STDIN}",
        ),
        FROM_STDIN,
    ],
    at: list[str] | None = None,
    points: Annotated[
        Path | None, opt.points_option("File of points, one x,y or JSON object per line")
    ] = None,
    poses: Annotated[
        Path | None,
        opt.points_option("With a footprint: file of poses, one x,y,yaw, TUM line or "
                          "JSON object per line"),
    ] = None,
    rule: FootprintRule | None = None,
    unknown: Annotated[
        str | None, opt.stage_option(esdf_stage, "unknown", "With a map: what unknown cells "
                                                            "count as.")
    ] = None,
    convention: Annotated[
        str | None, opt.stage_option(esdf_stage, "convention", "With a map: where the distance "
                                                               "is zero.")
    ] = None,
    lethal_threshold: Annotated[
        int | None,
        opt.stage_option(
            esdf_stage, "lethal_threshold", "With a map: least occupancy of an obstacle, 1..100."),
    ] = None,
    *,
    footprint: Footprint | None,
    robot: RobotParameters | None,
    settings: Settings,
) -> None:  # fmt: skip
    """Report distances and gradients at points, or a robot's cost at poses.

    Prints one line of JSON for each, in order. Distances and gradients are interpolated between
    the centres of cells. The gradient points away from obstacles, in the map frame. The cost of a
    robot is that of its footprint in Nav2's collision checker.

    Options
    -------
    --at X,Y[,YAW]: Point, metres, or with a footprint a pose; more may follow.
    --rule: With a footprint: cells that count, the outline as in Nav2, or full, with those inside.
        [default: outline]
    """
    parameters = opt.given(
        unknown=unknown, convention=convention, lethal_threshold=lethal_threshold
    )
    if robot is not None:
        _refuse({f"--{name.replace('_', '-')}": one for name, one in parameters.items()},
                "cannot be given together with --params-file")  # fmt: skip
        robot = robot if footprint is None else robot.with_shape(footprint)
        footprint = robot.footprint
    if footprint is None:
        need = "needs --footprint, --robot-radius or --params-file"
        _refuse({"--poses": poses, "--rule": rule}, need)
        kind, file = _POINTS, points
    else:
        _refuse({"--points": points}, "has no yaws; poses of a footprint are given by --poses")
        _refuse({"--convention": convention}, "applies to distances, not to a footprint")
        kind, file = _POSES, poses
    if not at and file is None:
        raise ParameterError("one of the two is required", source=f"--at, --{kind.name}")
    first = _of_options(at or [], kind)
    answer: Callable[[Any], Answers]
    if footprint is None:
        answer = partial(answers_of, field_to_ask(source, settings, parameters))
    else:
        costs = costs_to_ask(source, settings, parameters, robot)
        answer = partial(answers_at_poses, costs, footprint, rule=rule or "outline")
    with use_threads(settings.threads):
        _answer_all(_asked(first, file, kind), answer, kind, file, source, strict=settings.strict)


def _answer_all(
    asked: Iterator[Any],
    answer: Callable[[Any], Answers],
    kind: _Kind,
    file: Path | None,
    source: Path,
    *,
    strict: bool,
) -> None:
    """Print the answers as they come, and say at the end what was odd."""
    count = outside = bad = turned = 0
    for some in asked:
        answers = answer(some)
        if answers.count:
            terminal.result(answers.text.removesuffix("\n"))
        terminal.flush()
        count += answers.count
        outside += answers.outside
        bad += len(some.errors)
        turned += _more_than_a_turn(some) if kind is _POSES else 0
        if not terminal.is_read():
            break
    terminal.detail(f"{count} {kind.name}, {outside} of them outside of the map")
    if bad:
        emit_warning(f"{_name_of(file)}: {bad} of {count} hold no finite {kind.what}")
    if turned:
        emit_warning(f"{turned} of {count} poses have a yaw of more than a turn; is it in degrees?")
    if strict and outside:
        rule = f"{outside} of {count} {kind.name} are not inside of the map"
        raise FindingError(rule, source=source)


def _more_than_a_turn(some: NumberLines) -> int:
    return int(np.count_nonzero(np.abs(some.numbers[:, 2]) > _TURN))


def _refuse(options: Mapping[str, object], why: str) -> None:
    for name, value in options.items():
        if value is not None:
            raise ParameterError(why, source=name)


def _of_options(at: list[str], kind: _Kind) -> Any:
    width = kind.form.count(",") + 1
    try:
        numbers = [opt.numbers(text, width, kind.form, "--at") for text in at]
    except ParameterError as error:
        if kind is _POINTS and any(text.count(",") > 1 for text in at):
            error.hint = "a pose X,Y,YAW is asked for a robot, by --footprint or --robot-radius"
        raise
    rows = np.array(numbers, dtype=np.float64).reshape(-1, width)
    finite = np.isfinite(rows).all(axis=1)
    errors = {k: f"must be finite, got {at[k]}" for k in np.flatnonzero(~finite).tolist()}
    return NumberLines(rows, [0] * len(at), errors)


def _asked(first: Any, path: Path | None, kind: _Kind) -> Iterator[Any]:
    if first.lines:
        yield first
    if path is not None:
        chunks = terminal.input_chunks() if path == _STDIN else chunks_of(path)
        yield from kind.read(chunks, _name_of(path))


def _name_of(path: Path | None) -> Path | str:
    if path is None:
        return "--at"
    return "standard input" if path == _STDIN else path
