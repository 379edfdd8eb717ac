"""The entry point: builds the command line, runs it, and turns errors into exit codes."""

from __future__ import annotations

import contextlib
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.models import TyperPath

from mapdeal.cli import terminal
from mapdeal.cli.help_pages import in_groups, lay_out, write_commands
from mapdeal.cli.process import begin_work, ending
from mapdeal.cli.streams import DASH
from mapdeal.cli.usage import accept_spellings, usage_error
from mapdeal.errors import (
    FileAccessError,
    FindingError,
    MapdealError,
    ParameterError,
    refusal_of_the_system,
)

# typer brings its own copy of click in new versions and uses the package in old ones; both
# have the same tree of errors, reached from the one class that typer exports.
_UsageError: Any = typer.BadParameter.__mro__[1]
_ClickError: Any = typer.BadParameter.__mro__[2]

_OTHERS = (
    "run", "local", "build", "query", "route", "edit", "window", "shift", "convert", "pack",
    "unpack", "info", "lint", "diff", "align", "merge", "rotate", "rescale", "clean", "score",
    "report", "completion",
)  # fmt: skip
_WORDS = {"yes": "", "true": "", "on": "", "no": "no-", "false": "no-", "off": "no-"}

_OF_STAGES = ("reach",)
"""Stages whose commands are not made from their parameters: they answer questions."""

_OF_POINTS = {"query": "--at", "edit": "--point", "reach": "--to"}
_POINT = re.compile(r"(?:[^-=,][^=,]*=)?[-+0-9.eE]+(?:,[-+0-9.eE]+){1,2}")

_INTERRUPTED, _INTERNAL = 130, 70
_EPOCH = "SOURCE_DATE_EPOCH"
_EPOCH_DIGITS = 11  # up to the year 5138


def command_names() -> list[str]:
    """Return the names of all commands, in the order of ``--help``."""
    from mapdeal.stages.catalogue import STAGE_NAMES  # which loads numpy

    names = [*STAGE_NAMES, *_OTHERS]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise ValueError(f"a stage has the name of another command: {', '.join(sorted(twice))}")
    return [name for members in in_groups(names).values() for name in members]


class _ReaderGoneError(Exception):
    """Whoever read our output has seen enough."""


class _InterruptedError(Exception):
    """Somebody has pressed Ctrl-C, or ended the process by another signal."""


@contextmanager
def _own_endings() -> Iterator[None]:
    """Keep two endings from click, which has exit codes and silence of its own for them."""
    try:
        yield
    except BrokenPipeError:
        raise _ReaderGoneError from None
    except KeyboardInterrupt as interrupt:
        raise _InterruptedError(*interrupt.args) from None


class _NotEmpty:
    """Converts the name of a file or folder; an empty one would be the working folder."""

    def __init__(self, convert: Callable[..., Any]) -> None:
        self._convert = convert

    def __call__(self, value: Any, parameter: Any, context: Any) -> Any:
        if not os.fspath(value):
            raise typer.BadParameter("must not be empty", ctx=context, param=parameter)
        if value != "-" and Path(value) == DASH:  # ./- is the file of that name
            from mapdeal.formats.source import absolute_path

            return self._convert(str(absolute_path(DASH)), parameter, context)
        return self._convert(value, parameter, context)


