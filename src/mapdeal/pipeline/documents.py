"""JSON documents that commands write."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mapdeal.files.json_values import JsonValue, NamedMap, named_map
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import FARTHEST, Transform
from mapdeal.grid.reach import Bottleneck, GoalReach, Passage, Reach
from mapdeal.grid.route import Route
from mapdeal.sensors.points import PairLine


@dataclass(frozen=True)
class AlignmentAnswer:
    """Content of a document written by ``mapdeal align``."""

    first: NamedMap | None
    second: NamedMap | None
    transform: Transform
    same_place: bool
    reason: str | None
    score: float
    runner_up: float
    overlap: float
    agreement: float


def alignment_answer(document: JsonValue) -> AlignmentAnswer:
    moved, reason = document["transform"], document["reason"]
    x, y, yaw = (moved[key].number() for key in ("x", "y", "yaw"))
    return AlignmentAnswer(
        named_map(document["first"]), named_map(document["second"]), Transform(x, y, yaw),
        document["same_place"].flag(), None if reason.is_null else reason.text(),
        document["score"].number(least=0), document["runner_up"].number(least=0),
        document["overlap"].number(least=0, most=1), document["agreement"].number(least=0, most=1),
    )  # fmt: skip


_LARGEST = FARTHEST**2


@dataclass(frozen=True)
class ToldBound:
    name: str
    is_least: bool
    allowed: float
    found: float | None
    holds: bool


@dataclass(frozen=True)
class ScoreAnswer:
    """Content of a document printed by ``mapdeal score --json``."""

    file: str | None
    truth: str | None
    sums: Mapping[str, str]
    width: int
    height: int
    resolution: float
    transform: tuple[float, float, float] | None
    has_truth: bool
    figures: Mapping[str, float | None]
    bounds: tuple[ToldBound, ...]
    passes: bool


def score_answer(document: JsonValue) -> ScoreAnswer:
    own, truth, moved = document["map"], document["truth"], document["transform"]
    lattice = document["lattice"]
    return ScoreAnswer(
        None if own.is_null else own["file"].text(),
        None if truth.is_null else truth["file"].text(),
        {} if own.is_null else {
            name: digest.sha256() for name, digest in own["sha256"].fields().items()
        },
        lattice["width"].whole(1),
        lattice["height"].whole(1),
        lattice["resolution"].number(least=1e-6),
        None if moved.is_null else (
            moved["x"].number(), moved["y"].number(), moved["yaw"].number()
        ),
        not moved.is_null,
        _figures(document["values"]),
        tuple(_bound(one) for one in document["bounds"].items()),
        document["passes"].flag(),
    )  # fmt: skip


def _figures(values: JsonValue) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for name, value in values.fields().items():
        if isinstance(value.value, dict):
            for part, inner in value.fields().items():
                found[f"{name}.{part}"] = _figure(inner)
        elif not isinstance(value.value, list):  # a size, which the lattice tells too
            found[name] = _figure(value)
    return found


def _figure(value: JsonValue) -> float | None:
    return None if value.is_null else value.number(least=-_LARGEST, most=_LARGEST)


def _bound(one: JsonValue) -> ToldBound:
    return ToldBound(
        one["name"].text(), one["side"].word("min", "max") == "min",
        one["allowed"].number(least=-_LARGEST, most=_LARGEST), _figure(one["found"]),
        one["holds"].flag(),
    )  # fmt: skip


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
        "reachable_m2": _rounded(reach.reachable_area),
        "open_m2": _rounded(reach.open_area),
        "free_m2": _rounded(reach.free_area),
        "share": _rounded(reach.share),
        "goals": [_goal(one) for one in reach.goals],
        "passages": [_passage(one) for one in reach.passages],
    }


def _robot(reach: Reach) -> dict[str, Any]:
    robot = reach.robot
    shape: dict[str, Any] = {"radius": 0.0 if robot is None else robot.radius}
    if isinstance(robot, Footprint) and robot.vertices:
        shape = {
            "footprint": [list(corner) for corner in robot.vertices],
            "inscribed_radius": _rounded(robot.inscribed_radius),
            "circumscribed_radius": _rounded(robot.circumscribed_radius),
        }
    return {**shape, "headings": reach.heading_count}


def _start(reach: Reach) -> dict[str, Any]:
    x, y, *yaw = reach.start
    return {**_place(x, y), "yaw": _rounded(yaw[0]) if yaw else None}


def _goal(one: GoalReach) -> dict[str, Any]:
    named = {} if one.goal.name is None else {"name": one.goal.name}
    return {
        **named,
        **_place(one.goal.x, one.goal.y),
        "reachable": one.reachable,
        "heading_count": one.heading_count,
        "widest_radius_m": _rounded(one.widest_radius),
        "limited_by": None if one.limited_by is None else _bottleneck(one.limited_by),
        "reason": one.reason,
        "nearest_open": None if one.nearest_open is None else _place(*one.nearest_open),
    }


def _bottleneck(one: Bottleneck) -> dict[str, Any]:
    return {**_place(one.x, one.y), "width_m": _rounded(one.width), "at": one.at}


def _passage(one: Passage) -> dict[str, Any]:
    return {
        **_place(one.x, one.y),
        "width_m": _rounded(one.width),
        "cuts_off_m2": _rounded(one.cut_off),
        "open": one.is_open,
        "ends": [[_rounded(x), _rounded(y)] for x, y in one.ends],
    }


def _place(x: float, y: float) -> dict[str, Any]:
    return {"x": _rounded(x), "y": _rounded(y)}


def _rounded(value: float) -> float | None:
    return round(value, _DECIMALS) + 0.0 if math.isfinite(value) else None


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
