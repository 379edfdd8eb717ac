"""A YAML mapping as its nodes: scalars stay text, keys keep their lines.

PyYAML turns scalars into values by YAML 1.1, where ``5e-2`` is text, ``1:30`` is ninety and
``010`` is eight; ROS reads the text. So does this.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from mapdeal.errors import MalformedInputError
from mapdeal.formats.plain_yaml import compose_plain
from mapdeal.formats.source import read_file
from mapdeal.records import dataclass

_DEEPEST = 20
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
_PLAIN_KINDS = ("str", "int", "float", "bool", "null", "timestamp", "seq", "map", "merge")
_PLAIN_TAGS = {f"tag:yaml.org,2002:{kind}" for kind in _PLAIN_KINDS}


_NUMBER_TAGS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_NULL, _MERGE = "tag:yaml.org,2002:null", "tag:yaml.org,2002:merge"


@dataclass(frozen=True)
class YamlLimits:
    """Limits of a file: PyYAML takes 70 microseconds and a kilobyte for each value."""

    bytes: int
    nodes: int
    aliases: int = 0


OF_MAPS = YamlLimits(bytes=1 << 16, nodes=1000)
OF_RECIPES = YamlLimits(bytes=1 << 18, nodes=10_000, aliases=16)
OF_SHAPES = YamlLimits(bytes=1 << 20, nodes=100_000, aliases=16)


@dataclass(frozen=True)
class Entry:
    """The value of one key: its YAML node, and where it stands."""

    source: Path
    key: str
    node: yaml.Node
    key_line: int | None = None

    @property
    def place(self) -> str:
        """Key and line, as an error names them."""
        return f"{self.key} (line {self.node.start_mark.line + 1})"

    def error(self, rule: str, *, hint: str | None = None) -> MalformedInputError:
        """Return an error about this entry that shows its text."""
        start, end = self.node.start_mark, self.node.end_mark
        text = (start.buffer or "")[start.pointer : end.pointer].rstrip("\0").strip()
        return MalformedInputError(rule, source=self.source, place=self.place, got=text, hint=hint)

    def text(self) -> str:
        """Return the text of a scalar, as it is written."""
        if not isinstance(self.node, yaml.ScalarNode):
            raise self.error("must be a single value")
        return str(self.node.value)

    def number(self) -> float:
        """Return a scalar as a number, by ROS's reading of it."""
        text = self.text().strip()
        if not _NUMBER.fullmatch(text):
            raise self.error("must be a number", hint=_number_hint(text))
        if re.match(r"[-+]?0\d", text):
            hint = "YAML readers disagree on it (octal or decimal)"
            raise self.error("must be a number without leading zeros", hint=hint)
        return float(text)

    def items(self) -> list[Entry]:
        """Return the elements of a list."""
        if not isinstance(self.node, yaml.SequenceNode):
            raise self.error("must be a list")
        return [Entry(self.source, self.key, node) for node in self.node.value]

    def fields(self) -> dict[str, Entry]:
        """Return the entries of a mapping by key."""
        if not isinstance(self.node, yaml.MappingNode):
            raise self.error("must be a mapping of keys")
        return _entries_of(self.source, self.node)

    @property
    def line(self) -> int:
        """The line of the key, from 1 on; of an item of a list its own."""
        return self.key_line or int(self.node.start_mark.line) + 1

    def is_nothing(self) -> bool:
        """Return whether nothing stands there, or YAML's word for that."""
        return bool(self.node.tag == _NULL)

    def merged_fields(self) -> dict[str, Entry]:
        """Return the entries of a mapping by key, with those of the mappings that ``<<`` names."""
        if isinstance(self.node, yaml.MappingNode) and any(
            key.tag == _MERGE for key, _ in self.node.value
        ):
            own = [pair for pair in self.node.value if pair[0].tag != _MERGE]
            _entries_of(self.source, yaml.MappingNode(self.node.tag, own))  # none appears twice
            merged = yaml.MappingNode(self.node.tag, list(self.node.value))
            try:
                yaml.SafeLoader("").flatten_mapping(merged)
            except yaml.YAMLError as error:
                raise self.error(f"cannot be read ({one_line_of(error)})") from None
            # what is merged comes first, and gives way
            return {
                str(key.value): Entry(self.source, str(key.value), value, key.start_mark.line + 1)
                for key, value in merged.value
            }
        return self.fields()

    def plain_value(self) -> Any:
        """Return the value, in which all numbers are decimal ones.

        YAML 1.1 reads ``010`` as 8, ``1:30`` as 90 and ``1_0`` as 10; other readers do not. A key
        that appears twice is refused.
        """
        _refuse_repeated_keys(self.source, self.node)
        for node in _scalars_of(self.node):
            text = str(node.value).lower()
            if node.tag not in _NUMBER_TAGS or text.lstrip("+-") in (".inf", ".nan"):
                continue
            if not _NUMBER.fullmatch(text) or re.match(r"[-+]?0\d", text):
                hint = "YAML readers disagree on it; write digits, a point and an e alone"
                raise Entry(self.source, self.key, node).error(
                    "must be a decimal number", hint=hint
                )
        return self.value()

    def value(self) -> Any:
        """Return the value that PyYAML's safe loader makes of the node."""
        try:
            return yaml.SafeLoader("").construct_document(self.node)
        # PyYAML's constructors fail on tags that do not fit in whatever way they fail.
        except (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError,
                OverflowError) as error:  # fmt: skip
            raise self.error(f"cannot be read ({one_line_of(error)})") from None

    def printable_value(self) -> Any:
        """Return the value, if it can be written again."""
        value = self.value()
        try:
            yaml.safe_dump(value)
        except ValueError as error:  # a whole number of many thousand digits
            raise self.error(f"cannot be kept ({one_line_of(error)})") from None
        return value

    @property
    def is_yaml_1_1_text(self) -> bool:
        """Whether PyYAML would take the scalar for text although ROS reads a number."""
        return bool(self.node.tag == "tag:yaml.org,2002:str") and not getattr(
            self.node, "style", None
        )


