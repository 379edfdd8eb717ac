"""Commands of the shell, made from their definitions."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import fields
from functools import partial
from inspect import Parameter as Argument
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.options import (
    OR_STDIN,
    OR_STDOUT,
    SHARED_OPTIONS,
    option_name,
    option_of,
    type_of,
    with_shared_options,
)
from mapdeal.cli.terminal import DASH, FROM_STDIN, TO_STDOUT
from mapdeal.command import Command, Parameter, Result, Stage, commands_named
from mapdeal.errors import ParameterError, emit_warning
from mapdeal.files.json_values import json_of
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame
from mapdeal.maps.map_server import Encoding
from mapdeal.maps.png import write_indexed_png
from mapdeal.pipeline.folder import files_of, step_line, written_line
from mapdeal.pipeline.inputs import Map, Work, frame_of_file
from mapdeal.pipeline.recipe import recipe_words, step_for, step_of_recipe
from mapdeal.pipeline.run import SingleResult, apply_to_file
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import Step, make_step
from mapdeal.ros.robot import RobotParameters
from mapdeal.stages.catalogue import models_of

_FIRST_SENTENCE = re.compile(r".*?\.(?=\s+[A-Z`]|$)")

_TAKEN: dict[type[Any], tuple[str, str]] = {
    DistanceField: ("ESDF.npz", "the distance field of one"),
    Costmap: ("COST.npz", "a costmap"),
}
"""What ``--help`` calls grids that some stages take besides maps."""

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
_RECIPE = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE",
        autocompletion=recipe_words,
        help="Take the costs of a recipe, as for mapdeal run; options win over it.",
    ),
]
_JSON_OF_COSTS = Annotated[
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
        recipe: str | None = None,
        curve: Path | None = None,
        as_json: bool = False,
        **given: Any,
    ) -> None:
        if as_json:
            terminal.need_stdout("--json")
        read = _read_frames(first, given, settings)
        with _options_named(name, models):
            if recipe is not None:
                step = step_of_recipe(
                    recipe, name, opt.given(**given), footprint=footprint, robot=robot
                )
            elif robot is not None:
                shaped = robot if footprint is None else robot.with_shape(footprint)
                step = step_for(name, shaped, opt.given(**given))
                _warn_of_unused(step, shaped)
            else:
                step = _step_of(name, models, footprint, given)
                if first.makes is Costmap and footprint is None and _is_of_point(step, given):
                    emit_warning(
                        "no robot is given, by --robot-radius, --footprint, --params-file or "
                        "--recipe: the costs are those of a point"
                    )
        terminal.detail(step_line(step))
        started = time.perf_counter()
        made = apply_to_file(
            source, output, step, settings, encoding=encoding, curve=curve,
            with_curve=as_json and first.makes is Costmap, with_sums=as_json,
            also_read=[*([] if robot is None else robot.paths), *read],
        )  # fmt: skip
        terminal.detail(f"{name}: {time.perf_counter() - started:.3f} s")
        if as_json:
            document = _document(source, step, made)
            terminal.result(json_of(document).decode().removesuffix("\n"))
        else:
            written = written_line(output, made.figures, with_origin=step.moves)
            terminal.summary([written, *getattr(made.result, "lines", list)()])

    command.__name__ = name
    command.__doc__ = "\n\n".join(filter(None, [first.summary, first.details]))
    own = list(_stage_arguments(first, models))
    shared = [one.name for one in own if one.name not in ("source", "output")]
    if has_robot:
        replaced = next(stage.robot.replaces for stage in models.values() if stage.robot)
        shared.insert(shared.index(replaced) + 1 if replaced in shared else len(shared), "robot")
    shared.append("files")
    if first.makes is Costmap:
        own.append(_stage_option("recipe", _RECIPE, None))
        own.append(_stage_option("curve", _CURVE, None))
        own.append(_stage_option("encoding", _ENCODING, "occupancy"))
        own.append(_stage_option("as_json", _JSON_OF_COSTS, False))
        shared.insert(0, "recipe")
        shared[-1:-1] = ["mask", "encoding", "curve", "as_json"]
    else:
        own.append(_stage_option("as_json", _JSON, False))
        shared.insert(-1, "as_json")
    texts = {} if first.edits else {"max_memory": _MEMORY}
    if first.shows_changes:
        texts["image"] = "Write a picture of the changed cells."
    app = typer.Typer(rich_markup_mode=None, add_completion=False)
    made = with_shared_options(
        command,
        own,
        shared,
        help_texts=texts,
        makes_costs=lambda own: first.makes is Costmap and own.get("recipe") is None,
    )
    app.command(rich_help_panel=first.group, epilog=first.example)(made)
    return app


def _stage_arguments(first: Stage, models: Mapping[str | None, Stage]) -> Iterator[Argument]:
    metavar, about = _of_source(first)
    argument = typer.Argument(metavar=metavar, help=f"{about} {opt.OR_STDIN}")
    taken: Any = Annotated[Path, argument, FROM_STDIN]
    yield Argument("source", Argument.KEYWORD_ONLY, annotation=taken)
    written = files_of(first.makes)
    out = opt.output_argument(written.metavar, f"{written.about} {opt.OR_STDOUT}")
    made: Any = opt.GridOutput if first.edits else Annotated[Path, out, TO_STDOUT]
    yield Argument("output", Argument.KEYWORD_ONLY, annotation=made)
    if None not in models:
        names = [str(name) for name in models]
        text = f"The rule of the {first.name}s.  [default: {names[0]}"
        text += "; with --params-file the robot's]" if first.robot is not None else "]"
        option = typer.Option(
            metavar="|".join(names), autocompletion=lambda: names, help=text, show_default=False
        )
        yield _stage_option("model", Annotated[str | None, option], None)
    for name in _in_order(models):
        owners = {str(model): one for model, one in models.items() if name in one.parameters}
        stage = next(iter(owners.values()))
        parameter = stage.parameters[name]
        if any(other.parameters[name] != parameter for other in owners.values()):
            rule = f"models {', '.join(owners)} of {stage.name} have different parameters"
            raise ValueError(f"{rule} of one name: {name}")
        is_frame = parameter.kind is Frame  # which the shell takes from a map
        if parameter.from_robot or (parameter.is_structured and not is_frame):
            continue  # the robot's shape or a recipe sets it
        text = first_sentence(stage.meanings[name])
        if len(owners) < len(models):
            text = f"{', '.join(owners)}: {text[:1].lower()}{text[1:]}"
        kind: Any = Path if is_frame else opt.type_of(parameter)
        marks = [FROM_STDIN] if is_frame else []
        option = opt.option_of(parameter, text)
        if parameter.is_required:
            yield _stage_option(name, Annotated[(kind, option, *marks)], Argument.empty)
        else:
            yield _stage_option(name, Annotated[(kind | None, option, *marks)], None)


@contextmanager
def _options_named(name: str, models: Mapping[str | None, Stage]) -> Iterator[None]:
    try:
        yield
    except ParameterError as error:
        known = {key: one for stage in models.values() for key, one in stage.parameters.items()}
        keys = (error.place or "").removeprefix(f"{name}.").split(", ")
        if error.source is None and known.keys() >= set(keys):
            error.source, error.place = ", ".join(opt.option_name(known[key]) for key in keys), None
        raise


def _read_frames(stage: Stage, given: dict[str, Any], settings: Settings) -> list[Path]:
    """Replace maps in the place of frames by theirs; return the files that were read for it."""
    read: list[Path] = []
    for name, one in stage.parameters.items():
        if one.kind is Frame and given.get(name) is not None:
            given[name], files = frame_of_file(given[name], settings)
            read += files
    return read


def _of_source(stage: Stage) -> tuple[str, str]:
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


def _stage_option(name: str, annotation: Any, default: object) -> Argument:
    return Argument(name, Argument.KEYWORD_ONLY, default=default, annotation=annotation)


def first_sentence(text: str) -> str:
    """Return the first sentence of a parameter's description, without its markup."""
    match = _FIRST_SENTENCE.match(text)
    return (match[0] if match else text).replace("`", "")


