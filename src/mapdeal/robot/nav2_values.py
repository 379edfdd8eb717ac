"""Nav2's parameters as its nodes declare them: a value of another type ends the node."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mapdeal.formats.ros_parameters.problem import Level, Problem
from mapdeal.formats.ros_parameters.value import ParameterValue

_ARTICLES = {
    "bool": "a bool", "integer": "an integer", "double": "a double", "string": "a string",
    "string_array": "a list of strings", "integer_array": "a list of integers",
    "double_array": "a list of doubles", "bool_array": "a list of bools",
    "byte_array": "a list of bytes",
}  # fmt: skip


class Nav2Values:
    """The parameters that a node gets, and all problems that were found in them."""

    def __init__(
        self, values: Mapping[str, ParameterValue], node: str, files: Sequence[Path]
    ) -> None:
        self.values, self.node = values, node
        self.source = files[-1]
        self.problems: list[Problem] = []
        self._known: set[str] = set()

    def has(self, name: str) -> bool:
        """Return whether the files set a parameter."""
        return name in self.values

    def get(self, name: str, kind: str, default: Any, *, level: Level = "refused") -> Any:
        """Return a declared parameter, or its default.

        A value of another type becomes a problem, and what it means is returned if that is clear.
        """
        found = self.values.get(name)
        if found is None or found.kind == "not set":  # Nav2 never sees the latter
            return default
        if found.ignored is not None and name not in self._known:
            self._tell_ignored(name, found, found.ignored)
        if found.kind == kind:
            return found.value
        if name not in self._known:
            self._tell_type(name, kind, found, level)
        self._known.add(name)
        if kind == "double" and found.kind == "integer":
            return float(found.value)
        if kind == "integer" and found.kind == "double" and found.value.is_integer():
            return int(found.value)
        return default

    def number(self, name: str, default: float, *, least: float = -math.inf) -> float:
        """Return a declared double that is finite, and not below what costs are defined for."""
        value = float(self.get(name, "double", default))
        if not math.isfinite(value):
            text = "must be finite; the node accepts it, and the costs are meaningless"
            self.problem("params.not-finite", "refused", text, name)
            return default
        if value < least:
            text = (
                f"must not be below {least:g}; the node accepts it, and the costs are meaningless"
            )
            self.problem("params.not-positive", "refused", text, name)
            return default
        return value

    def problem(
        self, check: str, level: Level, text: str, name: str = "", hint: str | None = None
    ) -> None:
        """Keep a problem, with the place and the text of the parameter that it is about."""
        found = self.values.get(name)
        one = Problem(check, level, text, parameter=name, source=self.source, hint=hint)
        if found is not None:
            one = replace(one, source=found.source, line=found.line, got=found.text)
        if one not in self.problems:
            self.problems.append(one)

    def _tell_type(self, name: str, kind: str, found: ParameterValue, level: Level) -> None:
        wanted, given = _ARTICLES[kind], _ARTICLES[found.kind]
        if _is_substitution(found) and kind != "string":
            hint = "launch files replace it; pass the file that the node gets, or write the value"
            self.problem("params.substitution", level, f"must be {wanted}", name, hint)
            return
        end = "Nav2 does not start" if level == "refused" else "the real node does not start"
        check = "params.type" if level == "refused" else "params.sensor-type"
        text = f"must be {wanted}, is {given}; {end}"
        self.problem(check, level, text, name, _hint(kind, found))

    def _tell_ignored(self, name: str, found: ParameterValue, ignored: ParameterValue) -> None:
        self._known.add(name)
        where = f"line {ignored.line}"
        if ignored.source != found.source:
            where += f" of {ignored.source.name}"
        text = (
            f"{_ARTICLES[found.kind]} counts, and not {_ARTICLES[ignored.kind]} that is set later, "
            f"{ignored.text} on {where}: ROS 2 goes by the type"
        )
        hint = f"remove one of them, or write both as {_ARTICLES[ignored.kind]}"
        self.problem("params.hidden", "warning", text, name, hint)


def _is_substitution(found: ParameterValue) -> bool:
    """Return whether a text is there for launch files to replace it."""
    text = found.value if found.kind == "string" else ""
    is_name = text.isidentifier() and text.isupper() and "_" in text  # nav2_bringup's own form
    return "$(" in text or (text.startswith("<") and ">" in text) or is_name


def _hint(kind: str, found: ParameterValue) -> str | None:
    """Return what to write in place of a value of another type."""
    if kind == "double" and found.kind == "integer":
        return f"write {found.value}.0"
    if kind == "integer" and found.kind == "double":
        is_whole = abs(found.value) < 1 << 31 and found.value.is_integer()
        return f"write {int(found.value)}" if is_whole else "write a whole number"
    if kind == "string":
        return f'write "{found.text}"' if '"' not in found.text else "put it in quotes"
    if kind == "bool":
        return "write true or false, without quotes"
    if kind == "string_array" and found.kind == "string":
        return f'write ["{found.value}"]' if '"' not in found.value else "put it in brackets"
    if kind in ("double", "integer") and found.kind == "string":
        return "write a number, without quotes or a unit"
    return None
