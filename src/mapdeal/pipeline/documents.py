"""Text and numbers of the JSON documents that commands print, and the document of `Reach`."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mapdeal.command import Result
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import Bottleneck, GoalReach, Passage, Reach

_DECIMALS = 9
"""Of metres: what is beyond is the rounding of binary fractions."""


def rounded(value: float) -> float | None:
    """Return a number as documents have it, None if it is not finite."""
    return round(float(value), _DECIMALS) + 0.0 if math.isfinite(value) else None


def spread_json(document: Mapping[str, Any], *spread: str) -> str:
    """Return a document as JSON text, an entry on a line, of some of them each item.

    Examples
    --------
    >>> print(spread_json({"start": [0, 1], "points": [[0, 1], [2, 1]]}, "points"))
    {
      "start": [0, 1],
      "points": [
        [0, 1],
        [2, 1]
      ]
    }
    """
    lines = []
    for key, value in document.items():
        text = json.dumps(value)
        if key in spread and value:
            items = ",\n".join(f"    {json.dumps(item)}" for item in value)
            text = f"[\n{items}\n  ]"
        lines.append(f'  "{key}": {text}')
    return "{\n" + ",\n".join(lines) + "\n}"


class Spread(Result):
    """A result whose document is written as it is printed."""

    def summary(self, output: Path) -> Iterator[str]:
        """Yield where it is, and its lines in short."""
        yield f"{output}: {'; '.join(self.lines())}"

    def write(self, transaction: Any, output: Path) -> None:
        """Write the document, each part as soon as it is found."""
        transaction.write_parts(output, (f"{part}\n".encode() for part in self.parts()))


def reach_json(reach: Reach) -> str:
    """Return what a robot can reach as JSON text, each goal and each passage on a line."""
    return spread_json(reach_document(reach), "goals", "passages")


def reach_document(reach: Reach) -> dict[str, Any]:
    """Return what a robot can reach as JSON can hold it: areas, goals and passages."""
    return {
        "robot": _robot(reach),
        "start": _start(reach),
        "through_unknown": reach.through_unknown,
        "reachable_m2": rounded(reach.reachable_area),
        "open_m2": rounded(reach.open_area),
        "free_m2": rounded(reach.free_area),
        "share": rounded(reach.share),
        "goals": [_goal(one) for one in reach.goals],
        "passages": [_passage(one) for one in reach.passages],
    }


def _robot(reach: Reach) -> dict[str, Any]:
    robot = reach.robot
    shape: dict[str, Any] = {"radius": 0.0 if robot is None else robot.radius}
    if isinstance(robot, Footprint) and robot.vertices:
        shape = {
            "footprint": [list(corner) for corner in robot.vertices],
            "inscribed_radius": rounded(robot.inscribed_radius),
            "circumscribed_radius": rounded(robot.circumscribed_radius),
        }
    return {**shape, "headings": reach.heading_count}


def _start(reach: Reach) -> dict[str, Any]:
    x, y, *yaw = reach.start
    return {**_place(x, y), "yaw": rounded(yaw[0]) if yaw else None}


def _goal(one: GoalReach) -> dict[str, Any]:
    named = {} if one.goal.name is None else {"name": one.goal.name}
    return {
        **named,
        **_place(one.goal.x, one.goal.y),
        "reachable": one.reachable,
        "heading_count": one.heading_count,
        "widest_radius_m": rounded(one.widest_radius),
        "limited_by": None if one.limited_by is None else _bottleneck(one.limited_by),
        "reason": one.reason,
        "nearest_open": None if one.nearest_open is None else _place(*one.nearest_open),
    }


def _bottleneck(one: Bottleneck) -> dict[str, Any]:
    return {**_place(one.x, one.y), "width_m": rounded(one.width), "at": one.at}


def _passage(one: Passage) -> dict[str, Any]:
    return {
        **_place(one.x, one.y),
        "width_m": rounded(one.width),
        "cuts_off_m2": rounded(one.cut_off),
        "open": one.is_open,
        "ends": [[rounded(x), rounded(y)] for x, y in one.ends],
    }


def _place(x: float, y: float) -> dict[str, Any]:
    return {"x": rounded(x), "y": rounded(y)}