def _document(source: Path, step: Step, made: SingleResult) -> dict[str, Any]:
    if hasattr(made.result, "document"):
        return {"map": {"file": str(source), "sha256": made.sums}, **made.result.document()}
    document = {"parameters": step.described()[step.name], "figures": made.figures}
    if step.stage.makes is not Costmap:
        return document
    return {**document, **({"curve": None} if made.curve is None else made.curve.document())}


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


def _is_of_point(step: Step, given: Mapping[str, object]) -> bool:
    """Return whether a step that depends on the robot's shape was given none."""
    shape = step.stage.robot
    return shape is not None and given.get(shape.replaces) is None


def _warn_of_unused(step: Step, robot: RobotParameters) -> None:
    """Warn of a model, asked for by hand, that costs of a robot do not follow."""
    stage = step.stage
    if stage.robot is None and stage.parameters_from_layers(robot.costmap_layers) is None:
        emit_warning(
            f"--params-file: model {stage.model} takes no shape and no costs of it, only which "
            "occupancy is lethal"
        )


_OF_ROBOT = {
    "footprint": "--footprint, --robot-radius", "robot": "--params-file", "against": "--against"
}  # fmt: skip
"""Parameters that options in common stand for, and which these are."""

_OF_SETTINGS = SHARED_OPTIONS.keys() & {one.name for one in fields(Settings)} - {*opt.OF_IMAGES}
"""Parameters that get the value of the setting of their name."""

