"""Parameter files of ROS 2.

The reader copies the state machine of ROS 2's parser, which does not build nested mappings: its
results for repeated keys, empty mappings and lists in lists follow from these states. Values with
tags, which releases read differently, are refused.

References
----------
``get_value``, ``parse_file_events``, ``parse_key`` and ``parse_value`` of ros2/rcl,
rcl_yaml_param_parser/src/parse.c, and namespace.c beside it. A quoted value is a string; any other
has the first type that parses all of it: bool, integer (``strtoll`` with base 0), double
(``strtod``), string.
"""

from __future__ import annotations

import hashlib
import math
import re
from bisect import insort
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from mapdeal.files import yaml_text
from mapdeal.files.source import read_file
from mapdeal.records import dataclass, field, replace
from mapdeal.ros.robot import ParameterFile, ParameterFileError, ParameterValue, hint_on_launch

_TRUE = ["Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"]
_FALSE = ["N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"]
_BOOLS = {word: word in _TRUE for word in (*_TRUE, *_FALSE)}

_SPACES = " \t\n\v\f\r"  # what C's functions skip in front of a number
_INTEGER = re.compile(r"([-+]?)(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)", re.ASCII)
_DECIMAL = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?", re.ASCII)
_SPECIAL = re.compile(r"[-+]?(?:inf(?:inity)?|nan)", re.ASCII | re.IGNORECASE)
_YAML_SPECIAL = re.compile(r"\.(nan|NaN|NAN)|[-+]?\.(inf|Inf|INF)")


def typed_scalar(text: str, *, is_quoted: bool) -> tuple[str, Any]:
    """Return the type of a value, by ROS 2's name, and the value."""
    text = text.partition("\0")[0]  # C's strings end there
    if not is_quoted:
        for kind, read in _PLAIN:
            if (value := read(text)) is not None:
                return kind, value
    return "string", text


def _integer(text: str) -> int | None:
    """Parse a text with the syntax of ``strtoll`` with base 0; None if invalid or too large."""
    match = _INTEGER.fullmatch(text.lstrip(_SPACES))
    if not match or len(match[2].lstrip("0xX")) > 25:  # 2^63 has 22 digits in octal
        return None
    value = int(match[1] + re.sub("^0(?=[0-7])", "0o", match[2]), 0)
    return value if -(1 << 63) <= value < 1 << 63 else None


def _double(text: str) -> float | None:
    """Parse a text with the syntax of ``strtod``; None if invalid or out of range."""
    if _YAML_SPECIAL.fullmatch(text):
        return float(text.replace(".", ""))
    text = text.lstrip(_SPACES)
    if _SPECIAL.fullmatch(text):
        return float(text)
    value = float(text) if _DECIMAL.fullmatch(text) else math.inf
    return value if math.isfinite(value) else None


_PLAIN = (("bool", _BOOLS.get), ("integer", _integer), ("double", _double))  # with their parsers
PARAMETERS_KEY = "ros__parameters"
_LONGEST_TEXT = 200
_MOST_ALIASES = 200

_PRECEDENCE = (
    "bool", "integer", "double", "string",
    "bool_array", "integer_array", "double_array", "string_array",
)  # fmt: skip
_NESTING = f"parameters stand below NODE: {PARAMETERS_KEY}: NAME: VALUE"
_NO_LISTS_OF_LISTS = 'ROS 2 has none; put a footprint in quotes: "[[x1, y1], [x2, y2], ...]"'


@dataclass
class Slot:
    """A parameter of a node: its name, and the last value of each type that was set."""

    name: str
    unset: ParameterValue
    values: dict[str, ParameterValue] = field(default_factory=dict)  # in the order of setting

    def result(self) -> ParameterValue:
        """Return the value that rclcpp uses: types have precedence, not the order of setting."""
        if not self.values:
            return self.unset
        used = min(self.values.values(), key=lambda value: _PRECEDENCE.index(value.kind))
        last = next(reversed(self.values.values()))
        value = tuple(used.value) if isinstance(used.value, list) else used.value
        return replace(used, value=value, ignored=None if last is used else last)


class Ros2Node:
    def __init__(self, name: str, source: Path, line: int) -> None:
        self.name = name if name.startswith("/") else f"/{name}"
        self.source, self.line = source, line
        self.slots: list[Slot] = []
        self.entries: tuple[tuple[str, ParameterValue], ...] = ()  # set after all files are read
        self._places: dict[str, list[int]] = {}

    def find(self, name: str, unset: ParameterValue) -> int:
        if not (places := self._places.setdefault(name, [])):
            self.slots.append(Slot(name, unset))
            places.append(len(self.slots) - 1)
        return places[0]

    def rename(self, index: int, name: str) -> None:
        slot = self.slots[index]
        self._places[slot.name].remove(index)
        slot.name = name
        insort(self._places.setdefault(name, []), index)


