"""Parameter files of ROS 1.

Values are those of PyYAML's safe loader, YAML 1.1: ``1e-1`` is text, ``010`` is eight and ``yes``
is true. What is nested becomes namespaces, which are merged; of two values the later one stays.
"""

from __future__ import annotations

import ast
import base64
import binascii
import hashlib
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from mapdeal.errors import MalformedInputError
from mapdeal.files.source import read_file
from mapdeal.files.yaml_text import YamlLimits, compose_documents, one_line_of, written
from mapdeal.ros.values import ParameterValue, Problem

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


_RosLoader.add_constructor(_DEGREES, _degrees)
_RosLoader.add_constructor(_RADIANS, _radians)
_RosLoader.add_constructor(
    _BINARY, lambda _, node: base64.decodebytes(str(node.value).encode("ascii"))
)
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


OF_PARAMETERS = YamlLimits(bytes=1 << 20, nodes=50_000, aliases=200)
ROOT = ""
"""The name, at a file's top, of what a leading slash puts below the root of all namespaces."""

UNSENDABLE = "unsendable"
"""The kind of what roslaunch cannot hand on; a fault says so."""

_NAMESPACE_KEY = "_ns"
_MERGE = "tag:yaml.org,2002:merge"

Path1 = tuple[str, ...]


@dataclass(frozen=True)
class Ros1Namespace:
    """Parameters and the namespaces within, by name, in the order they came in."""

    line: int = 0
    source: Path | None = None
    members: dict[str, ParameterValue | Ros1Namespace] = field(default_factory=dict)

    def get(self, path: Path1) -> ParameterValue | Ros1Namespace | None:
        here: ParameterValue | Ros1Namespace | None = self
        for name in path:
            if not isinstance(here, Ros1Namespace):
                return None
            here = here.members.get(name)
        return here

    def values(self) -> Iterator[tuple[Path1, ParameterValue]]:
        for name, member in self.members.items():
            if isinstance(member, Ros1Namespace):
                yield from (((name, *path), value) for path, value in member.values())
            else:
                yield (name,), member

    def namespaces(self) -> Iterator[tuple[Path1, Ros1Namespace]]:
        for name, member in self.members.items():
            if isinstance(member, Ros1Namespace):
                yield (name,), member
                yield from (((name, *path), found) for path, found in member.namespaces())


@dataclass(frozen=True)
class Ros1File:
    """Content of a ROS 1 parameter file."""

    source: Path
    sha256: str
    parameters: Ros1Namespace
    faults: tuple[Problem, ...] = ()


def read_ros1_parameters(path: Path) -> Ros1File:
    return parse_ros1_parameters(path, read_file(path, limit=OF_PARAMETERS.bytes))


def parse_ros1_parameters(path: Path, data: bytes) -> Ros1File:
    reader = _Reader(path)
    documents = compose_documents(path, data, OF_PARAMETERS, EXTRA_TAGS)
    for node in documents:
        reader.read(node)
    if len(documents) > 1:
        line = documents[1].start_mark.line + 1
        reader.fault("params.syntax", "refused", "roslaunch reads files of one document", line,
                     hint="remove the ---, or load the file with rosparam load")  # fmt: skip
    return Ros1File(path, hashlib.sha256(data).hexdigest(), reader.tree, tuple(reader.faults))


def merge(into: Ros1Namespace, at: Path1, other: Ros1Namespace) -> None:
    """Set all parameters of a namespace below a path in another, as one after the other."""
    for path, value in other.values():
        put(into, (*at, *path), value)
    for path, found in other.namespaces():  # those that are empty, too, for what lint says of them
        _descend(into, (*at, *path), found.source, found.line)


def put(into: Ros1Namespace, path: Path1, value: ParameterValue) -> None:
    """Set one parameter; a value on its way becomes a namespace, as rosmaster has it."""
    _descend(into, path[:-1], value.source, value.line).members[path[-1]] = value


def _descend(into: Ros1Namespace, path: Path1, source: Path | None, line: int) -> Ros1Namespace:
    here = into
    for name in path:
        member = here.members.get(name)
        if not isinstance(member, Ros1Namespace):
            member = here.members[name] = Ros1Namespace(line, source)
        here = member
    return here


