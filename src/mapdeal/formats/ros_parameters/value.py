"""A parameter that was read: its value, its type in ROS's words, and where it stands."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class ParameterValue:
    """A parameter in a file.

    Parameters
    ----------
    value : bool, int, float, str or tuple; of ROS 1 also None, list and dict
        What it holds.
    kind : str
        Its type as the reader calls it: of ROS 2 ``bool``, ``integer``, ``double``, ``string``,
        ``bool_array`` and so on, or ``not set``.
    source : Path
        The file.
    line : int
        Where the value stands, from 1.
    text : str
        The value as it is written there, for messages.
    """

    value: Any
    kind: str
    source: Path
    line: int
    text: str
