"""The entry point: builds the command line and its help, runs it, turns errors into exit codes."""

import contextlib
import errno
import os
import sys
import traceback
from collections.abc import Iterable, Sequence
from importlib import import_module
from importlib.util import find_spec
from pkgutil import iter_modules
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from mapdeal.cli import signals, terminal, usage
from mapdeal.errors import FileAccessError, FindingError, MapdealError, refusal_of_the_system

# New versions of typer contain a copy of click, old ones import the package. Both have the same
# error classes: bases of the class that typer exports.
_ClickError: Any = typer.BadParameter.__mro__[2]

GROUPS = (
    "Maps, distance fields, costmaps", "Questions about a map", "Changing a map",
    "Two maps of one place", "Laser scans and point clouds", "Formats", "CI and reports",
)  # fmt: skip
"""Titles under which ``mapdeal --help`` lists commands, in its order."""

_COMMON = "Common options"
_LAST = ("Robot", _COMMON)  # groups of options that many commands have, after a command's own
_FIRST = ("run", "view", "info", "reach", "clean", "diff", "build", "lint")  # in the overview


def command_names() -> list[str]:
    from mapdeal import commands
    from mapdeal.stages.catalogue import STAGE_NAMES  # which loads numpy

    modules = sorted(name for _, name, _ in iter_modules(commands.__path__) if "_" not in name)
    return list(dict.fromkeys([*modules, *STAGE_NAMES, "completion"]))


class _LazyGroup(TyperGroup):
    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002 - click's signature
        return command_names()

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002 - click's signature
        if cmd_name in self.commands:
            return self.commands[cmd_name]
        package = "cli" if cmd_name == "completion" else "commands"
        found = find_spec(f"mapdeal.{package}.{cmd_name}") if cmd_name.isalpha() else None
        if found is None and cmd_name not in command_names():
            return None
        from mapdeal.cli.apps import command_app

        module = None if found is None else import_module(found.name)  # stages have none
        app = command_app(cmd_name, module)
        signals.begin_work()
        command: Any = typer.main.get_command(app)
        for runnable in (command, *getattr(command, "commands", {}).values()):
            usage.accept_words(runnable, cmd_name)
            lay_out(runnable)
        command.name = cmd_name
        summary = (command.help or "").partition("\n\n")[0]
        command.short_help = " ".join(summary.split())  # click would shorten it
        command.context_settings["help_option_names"] = ["-h", "--help"]
        self.commands[cmd_name] = command
        return command

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        write_commands(self, ctx, formatter)


vars(typer.core)["rich"] = None  # typer before 0.12 would format help with it
app = typer.Typer(
    cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"]}, rich_markup_mode=None,
    add_completion=False, pretty_exceptions_enable=False,
)  # fmt: skip


def _print_version(is_requested: bool) -> None:
    if is_requested:
        from mapdeal.kernels.engine import version_text

        terminal.result(version_text())
        raise typer.Exit


_VERSION: Any = typer.Option(
    "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
)


@app.callback()
def mapdeal(version: Annotated[bool, _VERSION] = False) -> None:
    """Process robot map files without ROS.

    Start with: mapdeal run MAP.yaml -o out

    A MAP is a map_server .yaml with its image, a .pbm with its .yaml, a Cartographer .pbstream, an
    .npz written by mapdeal, or - for such an .npz on standard input. Lengths are in metres, angles
    in radians. "mapdeal COMMAND --help" shows the options of a command, with examples.
    """


