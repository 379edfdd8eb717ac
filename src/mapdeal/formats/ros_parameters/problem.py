"""Problems in a robot's parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from mapdeal.records import dataclass

Level = Literal["refused", "warning", "note"]


@dataclass(frozen=True)
class Problem:
    """A fault in a robot's parameters, or a trap.

    Parameters
    ----------
    check : str
        Name of the check of ``mapdeal lint`` that reports it, ``params.name``.
    level : {'refused', 'warning', 'note'}
        Whether the real node ends there; or whether every command says it, or `lint` alone.
    text : str
        What it is, in one line, without the place.
    parameter : str
        The parameter, as ROS names it below its node; empty if it is about the whole.
    source : Path, optional
        The file that it stands in.
    line : int, optional
        The line there, from 1.
    got : str, optional
        The value that was found.
    hint : str, optional
        What to do about it, one line.
    """

    check: str
    level: Level
    text: str
    parameter: str = ""
    source: Path | None = None
    line: int | None = None
    got: str | None = None
    hint: str | None = None