_JSON = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]
_TYPES = {Map: Path, Map | None: Path | None, Sequence[Map]: list[Path]}  # what typer reads maps as


def command_app(name: str, module: ModuleType) -> typer.Typer:
    app = typer.Typer(rich_markup_mode=None, add_completion=False)
    members = commands_named(name)
    for word, definition in members.items():
        own: dict[str, Any] = {"rich_help_panel": definition.group, "epilog": definition.example}
        if word and not app.registered_callback:
            app.callback(help=module.__doc__, **own)(lambda: None)
        app.command(word or None, **own)(made_command(definition))
    return app


def made_command(definition: Command) -> Any:
    def run(*, settings: Settings, **values: Any) -> None:
        as_json = values.pop("as_json", False)
        output = values.get("output")
        if definition.json == "default":
            if output == DASH:
                output, as_json = None, True
                values["output"] = None
            as_json = as_json or (output is None and not terminal.has_reader())
        if as_json:
            terminal.need_stdout("--json")
        with ExitStack() as stack:
            work = Work(settings, outputs_named(definition, output), stack, terminal)
            stack.callback(Work.current.reset, Work.current.set(work))
            result = _called(definition, _accepted(definition, values, settings))
            if not isinstance(result, Result):
                return
            _write(result, work, None if definition.takes_output else output)
        _tell(result, definition, output, as_json=as_json)

    run.__name__, run.__doc__ = definition.name, definition.help
    own = list(_arguments(definition))
    names = [
        one.name for one in own
        if one.default is not Argument.empty and one.name not in SHARED_OPTIONS
    ]  # fmt: skip
    return with_shared_options(
        run,
        own,
        [*names, *definition.shared],
        help_texts=definition.texts,
        makes_costs=definition.makes_costs,
        ending=definition.output.ending if definition.output else ".npz",
    )


def outputs_named(definition: Command, output: Path | None) -> list[Path]:
    """Return the files that ``-o`` stands for; a function that takes it writes them itself."""
    if output is None or definition.output is None or definition.takes_output:
        return []
    return list(definition.output.paths(output))


def _accepted(
    definition: Command, values: dict[str, Any], settings: Settings
) -> dict[str, Any]:  # fmt: skip
    parameters = definition.parameters
    given = {name: getattr(settings, name) for name in parameters if name in _OF_SETTINGS}
    if definition.takes_output and definition.output is not None:
        values[definition.output.parameter] = values.pop("output")
    for name, value in values.items():
        if name in definition.inputs and not definition.inputs[name][2] and value in (None, []):
            continue
        if name in definition.inputs or (name in _OF_ROBOT and name in parameters):
            given[name] = value
        elif name in parameters and value is not None:
            given[name] = _value_of(parameters[name], value)
    return given


