"""The JSON documents of lint, reach, route, diff, align, score and build --compare, on a page.

They may come from elsewhere: each value is checked, and an error names the file and the key.
Numbers that JSON does not have, an infinite width for instance, are null there.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import NamedTuple, cast, get_args

import numpy as np
from numpy.typing import NDArray

from mapdeal.checks.findings import SEVERITIES, Finding, Severity
from mapdeal.commands.diff_robots import passage_text
from mapdeal.commands.report_next import ReachQuestion, robot_words
from mapdeal.compare.bounds import figure_text, figures_named
from mapdeal.compare.costs import CostChange
from mapdeal.compare.difference import Change
from mapdeal.errors import MalformedInputError, ParameterError, one_line
from mapdeal.files.json_values import (
    ALIGNMENT,
    COMPARISON,
    COST_DIFF,
    DIFF,
    LINT,
    REACH,
    ROBOT_DIFF,
    ROUTE,
    ROUTE_GRAPH,
    SCORE,
    JsonValue,
    NamedMap,
    document_kind,
    named_map,
    read_document,
)
from mapdeal.files.source import head_of
from mapdeal.grid.filters import KINDS
from mapdeal.grid.footprint import Footprint, checked_corners
from mapdeal.grid.frame import FARTHEST, Frame, Point, Transform
from mapdeal.grid.reach import (
    MOST_HEADINGS,
    Bottleneck,
    Goal,
    GoalReach,
    Method,
    Passage,
    PlaceOfLimit,
    Route,
    robot_text,
)
from mapdeal.grid.route_graph import RouteNode
from mapdeal.grid.shapes import Circle, Line, Polygon, Shape
from mapdeal.grid.values import CostScale, count_text, decimal_text
from mapdeal.inputs.kinds import SHAPES, recognised
from mapdeal.maps.route_graphs import parsed_graph
from mapdeal.maps.shapes import geojson_shapes, read_shapes
from mapdeal.report.document import About, Claim, Item, ItemKind, Table, Tone, Zone
from mapdeal.report.outlines import outlines_of
from mapdeal.report.verdict import GEOMETRY, on_findings, on_goals
from mapdeal.ros.robot import CostmapName

MOST_ITEMS = 1000
"""Of one kind: nobody looks through more, and a page with a million of them opens nowhere."""

MOST_POINTS = 20_000
"""Of a route on a page, which would grow by some megabytes for a million of them."""

_MOST_OF_A_CHANGE = 5  # regions that are listed of costs that changed in one way
MOST_CHANGES = 20  # places that are listed of obstacles that are new, or gone
_MOST_ROWS = 200
_LONGEST = 400
_CORNERS_OF_CIRCLE = 64
_WIDEST, _MOST_CORNERS = 1000.0, 500
"""Largest coordinate of a robot's corner, metres, and how many corners it may have."""

_LARGEST = FARTHEST**2
_WANTED = (
    "what lint, reach, route, diff, align, score or build --compare writes as JSON, nor a file of "
    "shapes"
)
Row = tuple[str, str]


@dataclass(frozen=True)
class Part:
    """What a document says of one of several maps, or of one of several ways to make one."""

    name: str
    items: list[Item]
    tables: list[Table]
    is_map: bool = True
    is_clean: bool = False
    claims: tuple[Claim, ...] = ()


@dataclass(frozen=True)
class Subject:
    """The robot or costmap that a result is about; a part of the key may be None, for unknown."""

    kind: str
    key: tuple[object, ...]
    text: str

    def differs(self, earlier: Subject) -> bool:
        pairs = zip(self.key, earlier.key, strict=True)
        return any(a != b for a, b in pairs if a is not None and b is not None)


_RADIUS_DIGITS = 4


def robot_subject(text: str, inscribed: float, circumscribed: float | None) -> Subject:
    """Return a robot by its radii; that of a round robot has no corners beyond it."""
    outer = None if circumscribed is None else round(circumscribed, _RADIUS_DIGITS)
    return Subject("robot", (round(inscribed, _RADIUS_DIGITS), outer), text)


