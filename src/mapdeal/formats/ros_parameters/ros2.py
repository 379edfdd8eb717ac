"""Files of ROS 2 parameters, read as ``rcl_yaml_param_parser`` and rclcpp read them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import yaml

from mapdeal.formats.ros_parameters.ros2_walk import NodeSlots, Walk, line_of, refusal
from mapdeal.formats.ros_parameters.value import ParameterValue
from mapdeal.formats.source import read_file
from mapdeal.formats.yaml_text import YamlLimits, decoded_text, events_of, fault_in, refuse_image
from mapdeal.records import dataclass

OF_PARAMETERS = YamlLimits(bytes=1 << 20, nodes=50_000)
DEEPEST = 40
TOO_DEEP = f"nested deeper than {DEEPEST} levels"


@dataclass(frozen=True)
class Ros2Node:
    """The parameters below one name of a node."""

    name: str
    source: Path
    line: int
    entries: tuple[tuple[str, ParameterValue], ...]


@dataclass(frozen=True)
class Ros2Parameters:
    """Combined content of ROS 2 parameter files."""

    nodes: tuple[Ros2Node, ...]
    files: tuple[tuple[Path, str], ...]

    def matching(self, node: str) -> tuple[Ros2Node, ...]:
        """Return what is meant for a node of a full name, from the root on."""
        return tuple(one for one in self.nodes if matches(one.name, node))

    def for_node(self, node: str) -> dict[str, ParameterValue]:
        """Return the parameters that a node of a full name gets, by their names.

        As rclcpp's ``parameter_map_from`` since Humble: what comes later overrides, in the order
        of the nodes in the files, whether ``/**`` or the very name.
        """
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
    nodes: dict[str, NodeSlots] = {}
    files = []
    for path in paths:
        data = read_file(path, limit=OF_PARAMETERS.bytes, inspect=partial(refuse_image, path))
        files.append((path, hashlib.sha256(data).hexdigest()))
        walk = Walk(path, nodes)
        for event in _events(path, decoded_text(path, data)):
            walk.take(event)
    if not nodes:
        raise refusal(paths[0], "no parameters in it: no node has a key ros__parameters", None)
    return Ros2Parameters(tuple(_node(one) for one in nodes.values()), tuple(files))


def _node(one: NodeSlots) -> Ros2Node:
    name = one.name if one.name.startswith("/") else f"/{one.name}"
    entries = tuple((slot.name, _frozen(slot.result())) for slot in one.slots)
    return Ros2Node(name, one.source, one.line, entries)


def _frozen(value: ParameterValue) -> ParameterValue:
    """Return a value whose list, still the reader's own, has become a tuple."""
    return replace(value, value=tuple(value.value)) if isinstance(value.value, list) else value


def _events(path: Path, text: str) -> Iterator[yaml.Event]:
    """Yield the events of a file, as far as it is harmless."""
    depth = 0
    try:
        for count, event in enumerate(events_of(path, text, OF_PARAMETERS)):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:
                raise refusal(path, TOO_DEEP, line_of(event))
            if count > OF_PARAMETERS.nodes:
                rule = f"more than {OF_PARAMETERS.nodes} keys and values"
                raise refusal(path, rule, line_of(event))
            yield event
    except yaml.YAMLError as error:
        rule, at = fault_in(text, error)
        raise refusal(path, rule, at[0] if at else None) from None
