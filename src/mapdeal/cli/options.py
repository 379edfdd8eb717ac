"""Arguments and values of options, and the one way to make a stage's options."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import typer

from mapdeal.cli.streams import TO_STDOUT
from mapdeal.command import Parameter, Words

OR_STDIN = "Or - for an .npz on stdin."
OR_STDOUT = "Or - for an .npz on stdout."


def output_argument(metavar: str, help_text: str) -> Any:
    return typer.Option("--output", "-o", metavar=metavar, help=help_text)


GridOutput = Annotated[
    Path,
    output_argument(
        "OUT", f"The result: .yaml or .pgm (a pgm pair), .png (a pair), or .npz. {OR_STDOUT}"
    ),
    TO_STDOUT,
]


def option_of(parameter: Parameter, help_text: str, *, is_flag: bool = False) -> Any:
    """Return the option of a parameter: its name with dashes, its default shown.

    The option's own default is None, "not given": the value stands in the function's signature.
    """
    words = parameter.words or Words()
    default = None if parameter.is_required else parameter.default
    metavar = words.metavar or (parameter.unit.metavar if parameter.unit else None)
    name = option_name(parameter)
    if parameter.kind is bool:
        name, metavar = (name if is_flag else f"{name}/--no{name[1:]}"), None
        default = None if is_flag else "yes" if default else "no"
    elif parameter.choices:
        metavar = "|".join(parameter.choices)
    elif metavar is not None and not words.metavar and get_args(parameter.kind)[1:] == (Ellipsis,):
        metavar = f"{metavar},{metavar},..."
    if isinstance(default, tuple):
        default = ",".join(str(value) for value in default) or None
    is_shown = default not in (None, "") and "[default: " not in help_text
    shown = f"  [default: {default}]" if is_shown else ""
    return typer.Option(
        *([name] if words.short is None else [name, f"-{words.short}"]),
        metavar=metavar,
        autocompletion=words.completed or (lambda: parameter.choices or ()),
        help=re.sub(r" +\[default: ", "  [default: ", help_text + shown),
        show_default=False,
    )


def option_name(parameter: Parameter) -> str:
    words = parameter.words or Words()
    return "--" + (words.name or parameter.name).replace("_", "-")


def type_of(parameter: Parameter) -> Any:
    """Return the type that typer reads a stage's parameter as; words and lists are text."""
    if parameter.words is not None and parameter.words.typed is not None:
        return parameter.words.typed
    if parameter.words is not None and parameter.words.read is not None:
        return list[str] if parameter.words.is_repeated else str
    if parameter.optional and parameter.default is not None:
        return str  # "none" as well
    if parameter.kind in (bool, int, float, Path):
        return parameter.kind
    if get_origin(parameter.kind) in (list, Sequence):
        return list[Path] if get_args(parameter.kind)[0] is Path else list[str]
    return str


def given(**options: object) -> dict[str, object]:
    return {name: value for name, value in options.items() if value is not None}
