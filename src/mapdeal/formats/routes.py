"""Routes as JSON."""

from __future__ import annotations

import json
import math
from typing import Any

from mapdeal.grid.route import Route

_DECIMALS = 9
"""Of metres: what is beyond is the rounding of binary fractions."""


def route_json(route: Route) -> str:
    """Return a route as JSON text, each point on a line of its own."""
    entries: dict[str, Any] = {
        "method": route.method,
        "reached": route.reached,
        "start": _pair(route.start),
        "goal": _pair(route.goal),
        "length_m": _number(route.length),
        "min_clearance_m": _number(route.min_clearance),
        "cost": _number(route.cost),
    }
    if route.method == "descent":
        minimum = route.local_minimum
        entries["local_minimum"] = None if minimum is None else _pair(minimum)
    lines = [f'  "{key}": {json.dumps(value)},' for key, value in entries.items()]
    points = ",\n".join(f"    {json.dumps(_pair(point))}" for point in route.points_xy.tolist())
    listed = f"[\n{points}\n  ]" if points else "[]"
    return "\n".join(["{", *lines, f'  "points": {listed}', "}"])


def _pair(point: Any) -> list[float]:
    return [round(float(value), _DECIMALS) + 0.0 for value in point]


def _number(value: float) -> float | None:
    return round(value, _DECIMALS) if math.isfinite(value) else None
