"""Commands of the shell, made from their definitions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from inspect import Parameter as Argument
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import typer

from mapdeal.cli import terminal
from mapdeal.cli.options import OR_STDIN, OR_STDOUT, option_name, option_of, type_of
from mapdeal.cli.shared_options import SHARED_OPTIONS, with_shared_options
from mapdeal.cli.stage_command import first_sentence
from mapdeal.cli.streams import FROM_STDIN, TO_STDOUT
from mapdeal.command import Command, Parameter, Result, commands_named
from mapdeal.errors import ParameterError
from mapdeal.maps.png import write_indexed_png
from mapdeal.pipeline.inputs import Map, Work
from mapdeal.pipeline.settings import Settings

_OF_ROBOT = {"footprint": "--footprint, --robot-radius", "robot": "--params-file"}
"""Parameters that options in common stand for, and which these are."""

_OF_SETTINGS = {name for name, one in SHARED_OPTIONS.items() if one.field == name}
"""Parameters that get the value of the setting of their name."""

_JSON = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]
_TYPES = {Map: Path, Map | None: Path | None, Sequence[Map]: list[Path]}
"""What typer reads maps as."""


def command_app(name: str, module: ModuleType) -> typer.Typer:
    """Return the typer application with the command of a module, or its group of commands."""
    app = typer.Typer(rich_markup_mode=None, add_completion=False)
    members = commands_named(name)
    if "" not in members:
        app.callback(help=module.__doc__)(lambda: None)
    for word, definition in members.items():
        app.command(word or None)(made_command(definition))
    return app


def made_command(definition: Command) -> Any:
    """Return the function that typer makes a command of."""

    def run(*, settings: Settings, **values: Any) -> None:
        as_json = values.pop("as_json", False)
        output = values.get("output")
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
    )


def outputs_named(definition: Command, output: Path | None) -> list[Path]:
    """Return the files that ``-o`` stands for; a function that takes it writes them itself."""
    if output is None or definition.output is None or definition.takes_output:
        return []
    return list(definition.output.paths(output))


def _accepted(
    definition: Command, values: dict[str, Any], settings: Settings
) -> dict[str, Any]:  # fmt: skip
    """Return the arguments of a command's function for what the shell has given."""
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
    """Call a command's function; its errors name options as they are typed."""
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
    """Return what a word of the shell stands for; errors name the option."""
    words = parameter.words
    try:
        if words is not None and words.read is not None:
            return words.read(value)
        return value if parameter.is_as_typed else parameter.accept(value)
    except ParameterError as error:
        error.source, error.place = option_name(parameter), None
        raise


def _write(result: Result, work: Work, output: Path | None) -> None:
    """Write what the command has made to the output, and its picture if one is asked for."""
    transaction = work.begin()
    if output is not None and work.outputs:
        result.write(transaction, output)
    if work.settings.image is not None:
        image = result.drawn(image_extent=work.settings.image_extent)
        write = partial(write_indexed_png, indices=image.indices, palette=image.palette)
        transaction.write(work.settings.image, write)


def _tell(result: Result, definition: Command, output: Path | None, *, as_json: bool) -> None:
    if as_json or (definition.json == "default" and output is None):
        terminal.stream(result.parts())
    elif output is not None and _is_all(definition):
        terminal.summary(result.summary(output))  # what was asked for is in the file
    else:
        terminal.document(result, result.lines())
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
    """Yield what typer takes for the inputs, the output and the parameters of a command."""
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
        text = f"{output.about} {OR_STDOUT}" if output.streams else output.about
        declared = typer.Option("--output", "-o", metavar=output.metavar, help=text)
        marks = [TO_STDOUT] if output.streams else []
        kind, default = (Path, Argument.empty) if output.is_required else (Path | None, None)
        yield _argument("output", Annotated[(kind, declared, *marks)], default)
    for name, parameter in definition.parameters.items():
        if name not in {*_OF_ROBOT, *_OF_SETTINGS, "output"} and not parameter.from_robot:
            yield _argument(name, _option(parameter, first_sentence(meanings[name])), None)
    if definition.json == "asked":
        yield _argument("as_json", _JSON, False)


def _option(parameter: Parameter, text: str) -> Any:
    option = option_of(parameter, text, is_flag=parameter.default is False)
    marks = [FROM_STDIN] if parameter.words is not None and parameter.words.streams else []
    return Annotated[(type_of(parameter) | None, option, *marks)]


def _argument(name: str, annotation: Any, default: Any) -> Argument:
    return Argument(name, Argument.KEYWORD_ONLY, default=default, annotation=annotation)
