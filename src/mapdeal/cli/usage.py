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
_FLAG_PREFIXES = {"yes": "", "true": "", "on": "", "no": "no-", "false": "no-", "off": "no-"}
_POINT_OPTION_OF = {"query": "--at", "edit": "--point", "reach": "--to", "run": "--to",
                    "graph": "--to", "diff": "--to", "plan": "--to"}  # fmt: skip
_SAME_OPTIONS = (
    ("from", "start", "begin", "origin"), ("to", "goal", "goals", "target", "end"),
    ("at", "point", "pose", "xy", "position", "center", "centre"), ("points", "goals-file"),
    ("output", "out", "output-dir"), ("params-file", "params", "robot", "config"),
    ("file", "zones"), ("robot-radius", "radius"), ("radius", "inflation-radius", "inflation"),
)  # fmt: skip
"""Names of one option in several programs."""

_SYNONYMS = {"show": "view", "plot": "view", "open": "view", "display": "view", "crop": "window",
             "compare": "diff", "inflation": "inflate", "costmap": "cost", "distance": "esdf",
             "path": "route", "check": "lint", "validate": "lint", "stats": "info", "fix": "lint",
             "filter": "clean", "resize": "rescale", "slam": "build", "stitch": "merge",
             "version": "--version"}  # fmt: skip
"""Names of commands in other programs."""

_USAGE_ERROR: Any = typer.BadParameter.__mro__[1]  # click's, of which typer may have a copy
_POINT = re.compile(r"(?:[^-=,][^=,]*=)?[-+0-9.eE]+(?:,[-+0-9.eE]+){1,2}")


def accept_words(command: Any, name: str) -> None:
    parse = command.parse_args
    flags = {option[2:] for parameter in command.params for option in parameter.opts
             if option.replace("--", "--no-", 1) in parameter.secondary_opts}  # fmt: skip

    def parse_args(context: Any, words: Sequence[str]) -> Any:
        words = _repeat_point_option(_join_flag_values(words, flags), _POINT_OPTION_OF.get(name))
        try:
            return parse(context, list(words))
        except _USAGE_ERROR as error:
            if not hasattr(command, "commands") and getattr(error, "ctx", None) is context:
                error.suggested = _suggested_options(command, context, words)
            raise

    command.parse_args = parse_args
    for parameter in command.params:
        parameter.type = _with_lenient_spelling(parameter.type)


def _with_lenient_spelling(kind: Any) -> Any:
    """Return a type of click that accepts all spellings of choices, but only plain numbers."""
    kind = copy(kind)  # click has one for all numbers
    convert = kind.convert
    choices = [str(choice) for choice in getattr(kind, "choices", ())]
    is_number = kind.name.startswith(_NUMBERS)
    is_path = hasattr(kind, "file_okay")

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


def _join_flag_values(words: Sequence[str], flags: Iterable[str]) -> list[str]:
    """Accept values of flags as in recipes, such as ``--inflate-unknown no``."""
    joined: list[str] = []
    for previous_word, word in pairwise(["", *words]):
        flag = previous_word.removeprefix("--")
        follows_flag = flag in flags and flag != previous_word
        name, equals, value = word.removeprefix("--").partition("=")
        if "--" in joined:  # only positional arguments follow
            joined.append(word)
        elif follows_flag and word.lower() in _FLAG_PREFIXES:
            joined[-1] = f"--{_FLAG_PREFIXES[word.lower()]}{flag}"
        elif not (equals and word.startswith("--") and name in flags):
            joined.append(word)
        elif value.lower() in _FLAG_PREFIXES:
            joined.append(f"--{_FLAG_PREFIXES[value.lower()]}{name}")
        else:
            raise ParameterError("must be yes or no", source=f"--{name}", got=value)
    return joined


def _repeat_point_option(words: Sequence[str], option: str | None) -> list[str]:
    """Accept several points after one option: ``--at 1,2 3,4``, ``--at=1,2 3,4``."""
    repeated: list[str] = []
    for word in words:
        follows_equals = "".join(repeated[-1:]).startswith(f"{option}=")
        if (follows_equals or option in repeated[-2:-1]) and _POINT.fullmatch(word):
            repeated.append(str(option))
        repeated.append(word)
    return repeated


