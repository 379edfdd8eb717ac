"""Where the page of a run goes, and whether it may: known before anything is made."""

from __future__ import annotations

from pathlib import Path

from mapdeal.errors import FileAccessError
from mapdeal.formats.source import exists, head_of

REPORT = "report.html"
"""The page of a run, in the folder that was named for its outputs."""

_GENERATOR = b'<meta name="generator" content="mapdeal'
_HEAD = 1 << 12


def check_replaceable(page: Path) -> None:
    """Refuse to replace what is in the place of a page, unless mapdeal has made it."""
    if exists(page) and _GENERATOR not in head_of(page, _HEAD):
        rule = "exists, and is not a page written by mapdeal"
        raise FileAccessError(rule, source=page, hint="move it: --report writes there")
