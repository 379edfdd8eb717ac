"""Checks, their findings, and the list of all checks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from mapdeal.errors import one_line
from mapdeal.grid.frame import Point
from mapdeal.ros.values import ParameterValue

Severity = Literal["error", "warning", "note"]
_DECIMALS = 9
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")


@dataclass(frozen=True)
class Finding:
    """Finding reported by a check.

    Parameters
    ----------
    check : str
        Name of the check, ``area.name``.
    severity : {'error', 'warning', 'note'}
        An error makes the map wrong or unsafe for some reader, a warning points out a trap, and
        a note is worth knowing.
    file : str
        File in which it was found.
    message : str
        Description, one line.
    line : int, optional
        Line number in the file, starting at 1.
    places : tuple of (x, y)
        Positions in the map frame, metres: a selection, the most important first.
    """

    check: str
    severity: Severity
    file: str
    message: str
    line: int | None = None
    places: tuple[Point, ...] = ()

    def __str__(self) -> str:
        """Return ``FILE:LINE: SEVERITY: CHECK: MESSAGE``, as ``mapdeal lint`` prints it."""
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return one_line(f"{place}: {self.severity}: {self.check}: {self.message}")


@dataclass(frozen=True)
class Remark:
    """Remark of a check about a map."""

    message: str
    key: str | None = None
    at: ParameterValue | None = None
    places: tuple[Point, ...] = ()


@dataclass(frozen=True)
class Check:
    name: str
    severity: Severity
    about: str
    run: Callable[[Any], Iterator[Remark | str]] | None = None
    facts: type | None = None


def places_of(points_xy: Iterable[Sequence[float]]) -> tuple[Point, ...]:
    """Return points of the map frame as findings print them, without the rounding of floats."""
    return tuple((round(x, _DECIMALS) + 0.0, round(y, _DECIMALS) + 0.0) for x, y in points_xy)


CHECKS: dict[str, Check] = {}
"""All checks by name, in the order in which they run."""


def add_check(check: Check) -> None:
    """Add a check to the list; raise ValueError if there is one of its name."""
    if check.name in CHECKS:
        raise ValueError(f"two checks are called {check.name}")
    CHECKS[check.name] = check


def declare_check(name: str, severity: Severity, about: str) -> None:
    """Add a check without a function: its findings come up while files are read."""
    add_check(Check(name, severity, about))


declare_check("file.access", "error", "a file is missing or cannot be read")
declare_check("file.malformed", "error", "a file breaks its format's rules")
declare_check("yaml.defaults", "warning", "negate or a threshold is missing; ROS requires them")
declare_check("yaml.number-as-text", "warning", "a number such as 5e-2 that YAML 1.1 reads as text")
declare_check("yaml.nan-yaw", "error", "a yaw that is not a number, which some map savers write")
declare_check("yaml.legacy-mode", "warning", "the mode is written in an old way")
declare_check("thresholds.equal", "warning", "free_thresh equals occupied_thresh")
declare_check("image.foreign-path", "warning", "the image's path only makes sense elsewhere")
declare_check("image.lossy", "warning", "the image is a JPEG: greys may have moved")
declare_check("image.orientation", "warning", "an EXIF orientation that ROS does not apply")
declare_check("image.depth", "warning", "16-bit colour, of which 8 bits were read")
declare_check("image.transparent-colour", "warning", "a transparent colour (PNG tRNS)")
declare_check("image.dos-header", "warning", "DOS line ends in the header of a PNM image")
declare_check("image.trailing-bytes", "warning", "bytes after the picture")
declare_check("image.raw-values", "warning", "values without a meaning in mode raw")
declare_check("map.view", "warning", "a 0..100 view of a distance field, which is not a map")
declare_check("lint.not-checked", "error", "a map that could not be checked: no memory, or a bug")
declare_check(
    "lint.unused-ignore", "note", "a comment that ignores nothing, or names a check that is none"
)
