"""Options and their values: those of parameters, and those that many commands share."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from functools import partial, wraps
from inspect import Parameter as Argument, Signature
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Optional, get_args, get_origin

import typer

from mapdeal.cli import terminal
from mapdeal.command import Command, Parameter, Words, split_optional
from mapdeal.errors import ParameterError, strict_warnings
from mapdeal.files.source import INTERPRETER, size_of, size_text
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.values import join_words
from mapdeal.kernels.threads import use_threads
from mapdeal.maps.dialects import Dialect
from mapdeal.maps.formats import FORMATS, format_of
from mapdeal.maps.images import IMAGE_SUFFIXES
from mapdeal.pictures.overlay import ImageExtent
from mapdeal.pipeline.inputs import numbers_of, used_mask
from mapdeal.pipeline.settings import Settings
from mapdeal.records import fields, replace
from mapdeal.ros.robot import INJECTED, CostmapName, RobotParameters

OR_STDIN = "Or - for an .npz on stdin."
OR_STDOUT = "Or - for an .npz on stdout."


def option_of(parameter: Parameter, help_text: str, *, is_flag: bool = False) -> Any:
    # An option with the default None is absent from the function's arguments.
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
        *([name] if words.short is None else [name, f"-{words.short}"]), metavar=metavar,
        autocompletion=words.completed or (lambda: parameter.choices or ()),
        help=re.sub(r" +\[default: ", "  [default: ", help_text + shown), show_default=False,
    )  # fmt: skip


def option_name(parameter: Parameter) -> str:
    return "--" + parameter.key.replace("_", "-")


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


def robot_shape(
    *, footprint: str | None, robot_radius: float | None, footprint_padding: float,
    robot_16_gon: bool | None = None,
) -> Footprint | None:  # fmt: skip
    """Return the robot's shape; commands without --robot-16-gon always use 16 corners."""
    if robot_16_gon and robot_radius is None:
        raise ParameterError("needs --robot-radius", source="--robot-16-gon")
    if footprint is not None and robot_radius is not None:
        raise ParameterError("cannot be given together with --robot-radius", source="--footprint")
    if footprint is not None:
        return Footprint.parse(footprint).padded(footprint_padding)
    if robot_radius is not None:
        make = Footprint.circle if robot_16_gon is False else Footprint.sixteen_gon
        return make(robot_radius).padded(footprint_padding)
    if footprint_padding:
        raise ParameterError("needs --footprint or --robot-radius", source="--footprint-padding")
    return None


def robot_parameters(
    *, params_file: Sequence[Path] | None, costmap: CostmapName | None, namespace: str | None,
    dialect: Dialect, shape_only: bool = False, has_mask: bool = False, has_pose: bool = False,
    is_replay: bool = False,
) -> RobotParameters | None:  # fmt: skip
    """Return the robot of parameter files; report its layers, unless only its shape counts."""
    if not params_file:
        for option, value in (("--costmap", costmap), ("--namespace", namespace)):
            if value is not None:
                raise ParameterError("needs --params-file", source=option)
        return None
    from mapdeal.ros.load import read_robot  # few commands read one

    robot = read_robot(
        params_file, costmap=costmap or "global", namespace=namespace,
        up_to_kilted=dialect != "nav2", shape_only=shape_only,
    )  # fmt: skip
    terminal.detail(f"robot: {robot!r}")
    if shape_only or is_replay:
        return robot
    remarks = []
    if not has_pose and any(listed.name == INJECTED for listed in robot.layers):
        text = "the local costmap has no static layer; the map is put in front of its layers"
        remarks.append(text)
    ignored = [listed for listed in robot.ignored if not (has_pose and listed.layer is not None)]
    reasons = [f"{listed.name} ({listed.why_ignored or f'no {listed.needs}'})"
               for listed in ignored if not (has_mask and listed.needs == "mask")]  # fmt: skip
    if reasons:
        remarks.append(f"ignored: {', '.join(reasons)}")
    remarks += [f"{layer.name}: {layer.effect()}" for layer in robot.costmap_layers.effective
                if layer.needs == "observations"]  # fmt: skip
    terminal.remark(f"{params_file[-1]}: {text}" for text in remarks)
    return robot


_ROBOT, _AGAINST, _ALWAYS = "robot", "against", "always"
_OF_FILES = ("params_file", "costmap", "namespace")  # of the group ``robot``
OF_IMAGES = ("resolution", "origin")  # of those without a YAML file; some commands have their own
OF_SETTINGS = {setting.name for setting in fields(Settings)}


