"""What a route graph should be like."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

from mapdeal.command import ABOVE_0, parameters_of
from mapdeal.errors import ParameterError

OneWay = Literal["right"]

_LENGTHS = ("spacing", "hall", "cover")
_LONGEST_WAY = 1 << 25  # cells: with more, weights of paths would be too large


@dataclass(frozen=True)
class Wishes:
    """What a graph should be like; lengths are in metres."""

    spacing: Annotated[float, ABOVE_0] = 2.0
    hall: Annotated[float, ABOVE_0] = 4.0
    cover: Annotated[float, ABOVE_0] = 3.0
    slow_below: Annotated[float | None, ABOVE_0] = None
    one_way: OneWay | None = None

    def __post_init__(self) -> None:
        for name, one in parameters_of(Wishes).items():
            object.__setattr__(self, name, one.accept(getattr(self, name)))

    def bounded(self, cells: int, side: float) -> Wishes:
        """Return the same wishes with lengths that are no longer than any way over some cells."""
        longest = min(cells, _LONGEST_WAY) * side
        return replace(self, **{name: min(getattr(self, name), longest) for name in _LENGTHS})


def check_wishes(wishes: Wishes, resolution: float) -> None:
    """Refuse lengths that are too short for a map's cells."""
    for name in _LENGTHS:
        value = getattr(wishes, name)
        if value < 4 * resolution:
            rule = f"must be at least four cells, {4 * resolution:g} m"
            raise ParameterError(rule, place=name, got=value)
