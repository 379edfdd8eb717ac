"""Bounds on figures of a score, for a gate that a map has to pass."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Real
from typing import Any, Literal

from mapdeal.errors import ParameterError
from mapdeal.records import dataclass
from mapdeal.scoring.names import COUNT, NUMBER, SHARE, figure_in, figures_named
from mapdeal.spelling import as_known, nearest

Side = Literal["min", "max"]

_ROUNDING = 1e-9
"""Of figures: six cells of 0.05 m are 0.30000000000000004 m."""


@dataclass(frozen=True)
class ScoreBound:
    """Bound on a figure of a score, and the value found.

    Parameters
    ----------
    name : str
        Name of the figure; a dot leads into a group, as in ``dist_est_to_truth_m.mean``.
    side : {'min', 'max'}
        Whether the figure must be at least or at most `allowed`.
    allowed : float
        The bound, in the unit of the figure: metres, or a share of 1.
    found : float or None
        Value of the figure; None if there was nothing to measure.
    """

    name: str
    side: Side
    allowed: float
    found: float | None

    @property
    def holds(self) -> bool:
        """Whether the figure is within the bound, allowing for floating-point rounding.

        Examples
        --------
        >>> ScoreBound("coverage", "min", 0.9, 0.91).holds
        True
        >>> ScoreBound("coverage", "min", 0.9, None).holds
        False
        """
        if self.found is None:
            return False
        beyond = self.found - self.allowed if self.side == "max" else self.allowed - self.found
        return beyond <= _ROUNDING * abs(self.allowed)


def checked_bounds(
    minimum: Mapping[str, float], maximum: Mapping[str, float], *, with_truth: bool
) -> list[tuple[str, Side, float]]:
    """Return the bounds under the official names of their figures."""
    found: list[tuple[str, Side, float]] = []
    for side, bounds in (("min", minimum), ("max", maximum)):
        for given, allowed in bounds.items():
            name = _known_name(given, side, with_truth=with_truth)
            if not isinstance(allowed, Real) or not math.isfinite(allowed):
                rule = "must be a finite number"
                raise ParameterError(rule, source=f"--{side}", place=name, got=allowed)
            found.append((name, "min" if side == "min" else "max", float(allowed)))
    least = {name: allowed for name, side, allowed in found if side == "min"}
    for name, side, allowed in found:
        if side == "max" and allowed < least.get(name, -math.inf):
            rule = f"cannot be both at least {least[name]:g} and at most {allowed:g}"
            raise ParameterError(rule, source="--min, --max", place=name)
    return found


def judged(bounds: list[tuple[str, Side, float]], values: Mapping[str, Any]) -> list[ScoreBound]:
    """Return the bounds with the values found."""
    return [
        ScoreBound(name, side, allowed, figure_in(values, name)) for name, side, allowed in bounds
    ]


def why_missing(name: str) -> str:
    """Return a short reason why a figure is missing.

    Examples
    --------
    >>> why_missing("coverage"), why_missing("dist_est_to_truth_m.mean")
    ('the truth has no such cells', 'one of the maps has no walls to measure')
    """
    if name.startswith("dist_"):
        return "one of the maps has no walls to measure"
    if name.startswith("ssim_"):
        return "the truth is smaller than a window"
    if name.startswith("coverage"):
        return "the truth has no such cells"
    return "there are no such cells"


def unit_of(name: str, *, with_truth: bool) -> str:
    """Return the unit to print after a figure; empty for shares and counts."""
    unit, _ = figures_named(with_truth=with_truth)[name]
    return "" if unit in (SHARE, COUNT, NUMBER) else f" {unit}"


def _known_name(given: str, side: str, *, with_truth: bool) -> str:
    names = figures_named(with_truth=with_truth)
    name = as_known(given, names)
    if name in names:
        return name
    inside = [one for one in names if one.startswith(f"{name}.")]
    if inside:
        rule, hint = "holds several figures", f"take one of them, such as {inside[1]}"
    elif name in figures_named(with_truth=not with_truth):
        rule = "is a figure " + ("of a map without a truth" if with_truth else "that needs a truth")
        hint = "leave --truth out" if with_truth else "give --truth"
    else:
        near = nearest(name, names)
        rule = "is not a figure of a score"
        hint = f"did you mean {near}?" if near else "mapdeal score --json lists the names"
    raise ParameterError(rule, source=f"--{side}", got=given, hint=hint)