class SharedOption(NamedTuple):
    """An option that many commands have; those of ``files`` are settings of the same name."""

    kind: Any
    text: str
    metavar: str | None = None
    default: object = None
    group: str | None = "files"
    least: int | None = None

    def parameter(self, name: str, text: str | None) -> Argument:
        has_one_form = self.kind is bool and name != "robot_16_gon"  # which has a --no-, too
        flag = [f"--{name.replace('_', '-')}"] if has_one_form else []
        flag += ["-" + name[0]] if name in ("quiet", "verbose") else []
        text = text or self.text
        declare = partial(typer.Option, *flag, metavar=self.metavar, min=self.least, help=text)
        panel = "Robot" if self.group in (_ROBOT, _AGAINST) or name == "mask" else "Common options"
        option = declare(show_default="[default: " not in text, rich_help_panel=panel)
        kind: Any = Annotated[self.kind, option]
        return Argument(name, Argument.KEYWORD_ONLY, default=self.default, annotation=kind)


_robots = partial(SharedOption, group="robot")
_always = partial(SharedOption, bool, default=False, group="always")
SHARED_OPTIONS = {
    "footprint": _robots(
        str | None, "Corners of the robot around its centre, metres.", "[[X,Y],...]"),
    "robot_radius": _robots(float | None, "Radius of a round robot, metres.", "M"),
    "footprint_padding": _robots(
        float, "Distance to move the edges of the shape outwards, metres; ROS uses 0.01.", "M", 0.0
    ),
    "robot_16_gon": _robots(
        bool, "Treat a round robot as a polygon of 16 corners, as costmap_2d does.  [default: no]",
        default=False),
    "params_file": _robots(list[Path] | None,
        "Take shape and costs from a robot's own parameters: a Nav2 file, or ROS 1's costmap "
        "files; can be repeated, later files override earlier ones.", "FILE"),
    "costmap": _robots(CostmapName | None, "Costmap of --params-file.  [default: global]"),
    "namespace": _robots(str | None, "Robot of --params-file, if it contains several.", "NS"),
    "against": SharedOption(list[Path] | None,
        "Compare with the costmap of these parameters; repeatable, later files override.", "FILE",
        group=_AGAINST),
    "image": SharedOption(Path | None, "Also write a picture of the result.", "FILE.png"),
    "image_extent": SharedOption(
        ImageExtent, "Extent of pictures: the known cells and a margin, or the whole map.",
        default=Settings.image_extent),
    "dialect": SharedOption(
        Dialect, "How the image is read: as nav2 (jazzy and newer), humble or ros1.",
        default=Settings.dialect),
    "resolution": SharedOption(float | None,
        "For an image without its .yaml, or a .pbstream [0.05]: side of a cell, metres.", "M"),
    "origin": SharedOption(str | None,
        "For an image without its .yaml: pose of its lower left corner.  [default: 0,0,0]",
        "X,Y,YAW"),
    "max_cells": SharedOption(int | None,
        "Refuse larger images before allocating memory.  [default: 2e8 for compressed images, "
        "1e9 for others]", "N", least=1),
    "force": SharedOption(bool, "Replace existing outputs.", default=False),
    "threads": SharedOption(int | None, "Threads to use.  [default: all cores]", "N", least=1),
    "max_memory": SharedOption(str | None,
        "Memory to use, such as 4G or 500M; inputs that need more are refused.  [default: half of "
        "the free memory]", "SIZE"),
    "image_max": SharedOption(
        int, "Longest side of pictures, pixels; 0 for one pixel per cell.", "PIXELS",
        Settings.image_max, group=None, least=0),
    "mask": SharedOption(Path | None,
        "Keepout mask, a map: lower bound of the costs; 100 keeps the robot's centre out.",
        "MASK", group=None),
    "no_images": SharedOption(bool, "Write no pictures.", default=False, group=None),
    "strict": _always("Exit with 1, and write nothing, if there is a warning."),
    "quiet": _always("Print only errors and requested results."),
    "verbose": _always("Print the files read and the steps taken."),
}  # fmt: skip
"""Options by parameter, in the order of their groups. All commands end with ``always``."""


def expanded(names: Iterable[str]) -> list[str]:
    groups: dict[str, list[str]] = {}
    for name, option in SHARED_OPTIONS.items():
        if option.group is not None:
            groups.setdefault(option.group, []).append(name)
    names = list(names)
    own = {*names, *(("origin",) if "resolution" in names else ())}  # of the output
    groups["files"] = [name for name in groups["files"] if name not in own & {*OF_IMAGES}]
    return [member for name in names for member in groups.get(name, [name])]