def costmap_subject(name: str, files: Iterable[tuple[str, str]]) -> Subject:
    names, sums = zip(*files, strict=True) if (files := list(files)) else ((), ())
    return Subject("costmap", (name, sums), f"the {name} costmap of {', '.join(names)}")


class NamedFile(NamedTuple):
    file: str
    sha256: str


@dataclass(frozen=True)
class NamedRobot:
    """The parameter files of a robot, and which of its costmaps is read from them."""

    files: tuple[NamedFile, ...]
    costmap: CostmapName
    namespace: str | None


@dataclass(frozen=True)
class Results:
    """What a document says of maps, as a page shows it."""

    kind: str
    items: list[Item] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)
    maps: tuple[NamedMap | None, ...] = ()
    files: tuple[str, ...] = ()  # names of files in it

    transform: Transform | None = None
    tolerance: float = 0.0  # cells
    claims: tuple[Claim, ...] = ()
    subjects: tuple[Subject, ...] = ()
    question: ReachQuestion | None = None
    start: tuple[float, ...] = ()
    goals: tuple[Goal, ...] = ()
    robots: tuple[NamedRobot, ...] = ()  # whose parameters are compared


def read_results(path: Path) -> Results:
    """Return what lint, reach, route, diff, align, score or build --compare wrote, or shapes."""
    if not head_of(path, 1 << 10).removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"{"):
        return Results(SHAPES, shape_items(read_shapes(path)))
    document = read_document(path)
    name = document_kind(document.value)
    if name == SHAPES:
        return Results(SHAPES, shape_items(geojson_shapes(document), zones_in(document.value)))
    if name not in _READERS:
        with recognised(path, _WANTED):
            raise MalformedInputError(f"is not {_WANTED}", source=path)
    return results_of(document)


def results_of(document: JsonValue) -> Results:
    """Return what a document says that a command has written, or would write."""
    try:
        return _READERS[document_kind(document.value)](document)
    except RecursionError:  # a value that is shown, or kept as it is
        raise MalformedInputError("nested too deep", source=document.source) from None


def _lint(document: JsonValue) -> Results:
    files = document.get("parameter_files")
    parts = [_linted(one, is_map=False) for one in ([] if files is None else files.items())]
    parts += [_linted(one, is_map=True) for one in document["maps"].items()]
    for key in ("errors", "warnings", "notes", "suppressed"):
        document[key].integer()
    return Results(LINT, parts=parts, files=tuple(part.name for part in parts))


def _linted(one: JsonValue, *, is_map: bool) -> Part:
    file, repairs = one["file"].text(), one.get("repairs")
    findings = [_finding(found, file) for found in one["findings"].items()]
    counts = Counter(found.severity for found in findings)
    rows = [(f"{severity}s", str(counts[severity])) for severity in SEVERITIES]
    rows.append(("suppressed", str(one["suppressed"].integer())))
    for number, repair in enumerate([] if repairs is None else repairs.items(), start=1):
        rows.append((f"repair {number}", short(repair.text())))
    items = _shortened((item for found in findings for item in _items_of(found)), "finding")
    texts: dict[str, list[str]] = {
        severity: [short(one.message) for one in findings if one.severity == severity]
        for severity in SEVERITIES
    }
    claims = (on_findings(texts),) if is_map else ()
    table = Table("Lint", tuple(rows))
    return Part(file, items, [table], is_map, is_clean=not findings, claims=claims)


def _finding(one: JsonValue, file: str) -> Finding:
    severity = cast("Severity", one["severity"].word(*SEVERITIES))
    line = one["line"].or_none(JsonValue.integer)
    places = tuple(place.point() for place in one["places"].items())
    return Finding(one["check"].text(), severity, file, one["message"].text(), line, places)


def _items_of(found: Finding) -> Iterator[Item]:
    line = f" (line {found.line})" if found.line is not None else ""
    text = short(f"{found.check}: {found.message}{line}")
    # Findings of one check are one line, and so are the places of one finding.
    group = short(f"{found.severity} {found.check}")
    first = found.places[0] if found.places else None
    yield Item("finding", text, found.severity, first, group=group)
    for index, place in enumerate(found.places[1:], start=2):
        text = short(f"{found.check}: place {index} of {len(found.places)}")
        yield Item("finding", text, found.severity, place, group=group)


