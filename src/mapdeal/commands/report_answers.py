"""The JSON documents of lint, reach, route, diff, align, score and build --compare, read back.

They may come from elsewhere: each value is checked, and an error names the file and the key.
Numbers that JSON does not have, an infinite width for instance, are null there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast, get_args

from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.files.json_values import (
    ALIGNMENT,
    COMPARISON,
    DIFF,
    LINT,
    REACH,
    ROUTE,
    SCORE,
    JsonValue,
    NamedMap,
    document_kind,
    named_map,
    read_document,
)
from mapdeal.files.source import head_of
from mapdeal.grid.footprint import Footprint, checked_corners
from mapdeal.grid.frame import FARTHEST, Origin, Point
from mapdeal.grid.reach import MOST_HEADINGS, Bottleneck, Goal, GoalReach, Passage, PlaceOfLimit
from mapdeal.grid.route import Method, Route
from mapdeal.grid.shapes import Shape
from mapdeal.inputs.kinds import SHAPES, recognised
from mapdeal.maps.shapes import geojson_shapes, read_shapes
from mapdeal.pipeline.documents import AlignmentAnswer, ScoreAnswer, alignment_answer, score_answer

Severity = Literal["error", "warning", "note"]

_WIDEST = 1000.0
"""Largest coordinate of a robot's corner, metres."""
_MOST_CORNERS = 500
_WANTED = (
    "what lint, reach, route, diff, align, score or build --compare writes as JSON, nor a file of "
    "shapes"
)


@dataclass(frozen=True)
class ToldFinding:
    check: str
    severity: Severity
    message: str
    line: int | None = None
    places: tuple[Point, ...] = ()


@dataclass(frozen=True)
class LintedFile:
    """A map, a folder of a run or a parameter file, with the findings of lint."""

    file: str
    findings: tuple[ToldFinding, ...]
    suppressed: int
    is_parameters: bool = False
    repairs: tuple[str, ...] = ()


@dataclass(frozen=True)
class LintAnswer:
    """Content of a document printed by ``mapdeal lint --format json``."""

    files: tuple[LintedFile, ...]
    errors: int
    warnings: int
    notes: int
    suppressed: int


@dataclass(frozen=True)
class ReachAnswer:
    """Content of a document written by ``mapdeal reach``; areas in square metres."""

    robot: Footprint | None
    heading_count: int
    start: tuple[float, ...]
    through_unknown: bool
    reachable_area: float
    open_area: float
    free_area: float
    share: float
    goals: tuple[GoalReach, ...]
    passages: tuple[Passage, ...]


@dataclass(frozen=True, eq=False)
class RouteAnswer:
    """Content of a document written by ``mapdeal route``."""

    route: Route


@dataclass(frozen=True)
class DiffAnswer:
    """Content of a document printed by ``mapdeal diff --json``."""

    first: NamedMap | None
    second: NamedMap | None
    is_equal: bool
    passes: bool
    common_cells: int
    differing: int
    beyond_tolerance: int
    known_only_in_first: int
    geometry: Mapping[str, tuple[str, str]]
    metadata: Mapping[str, tuple[str, str]]
    confusion: Mapping[str, Mapping[str, int]]
    symmetry: str | None
    walls: tuple[Mapping[str, float] | None, Mapping[str, float] | None]
    bounds: Mapping[str, tuple[float, float | None, bool]]


@dataclass(frozen=True)
class ComparedMethod:
    figures: Mapping[str, float | None]
    vanished: tuple[tuple[float, float, int], ...]


@dataclass(frozen=True)
class ComparisonAnswer:
    """Content of ``comparison.json``, written by ``mapdeal build --compare``."""

    inputs: tuple[str, ...]
    width: int
    height: int
    resolution: float
    origin: Origin
    methods: Mapping[str, ComparedMethod]
    differing: Mapping[tuple[str, str], int]


