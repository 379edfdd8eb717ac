"""Parameter files of ROS 2.

The reader is a machine of few states, and not one of nested mappings: what it makes of keys that
stand twice, of empty mappings and of lists in lists follows from these states alone, and nodes
live with that. Tags are as in the parser of Nav2's main branch; releases up to Kilted know
``!!str`` alone.

References
----------
``get_value``, ``parse_file_events``, ``parse_key`` and ``parse_value`` of ros2/rcl,
rcl_yaml_param_parser/src/parse.c, and namespace.c beside it. A value in quotes is a string; else
it is the first of bool, integer (``strtoll`` with base 0), double (``strtod``) and string that
takes the whole of it.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import math
import re
from bisect import insort
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from mapdeal.files.source import read_file
from mapdeal.files.yaml_text import (
    YamlLimits,
    decoded_text,
    events_of,
    fault_in,
    refuse_image,
    source_text,
)
from mapdeal.ros.robot import ParameterFileError, ParameterValue

_TRUE = frozenset(["Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"])
_FALSE = frozenset(["N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"])
_TAG = "tag:yaml.org,2002:"

_SPACES = " \t\n\v\f\r"  # what C's functions skip in front of a number
_INTEGER = re.compile(r"([-+]?)(?:0[xX]([0-9a-fA-F]+)|(0[0-7]*)|([1-9][0-9]*))", re.ASCII)
_DECIMAL = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?", re.ASCII)
_HEXADECIMAL = re.compile(
    r"[-+]?0[xX](?:[0-9a-fA-F]+(?:\.[0-9a-fA-F]*)?|\.[0-9a-fA-F]+)(?:[pP][-+]?[0-9]+)?", re.ASCII
)
_SPECIAL = re.compile(r"[-+]?(?:inf(?:inity)?|nan(?:\([0-9a-z_]*\))?)", re.ASCII | re.IGNORECASE)
_YAML_SPECIAL = frozenset(
    [f".{word}" for word in ("nan", "NaN", "NAN")]
    + [f"{sign}.{word}" for sign in ("", "+", "-") for word in ("inf", "Inf", "INF")]
)
_MOST_DIGITS = 400  # of a number that may still fit a double; Python refuses to read many more


class TagError(ValueError):
    """A tag that the parser does not know, or that the value does not fit."""


def typed_scalar(text: str, *, is_quoted: bool, tag: str | None) -> tuple[str, Any]:
    """Return the type of a value, as ROS 2 calls it, and the value."""
    text = text.partition("\0")[0]  # C's strings end there
    if tag is not None:
        return _tagged(text, tag)
    if not is_quoted:
        for kind, _, read in _PLAIN:
            value = read(text)
            if value is not None:
                return kind, value
    return "string", text


def _tagged(text: str, tag: str) -> tuple[str, Any]:
    name = tag.removeprefix(_TAG)
    if name == "str":
        return "string", text
    if name == "binary":
        try:
            return "byte_array", base64.b64decode(text, validate=True)
        except binascii.Error:
            raise TagError("is not in base64, as its tag says") from None
    for kind, tag_name, read in _PLAIN:
        if name == tag_name:
            value = read(text)
            if value is None:
                raise TagError(f"is not a value of its tag !!{name}")
            return kind, value
    shown = f"!!{name}" if name != tag else tag
    raise TagError(f"has a tag that ROS 2 does not know, {shown}")


def _bool(text: str) -> bool | None:
    return True if text in _TRUE else False if text in _FALSE else None


def _integer(text: str) -> int | None:
    """Return what ``strtoll(text, end, 0)`` makes of the whole text, unless it overflows."""
    match = _INTEGER.fullmatch(text.lstrip(_SPACES))
    if not match:
        return None
    sign, hexadecimal, octal, decimal = match.groups()
    digits = hexadecimal or octal or decimal
    if len(digits.lstrip("0")) > 25:  # 2^63 has 22 digits in octal
        return None
    value = int(digits, 16 if hexadecimal else 8 if octal else 10)
    value = -value if sign == "-" else value
    return value if -(1 << 63) <= value < 1 << 63 else None


def _double(text: str) -> float | None:
    """Return what ``strtod`` makes of the whole text, unless it is out of range."""
    if text in _YAML_SPECIAL:
        return float(text.replace(".", ""))
    text = text.lstrip(_SPACES)
    if _SPECIAL.fullmatch(text):
        return float(text.partition("(")[0])
    if _HEXADECIMAL.fullmatch(text):
        return _from_hexadecimal(text)
    if not _DECIMAL.fullmatch(text):
        return None
    value = float(text)
    mantissa = re.split("[eE]", text)[0]
    is_zero = not mantissa.strip("+-0.")
    return value if is_zero or _is_normal(value) else None


def _from_hexadecimal(text: str) -> float | None:
    if len(text) > _MOST_DIGITS:
        return None
    try:
        value = float.fromhex(text)
        is_zero = not re.split("[pP]", text)[0].lower().lstrip("+-").removeprefix("0x").strip("0.")
        if is_zero or _is_normal(value):
            return value
        mantissa, _, exponent = text.lower().partition("p")  # exact ones set no errno
        scaled = float.fromhex(f"{mantissa}p{int(exponent or 0) + 200}")
    except (OverflowError, ValueError):
        return None
    return value if value and scaled == math.ldexp(value, 200) else None


def _is_normal(value: float) -> bool:
    """Return whether ``strtod`` is content: infinite and subnormal results set ``errno``."""
    return math.isfinite(value) and abs(value) >= 2.0**-1022


_PLAIN = (("bool", "bool", _bool), ("integer", "int", _integer), ("double", "float", _double))
"""Types, their tags, and what reads them."""

PARAMETERS_KEY = "ros__parameters"
_LONGEST_TEXT = 200
_MOST_ALIASES = 200
_LONGEST_NODE_NAME = 255

_PRECEDENCE = (
    "bool", "integer", "double", "string",
    "byte_array", "bool_array", "integer_array", "double_array", "string_array",
)  # fmt: skip
_NESTING = f"parameters stand below NODE: {PARAMETERS_KEY}: NAME: VALUE"
_LAUNCH = "launch files replace it; pass the file that the node gets, or write the name itself"
_NO_LISTS_OF_LISTS = 'ROS 2 has none; put a footprint in quotes: "[[x1, y1], [x2, y2], ...]"'


@dataclass
class Slot:
    """A parameter of a node: its name, and one value of each type that was ever set."""

    name: str
    unset: ParameterValue
    values: dict[str, ParameterValue] = field(default_factory=dict)  # in the order of setting

    def result(self) -> ParameterValue:
        """Return the value that rclcpp takes: by type, not by which one was set last."""
        if not self.values:
            return self.unset
        best = min(self.values.values(), key=lambda value: _PRECEDENCE.index(value.kind))
        last = next(reversed(self.values.values()))
        value = tuple(best.value) if isinstance(best.value, list) else best.value
        return replace(best, value=value, ignored=None if last is best else last)


class Ros2Node:
    """The parameters below one name of a node."""

    def __init__(self, name: str, source: Path, line: int) -> None:
        self.name = name if name.startswith("/") else f"/{name}"
        self.source, self.line = source, line
        self.slots: list[Slot] = []
        self.entries: tuple[tuple[str, ParameterValue], ...] = ()
        """Names and values, once all files are read."""
        self._places: dict[str, list[int]] = defaultdict(list)

    def find(self, name: str, unset: ParameterValue) -> int:
        places = self._places[name]
        if not places:
            self.slots.append(Slot(name, unset))
            places.append(len(self.slots) - 1)
        return places[0]

    def rename(self, index: int, name: str) -> None:
        slot = self.slots[index]
        self._places[slot.name].remove(index)
        slot.name = name
        insort(self._places[name], index)


class Walk:
    """The walk through one file; nodes of the files before it are found again."""

    def __init__(self, path: Path, nodes: dict[str, Ros2Node]) -> None:
        self._path, self._nodes = path, nodes
        self._node: Ros2Node | None = next(iter(nodes.values()), None)
        self._index = 0
        self._is_key, self._is_sequence, self._is_new_map = True, False, False
        self._in_parameters = False
        self._key = ""  # the last one, for errors
        self._depth = 0
        self._anchored: dict[str | None, yaml.ScalarEvent] = {}
        self.aliases: list[yaml.AliasEvent] = []
        self._items: list[Any] = []
        self._items_kind: str | None = None
        self._sequence: yaml.Event | None = None
        self._node_names = _Names("/")
        self._parameter_names = _Names(".")

    def take(self, event: yaml.Event) -> None:
        if isinstance(event, yaml.AliasEvent):
            event = self._resolved(event)
        if isinstance(event, yaml.ScalarEvent):
            self._anchored[event.anchor] = event
            if self._is_key:
                self._take_key(event)
            else:
                self._take_value(event)
        elif isinstance(event, yaml.SequenceStartEvent):
            self._anchored.pop(event.anchor, None)
            self._start_sequence(event)
        elif isinstance(event, yaml.SequenceEndEvent):
            self._is_sequence, self._is_key = False, True
        elif isinstance(event, yaml.MappingStartEvent):
            self._anchored.pop(event.anchor, None)
            self._depth += 1
            # that of ros__parameters itself is none
            is_own = self._in_parameters and self._depth - self._node_names.count == 2
            self._is_key, self._is_new_map = True, not is_own
        elif isinstance(event, yaml.MappingEndEvent):
            self._end_mapping()

    def _resolved(self, alias: yaml.AliasEvent) -> yaml.ScalarEvent:
        """Return the scalar that an alias stands for, at the alias's own place."""
        # rcl knows no aliases. nav2_bringup's RewrittenYaml loads a file and dumps it again, which
        # writes scalars in the place of their aliases, but again aliases of lists and mappings.
        scalar = self._anchored.get(alias.anchor)
        if scalar is None:
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
        if self._is_key:
            if self._in_parameters:
                raise self._error("a list within a list", event, hint=_NO_LISTS_OF_LISTS)
            raise self._error("a list stands where a key should be", event)
        if not self._in_parameters:
            rule = f"a list stands outside of {PARAMETERS_KEY}"
            raise self._error(rule, event, hint=_NESTING)
        self._is_sequence = True
        self._items_kind, self._sequence = None, event
        slot = self._slot()
        if slot is not None and not slot.values:
            slot.unset = self._value_of(None, "not set", event, "[]")

    def _take_key(self, event: yaml.ScalarEvent) -> None:
        if not event.value:
            raise self._error("an empty key", event)
        key = event.value.partition("\0")[0]
        if self._in_parameters:
            self._take_parameter(key, event)
        elif key.startswith(PARAMETERS_KEY):
            self._take_parameters_key(event)
        else:
            self._node_names.add(key)
            self._key = self._node_names.text or key
        self._is_key = False

    def _take_parameters_key(self, event: yaml.ScalarEvent) -> None:
        name = self._node_names.text
        if name is None:
            rule = f"no name of a node stands above {PARAMETERS_KEY}"
            raise self._error(rule, event, hint=_NESTING)
        fault = name_fault(name)
        if fault:
            hint = _LAUNCH if any(mark in name for mark in "<$") else None
            raise self._error(f"not a name of a node: {fault}", event, got=name, hint=hint)
        if name not in self._nodes:
            self._nodes[name] = Ros2Node(name, self._path, line_of(event))
        self._node = self._nodes[name]
        self._in_parameters = True
        self._key = f"{PARAMETERS_KEY} of {name}"

    def _take_parameter(self, key: str, event: yaml.ScalarEvent) -> None:
        node = self._node
        if node is None:  # a value came first, and was refused
            raise self._error("a key before any node", event)
        unset = self._value_of(None, "not set", event, "{}")
        if self._is_new_map:
            slot = self._slot()
            if slot is None:
                raise self._error("a mapping stands where a value should be", event)
            self._parameter_names.replace(slot.name)
            self._is_new_map = False
        space = self._parameter_names.text
        if space is None:
            self._index = node.find(key, unset)
        else:
            self._index = node.find(space, unset)
            node.rename(self._index, f"{space}.{key}")
        slot = node.slots[self._index]
        self._key = slot.name
        if not slot.values:
            slot.unset = unset

    def _take_value(self, event: yaml.ScalarEvent) -> None:
        node = self._node
        is_quoted = event.style in ("'", '"')
        is_missing = not is_quoted and not event.value
        if is_missing or not self._in_parameters or node is None or not node.slots:
            raise self._unplaced(event, is_missing=is_missing)
        tag = None if event.tag == "!" else event.tag
        try:
            kind, value = typed_scalar(event.value, is_quoted=is_quoted, tag=tag)
        except TagError as error:
            raise self._error(f"the value {error}", event, got=_short(event.value)) from None
        if self._is_sequence:
            self._take_item(event, kind, value)
        else:
            self._set(self._value_of(value, kind, event, _between(event, event)))
            self._is_key = True

    def _unplaced(self, event: yaml.ScalarEvent, *, is_missing: bool) -> ParameterFileError:
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

    def _take_item(self, event: yaml.ScalarEvent, kind: str, value: Any) -> None:
        """Put a value into a list, which has the type of its first one."""
        if kind == "byte_array":
            raise self._error("bytes in base64 cannot stand in a list", event)
        if self._items_kind is None:
            self._items_kind, self._items = kind, []
        if kind != self._items_kind:
            both, hint = {kind, self._items_kind}, None
            if both == {"integer", "double"}:
                hint = "write all of them with a decimal point"
            elif "string" in both:
                hint = "put texts into quotes"
            rule = f"the values of a list must be of one type, here {self._items_kind}"
            raise self._error(rule, event, got=f"{_short(event.value)} ({kind})", hint=hint)
        self._items.append(value)
        first = self._sequence or event
        text = _between(first, event) + "]"
        self._set(self._value_of(self._items, f"{kind}_array", first, text))

    def _set(self, value: ParameterValue) -> None:
        slot = self._slot()
        if slot is not None:
            before = slot.values.pop(value.kind, None)  # one of another type stays beside it
            if before is not None and before.source == value.source and before.line != value.line:
                value = replace(value, replaced=before)
            slot.values[value.kind] = value

    def _slot(self) -> Slot | None:
        """Return the parameter at hand; none if the index is that of another node."""
        node = self._node
        return node.slots[self._index] if node and self._index < len(node.slots) else None

    def _value_of(self, value: Any, kind: str, event: yaml.Event, text: str) -> ParameterValue:
        return ParameterValue(value, kind, self._path, line_of(event), _short(text))

    def _error(
        self, rule: str, event: yaml.Event, *, got: str | None = None, hint: str | None = None
    ) -> ParameterFileError:
        return refusal(self._path, rule, line_of(event), got=got, hint=hint)


