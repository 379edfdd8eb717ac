"""The commands of stages, made from their definitions."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Mapping
from inspect import Parameter
from pathlib import Path
from typing import Annotated, Any

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.robot_options import say_queue
from mapdeal.cli.shared_options import with_shared_options
from mapdeal.cli.streams import FROM_STDIN, TO_STDOUT
from mapdeal.errors import ParameterError, emit_warning
from mapdeal.files.json_values import json_of
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.framed import Figures
from mapdeal.maps.map_server import Encoding
from mapdeal.pipeline.folder import files_of, summary_of
from mapdeal.pipeline.recipe import step_for
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.single import SingleResult, apply_to_file
from mapdeal.pipeline.step import Step, make_step
from mapdeal.ros.robot import RobotParameters
from mapdeal.stages.catalogue import models_of
from mapdeal.stages.definition import Stage

_FIRST_SENTENCE = re.compile(r".*?\.(?=\s+[A-Z`]|$)")

_TAKEN: dict[type[Any], tuple[str, str]] = {
    DistanceField: ("ESDF.npz", "the distance field of one"),
    Costmap: ("COST.npz", "a costmap"),
}
"""What ``--help`` calls grids that some stages take besides maps."""

_MASK = Annotated[
    Path | None,
    typer.Option(metavar="MASK", help="Keepout mask, a map: the lower bound of the costs."),
    FROM_STDIN,
]
_ENCODING = Annotated[
    Encoding,
    typer.Option(help="Pixels of a .yaml: the values that ROS publishes, or costmap_2d's bytes."),
]
_CURVE = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.png",
        help="Also plot the cost over the distance from the nearest obstacle, with the robot's "
        "radii.",
    ),
]
_JSON = Annotated[
    bool,
    typer.Option(
        "--json",
        help="Print one JSON document: parameters, figures, and the cost curve as a table.",
    ),
]
_MEMORY = (
    "Memory to use, such as 4G or 500M; maps that need more are processed in blocks of rows.  "
    "[default: half of the free memory]"
)


def stage_app(name: str) -> typer.Typer:
    models = models_of(name)
    first = next(iter(models.values()))
    has_robot = any(stage.robot is not None for stage in models.values())

    def command(
        *,
        source: Path,
        output: Path,
        settings: Settings,
        footprint: Footprint | None = None,
        robot: RobotParameters | None = None,
        encoding: Encoding = "occupancy",
        mask: Path | None = None,
        curve: Path | None = None,
        as_json: bool = False,
        **given: Any,
    ) -> None:
        if as_json:
            terminal.need_stdout("--json")
        if robot is not None:
            shaped = robot if footprint is None else robot.with_shape(footprint)
            step = step_for(name, shaped, opt.given(**given))
            _warn_of_unused(step, shaped)
        else:
            step = _step_of(name, models, footprint, given)
        terminal.detail(opt.described(name, step.described()[name]))
        started = time.perf_counter()
        made = apply_to_file(
            source, output, step, settings, encoding=encoding, mask=mask, curve=curve,
            with_curve=as_json, also_read=() if robot is None else robot.paths
        )  # fmt: skip
        terminal.detail(f"{name}: {time.perf_counter() - started:.3f} s")
        if robot is not None:
            say_queue(source, [step], settings)
        if as_json:
            terminal.result(json_of(_document(step, made)).decode().removesuffix("\n"))
        else:
            say_written(output, made.figures)

    command.__name__ = name
    command.__doc__ = "\n\n".join(filter(None, [first.summary, first.details]))
    own = list(_arguments(first, models))
    shared = [one.name for one in own if one.name not in ("source", "output")]
    if has_robot:
        replaced = next(stage.robot.replaces for stage in models.values() if stage.robot)
        shared.insert(shared.index(replaced) + 1, "robot")
    shared.append("files")
    if first.makes is Costmap:
        own += [_option("mask", _MASK, None), _option("encoding", _ENCODING, "occupancy")]
        own += [_option("curve", _CURVE, None), _option("as_json", _JSON, False)]
        shared[-1:-1] = ["mask", "encoding", "curve", "as_json"]
    app = typer.Typer(rich_markup_mode=None, add_completion=False)
    made = with_shared_options(
        command,
        own,
        shared,
        help_texts={"max_memory": _MEMORY},
        makes_costs=lambda _: first.makes is Costmap,
    )
    app.command()(made)
    return app


def _arguments(first: Stage, models: Mapping[str | None, Stage]) -> Iterator[Parameter]:
    """Yield what a stage's command takes beside the options that others have, too."""
    metavar, about = _of_source(first)
    argument = typer.Argument(metavar=metavar, help=f"{about} {opt.OR_STDIN}")
    taken: Any = Annotated[Path, argument, FROM_STDIN]
    yield Parameter("source", Parameter.KEYWORD_ONLY, annotation=taken)
    written = files_of(first.makes)
    out = opt.output_argument(written.metavar, f"{written.about} {opt.OR_STDOUT}")
    made: Any = Annotated[Path, out, TO_STDOUT]
    yield Parameter("output", Parameter.KEYWORD_ONLY, annotation=made)
    if None not in models:
        names = [str(name) for name in models]
        text = f"The rule of the {first.name}s.  [default: {names[0]}"
        text += "; with --params-file the robot's]" if first.robot is not None else "]"
        option = typer.Option(
            metavar="|".join(names), autocompletion=lambda: names, help=text, show_default=False
        )
        yield _option("model", Annotated[str | None, option], None)
    for name in _in_order(models):
        owners = {str(model): one for model, one in models.items() if name in one.parameters}
        stage = next(iter(owners.values()))
        parameter = stage.parameters[name]
        if any(other.parameters[name] != parameter for other in owners.values()):
            rule = f"models {', '.join(owners)} of {stage.name} have different parameters"
            raise ValueError(f"{rule} of one name: {name}")
        if parameter.from_robot or parameter.is_structured:
            continue  # the robot's shape or a recipe sets it
        text = first_sentence(stage.meanings[name])
        if len(owners) < len(models):
            text = f"{', '.join(owners)}: {text[:1].lower()}{text[1:]}"
        kind: Any = opt.type_of(parameter)
        annotation: Any = Annotated[kind | None, opt.option_of(parameter, text)]
        yield _option(name, annotation, None)