class _Reader:
    """Converter from the nodes of a file to parameters, which collects faults."""

    def __init__(self, source: Path) -> None:
        self.source = source
        self.tree = Ros1Namespace(1, source)
        self.faults: list[Problem] = []

    def fault(self, check: str, level: Any, text: str, line: int, **more: str) -> None:
        self.faults.append(Problem(check, level, text, source=self.source, line=line, **more))

    def read(self, node: yaml.Node) -> None:
        if not isinstance(node, yaml.MappingNode):
            kind = "list" if isinstance(node, yaml.SequenceNode) else "single value"
            rule = f"must be a mapping of parameters, is a {kind}"
            raise MalformedInputError(rule, source=self.source)
        self._add((), node, _own_namespace(node))

    def _add(self, path: Path1, node: yaml.MappingNode, above: Path1) -> None:
        for key, value in self._pairs(path, node):
            where = _joined(path or above, key)
            if not where or (path == () and key == _NAMESPACE_KEY):
                continue
            if isinstance(value, yaml.MappingNode) and not value.tag.startswith("!"):
                _descend(self.tree, where, self.source, value.start_mark.line + 1)
                self._add(where, value, above)
            else:
                self._set(where, value)

    def _pairs(self, path: Path1, node: yaml.MappingNode) -> Iterator[tuple[str, yaml.Node]]:
        """Yield names and nodes of a mapping; a name twice only as it stands last."""
        seen: dict[str, tuple[int, yaml.Node]] = {}
        own = {id(key) for key, _ in node.value}
        for key, value in _flattened(self.source, node):
            name, line = value_of(self.source, key), key.start_mark.line + 1
            if not isinstance(name, str):
                shown = "/".join((*path, str(key.value)))
                self.fault("params.name", "refused", "names must be text", line, parameter=shown,
                           got=f"{kind_of(name)} {key.value}", hint="put it in quotes")  # fmt: skip
                continue
            if name in seen and id(key) in own and seen[name][0] > 0:
                self._twice((*path, name), *seen[name], line, value)
            seen.pop(name, None)
            seen[name] = (line if id(key) in own else 0, value)
        for name, (_, value) in seen.items():
            yield name, value

    def _twice(
        self, path: Path1, first: int, before: yaml.Node, line: int, value: yaml.Node
    ) -> None:
        is_same = value_of(self.source, before) == value_of(self.source, value)
        which = ", with one value" if is_same else "; the later one counts"
        text = f"appears twice, on lines {first} and {line}{which}"
        check, level = ("params.repeated", "note") if is_same else ("params.twice", "warning")
        self.fault(check, level, text, line, parameter="/".join(path))

    def _set(self, path: Path1, node: yaml.Node) -> None:
        value, text = value_of(self.source, node), written(node)
        line, name = node.start_mark.line + 1, "/".join(path).lstrip("/")
        reason = why_unsendable(value)
        if reason is not None:
            more = {"hint": reason.hint} if reason.hint else {}
            self.fault(reason.check, "refused", reason.text, line, parameter=name,
                       **({"got": text} if text else {}), **more)  # fmt: skip
        kind = kind_of(value) if reason is None else UNSENDABLE
        put(self.tree, path, ParameterValue(value, kind, self.source, line, text))


def _own_namespace(node: yaml.MappingNode) -> Path1:
    """Return what ``_ns`` in a document says."""
    for key, value in node.value:
        if getattr(key, "value", None) == _NAMESPACE_KEY and isinstance(value, yaml.ScalarNode):
            return _joined((), str(value.value))
    return ()


def _joined(path: Path1, name: str) -> Path1:
    """Return the path of a name below another one, as ``ns_join``; a slash leads to the root."""
    parts = tuple(part for part in name.split("/") if part)
    return (ROOT, *parts) if name.startswith("/") else (*path, *parts)


def _flattened(source: Path, node: yaml.MappingNode) -> list[tuple[yaml.Node, yaml.Node]]:
    """Return the pairs of a mapping, those of merge keys before its own."""
    if not any(key.tag == _MERGE for key, _ in node.value):
        return list(node.value)
    merged = yaml.MappingNode(node.tag, list(node.value), node.start_mark, node.end_mark)
    try:
        yaml.SafeLoader("").flatten_mapping(merged)
    except yaml.YAMLError:
        place = f"line {node.start_mark.line + 1}"
        raise MalformedInputError("<< must name mappings", source=source, place=place) from None
    return list(merged.value)


def as_mapping(namespace: Ros1Namespace) -> Mapping[str, Any]:
    """Return a namespace as plain dicts and values, as ``rosparam get`` prints it."""
    return {
        name: as_mapping(member) if isinstance(member, Ros1Namespace) else member.value
        for name, member in namespace.members.items()
    }