class FileReader:
    """State machine that reads one file's events into nodes, which all files share."""

    def __init__(self, path: Path, nodes: dict[str, Ros2Node]) -> None:
        self._path, self._nodes = path, nodes
        self._node: Ros2Node | None = next(iter(nodes.values()), None)
        self._index = self._depth = 0
        self._is_key, self._is_sequence, self._starts_mapping = True, False, False
        self._in_parameters = False
        self._key = ""  # the last key, for errors
        self._anchored: dict[str | None, yaml.ScalarEvent] = {}
        self.aliases: list[yaml.AliasEvent] = []
        self._items: list[Any] = []
        self._items_kind: str | None = None
        self._sequence: yaml.Event | None = None
        self._node_names, self._parameter_names = _Names("/"), _Names(".")

    def handle(self, event: yaml.Event) -> None:
        if isinstance(event, yaml.AliasEvent):
            event = self._resolved(event)
        if isinstance(event, yaml.ScalarEvent):
            self._anchored[event.anchor] = event
            if self._is_key:
                self._handle_key(event)
            else:
                self._handle_value(event)
        elif isinstance(event, yaml.SequenceStartEvent):
            self._anchored.pop(event.anchor, None)
            self._start_sequence(event)
        elif isinstance(event, yaml.SequenceEndEvent):
            self._is_sequence, self._is_key = False, True
        elif isinstance(event, yaml.MappingStartEvent):
            self._anchored.pop(event.anchor, None)
            self._depth += 1
            # the mapping of ros__parameters itself adds no name
            is_root = self._in_parameters and self._depth - self._node_names.count == 2
            self._is_key, self._starts_mapping = True, not is_root
        elif isinstance(event, yaml.MappingEndEvent):
            self._end_mapping()

    def _resolved(self, alias: yaml.AliasEvent) -> yaml.ScalarEvent:
        # rcl refuses aliases. nav2_bringup's RewrittenYaml loads and dumps files, which replaces
        # aliases of scalars by values, but writes those of lists and mappings as aliases again.
        if (scalar := self._anchored.get(alias.anchor)) is None:
            rule, got = "ROS 2 does not support aliases", f"*{alias.anchor}"
            raise self._error(rule, alias, got=got, hint="write the value itself")
        if len(self.aliases) >= _MOST_ALIASES:
            raise self._error(f"more than {_MOST_ALIASES} aliases", alias)
        self.aliases.append(alias)
        return yaml.ScalarEvent(
            None, scalar.tag, scalar.implicit, scalar.value, alias.start_mark, alias.end_mark,
            style=scalar.style,
        )  # fmt: skip

    def _end_mapping(self) -> None:
        if self._in_parameters:
            if self._parameter_names.count:
                self._parameter_names.drop_last()
            else:
                self._in_parameters = False
        elif self._depth == self._node_names.count + 1:
            self._node_names.drop_last()
        self._depth -= 1

    def _start_sequence(self, event: yaml.SequenceStartEvent) -> None:
        if self._is_key and self._in_parameters:
            raise self._error("a list within a list", event, hint=_NO_LISTS_OF_LISTS)
        if self._is_key:
            raise self._error("a list stands where a key should be", event)
        if not self._in_parameters:
            raise self._error(f"a list stands outside of {PARAMETERS_KEY}", event, hint=_NESTING)
        self._is_sequence = True
        self._items_kind, self._sequence = None, event
        slot = self._slot()
        if slot is not None and not slot.values:
            slot.unset = self._value_of(None, "not set", event, "[]")

    def _handle_key(self, event: yaml.ScalarEvent) -> None:
        if not event.value:
            raise self._error("an empty key", event)
        key = event.value.partition("\0")[0]
        if self._in_parameters:
            self._handle_parameter(key, event)
        elif key.startswith(PARAMETERS_KEY):
            self._handle_parameters_key(event)
        else:
            self._node_names.add(key)
            self._key = self._node_names.text or key
        self._is_key = False

    def _handle_parameters_key(self, event: yaml.ScalarEvent) -> None:
        if (name := self._node_names.text) is None:
            rule = f"no name of a node stands above {PARAMETERS_KEY}"
            raise self._error(rule, event, hint=_NESTING)
        if fault := name_fault(name):
            hint = hint_on_launch("name itself") if any(mark in name for mark in "<$") else None
            raise self._error(f"not a name of a node: {fault}", event, got=name, hint=hint)
        if name not in self._nodes:
            self._nodes[name] = Ros2Node(name, self._path, line_of(event))
        self._node = self._nodes[name]
        self._in_parameters = True
        self._key = f"{PARAMETERS_KEY} of {name}"

    def _handle_parameter(self, key: str, event: yaml.ScalarEvent) -> None:
        if (node := self._node) is None:
            raise self._error("a key before any node", event)
        unset = self._value_of(None, "not set", event, "{}")
        if self._starts_mapping:
            if (slot := self._slot()) is None:
                raise self._error("a mapping stands where a value should be", event)
            self._parameter_names.replace(slot.name)
            self._starts_mapping = False
        space = self._parameter_names.text
        self._index = node.find(key if space is None else space, unset)
        if space is not None:
            node.rename(self._index, f"{space}.{key}")
        slot = node.slots[self._index]
        self._key = slot.name
        if not slot.values:
            slot.unset = unset

    def _handle_value(self, event: yaml.ScalarEvent) -> None:
        node = self._node
        is_quoted = event.style in ("'", '"')
        is_missing = not is_quoted and not event.value
        if is_missing or not self._in_parameters or node is None or not node.slots:
            raise self._misplaced(event, is_missing=is_missing)
        if event.tag not in (None, "!"):
            got, hint = event.tag.replace("tag:yaml.org,2002:", "!!"), "write the value without it"
            raise self._error("a value has a tag", event, got=got, hint=hint)
        kind, value = typed_scalar(event.value, is_quoted=is_quoted)
        if self._is_sequence:
            self._handle_item(event, kind, value)
        else:
            self._set(self._value_of(value, kind, event, _excerpt(event, event)))
            self._is_key = True

    def _misplaced(self, event: yaml.ScalarEvent, *, is_missing: bool) -> ParameterFileError:
        got, hint = None if is_missing else _short(event.value), _NESTING
        if self._key.startswith(f"{PARAMETERS_KEY} of "):
            rule = f"{self._key} holds no parameters, and ROS 2 refuses the whole file"
            hint = f"write {PARAMETERS_KEY}: {{}}, or take the node out"
        elif not is_missing:
            rule = f"a value stands outside of {PARAMETERS_KEY}"
        elif self._is_sequence:
            rule, hint = "a value of a list is missing", "write a value, or take the line out"
        else:
            rule = f"the value of {self._key} is missing"
            if self._in_parameters:
                hint = 'write a value, "" for an empty text, or take the key out'
        return self._error(rule, event, got=got, hint=hint)

    def _handle_item(self, event: yaml.ScalarEvent, kind: str, value: Any) -> None:
        if self._items_kind is None:
            self._items_kind, self._items = kind, []
        if kind != self._items_kind:
            kinds = {kind, self._items_kind}
            hint = "put texts into quotes" if "string" in kinds else None
            if kinds == {"integer", "double"}:
                hint = "write all of them with a decimal point"
            rule = f"the values of a list must be of one type, here {self._items_kind}"
            raise self._error(rule, event, got=f"{_short(event.value)} ({kind})", hint=hint)
        self._items.append(value)
        first = self._sequence or event
        self._set(self._value_of(self._items, f"{kind}_array", first, _excerpt(first, event) + "]"))

    def _set(self, value: ParameterValue) -> None:
        if (slot := self._slot()) is not None:
            earlier = slot.values.pop(value.kind, None)  # values of other types remain
            if earlier and earlier.source == value.source and earlier.line != value.line:
                value = replace(value, replaced=earlier)
            slot.values[value.kind] = value

    def _slot(self) -> Slot | None:
        """Return the current parameter; None if the index belongs to another node."""
        node = self._node
        return node.slots[self._index] if node and self._index < len(node.slots) else None

    def _value_of(self, value: Any, kind: str, event: yaml.Event, text: str) -> ParameterValue:
        return ParameterValue(value, kind, self._path, line_of(event), _short(text))

    def _error(
        self, rule: str, event: yaml.Event, *, got: str | None = None, hint: str | None = None
    ) -> ParameterFileError:
        return refusal(self._path, rule, line_of(event), got=got, hint=hint)