def _suggested_options(command: Any, context: Any, words: Sequence[str]) -> str | None:
    """Suggest an option for each surplus word; None unless all of them fit one."""
    from mapdeal.cli.options import SHARED_OPTIONS
    from mapdeal.files.source import exists

    try:
        values, surplus, _ = command.make_parser(context).parse_args(list(words))
    except _USAGE_ERROR:
        return None
    unused = [option for option in command.params
              if option.opts[0][:2] == "--" and not values.get(option.name)
              and (option.required or option.name not in SHARED_OPTIONS)]  # fmt: skip
    lists = [value for value in values.values() if isinstance(value, tuple) and value]
    if not surplus and lists and not exists(Path(lists[0][-1])):
        surplus = [lists[0][-1]]  # the last word of a command that takes many files
    suggested: list[str] = []
    for word in surplus:
        last_index = len(words) - 1 - words[::-1].index(word)
        is_split_point = _NUMBER.fullmatch(word) and _NUMBER.fullmatch(words[last_index - 1])
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
        is_accepted = not suggested or option.multiple or option.opts[0] == "--to"
        return is_accepted and "X,Y" in metavar and "[[" not in metavar
    if option.name == "output":
        return (Path(word).suffix == "") == (metavar == "DIR")
    return bool((option.required or option.name == "truth") and option.type.name == "path")


def point_hint(word: str, command: str) -> str | None:
    option = _POINT_OPTION_OF.get(command)
    return f"did you mean {option} {word}?" if option and _POINT.fullmatch(word) else None


def usage_error(error: Any) -> ParameterError:
    message = " ".join(error.format_message().split()).removesuffix(".")
    message = message[:1].lower() + message[1:]
    context = getattr(error, "ctx", None)
    command = getattr(context, "command", None)
    path = getattr(context, "command_path", "mapdeal")
    hint = getattr(error, "suggested", None)
    if unknown := _UNKNOWN.match(message):  # click's own suggestion is dropped
        message, hint = unknown[0], _nearest_hint(unknown["name"], command, context)
    elif no_choice := _NO_CHOICE.search(message):
        hint = nearest_hint(no_choice["word"], map(str, getattr(error.param.type, "choices", ())))
    is_surplus = message.startswith("got unexpected extra")
    if hint is None and path.endswith(" local") and ("--cloud" in message or is_surplus):
        hint = "clouds are given with --cloud FILE, repeated, or as a pattern in quotes"
    has_number = any(map(_NUMBER.fullmatch, message.split()))
    if hint is None and has_number and (is_surplus or message.startswith("no such option")):
        hint = "points and sizes are written X,Y, without a space"
    return ParameterError(message, hint=hint or f"run {path} --help for usage")


def _nearest_hint(word: str, command: Any, context: Any) -> str | None:
    if not word.startswith("-"):
        if word.lower() in _SYNONYMS:
            return f"did you mean {_SYNONYMS[word.lower()]}?"
        return nearest_hint(word, [*command.list_commands(context), "help"])
    options = [name for option in command.params for name in (*option.opts, *option.secondary_opts)]
    for names in _SAME_OPTIONS:
        same = [option for option in options if option[:2] == "--" and option[2:] in names]
        if same and word.lstrip("-") in names:
            return f"did you mean {same[0]}?"
    if command.name == "report" and word in ("--params-file", "--robot-radius", "--footprint"):
        return f"mapdeal run MAP {word} ... --report -o DIR makes the page of a robot"
    if similar := nearest(word.lstrip("-"), [name[2:] for name in options if name[:2] == "--"]):
        return f"did you mean --{similar}?"
    if command.name != "run":
        return None
    from mapdeal.stages.catalogue import STAGES

    name = word.lstrip("-").replace("-", "_")
    stage = next((stage.name for stage in STAGES if name in stage.parameters), None)
    return stage and f"--set {stage}.{name}=VALUE sets it"
