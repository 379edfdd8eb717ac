"""Options that many commands share: each is declared once, and a command asks for it by name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from functools import wraps
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from mapdeal.cli import terminal
from mapdeal.cli.robot_options import robot_parameters, robot_shape
from mapdeal.cli.streams import piped, streamed
from mapdeal.errors import ParameterError, strict_warnings
from mapdeal.files.budget import size_of
from mapdeal.kernels.threads import use_threads
from mapdeal.maps.map_yaml import Dialect
from mapdeal.pictures.overlay import ImageExtent
from mapdeal.pipeline.settings import Settings
from mapdeal.ros.robot import CostmapName

Command = Callable[..., None]

_ROBOT, _ALWAYS = "robot", "always"

_OF_FILES = ("params_file", "costmap", "namespace")
"""The options of the group ``robot`` that are about a robot's own parameters."""


class SharedOption(NamedTuple):
    """An option that many commands have."""

    kind: Any
    option: Any
    default: object = None
    group: str | None = None
    field: str | None = None
    value_of: Callable[[Any], object] | None = None


SHARED_OPTIONS = {
    "footprint": SharedOption(
        str | None,
        typer.Option(
            metavar="[[X,Y],...]",
            help="Corners of the robot around its centre, metres.",
        ),
        group="robot",
    ),
    "robot_radius": SharedOption(
        float | None,
        typer.Option(metavar="M", help="Radius of a round robot, metres."),
        group="robot",
    ),
    "footprint_padding": SharedOption(
        float,
        typer.Option(
            metavar="M",
            help="Distance to move the edges of the shape outwards, metres; ROS uses 0.01.",
        ),
        default=0.0,
        group="robot",
    ),
    "robot_16_gon": SharedOption(
        bool,
        typer.Option(
            help="Treat a round robot as a polygon of 16 corners, as costmap_2d does.  "
            "[default: no]",
            show_default=False,
        ),
        default=False,
        group="robot",
    ),
    "params_file": SharedOption(
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Take shape and costs from a robot's own parameters: a Nav2 file, or ROS 1's "
            "costmap files; can be repeated, later files win.",
        ),
        group="robot",
    ),
    "costmap": SharedOption(
        CostmapName | None,
        typer.Option(help="Costmap of --params-file.  [default: global]", show_default=False),
        group="robot",
    ),
    "namespace": SharedOption(
        str | None,
        typer.Option(metavar="NS", help="Robot of --params-file, if it contains several."),
        group="robot",
    ),
    "image": SharedOption(
        Path | None,
        typer.Option(metavar="FILE.png", help="Also write a picture of the result."),
        group="files",
        field="image",
    ),
    "image_extent": SharedOption(
        ImageExtent,
        typer.Option(help="Extent of pictures: the known cells and a margin, or the whole map."),
        default=Settings.image_extent,
        group="files",
        field="image_extent",
    ),
    "dialect": SharedOption(
        Dialect,
        typer.Option(help="How the image is read: as nav2 (jazzy and newer), humble or ros1."),
        default=Settings.dialect,
        group="files",
        field="dialect",
    ),
    "max_cells": SharedOption(
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            help="Refuse larger images before allocating memory.  [default: 2e8 for compressed "
            "images, 1e9 for others]",
        ),
        group="files",
        field="max_cells",
    ),
    "force": SharedOption(
        bool,
        typer.Option("--force", help="Replace existing outputs."),
        default=False,
        group="files",
        field="force",
    ),
    "threads": SharedOption(
        int | None,
        typer.Option(metavar="N", min=1, help="Threads to use.  [default: all cores]"),
        group="files",
        field="threads",
    ),
    "max_memory": SharedOption(
        str | None,
        typer.Option(
            metavar="SIZE",
            help="Memory to use, such as 4G or 500M; what needs more is refused.  [default: "
            "half of the free memory]",
        ),
        group="files",
        field="max_memory",
        value_of=lambda text: None if text is None else size_of(text, "--max-memory"),
    ),
    "image_max": SharedOption(
        int,
        typer.Option(
            metavar="PIXELS",
            min=0,
            help="Longest side of pictures, pixels; 0 for one pixel per cell.",
        ),
        default=Settings.image_max,
        field="image_max",
    ),
    "no_images": SharedOption(
        bool,
        typer.Option("--no-images", help="Write no pictures."),
        default=False,
        field="images",
        value_of=lambda without: not without,
    ),
    "strict": SharedOption(
        bool,
        typer.Option("--strict", help="Exit with 1, and write nothing, if there is a warning."),
        default=False,
        group="always",
        field="strict",
    ),
    "quiet": SharedOption(
        bool,
        typer.Option("--quiet", "-q", help="Print only errors and requested results."),
        default=False,
        group="always",
    ),
    "verbose": SharedOption(
        bool,
        typer.Option("--verbose", "-v", help="Print what is read and done."),
        default=False,
        group="always",
    ),
}
"""By name of the parameter; a group has this order. Every command ends with ``always``."""


