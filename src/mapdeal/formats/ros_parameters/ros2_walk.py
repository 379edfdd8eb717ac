"""The walk of ``rcl_yaml_param_parser`` through the events of a YAML file, step by step.

It is a machine of few states, and not a reader of nested mappings: what it makes of keys that
stand twice, of empty mappings and of lists in lists follows from these states alone, and nodes
live with that. So the same states are kept here.

References
----------
``parse_file_events``, ``parse_key``, ``parse_value`` of ros2/rcl,
rcl_yaml_param_parser/src/parse.c, and namespace.c beside it.
"""

from __future__ import annotations

from bisect import insort
from collections import defaultdict
from dataclasses import field
from pathlib import Path
from typing import Any

import yaml

from mapdeal.formats.ros_parameters.ros2_scalar import TagError, typed_scalar
from mapdeal.formats.ros_parameters.value import ParameterFileError, ParameterValue
from mapdeal.formats.yaml_text import written
from mapdeal.records import dataclass

PARAMETERS_KEY = "ros__parameters"
_LONGEST_TEXT = 200
_LONGEST_NODE_NAME = 255

_PRECEDENCE = (
    "bool", "integer", "double", "string",
    "byte_array", "bool_array", "integer_array", "double_array", "string_array",
)  # fmt: skip
_LAUNCH = "launch files replace it; pass the file that the node gets, or write the name itself"
_NO_LISTS_OF_LISTS = 'ROS 2 has none; put a footprint in quotes: "[[x1, y1], [x2, y2], ...]"'


@dataclass
class Slot:
    """A parameter of a node: its name, and one value of each type that was ever set."""

    name: str
    unset: ParameterValue
    values: dict[str, ParameterValue] = field(default_factory=dict)  # in the order of setting

    def set(self, value: ParameterValue) -> None:
        """Keep a value; one of another type stays beside it."""
        self.values.pop(value.kind, None)
        self.values[value.kind] = value

    def result(self) -> ParameterValue:
        """Return the value that rclcpp takes: by type, not by which one was set last."""
        if not self.values:
            return self.unset
        best = min(self.values.values(), key=lambda value: _PRECEDENCE.index(value.kind))
        last = next(reversed(self.values.values()))
        if last is best:
            return best
        return ParameterValue(best.value, best.kind, best.source, best.line, best.text, last)


class NodeSlots:
    """The parameters of one name of a node, as they are read."""

    def __init__(self, name: str, source: Path, line: int) -> None:
        self.name, self.source, self.line = name, source, line
        self.slots: list[Slot] = []
        self._places: dict[str, list[int]] = defaultdict(list)

    def find(self, name: str, unset: ParameterValue) -> int:
        """Return the index of the first parameter of a name, which is made if there is none."""
        places = self._places[name]
        if not places:
            self.slots.append(Slot(name, unset))
            places.append(len(self.slots) - 1)
        return places[0]

    def rename(self, index: int, name: str) -> None:
        """Rename a parameter, whether or not the name exists already."""
        slot = self.slots[index]
        self._places[slot.name].remove(index)
        slot.name = name
        insort(self._places[name], index)


class Walk:
    """The walk through one file; nodes of the files before it are found again."""

    def __init__(self, path: Path, nodes: dict[str, NodeSlots]) -> None:
        self._path, self._nodes = path, nodes
        self._node: NodeSlots | None = next(iter(nodes.values()), None)
        self._index = 0
        self._is_key, self._is_sequence, self._is_new_map = True, False, False
        self._in_parameters = False
        self._key = ""  # the last one, for errors
        self._depth = 0
        self._items: list[Any] = []
        self._items_kind: str | None = None
        self._sequence: yaml.Event | None = None
        self._node_names = _Names("/")
        self._parameter_names = _Names(".")

    def take(self, event: yaml.Event) -> None:
        """Go one step further."""
        if isinstance(event, yaml.ScalarEvent):
            if self._is_key:
                self._take_key(event)
            else:
                self._take_value(event)
        elif isinstance(event, yaml.SequenceStartEvent):
            self._start_sequence(event)
        elif isinstance(event, yaml.SequenceEndEvent):
            self._is_sequence, self._is_key = False, True
        elif isinstance(event, yaml.MappingStartEvent):
            self._start_mapping()
        elif isinstance(event, yaml.MappingEndEvent):
            self._end_mapping()
        elif isinstance(event, yaml.AliasEvent):
            raise self._error(
                "ROS 2 does not support aliases", event,
                got=f"*{event.anchor}", hint="write the value itself",
            )  # fmt: skip

    def _start_mapping(self) -> None:
        self._depth += 1
        self._is_new_map = self._is_key = True
        if self._in_parameters and self._depth - self._node_names.count == 2:
            self._is_new_map = False  # that of ros__parameters itself

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
            raise self._error(rule, event, hint=_nesting_hint())
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
            raise self._error(rule, event, hint=_nesting_hint())
        fault = name_fault(name)
        if fault:
            hint = _LAUNCH if any(mark in name for mark in "<$") else None
            raise self._error(f"not a name of a node: {fault}", event, got=name, hint=hint)
        if name not in self._nodes:
            self._nodes[name] = NodeSlots(name, self._path, line_of(event))
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
        """Return the error of a value that is empty, or that is none of a parameter."""
        got, hint = None if is_missing else _short(event.value), _nesting_hint()
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
            both = {kind, self._items_kind}
            hint = "write all of them with a decimal point" if both == {"integer", "double"} else \
                "put texts into quotes" if "string" in both else None  # fmt: skip
            rule = f"the values of a list must be of one type, here {self._items_kind}"
            raise self._error(rule, event, got=f"{_short(event.value)} ({kind})", hint=hint)
        self._items.append(value)
        first = self._sequence or event
        text = _between(first, event) + "]"
        self._set(self._value_of(self._items, f"{kind}_array", first, text))

    def _set(self, value: ParameterValue) -> None:
        slot = self._slot()
        if slot is not None:
            slot.set(value)

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
    """Names of mappings within each other, joined to one text, as namespace.c does it.

    The last one is dropped by looking for a separator from behind, even if that stands within
    the name.
    """

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
    """Return the error that a file is refused with as a whole."""
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


def _nesting_hint() -> str:
    return f"parameters stand below NODE: {PARAMETERS_KEY}: NAME: VALUE"


def line_of(event: yaml.Event) -> int:
    """Return the line that an event starts on, from 1."""
    return int(event.start_mark.line) + 1 if event.start_mark else 1


def _between(first: yaml.Event, last: yaml.Event) -> str:
    """Return what is written, on one line and cut where nobody reads on."""
    return " ".join(written(first, last, _LONGEST_TEXT).split())


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST_TEXT else f"{text[:_LONGEST_TEXT]}..."