class _Names:
    """Names of mappings within each other, joined to one text, as namespace.c does it."""

    # The last one is dropped by looking for a separator from behind, even if that stands within the
    # name.
    def __init__(self, separator: str) -> None:
        self._separator = separator
        self.text: str | None = None
        self.count = 0

    def add(self, name: str) -> None:
        if not self.count or self.text is None:
            self.text = name
        else:
            joint = "" if self.text.endswith(self._separator) else self._separator
            self.text += joint + name
        self.count += 1

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
    """Return what is wrong with a name of a node and its namespaces; None if nothing is."""
    if name in ("/**", "/*"):
        return None
    *spaces, last = name.removeprefix("/").split("/")
    if any(not space for space in spaces):
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
    return "it is too long" if len(last) > _LONGEST_NODE_NAME else None


def line_of(event: yaml.Event) -> int:
    return int(event.start_mark.line) + 1 if event.start_mark else 1


def _between(first: yaml.Event, last: yaml.Event) -> str:
    """Return what is written, on one line and cut where nobody reads on."""
    return " ".join(source_text(first, last, _LONGEST_TEXT).split())


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST_TEXT else f"{text[:_LONGEST_TEXT]}..."


_LIMITS = YamlLimits(bytes=1 << 20, nodes=50_000)
_DEEPEST = 40


