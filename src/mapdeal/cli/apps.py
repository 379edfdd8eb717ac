"""Commands of the shell, made from their definitions."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import cached_property, partial
from inspect import Parameter as Argument
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import typer

from mapdeal import command as definitions, errors, records
from mapdeal.cli import options as opt, terminal
from mapdeal.command import Command, Output, Parameter, Result, Stage, Words
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.values import join_words
from mapdeal.maps import formats, map_server, png
from mapdeal.pipeline.folder import files_of, step_line
from mapdeal.pipeline.inputs import InShell, Map, Work, need_folder
from mapdeal.pipeline.recipe import RecipeName, load_recipe, step_for, step_of_recipe
from mapdeal.pipeline.run import SingleResult, apply_to_file
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import Step, make_step
from mapdeal.ros.robot import RobotParameters
from mapdeal.stages.catalogue import models_of

_FIRST_SENTENCE = re.compile(r".*?\.(?=\s+[A-Z`]|$)")
_INPUTS: dict[type[Any], tuple[str, str]] = {  # in --help: grids that stages accept besides maps
    DistanceField: ("ESDF.npz", "the distance field of one"),
    Costmap: ("COST.npz", "a costmap"),
}
_MEMORY = (
    "Memory to use, such as 4G or 500M; maps that need more are processed in blocks of rows.  "
    "[default: half of the free memory]"
)
_JSON = "Print one JSON document."
_JSON_OF_COSTS = "Print one JSON document: parameters, figures, and the cost curve as a table."
_EDITED = f"{formats.or_other_formats('The result: .yaml or .pgm (a pgm pair), .png (a pair)')}."


def _apply_stage(
    models: Mapping[str | None, Stage], *, source: Path, output: Path, work: InShell,
    footprint: Footprint | None = None, robot: Annotated[RobotParameters | None, Words()] = None,
    recipe: RecipeName = None, encoding: map_server.Encoding = "occupancy",
    curve: Annotated[Path | None, Words("FILE.png")] = None, **values: Any,
) -> SingleResult:  # fmt: skip
    """Apply a stage to a file.

    Parameters
    ----------
    recipe : str, optional
        Use the costs of a recipe, as for mapdeal run; options override it.
    encoding : {'occupancy', 'costmap2d'}
        Pixels of a .yaml: the values that ROS publishes, or costmap_2d's bytes.
    curve : path, optional
        Also plot the cost over the distance from the nearest obstacle, with the robot's radii.
    """
    stage = next(iter(models.values()))
    inputs = [] if robot is None else robot.paths
    before: Sequence[Step] = ()
    if recipe is not None:
        step = step_of_recipe(recipe, stage.name, values, footprint=footprint, robot=robot)
    elif robot is not None:
        shaped = robot if footprint is None else robot.with_shape(footprint)
        step = step_for(stage.name, shaped, values)
        model = step.stage
        if model.robot is None and model.parameters_from_layers(shaped.costmap_layers) is None:
            text = f"--params-file: model {model.model} takes no shape and no costs of it"
            errors.emit_warning(f"{text}, only which occupancy is lethal")
        if stage.needs_costs(step.parameters):
            before = load_recipe(shaped).steps
    else:
        step = _step_of(models, footprint, values)
        shape = step.stage.robot if stage.product_type is Costmap and footprint is None else None
        if shape is not None and shape.replaces not in values:
            text = "no robot is given, by --robot-radius, --footprint, --params-file or --recipe"
            errors.emit_warning(f"{text}: the costs are those of a point")
    terminal.detail(step_line(step))
    started = time.perf_counter()
    result = apply_to_file(
        source, output, step, work.settings, encoding=encoding, curve=curve,
        with_curve=work.as_json and stage.product_type is Costmap, with_sums=work.as_json,
        also_read=inputs, before=before, robot=robot if stage.product_type is Costmap else None,
    )  # fmt: skip
    terminal.detail(f"{stage.name}: {time.perf_counter() - started:.3f} s")
    return result


@records.dataclass(frozen=True, eq=False)
class _StageCommand(Command):
    models: Mapping[str | None, Stage] = records.field(default_factory=dict)

    @property
    def _first(self) -> Stage:
        return next(iter(self.models.values()))

    @property
    def help(self) -> str:
        return "\n\n".join(filter(None, [self._first.summary, self._first.details]))

    @cached_property
    def inputs(self) -> dict[str, tuple[Any, Words, bool]]:
        metavars = ["MAP", *(_INPUTS[kind][0] for kind in self._first.takes if kind in _INPUTS)]
        return {"source": (Path, Words("|".join(metavars), streams=True), True)}

    @cached_property
    def meanings(self) -> dict[str, str]:
        """Description of each parameter; those of some models begin with their names."""
        stage = self._first
        *before, last = ["", *(_INPUTS[kind][1] for kind in stage.takes if kind in _INPUTS)]
        source = f"{', '.join(['A map', *before[1:]])}, or {last}."
        if not last:
            source = f"{join_words(entry.name for entry in formats.FORMATS)}."
            source = f"{source[:1].upper()}{source[1:]}"
        model = f"The rule of the {stage.name}s.  [default: {next(iter(self.models))}"
        model += "; with --params-file the robot's]" if stage.robot is not None else "]"
        texts = {"source": source, "model": model, **definitions.meanings_of(_apply_stage)}
        texts["as_json"] = _JSON_OF_COSTS if stage.product_type is Costmap else _JSON
        for name, owners in self._owners.items():
            text = next(iter(owners.values())).meanings[name]
            if len(owners) < len(self.models):
                text = f"{', '.join(map(str, owners))}: {text[:1].lower()}{text[1:]}"
            texts[name] = text
        return texts

    @cached_property
    def parameters(self) -> dict[str, Parameter]:
        own = definitions.parameters_of(_apply_stage)
        is_of_costs = self._first.product_type is Costmap
        found = {"recipe": own["recipe"]} if is_of_costs else {}
        if None not in self.models:
            names = [str(model) for model in self.models]
            words = Words("|".join(names), completed=lambda: names)
            found["model"] = Parameter("model", None, str, True, (), words=words)
        for name, owners in self._owners.items():
            parameter = next(iter(owners.values())).parameters[name]
            if any(stage.parameters[name] != parameter for stage in owners.values()):
                rule = f"models {', '.join(map(str, owners))} of {self.name} have different"
                raise ValueError(f"{rule} parameters of one name: {name}")
            if not parameter.is_structured:  # else set by the robot's shape or by a recipe
                found[name] = parameter
        last = ["encoding", "curve"] if is_of_costs else []
        last += ["footprint", "robot"] if "robot" in self.shared else []
        return found | {name: own[name] for name in [*last, "output"]}

    @property
    def _owners(self) -> dict[str, dict[str | None, Stage]]:
        """Models by parameter; parameters that every one of several models has come last."""
        names = dict.fromkeys(name for stage in self.models.values() for name in stage.parameters)
        owners = {name: {model: own for model, own in self.models.items() if name in own.parameters}
                  for name in names}  # fmt: skip
        several = len(self.models) > 1
        last = [name for name, own in owners.items() if several and len(own) == len(self.models)]
        return {name: owners[name] for name in sorted(owners, key=last.__contains__)}


def _command_of_stage(name: str) -> Command:
    models = models_of(name)
    first = next(iter(models.values()))
    files = files_of(first.product_type)
    output = Output("OUT", _EDITED) if first.edits else Output(files.metavar, files.about)
    has_robot = any(stage.robot is not None for stage in models.values())
    is_of_costs = first.product_type is Costmap
    shared = ["robot"] * has_robot + ["mask"] * is_of_costs
    texts = {} if first.edits else {"max_memory": _MEMORY}
    if first.shows_changes:
        texts["image"] = "Write a picture of the changed cells."
    return _StageCommand(
        partial(_apply_stage, models), first.group, first.example, name, output,
        (*shared, "files"), texts, models=models,
        makes_costs=lambda values: is_of_costs and values.get("recipe") is None,
    )  # fmt: skip


def first_sentence(text: str) -> str:
    match = _FIRST_SENTENCE.match(text)
    return (match[0] if match else text).replace("`", "")


def _step_of(
    models: Mapping[str | None, Stage], footprint: Footprint | None, values: Mapping[str, object]
) -> Step:
    name = next(iter(models.values())).name
    model = values.get("model", next(iter(models)))
    stage = models.get(None if model is None else str(model))
    if footprint is None or stage is None:  # `make_step` refuses an unknown model
        return make_step(name, values)
    if (shape := stage.robot) is None:
        shaped = " and ".join(str(stage.model) for stage in models.values() if stage.robot)
        rule = f"only {name}s of model {shaped} depend on the robot's shape"
        raise errors.ParameterError(rule, source="--model", got=model)
    if shape.replaces in values:
        rule = "cannot be given together with a robot's shape"
        raise errors.ParameterError(rule, source=f"--{shape.replaces.replace('_', '-')}")
    return make_step(name, {**values, **shape.parameters(footprint)})


_OF_ROBOT = {  # shared options by the parameter that they set
    "footprint": "--footprint, --robot-radius", "robot": "--params-file", "against": "--against"
}  # fmt: skip
_OF_SETTINGS = opt.OF_SETTINGS & opt.SHARED_OPTIONS.keys() - {*opt.OF_IMAGES}
_TYPES = {Map: Path, Map | None: Path | None, Sequence[Map]: list[Path]}  # what typer reads maps as


def command_app(name: str, module: ModuleType | None = None) -> typer.Typer:
    app = typer.Typer(rich_markup_mode=None, add_completion=False)
    members = {"": _command_of_stage(name)} if module is None else definitions.commands_named(name)
    for word, definition in members.items():
        own: dict[str, Any] = {"rich_help_panel": definition.group, "epilog": definition.example}
        if word and not app.registered_callback:
            app.callback(help=module.__doc__, **own)(lambda: None)
        app.command(word or None, **own)(_shell_function(definition))
    return app


def _shell_function(definition: Command) -> Any:
    def run(*, settings: Settings, **values: Any) -> None:
        as_json = values.pop("as_json", False)
        output = values.get("output")
        if definition.json == "default":
            if output == terminal.DASH:
                output, as_json = None, True
                values["output"] = None
            as_json = as_json or (output is None and not terminal.has_reader())
        if as_json:
            terminal.need_stdout()
        if output is not None and definition.output and definition.output.metavar == "DIR":
            need_folder(output)
        with ExitStack() as stack:
            outputs = []  # if the function takes the output, it writes the files
            if output is not None and definition.output and not definition.takes_output:
                outputs = list(definition.output.paths(output))
            work = Work(settings, outputs, stack, terminal, as_json=as_json)
            stack.callback(Work.current.reset, Work.current.set(work))
            result = _call(definition, _accept_values(definition, values, work))
            if not isinstance(result, Result):
                return
            if not isinstance(definition, _StageCommand):
                _write(result, work, None if definition.takes_output else output)
        _print(result, definition, output, as_json=as_json)

    run.__name__, run.__doc__ = definition.name, definition.help
    own = list(_arguments(definition))
    is_stage = isinstance(definition, _StageCommand)
    names = [argument.name for argument in own
             if (is_stage and argument.name not in {*definition.inputs, "output"})
             or (argument.default is not Argument.empty
                 and argument.name not in opt.SHARED_OPTIONS)]  # fmt: skip
    names = list(opt.expanded([*names, *definition.shared]))
    if "image" in names and not (is_stage or definition.may_have_picture):
        names = [name for name in names if name not in ("image", "image_extent")]
    return opt.with_shared_options(run, own, names, definition, _streams_of(definition))


def _accept_values(definition: Command, values: dict[str, Any], work: Work) -> dict[str, Any]:
    parameters, inputs = definition.parameters, definition.inputs
    accepted = {name: getattr(work.settings, name) for name in parameters if name in _OF_SETTINGS}
    accepted |= {"work": work} if definition.takes_work else {}
    if definition.takes_output and definition.output is not None:
        values[definition.output.parameter] = values.pop("output")
    for name, value in values.items():
        if name in inputs and not inputs[name][2] and value in (None, []):
            continue
        if name in inputs or (name in parameters and _is_of_robot(parameters[name])):
            accepted[name] = value
        elif name in parameters and value is not None:
            accepted[name] = _accept(parameters[name], value)
    return accepted


def _is_of_robot(parameter: Parameter) -> bool:
    """Return whether shared options stand for a parameter, as it has no option of its own."""
    has_option = parameter.words is not None and parameter.words.metavar is not None
    return parameter.name in _OF_ROBOT and not has_option


def _call(definition: Command, values: dict[str, Any]) -> Any:
    try:
        return definition.function(**values)
    except errors.ParameterError as error:
        names = str(error.place).removeprefix(f"{definition.name}.").split(", ")
        if error.source is None and {*definition.parameters, *opt.SHARED_OPTIONS}.issuperset(names):
            keys = {name: own.key for name, own in definition.parameters.items()}
            options = (_OF_ROBOT.get(n) or f"--{keys.get(n, n).replace('_', '-')}" for n in names)
            error.source, error.place = ", ".join(options), None
        raise


def _accept(parameter: Parameter, value: Any) -> Any:
    words = parameter.words
    try:
        if words is not None and words.read is not None:
            return words.read(value)
        return value if parameter.is_as_typed else parameter.accept(value)
    except errors.ParameterError as error:
        error.source, error.place = opt.option_name(parameter), None
        raise


def _write(result: Result, work: Work, output: Path | None) -> None:
    transaction = work.begin()
    if output is not None and work.outputs:
        result.write(transaction, output)
    if work.settings.image is not None:
        image = result.drawn(image_extent=work.settings.image_extent)
        write = partial(png.write_png, pixels=image.indices, palette=image.palette)
        transaction.write(work.settings.image, write)


def _print(result: Result, definition: Command, output: Path | None, *, as_json: bool) -> None:
    is_required = definition.output is not None and definition.output.is_required
    if as_json:
        terminal.stream(result.parts())
    elif output is not None and (definition.json == "default" or is_required):
        terminal.summary(result.summary(output))  # the file contains the result
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


def _streams_of(definition: Command) -> dict[str, bool]:
    """Return which parameters accept ``-``, and whether that is the output."""
    words = {name: own.words for name, own in definition.parameters.items() if own.words}
    words |= {name: own for name, (_, own, _) in definition.inputs.items()}
    maps = [name for name, (kind, _, _) in definition.inputs.items() if kind in _TYPES]
    streams = dict.fromkeys([*maps, *(name for name, own in words.items() if own.streams)], False)
    has_output = definition.output is not None and definition.output.streams
    return {**streams, "output": True} if has_output else streams


def _arguments(definition: Command) -> Iterator[Argument]:
    meanings, output = definition.meanings, definition.output
    for name, (kind, words, is_required) in definition.inputs.items():
        if output is not None and name == output.parameter:
            continue
        is_map = kind in _TYPES or words.streams
        text = first_sentence(meanings[name])
        if words.name is None:
            text = f"{text} {opt.OR_STDIN}" if is_map else text
            declared = typer.Argument(metavar=words.metavar or "MAP", help=text)
        else:
            declared = typer.Option(f"--{words.name}", metavar=words.metavar, help=text)
        typed = words.typed or _TYPES.get(kind, kind)
        default = Argument.empty if is_required else None
        yield _argument(name, Annotated[typed, declared], default)
    if output is not None:
        is_text = output.ending != ".npz" or definition.json == "default"
        stream = "Or - for stdout." if is_text else opt.OR_STDOUT
        is_streamed = output.streams or definition.json == "default"
        text = f"{output.about} {stream}" if is_streamed else output.about
        declared = typer.Option("--output", "-o", metavar=output.metavar, help=text)
        kind, default = (Path, Argument.empty) if output.is_required else (Path | None, None)
        yield _argument("output", Annotated[kind, declared], default)
    for name, parameter in definition.parameters.items():
        if name in {*_OF_SETTINGS, "output"} or parameter.from_robot or _is_of_robot(parameter):
            continue
        is_flag = parameter.default is False and not isinstance(definition, _StageCommand)
        option = opt.option_of(parameter, first_sentence(meanings[name]), is_flag=is_flag)
        is_required = parameter.is_required
        kind = opt.type_of(parameter) if is_required else opt.type_of(parameter) | None
        default = Argument.empty if is_required else None
        yield _argument(name, Annotated[kind, option], default)
    if definition.json != "never":
        option = typer.Option("--json", help=meanings.get("as_json", _JSON))
        yield _argument("as_json", Annotated[bool, option], False)


def _argument(name: str, annotation: Any, default: Any) -> Argument:
    return Argument(name, Argument.KEYWORD_ONLY, default=default, annotation=annotation)