def expanded(names: Iterable[str]) -> list[str]:
    groups: dict[str, list[str]] = {}
    for name, option in SHARED_OPTIONS.items():
        if option.group is not None:
            groups.setdefault(option.group, []).append(name)
    return [member for name in names for member in groups.get(name, [name])]


def _makes_costs(_values: Mapping[str, Any]) -> bool:
    return True


def with_shared_options(
    function: Command,
    own: Iterable[Parameter],
    names: Sequence[str],
    *,
    help_texts: Mapping[str, str] | None = None,
    makes_costs: Callable[[Mapping[str, Any]], bool] = _makes_costs,
) -> Command:
    """Return a command with options of its own and shared ones.

    When it is called, it sets how much is said, makes `Settings`, the robot's shape and its own
    parameters, and hands them to the function with the values of its own options.
    """
    parameters = _spliced(function.__name__, {one.name: one for one in own}, names, help_texts)
    shared = [name for name in SHARED_OPTIONS if name in expanded([*names, _ALWAYS])]
    robot = _of_robot(shared)
    marked = streamed(parameters)

    @wraps(function)
    def command(**values: Any) -> None:
        given = {name: values.pop(name) for name in shared}
        _start(quiet=given["quiet"], verbose=given["verbose"], strict=given["strict"])
        values["settings"] = settings = _settings_of(given)
        with strict_warnings(settings.strict):
            if robot:
                shape = {name: given[name] for name in robot if name not in _OF_FILES}
                values["footprint"] = robot_shape(**shape)
            if "params_file" in shared:
                files = {name: given[name] for name in _OF_FILES}
                is_shape, dialect = not makes_costs(values), settings.dialect
                values["robot"] = robot_parameters(**files, dialect=dialect, is_shape=is_shape)
            with (
                settings.memory(anew=True),
                use_threads(settings.threads),
                piped(values, marked) as piped_values,
            ):
                function(**piped_values)

    typed: Any = command
    typed.__signature__ = Signature(parameters, return_annotation=None)
    typed.__annotations__ = {one.name: one.annotation for one in parameters} | {"return": None}
    return command


def _of_robot(names: Iterable[str]) -> list[str]:
    robot = expanded([_ROBOT])
    return [name for name in names if name in robot]


def _spliced(
    command: str,
    own: Mapping[str, Parameter],
    names: Sequence[str],
    help_texts: Mapping[str, str] | None,
) -> list[Parameter]:
    ordered = expanded([*names, _ALWAYS])
    for name in ordered:
        if name not in own and name not in SHARED_OPTIONS:
            raise ValueError(f"{command}: no option or group {name!r}")
        if ordered.count(name) > 1 or (name in own and name in SHARED_OPTIONS):
            raise ValueError(f"{command}: option {name!r} comes twice")
    texts = dict(help_texts or {})
    parameters = {name: one for name, one in own.items() if name not in ordered}
    for name in ordered:
        parameters[name] = own.get(name) or _parameter(name, texts.pop(name, None))
    if texts:
        raise ValueError(f"{command}: no shared option {next(iter(texts))!r}")
    return [one.replace(kind=Parameter.KEYWORD_ONLY) for one in parameters.values()]


def _parameter(name: str, help_text: str | None) -> Parameter:
    shared = SHARED_OPTIONS[name]
    option = copy(shared.option)
    option.help = help_text or option.help
    option.rich_help_panel = "Robot" if shared.group == _ROBOT else "Common options"
    return Parameter(
        name,
        Parameter.KEYWORD_ONLY,
        default=shared.default,
        annotation=Annotated[shared.kind, option],
    )


def _start(*, quiet: bool, verbose: bool, strict: bool) -> None:
    if quiet and verbose:
        raise ParameterError("cannot be given together with --quiet", source="--verbose")
    terminal.configure(quiet=quiet, verbose=verbose, strict=strict)


def _settings_of(given: Mapping[str, Any]) -> Settings:
    fields: dict[str, Any] = {}
    for name, value in given.items():
        option = SHARED_OPTIONS[name]
        if option.field is not None:
            fields[option.field] = option.value_of(value) if option.value_of else value
    return Settings(**fields, progress=terminal.blocks_done)
