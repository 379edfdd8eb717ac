"""Result of reach as JSON."""

from __future__ import annotations

import json
import math
from typing import Any

from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import Bottleneck, GoalReach, Passage, Reach

_DECIMALS = 9
"""Of metres: what is beyond is the rounding of binary fractions."""


def reach_json(reach: Reach) -> str:
    """Return what a robot can reach as JSON text, each goal and each passage on a line."""
    document = reach_document(reach)
    lines = []
    for key, value in document.items():
        if isinstance(value, list) and value:
            items = ",\n".join(f"    {json.dumps(item)}" for item in value)
            lines.append(f'  "{key}": [\n{items}\n  ]')
        else:
            lines.append(f'  "{key}": {json.dumps(value)}')
    return "{\n" + ",\n".join(lines) + "\n}"


def reach_document(reach: Reach) -> dict[str, Any]:
    """Return what a robot can reach as JSON can hold it: areas, goals and passages."""
    return {
        "robot": _robot(reach),
        "start": _start(reach),
        "through_unknown": reach.through_unknown,
        "reachable_m2": _number(reach.reachable_area),
        "open_m2": _number(reach.open_area),
        "free_m2": _number(reach.free_area),
        "share": _number(reach.share),
        "goals": [_goal(one) for one in reach.goals],
        "passages": [_passage(one) for one in reach.passages],
    }


def _robot(reach: Reach) -> dict[str, Any]:
    robot = reach.robot
    shape: dict[str, Any] = {"radius": 0.0 if robot is None else robot.radius}
    if isinstance(robot, Footprint) and robot.vertices:
        shape = {
            "footprint": [list(corner) for corner in robot.vertices],
            "inscribed_radius": _number(robot.inscribed_radius),
            "circumscribed_radius": _number(robot.circumscribed_radius),
        }
    return {**shape, "headings": reach.heading_count}


def _start(reach: Reach) -> dict[str, Any]:
    x, y, *yaw = reach.start
    return {**_place(x, y), "yaw": _number(yaw[0]) if yaw else None}


def _goal(one: GoalReach) -> dict[str, Any]:
    named = {} if one.goal.name is None else {"name": one.goal.name}
    return {
        **named,
        **_place(one.goal.x, one.goal.y),
        "reachable": one.reachable,
        "heading_count": one.heading_count,
        "widest_radius_m": _number(one.widest_radius),
        "limited_by": None if one.limited_by is None else _bottleneck(one.limited_by),
        "reason": one.reason,
        "nearest_open": None if one.nearest_open is None else _place(*one.nearest_open),
    }


def _bottleneck(one: Bottleneck) -> dict[str, Any]:
    return {**_place(one.x, one.y), "width_m": _number(one.width), "at": one.at}


def _passage(one: Passage) -> dict[str, Any]:
    return {
        **_place(one.x, one.y),
        "width_m": _number(one.width),
        "cuts_off_m2": _number(one.cut_off),
        "open": one.is_open,
        "ends": [[_number(x), _number(y)] for x, y in one.ends],
    }


def _place(x: float, y: float) -> dict[str, Any]:
    return {"x": _number(x), "y": _number(y)}


def _number(value: float) -> float | None:
    return round(value, _DECIMALS) + 0.0 if math.isfinite(value) else None
