"""The words of the command line, as shells complete them: commands, options, values."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from typing import Any

from mapdeal.records import dataclass

_MAPS = (".yaml", ".yml", ".npz", ".pbm")
_CLOUDS = (".pcd", ".ply", ".xyz", ".txt", ".csv", ".asc", ".npy", ".npz")
_LOGS = (".log", ".clf", ".gz", ".npz")
_BY_METAVAR = {
    "MAP": _MAPS, "MAP|ESDF.npz": _MAPS, "GLOBAL": _MAPS, "MASK": _MAPS, "A": _MAPS, "B": _MAPS,
    "MAP...": _MAPS, "OUT": (".yaml", ".npz", ".pgm", ".png"), "OUT.json": (".json",),
    "OUT.npz": (".npz",), "OUT.pbm": (".pbm",), "IN.pbm": (".pbm",), "FILE.png": (".png",),
    "SHAPES": (".yaml", ".yml", ".json", ".geojson"), "NAME|FILE": (".yaml", ".yml"),
    "LOG": _LOGS, "FILE.json": (".json",),
}  # fmt: skip
"""Endings of files by what ``--help`` calls them; folders are offered with them."""

_BY_OPTION = {"--cloud": _CLOUDS, "--pairs": (".csv", ".json", ".jsonl", ".txt")}
_FOLDERS = ("DIR",)
_LISTS = ("--select", "--ignore")


@dataclass(frozen=True)
class Value:
    """What can stand for an option's value or an argument."""

    words: tuple[str, ...] = ()
    endings: tuple[str, ...] | None = None
    is_folder: bool = False


@dataclass(frozen=True)
class OptionWords:
    """An option: its names, what it means in a line, and its value, None of a flag."""

    names: tuple[str, ...]
    meaning: str
    value: Value | None = None


@dataclass(frozen=True)
class CommandWords:
    """A command: its name, what it does, its options, its argument, and commands below it."""

    name: str
    meaning: str
    options: tuple[OptionWords, ...]
    argument: Value | None = None
    commands: tuple[CommandWords, ...] = field(default=())


def recipe_words() -> tuple[str, ...]:
    """Return the names of the built-in recipes."""
    from mapdeal.pipeline.recipe import BUILT_IN

    return tuple(BUILT_IN)


def setting_words() -> tuple[str, ...]:
    """Return ``stage.parameter=`` for each parameter of each stage, with its choices behind."""
    from mapdeal.stages.catalogue import STAGES

    words: dict[str, None] = {}
    for stage in STAGES:
        models = [str(one.model) for one in STAGES if one.name == stage.name and one.model]
        words |= dict.fromkeys(f"{stage.name}.model={model}" for model in models)
        for name, parameter in stage.parameters.items():
            choices = ("yes", "no") if parameter.kind is bool else parameter.choices
            words |= dict.fromkeys(f"{stage.name}.{name}={choice}" for choice in choices or ("",))
    return tuple(words)


def check_words() -> tuple[str, ...]:
    """Return the names of the checks of lint."""
    from mapdeal.checks import lint  # which lists them
    from mapdeal.checks.finding import CHECKS

    return tuple(sorted(CHECKS)) if lint else ()


def command_words(name: str, command: Any) -> CommandWords:
    """Return the words of a command of click's, and of those below it."""
    below: dict[str, Any] = {}
    if hasattr(command, "list_commands"):
        below = {one: command.get_command(None, one) for one in command.list_commands(None)}
    options = [_option(one) for one in command.params if one.param_type_name == "option"]
    arguments = [one for one in command.params if one.param_type_name == "argument"]
    help_text = ("-h", "--help") if "-h" in command.context_settings.get(
        "help_option_names", ()) else ("--help",)  # fmt: skip
    return CommandWords(
        name,
        _line(command.help),
        (*options, OptionWords(help_text, "Show the options of the command.")),
        _value(arguments[0]) if arguments else None,
        tuple(command_words(one, command) for one, command in below.items()),
    )


def _option(parameter: Any) -> OptionWords:
    names = tuple(sorted((*parameter.opts, *parameter.secondary_opts), key=len))
    return OptionWords(names, _line(parameter.help), None if parameter.is_flag else
                       _value(parameter))  # fmt: skip


def _value(parameter: Any) -> Value:
    names = set(parameter.opts)
    metavar = parameter.metavar or ""
    choices = getattr(parameter.type, "choices", None)
    by_name = next((_BY_OPTION[one] for one in names if one in _BY_OPTION), None)
    endings = by_name or _BY_METAVAR.get(metavar)
    words: tuple[str, ...] = ()
    if choices:
        words = tuple(str(getattr(one, "value", one)) for one in choices)
    elif "NAME|FILE" in metavar:
        words = recipe_words()
    elif names & {"--set", "--local-set"}:
        words = setting_words()
    elif names & set(_LISTS):
        words = check_words()
    elif "|" in metavar and metavar == metavar.lower():
        words = tuple(metavar.split("|"))
    elif endings is None and parameter.type.name == "path" and metavar not in _FOLDERS:
        endings = ()
    return Value(words, endings, is_folder=metavar in _FOLDERS)


def _line(text: str | None) -> str:
    """Return the first sentence of a help text, on one line."""
    line = " ".join((text or "").partition("\n\n")[0].split()).partition("  [")[0]
    first, _, rest = line.partition(". ")
    return f"{first}." if rest else line


def every_command(root: CommandWords) -> Iterator[tuple[tuple[str, ...], CommandWords]]:
    """Yield each command with the names that lead to it, the program's aside."""
    for one in root.commands:
        yield (one.name,), one
        for names, below in every_command(one):
            yield (one.name, *names), below
