"""Values of parameters, and what is wrong with them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mapdeal.errors import MalformedInputError

Level = Literal["refused", "warning", "note"]


@dataclass(frozen=True)
class Problem:
    """A fault in a robot's parameters, or a trap."""

    check: str
    level: Level
    text: str
    parameter: str = ""
    source: Path | None = None
    line: int | None = None
    got: str | None = None
    hint: str | None = None


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
    value: Any
    kind: str
    source: Path
    line: int
    text: str
    ignored: ParameterValue | None = None