@dataclass(frozen=True)
class ShapesAnswer:
    shapes: tuple[Shape, ...]


Answer = (
    LintAnswer | ReachAnswer | RouteAnswer | DiffAnswer | AlignmentAnswer | ScoreAnswer
    | ComparisonAnswer | ShapesAnswer
)  # fmt: skip


def read_answer(path: Path) -> Answer:
    """Return what lint, reach, route, diff, align, score or build --compare wrote, or shapes."""
    if not head_of(path, 1 << 10).removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"{"):
        return ShapesAnswer(tuple(read_shapes(path)))
    document = read_document(path)
    name = document_kind(document.value)
    if name == SHAPES:
        return ShapesAnswer(tuple(geojson_shapes(document)))
    if name not in _READERS:
        with recognised(path, _WANTED):
            raise MalformedInputError(f"is not {_WANTED}", source=path)
    try:
        return _READERS[name](document)
    except RecursionError:  # a value that is shown, or kept as it is
        raise MalformedInputError("nested too deep", source=path) from None


def _lint(document: JsonValue) -> LintAnswer:
    files = document.get("parameter_files")
    of_parameters = [] if files is None else files.items()
    listed = [_linted(one, is_parameters=True) for one in of_parameters]
    listed += [_linted(one, is_parameters=False) for one in document["maps"].items()]
    counts = (document[key].whole() for key in ("errors", "warnings", "notes", "suppressed"))
    return LintAnswer(tuple(listed), *counts)


def _linted(one: JsonValue, *, is_parameters: bool) -> LintedFile:
    repairs = one.get("repairs")
    return LintedFile(
        one["file"].text(), tuple(_finding(found) for found in one["findings"].items()),
        one["suppressed"].whole(), is_parameters,
        () if repairs is None else tuple(repair.text() for repair in repairs.items()),
    )  # fmt: skip


def _finding(one: JsonValue) -> ToldFinding:
    line = one["line"]
    return ToldFinding(
        one["check"].text(), cast("Severity", one["severity"].word(*get_args(Severity))),
        one["message"].text(), None if line.is_null else line.whole(),
        tuple(place.point() for place in one["places"].items()),
    )  # fmt: skip