class _Names:
    """Names of nested mappings, joined to one text, as in namespace.c."""

    # To drop the last name, namespace.c cuts at the last separator, even one within a name.
    def __init__(self, separator: str) -> None:
        self._separator = separator
        self.text: str | None = None
        self.count = 0

    def add(self, name: str) -> None:
        if not self.count or self.text is None:
            self.replace(name)
        else:
            joint = "" if self.text.endswith(self._separator) else self._separator
            self.replace(self.text + joint + name)

    def replace(self, text: str) -> None:
        self.text = text
        self.count += 1

    def drop_last(self) -> None:
        if self.count <= 1:
            self.text = None
        elif self.text is not None and self._separator in self.text:
            self.text = self.text[: self.text.rindex(self._separator)]
        self.count = max(self.count - 1, 0)


def refusal(
    path: Path, rule: str, line: int | None, *, got: str | None = None, hint: str | None = None
) -> ParameterFileError:
    place = None if line is None else f"line {line}"
    shown: dict[str, Any] = {} if got is None else {"got": got}
    error = ParameterFileError(rule, source=path, place=place, hint=hint, **shown)
    error.line, error.found = line, got
    return error


def name_fault(name: str) -> str | None:
    *spaces, last = name.removeprefix("/").split("/")
    if not all(spaces):
        return "it has two slashes in a row"
    if not last:
        return "it ends with a slash"
    for token in (*spaces, last):
        if token in ("*", "**"):
            continue
        if not (token.isascii() and token.replace("_", "a").isalnum()):
            return f"only letters, digits and _ are allowed in {token!r}"
        if token[0].isdigit():
            return f"{token!r} starts with a digit"
    return "it is too long" if len(last) > 255 else None


