"""A YAML mapping as its nodes: scalars stay text, keys keep their lines.

PyYAML turns scalars into values by YAML 1.1, where ``5e-2`` is text, ``1:30`` is ninety and
``010`` is eight. ROS reads the text of scalars, and so does this module. The events come from
libyaml, which is part of PyYAML's wheels; its replacement, PyYAML's own parser, refuses some tabs.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import yaml

from mapdeal.errors import MalformedInputError
from mapdeal.files.source import read_file
from mapdeal.records import dataclass

N = TypeVar("N", bound=yaml.Node)
_DEEPEST = 20
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
_PLAIN_KINDS = ("str", "int", "float", "bool", "null", "timestamp", "seq", "map", "merge")
_PLAIN_TAGS = frozenset(f"tag:yaml.org,2002:{kind}" for kind in _PLAIN_KINDS)
_NUMBER_TAGS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_NULL, _MERGE = "tag:yaml.org,2002:null", "tag:yaml.org,2002:merge"
_BREAKS = "\r\n\x85\u2028\u2029"


@dataclass(frozen=True)
class YamlLimits:
    """Limits of a file; each value takes a kilobyte of memory."""

    bytes: int
    nodes: int
    aliases: int = 0


OF_MAPS = YamlLimits(bytes=1 << 16, nodes=1000)
OF_RECIPES = YamlLimits(bytes=1 << 18, nodes=10_000, aliases=16)
OF_SHAPES = YamlLimits(bytes=1 << 20, nodes=100_000, aliases=16)


@dataclass(frozen=True)
class Entry:
    """The value of one key: its YAML node, and its place in the file."""

    source: Path
    key: str
    node: yaml.Node
    key_line: int | None = None

    @property
    def place(self) -> str:
        return f"{self.key} (line {self.node.start_mark.line + 1})"

    def error(self, rule: str, *, hint: str | None = None) -> MalformedInputError:
        got = source_text(self.node)
        return MalformedInputError(rule, source=self.source, place=self.place, got=got, hint=hint)

    def _node_of(self, kind: type[N], noun: str) -> N:
        if not isinstance(self.node, kind):
            raise self.error(f"must be {noun}")
        return self.node

    def text(self) -> str:
        return str(self._node_of(yaml.ScalarNode, "a single value").value)

    def number(self) -> float:
        text = self.text().strip()
        if not _NUMBER.fullmatch(text):
            raise self.error("must be a number", hint=_number_hint(text, self.key))
        if re.match(r"[-+]?0\d", text):
            hint = "YAML readers disagree on it (octal or decimal)"
            raise self.error("must be a number without leading zeros", hint=hint)
        return float(text)

    def items(self) -> list[Entry]:
        nodes = self._node_of(yaml.SequenceNode, "a list").value
        return [Entry(self.source, self.key, node) for node in nodes]

    def fields(self) -> dict[str, Entry]:
        return _entries_of(self.source, self._node_of(yaml.MappingNode, "a mapping of keys"))

    @property
    def line(self) -> int:
        return self.key_line or int(self.node.start_mark.line) + 1

    def is_nothing(self) -> bool:
        return bool(self.node.tag == _NULL)

    def merged_fields(self) -> dict[str, Entry]:
        """Return the entries of a mapping by key, with those of the mappings that ``<<`` names."""
        node = self._node_of(yaml.MappingNode, "a mapping of keys")
        own = [pair for pair in node.value if pair[0].tag != _MERGE]
        _entries_of(self.source, yaml.MappingNode(node.tag, own))  # refuses duplicate keys
        # merged keys come first, so the mapping's own keys replace them
        return {
            str(key.value): Entry(self.source, str(key.value), value, key.start_mark.line + 1)
            for key, value in flattened(self.source, node)
        }

    def plain_value(self) -> Any:
        # YAML 1.1 reads ``010`` as 8, ``1:30`` as 90 and ``1_0`` as 10, and other readers do not,
        # so such numbers are refused. `_scalars_of` refuses duplicate keys.
        for node in list(_scalars_of(self.source, self.node)):
            text = str(node.value).lower()
            is_plain = _NUMBER.fullmatch(text) and not re.match(r"[-+]?0\d", text)
            is_special = text.lstrip("+-") in (".inf", ".nan")
            if node.tag in _NUMBER_TAGS and not (is_plain or is_special):
                hint = "YAML readers disagree on it; write digits, a point and an e alone"
                number = Entry(self.source, self.key, node)
                raise number.error("must be a decimal number", hint=hint)
        return self.value()

    def value(self) -> Any:
        try:
            return yaml.SafeLoader("").construct_document(self.node)
        # PyYAML's constructors raise any of these on tags that do not fit their values.
        except (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError,
                OverflowError) as error:  # fmt: skip
            raise self.error(f"cannot be read ({one_line_of(error)})") from None

    def printable_value(self) -> Any:
        value = self.value()
        try:
            yaml.safe_dump(value)
        except ValueError as error:  # a whole number of many thousand digits
            raise self.error(f"cannot be kept ({one_line_of(error)})") from None
        return value

    @property
    def is_yaml_1_1_text(self) -> bool:
        """Whether YAML 1.1, and so PyYAML, reads the scalar without quotes as text."""
        is_quoted = getattr(self.node, "style", None)
        return bool(self.node.tag == "tag:yaml.org,2002:str" and not is_quoted)


def flattened(path: Path, node: yaml.MappingNode) -> list[tuple[yaml.Node, yaml.Node]]:
    """Return the pairs of a mapping after those of the mappings that ``<<`` names."""
    merged = yaml.MappingNode(node.tag, list(node.value), node.start_mark, node.end_mark)
    try:
        yaml.SafeLoader("").flatten_mapping(merged)
    except yaml.YAMLError:
        place = f"line {node.start_mark.line + 1}"
        raise MalformedInputError("<< must name mappings", source=path, place=place) from None
    return list(merged.value)


def read_mapping(path: Path, limits: YamlLimits = OF_MAPS) -> dict[str, Entry]:
    data = read_file(path, limit=limits.bytes, inspect=lambda head: refuse_image(path, head))
    return parse_mapping(path, data, limits)


def parse_mapping(path: Path, data: bytes, limits: YamlLimits = OF_MAPS) -> dict[str, Entry]:
    if (node := _compose(path, decoded_text(path, data), limits)) is None:
        raise MalformedInputError("no mapping in file", source=path)
    if not isinstance(node, yaml.MappingNode):
        kind = "list" if isinstance(node, yaml.SequenceNode) else "single value"
        raise MalformedInputError(f"must be a mapping of keys, is a {kind}", source=path)
    return _entries_of(path, node)


def parse_value(text: str, name: str) -> Any:
    """Return the value of a YAML text with decimal numbers; errors refer to it as `name`."""
    node = _compose(Path(name), text, OF_MAPS)
    return None if node is None else Entry(Path(name), "value", node).plain_value()


def _entries_of(path: Path, node: yaml.MappingNode) -> dict[str, Entry]:
    entries: dict[str, Entry] = {}
    for key_node, value_node in node.value:
        if not isinstance(key_node, yaml.ScalarNode):
            place = f"line {key_node.start_mark.line + 1}"
            raise MalformedInputError("a key must be a single word", source=path, place=place)
        if (key := str(key_node.value)) in entries:
            line = key_node.start_mark.line + 1
            rule = f"key appears twice, on lines {entries[key].line} and {line}"
            raise MalformedInputError(rule, source=path, place=key)
        entries[key] = Entry(path, key, value_node, key_node.start_mark.line + 1)
    return entries


def _scalars_of(path: Path, node: yaml.Node) -> Iterator[yaml.ScalarNode]:
    if isinstance(node, yaml.ScalarNode):
        yield node
        return
    children = node.value
    if isinstance(node, yaml.MappingNode):
        children = [entry.node for entry in _entries_of(path, node).values()]
    for child in children:
        yield from _scalars_of(path, child)


def source_text(first: Any, last: Any = None, most: int = 1 << 62) -> str:
    start, end = first.start_mark.index, (last or first).end_mark.index
    return str(first.start_mark.buffer)[start : min(end, start + most)].strip()


def one_line_of(error: Exception) -> str:
    return str(getattr(error, "problem", None) or error).splitlines()[0]


def refuse_image(path: Path, data: bytes) -> None:
    if re.match(rb"P[1-7fF]\s", data) or data.startswith((b"\x89PNG", b"BM", b"II*\0", b"MM\0*")):
        kind = f"a {data[:2].decode()} image" if data[:1] == b"P" else "an image"
        raise MalformedInputError(f"looks like {kind}", source=path, hint="pass the .yaml")


def decoded_text(path: Path, data: bytes) -> str:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MalformedInputError("not UTF-8", source=path, place=f"byte {error.start}") from None
    if "\0" in text:
        place = f"byte {text.index(chr(0))}"
        raise MalformedInputError("not UTF-8 text: it holds a NUL byte", source=path, place=place)
    return text


def compose_documents(path: Path, data: bytes, limits: YamlLimits) -> list[yaml.Node]:
    text = decoded_text(path, data)
    with _as_malformed(path, text):
        composer, documents = _PYYAML(text).read(path, text, limits), []
        while composer.check_node():
            documents.append(composer.get_node())
        return documents


def _compose(path: Path, text: str, limits: YamlLimits) -> yaml.Node | None:
    with _as_malformed(path, text):
        node: yaml.Node | None = _LIBYAML(text).read(path, text, limits).get_single_node()
        return node


def events_of(path: Path, text: str, limits: YamlLimits) -> Iterator[yaml.Event]:
    loader = _LIBYAML(text).read(path, text, limits)
    while loader.check_event():
        yield loader.get_event()


@contextmanager
def _as_malformed(path: Path, text: str) -> Iterator[None]:
    try:
        yield
    except (yaml.YAMLError, UnicodeEncodeError) as error:
        rule, position = fault_in(text, error)
        place = f"line {position[0]}, column {position[1]}" if position else None
        raise MalformedInputError(rule, source=path, place=place) from None


def fault_in(text: str, error: Exception) -> tuple[str, tuple[int, int] | None]:
    rule = f"not valid YAML: {one_line_of(error)}"
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    if mark is None:
        return rule, None
    odd = text[mark.index : mark.index + 1]
    rule = rule.replace("character that cannot", f"character {odd!r} that cannot")
    if not (odd or mark.column) and text and text[-1] not in _BREAKS:
        return rule, (mark.line, len(text.splitlines()[-1]) + 1)  # libyaml adds a line break
    return rule, (mark.line + 1, mark.column + 1)


class _Composer(yaml.composer.Composer):
    """PyYAML's composer with limits, which it checks at each event."""

    def read(self, path: Path, text: str, limits: YamlLimits) -> Any:
        """Set the file and the limits; loaders are created with only the text."""
        self._path, self._text, self._limits = path, text, limits
        self._depth = self._nodes = self._aliases = 0
        return self

    def get_event(self) -> Any:
        """Return the next event; its marks refer to the text."""
        event: Any = super().get_event()  # type: ignore[misc]
        event.start_mark, event.end_mark = (
            yaml.Mark("", mark.index, mark.line, mark.column, self._text, mark.index)
            for mark in (event.start_mark, event.end_mark)
        )
        return event

    def compose_document(self) -> yaml.Node | None:
        self.anchors: dict[Any, yaml.Node] = {}
        self._nodes_of: dict[str | None, int] = {}
        return super().compose_document()

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[attr-defined]
        if isinstance(event, yaml.AliasEvent):
            self._count_alias(event)
            return super().compose_node(parent, index)
        before = self._nodes
        self._count(1, event)
        if event.tag not in (None, "!") and event.tag not in _PLAIN_TAGS:
            raise self._error("tag not allowed", event, got=event.tag)
        is_nested = isinstance(event, yaml.CollectionStartEvent)
        self._depth += is_nested
        if self._depth > _DEEPEST:
            raise self._error(f"nested deeper than {_DEEPEST} levels", event)
        node = super().compose_node(parent, index)
        if isinstance(node, yaml.ScalarNode):
            node.value = sys.intern(node.value)  # PyYAML 6.0.4 compares keys of << by identity
        self._depth -= is_nested
        self._nodes_of[event.anchor] = self._nodes - before
        return node

    def _count_alias(self, event: Any) -> None:
        self._aliases += 1
        if self._aliases > self._limits.aliases:
            most = self._limits.aliases
            rule = f"more than {most} aliases" if most else "aliases are not allowed"
            raise self._error(rule, event, got=f"*{event.anchor}")
        # an anchor whose node is unfinished contains the alias; PyYAML refuses unknown anchors
        if event.anchor in self.anchors and event.anchor not in self._nodes_of:
            raise self._error("an alias within its own anchor", event, got=f"*{event.anchor}")
        self._count(self._nodes_of.get(event.anchor, 0), event)

    def _count(self, nodes: int, event: Any) -> None:
        self._nodes += nodes
        if self._nodes > self._limits.nodes:
            raise self._error(f"more than {self._limits.nodes} keys and values", event)

    def _error(self, rule: str, event: Any, **got: str) -> MalformedInputError:
        place = f"line {event.start_mark.line + 1}"
        return MalformedInputError(rule, source=self._path, place=place, **got)