def _reach(document: JsonValue) -> ReachAnswer:
    start, yaw = document["start"], document["start"]["yaw"]
    goals = document["goals"].items()
    return ReachAnswer(
        _robot(document["robot"]), document["robot"]["headings"].whole(1, MOST_HEADINGS),
        (*_place(start), *(() if yaw.is_null else (yaw.number(),))),
        document["through_unknown"].flag(), document["reachable_m2"].number(least=0),
        document["open_m2"].number(least=0), document["free_m2"].number(least=0),
        document["share"].number(least=0, most=1), tuple(_goal(one) for one in goals),
        tuple(_passage(one) for one in document["passages"].items()),
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


def _goal(one: JsonValue) -> GoalReach:
    name, limit = one.get("name"), one["limited_by"]
    reason, nearest = one["reason"], one["nearest_open"]
    return GoalReach(
        Goal(*_place(one), None if name is None else name.text()), one["reachable"].flag(),
        one["heading_count"].whole(), one["widest_radius_m"].number_or(math.inf),
        None if limit.is_null else _bottleneck(limit), None if reason.is_null else reason.text(),
        None if nearest.is_null else _place(nearest),
    )  # fmt: skip


def _bottleneck(one: JsonValue) -> Bottleneck:
    at = cast("PlaceOfLimit", one["at"].word(*get_args(PlaceOfLimit)))
    return Bottleneck(*_place(one), one["width_m"].number_or(math.inf), at)


def _passage(one: JsonValue) -> Passage:
    ends = [end.point() for end in one["ends"].items()]
    if len(ends) != 2:
        raise one["ends"].error("must be two points [x, y]")
    return Passage(
        *_place(one), one["width_m"].number_or(math.inf), one["cuts_off_m2"].number_or(math.inf),
        one["open"].flag(), (ends[0], ends[1]),
    )  # fmt: skip


def _place(one: JsonValue) -> Point:
    return one["x"].number(), one["y"].number()


def _route(document: JsonValue) -> RouteAnswer:
    points = document["points"].points()
    nowhere = math.nan if not len(points) else math.inf
    minimum, expanded = document.get("local_minimum"), document["expanded"]
    route = Route(
        cast("Method", document["method"].word(*get_args(Method))), document["reached"].flag(),
        document["start"].point(), document["goal"].point(), points,
        document["length_m"].number_or(nowhere), document["cost"].number_or(nowhere),
        document["min_clearance_m"].number_or(nowhere),
        None if minimum is None or minimum.is_null else minimum.point(),
        document["mean_clearance_m"].number_or(nowhere),
        None if expanded.is_null else expanded.whole(), document["optimal"].flag(),
    )  # fmt: skip
    return RouteAnswer(route)


def _diff(document: JsonValue) -> DiffAnswer:
    symmetry, walls = document["symmetry"], document["walls"]
    return DiffAnswer(
        named_map(document["first"]), named_map(document["second"]), document["equal"].flag(),
        document["passes"].flag(), document["common_cells"].whole(), document["differing"].whole(),
        document["beyond_tolerance"].whole(), document["known_only_in_first"].whole(),
        _pairs(document["geometry"]), _pairs(document["metadata"]),
        {
            state: {other: cells.whole() for other, cells in row.fields().items()}
            for state, row in document["confusion"].fields().items()
        },
        None if symmetry.is_null else symmetry.text(),
        (_shift(walls["first_to_second"]), _shift(walls["second_to_first"])),
        {name: _bound(one) for name, one in document["bounds"].fields().items()},
    )  # fmt: skip


def _pairs(one: JsonValue) -> dict[str, tuple[str, str]]:
    """Return values of both maps as they stand in the document."""
    found = {}
    for name, pair in one.fields().items():
        values = pair.items()
        if len(values) != 2:
            raise pair.error("must be two values")
        found[name] = (values[0].shown(), values[1].shown())
    return found


def _shift(one: JsonValue) -> dict[str, float] | None:
    if one.is_null:
        return None
    return {name: one[name].number(least=0) for name in ("largest", "percentile_95", "mean")}


def _bound(one: JsonValue) -> tuple[float, float | None, bool]:
    found = one["found"]
    return (
        one["allowed"].number(least=0),
        None if found.is_null else found.number(least=0),
        one["holds"].flag(),
    )


def _comparison(document: JsonValue) -> ComparisonAnswer:
    origin = [one.number() for one in document["origin"].items()]
    if len(origin) != 3:
        raise document["origin"].error("must be three numbers [x, y, yaw]")
    return ComparisonAnswer(
        tuple(one.text() for one in document["inputs"].items()), document["width"].whole(1),
        document["height"].whole(1), document["resolution"].number(least=1e-6),
        (origin[0], origin[1], origin[2]),
        {name: _method(one) for name, one in document["methods"].fields().items()},
        {
            (one["first"].text(), one["second"].text()): one["differing"].whole()
            for one in document["pairs"].items()
        },
    )  # fmt: skip


def _method(one: JsonValue) -> ComparedMethod:
    apart = ("parameters", "vanished")
    figures = {name: told for name, told in one.fields().items() if name not in apart}
    return ComparedMethod(
        {name: None if f.is_null else f.number(most=FARTHEST**2) for name, f in figures.items()},
        tuple((*_place(place), place["cells"].whole()) for place in one["vanished"].items()),
    )


_READERS: dict[str | None, Callable[[JsonValue], Answer]] = {
    LINT: _lint, REACH: _reach, ROUTE: _route, DIFF: _diff, COMPARISON: _comparison,
    SCORE: score_answer, ALIGNMENT: alignment_answer,
}  # fmt: skip