def _made_context(make: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Have click read the options, of which --help prints."""
    try:
        with _own_endings():
            return make(*args, **kwargs)
    except OSError as error:  # nothing else is done here
        rule = f"cannot be written: {error.strerror or error}"
        raise FileAccessError(rule, source="standard output") from None


def _leave_files_to_us(command: Any) -> None:
    """Keep a command, and those below it, from saying in click's way what cannot be used."""
    command.make_context = partial(_made_context, command.make_context)
    for parameter in command.params:
        accept_spellings(parameter)
        if isinstance(parameter.type, TyperPath):
            parameter.type.readable = False  # whoever opens the file says why it cannot
            vars(parameter.type)["convert"] = _NotEmpty(parameter.type.convert)
    for below in getattr(command, "commands", {}).values():
        _leave_files_to_us(below)


class _LazyGroup(TyperGroup):
    """A group that imports a command when it is asked for.

    The commands of stages are made from their definitions, unless they have more to ask. Each
    other one lives in ``mapdeal.cli.<name>`` as a typer app with one command.
    """

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002 - click's signature
        return command_names()

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002 - click's signature
        if cmd_name in self.commands:
            return self.commands[cmd_name]
        if cmd_name in (*_OF_STAGES, *_OTHERS):
            app = import_module(f"mapdeal.cli.{cmd_name}").app
        else:
            if cmd_name not in command_names():
                return None
            from mapdeal.cli.stage_command import stage_app

            app = stage_app(cmd_name)
        begin_work()
        command: Any = typer.main.get_command(app)
        _leave_files_to_us(command)
        lay_out(command, cmd_name)
        command.name = cmd_name
        first, _, _ = (command.help or "").partition("\n\n")
        command.short_help = " ".join(first.split())  # else it is cut off in the list
        command.context_settings["help_option_names"] = ["-h", "--help"]
        self.commands[cmd_name] = command
        return command

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands in groups."""
        write_commands(self, ctx, formatter)

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Read the options, of which --help and --version print."""
        return _made_context(super().make_context, *args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with _own_endings():
            return super().invoke(ctx)


app = typer.Typer(
    cls=_LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from mapdeal.kernels.engine import version_text

        terminal.result(version_text())
        raise typer.Exit


@app.callback()
def mapdeal(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Process robot map files without ROS.

    Start with: mapdeal run MAP.yaml -o out

    A MAP is a map_server .yaml with its image, a .pbm with its .yaml, an .npz written by mapdeal,
    or - for such an .npz on standard input. Lengths are in metres, angles in radians. "mapdeal
    COMMAND --help" shows the options of a command, with examples.
    """


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    terminal.accept_all_characters()
    terminal.show_warnings()
    _forget_odd_epoch()
    command = typer.main.get_command(app)
    if os.environ.get("_MAPDEAL_COMPLETE"):  # a shell asks for words
        from mapdeal.cli.completion import prepare_completion

        prepare_completion()
    try:
        words = list(sys.argv[1:] if arguments is None else arguments)
        words = _spread_points(_joined_flags(words, _yes_or_no_options(command, words)))
        code = command.main(args=words or ["--help"], prog_name="mapdeal", standalone_mode=False)
        if code == _INTERRUPTED:  # of a signal that came where only typer noticed it
            raise KeyboardInterrupt
        terminal.finish()
    except MapdealError as error:
        problem = _worse_than(error)
        if isinstance(problem, FileAccessError) and problem.is_missing and problem.hint is None:
            from mapdeal.formats.nearby import file_meant

            problem.hint = file_meant(str(problem.source))
        terminal.error(problem)
        return problem.exit_code
    except _ClickError as error:
        terminal.error(usage_error(error, command_names))
        return ParameterError.exit_code
    except (KeyboardInterrupt, _InterruptedError, typer.Abort) as interrupt:
        what, code = ending()
        terminal.error(MapdealError("; ".join([what, *interrupt.args])))
        return code
    except _ReaderGoneError:
        return 0
    except Exception as error:  # noqa: BLE001 - the last resort, which says that it is one
        refusal = refusal_of_the_system(error)
        if refusal is not None:
            terminal.error(refusal)
            return refusal.exit_code
        with contextlib.suppress(OSError):
            traceback.print_exc()
        terminal.error(
            MapdealError("internal error", hint="this is a bug in mapdeal; please report it")
        )
        return _INTERNAL
    return code if isinstance(code, int) else 0


def _forget_odd_epoch() -> None:
    """Drop a SOURCE_DATE_EPOCH that is no time: scipy's imports would fail on it.

    No output of ours holds a time.
    """
    epoch = os.environ.get(_EPOCH, "0")
    if not epoch.isdecimal() or len(epoch) > _EPOCH_DIGITS:
        del os.environ[_EPOCH]


def _worse_than(error: MapdealError) -> MapdealError:
    """Return the error to report: that results are lost is worse than a finding."""
    if isinstance(error, FindingError):
        try:
            terminal.finish()
        except FileAccessError as lost:
            return lost
    return error


def _spread_points(words: list[str]) -> list[str]:
    """Let an option that is repeated for each point be given once: ``--at 1,2 3,4``."""
    option = _OF_POINTS.get(words[0]) if words else None
    spread: list[str] = []
    follows = False
    for index, word in enumerate(words):
        is_value = index > 0 and words[index - 1] == option
        if follows and not is_value and _POINT.fullmatch(word):
            spread.append(option or "")
        else:
            follows = is_value or (option is not None and word == option)
        spread.append(word)
    return spread


def _yes_or_no_options(command: Any, words: Sequence[str]) -> set[str]:
    """Return the names of the options with a ``--no-`` form of the command that is asked for."""
    for word in words:
        if not isinstance(command, TyperGroup) or word.startswith("-"):
            break
        command = command.get_command(None, word)  # type: ignore[arg-type]
    return {
        name.removeprefix("--")
        for parameter in getattr(command, "params", ())
        for name in parameter.opts
        if name.replace("--", "--no-", 1) in parameter.secondary_opts
    }


def _joined_flags(words: list[str], names: set[str]) -> list[str]:
    """Let flags be written as parameters are: ``--inflate-unknown no``, ``=no``.

    Recipes spell the parameter ``inflate_unknown: no``; its option is a pair of flags.
    """
    joined: list[str] = []
    index = 0
    while index < len(words):
        name, equals, value = words[index].removeprefix("--").partition("=")
        if words[index] == "--":
            return joined + words[index:]
        if words[index].startswith("--") and name in names:
            if not equals and index + 1 < len(words) and words[index + 1].lower() in _WORDS:
                index += 1
                value = words[index]
            word = f"--{_WORDS.get(value.lower(), '')}{name}"
            if value and value.lower() not in _WORDS:
                raise ParameterError("must be yes or no", source=f"--{name}", got=value)
            joined.append(word)
        else:
            joined.append(words[index])
        index += 1
    return joined
