"""Reading of words on the command line, and the errors for unknown ones."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from copy import copy
from itertools import pairwise
from pathlib import Path
from typing import Any

import typer

from mapdeal.cli.terminal import DASH
from mapdeal.errors import ParameterError, as_known, nearest, nearest_hint

_NUMBER = re.compile(r"\(?-?\d+(\.\d*)?\)?")
_UNKNOWN = re.compile(r"no such (option|command):? '?(?P<name>(?<=')[^']*|[^ ']*)'?")
_NO_CHOICE = re.compile(r": '(?P<word>[^']*)' is not one of ")
_NUMBERS = ("int", "float")
_FLAGS = {"yes": "", "true": "", "on": "", "no": "no-", "false": "no-", "off": "no-"}
_OF_POINTS = {
    "query": "--at", "edit": "--point", "reach": "--to", "run": "--to", "graph": "--to",
    "diff": "--to", "plan": "--to",
}  # fmt: skip
_SAME_OPTIONS = (
    ("from", "start", "begin", "origin"), ("to", "goal", "goals", "target", "end"),
    ("at", "point", "pose", "xy", "position", "center", "centre"), ("points", "goals-file"),
    ("output", "out", "output-dir"), ("params-file", "params", "robot", "config"),
    ("file", "zones"), ("robot-radius", "radius"),
)  # fmt: skip
"""Names of one option in several programs."""

_SYNONYMS = {
    "show": "view", "plot": "view", "open": "view", "display": "view", "crop": "window",
    "compare": "diff", "inflation": "inflate", "costmap": "cost", "distance": "esdf",
    "path": "route", "check": "lint", "validate": "lint", "stats": "info",
    "fix": "lint", "filter": "clean", "resize": "rescale", "slam": "build", "stitch": "merge",
    "version": "--version",
}  # fmt: skip
"""Names of commands in other programs."""

_USAGE_ERROR: Any = typer.BadParameter.__mro__[1]  # click's, of which typer may have a copy
_POINT = re.compile(r"(?:[^-=,][^=,]*=)?[-+0-9.eE]+(?:,[-+0-9.eE]+){1,2}")


def accept_words(command: Any, name: str) -> None:
    parse = command.parse_args
    options = [(option, own) for own in command.params for option in own.opts]
    flags = {option[2:] for option, own in options
             if option.replace("--", "--no-", 1) in own.secondary_opts}  # fmt: skip

    def parse_args(context: Any, words: Sequence[str]) -> Any:
        words = _spread(_joined(words, flags), _OF_POINTS.get(name))
        try:
            return parse(context, list(words))
        except _USAGE_ERROR as error:
            if not hasattr(command, "commands") and getattr(error, "ctx", None) is context:
                error.suggested = _suggested_options(command, context, words)
            raise

    command.parse_args = parse_args
    for parameter in command.params:
        parameter.type = _spelled(parameter.type)


def _spelled(kind: Any) -> Any:
    """Return a type of click that accepts all spellings, but only plain numbers and names."""
    kind = copy(kind)  # click has one for all numbers
    convert, choices = kind.convert, [str(choice) for choice in getattr(kind, "choices", ())]
    is_number, is_path = kind.name.startswith(_NUMBERS), hasattr(kind, "file_okay")

    def converted(value: Any, parameter: Any, context: Any) -> Any:
        from mapdeal.command import is_plain
        from mapdeal.files.source import absolute_path

        rule = None
        if choices and isinstance(value, str):
            value = as_known(value, choices)
        elif is_number and not is_plain(value):
            rule = f"{value!r} is not a number"
        elif is_path and not os.fspath(value):  # it would be the working folder
            rule = "must not be empty"
        elif is_path and value != "-" and Path(value) == DASH:  # ./- is the file of that name
            value = str(absolute_path(DASH))
        if rule is not None:
            raise typer.BadParameter(rule, ctx=context, param=parameter)
        return convert(value, parameter, context)

    kind.convert = converted
    kind.readable = False  # whoever opens a file says why it cannot be read
    if is_path:
        kind.shell_complete = lambda *_: []  # shells complete paths themselves
    return kind


def _joined(words: Sequence[str], flags: Iterable[str]) -> list[str]:
    """Accept values of flags as in recipes, such as ``--inflate-unknown no``."""
    joined: list[str] = []
    for before, word in pairwise(["", *words]):
        name, equals, value = word.removeprefix("--").partition("=")
        is_value = before[:2] == "--" and before[2:] in flags and word.lower() in _FLAGS
        if "--" in joined or not (is_value or (equals and word[:2] == "--" and name in flags)):
            joined.append(word)
        elif is_value:
            joined[-1] = f"--{_FLAGS[word.lower()]}{before[2:]}"
        elif value.lower() in _FLAGS:
            joined.append(f"--{_FLAGS[value.lower()]}{name}")
        else:
            raise ParameterError("must be yes or no", source=f"--{name}", got=value)
    return joined


def _spread(words: Sequence[str], option: str | None) -> list[str]:
    """Accept several points after one option: ``--at 1,2 3,4``, ``--at=1,2 3,4``."""
    spread: list[str] = []
    for word in words:
        is_first = "".join(spread[-1:]).startswith(f"{option}=")
        if (is_first or option in spread[-2:-1]) and _POINT.fullmatch(word):
            spread.append(str(option))
        spread.append(word)
    return spread


def _suggested_options(command: Any, context: Any, words: Sequence[str]) -> str | None:
    """Return extra words as the options that they seem to be values of, if all of them do."""
    from mapdeal.cli.options import SHARED_OPTIONS
    from mapdeal.files.source import exists

    try:
        used, extra, _ = command.make_parser(context).parse_args(list(words))
    except _USAGE_ERROR:
        return None
    unused = [
        option for option in command.params
        if option.opts[0][:2] == "--" and not used.get(option.name)
        and (option.required or option.name not in SHARED_OPTIONS)
    ]  # fmt: skip
    last = next((value[-1] for value in used.values() if isinstance(value, tuple) and value), None)
    if not extra and last is not None and not exists(Path(last)):
        extra = [last]  # of commands that take many files
    suggested: list[str] = []
    for word in extra:
        before = words[len(words) - 2 - words[::-1].index(word)]
        is_split_point = _NUMBER.fullmatch(word) and _NUMBER.fullmatch(before)
        option = next((option for option in unused if _fits(word, option, suggested)), None)
        if option is None or is_split_point:
            return None
        suggested.append(f"{'-o' if option.name == 'output' else option.opts[0]} {word}")
        if not option.multiple:
            unused.remove(option)
    return f"did you mean {' '.join(suggested)}?" if suggested else None


def _fits(word: str, option: Any, suggested: Sequence[str]) -> bool:
    metavar = option.metavar or ""
    if _NUMBER.fullmatch(word):
        return bool(option.type.name.startswith(_NUMBERS))
    if _POINT.fullmatch(word):
        is_next = not suggested or option.multiple or option.opts[0] == "--to"
        return is_next and "X,Y" in metavar and "[[" not in metavar
    if option.name == "output":
        return (Path(word).suffix == "") == (metavar == "DIR")
    return bool(option.required and option.type.name == "path")


def point_hint(word: str, command: str) -> str | None:
    option = _OF_POINTS.get(command)
    return f"did you mean {option} {word}?" if option and _POINT.fullmatch(word) else None


def usage_error(error: Any) -> ParameterError:
    message = " ".join(error.format_message().split()).removesuffix(".")
    message = message[:1].lower() + message[1:]
    context = getattr(error, "ctx", None)
    command, path = getattr(context, "command", None), getattr(context, "command_path", "mapdeal")
    unknown, no_choice = _UNKNOWN.match(message), _NO_CHOICE.search(message)
    is_astray = message.startswith(("got unexpected extra", "no such option"))
    hint = getattr(error, "suggested", None)
    if unknown is not None:  # click's own suggestion is dropped
        message = unknown[0]
        hint = _nearest_hint(unknown["name"], command, context)
    elif no_choice is not None:
        hint = nearest_hint(no_choice["word"], map(str, getattr(error.param.type, "choices", ())))
    is_about_clouds = "--cloud" in message or message.startswith("got unexp")
    if hint is None and path.endswith(" local") and is_about_clouds:
        hint = "clouds are given with --cloud FILE, repeated, or as a pattern in quotes"
    elif hint is None and is_astray and any(map(_NUMBER.fullmatch, message.split())):
        hint = "points and sizes are written X,Y, without a space"
    return ParameterError(message, hint=hint or f"run {path} --help for usage")


def _nearest_hint(word: str, command: Any, context: Any) -> str | None:
    if not word.startswith("-"):
        known = command.list_commands(context)
        if word.lower() in _SYNONYMS:
            return f"did you mean {_SYNONYMS[word.lower()]}?"
        return nearest_hint(word, [*known, "help"])
    options = [name for option in command.params for name in (*option.opts, *option.secondary_opts)]
    same = {name for names in _SAME_OPTIONS if word.lstrip("-") in names for name in names}
    for option in options:
        if option[:2] == "--" and option[2:] in same:
            return f"did you mean {option}?"
    if command.name == "report" and word in ("--params-file", "--robot-radius", "--footprint"):
        return f"mapdeal run MAP {word} ... --report -o DIR makes the page of a robot"
    near = nearest(word.lstrip("-"), [name[2:] for name in options if name[:2] == "--"])
    if near is not None or command.name != "run":
        return near and f"did you mean --{near}?"
    from mapdeal.stages.catalogue import STAGES

    name = word.lstrip("-").replace("-", "_")
    stages = [stage.name for stage in STAGES if name in stage.parameters]
    return f"--set {stages[0]}.{name}=VALUE sets it" if stages else None
