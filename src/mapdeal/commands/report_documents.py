"""The JSON documents of lint, reach, route, plan, diff, align, score and build --compare.

They may come from elsewhere: each value is checked, and an error names the file and the key.
Numbers that JSON does not have, an infinite width for instance, are null there.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import count, islice
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np
from numpy.typing import NDArray

from mapdeal.checks.findings import SEVERITIES, Severity
from mapdeal.commands.diff import passage_text
from mapdeal.compare.difference import Change, CostChange
from mapdeal.compare.score import figure_text, figures_named
from mapdeal.errors import MalformedInputError, ParameterError, one_line
from mapdeal.files import json_values, source
from mapdeal.files.json_values import JsonValue, NamedMap
from mapdeal.grid import filters, reach, route_graph
from mapdeal.grid.footprint import Footprint, checked_corners
from mapdeal.grid.frame import FARTHEST, Frame, Point, Transform
from mapdeal.grid.reach import Bottleneck, Goal, GoalReach, Method, Passage, PlaceOfLimit, Route
from mapdeal.grid.shapes import Circle, Line, Polygon, Shape
from mapdeal.grid.values import CostScale, count_text, decimal_text, place_text
from mapdeal.maps.kinds import SHAPES, recognised
from mapdeal.maps.route_graphs import parsed_graph
from mapdeal.maps.shapes import geojson_shapes, read_shapes
from mapdeal.records import dataclass, field, replace
from mapdeal.report.document import About, Claim, Item, State, Table, Tone, Zone, outlines_of
from mapdeal.report.verdict import GEOMETRY, MOST_CLAIMS, on_findings, on_goals
from mapdeal.ros.robot import CostmapName

MOST_ITEMS = 1000  # listed items of one kind: pages with a million of them do not open
MOST_POINTS = 20_000  # of a route on a page: a million of them take some megabytes
_MOST_OF_A_CHANGE = 5  # regions that are listed of costs that changed in one way
MOST_CHANGES = 20  # places that are listed of obstacles that are new, or gone
_MOST_ROWS = 200
_LONGEST = 400
_CORNERS_OF_CIRCLE = 64
_WIDEST, _MOST_CORNERS = 1000.0, 500  # of a robot: coordinates in metres, and the number of corners
_RADIUS_DIGITS = 4  # to which the radii of two robots are compared
_LARGEST = FARTHEST**2
_KNOWN_DOCUMENTS = (
    "what lint, reach, route, plan of one map, diff, align, score or build --compare writes as "
    "JSON, nor a file of shapes"
)
_COUNTS = {  # of a diff
    "common_cells": "common cells", "differing": "differing",
    "beyond_tolerance": "beyond the tolerance", "known_only_in_first": "known in the first alone",
}  # fmt: skip


@dataclass(frozen=True)
class Subject:
    """The robot or costmap that a result is about; a part of the key may be None, for unknown."""

    kind: str
    key: tuple[object, ...]
    text: str

    def differs(self, earlier: Subject) -> bool:
        pairs = zip(self.key, earlier.key, strict=True)
        return any(a != b for a, b in pairs if a is not None and b is not None)


def robot_subject(text: str, *radii: float | None) -> Subject:
    key = tuple(radius and round(radius, _RADIUS_DIGITS) for radius in radii)
    return Subject("robot", key, text)


def costmap_subject(name: str, files: Iterable[tuple[str, str]]) -> Subject:
    names, sums = zip(*files, strict=True) if (files := list(files)) else ((), ())
    return Subject("costmap", (name, sums), f"the {name} costmap of {', '.join(names)}")


@dataclass(frozen=True)
class NamedRobot:
    files: tuple[tuple[str, str], ...]  # names and checksums
    costmap: CostmapName
    namespace: str | None


@dataclass(frozen=True)
class Results:
    """What a document says of maps, as a page shows it."""

    kind: str
    items: list[Item] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    parts: list[Results] = field(default_factory=list)  # maps of lint, methods of a comparison
    maps: tuple[NamedMap | None, ...] = ()
    truth: str | None = None  # name of its file
    transform: Transform | None = None
    tolerance: float = 0.0  # cells
    claims: tuple[Claim, ...] = ()
    subjects: tuple[Subject, ...] = ()
    question: ReachQuestion | None = None
    start: tuple[float, ...] = ()
    goals: tuple[Goal, ...] = ()
    robots: tuple[NamedRobot, ...] = ()  # whose parameters are compared
    name: str = ""  # of a part

    @property
    def files(self) -> tuple[str, ...]:
        names = [part.name for part in self.parts] if self.kind == json_values.LINT else []
        names += [named.file for named in self.maps if named is not None]
        names += [] if self.truth is None else [self.truth]
        return (*names, *(name for robot in self.robots for name, _ in robot.files))


def read_results(path: Path) -> Results:
    if not source.head_of(path, 1 << 10).removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"{"):
        return Results(SHAPES, shape_items(read_shapes(path)))
    document = json_values.read_document(path)
    name = json_values.document_kind(document.value)
    if name == SHAPES:
        return Results(SHAPES, shape_items(geojson_shapes(document), zones_in(document.value)))
    if name not in _READERS:
        with recognised(path, _KNOWN_DOCUMENTS):
            raise MalformedInputError(f"is not {_KNOWN_DOCUMENTS}", source=path)
    return results_of(document)


def results_of(document: JsonValue) -> Results:
    try:
        return _READERS[json_values.document_kind(document.value)](document)
    except RecursionError:  # a value that is shown, or kept as it is
        raise MalformedInputError("nested too deep", source=document.source) from None


def _lint(document: JsonValue) -> Results:
    files = map(_part_of_lint, document.items_of("parameter_files"))
    parts = [replace(part, claims=()) for part in files]  # only maps have claims
    parts += map(_part_of_lint, document["maps"].items())
    for key in ("errors", "warnings", "notes", "suppressed"):
        document[key].integer()
    return Results(json_values.LINT, parts=parts)


def _part_of_lint(document: JsonValue) -> Results:
    texts: dict[str, list[str]] = {severity: [] for severity in SEVERITIES}
    items: list[Item] = []
    for finding in document["findings"].items():
        severity = cast("Severity", finding["severity"].word(*SEVERITIES))
        check, message = finding["check"].text(), finding["message"].text()
        texts[severity].append(short(message))
        line = finding["line"].or_none(JsonValue.integer)
        message += f" (line {line})" if line is not None else ""
        places = [place.point() for place in finding["places"].items()]
        # Findings of one check share a line of the list, and so do the places of one finding.
        group = short(f"{severity} {check}")
        for index, place in enumerate(places or (None,), start=1):
            words = f"place {index} of {len(places)}" if index > 1 else message
            items.append(Item("finding", short(f"{check}: {words}"), severity, place, group=group))
    rows = [(f"{severity}s", str(len(messages))) for severity, messages in texts.items()]
    rows.append(("suppressed", str(document["suppressed"].integer())))
    for number, repair in enumerate(document.items_of("repairs"), start=1):
        rows.append((f"repair {number}", short(repair.text())))
    tables, claims = [Table("Lint", tuple(rows))], (on_findings(texts),)
    items, name = _shortened(items, "finding"), document["file"].text()
    return Results(json_values.LINT, items, tables, claims=claims, name=name)


def _reach(document: JsonValue) -> Results:
    robot, yaw = _robot(document["robot"]), document["start"]["yaw"].or_none(JsonValue.number)
    headings = document["robot"]["headings"].integer(1, reach.MOST_HEADINGS)
    place, text = _place(document["start"]), reach.robot_text(robot)
    goals = [goal_of(goal) for goal in document["goals"].items()]
    passages = [passage_of(passage) for passage in document["passages"].items()]
    is_open = document["through_unknown"].flag()
    areas = [document[f"{name}_m2"].number(least=0) for name in ("reachable", "open", "free")]
    share = document["share"].number(least=0, most=1)
    closed = sum(not passage.is_open for passage in passages)
    rows = (
        ("robot", text),
        ("headings", str(headings)),
        ("unknown cells", "open" if is_open else "closed"),
        ("reachable", f"{areas[0]:.6g} m2"),
        ("open to the robot", f"{areas[1]:.6g} m2"),
        ("free", f"{areas[2]:.6g} m2"),
        ("reachable share of free", f"{100 * share:.4g} %"),
        ("goals reached", f"{sum(goal.reachable for goal in goals)} of {len(goals)}"),
        ("passages", f"{len(passages)}, {closed} of them closed"),
    )
    at = place_text(place) + ("" if yaw is None else f", yaw {yaw:.4g}")
    start = Item("start", f"start at {at}: {text}", place=place, label="start")
    subjects, words = [], [*robot_words(robot), *(["--through-unknown"] if is_open else [])]
    if robot is not None:
        outer = robot.circumscribed_radius if robot.vertices else None
        subjects.append(robot_subject(text, robot.inscribed_radius, outer))
    costmap = document.get("costmap")
    if costmap is not None and not costmap.is_null:
        subjects.append(costmap_subject(costmap["costmap"].text(), _named_files(costmap, "name")))
    share_of_open = min(areas[0] / areas[1], 1.0) if areas[1] else 1.0
    start_pose = place if yaw is None else (*place, yaw)
    return Results(
        json_values.REACH, [start, *goal_items(goals, robot, headings), *passage_items(passages)],
        [Table("What the robot can reach", rows)],
        claims=(on_goals(goals, passages, robot, share=share_of_open),),
        maps=_maps(document, "map"), subjects=tuple(subjects),
        question=ReachQuestion(start_pose, tuple(goal.goal for goal in goals), tuple(words)),
    )  # fmt: skip


def _named_files(document: JsonValue, key: str) -> tuple[tuple[str, str], ...]:
    return tuple((file[key].text(), file["sha256"].sha256()) for file in document["files"].items())


def _robot(robot: JsonValue) -> Footprint | None:
    corners = robot.get("footprint")
    if corners is None:
        radius = robot["radius"].number(least=0, most=_WIDEST)
        return Footprint.circle(radius) if radius else None
    try:
        return checked_shape([corner.point() for corner in corners.items()])
    except ParameterError as error:
        raise error.in_file(corners.source, corners.place) from None


def checked_shape(corners: Sequence[Any]) -> Footprint:
    most = _MOST_CORNERS
    return Footprint(checked_corners(corners, "footprint", within=_WIDEST, least=3, most=most))


def goal_of(document: JsonValue) -> GoalReach:
    return GoalReach(
        Goal(*_place(document), document.optional("name", JsonValue.text)),
        document["reachable"].flag(), document["heading_count"].integer(),
        document["widest_radius_m"].number_or(math.inf),
        document["limited_by"].or_none(_bottleneck), document["reason"].or_none(JsonValue.text),
        document["nearest_open"].or_none(_place),
    )  # fmt: skip


def _bottleneck(document: JsonValue) -> Bottleneck:
    at = cast("PlaceOfLimit", document["at"].word(*get_args(PlaceOfLimit)))
    return Bottleneck(*_place(document), document["width_m"].number_or(math.inf), at)


def passage_of(document: JsonValue) -> Passage:
    ends = [end.point() for end in document["ends"].items()]
    if len(ends) != 2:
        raise document["ends"].error("must be two points [x, y]")
    return Passage(
        *_place(document), document["width_m"].number_or(math.inf),
        document["cuts_off_m2"].number_or(math.inf), document["open"].flag(), (ends[0], ends[1]),
    )  # fmt: skip


def _place(document: JsonValue) -> Point:
    return document["x"].number(), document["y"].number()


def goal_items(goals: Iterable[GoalReach], robot: Footprint | None, headings: int) -> list[Item]:
    items = []
    for answer in goals:
        place = answer.goal.x, answer.goal.y
        text = f"goal {answer.goal.label}: {'reachable' if answer.reachable else 'not reachable'}"
        if answer.reachable and robot is not None and robot.vertices:
            text += f" in {answer.heading_count} of {count_text(headings, 'heading')}"
        limit, widest = answer.limited_by, answer.widest_radius
        if answer.reason is not None:
            text, limit = f"{text}: {answer.stopped_by}", None
        elif widest == 0:
            text += "; by no robot, however small"
        elif math.isfinite(widest):
            text += f"; a round robot gets there with a radius below {_metres(widest)}"
        text += f": {limit.text}" if limit is not None and math.isfinite(limit.width) else ""
        tone: Tone = "good" if answer.reachable else "error"
        label = short(answer.goal.name or "goal")
        items.append(Item("goal", short(text), tone, place, label=label))
    return _shortened(items, "goal")


def passage_items(passages: Iterable[Passage]) -> list[Item]:
    items = []
    for passage in passages:
        width, area = _metres(passage.width), f"{decimal_text(passage.cut_off)} m2"
        tone: Tone = "warning" if passage.is_open else "error"
        text = f"closed passage of {width}, cuts off {area} from the start"
        if passage.is_open:
            text = f"narrow passage of {width}, {area} behind it"
        line = np.array(passage.ends, dtype=np.float64)
        label = f"{100 * passage.width:.0f} cm" if passage.width < 1 else width
        items.append(Item("passage", text, tone, (passage.x, passage.y), (line,), label))
    return _shortened(items, "passage")


def _route(document: JsonValue) -> Results:
    route = route_of(document)
    rows = (
        ("method", route.method),
        ("reached", "yes" if route.reached else "no"),
        ("start", place_text(route.start)),
        ("goal", place_text(route.goal)),
        ("length", _metres(route.length)),
        ("least clearance", _metres(route.min_clearance)),
        ("mean clearance", _metres(route.mean_clearance)),
        ("cost", f"{route.cost:.6g}" if math.isfinite(route.cost) else "-"),
        ("cells expanded", "-" if route.expanded is None else str(route.expanded)),
        ("certainly the cheapest", "yes" if route.optimal else "no"),
    )
    return Results(json_values.ROUTE, route_items(route), [Table("Route", rows)])


def route_of(document: JsonValue) -> Route:
    points = document["points"].points()
    nowhere = math.nan if not len(points) else math.inf
    return Route(
        cast("Method", document["method"].word(*get_args(Method))), document["reached"].flag(),
        document["start"].point(), document["goal"].point(), points,
        document["length_m"].number_or(nowhere), document["cost"].number_or(nowhere),
        document["min_clearance_m"].number_or(nowhere),
        document.optional("local_minimum", JsonValue.point),
        document["mean_clearance_m"].number_or(nowhere),
        document["expanded"].or_none(JsonValue.integer), document["optimal"].flag(),
    )  # fmt: skip


def route_items(route: Route) -> list[Item]:
    tone: Tone = "good" if route.reached else "error"
    label = "goal" if route.reached else "goal, not reached"
    ends = [
        Item("start", f"start at {place_text(route.start)}", place=route.start, label="start"),
        Item("goal", f"{label}, at {place_text(route.goal)}", tone, route.goal, label=label),
    ]
    text, points_xy = f"route by {route.method}", route.points_xy
    if not len(points_xy):
        return [*ends, Item("route", f"{text}: no way", tone)]
    text += f" of {_metres(route.length)}"
    if math.isfinite(route.min_clearance):
        text += f", at least {_metres(route.min_clearance)} from obstacles"
    text += f", cost {route.cost:.4g}" if math.isfinite(route.cost) else ""
    if route.local_minimum is not None:
        text += f"; it ends in a local minimum at {place_text(route.local_minimum)}"
    elif not route.reached:
        text += "; it does not reach the goal"
    return [*ends, _along(Item("route", text, tone), points_xy)]


def _along(item: Item, points_xy: NDArray[np.float64]) -> Item:
    x, y = points_xy[len(points_xy) // 2].tolist()
    if len(points_xy) > MOST_POINTS:
        chosen = np.linspace(0, len(points_xy) - 1, MOST_POINTS)  # with the first and the last
        points_xy = points_xy[chosen.astype(np.int64)]
    return replace(item, place=(x, y), lines=(points_xy,))


def trajectory_items(trajectories: Mapping[int, Any]) -> list[Item]:
    items = []
    for key, path in trajectories.items():
        facts = path.described()
        text = f"trajectory {key}: {count_text(facts['poses'], 'pose')}, "
        text += f"{facts['length_m']:.6g} m in {facts['duration_s']:.6g} s"
        items.append(_along(Item("trajectory", text, "note"), path.poses[:, :2]))
    return items


def _plan(document: JsonValue) -> Results:
    start = _xy(document["start"])
    items = [Item("start", f"start at {place_text(start)}", place=start, label="start")]
    rows, missed = [], []
    for goal in document["goals"].items():
        place, is_found = _place(goal), goal["found"].or_none(JsonValue.flag)
        name = goal.optional("name", JsonValue.text)
        label = place_text(place) if name is None else name
        text = f"no path, {goal['reason'].or_none(JsonValue.text) or 'not known'}"
        tone: Tone = "good" if is_found else "note" if is_found is None else "error"
        points_xy = np.array([_xy(pose) for pose in goal["points"].items()]).reshape(-1, 2)
        if is_found and len(points_xy):
            text = f"path of {_metres(goal['length_m'].number())}"
            items.append(_along(Item("route", f"goal {label}: {text}", tone), points_xy))
        items.append(Item("goal", short(f"goal {label}: {text}"), tone, place, label=short(label)))
        rows.append((label, text))
        missed += [] if is_found else [f"{label} ({text})"]
        for change in goal.items_of("changes"):
            described = short(change["text"].text())
            rows.append((f"{label}: makes a path", described))
            if change.get("map") is not None:
                items.append(Item("passage", described, "warning", _place(change)))
    title = f"Plans of {document['planner']['plugin'].text()}"
    tones = [item.tone for item in items if item.kind == "goal"]
    state: State = "error" if "error" in tones else "unknown" if "note" in tones else "good"
    goals = count_text(len(tones), "goal")
    words = f"The robot's planner finds a path to {tones.count('good')} of {goals}"
    words += f". Not to: {'; '.join(missed[:MOST_CLAIMS])}" if missed else ""
    claims, maps = (Claim("goals", state, words, title),), _maps(document, "map")
    return Results(json_values.PLAN, items, [Table(title, tuple(rows))], maps=maps, claims=claims)


def _xy(numbers: JsonValue) -> Point:
    pose = [number.number() for number in numbers.items()]
    if len(pose) != 3:
        raise numbers.error("must be [x, y, yaw]")
    return pose[0], pose[1]


def _route_graph(document: JsonValue) -> Results:
    graph = parsed_graph(document).graph
    if not len(graph.edges):
        return Results(json_values.ROUTE_GRAPH)
    lines = graph.points_xy[np.unique(np.sort(graph.ends, axis=1), axis=0)]
    nodes, edges = count_text(len(graph.nodes), "node"), count_text(len(graph.edges), "edge")
    items = [Item("graph", f"route graph of {nodes} and {edges}", "note", lines=tuple(lines))]
    items += _shortened(map(_node_item, graph.nodes), "graph")
    lengths = f"{float(graph.lengths.sum()):.6g} m, each direction by itself"
    rows = (("nodes", str(len(graph.nodes))), ("edges", str(len(graph.edges))), ("length", lengths))
    return Results(json_values.ROUTE_GRAPH, items, [Table("Route graph", rows)])


def _node_item(node: route_graph.RouteNode) -> Item:
    metadata = ", ".join(f"{key} {value}" for key, value in node.metadata.items())
    place = (node.x, node.y)
    label = short(str(node.metadata.get("name") or ""))
    text = ": ".join(filter(None, (f"node {node.id} at {place_text(place)}", metadata)))
    return Item("graph", short(text), "note", place, label=label)


def shape_items(shapes: Sequence[Shape], zones: Sequence[Zone] = ()) -> list[Item]:
    items: Iterable[Item] = map(_shape_item, shapes)
    if len(zones) == len(shapes):
        items = map(_zone_item, items, zones)
    return _shortened(items, "shape")


def _zone_item(item: Item, zone: Zone) -> Item:
    speed = "" if zone.speed is None else f", speed {zone.speed:g} %"
    name = f"{zone.name}: " if zone.name else ""
    text = short(f"{name}{zone.kind} zone{speed}, {item.text}")
    return replace(item, text=text, label=zone.name or zone.kind, zone=zone)


def zones_in(document: object) -> list[Zone]:
    features = document.get("features") if isinstance(document, dict) else None
    zones = []
    for feature in features if isinstance(features, list) else ():
        geometry, known = (feature.get(name) for name in ("geometry", "properties"))
        if not isinstance(geometry, dict) or geometry.get("type") != "Polygon":
            return []
        known = known if isinstance(known, dict) else {}
        kind, name, speed = (known.get(key) for key in ("kind", "name", "speed"))
        number = None if isinstance(speed, bool) or not isinstance(speed, int | float) else speed
        if kind not in filters.KINDS:
            return []
        is_speed = kind == "speed" and number is not None and 0 < number <= _LARGEST
        label = short(name) if isinstance(name, str) else ""
        zones.append(Zone(kind, number if is_speed else None, label))
    return zones


def _shape_item(shape: Shape) -> Item:
    lines: tuple[NDArray[np.float64], ...] = ()
    text, place = shape.kind, None
    if isinstance(shape, Polygon):
        rings = (shape.points_xy, *shape.holes_xy)
        lines = tuple(np.array([*ring, ring[0]], dtype=np.float64) for ring in rings)
        text = f"polygon with {len(shape.points_xy)} corners"
        text += f" and {count_text(len(shape.holes_xy), 'hole')}" if shape.holes_xy else ""
    elif isinstance(shape, Line):
        lines = (np.array(shape.points_xy, dtype=np.float64),)
        text = f"line through {len(shape.points_xy)} points"
        text += f", {_metres(shape.thickness)} thick" if shape.thickness else ""
    elif isinstance(shape, Circle):
        numbers = np.arange(_CORNERS_OF_CIRCLE + 1) % _CORNERS_OF_CIRCLE
        angles = numbers * (2 * np.pi) / _CORNERS_OF_CIRCLE
        unit = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        lines = (np.array(shape.center_xy, dtype=np.float64) + shape.radius * unit,)
        text = f"circle of radius {_metres(shape.radius)}"
    if lines:
        place = tuple(((lines[0].min(axis=0) + lines[0].max(axis=0)) / 2).tolist())
    text += "" if shape.value is None else f", value {shape.value}"
    return Item("shape", text, place=place, lines=lines)


def _maps(document: JsonValue, *keys: str) -> tuple[NamedMap | None, ...]:
    return tuple(document.optional(key, json_values.named_map) for key in keys)


def _alignment(document: JsonValue) -> Results:
    transform, is_same = _transform(document["transform"]), document["same_place"].flag()
    reason = short(document["reason"].or_none(JsonValue.text) or "")
    shares = [document[key].number(least=0, most=1) for key in ("overlap", "agreement")]
    rows = (
        ("same place", "yes" if is_same else f"uncertain: {reason}"),
        ("transform", _transform_text(transform)),
        ("score", f"{document['score'].number(least=0):.2f}"),
        ("best score elsewhere", f"{document['runner_up'].number(least=0):.2f}"),
        ("overlap", f"{100 * shares[0]:.0f} %"),
        ("walls in common that agree", f"{100 * shares[1]:.0f} %"),
        *map(_candidate_row, count(1), document.items_of("candidates")),
    )
    tables = [Table("Alignment", rows)]
    maps = _maps(document, "first", "second")
    words = f"The two maps overlap by {100 * shares[0]:.0f} %, "
    words += f"and {100 * shares[1]:.0f} % of their common walls agree"
    if not is_same:
        words = f"It is uncertain whether the two maps show the same place: {reason}"
    claim = Claim("geometry", "good" if is_same else "warning", words, "Alignment")
    found: Any = {"tables": tables, "maps": maps, "transform": transform, "claims": (claim,)}
    return Results(json_values.ALIGNMENT, **found)


def _diff(document: JsonValue) -> Results:
    kind = json_values.document_kind(document.value) or ""
    is_of_costs, maps = kind == json_values.COST_DIFF, _maps(document, "first", "second")
    rows = [(key, "yes" if document[key].flag() else "no") for key in ("equal", "passes")]
    for title, named in zip(("first map", "second map"), maps, strict=True):
        rows += [] if named is None else [(title, short(named.file))]
    counts = _COUNTS.keys() - ({"beyond_tolerance"} if is_of_costs else set())
    rows += [(name, str(document[key].integer())) for key, name in _COUNTS.items() if key in counts]
    pairs, tolerance = _pairs(document["geometry"]), None
    if is_of_costs:
        rows.append(("cost scale", document["cost_scale"].word(*get_args(CostScale))))
        moved: JsonValue | None = document["transform"]
    else:
        symmetry = document["symmetry"].or_none(JsonValue.text)
        if symmetry is not None:
            rows.append(("the second is much more like it", f"if it is {short(symmetry)}"))
        for key in ("first_to_second", "second_to_first"):
            shift = document["walls"][key].or_none(_shift) or "no obstacles"
            rows.append((f"directed Hausdorff distance, {key.replace('_', ' ')}", shift))
        pairs |= _pairs(document["metadata"])
        moved, tolerance = document.get("transform"), document.get("tolerance")
    bounds = document["bounds"].fields()
    for name, bound in bounds.items():
        rows.append((short(name), f"at most {_verdict(bound, 'nothing to compare', 0)}"))
    tables = [Table("What differs", tuple(rows))]
    tables += [Table(GEOMETRY, tuple(pairs.items()))] if pairs else []
    if not is_of_costs:
        counted = []
        for state, row in document["confusion"].fields().items():
            counted += [(short(f"{state} → {second}"), str(count.value))
                        for second, count in row.fields().items() if count.integer()]  # fmt: skip
        tables.append(Table("Cells, first → second", tuple(counted)))
    missed = " and ".join(name for name, bound in bounds.items() if not bound["holds"].flag())
    about: About = "cells" if is_of_costs else "obstacles"
    words = f"The bound on {short(missed)} does not hold"
    return Results(
        kind, tables=tables, maps=maps,
        transform=None if moved is None else moved.or_none(_transform),
        tolerance=0.0 if tolerance is None else tolerance.number(least=0),
        claims=(Claim(about, "error", words, tables[0].title),) if missed else (),
    )  # fmt: skip


def _robot_diff(document: JsonValue) -> Results:
    robots = tuple(map(_named_robot, document["robots"].items()))
    if len(robots) != 2 or not all(robot.files for robot in robots):
        raise document["robots"].error("must be two robots with parameter files")
    start = tuple(number.number() for number in document["start"].items())
    reaches = document["reach"].items()[:1]  # both have the same goals
    goals = tuple(goal_of(goal).goal for answer in reaches for goal in answer["goals"].items())
    maps = _maps(document, "map", "mask")
    return Results(json_values.ROBOT_DIFF, maps=maps, start=start, goals=goals, robots=robots)


def _named_robot(robot: JsonValue) -> NamedRobot:
    costmap = cast("CostmapName", robot["costmap"].word(*get_args(CostmapName)))
    files = _named_files(robot, "file")
    return NamedRobot(files, costmap, robot["namespace"].or_none(JsonValue.text))


def passage_change_items(passages: Iterable[Passage], word: str, tone: Tone) -> list[Item]:
    pairs = zip(passage_items(passages), passages, strict=False)
    return [replace(item, tone=tone, text=f"passage that {word}: {passage_text(passage)}")
            for item, passage in pairs]  # fmt: skip


def cost_change_items(changes: Iterable[CostChange], frame: Frame) -> list[Item]:
    listed = [region for change in changes for region in change.largest[:_MOST_OF_A_CHANGE]]
    items = change_items(listed, sum(change.regions for change in changes) - len(listed), frame)
    return [replace(item, lines=()) if item.kind in ("rose", "fell") else item for item in items]


def _candidate_row(number: int, candidate: JsonValue) -> tuple[str, str]:
    score, against = (candidate[key].number(least=0) for key in ("score", "contradicting_m"))
    text = f"{_transform_text(_transform(candidate))}; {against:.1f} m of walls in free space"
    return f"candidate {number}, score {score:.2f}", text


def _transform_text(transform: Transform) -> str:
    x, y, yaw = transform.pose
    return f"x {x:.4g} m, y {y:.4g} m, yaw {math.degrees(yaw):.4g} degrees"


def _transform(document: JsonValue) -> Transform:
    return Transform(*(document[key].number() for key in ("x", "y", "yaw")))


def _shift(document: JsonValue) -> str:
    keys = "largest", "percentile_95", "mean"
    largest, most, mean = (_metres(document[key].number(least=0)) for key in keys)
    return f"{largest}; 95 % within {most}, mean {mean}"


def _verdict(bound: JsonValue, absent: str, least: float) -> str:
    most = max(-least, FARTHEST)
    allowed = bound["allowed"].number(least=least, most=most)
    found = bound["found"].or_none(lambda value: value.number(least=least, most=most))
    verdict = "holds" if bound["holds"].flag() else "missed"
    return f"{allowed:g}: {verdict}, {absent if found is None else f'found {found:.9g}'}"


def _pairs(document: JsonValue) -> dict[str, str]:
    found = {}
    for name, pair in document.fields().items():
        values = pair.items()
        if len(values) != 2:
            raise pair.error("must be two values")
        found[short(name)] = short(f"{values[0].json_text()} → {values[1].json_text()}")
    return found


def change_items(changes: Sequence[Change], unlisted: int, frame: Frame) -> list[Item]:
    items, room = [], MOST_POINTS
    for number, change in enumerate(changes, start=1):
        lines = outlines_of(change.cells, frame)
        count = sum(map(len, lines))
        lines = lines if count <= room else []  # of a map that has nothing in common with the other
        room -= count if lines else 0
        at = place_text([round(change.x, 2), round(change.y, 2)])
        text = f"{number}. {decimal_text(change.area, 3)} m2 at {at}"
        place = (change.x, change.y)
        items.append(Item(change.kind, text, "plain", place, tuple(lines), str(number)))
    if unlisted:
        items.append(Item(changes[-1].kind, f"{count_text(unlisted, 'smaller change')} not listed"))
    return items


def _comparison(document: JsonValue) -> Results:
    for name in document["inputs"].items():
        name.text()
    document["width"].integer(1), document["height"].integer(1)
    document["resolution"].number(least=1e-6)
    if len([number.number() for number in document["origin"].items()]) != 3:
        raise document["origin"].error("must be three numbers [x, y, yaw]")
    parts = [_method(name, method) for name, method in document["methods"].fields().items()]
    rows = []
    for pair in document["pairs"].items():
        names = short(f"{pair['first'].text()}, {pair['second'].text()}")
        rows.append((names, str(pair["differing"].integer())))
    tables = [*(part.tables[0] for part in parts), Table("Differing cells", tuple(rows))]
    return Results(json_values.COMPARISON, [], tables, parts)


def _method(name: str, document: JsonValue) -> Results:
    rows = []
    for key, figure in document.fields().items():
        if key not in ("parameters", "vanished"):
            text = "-" if figure.is_null else f"{figure.number(most=_LARGEST):.9g}"
            rows.append((short(key.replace("_", " ")), text))
    items = []
    for place in document["vanished"].items():
        count, group = count_text(place["cells"].integer(), "cell"), short(f"{name}: hits vanished")
        text = short(f"{name}: {count} with hits vanished")
        items.append(Item("finding", text, "note", _place(place), group=group))
    listed = _shortened(items, "group of hits")
    table = Table(short(f"Method {name}"), tuple(rows))
    return Results(json_values.COMPARISON, listed, [table], name=name)


def _score(document: JsonValue) -> Results:
    truth, moved, lattice = document["truth"], document["transform"], document["lattice"]
    rows = [("bound", _bound(bound)) for bound in document["bounds"].items()]
    truth_file = None if truth.is_null else truth["file"].text()
    if not moved.is_null:
        x, y, yaw = _transform(moved).pose
        rows.append(("truth", short(truth_file or "no file")))
        if x or y or yaw:
            rows.append(("moved by", f"x {x:.6g} m, y {y:.6g} m, yaw {math.degrees(yaw):.6g} deg"))
    size = f"{lattice['width'].integer(1)} x {lattice['height'].integer(1)} cells of "
    size += f"{lattice['resolution'].number(least=1e-6):.6g} m"
    rows.append(("size" if moved.is_null else "compared on", size))
    figures, names = _figures(document["values"]), figures_named(with_truth=not moved.is_null)
    for name in (name for name in names if name in figures):
        unit, meaning = names[name]
        rows.append((f"{meaning} ({name})", figure_text(figures[name], unit)))
    for name, value in figures.items():
        if name not in names and name != "resolution_m":
            rows.append((short(name), "-" if value is None else f"{value:.6g}"))
    verdict = "passes" if document["passes"].flag() else "does not pass"
    title = f"Score: {verdict}" if document["bounds"].items() else "Score"
    table = Table(title, tuple(rows[:_MOST_ROWS]))
    return Results(json_values.SCORE, tables=[table], maps=_maps(document, "map"), truth=truth_file)


def _bound(bound: JsonValue) -> str:
    side = "at least" if bound["side"].word("min", "max") == "min" else "at most"
    return f"{short(bound['name'].text())} {side} {_verdict(bound, 'not measured', -_LARGEST)}"


def _figures(values: JsonValue) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for name, value in values.fields().items():
        if isinstance(value.value, dict):
            found |= {f"{name}.{part}": _figure(inner) for part, inner in value.fields().items()}
        elif not isinstance(value.value, list):  # sizes are also in the lattice
            found[name] = _figure(value)
    return found


def _figure(value: JsonValue) -> float | None:
    return value.or_none(lambda figure: figure.number(least=-_LARGEST, most=_LARGEST))


def _shortened(items: Iterable[Item], noun: str) -> list[Item]:
    remaining = iter(items)
    listed = list(islice(remaining, MOST_ITEMS))
    if unlisted := sum(1 for _ in remaining):
        text = f"{count_text(unlisted, f'more {noun}')} not listed"
        listed.append(Item(listed[0].kind, text, "note"))
    return listed


def short(text: str) -> str:
    line = one_line(text)
    return line if len(line) <= _LONGEST else f"{line[:_LONGEST]}..."


def _metres(value: float) -> str:
    return f"{value:.4g} m" if math.isfinite(value) else "-"


_READERS: dict[str | None, Callable[[JsonValue], Results]] = {
    json_values.LINT: _lint, json_values.REACH: _reach, json_values.ROUTE: _route,
    json_values.DIFF: _diff, json_values.COST_DIFF: _diff,
    json_values.ROBOT_DIFF: _robot_diff, json_values.COMPARISON: _comparison,
    json_values.SCORE: _score, json_values.ALIGNMENT: _alignment,
    json_values.ROUTE_GRAPH: _route_graph, json_values.PLAN: _plan,
}  # fmt: skip


@dataclass(frozen=True)
class ReachQuestion:
    start: tuple[float, ...]
    goals: tuple[Goal, ...]
    robot: tuple[str, ...]
    planner: str = "route"


def robot_words(footprint: Footprint | None) -> tuple[str, ...]:
    if footprint is None:
        return ()
    if footprint.vertices:
        return ("--footprint", json.dumps([list(corner) for corner in footprint.vertices]))
    return ("--robot-radius", f"{footprint.radius:.9g}")


def typed_path(path: Path) -> str:
    """Return the name of a file from the working folder, absolute if they share only the root."""
    text, folder = str(path), source.absolute_path(Path())
    if len({*path.parents} & {folder, *folder.parents}) > 1:
        text = os.path.relpath(path)
    return f"./{text}" if text.startswith("-") else text
