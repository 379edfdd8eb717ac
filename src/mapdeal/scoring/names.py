"""The names of the figures of a score, their units, and what they mean in a few words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

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
    "fn": (COUNT, "in the truth alone"),
}
_OF_THICKNESS = {name: _OF_DISTANCES[name] for name in ("mean", "median", "p95")} | {
    "max": (METRES, "thickest")
}

Group = Mapping[str, tuple[str, str]]

DISTANCES: dict[str, str] = {
    "dist_est_to_truth_m": "walls of the map to those of the truth",
    "dist_est_to_truth_where_truth_known_m": "... where the truth is known",
    "dist_truth_to_est_m": "walls of the truth to those of the map",
    "dist_truth_to_est_where_est_known_m": "... where the map is known",
}
"""Groups of figures of distances, in the order in which they are printed."""

CONFUSIONS: dict[str, str] = {
    "confusion_known_in_both": "cells that are known in both",
    "confusion_whole_lattice": "all cells of the truth",
}

AGAINST_TRUTH: dict[str, tuple[str, str]] = {
    "coverage": (SHARE, "known area of the truth that the map knows"),
    "coverage_free": (SHARE, "free area of the truth that the map knows"),
    "known_in_both": (COUNT, "cells known in both"),
    "precision_occupied_known_in_both": (SHARE, "wall cells of the map that the truth has"),
    "recall_occupied_known_in_both": (SHARE, "wall cells of the truth that the map has"),
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

_GROUPS_WITH_TRUTH: dict[str, Group] = {
    **dict.fromkeys(DISTANCES, _OF_DISTANCES),
    **dict.fromkeys(CONFUSIONS, _OF_CONFUSION),
}
_GROUPS_ALONE: dict[str, Group] = {THICKNESS: _OF_THICKNESS}


def figures_named(*, with_truth: bool) -> dict[str, tuple[str, str]]:
    """Return unit and meaning of each figure that can have a bound, by its dotted name."""
    plain = AGAINST_TRUTH if with_truth else ALONE
    groups = _GROUPS_WITH_TRUTH if with_truth else _GROUPS_ALONE
    titles = {**DISTANCES, **CONFUSIONS, THICKNESS: "thickness of walls"}
    found = dict(plain)
    for group, members in groups.items():
        for name, (unit, meaning) in members.items():
            found[f"{group}.{name}"] = unit, f"{titles[group]}: {meaning}"
    return found


def figure_in(values: Mapping[str, Any], name: str) -> float | None:
    """Return the figure of a dotted name; None if there was nothing to measure."""
    found: Any = values
    for part in name.split("."):
        found = found[part]
    return None if found is None else float(found)


def figure_text(value: float | None, unit: str) -> str:
    """Return a figure with its unit as people read it, ``-`` where there is none.

    Examples
    --------
    >>> figure_text(0.30000000000000004, METRES), figure_text(0.9097, SHARE)
    ('0.3 m', '91.0 %')
    >>> figure_text(None, METRES), figure_text(1234, COUNT), figure_text(0.46785, NUMBER)
    ('-', '1234', '0.468')
    """
    if value is None:
        return "-"
    if unit == SHARE:
        return f"{100 * value:.1f} %"
    if unit == COUNT:
        return str(int(value))
    if unit == NUMBER:
        return f"{value:.3f}"
    return f"{float(f'{value:.4g}'):g} {unit}"