def _of_source(stage: Stage) -> tuple[str, str]:
    """Return what ``--help`` says of the grids that a stage takes."""
    metavars = ["MAP", *(_TAKEN[kind][0] for kind in stage.takes if kind in _TAKEN)]
    others = [_TAKEN[kind][1] for kind in stage.takes if kind in _TAKEN]
    if not others:
        return "MAP", "A map_server .yaml, a .pbm with its .yaml, or an .npz written by mapdeal."
    *before, last = others
    return "|".join(metavars), f"{', '.join(['A map', *before])}, or {last}."


def _in_order(models: Mapping[str | None, Stage]) -> list[str]:
    """Return the parameters of all models, those last that every one of several has."""
    names = dict.fromkeys(name for stage in models.values() for name in stage.parameters)
    if len(models) == 1:
        return list(names)
    everywhere = [n for n in names if all(n in stage.parameters for stage in models.values())]
    return [*(name for name in names if name not in everywhere), *everywhere]


def _option(name: str, annotation: Any, default: object) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def first_sentence(text: str) -> str:
    """Return the first sentence of a parameter's description, without its markup.

    Examples
    --------
    >>> first_sentence("Occupancy of ``an`` obstacle, 1..100. The rest is for the docs.")
    'Occupancy of an obstacle, 1..100.'
    """
    match = _FIRST_SENTENCE.match(text)
    return (match[0] if match else text).replace("`", "")


def _document(step: Step, made: SingleResult) -> dict[str, Any]:
    """Return what was made as JSON can hold it: how, its figures, and the curve of costs."""
    curve = {"curve": None} if made.curve is None else made.curve.document()
    return {"parameters": step.described()[step.name], "figures": made.figures, **curve}


def _step_of(
    name: str,
    models: Mapping[str | None, Stage],
    footprint: Footprint | None,
    given: Mapping[str, object],
) -> Step:
    parameters = opt.given(**given)
    if footprint is not None:
        model = parameters.get("model", next(iter(models)))
        stage = models.get(None if model is None else str(model))
        robot = stage.robot if stage is not None else None
        if stage is not None and robot is None:
            able = " and ".join(str(one.model) for one in models.values() if one.robot)
            rule = f"only {name}s of model {able} depend on the robot's shape"
            raise ParameterError(rule, source="--model", got=model)
        if robot is not None and robot.replaces in parameters:
            rule = "cannot be given together with a robot's shape"
            raise ParameterError(rule, source=f"--{robot.replaces.replace('_', '-')}")
        if robot is not None:
            parameters |= robot.parameters(footprint)
    return make_step(name, parameters)


def _warn_of_unused(step: Step, robot: RobotParameters) -> None:
    """Warn of a model, asked for by hand, that costs of a robot do not follow."""
    stage = step.stage
    if stage.robot is None and stage.of_layers(robot.costmap_layers) is None:
        emit_warning(
            f"--params-file: model {stage.model} takes no shape and no costs of it, only which "
            "occupancy is lethal"
        )


def say_written(output: Path, figures: Figures, *, with_origin: bool = False) -> None:
    text = f"{output}: {figures['width']} x {figures['height']} cells"
    if with_origin:
        x, y, yaw = figures["origin"]
        text += f" at {x:.10g}, {y:.10g}" + (f", yaw {yaw:.6g}" if yaw else "")
    terminal.summary([f"{text}, {summary_of(figures)}"])