def _reach(document: JsonValue) -> Results:
    robot, yaw = _robot(document["robot"]), document["start"]["yaw"]
    headings = document["robot"]["headings"].integer(1, MOST_HEADINGS)
    place = _place(document["start"])
    heading = "" if yaw.is_null else f", yaw {yaw.number():.4g}"
    goals = [goal_of(one) for one in document["goals"].items()]
    passages = [passage_of(one) for one in document["passages"].items()]
    is_open = document["through_unknown"].flag()
    areas = [document[f"{name}_m2"].number(least=0) for name in ("reachable", "open", "free")]
    share = document["share"].number(least=0, most=1)
    closed = sum(not one.is_open for one in passages)
    rows = (
        ("robot", robot_text(robot)),
        ("headings", str(headings)),
        ("unknown cells", "open" if is_open else "closed"),
        ("reachable", f"{areas[0]:.6g} m2"),
        ("open to the robot", f"{areas[1]:.6g} m2"),
        ("free", f"{areas[2]:.6g} m2"),
        ("reachable share of free", f"{100 * share:.4g} %"),
        ("goals reached", f"{sum(one.reachable for one in goals)} of {len(goals)}"),
        ("passages", f"{len(passages)}, {closed} of them closed"),
    )
    text = f"start at {_at(place)}{heading}: {robot_text(robot)}"
    start = Item("start", text, place=place, label="start")
    items = [start, *goal_items(goals, robot, headings), *passage_items(passages)]
    fits = min(areas[0] / areas[1], 1.0) if areas[1] else 1.0
    claims = (on_goals(goals, passages, robot, share=fits),)
    subjects = [] if robot is None else [
        robot_subject(
            robot_text(robot), robot.inscribed_radius,
            robot.circumscribed_radius if robot.vertices else None,
        )
    ]  # fmt: skip
    words = (*robot_words(robot), *(("--through-unknown",) if is_open else ()))
    start_pose = place if yaw.is_null else (*place, yaw.number())
    question = ReachQuestion(start_pose, tuple(goal.goal for goal in goals), words)
    costmap, about = document.get("costmap"), document.get("map")
    named = None if about is None else named_map(about)
    if costmap is not None and not costmap.is_null:
        files = [
            (file["name"].text(), file["sha256"].sha256()) for file in costmap["files"].items()
        ]
        subjects.append(costmap_subject(costmap["costmap"].text(), files))
    return Results(
        REACH, items, [Table("What the robot can reach", rows)], claims=claims,
        maps=(named,), files=() if named is None else (named.file,), subjects=tuple(subjects),
        question=question,
    )  # fmt: skip


def _robot(robot: JsonValue) -> Footprint | None:
    corners = robot.get("footprint")
    if corners is None:
        radius = robot["radius"].number(least=0, most=_WIDEST)
        return Footprint.circle(radius) if radius else None
    points = [one.point() for one in corners.items()]
    try:
        return Footprint(
            checked_corners(points, "footprint", within=_WIDEST, least=3, most=_MOST_CORNERS)
        )
    except ParameterError as error:
        raise error.in_file(corners.source, corners.place) from None


def goal_of(one: JsonValue) -> GoalReach:
    name = one.get("name")
    return GoalReach(
        Goal(*_place(one), None if name is None else name.text()), one["reachable"].flag(),
        one["heading_count"].integer(), one["widest_radius_m"].number_or(math.inf),
        one["limited_by"].or_none(_bottleneck), one["reason"].or_none(JsonValue.text),
        one["nearest_open"].or_none(_place),
    )  # fmt: skip


def _bottleneck(one: JsonValue) -> Bottleneck:
    at = cast("PlaceOfLimit", one["at"].word(*get_args(PlaceOfLimit)))
    return Bottleneck(*_place(one), one["width_m"].number_or(math.inf), at)


def passage_of(one: JsonValue) -> Passage:
    ends = [end.point() for end in one["ends"].items()]
    if len(ends) != 2:
        raise one["ends"].error("must be two points [x, y]")
    return Passage(
        *_place(one), one["width_m"].number_or(math.inf), one["cuts_off_m2"].number_or(math.inf),
        one["open"].flag(), (ends[0], ends[1]),
    )  # fmt: skip


