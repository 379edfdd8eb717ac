"""Names of figures, and bounds for them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product
from numbers import Real
from typing import Any, Literal

from mapdeal.errors import ParameterError, as_known, nearest
from mapdeal.grid.values import decimal_text
from mapdeal.records import dataclass

METRES, SHARE, COUNT, NUMBER, AREA = "m", "share", "count", "number", "m2"
_OF_DISTANCES = {
    "n": (COUNT, "wall cells measured"),
    "mean": (METRES, "mean"),
    "median": (METRES, "median"),
    "p95": (METRES, "95th percentile"),
    "max": (METRES, "farthest"),
    "share_lt_0p1": (SHARE, "less than 0.1 m"),
    "share_le_0p1": (SHARE, "at most 0.1 m"),
}
_OF_CONFUSION = {
    "tp": (COUNT, "occupied in both"),
    "tn": (COUNT, "in neither"),
    "fp": (COUNT, "in the map alone"),
    "fn": (COUNT, "in the true map alone"),
}
_OF_THICKNESS = {name: _OF_DISTANCES[name] for name in ("mean", "median", "p95")} | {
    "max": (METRES, "thickest")
}

DISTANCES: dict[str, str] = {
    "dist_est_to_truth_m": "from walls of the map to true walls",
    "dist_est_to_truth_where_truth_known_m": "... where the true map is known",
    "dist_truth_to_est_m": "from true walls to walls of the map",
    "dist_truth_to_est_where_est_known_m": "... where the map is known",
}
"""Groups of figures of distances, in the order in which they are printed."""
CONFUSIONS: dict[str, str] = {
    "confusion_known_in_both": "cells that are known in both",
    "confusion_whole_lattice": "all cells of the true map",
}

AGAINST_TRUTH: dict[str, tuple[str, str]] = {
    "coverage": (SHARE, "known area of the true map, known in the map"),
    "coverage_free": (SHARE, "free area of the true map, known in the map"),
    "known_in_both": (COUNT, "cells known in both"),
    "precision_occupied_known_in_both": (SHARE, "wall cells of the map that the true map has"),
    "recall_occupied_known_in_both": (SHARE, "wall cells of the true map that the map has"),
    "iou_occupied": (SHARE, "wall cells: in both, of those in either"),
    "iou_free": (SHARE, "free cells: in both, of those in either"),
    "mcc_known_in_both": (NUMBER, "correlation of walls (MCC), where both are known"),
    "mcc_whole_lattice": (NUMBER, "correlation of walls (MCC), all cells"),
    "ssim_uniform7": (NUMBER, "structural similarity, windows of 7 x 7"),
    "ssim_gauss": (NUMBER, "structural similarity, Gaussian windows"),
}

ALONE: dict[str, tuple[str, str]] = {
    "share_occupied": (SHARE, "occupied"),
    "share_free": (SHARE, "free"),
    "share_unknown": (SHARE, "unknown"),
    "share_occupied_of_known": (SHARE, "occupied, of the known cells"),
    "wall_cells": (COUNT, "wall cells"),
    "wall_pieces": (COUNT, "pieces of wall, of 5 cells or more"),
    "specks": (COUNT, "small components, of 4 cells or fewer"),
    "share_one_cell_thick": (SHARE, "wall cells where the wall is one cell thick"),
    "corners": (COUNT, "corners and ends of walls"),
    "enclosed_areas": (COUNT, "enclosed areas of 0.25 m2 or more"),
    "enclosed_m2": (AREA, "free area that they enclose"),
    "enclosed_pockets": (COUNT, "smaller enclosed pockets"),
}

THICKNESS = "wall_thickness_m"


def figures_named(*, with_truth: bool) -> dict[str, tuple[str, str]]:
    """Return unit and meaning of each figure that can have a bound, by its dotted name."""
    found = dict(AGAINST_TRUTH if with_truth else ALONE)
    groups = [(DISTANCES, _OF_DISTANCES), (CONFUSIONS, _OF_CONFUSION)]
    if not with_truth:
        groups = [({THICKNESS: "thickness of walls"}, _OF_THICKNESS)]
    for titles, members in groups:
        for (group, title), (name, (unit, meaning)) in product(titles.items(), members.items()):
            found[f"{group}.{name}"] = unit, f"{title}: {meaning}"
    return found


def figure_in(values: Mapping[str, Any], name: str) -> float | None:
    found: Any = values
    for part in name.split("."):
        found = found[part]
    return None if found is None else float(found)


def figure_text(value: float | None, unit: str) -> str:
    if value is None:
        return "-"
    if unit == SHARE:
        return f"{100 * value:.1f} %"
    if unit == COUNT:
        return str(int(value))
    if unit == NUMBER:
        return f"{value:.3f}"
    return f"{decimal_text(value)} {unit}"


NOTHING_COMPARED = "the maps have no known cell in common"
_OF_OVERLAP = ("known_in_both", "coverage", "coverage_free")
Side = Literal["min", "max"]
_ROUNDING = 1e-9  # of figures: six cells of 0.05 m are 0.30000000000000004 m


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
        Value of the figure, if it could be measured.
    """

    name: str
    side: Side
    allowed: float
    found: float | None

    @property
    def holds(self) -> bool:
        """Whether there is a figure, and it is within the bound but for rounding."""
        if self.found is None:
            return False
        beyond = self.found - self.allowed if self.side == "max" else self.allowed - self.found
        return beyond <= _ROUNDING * abs(self.allowed)