def with_shared_options(
    function: Any, own: Iterable[Argument], names: Sequence[str], definition: Command,
    streams: Mapping[str, bool],
) -> Any:  # fmt: skip
    """Return a command that calls a function with `Settings`, the robot, and its own options."""
    makes_costs = definition.makes_costs
    ending = definition.output.ending if definition.output else ".npz"
    by_name = {argument.name: argument for argument in own}
    ordered = expanded([*names, _ALWAYS])
    parameters = _spliced(definition, by_name, ordered)
    shared = [name for name in SHARED_OPTIONS if name in ordered and name not in by_name]
    robot = [name for name in shared if SHARED_OPTIONS[name].group == _ROBOT]
    has_mask = "mask" in shared  # a file that may come from a standard stream
    streams = {**streams, "mask": False} if has_mask else streams
    defaults = {parameter.name: parameter.default for parameter in parameters}

    @wraps(function)
    def command(**values: Any) -> None:
        for name, value in values.items():
            if isinstance(value, Enum):
                values[name] = value.value
            elif value in ([], ()):  # typer before 0.13 has this for repeated options
                values[name] = defaults[name]
        shared_values = {name: values.pop(name) for name in shared if name != "mask"}
        if shared_values["quiet"] and shared_values["verbose"]:
            raise ParameterError("cannot be given together with --quiet", source="--verbose")
        terminal.configure(**{name: shared_values[name] for name in ("quiet", "verbose", "strict")})
        values["settings"] = settings = _settings_of(shared_values)
        with strict_warnings(settings.strict):
            if robot:
                shape = {name: shared_values[name] for name in robot if name not in _OF_FILES}
                values |= {"footprint": robot_shape(**shape)} if shape else {}
            if "params_file" in shared:
                files: dict[str, Any] = {name: shared_values.get(name) for name in _OF_FILES}
                is_given: Any = {f"has_{k}": values.get(k) is not None for k in ("mask", "pose")}
                read_parameters = partial(
                    robot_parameters, dialect=settings.dialect, shape_only=not makes_costs(values),
                    is_replay=values.get("bag") is not None, **is_given,
                )  # fmt: skip
                values["robot"] = read_parameters(**files)
                if shared_values.get("against"):
                    files["params_file"] = shared_values["against"]
                    values["against"] = read_parameters(**files)
            if settings.resolution is not None and not _names_image(values):
                endings = join_words((e.endings[0] for e in FORMATS if e.takes_resolution), "and")
                rule = f"applies to images without their .yaml and to {endings}, and none is named"
                raise ParameterError(rule, source="--resolution")
            piped = terminal.piped(values, streams, ending=ending)
            with settings.reading(anew=True), use_threads(settings.threads), piped as piped_values:
                mask = piped_values.pop("mask") if has_mask else None
                if has_mask and makes_costs(values) and "against" not in shared:
                    mask = used_mask(mask, values.get("robot"))
                with terminal.activity_shown(function.__name__):
                    function(**{**piped_values, "settings": replace(settings, mask=mask)})

    typed: Any = command
    parameters = [p.replace(annotation=_for_typer(p.annotation)) for p in parameters]
    typed.__signature__ = Signature(parameters, return_annotation=None)
    typed.__annotations__ = {p.name: p.annotation for p in parameters} | {"return": None}
    return command


def _for_typer(annotation: Any) -> Any:
    """Return an annotation that typer 0.9, of Ubuntu 24.04, reads: without ``|`` and Literal."""
    hint, *marks = get_args(annotation) if get_origin(annotation) is Annotated else [annotation]
    kind, is_optional = split_optional(hint)
    if get_origin(kind) is Literal:
        words = [(word, word) for word in get_args(kind)]
        kind = Enum("Choice", words, type=str)  # type: ignore[misc, no-redef] # made of a list
    return Annotated[(Optional[kind] if is_optional else kind, *marks)]  # noqa: UP045


def _names_image(values: Mapping[str, Any]) -> bool:
    named = [value for name, value in values.items() if name != "output"]
    texts = [item for value in named for item in (value if isinstance(value, list) else [value])]
    paths = [Path(item) for item in texts if isinstance(item, str | Path)]
    has_image_suffix = any(path.suffix.lower() in IMAGE_SUFFIXES for path in paths)
    return has_image_suffix or any(format_of(path).takes_resolution for path in paths)


def _spliced(definition: Command, own: dict[str, Argument], ordered: list[str]) -> list[Argument]:
    texts = dict(definition.texts)
    parameters = {name: argument for name, argument in own.items() if name not in ordered}
    for name in ordered:
        text = None if name in own else texts.pop(name, None)
        parameters[name] = own.get(name) or SHARED_OPTIONS[name].parameter(name, text)
    if texts:
        raise ValueError(f"{definition.name}: no shared option {next(iter(texts))!r}")
    return [argument.replace(kind=Argument.KEYWORD_ONLY) for argument in parameters.values()]


def _settings_of(shared_values: Mapping[str, Any]) -> Settings:
    values = {name: shared_values[name] for name in shared_values if name in OF_SETTINGS}
    if values.get("origin") is None:
        values.pop("origin", None)
    elif values.get("resolution") is None:
        raise ParameterError("needs --resolution", source="--origin")
    else:
        values["origin"] = numbers_of(values["origin"], "X,Y,YAW", place="--origin")
    if values.get("max_memory") is not None:
        text = values["max_memory"]
        values["max_memory"] = size = size_of(text, "--max-memory")
        if size < INTERPRETER:
            rule = f"must be at least {size_text(INTERPRETER)}, which mapdeal itself takes"
            raise ParameterError(rule, source="--max-memory", got=text)
    if "no_images" in shared_values:
        values["images"] = not shared_values["no_images"]
    return Settings(**values, progress=terminal.blocks_done)
