"""Mistakes on the command line: what click calls them, as one line and a hint that can be typed."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from copy import copy
from typing import Any

import typer

from mapdeal.errors import ParameterError
from mapdeal.spelling import as_known, meant, nearest

_NUMBER = re.compile(r"-?\d+(\.\d*)?\)?")
_NO_OPTION = re.compile(r"no such option:? '?(?P<name>-[^ ']*)'?")
_NO_COMMAND = re.compile(r"no such command '(?P<name>[^']*)'")
_NUMBERS = ("int", "float")


class PlainNumber:
    """Converts numbers of options, except those that only Python takes for one."""

    def __init__(self, convert: Callable[..., Any]) -> None:
        self._convert = convert

    def __call__(self, value: Any, parameter: Any, context: Any) -> Any:
        """Return the number of a word."""
        from mapdeal.stages.parameters import is_plain

        if not is_plain(value):
            rule = f"{value!r} is not a number"
            raise typer.BadParameter(rule, ctx=context, param=parameter)
        return self._convert(value, parameter, context)


class SpelledChoice:
    """Converts choices, whatever way of spelling them."""

    def __init__(self, convert: Callable[..., Any], choices: Iterable[object]) -> None:
        self._convert = convert
        self._choices = [str(choice) for choice in choices]

    def __call__(self, value: Any, parameter: Any, context: Any) -> Any:
        """Return the choice that a word stands for."""
        known = as_known(value, self._choices) if isinstance(value, str) else value
        return self._convert(known, parameter, context)


def accept_spellings(parameter: Any) -> None:
    """Have the words of an option read as those of recipes are: spellings and numbers."""
    kind = copy(parameter.type)  # click has one for all numbers
    if str(getattr(kind, "name", "")).startswith(_NUMBERS):
        vars(kind)["convert"] = PlainNumber(kind.convert)
    elif hasattr(kind, "choices"):
        vars(kind)["convert"] = SpelledChoice(kind.convert, kind.choices)
    parameter.type = kind


def usage_error(error: Any, commands: Callable[[], Iterable[str]]) -> ParameterError:
    """Return click's error as one of ours, on one line."""
    message = " ".join(error.format_message().split()).removesuffix(".")
    message = message[:1].lower() + message[1:] if not message.startswith("'") else message
    context = getattr(error, "ctx", None)
    path = getattr(context, "command_path", None) or "mapdeal"
    mistyped = _NO_OPTION.match(message) or _NO_COMMAND.match(message)
    if mistyped is not None:  # click adds what is near to some of them, in ways of its own
        message = mistyped[0]
    hint = _meant_by(error, mistyped, context, commands)
    if hint is None:
        hint = f"run {path} --help for usage"
        is_astray = message.startswith(("got unexpected extra", "no such option"))
        if path.endswith(" local") and ("--cloud" in message or message.startswith("got unexp")):
            hint = "clouds are given with --cloud FILE, repeated, or as a pattern in quotes"
        elif is_astray and any(map(_NUMBER.fullmatch, message.replace("(", " ").split())):
            hint = "points and sizes are written X,Y, without a space"
    return ParameterError(message, hint=hint)


def _meant_by(
    error: Any, mistyped: re.Match[str] | None, context: Any, commands: Callable[[], Iterable[str]]
) -> str | None:
    """Return the hint of what was meant, if something known is near."""
    if mistyped is not None and mistyped.re is _NO_COMMAND:
        below = getattr(getattr(context, "command", None), "commands", None)
        is_top = getattr(context, "parent", None) is None
        return meant(mistyped["name"], commands() if is_top or below is None else below)
    if mistyped is not None:
        parameters = getattr(getattr(context, "command", None), "params", ())
        names = [name for one in parameters for name in (*one.opts, *one.secondary_opts)]
        words = (name[2:] for name in names if name.startswith("--"))
        near = nearest(mistyped["name"].lstrip("-"), words)
        if near is not None:
            return f"did you mean --{near}?"
        return _parameter_of_a_stage(mistyped["name"], getattr(context, "command_path", ""))
    choices = getattr(getattr(getattr(error, "param", None), "type", None), "choices", None)
    found = re.search(r": '(?P<word>[^']*)' is not one of ", error.format_message())
    return meant(found["word"], map(str, choices)) if choices and found else None


def _parameter_of_a_stage(option: str, path: str) -> str | None:
    """Return how `run` sets a parameter of a stage that was given as an option of its own."""
    if not path.endswith(" run"):
        return None
    from mapdeal.stages.catalogue import STAGES

    name = option.lstrip("-").replace("-", "_")
    stage = next((stage.name for stage in STAGES if name in stage.parameters), None)
    return None if stage is None else f"--set {stage}.{name}=VALUE sets it"