@dataclass(frozen=True)
class Ros2Parameters:
    nodes: tuple[Ros2Node, ...]
    files: tuple[tuple[Path, str], ...]
    aliases: tuple[tuple[Path, int, str], ...] = ()
    """File, line and name of the first alias of each file that has some."""

    def matching(self, node: str) -> tuple[Ros2Node, ...]:
        """Return what is meant for a node of a full name, from the root on."""
        return tuple(one for one in self.nodes if matches(one.name, node))

    def for_node(self, node: str) -> dict[str, ParameterValue]:
        """Return the parameters that a node of a full name gets, by their names."""
        # As rclcpp's ``parameter_map_from`` since Humble: what comes later overrides, in the order
        # of the nodes in the files, whether ``/**`` or the very name.
        return {name: value for one in self.matching(node) for name, value in one.entries}

    def unset_for(self, node: str) -> list[tuple[str, ParameterValue]]:
        """Return parameters without a value, ``[]`` and ``{}``: rclcpp ends a node over any."""
        entries = (entry for one in self.matching(node) for entry in one.entries)
        return [(name, value) for name, value in entries if value.kind == "not set"]


def matches(pattern: str, node: str) -> bool:
    """Return whether a name with wildcards stands for a node of a full name."""
    wanted = node.split("/")[1:]
    reached = {0}  # how much of the name the parts so far can be
    for part in pattern.split("/")[1:]:
        if part == "**":
            reached = set(range(min(reached), len(wanted) + 1))
        else:
            left = [index for index in reached if index < len(wanted)]
            reached = {index + 1 for index in left if part in ("*", wanted[index])}
        if not reached:
            return False
    return len(wanted) in reached