def checked_bounds(
    minimum: Mapping[str, float], maximum: Mapping[str, float], *, with_truth: bool
) -> list[tuple[str, Side, float]]:
    found: list[tuple[str, Side, float]] = []
    bounds_by_side: dict[Side, Mapping[str, float]] = {"min": minimum, "max": maximum}
    for side, bounds in bounds_by_side.items():
        for spelling, allowed in bounds.items():
            name = _known_name(spelling, side, with_truth=with_truth)
            if not isinstance(allowed, Real) or not math.isfinite(allowed):
                rule = "must be a finite number"
                raise ParameterError(rule, source=f"--{side}", place=name, got=allowed)
            found.append((name, side, float(allowed)))
    least = {name: allowed for name, side, allowed in found if side == "min"}
    for name, side, allowed in found:
        if side == "max" and allowed < least.get(name, -math.inf):
            rule = f"cannot be both at least {least[name]:g} and at most {allowed:g}"
            raise ParameterError(rule, source="--min, --max", place=name)
    return found


def judged(
    bounds: list[tuple[str, Side, float]], values: Mapping[str, Any]
) -> tuple[ScoreBound, ...]:
    """Return the bounds with their figures; maps without a common known cell have none."""
    names = [name for name, *_ in bounds]
    found = [None if _is_not_compared(name, values) else figure_in(values, name) for name in names]
    return tuple(ScoreBound(*bound, value) for bound, value in zip(bounds, found, strict=True))


def _is_not_compared(name: str, values: Mapping[str, Any]) -> bool:
    return values.get("known_in_both") == 0 and name not in _OF_OVERLAP


def why_missing(name: str, values: Mapping[str, Any]) -> str:
    if name.startswith("dist_"):
        return "one of the maps has no walls to measure"
    if _is_not_compared(name, values):
        return NOTHING_COMPARED
    if name.startswith("ssim_"):
        return "the truth is smaller than a window"
    if name.startswith("coverage"):
        return "the truth has no such cells"
    return "there are no such cells"


def unit_of(name: str, *, with_truth: bool) -> str:
    unit, _ = figures_named(with_truth=with_truth)[name]
    return "" if unit in (SHARE, COUNT, NUMBER) else f" {unit}"


def _known_name(spelling: str, side: str, *, with_truth: bool) -> str:
    names = figures_named(with_truth=with_truth)
    name = as_known(spelling, names)
    if name in names:
        return name
    inside = [figure for figure in names if figure.startswith(f"{name}.")]
    if inside:
        rule, hint = "contains several figures", f"choose one, such as {inside[1]}"
    elif name in figures_named(with_truth=not with_truth):
        rule = "is a figure " + ("of a map without a truth" if with_truth else "that needs a truth")
        hint = "omit --truth" if with_truth else "add --truth"
    else:
        near = nearest(name, names)
        rule = "is not a figure of a score"
        hint = f"did you mean {near}?" if near else "listed by mapdeal score --json, Score.values"
    raise ParameterError(rule, source=f"--{side}", got=spelling, hint=hint)