def _place(one: JsonValue) -> Point:
    return one["x"].number(), one["y"].number()


def goal_items(
    goals: Iterable[GoalReach], robot: Footprint | None, heading_count: int
) -> list[Item]:
    items = []
    for one in goals:
        place = one.goal.x, one.goal.y
        text = f"goal {one.goal.label}: {'reachable' if one.reachable else 'not reachable'}"
        if one.reachable and robot is not None and robot.vertices:
            text += f" in {one.heading_count} of {count_text(heading_count, 'heading')}"
        if one.reason is not None:
            text += f": {one.stopped_by}"
        elif one.widest_radius == 0:
            text += "; by no robot, however small"
        elif math.isfinite(one.widest_radius):
            text += f"; a round robot gets there with a radius below {_metres(one.widest_radius)}"
        limit = one.limited_by
        if one.reason is None and limit is not None and math.isfinite(limit.width):
            text += f": {limit.text}"
        tone: Tone = "good" if one.reachable else "error"
        items.append(Item("goal", short(text), tone, place, label=short(one.goal.name or "goal")))
    return _shortened(items, "goal")


def passage_items(passages: Iterable[Passage]) -> list[Item]:
    """Return passages, each a line between the obstacles on both sides of it."""
    items = []
    for one in passages:
        width, area = _metres(one.width), f"{decimal_text(one.cut_off)} m2"
        text = f"closed passage of {width}, cuts off {area}"
        tone: Tone = "error"
        if one.is_open:
            text, tone = f"narrow passage of {width}, {area} behind it", "warning"
        line = np.array(one.ends, dtype=np.float64)
        label = f"{100 * one.width:.0f} cm" if one.width < 1 else width
        items.append(Item("passage", text, tone, (one.x, one.y), (line,), label))
    return _shortened(items, "passage")


def _route(document: JsonValue) -> Results:
    route = route_of(document)
    rows = (
        ("method", route.method),
        ("reached", "yes" if route.reached else "no"),
        ("start", _at(route.start)),
        ("goal", _at(route.goal)),
        ("length", _metres(route.length)),
        ("least clearance", _metres(route.min_clearance)),
        ("mean clearance", _metres(route.mean_clearance)),
        ("cost", f"{route.cost:.6g}" if math.isfinite(route.cost) else "-"),
        ("cells expanded", "-" if route.expanded is None else str(route.expanded)),
        ("certainly the cheapest", "yes" if route.optimal else "no"),
    )
    return Results(ROUTE, route_items(route), [Table("Route", rows)])


def route_of(document: JsonValue) -> Route:
    points, minimum = document["points"].points(), document.get("local_minimum")
    nowhere = math.nan if not len(points) else math.inf
    return Route(
        cast("Method", document["method"].word(*get_args(Method))), document["reached"].flag(),
        document["start"].point(), document["goal"].point(), points,
        document["length_m"].number_or(nowhere), document["cost"].number_or(nowhere),
        document["min_clearance_m"].number_or(nowhere),
        None if minimum is None else minimum.or_none(JsonValue.point),
        document["mean_clearance_m"].number_or(nowhere),
        document["expanded"].or_none(JsonValue.integer), document["optimal"].flag(),
    )  # fmt: skip


