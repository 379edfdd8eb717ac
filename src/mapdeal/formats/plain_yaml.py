"""The plainest YAML, composed at once: lines of a key and a word, or a list of numbers.

Nearly every YAML file of a map is like that, and PyYAML takes a millisecond for one, which is
longer than a small map takes for all the rest. What is not as plain is left to it, errors
included. The nodes, their tags and marks are those that it gives.
"""

from __future__ import annotations

import re

import yaml

_LINE = re.compile(
    r"(?P<key>[A-Za-z_][A-Za-z0-9_]{0,60}): {1,9}"
    r"(?:(?P<word>[A-Za-z0-9_./][A-Za-z0-9_./+-]{0,200}|[-+][0-9.][0-9.eE+-]{0,60})"
    r"|(?P<list>\[ {0,4}[-+0-9.][0-9.eE+-]{0,60}"
    r"(?: {0,4}, {0,4}[-+0-9.][0-9.eE+-]{0,60}){0,9} {0,4}\]))"
    r" *(?: #[ -~]*)?"
)
_NUMBER = re.compile(r"[-+0-9.][0-9.eE+-]{0,60}")
_COMMENT = re.compile(r" *(?:#[ -~]*)?")
_NAME = "<unicode string>"  # of what is no file, in PyYAML's marks
_MOST_LINES = 200


def compose_plain(text: str, most_nodes: int) -> yaml.MappingNode | None:
    """Return the mapping in a text; None if it may be anything but the plainest YAML."""
    lines = text.split("\n", _MOST_LINES)
    if len(lines) > _MOST_LINES:
        return None
    found = [_LINE.fullmatch(line) for line in lines]
    if not any(found) or not all(
        one or _COMMENT.fullmatch(line) for one, line in zip(found, lines, strict=True)
    ):
        return None
    lists = [one["list"] for one in found if one and one["list"]]
    count = 1 + 2 * sum(map(bool, found)) + sum(1 + one.count(",") for one in lists)
    if count > most_nodes:
        return None
    buffer, at = f"{text}\0", 0
    pairs: list[tuple[yaml.Node, yaml.Node]] = []

    def mark(line: int, column: int) -> yaml.Mark:
        return yaml.Mark(_NAME, at + column, line, column, buffer, at + column)

    def scalar(line: int, value: str, start: int, end: int) -> yaml.ScalarNode:
        return yaml.ScalarNode(_tag_of(value), value, mark(line, start), mark(line, end))

    for number, (line, one) in enumerate(zip(lines, found, strict=True)):
        if one:
            key = scalar(number, one["key"], *one.span("key"))
            value: yaml.Node
            if one["word"] is not None:
                value = scalar(number, one["word"], *one.span("word"))
            else:
                start, end = one.span("list")
                items: list[yaml.Node] = [
                    scalar(number, item[0], *item.span())
                    for item in _NUMBER.finditer(line, start + 1, end - 1)
                ]
                if any(item.value in ("-", "+") for item in items):  # a list within, or an error
                    return None
                value = yaml.SequenceNode(
                    "tag:yaml.org,2002:seq", items, mark(number, start), mark(number, end),
                    flow_style=True,
                )  # fmt: skip
            pairs.append((key, value))
        at += len(line) + 1
    at -= len(lines[-1]) + 1
    return yaml.MappingNode(
        "tag:yaml.org,2002:map", pairs, pairs[0][0].start_mark,
        mark(len(lines) - 1, len(lines[-1])), flow_style=False,
    )  # fmt: skip


def _tag_of(value: str) -> str:
    """Return what YAML 1.1 takes a plain scalar for."""
    resolvers = yaml.SafeLoader.yaml_implicit_resolvers
    for tag, pattern in (*resolvers.get(value[0], ()), *resolvers.get(None, ())):
        if pattern.match(value):
            return str(tag)
    return "tag:yaml.org,2002:str"