def read_ros2(paths: Sequence[Path]) -> Ros2Parameters:
    """Return the parameters in files, which are read into one another as ROS 2 does."""
    nodes: dict[str, Ros2Node] = {}
    files, aliases = [], []
    for path in paths:
        data = read_file(path, limit=_LIMITS.bytes, inspect=partial(refuse_image, path))
        files.append((path, hashlib.sha256(data).hexdigest()))
        walk = Walk(path, nodes)
        for event in _events(path, decoded_text(path, data)):
            walk.take(event)
        aliases += [(path, line_of(alias), f"*{alias.anchor}") for alias in walk.aliases[:1]]
    if not nodes:
        raise refusal(paths[0], "no parameters in it: no node has a key ros__parameters", None)
    for node in nodes.values():
        node.entries = tuple((slot.name, slot.result()) for slot in node.slots)
    return Ros2Parameters(tuple(nodes.values()), tuple(files), tuple(aliases))


def _events(path: Path, text: str) -> Iterator[yaml.Event]:
    depth = 0
    try:
        for count, event in enumerate(events_of(path, text, _LIMITS)):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEEPEST:
                raise refusal(path, f"nested deeper than {_DEEPEST} levels", line_of(event))
            if count > _LIMITS.nodes:
                rule = f"more than {_LIMITS.nodes} keys and values"
                raise refusal(path, rule, line_of(event))
            yield event
    except yaml.YAMLError as error:
        rule, at = fault_in(text, error)
        raise refusal(path, rule, at[0] if at else None) from None