def _called(definition: Command, given: dict[str, Any]) -> Any:
    try:
        return definition.function(**given)
    except ParameterError as error:
        names = str(error.place).split(", ")
        if error.source is None and {*definition.parameters, *SHARED_OPTIONS}.issuperset(names):
            error.source, error.place = ", ".join(_typed(definition, one) for one in names), None
        raise


def _typed(definition: Command, name: str) -> str:
    own = definition.parameters.get(name)
    if own is None or name in _OF_ROBOT:
        return _OF_ROBOT.get(name) or f"--{name.replace('_', '-')}"
    return option_name(own)


def _value_of(parameter: Parameter, value: Any) -> Any:
    words = parameter.words
    try:
        if words is not None and words.read is not None:
            return words.read(value)
        return value if parameter.is_as_typed else parameter.accept(value)
    except ParameterError as error:
        error.source, error.place = option_name(parameter), None
        raise


def _write(result: Result, work: Work, output: Path | None) -> None:
    transaction = work.begin()
    if output is not None and work.outputs:
        result.write(transaction, output)
    if work.settings.image is not None:
        image = result.drawn(image_extent=work.settings.image_extent)
        write = partial(write_indexed_png, indices=image.indices, palette=image.palette)
        transaction.write(work.settings.image, write)


def _tell(result: Result, definition: Command, output: Path | None, *, as_json: bool) -> None:
    if as_json:
        terminal.stream(result.parts())
    elif output is not None and _is_all(definition):
        terminal.summary(result.summary(output))  # what was asked for is in the file
        terminal.summary(result.found(), is_asked_for=True)
    else:
        terminal.summary(result.lines(), is_asked_for=True)
        terminal.summary(result.closing())
    for line in result.details():
        terminal.detail(line)
    terminal.remark(result.remarks())
    result.check()
    if not result.passes:
        raise typer.Exit(1)


def _is_all(definition: Command) -> bool:
    """Return whether the output, where it is asked for, has the answer instead of the terminal."""
    output = definition.output
    return definition.json == "default" or (output is not None and output.is_required)


def _arguments(definition: Command) -> Iterator[Argument]:
    meanings, output = definition.meanings, definition.output
    for name, (kind, words, is_required) in definition.inputs.items():
        if output is not None and name == output.parameter:
            continue
        is_map = kind in _TYPES or words.streams
        text = first_sentence(meanings[name])
        default = Argument.empty if is_required else None
        if words.name is None:
            text = f"{text} {OR_STDIN}" if is_map else text
            declared = typer.Argument(metavar=words.metavar or "MAP", help=text)
        else:
            declared = typer.Option(f"--{words.name}", metavar=words.metavar, help=text)
        marks = [FROM_STDIN] if is_map else []
        typed = words.typed or _TYPES.get(kind, kind)
        yield _argument(name, Annotated[(typed, declared, *marks)], default)
    if output is not None:
        is_text = output.ending != ".npz" or definition.json == "default"
        stream = "Or - for stdout." if is_text else OR_STDOUT
        is_streamed = output.streams or definition.json == "default"
        text = f"{output.about} {stream}" if is_streamed else output.about
        declared = typer.Option("--output", "-o", metavar=output.metavar, help=text)
        marks = [TO_STDOUT] if output.streams else []
        kind, default = (Path, Argument.empty) if output.is_required else (Path | None, None)
        yield _argument("output", Annotated[(kind, declared, *marks)], default)
    for name, parameter in definition.parameters.items():
        if name not in {*_OF_ROBOT, *_OF_SETTINGS, "output"} and not parameter.from_robot:
            yield _argument(name, _option(parameter, first_sentence(meanings[name])), None)
    if definition.json != "never":
        yield _argument("as_json", _JSON, False)


def _option(parameter: Parameter, text: str) -> Any:
    option = option_of(parameter, text, is_flag=parameter.default is False)
    marks = [FROM_STDIN] if parameter.words is not None and parameter.words.streams else []
    return Annotated[(type_of(parameter) | None, option, *marks)]


def _argument(name: str, annotation: Any, default: Any) -> Argument:
    return Argument(name, Argument.KEYWORD_ONLY, default=default, annotation=annotation)