def main(arguments: Sequence[str] | None = None) -> int:
    terminal.prepare()
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words[:1] == ["help"]:
        words = [*words[1:], "--help"]
    try:
        group = typer.main.get_command(app)
        if os.environ.get("_MAPDEAL_COMPLETE"):
            from mapdeal.cli.completion import prepare_completion

            prepare_completion()
            group.main(prog_name="mapdeal")  # replies to the shell and exits
        # instead of click's main, whose messages and exit codes differ
        with group.make_context("mapdeal", words or ["info"]) as context:
            if words:
                group.invoke(context)
            else:
                terminal.result(overview(group, context))
        code = 0
    except typer.Exit as end:
        code = end.exit_code
    except FindingError as error:
        return _report(terminal.lost() or error)  # lost results are worse
    except MapdealError as error:
        if isinstance(error, FileAccessError) and error.is_missing and error.hint is None:
            from mapdeal.files.source import similar_file_hint
            from mapdeal.maps.formats import MAP_ENDINGS

            name = str(error.source)
            error.hint = usage.point_hint(name, words[0]) or similar_file_hint(name, MAP_ENDINGS)
        return _report(error)
    except _ClickError as error:
        return _report(usage.usage_error(error))
    except KeyboardInterrupt as interrupt:
        cause, code = signals.ending()
        _report(MapdealError("; ".join([cause, *interrupt.args])))
        return code
    except BrokenPipeError:  # the reader has closed the pipe
        return 0
    except Exception as error:  # noqa: BLE001 - reported as an internal error
        signals.release_reserve()
        refusal = refusal_of_the_system(error)
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:  # of --help, by typer
            rule = f"cannot be written: {error.strerror}"
            refusal = FileAccessError(rule, source="standard output")
        if refusal is not None:
            return _report(refusal)
        with contextlib.suppress(OSError):
            traceback.print_exc()
        hint = "this is a bug in mapdeal; please report it"
        return _report(MapdealError("internal error", hint=hint))
    lost = terminal.lost()
    return code if lost is None else _report(lost)


def _report(error: MapdealError) -> int:
    terminal.error(error)
    return error.exit_code


def in_groups(group: Any, context: Any, names: Iterable[str] = ()) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {title: [] for title in GROUPS}
    for name in names or group.list_commands(context):
        command = group.get_command(context, name)
        found.setdefault(command.rich_help_panel or "Other commands", []).append(command)
    return {title: members for title, members in found.items() if members}


def lay_out(command: Any) -> None:
    def write_options(context: Any, formatter: Any) -> None:
        for title, rows in sections_of(command, context).items():
            with formatter.section(terminal.bold(title)):
                formatter.write_dl(rows)

    def write_examples(_: Any, formatter: Any) -> None:
        with formatter.section("Examples"):
            for line in command.epilog.splitlines():
                formatter.write(f"{'':{formatter.current_indent}}{line}\n")

    if not hasattr(command, "commands"):
        command.format_options = write_options
    if command.epilog:
        command.format_epilog = write_examples


def overview(group: Any, context: Any) -> str:
    formatter = context.make_formatter()
    formatter.write("Process robot map files without ROS.\n\n")
    formatter.write("Start with: mapdeal run MAP.yaml -o out\n")
    write_commands(group, context, formatter, names=_FIRST)
    text = "mapdeal --help lists all commands, mapdeal help COMMAND shows one with examples."
    return f"{formatter.getvalue()}\n{text}"


def write_commands(group: Any, context: Any, formatter: Any, *, names: Iterable[str] = ()) -> None:
    groups = in_groups(group, context, names)
    longest = max(len(command.name) for members in groups.values() for command in members)
    for title, members in groups.items():
        with formatter.section(terminal.bold(title)):
            rows = [(command.name, command.short_help) for command in members]
            formatter.write_dl(rows, col_max=longest)


def sections_of(command: Any, context: Any) -> dict[str, list[tuple[str, str]]]:
    parameters = command.get_params(context)
    sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
    for parameter in parameters:
        if record := parameter.get_help_record(context):
            names, text = record
            title, text = _placed(parameter, text, parameters)
            sections.setdefault(title, []).append((names, text))
    ordered = sorted(sections, key=lambda title: title in _LAST)  # others keep their order
    return {title: sections[title] for title in ordered if sections[title]}


def _placed(parameter: Any, text: str, parameters: Iterable[Any]) -> tuple[str, str]:
    # Texts begin with what an option counts with: "With a bag: ...", or a value, "rings: ...".
    if parameter.param_type_name == "argument":
        return "Arguments", text
    title = _COMMON if parameter.name == "help" else getattr(parameter, "rich_help_panel", None)
    if title is not None:
        return title, text
    condition, colon, meaning = text.partition(": ")
    meaning = meaning[:1].upper() + meaning[1:]
    if colon and condition == "With a bag":
        return condition, meaning
    for choice in parameters:
        if condition in [*(choice.metavar or "").split("|"), *getattr(choice.type, "choices", ())]:
            return f"With {choice.opts[0]} {condition}", meaning
    return "Options", text
