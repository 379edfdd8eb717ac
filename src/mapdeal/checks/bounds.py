"""Bounds on the difference between two maps, for a gate that lets small changes pass."""

from __future__ import annotations

import math
import sys
from numbers import Real

import numpy as np

from mapdeal.checks.difference import STATES, Difference
from mapdeal.errors import ParameterError
from mapdeal.records import dataclass

_ROUNDING = 1e-9
"""Of distances: six cells of 0.05 m are 0.30000000000000004 m."""


@dataclass(frozen=True)
class Bound:
    """Bound on the difference between two maps, and the value found.

    Parameters
    ----------
    name : str
        Option that sets the bound, without the leading dashes.
    unit : str
        Unit of both values.
    allowed : float
        Largest value allowed.
    found : float
        Value found; infinite if one map has obstacles to compare and the other has none, nan if
        the maps have no common cell.
    """

    name: str
    unit: str
    allowed: float
    found: float

    @property
    def holds(self) -> bool:
        """Whether the value found is within the bound, allowing for floating-point rounding."""
        return self.found <= self.allowed * (1 + _ROUNDING)  # never true of nan


@dataclass(frozen=True)
class Bounds:
    """Bounds on the difference between two maps."""

    max_shift: float | None = None
    max_differing: float | None = None

    def __post_init__(self) -> None:
        if self.max_shift is not None and not _lies_in(self.max_shift, 0, sys.float_info.max):
            rule = "must be a finite number of metres, 0 or more"
            raise ParameterError(rule, place="max_shift", got=self.max_shift)
        if self.max_differing is not None and not _lies_in(self.max_differing, 0, 100):
            rule = "must be 0 to 100 percent"
            raise ParameterError(rule, place="max_differing", got=self.max_differing)

    def __bool__(self) -> bool:
        return self.max_shift is not None or self.max_differing is not None

    def judged(self, found: Difference) -> tuple[Bound, ...]:
        """Return each bound that is set, with the value found.

        Notes
        -----
        Only the common area is judged, whatever the geometry of the maps.
        """
        bounds = []
        if self.max_shift is not None:
            bounds.append(Bound("max-shift", "m", self.max_shift, largest_shift(found)))
        if self.max_differing is not None:
            share = 100 * found.beyond / found.common if found.common else math.nan
            bounds.append(Bound("max-differing", "%", self.max_differing, share))
        return tuple(bounds)


def largest_shift(found: Difference) -> float:
    """Return the largest distance of an obstacle of either map from those of the other, metres.

    Infinite if only one of the maps has obstacles, nan if they have no common cell.
    """
    if not found.common:
        return math.nan
    occupied = STATES.index("occupied")
    in_common = np.array([found.confusion[occupied].sum(), found.confusion[:, occupied].sum()])
    shifts = [
        0.0 if not count else math.inf if shift is None else shift.largest
        for count, shift in zip(in_common, found.walls, strict=True)
    ]
    return max(shifts)


def _lies_in(number: object, lowest: float, highest: float) -> bool:
    """Return whether something is a number, and within limits."""
    return isinstance(number, Real) and lowest <= float(number) <= highest