def line_of(event: yaml.Event | yaml.Node) -> int:
    return int(event.start_mark.line) + 1 if event.start_mark else 1


def _excerpt(first: yaml.Event, last: yaml.Event) -> str:
    return " ".join(yaml_text.source_text(first, last, _LONGEST_TEXT).split())


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST_TEXT else f"{text[:_LONGEST_TEXT]}..."


_LIMITS = yaml_text.YamlLimits(bytes=1 << 20, nodes=50_000)
_DEEPEST = 40


@dataclass(frozen=True)
class Ros2Parameters:
    nodes: tuple[Ros2Node, ...]
    files: tuple[ParameterFile, ...]
    aliases: tuple[tuple[Path, int, str], ...] = ()
    """File, line and name of the first alias in each file with aliases."""

    def matching(self, node: str) -> tuple[Ros2Node, ...]:
        return tuple(entry for entry in self.nodes if matches(entry.name, node))

    def for_node(self, node: str) -> dict[str, ParameterValue]:
        # As in rclcpp's ``parameter_map_from`` since Humble, later entries override earlier ones,
        # no matter whether their name is ``/**`` or the node's full name.
        return {name: value for entry in self.matching(node) for name, value in entry.entries}

    def unset_for(self, node: str) -> list[tuple[str, ParameterValue]]:
        """Return parameters without a value, ``[]`` and ``{}``: with any, the node exits."""
        entries = (pair for entry in self.matching(node) for pair in entry.entries)
        return [(name, value) for name, value in entries if value.kind == "not set"]


def matches(pattern: str, node: str) -> bool:
    parts = node.split("/")[1:]
    counts = {0}  # numbers of the node's parts that the pattern's parts so far can match
    for pattern_part in pattern.split("/")[1:]:
        if pattern_part == "**":
            counts = set(range(min(counts), len(parts) + 1))
        else:
            counts = {n + 1 for n in counts if n < len(parts) and pattern_part in ("*", parts[n])}
        if not counts:
            return False
    return len(parts) in counts


def read_ros2(paths: Sequence[Path]) -> Ros2Parameters:
    nodes: dict[str, Ros2Node] = {}
    files, aliases = [], []
    for path in paths:
        data = read_file(path, limit=_LIMITS.bytes, inspect=partial(yaml_text.refuse_image, path))
        files.append(ParameterFile(path, hashlib.sha256(data).hexdigest()))
        reader = FileReader(path, nodes)
        for event in _events(path, yaml_text.decoded_text(path, data)):
            reader.handle(event)
        aliases += [(path, line_of(alias), f"*{alias.anchor}") for alias in reader.aliases[:1]]
    if not nodes:
        raise refusal(paths[0], "no parameters in it: no node has a key ros__parameters", None)
    for node in nodes.values():
        node.entries = tuple((slot.name, slot.result()) for slot in node.slots)
    return Ros2Parameters(tuple(nodes.values()), tuple(files), tuple(aliases))


def _events(path: Path, text: str) -> Iterator[yaml.Event]:
    depth = 0
    try:
        for count, event in enumerate(yaml_text.events_of(path, text, _LIMITS)):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEEPEST:
                raise refusal(path, f"nested deeper than {_DEEPEST} levels", line_of(event))
            if count > _LIMITS.nodes:
                rule = f"more than {_LIMITS.nodes} keys and values"
                raise refusal(path, rule, line_of(event))
            yield event
    except yaml.YAMLError as error:
        rule, place = yaml_text.fault_in(text, error)
        raise refusal(path, rule, place[0] if place else None) from None
