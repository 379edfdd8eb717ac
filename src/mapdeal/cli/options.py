"""Options that several commands share, and the one way to make a stage's options."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from mapdeal.cli import terminal
from mapdeal.errors import ParameterError
from mapdeal.grid.footprint import Footprint
from mapdeal.stages.parameters import parameters_of


class DialectName(StrEnum):
    """The readers whose reading of images can be followed."""

    nav2 = "nav2"
    humble = "humble"
    ros1 = "ros1"


class EncodingName(StrEnum):
    """What pixels of costs can hold."""

    occupancy = "occupancy"
    costmap2d = "costmap2d"


class ScaleName(StrEnum):
    """The scales that values can be converted to."""

    occupancy = "occupancy"
    costmap2d = "costmap2d"
    amcl = "amcl"


class ModeName(StrEnum):
    """How values can become pixels."""

    trinary = "trinary"
    scale = "scale"
    raw = "raw"


MapArgument = Annotated[
    Path, typer.Argument(metavar="MAP", help="A map_server .yaml, or an .npz of mapdeal's.")
]
Dialect = Annotated[
    DialectName,
    typer.Option(help="Whose reading of the image: nav2 (jazzy and newer), humble, or ros1."),
]
MaxCells = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=1,
        help="Refuse larger images before memory is taken.  "
        "[default: 2e8 for compressed images, 1e9 for others]",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace outputs that exist.")]
Threads = Annotated[
    int | None,
    typer.Option(metavar="N", min=1, help="Threads to use.  [default: all processors]"),
]
MaxMemory = Annotated[
    str | None,
    typer.Option(
        metavar="SIZE",
        help="Memory to take, like 4G or 500M; maps that need more are worked on by slabs of "
        "rows.  [default: half of what is free]",
    ),
]
Image = Annotated[
    Path | None, typer.Option(metavar="FILE.png", help="Write a picture of the result, too.")
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Say nothing but errors and asked-for results.")
]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Say what is read and done.")]
FootprintText = Annotated[
    str | None,
    typer.Option(
        "--footprint", metavar="[[X,Y],...]", help="The robot's corners around its centre."
    ),
]
RobotRadius = Annotated[
    float | None, typer.Option(metavar="M", help="The radius of a round robot.")
]
Robot16Gon = Annotated[
    bool,
    typer.Option(
        "--robot-16-gon/--no-robot-16-gon",
        help="Take a round robot as costmap_2d does, as a polygon of 16 corners.  [default: no]",
        show_default=False,
    ),
]
FootprintPadding = Annotated[
    float, typer.Option(metavar="M", help="Move the shape's edges outwards; ROS pads by 0.01.")
]


_COUNTS = {2: "two", 3: "three"}

Size = Annotated[
    str, typer.Option(metavar="WX,WY", help="Metres along the columns and along the rows.")
]
At = Annotated[str | None, typer.Option(metavar="X,Y", help="The middle, in the map frame.")]
Corner = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y",
        help="Or the corner at its first cell, in the map frame: the lower left one, if the map "
        "has no yaw.",
    ),
]


def output_argument(metavar: str, help_text: str) -> Any:
    """Return the option -o of a command."""
    return typer.Option("--output", "-o", metavar=metavar, help=help_text)


GridOutput = Annotated[
    Path, output_argument("OUT", "The result: .yaml or .pgm (a pgm pair), .png (a pair), or .npz.")
]


def stage_option(
    function: Callable[..., Any], name: str, help_text: str, *, metavar: str | None = None
) -> Any:
    """Return the option of a stage's parameter: its name with dashes, its default shown.

    The option's own default is None, "not given": the value stands in the stage's signature.
    """
    parameter = parameters_of(function)[name]
    dashed = name.replace("_", "-")
    default = parameter.default
    name_on_line = f"--{dashed}"
    if parameter.kind is bool:
        name_on_line = f"--{dashed}/--no-{dashed}"
        default = "yes" if default else "no"
    elif parameter.choices:
        metavar = "|".join(parameter.choices)
    elif isinstance(default, tuple):
        default = ",".join(str(value) for value in default)
    shown = "" if default is None else f"  [default: {default}]"
    return typer.Option(name_on_line, metavar=metavar, help=help_text + shown, show_default=False)


def given(**options: object) -> dict[str, object]:
    """Return the options that were given on the command line."""
    return {name: value for name, value in options.items() if value is not None}


def robot_shape(
    text: str | None, radius: float | None, padding: float, *, as_16_gon: bool
) -> Footprint | None:
    """Return the robot's shape that the options describe, if they do."""
    if as_16_gon and radius is None:
        raise ParameterError("needs --robot-radius", source="--robot-16-gon")
    if text is not None and radius is not None:
        rule = "cannot be given together with --robot-radius"
        raise ParameterError(rule, source="--footprint")
    if text is not None:
        return Footprint.parse(text).padded(padding)
    if radius is not None:
        shape = Footprint.sixteen_gon(radius) if as_16_gon else Footprint.circle(radius)
        return shape.padded(padding)
    if padding:
        rule = "needs --footprint or --robot-radius"
        raise ParameterError(rule, source="--footprint-padding")
    return None


