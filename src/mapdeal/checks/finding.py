"""What checks find, and the list of all checks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

Severity = Literal["error", "warning", "note"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")


@dataclass(frozen=True)
class Finding:
    """Something that a check has found in a file.

    Parameters
    ----------
    check : str
        The check's name, ``area.name``.
    severity : {'error', 'warning', 'note'}
        An error makes a map wrong or unsafe for some reader; a warning is a trap; a note is
        good to know.
    file : str
        Where it is.
    message : str
        What it is, one line.
    line : int, optional
        The line of the file, from 1 on.
    """

    check: str
    severity: Severity
    file: str
    message: str
    line: int | None = None


@dataclass(frozen=True)
class Told:
    """What a check says: a message, and the key of the YAML that it is about."""

    message: str
    key: str | None = None


@dataclass(frozen=True)
class Check:
    """A check: its name, its severity, what it is about, and the function behind it.

    Checks without a function are found while files are read.
    """

    name: str
    severity: Severity
    about: str
    run: Callable[[Any], Iterator[Told | str]] | None = None


CHECKS: dict[str, Check] = {}

CheckFunction = Callable[[Any], Iterator[Told | str]]


def check(name: str, severity: Severity, about: str) -> Callable[[CheckFunction], CheckFunction]:
    """Add a function to the list of checks; it takes facts and yields what it has to say."""

    def added(function: CheckFunction) -> CheckFunction:
        _add(Check(name, severity, about, function))
        return function

    return added


def found_in_reading(name: str, severity: Severity, about: str) -> None:
    """Add a check whose findings are warnings, or errors, of the readers."""
    _add(Check(name, severity, about))


def _add(one: Check) -> None:
    if one.name in CHECKS:
        raise ValueError(f"two checks are called {one.name}")
    CHECKS[one.name] = one


found_in_reading("file.access", "error", "a file is missing or cannot be read")
found_in_reading("file.malformed", "error", "a file breaks its format's rules")
found_in_reading("yaml.defaults", "warning", "negate or a threshold is missing; ROS requires them")
found_in_reading(
    "yaml.number-as-text", "warning", "a number such as 5e-2 that YAML 1.1 reads as text"
)
found_in_reading("yaml.nan-yaw", "error", "a yaw that is no number, which some map savers write")
found_in_reading("yaml.legacy-mode", "warning", "the mode is written in an old way")
found_in_reading("thresholds.equal", "warning", "free_thresh equals occupied_thresh")
found_in_reading("image.foreign-path", "warning", "the image's path only makes sense elsewhere")
found_in_reading("image.lossy", "warning", "the image is a JPEG: greys may have moved")
found_in_reading("image.orientation", "warning", "an EXIF orientation that ROS does not apply")
found_in_reading("image.depth", "warning", "16-bit colour, of which 8 bits were read")
found_in_reading("image.transparent-colour", "warning", "a transparent colour (PNG tRNS)")
found_in_reading("image.dos-header", "warning", "DOS line ends in the header of a PNM image")
found_in_reading("image.trailing-bytes", "warning", "bytes behind the picture")
found_in_reading("image.raw-values", "warning", "values of mode raw that mean nothing")
