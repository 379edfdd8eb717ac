"""Values of ROS 1 parameters: PyYAML's, with rosparam's angles and binary data."""

from __future__ import annotations

import ast
import base64
import binascii
import math
import operator
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from mapdeal.errors import MalformedInputError
from mapdeal.formats.yaml_text import one_line_of
from mapdeal.records import dataclass

_DEGREES, _RADIANS = "!degrees", "!radians"
_BINARY = "tag:yaml.org,2002:binary"
EXTRA_TAGS = frozenset({_DEGREES, _RADIANS, _BINARY})
"""Tags that rosparam knows, besides those of plain YAML."""

_LONGEST_ANGLE = 200
_INT32 = 1 << 31


@dataclass(frozen=True)
class Unsendable:
    """Why roslaunch cannot hand a value to the parameter server, and what to do about it."""

    check: str
    text: str
    hint: str | None = None


class _RosLoader(yaml.SafeLoader):
    """PyYAML's safe loader with the constructors that rosparam adds."""


def _degrees(loader: yaml.SafeLoader, node: yaml.Node) -> float:
    text = _angle_text(loader, node)
    inner = text[4:-1] if text.startswith("deg(") else text
    return float(inner) * math.pi / 180.0


def _radians(loader: yaml.SafeLoader, node: yaml.Node) -> float:
    text = _angle_text(loader, node)
    return _calculated(text[4:-1] if text.startswith("rad(") else text)


def _angle_text(loader: yaml.SafeLoader, node: yaml.Node) -> str:
    if not isinstance(node, yaml.ScalarNode):
        raise ValueError("an angle must be a single value")
    return str(loader.construct_scalar(node)).strip()


def _binary(_: yaml.SafeLoader, node: yaml.Node) -> bytes:
    return base64.decodebytes(str(node.value).encode("ascii"))


_RosLoader.add_constructor(_DEGREES, _degrees)
_RosLoader.add_constructor(_RADIANS, _radians)
_RosLoader.add_constructor(_BINARY, _binary)
_ANGLES = (("deg(", _DEGREES), ("rad(", _RADIANS))

_OPERATORS: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.Div: operator.truediv, ast.Pow: operator.pow,
}  # fmt: skip


def _calculated(text: str) -> float:
    """Return what an expression of numbers and ``pi`` comes to; rosparam runs it as Python."""
    if len(text) > _LONGEST_ANGLE:
        raise ValueError("an angle of more than 200 characters")
    try:
        return float(_number_of(ast.parse(text.strip(), mode="eval").body))
    except (SyntaxError, ArithmeticError, RecursionError, MemoryError, TypeError):
        raise ValueError("no angle in radians") from None


def _number_of(node: ast.expr) -> float:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    if isinstance(node, ast.Name) and node.id == "pi":
        return math.pi
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        number = _number_of(node.operand)
        return -number if isinstance(node.op, ast.USub) else number
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](_number_of(node.left), _number_of(node.right))
    raise ValueError("an angle in radians is made of numbers, pi and + - * / **")


def value_of(source: Path, node: yaml.Node) -> Any:
    """Return the value of a node, as rosparam's loader makes it."""
    _resolve_angles(node, set())
    try:
        return _RosLoader("").construct_document(node)
    # PyYAML's constructors fail on tags that do not fit in whatever way they fail.
    except (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError, OverflowError,
            binascii.Error) as error:  # fmt: skip
        place = f"line {node.start_mark.line + 1}"
        rule = f"cannot be read ({one_line_of(error)})"
        raise MalformedInputError(rule, source=source, place=place) from None


def _resolve_angles(node: yaml.Node, done: set[int]) -> None:
    """Tag bare ``deg(...)`` and ``rad(...)`` as rosparam's resolvers do."""
    if id(node) in done:
        return
    done.add(id(node))
    if isinstance(node, yaml.ScalarNode):
        if node.tag == "tag:yaml.org,2002:str" and node.style is None:
            text = str(node.value)
            for start, tag in _ANGLES:
                if text.startswith(start) and text.find(")") == len(text) - 1:
                    node.tag = tag
    elif isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _resolve_angles(item, done)
    elif isinstance(node, yaml.MappingNode):
        for _, item in node.value:
            _resolve_angles(item, done)


def kind_of(value: Any) -> str:
    """Return the type of a value, as XML-RPC has it."""
    if isinstance(value, bool):
        return "bool"
    for kind, name in ((int, "int"), (float, "double"), (str, "string"), (bytes, "binary"),
                       (list, "list"), (dict, "struct")):  # fmt: skip
        if isinstance(value, kind):
            return name
    return "nothing" if value is None else type(value).__name__


def why_unsendable(value: Any) -> Unsendable | None:
    """Return why a value cannot be sent to the parameter server; None if it can."""
    if value is None:
        hint = "give it a value, or remove the line"
        return Unsendable("params.empty", "has no value, and roslaunch exits", hint)
    if isinstance(value, bool | str | bytes | float):
        return None
    if isinstance(value, int):
        if -_INT32 <= value < _INT32:
            return None
        return Unsendable("params.type", "roslaunch sends whole numbers of 32 bits alone")
    if isinstance(value, list):
        return next(filter(None, map(why_unsendable, value)), None)
    if isinstance(value, dict):
        if not all(isinstance(key, str) for key in value):
            return Unsendable("params.name", "names must be text", "put them in quotes")
        return next(filter(None, map(why_unsendable, value.values())), None)
    kind = kind_of(value)
    return Unsendable(
        "params.type", f"is a {kind}, which roslaunch cannot send", "put it in quotes"
    )
