"""A map that a JSON document names, with the checksums of its files."""

from __future__ import annotations

from collections.abc import Mapping

from mapdeal.formats.json_values import JsonValue
from mapdeal.records import dataclass


@dataclass(frozen=True)
class NamedMap:
    """A map that a document is about."""

    file: str
    sha256: Mapping[str, str]


def named_map(one: JsonValue) -> NamedMap | None:
    """Return a map and its files; None of one that was no file."""
    if one.is_null:
        return None
    sums = {name: digest.sha256() for name, digest in one["sha256"].fields().items()}
    return NamedMap(one["file"].text(), sums)