def read_mapping(path: Path, limits: YamlLimits = OF_MAPS) -> dict[str, Entry]:
    """Return the entries of the mapping that a YAML file holds, by key."""
    data = read_file(path, limit=limits.bytes, inspect=lambda head: refuse_image(path, head))
    return parse_mapping(path, data, limits)


def parse_mapping(path: Path, data: bytes, limits: YamlLimits = OF_MAPS) -> dict[str, Entry]:
    """Return the entries of the mapping that the contents of a YAML file hold, by key."""
    text = decoded_text(path, data)
    node = _compose(path, text, limits)
    if node is None:
        raise MalformedInputError("no mapping in file", source=path)
    if not isinstance(node, yaml.MappingNode):
        kind = "list" if isinstance(node, yaml.SequenceNode) else "single value"
        raise MalformedInputError(f"must be a mapping of keys, is a {kind}", source=path)
    return _entries_of(path, node)


def parse_value(text: str, name: str, limits: YamlLimits = OF_MAPS) -> Any:
    """Return the value of a text that is no file, with decimal numbers; errors call it `name`."""
    node = _compose(Path(name), text, limits)
    return None if node is None else Entry(Path(name), "value", node).plain_value()


def _entries_of(path: Path, node: yaml.MappingNode) -> dict[str, Entry]:
    """Return the entries of a mapping by key; a key that appears twice is refused."""
    entries: dict[str, Entry] = {}
    for key_node, value_node in node.value:
        if not isinstance(key_node, yaml.ScalarNode):
            place = f"line {key_node.start_mark.line + 1}"
            raise MalformedInputError("a key must be a single word", source=path, place=place)
        key = str(key_node.value)
        if key in entries:
            line = key_node.start_mark.line + 1
            rule = f"key appears twice, on lines {entries[key].line} and {line}"
            raise MalformedInputError(rule, source=path, place=key)
        entries[key] = Entry(path, key, value_node, key_node.start_mark.line + 1)
    return entries


def _refuse_repeated_keys(path: Path, node: yaml.Node) -> None:
    if isinstance(node, yaml.MappingNode):
        for entry in _entries_of(path, node).values():
            _refuse_repeated_keys(path, entry.node)
    elif isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _refuse_repeated_keys(path, item)


def _scalars_of(node: yaml.Node) -> Iterator[yaml.ScalarNode]:
    """Yield the single values in a node, which is no deeper than the limits allow."""
    if isinstance(node, yaml.ScalarNode):
        yield node
    elif isinstance(node, yaml.SequenceNode):
        for item in node.value:
            yield from _scalars_of(item)
    elif isinstance(node, yaml.MappingNode):
        for _, value in node.value:
            yield from _scalars_of(value)


def one_line_of(error: Exception) -> str:
    """Return the message of a YAML error without its several lines of context."""
    problem = getattr(error, "problem", None) or str(error)
    return str(problem).splitlines()[0]


