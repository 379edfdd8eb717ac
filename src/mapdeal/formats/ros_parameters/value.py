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
    """A parameter in a file.

    Parameters
    ----------
    value : bool, int, float, str or tuple; of ROS 2 also bytes and None; of ROS 1 also None, \
list and dict
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
    ignored : ParameterValue, optional
        A value of another type that is written later, and that ROS 2 ignores all the same.
    """

    value: Any
    kind: str
    source: Path
    line: int
    text: str
    ignored: ParameterValue | None = None