def pair(text: str, name: str) -> tuple[float, float]:
    """Return the two numbers of an option written ``X,Y``."""
    x, y = numbers(text, 2, "X,Y", name)
    return x, y


def size_of(text: str, name: str) -> int:
    """Return a number of bytes: ``500M`` and ``4GiB`` are of 1024, ``4GB`` of 1000.

    Raises
    ------
    ParameterError
        If it is none; the error calls it `name`.
    """
    form = r"([0-9]{1,9}(?:\.[0-9]*)?)\s*([kmgt]?)(i?b)?"
    match = re.fullmatch(form, text.strip(), re.IGNORECASE)
    if match is None:
        raise ParameterError("must be a size such as 4G or 500M", place=name, got=text)
    number, unit, ending = float(match[1]), match[2].lower(), (match[3] or "").lower()
    size = int(number * (1000 if ending == "b" else 1024) ** " kmgt".index(unit or " "))
    if size < 1:
        raise ParameterError("must be above 0", place=name, got=text)
    return size


def numbers(text: str, count: int, form: str, name: str) -> list[float]:
    """Return the numbers of an option that is written like `form`."""
    try:
        if not text.isascii() or "_" in text:  # which Python reads as digits, too
            raise ValueError
        values = [float(part) for part in text.split(",")]
        if len(values) != count:
            raise ValueError
    except ValueError:
        rule = f"must be {_COUNTS[count]} numbers {form}"
        raise ParameterError(rule, source=name, got=text) from None
    return values


def region(size: str, at: str | None, corner: str | None) -> dict[str, Any]:
    """Return a region of a grid as functions on grids take it."""
    place = f"at {at}" if corner is None else f"corner {corner}"
    terminal.detail(f"region: {place}, size {size}")
    if at is not None and corner is not None:
        raise ParameterError("cannot be given together with --corner", source="--at")
    if at is not None:
        return {"size_xy": pair(size, "--size"), "center_xy": pair(at, "--at")}
    if corner is not None:
        return {"size_xy": pair(size, "--size"), "corner_xy": pair(corner, "--corner")}
    raise ParameterError("one of the two is needed", source="--at, --corner")


def described(stage: str, parameters: Mapping[str, object]) -> str:
    """Return a stage's parameters as a verbose command says them."""
    words = {None: "none", True: "yes", False: "no"}
    pairs = (
        f"{name}={words[value] if value is None or isinstance(value, bool) else value}"
        for name, value in parameters.items()
    )
    return f"{stage}: {', '.join(pairs)}"


def start(*, quiet: bool, verbose: bool) -> None:
    """Set how much a command says."""
    if quiet and verbose:
        raise ParameterError("cannot be given together with --quiet", source="--verbose")
    terminal.configure(quiet=quiet, verbose=verbose)
