"""Arguments and values of options, and the one way to make a stage's options."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from mapdeal.cli import terminal
from mapdeal.cli.streams import FROM_STDIN, TO_STDOUT
from mapdeal.errors import ParameterError
from mapdeal.grid.resample import ResamplingRule
from mapdeal.pipeline.folder import said
from mapdeal.stages.definition import Parameter, is_plain, parameters_of

OR_STDIN = "Or - for an .npz on stdin."
OR_STDOUT = "Or - for an .npz on stdout."

MapArgument = Annotated[
    Path,
    typer.Argument(
        metavar="MAP",
        help="A map_server .yaml, a .pbm with its .yaml, or an .npz written by mapdeal. "
        + OR_STDIN,
    ),
    FROM_STDIN,
]

_COUNTS = {2: "two", 3: "three"}

Size = Annotated[str, typer.Option(metavar="WX,WY", help="Extent along columns and rows, metres.")]
At = Annotated[
    str | None, typer.Option(metavar="X,Y", help="Centre of the window, map frame, metres.")
]
Corner = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y",
        help="Or the corner at its first cell, map frame, metres: the lower left one if the "
        "map has no yaw.",
    ),
]
Rule = Annotated[
    ResamplingRule,
    typer.Option(
        help="Value of a new cell: the largest of all overlapped cells (area), so that no "
        "obstacle is lost, or the value at its centre (nearest)."
    ),
]


def jobs_option(help_text: str) -> Any:
    return typer.Option("--jobs", "-j", metavar="N", min=1, help=help_text)


def points_option(what: str) -> Any:
    return typer.Option(metavar="FILE|-", help=f"{what}; - reads standard input.")


def output_argument(metavar: str, help_text: str) -> Any:
    return typer.Option("--output", "-o", metavar=metavar, help=help_text)


GridOutput = Annotated[
    Path,
    output_argument(
        "OUT", f"The result: .yaml or .pgm (a pgm pair), .png (a pair), or .npz. {OR_STDOUT}"
    ),
    TO_STDOUT,
]


def stage_option(function: Callable[..., Any], name: str, help_text: str) -> Any:
    """Return the option of a stage's parameter for a command that is not the stage's own."""
    return option_of(parameters_of(function)[name], help_text)


def option_of(parameter: Parameter, help_text: str) -> Any:
    """Return the option of a stage's parameter: its name with dashes, its default shown.

    The option's own default is None, "not given": the value stands in the stage's signature.
    """
    dashed = parameter.name.replace("_", "-")
    default = parameter.default
    metavar = parameter.unit.metavar if parameter.unit else None
    name_on_line = f"--{dashed}"
    if parameter.kind is bool:
        name_on_line, metavar = f"--{dashed}/--no-{dashed}", None
        default = "yes" if default else "no"
    elif parameter.choices:
        metavar = "|".join(parameter.choices)
    elif metavar is not None and get_args(parameter.kind)[1:] == (Ellipsis,):
        metavar = f"{metavar},{metavar},..."
    if isinstance(default, tuple):
        default = ",".join(str(value) for value in default)
    shown = "" if default is None else f"  [default: {default}]"
    return typer.Option(
        name_on_line,
        metavar=metavar,
        autocompletion=lambda: parameter.choices or (),
        help=help_text + shown,
        show_default=False,
    )


def type_of(parameter: Parameter) -> Any:
    """Return the type that typer reads a stage's parameter as; words and lists are text."""
    return parameter.kind if parameter.kind in (bool, int, float) else str


def given(**options: object) -> dict[str, object]:
    return {name: value for name, value in options.items() if value is not None}


def pair(text: str, name: str) -> tuple[float, float]:
    """Return the two numbers of an option written ``X,Y``."""
    x, y = numbers(text, 2, "X,Y", name)
    return x, y


def size_of(text: str, name: str) -> int:
    """Return a number of bytes: ``500M`` and ``4GiB`` are of 1024, ``4GB`` of 1000."""
    match = re.fullmatch(
        r"([0-9]{1,9}(?:\.[0-9]*)?)\s*([kmgt]?)(i?b)?", text.strip(), re.IGNORECASE
    )
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
        if not is_plain(text):
            raise ValueError
        values = [float(part) for part in text.split(",")]
        if len(values) != count:
            raise ValueError
    except ValueError:
        rule = f"must be {_COUNTS[count]} numbers {form}" if count > 1 else "must be a number"
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
    raise ParameterError("one of the two is required", source="--at, --corner")


def described(stage: str, parameters: Mapping[str, object]) -> str:
    """Return a stage's parameters as a verbose command says them."""
    return f"{stage}: {', '.join(f'{name}={said(value)}' for name, value in parameters.items())}"
