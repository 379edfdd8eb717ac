"""Problems in a robot's parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from mapdeal.records import dataclass

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
