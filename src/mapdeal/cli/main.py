"""The entry point: builds the command line, runs it, and turns errors into exit codes."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from mapdeal.cli import terminal
from mapdeal.cli.help_pages import in_groups, lay_out, write_commands
from mapdeal.cli.process import begin_work, ending
from mapdeal.cli.usage import accept_words, usage_error
from mapdeal.errors import FileAccessError, FindingError, MapdealError, refusal_of_the_system

# typer brings its own copy of click in new versions and uses the package in old ones; both
# have the same tree of errors, reached from the one class that typer exports.
_ClickError: Any = typer.BadParameter.__mro__[2]

_OTHERS = ("completion",)
COMMANDS = (
    "run",
    "local",
    "align",
    "diff",
    "score",
    "build",
    "query",
    "route",
    "convert",
    "merge",
    "lint",
    "edit",
    "pack",
    "unpack",
    "info",
    "report",
)
_MODULES = {"unpack": "pack"}
_OF_STAGES = ("reach",)
"""Stages whose commands are not made from their parameters: they answer questions."""


def command_names() -> list[str]:
    """Return the names of all commands, in the order of ``--help``."""
    from mapdeal.stages.catalogue import STAGE_NAMES  # which loads numpy

    names = [*STAGE_NAMES, *COMMANDS, *_OTHERS]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise ValueError(f"a stage has the name of another command: {', '.join(sorted(twice))}")
    return [name for members in in_groups(names).values() for name in members]


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
        if cmd_name in (*COMMANDS, *_OF_STAGES):
            from mapdeal.cli.apps import command_app

            module = import_module(f"mapdeal.commands.{_MODULES.get(cmd_name, cmd_name)}")
            app = command_app(cmd_name, module)
        elif cmd_name in _OTHERS:
            app = import_module(f"mapdeal.cli.{cmd_name}").app
        else:
            if cmd_name not in command_names():
                return None
            from mapdeal.cli.stage_command import stage_app

            app = stage_app(cmd_name)
        begin_work()
        command: Any = typer.main.get_command(app)
        for name, one in (("", command), *getattr(command, "commands", {}).items()):
            accept_words(one, cmd_name)
            lay_out(one, f"{cmd_name} {name}".strip())
        command.name = cmd_name
        first, _, _ = (command.help or "").partition("\n\n")
        command.short_help = " ".join(first.split())  # else it is cut off in the list
        command.context_settings["help_option_names"] = ["-h", "--help"]
        self.commands[cmd_name] = command
        return command

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        write_commands(self, ctx, formatter)


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
    terminal.prepare()
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        group = typer.main.get_command(app)
        if os.environ.get("_MAPDEAL_COMPLETE"):
            from mapdeal.cli.completion import prepare_completion

            prepare_completion()
            group.main(prog_name="mapdeal")  # answers the shell and ends the process
        # as click's own main, whose silence and exit codes are not ours
        with group.make_context("mapdeal", words or ["--help"]) as context:
            group.invoke(context)
        code = 0
    except typer.Exit as end:
        code = end.exit_code
    except FindingError as error:
        return _told(terminal.lost() or error)  # that results are lost is worse
    except FileAccessError as error:
        if error.is_missing and error.hint is None:
            from mapdeal.files.source import file_meant

            error.hint = file_meant(str(error.source))
        return _told(error)
    except MapdealError as error:
        return _told(error)
    except _ClickError as error:
        return _told(usage_error(error))
    except KeyboardInterrupt as interrupt:
        what, code = ending()
        _told(MapdealError("; ".join([what, *interrupt.args])))
        return code
    except BrokenPipeError:  # whoever reads has seen enough
        return 0
    except Exception as error:  # noqa: BLE001 - the last resort, which says that it is one
        refusal = refusal_of_the_system(error)
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:  # of --help, by typer
            rule = f"cannot be written: {error.strerror}"
            refusal = FileAccessError(rule, source="standard output")
        if refusal is not None:
            return _told(refusal)
        with contextlib.suppress(OSError):
            traceback.print_exc()
        return _told(
            MapdealError("internal error", hint="this is a bug in mapdeal; please report it")
        )
    lost = terminal.lost()
    return code if lost is None else _told(lost)


def _told(error: MapdealError) -> int:
    """Report an error; return its exit code."""
    terminal.error(error)
    return error.exit_code
