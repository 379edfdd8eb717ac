"""A map that a JSON document names, with the checksums of its files."""

from __future__ import annotations

from collections.abc import Mapping

from mapdeal.formats.json_values import JsonValue
from mapdeal.records import dataclass


@dataclass(frozen=True)
class NamedMap:
    """A map that a document is about.

    Parameters
    ----------
    file : str
        Its name, relative to the working directory of then.
    sha256 : mapping of str to str
        The names of the files that it was read from, without folders, and their checksums.
    """

    file: str
    sha256: Mapping[str, str]


def named_map(one: JsonValue) -> NamedMap | None:
    """Return a map and its files; None of one that was no file."""
    if one.is_null:
        return None
    sums = {name: digest.sha256() for name, digest in one["sha256"].fields().items()}
    return NamedMap(one["file"].text(), sums)