def route_items(route: Route) -> list[Item]:
    tone: Tone = "good" if route.reached else "error"
    label = "goal" if route.reached else "goal, not reached"
    ends = [
        Item("start", f"start at {_at(route.start)}", place=route.start, label="start"),
        Item("goal", f"{label}, at {_at(route.goal)}", tone, route.goal, label=label),
    ]
    text = f"route by {route.method}"
    points_xy = route.points_xy
    if not len(points_xy):
        return [*ends, Item("route", f"{text}: no way", tone)]
    text += f" of {_metres(route.length)}"
    if math.isfinite(route.min_clearance):
        text += f", at least {_metres(route.min_clearance)} from obstacles"
    if math.isfinite(route.cost):
        text += f", cost {route.cost:.4g}"
    if route.local_minimum is not None:
        text += f"; it ends in a local minimum at {_at(route.local_minimum)}"
    elif not route.reached:
        text += "; it does not reach the goal"
    x, y = points_xy[len(points_xy) // 2].tolist()
    if len(points_xy) > MOST_POINTS:
        chosen = np.linspace(0, len(points_xy) - 1, MOST_POINTS)  # with the first and the last
        points_xy = points_xy[chosen.astype(np.int64)]
    return [*ends, Item("route", text, tone, (x, y), (points_xy,))]


def _route_graph(document: JsonValue) -> Results:
    graph = parsed_graph(document).graph
    if not len(graph.edges):
        return Results(ROUTE_GRAPH)
    lines = graph.points_xy[np.unique(np.sort(graph.ends, axis=1), axis=0)]
    nodes, edges = count_text(len(graph.nodes), "node"), count_text(len(graph.edges), "edge")
    text = f"route graph of {nodes} and {edges}"
    items = [Item("graph", text, "note", lines=tuple(lines))]
    items += _shortened((_node_item(one) for one in graph.nodes), "graph")
    lengths = f"{float(graph.lengths.sum()):.6g} m, each direction by itself"
    rows = (("nodes", str(len(graph.nodes))), ("edges", str(len(graph.edges))), ("length", lengths))
    return Results(ROUTE_GRAPH, items, [Table("Route graph", rows)])


def _node_item(node: RouteNode) -> Item:
    told = ", ".join(f"{key} {value}" for key, value in node.metadata.items())
    text = f"node {node.id} at {_at((node.x, node.y))}" + (f": {told}" if told else "")
    name = node.metadata.get("name")
    label = short(str(name)) if name else ""
    return Item("graph", short(text), "note", (node.x, node.y), label=label)


def shape_items(shapes: Sequence[Shape], zones: Sequence[Zone] = ()) -> list[Item]:
    """Return the shapes of a file; if they are all polygons, `zones` says what each is for."""
    found = (_shape_item(one) for one in shapes)
    if len(zones) == len(shapes):
        found = (_zone_item(*one) for one in zip(found, zones, strict=True))
    return _shortened(found, "shape")


def _zone_item(item: Item, zone: Zone) -> Item:
    speed = "" if zone.speed is None else f", speed {zone.speed:g} %"
    kind = f"{zone.kind} zone{speed}"
    text = f"{zone.name}: {kind}, {item.text}" if zone.name else f"{kind}, {item.text}"
    return replace(item, text=short(text), label=zone.name or zone.kind, zone=zone)


def zones_in(document: object) -> list[Zone]:
    """Return the zones in a file of shapes, if all are polygons that have a zone's kind."""
    features = document.get("features") if isinstance(document, dict) else None
    zones = []
    for one in features if isinstance(features, list) else ():
        geometry, known = (one.get(name) for name in ("geometry", "properties"))
        if not isinstance(geometry, dict) or geometry.get("type") != "Polygon":
            return []
        known = known if isinstance(known, dict) else {}
        kind, name, speed = (known.get(key) for key in ("kind", "name", "speed"))
        number = None if isinstance(speed, bool) or not isinstance(speed, int | float) else speed
        if kind not in KINDS:
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
        angles = np.arange(_CORNERS_OF_CIRCLE + 1) % _CORNERS_OF_CIRCLE * (2 * np.pi)
        angles /= _CORNERS_OF_CIRCLE
        unit = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        lines = (np.array(shape.center_xy, dtype=np.float64) + shape.radius * unit,)
        text = f"circle of radius {_metres(shape.radius)}"
    if lines:
        x, y = ((lines[0].min(axis=0) + lines[0].max(axis=0)) / 2).tolist()
        place = x, y
    text += "" if shape.value is None else f", value {shape.value}"
    return Item("shape", text, place=place, lines=lines)


def _named(document: JsonValue, *keys: str) -> tuple[tuple[NamedMap | None, ...], tuple[str, ...]]:
    maps = tuple(named_map(document[key]) for key in keys)
    return maps, tuple(one.file for one in maps if one is not None)


def _alignment(document: JsonValue) -> Results:
    maps, files = _named(document, "first", "second")
    transform = _transform(document["transform"])
    is_same = document["same_place"].flag()
    reason = document["reason"].or_none(JsonValue.text)
    shares = [document[key].number(least=0, most=1) for key in ("overlap", "agreement")]
    rows = (
        ("same place", "yes" if is_same else f"not sure: {short(reason or '')}"),
        ("transform", _transform_text(transform)),
        ("score", f"{document['score'].number(least=0):.2f}"),
        ("best score elsewhere", f"{document['runner_up'].number(least=0):.2f}"),
        ("overlap", f"{100 * shares[0]:.0f} %"),
        ("walls in common that agree", f"{100 * shares[1]:.0f} %"),
    )
    table = Table("Alignment", rows)
    words = f"The two maps overlap by {100 * shares[0]:.0f} %, "
    words += f"and {100 * shares[1]:.0f} % of their common walls agree"
    if not is_same:
        words = f"It is not sure that the two maps show the same place: {short(reason or '')}"
    claims = (Claim("geometry", "good" if is_same else "warning", words, table.title),)
    return Results(ALIGNMENT, [], [table], [], maps, files, transform, claims=claims)


_COUNTS_OF_DIFF = {
    "common_cells": "common cells", "differing": "differing",
    "beyond_tolerance": "beyond the tolerance", "known_only_in_first": "known in the first alone",
}  # fmt: skip


def _rows_of_diff(document: JsonValue, maps: Iterable[NamedMap | None]) -> list[Row]:
    rows = [(key, "yes" if document[key].flag() else "no") for key in ("equal", "passes")]
    for title, named in zip(("first map", "second map"), maps, strict=True):
        rows += [] if named is None else [(title, short(named.file))]
    for key, title in _COUNTS_OF_DIFF.items():
        if key != "beyond_tolerance" or "confusion" in document.fields():
            rows.append((title, str(document[key].integer())))
    return rows


def _claims_on_bounds(document: JsonValue, about: About, evidence: str) -> tuple[Claim, ...]:
    bounds = document["bounds"].fields()
    missed = [name for name, bound in bounds.items() if not bound["holds"].flag()]
    text = f"The bound on {short(' and '.join(missed))} does not hold"
    return (Claim(about, "error", text, evidence),) if missed else ()


def _diff(document: JsonValue) -> Results:
    maps, files = _named(document, "first", "second")
    rows = _rows_of_diff(document, maps)
    symmetry = document["symmetry"].or_none(JsonValue.text)
    if symmetry is not None:
        rows.append(("the second is much more like it", f"if it is {short(symmetry)}"))
    for key in ("first_to_second", "second_to_first"):
        shift = document["walls"][key].or_none(_shift)
        what = f"directed Hausdorff distance, {key.replace('_', ' ')}"
        rows.append((what, shift or "no obstacles"))
    for name, one in document["bounds"].fields().items():
        rows.append((short(name), _bound_of_diff(one)))
    tables = [Table("What differs", tuple(rows))]
    pairs = {**_pairs(document["geometry"]), **_pairs(document["metadata"])}
    if pairs:
        tables.append(Table(GEOMETRY, tuple(pairs.items())))
    cells = [
        (short(f"{state} → {other}"), count.integer())
        for state, row in document["confusion"].fields().items()
        for other, count in row.fields().items()
    ]
    counted = tuple((what, str(count)) for what, count in cells if count)
    tables.append(Table("Cells, first → second", counted))
    moved, tolerance = document.get("transform"), document.get("tolerance")
    return Results(
        DIFF, [], tables, [], maps, files,
        transform=None if moved is None else moved.or_none(_transform),
        tolerance=0.0 if tolerance is None else tolerance.number(least=0),
        claims=_claims_on_bounds(document, "obstacles", tables[0].title),
    )  # fmt: skip


def _cost_diff(document: JsonValue) -> Results:
    maps, files = _named(document, "first", "second")
    rows = _rows_of_diff(document, maps)
    rows.append(("cost scale", document["cost_scale"].word(*get_args(CostScale))))
    for name, bound in document["bounds"].fields().items():
        rows.append((short(name), _bound_of_diff(bound)))
    tables = [Table("What differs", tuple(rows))]
    if pairs := _pairs(document["geometry"]):
        tables.append(Table(GEOMETRY, tuple(pairs.items())))
    return Results(
        COST_DIFF, [], tables, [], maps, files,
        transform=document["transform"].or_none(_transform),
        claims=_claims_on_bounds(document, "cells", tables[0].title),
    )  # fmt: skip


def _robot_diff(document: JsonValue) -> Results:
    maps, files = _named(document, "map")
    robots = tuple(
        NamedRobot(
            tuple(
                NamedFile(file["file"].text(), file["sha256"].sha256())
                for file in robot["files"].items()
            ),
            cast("CostmapName", robot["costmap"].word(*get_args(CostmapName))),
            robot["namespace"].or_none(JsonValue.text),
        )
        for robot in document["robots"].items()
    )
    if len(robots) != 2 or not all(robot.files for robot in robots):
        raise document["robots"].error("must be two robots with parameter files")
    start = tuple(number.number() for number in document["start"].items())
    reaches = document["reach"].items()[:1]  # both have the same goals
    goals = tuple(goal_of(goal).goal for reach in reaches for goal in reach["goals"].items())
    files += tuple(file.file for robot in robots for file in robot.files)
    return Results(ROBOT_DIFF, maps=maps, files=files, start=start, goals=goals, robots=robots)


def passage_change_items(passages: Iterable[Passage], word: str, tone: Tone) -> list[Item]:
    """Return passages that close or open, as `word` says."""
    return [
        replace(item, tone=tone, text=f"passage that {word}: {passage_text(passage)}")
        for item, passage in zip(passage_items(passages), passages, strict=False)
    ]


def cost_change_items(changes: Iterable[CostChange], frame: Frame) -> list[Item]:
    """Return the largest regions of each change; only those of closed cells with outlines."""
    listed = [region for change in changes for region in change.largest[:_MOST_OF_A_CHANGE]]
    if not listed:
        return []
    items = change_items(listed, sum(change.regions for change in changes) - len(listed), frame)
    return [replace(item, lines=()) if item.kind in ("rose", "fell") else item for item in items]


def _transform_text(one: Transform) -> str:
    return f"x {one.x:.4g} m, y {one.y:.4g} m, yaw {math.degrees(one.yaw):.4g} degrees"


def _transform(one: JsonValue) -> Transform:
    return Transform(*(one[key].number() for key in ("x", "y", "yaw")))


def _shift(one: JsonValue) -> str:
    largest, most, mean = (
        _metres(one[name].number(least=0)) for name in ("largest", "percentile_95", "mean")
    )
    return f"{largest}; 95 % within {most}, mean {mean}"


def _bound_of_diff(one: JsonValue) -> str:
    allowed = one["allowed"].number(least=0)
    found = one["found"].or_none(lambda value: value.number(least=0))
    return f"at most {allowed:g}: {_verdict(one, found, 'nothing to compare')}"


def _verdict(one: JsonValue, found: float | None, absent: str) -> str:
    verdict = "holds" if one["holds"].flag() else "missed"
    return f"{verdict}, {absent if found is None else f'found {found:.9g}'}"


def _pairs(one: JsonValue) -> dict[str, str]:
    found = {}
    for name, pair in one.fields().items():
        values = pair.items()
        if len(values) != 2:
            raise pair.error("must be two values")
        found[short(name)] = short(f"{values[0].shown()} → {values[1].shown()}")
    return found


def change_items(changes: Sequence[Change], left: int, frame: Frame) -> list[Item]:
    """Return the places where obstacles are new or gone, the largest first, as outlines."""
    items = []
    room = MOST_POINTS
    for number, one in enumerate(changes, start=1):
        lines = outlines_of(one.cells, frame)
        count = sum(map(len, lines))
        lines = lines if count <= room else []  # of a map that has nothing in common with the other
        room -= count if lines else 0
        kind: ItemKind = one.kind
        place = one.x, one.y
        at = ", ".join(f"{round(part, 2) + 0.0:.6g}" for part in place)
        text, label = f"{number}. {decimal_text(one.area, 3)} m2 at {at}", str(number)
        items.append(Item(kind, text, "plain", place, tuple(lines), label))
    if left:
        items.append(Item(changes[-1].kind, f"{count_text(left, 'smaller change')} not listed"))
    return items


def _comparison(document: JsonValue) -> Results:
    for one in document["inputs"].items():
        one.text()
    document["width"].integer(1), document["height"].integer(1)
    document["resolution"].number(least=1e-6)
    if len([one.number() for one in document["origin"].items()]) != 3:
        raise document["origin"].error("must be three numbers [x, y, yaw]")
    parts = [_method(name, one) for name, one in document["methods"].fields().items()]
    pairs = {}
    for one in document["pairs"].items():
        pairs[short(f"{one['first'].text()}, {one['second'].text()}")] = one["differing"].integer()
    rows = tuple((name, str(count)) for name, count in pairs.items())
    tables = [table for part in parts for table in part.tables]
    return Results(COMPARISON, [], [*tables, Table("Differing cells", rows)], parts)


def _method(name: str, one: JsonValue) -> Part:
    rows = []
    for key, told in one.fields().items():
        if key not in ("parameters", "vanished"):
            text = "-" if told.is_null else f"{told.number(most=_LARGEST):.9g}"
            rows.append((short(key.replace("_", " ")), text))
    items = []
    for place in one["vanished"].items():
        count = count_text(place["cells"].integer(), "cell")
        text = short(f"{name}: {count} with hits vanished")
        group = short(f"{name}: hits vanished")
        items.append(Item("finding", text, "note", _place(place), group=group))
    table = Table(short(f"Method {name}"), tuple(rows))
    return Part(name, _shortened(items, "group of hits"), [table])


def _score(document: JsonValue) -> Results:
    maps, files = _named(document, "map")
    truth, moved, lattice = document["truth"], document["transform"], document["lattice"]
    rows = [("bound", _bound(one)) for one in document["bounds"].items()]
    truth_file = None if truth.is_null else truth["file"].text()
    if not moved.is_null:
        x, y, yaw = (moved[key].number() for key in ("x", "y", "yaw"))
        rows.append(("truth", short(truth_file or "no file")))
        if x or y or yaw:
            pose = f"x {x:.6g} m, y {y:.6g} m, yaw {math.degrees(yaw):.6g} deg"
            rows.append(("moved by", pose))
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
    files += () if truth_file is None else (truth_file,)
    return Results(SCORE, [], [table], [], maps, files)


def _bound(one: JsonValue) -> str:
    side = "at least" if one["side"].word("min", "max") == "min" else "at most"
    allowed, found = one["allowed"].number(least=-_LARGEST, most=_LARGEST), _figure(one["found"])
    verdict = _verdict(one, found, "not measured")
    return f"{short(one['name'].text())} {side} {allowed:g}: {verdict}"


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
    return value.or_none(lambda one: one.number(least=-_LARGEST, most=_LARGEST))


def _shortened(items: Iterable[Item], what: str) -> list[Item]:
    rest = iter(items)
    listed = list(islice(rest, MOST_ITEMS))
    left = sum(1 for _ in rest)
    if left:
        text = f"{count_text(left, f'more {what}')} not listed"
        listed.append(Item(listed[0].kind, text, "note"))
    return listed


def short(text: str) -> str:
    """Return a text that may come from anywhere as one short line."""
    line = one_line(text)
    return line if len(line) <= _LONGEST else f"{line[:_LONGEST]}..."


def _metres(value: float) -> str:
    return f"{value:.4g} m" if math.isfinite(value) else "-"


def _at(point: Sequence[float]) -> str:
    x, y = point
    return f"{x + 0.0:.6g}, {y + 0.0:.6g}"


_READERS: dict[str | None, Callable[[JsonValue], Results]] = {
    LINT: _lint, REACH: _reach, ROUTE: _route, DIFF: _diff, COMPARISON: _comparison,
    SCORE: _score, ALIGNMENT: _alignment, ROUTE_GRAPH: _route_graph, COST_DIFF: _cost_diff,
    ROBOT_DIFF: _robot_diff,
}  # fmt: skip