def _composer_over(loader: Any) -> Any:
    return type("_Over", (_Composer, loader), {"__init__": loader.__init__})


_PYYAML = _composer_over(yaml.SafeLoader)
_LIBYAML = _composer_over(getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def _number_hint(text: str, key: str) -> str | None:
    if re.fullmatch(r"[-+]?\d+,\d+", text):
        return "write the decimal point as '.'"
    word = text.lower().lstrip("+-.")
    if word == "nan" and key == "origin":
        return "a fault of some map savers; write 0"
    if word in ("inf", "infinity", "nan"):
        return "it must be finite"
    if re.match(r"[-+]?[\d.]+\s*[a-zA-Z]", text):
        return "write the bare number, without a unit or suffix"
    return None


def with_values(entries: Mapping[str, Entry], changes: Mapping[str, Any]) -> bytes:
    """Return the contents of the file of `entries` with changed values, otherwise as they are."""
    # This is correct only for one key per line, as in map files; so callers read the result again.
    text = next(iter(entries.values())).node.start_mark.buffer or ""
    replacements: dict[int, tuple[int, str]] = {}
    for key in changes.keys() & entries.keys():
        entry, value = entries[key], changes[key]
        is_list = isinstance(value, list | tuple)
        parts, values = (entry.items(), value) if is_list else ([entry], [value])
        if len(parts) != len(values):
            raise entry.error(f"must be a list of {len(values)}")
        for part, new_value in zip(parts, values, strict=True):
            start = part.node.start_mark.index
            replacements[start] = start + len(source_text(part.node)), _flow_text(new_value)
    for start, (end, new) in sorted(replacements.items(), reverse=True):
        text = f"{text[:start]}{new}{text[end:]}"
    newline = "\r\n" if "\r\n" in text else "\n"
    missing = [f"{key}: {_flow_text(changes[key])}" for key in changes if key not in entries]
    if missing and not text.endswith("\n"):
        text += newline
    return (text + "".join(f"{line}{newline}" for line in missing)).encode()


def _flow_text(value: Any) -> str:
    text = yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, width=1 << 20)
    return text.removesuffix("\n").removesuffix("\n...")


def yaml_document(document: dict[str, Any]) -> bytes:
    """Return `document` as YAML: keys in order, lists in brackets, floats in shortest form."""
    text = yaml.safe_dump(
        document, sort_keys=False, default_flow_style=None, allow_unicode=True, width=1000
    )
    return text.encode()