def refuse_image(path: Path, data: bytes) -> None:
    """Raise MalformedInputError if data start as those of an image do."""
    if re.match(rb"P[1-7fF]\s", data) or data.startswith((b"\x89PNG", b"BM", b"II*\0", b"MM\0*")):
        kind = f"a {data[:2].decode()} image" if data[:1] == b"P" else "an image"
        raise MalformedInputError(f"looks like {kind}", source=path, hint="pass the .yaml")


def decoded_text(path: Path, data: bytes) -> str:
    """Return what is written in a YAML file."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MalformedInputError("not UTF-8", source=path, place=f"byte {error.start}") from None
    if "\0" in text:
        place = f"byte {text.index(chr(0))}"
        raise MalformedInputError("not UTF-8 text: it holds a NUL byte", source=path, place=place)
    return text


def compose_documents(
    path: Path, data: bytes, limits: YamlLimits, tags: frozenset[str] = frozenset()
) -> list[yaml.Node]:
    """Return the nodes of all documents in the contents of a YAML file."""
    text = decoded_text(path, data)
    with _as_malformed(path):
        composer = _Composer(text, path, limits, tags)
        documents: list[yaml.Node] = []
        while composer.check_node():
            node = composer.get_node()
            documents += [] if node is None else [node]
        return documents


def _compose(path: Path, text: str, limits: YamlLimits) -> yaml.Node | None:
    """Return the tree of nodes, as far as it is harmless."""
    plain = compose_plain(text, limits.nodes)
    if plain is not None:
        return plain
    with _as_malformed(path):
        return _Composer(text, path, limits).get_single_node()


@contextmanager
def _as_malformed(path: Path) -> Iterator[None]:
    try:
        yield
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}" if mark else None
        rule = f"not valid YAML: {one_line_of(error)}"
        raise MalformedInputError(rule, source=path, place=where) from None


class _Composer(yaml.SafeLoader):
    """PyYAML's composer, which looks at each node before it is made."""

    def __init__(
        self, text: str, path: Path, limits: YamlLimits, tags: frozenset[str] = frozenset()
    ) -> None:
        super().__init__(text)
        self._tags = _PLAIN_TAGS | tags
        self._path = path
        self._limits = limits
        self._depth = self._nodes = self._aliases = 0
        self._nodes_of: dict[str, int] = {}  # by anchor

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Return the next node and all below it."""
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent):
            self._count_alias(event)
            return super().compose_node(parent, index)
        before = self._nodes
        self._count(1, event)
        tag = getattr(event, "tag", None)
        if tag not in (None, "!") and tag not in self._tags:
            raise self._error("tag not allowed", event, got=tag)
        is_nested = isinstance(event, (yaml.SequenceStartEvent, yaml.MappingStartEvent))
        self._depth += is_nested
        if self._depth > _DEEPEST:
            raise self._too_deep(event.start_mark)
        node = super().compose_node(parent, index)
        self._depth -= is_nested
        if event.anchor is not None:
            self._nodes_of[event.anchor] = self._nodes - before
        return node

    def fetch_flow_collection_start(self, kind: Any) -> None:
        """Scan a bracket; the scanner is many brackets ahead of the composer."""
        if self.flow_level >= _DEEPEST:
            raise self._too_deep(self.get_mark())
        super().fetch_flow_collection_start(kind)

    def _too_deep(self, mark: yaml.Mark) -> MalformedInputError:
        rule = f"nested deeper than {_DEEPEST} levels"
        return MalformedInputError(rule, source=self._path, place=f"line {mark.line + 1}")

    def _count_alias(self, event: yaml.AliasEvent) -> None:
        anchor = event.anchor or ""
        self._aliases += 1
        if self._aliases > self._limits.aliases:
            most = self._limits.aliases
            rule = f"more than {most} aliases" if most else "aliases are not allowed"
            raise self._error(rule, event, got=f"*{anchor}")
        # one that is not known yet is refused by PyYAML, or stands within what it stands for
        if anchor in self.anchors and anchor not in self._nodes_of:
            raise self._error("an alias within its own anchor", event, got=f"*{anchor}")
        self._count(self._nodes_of.get(anchor, 0), event)

    def _count(self, nodes: int, event: yaml.Event) -> None:
        self._nodes += nodes
        if self._nodes > self._limits.nodes:
            rule = f"more than {self._limits.nodes} keys and values"
            raise self._error(rule, event)

    def _error(self, rule: str, event: yaml.Event, **got: object) -> MalformedInputError:
        return MalformedInputError(rule, source=self._path, place=_line(event), **got)  # type: ignore[arg-type]


def _line(event: yaml.Event) -> str:
    return f"line {event.start_mark.line + 1}" if event.start_mark else "the file"


def _number_hint(text: str) -> str | None:
    if re.fullmatch(r"[-+]?\d+,\d+", text):
        return "write the decimal point as '.'"
    if text.lower().lstrip("+-.") in ("inf", "infinity"):
        return "it must be finite"
    if re.match(r"[-+]?[\d.]+\s*[a-zA-Z]", text):
        return "write the bare number, without a unit or suffix"
    if text.lower().lstrip("+-.") == "nan":
        return "a fault of some map savers; write 0"
    return None


def edited(entries: Mapping[str, Entry], changes: Mapping[str, Any]) -> bytes:
    """Return the file that entries were read from with other values, all else as it is.

    Notes
    -----
    The result is what it is meant to be only if the mapping is written in lines, as that of a map
    is; whoever calls this reads it again.
    """
    first = next(iter(entries.values()))
    text = (first.node.start_mark.buffer or "").rstrip("\0")
    spans: list[tuple[int, int, str]] = []
    for key in changes.keys() & entries.keys():
        entry, value = entries[key], changes[key]
        parts, values = [entry], [value]
        if isinstance(value, (list, tuple)):
            parts, values = entry.items(), list(value)
            if len(parts) != len(values):
                raise entry.error(f"must be a list of {len(values)}")
        spans += [_span(part, one) for part, one in zip(parts, values, strict=True)]
    for start, end, new in sorted(spans, reverse=True):
        text = f"{text[:start]}{new}{text[end:]}"
    newline = "\r\n" if "\r\n" in text else "\n"
    missing = [f"{key}: {_flow_text(changes[key])}" for key in changes if key not in entries]
    if missing and not text.endswith("\n"):
        text += newline
    return (text + "".join(f"{line}{newline}" for line in missing)).encode()


def _span(entry: Entry, value: Any) -> tuple[int, int, str]:
    """Return where the text of a value stands, and what takes its place."""
    start, end = entry.node.start_mark, entry.node.end_mark
    old = (start.buffer or "")[start.pointer : end.pointer]
    return start.pointer, end.pointer - (len(old) - len(old.rstrip())), _flow_text(value)


def _flow_text(value: Any) -> str:
    """Return a value as it is written behind its key."""
    text = yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, width=1 << 20)
    return text.removesuffix("\n").removesuffix("\n...")


_FEW, _SHORT = 8, 100
_PLAIN_KEY = re.compile(r"[a-z_]{3,}")
_PLAIN_TEXT = re.compile(r"[a-z_]{3,}|[A-Za-z_][A-Za-z0-9_-]*\.[a-z]{3,4}")
_NOT_PLAIN = {"yes", "true", "off", "false", "null", "inf", "nan"}
"""Words that YAML, or a reader of it, takes for something else than text."""


def yaml_document(document: dict[str, Any]) -> bytes:
    """Return a YAML file of `document`: keys in order, lists in brackets, floats shortest.

    PyYAML takes a millisecond for the few lines beside an image, so those are written here, the
    same to the byte.
    """
    lines = [_plain_line(key, value) for key, value in document.items()]
    has_list = any(type(value) is list for value in document.values())  # else it is one line
    if has_list and None not in lines:
        return "".join(f"{line}\n" for line in lines).encode()
    text = yaml.safe_dump(
        document, sort_keys=False, default_flow_style=None, allow_unicode=True, width=1000
    )
    return text.encode()


def _plain_line(key: Any, value: Any) -> str | None:
    """Return an entry as PyYAML writes it, None if that may need more than its words."""
    if not isinstance(key, str) or not _PLAIN_KEY.fullmatch(key) or key in _NOT_PLAIN:
        return None
    text: str | None
    if type(value) is list and 0 < len(value) <= _FEW:
        numbers = [_plain_number(one) for one in value]
        text = None if None in numbers else f"[{', '.join(map(str, numbers))}]"
    elif type(value) is str:
        is_plain = _PLAIN_TEXT.fullmatch(value) and value not in _NOT_PLAIN and len(value) < _SHORT
        text = value if is_plain else None
    else:
        text = _plain_number(value)
    return None if text is None else f"{key}: {text}"


def _plain_number(value: Any) -> str | None:
    if type(value) is int:
        return str(value)
    if type(value) is not float or not math.isfinite(value):
        return None
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
