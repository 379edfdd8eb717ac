"""Comments of a map's YAML file that speak to mapdeal."""

from __future__ import annotations

import re
from pathlib import Path

from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.formats.source import read_file
from mapdeal.formats.yaml_text import OF_MAPS
from mapdeal.records import dataclass

_IGNORE = re.compile(r"(?:^|(?<=\s))#[ \t]{0,9}mapdeal:[ \t]{0,9}ignore(?![\w-]):?")
_NAME = re.compile(r"[ \t]*([\w.-]+)[ \t]*(,?)")


@dataclass(frozen=True)
class IgnoreComment:
    """A comment ``# mapdeal: ignore ID[, ID]``."""

    line: int
    names: tuple[str, ...]


def read_ignore_comments(path: Path, limit: int = OF_MAPS.bytes) -> list[IgnoreComment]:
    """Return the comments of a file that name checks of lint which are to be ignored.

    Notes
    -----
    A comment is recognised by its text: at the beginning of a line or behind white space. So it
    counts in a file, too, that is no YAML.
    """
    try:
        data = read_file(path, limit=limit)
    except (FileAccessError, MalformedInputError):
        return []
    lines = data.decode("utf-8-sig", "replace").splitlines()
    found = ((number, line, _IGNORE.search(line)) for number, line in enumerate(lines, start=1))
    return [
        IgnoreComment(number, _names_in(line, match.end()))
        for number, line, match in found
        if match
    ]


def _names_in(line: str, position: int) -> tuple[str, ...]:
    """Return names with commas between them."""
    names = []
    while match := _NAME.match(line, position):
        names.append(match[1])
        if not match[2]:
            break
        position = match.end()
    return tuple(names)
