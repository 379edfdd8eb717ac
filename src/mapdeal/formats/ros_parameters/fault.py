"""What is wrong with a file of parameters before anyone asks what its values mean."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True)
class Fault:
    """A fault of a file of parameters, found while it was read.

    Parameters
    ----------
    check : str
        Name of the check of ``mapdeal lint`` that reports it, ``params.name``.
    level : {'refused', 'warning', 'note'}
        Whether ROS refuses the file for it; or whether every command says it, or `lint` alone.
    text : str
        What it is, in one line, without the place.
    source : Path
        The file.
    line : int, optional
        The line, from 1.
    parameter : str
        The parameter, with the names it stands below; empty if it is about the whole file.
    got : str, optional
        The value that was found.
    hint : str, optional
        What to do about it, one line.
    """

    check: str
    level: Literal["refused", "warning", "note"]
    text: str
    source: Path
    line: int | None = None
    parameter: str = ""
    got: str | None = None
    hint: str | None = None
