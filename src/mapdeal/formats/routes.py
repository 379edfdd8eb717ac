"""Routes as JSON."""

from __future__ import annotations

import json
import math
from typing import Any

from mapdeal.formats.points import PairLine
from mapdeal.grid.route import Route

_DECIMALS = 9
"""Of metres: what is beyond is the rounding of binary fractions."""


def route_json(route: Route) -> str:
    """Return a route as JSON text, each point on a line of its own."""
    entries: dict[str, Any] = {"method": route.method, **_entries(route)}
    if route.method == "descent":
        minimum = route.local_minimum
        entries["local_minimum"] = None if minimum is None else _pair(minimum)
    lines = [f'  "{key}": {json.dumps(value)},' for key, value in entries.items()]
    points = ",\n".join(f"    {json.dumps(_pair(point))}" for point in route.points_xy.tolist())
    listed = f"[\n{points}\n  ]" if points else "[]"
    return "\n".join(["{", *lines, f'  "points": {listed}', "}"])


def route_line(route: Route, *, pair: int, method: str) -> str:
    """Return a route as JSON on one line, without its points."""
    return json.dumps({"pair": pair, "method": method, **_entries(route)})


def failed_line(asked: PairLine, *, pair: int, error: str, hint: str | None = None) -> str:
    """Return as JSON on one line why a start and a goal have no routes."""
    entries: dict[str, Any] = {"pair": pair, "line": asked.line}
    if asked.start is not None and asked.goal is not None:
        entries |= {"start": _pair(asked.start), "goal": _pair(asked.goal)}
    entries["error"] = error
    return json.dumps(entries if hint is None else {**entries, "hint": hint})


def _entries(route: Route) -> dict[str, Any]:
    return {
        "reached": route.reached,
        "start": _pair(route.start),
        "goal": _pair(route.goal),
        "length_m": _number(route.length),
        "min_clearance_m": _number(route.min_clearance),
        "mean_clearance_m": _number(route.mean_clearance),
        "cost": _number(route.cost),
        "expanded": route.expanded,
        "optimal": route.optimal,
    }


def _pair(point: Any) -> list[float]:
    return [round(float(value), _DECIMALS) + 0.0 for value in point]


def _number(value: float) -> float | None:
    return round(value, _DECIMALS) if math.isfinite(value) else None
