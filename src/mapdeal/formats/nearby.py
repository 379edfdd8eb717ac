"""Files that may be meant by the name of one that does not exist."""

from __future__ import annotations

from pathlib import Path

from mapdeal.errors import FileAccessError
from mapdeal.formats.source import contents_of

_ALIKE = 0.8
"""Names are alike from this ratio on: office1.yaml and office.yaml."""

_MAPS = (".yaml", ".yml", ".npz")
"""Endings of what a name without one may mean, the likeliest first."""


def file_meant(name: str) -> str | None:
    """Return a hint that asks for the file most like a name in its folder; None without any.

    A name without an ending means the map of that name.
    """
    import difflib  # of use to mistakes alone

    path = Path(name)
    try:
        names = [one for one in contents_of(path.parent)[1] if one != path.name]
    except FileAccessError:
        return None
    near = [path.name + ending for ending in _MAPS if path.name + ending in names]
    plain = {one.lower(): one for one in reversed(names)}
    near += [plain[one] for one in difflib.get_close_matches(path.name.lower(), plain, 1, _ALIKE)]
    return f"did you mean {path.with_name(near[0])}?" if near else None
