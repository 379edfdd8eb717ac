"""A parameter that was read: its value, its type in ROS's words, and where it stands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mapdeal.errors import MalformedInputError
from mapdeal.records import dataclass


class ParameterFileError(MalformedInputError):
    """A file of parameters that its own parser refuses as a whole.

    Attributes
    ----------
    line : int or None
        Where it stops, from 1; the text of the error names it, too.
    found : str or None
        What stands there.
    """

    line: int | None = None
    found: str | None = None


@dataclass(frozen=True)
class ParameterValue:
    """A parameter in a file."""

    value: Any
    kind: str
    source: Path
    line: int
    text: str
    ignored: ParameterValue | None = None
