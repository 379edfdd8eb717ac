import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mapdeal.checks.findings import Finding
from mapdeal.checks.lint import LintReport, MapReport
from mapdeal.commands import report_documents
from mapdeal.commands.report_documents import MOST_ITEMS, goal_items, goal_of, read_results
from mapdeal.commands.route import PlannedRoute
from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.files.json_values import JsonValue, read_document
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import Bottleneck, Goal, GoalReach, Passage, Reach, Route, robot_text
from mapdeal.pipeline.folder import reach_document
from pipeline.test_odd_documents import with_part
from robustness.seeds import ANSWERS

ALIGNMENT, COMPARISON, DIFF, LINT, REACH, ROUTE, SCORE = (
    ANSWERS[name] for name in ["alignment", "comparison", "diff", "lint", "reach", "route", "score"]
)


@pytest.fixture
def read(tmp_path):
    def read(document, name="answer.json"):
        path = tmp_path / name
        path.write_bytes(document if isinstance(document, bytes) else json.dumps(document).encode())
        return read_results(path)

    return read


ROWS = {
    "reach": (REACH, {
        "robot": "a robot with 3 corners, radius 0.09487 to 0.3606 m", "headings": "16",
        "unknown cells": "closed", "reachable": "8.5 m2", "open to the robot": "12 m2",
        "free": "20.25 m2", "reachable share of free": "42 %", "goals reached": "1 of 2",
        "passages": "1, 1 of them closed",
    }),
    "point": ({**REACH, "robot": {"radius": 0, "headings": 1}, "passages": []},
              {"robot": "a point", "passages": "0, 0 of them closed"}),
    "route": ({**ROUTE, "length_m": 3.2, "expanded": 9}, {
        "length": "3.2 m", "cells expanded": "9", "mean clearance": "-",
        "certainly the cheapest": "no",
    }),
    "diff": (DIFF, {
        "width": "3 → 4", "origin": "[0, 0, 0] → [1, 0, 0.5]", "mode": '"trinary" → "scale"',
        "free → free": "9", "free → occupied": "3",
        "directed Hausdorff distance, first to second": "0.5 m; 95 % within 0.4 m, mean 0.1 m",
        "directed Hausdorff distance, second to first": "no obstacles",
        "max_shift": "at most 0.1: missed, nothing to compare",
    }),
    "missed": (
        with_part(DIFF, ("bounds", "max_differing"), {"allowed": 5, "found": 30, "holds": False}),
        {"max_differing": "at most 5: missed, found 30"},
    ),
    "methods": (COMPARISON, {"occupied": "3", "mean thickness m": "-", "tsdf, beams": "5"}),
    "alignment": (ALIGNMENT, {
        "same place": "uncertain: another <place> fits",
        "transform": "x 1.5 m, y -2 m, yaw 14.32 degrees", "score": "3.50",
        "best score elsewhere": "3.25", "overlap": "50 %", "walls in common that agree": "100 %",
    }),
    "score": (SCORE, {
        "truth": "no file", "compared on": "4 x 3 cells of 0.25 m",
        "moved by": "x 1.5 m, y -2 m, yaw 14.3239 deg",
    }),
    "alone": ({**SCORE, "transform": None, "map": None}, {"size": "4 x 3 cells of 0.25 m"}),
}  # fmt: skip


@pytest.mark.parametrize("name", ROWS)
def test_tables_hold_what_documents_say(read, name):
    document, expected = ROWS[name]
    rows = dict(row for table in read(document).tables for row in table.rows)
    assert {key: rows.get(key) for key in expected} == expected
    if name in ("reach", "alignment"):
        assert rows == expected


def test_what_lint_has_found(read):
    results = read(LINT)
    parameters, map_part = results.parts
    assert results.files == ("nav2.yaml", "a<b>.yaml")
    assert (parameters.items, parameters.claims) == ([], ())
    assert (map_part.name, len(map_part.claims)) == ("a<b>.yaml", 1)
    assert dict(map_part.tables[0].rows) == {
        "errors": "0", "warnings": "1", "notes": "1", "suppressed": "2",
        "repair 1": "free_thresh 0.196",
    }  # fmt: skip
    assert [(item.text, item.tone, item.place) for item in map_part.items] == [
        ("map.islands: <img onerror=1>\\n\\x07", "warning", (1.5, -2.0)),
        ("map.islands: place 2 of 2", "warning", (0.0, 3.0)),
        ("yaml.origin-yaw: turned (line 3)", "note", None),
    ]


def test_items_of_reach_and_methods_have_their_places(read):
    start, dock, unreachable, passage = read(REACH).items
    assert (start.place, dock.place, unreachable.place) == ((1.5, -2.0), (3.0, 4.0), (-3.0, 4.0))
    assert start.text.startswith("start at 1.5, -2, yaw 0.5: ")
    assert (dock.text, dock.tone) == ("goal dock: reachable in 7 of 16 headings", "good")
    assert (unreachable.tone, passage.place) == ("error", (-2.0, 1.0))
    assert passage.lines[0].tolist() == [[-2.0, 0.7], [-2.0, 1.3]]
    (tsdf,) = read(COMPARISON).parts
    (item,) = tsdf.items
    assert (item.text, item.place) == ("tsdf: 4 cells with hits vanished", (1.25, 2.5))


@pytest.mark.parametrize(("document", "file"), [
    (DIFF, "a.yaml"), (ALIGNMENT, "a<b>.yaml"), (SCORE, "a<b>.yaml"),
    ({**SCORE, "map": None}, None),
], ids=["diff", "alignment", "score", "no map"])  # fmt: skip
def test_maps_are_named_with_their_sums(read, document, file):
    results = read(document)
    first, *later = results.maps
    assert (first and first.file, [*later]) == (file, [None] * len(later))
    assert results.files == ((file,) if file else ())
    if document is DIFF:
        assert first.sha256 == {"a.yaml": "ab" * 32, "a.pgm": "0" * 64}
    if document is ALIGNMENT:
        assert results.transform.pose == (1.5, -2.0, 0.25)


def test_a_score_lists_its_bounds_first_and_then_its_figures(read):
    (table,) = read(SCORE).tables
    assert table.title == "Score: does not pass"
    first, second, *figures = table.rows
    assert first == ("bound", "coverage at least 0.8: holds, found 0.9")
    assert second == ("bound", "ssim_gauss at most 1: missed, not measured")
    shown = {name.rpartition("(")[2].rstrip(")"): text for name, text in figures}
    assert (shown["coverage"], shown["ssim_gauss"]) == ("90.0 %", "-")
    assert shown["dist_est_to_truth_m.mean"] == "0.5 m"


def values_in(document, key, read):
    return [read(item) for item in JsonValue(Path("answer.json"), document)[key].items()]


def test_keys_that_are_not_known_yet_are_passed_over(read):
    for document in (LINT, REACH, ROUTE, DIFF, COMPARISON, SCORE):
        again, results = read({**document, "new": [{}]}), read(document)
        assert (again.kind, again.tables) == (results.kind, results.tables)
        assert (again.parts == []) == (results.parts == [])


FINDING = ("maps", 0, "findings", 0)
GONE = object()


@pytest.mark.parametrize(("document", "place", "value", "message"), [
    (LINT, (*FINDING, "check"), GONE, "maps[0].findings[0]: must have a key check"),
    (LINT, (*FINDING, "severity"), "bad",
     "maps[0].findings[0].severity: must be one of error, warning, note, got 'bad'"),
    (LINT, (*FINDING, "message"), 7, "maps[0].findings[0].message: must be a text, got 7"),
    (LINT, (*FINDING, "places"), [[1]], '{"x": x, "y": y} or two numbers [x, y], got [1]'),
    (LINT, (*FINDING, "places"), [[1, 1e13]], "must be a number from -1e+12 to 1e+12"),
    (LINT, ("errors",), 1.5, "errors: must be a whole number, got 1.5"),
    (REACH, ("robot", "footprint"), [[0, 0]], "at least three vertices"),
    (REACH, ("goals", 0, "reachable"), "yes", "must be true or false, got 'yes'"),
    (REACH, ("passages", 0, "ends"), [[0, 0]], "passages[0].ends: must be two points"),
    (ROUTE, ("points",), [[0, 1], [True, 2]], "points[1][0]: must be a number, got True"),
    (ROUTE, ("points",), {}, "is not what lint, reach, route, plan of one map, diff, align, score"),
    (DIFF, ("first", "sha256", "a.pgm"), "AB" * 32, "must be the 64 hexadecimal digits"),
    (DIFF, ("geometry", "width"), [1], "geometry.width: must be two values, got [1]"),
    (SCORE, ("values",), {"a": {"b": "c"}}, "values.a.b: must be a number, got 'c'"),
    (SCORE, ("truth",), GONE, "must have a key truth"),
    (COMPARISON, ("origin",), [1, 2], "origin: must be three numbers"),
    (b'{"maps": [' + b"[" * 100_000, (), None, "nested too deep"),
    (b'{"maps": [NaN], "errors": 0, "suppressed": 0}', (), None, "NaN is not a JSON number"),
    (b'{"maps": [], "errors": 1e999, "suppressed": 0}', (), None, "errors: must be a whole num"),
    (b'{"errors": ' + b"7" * 5000 + b"}", (), None, "invalid JSON"),
    (b'{"errors": 0, "errors": 1}', (), None, "key 'errors' appears twice"),
    (b'{"maps": [}', (), None, "line 1, column 11: invalid JSON"),
    (b'{"maps": "\xff"}', (), None, "not UTF-8"),
    (b"{}", (), None, "plan of one map, diff, align, score or build --compare writes as JSON"),
    (b'{"outputs": {}, "stages": []}', (), None, "is the manifest of a run, not what lint"),
    (b"image: a.pgm\nresolution: 1\n", (), None, "is a map, not a file of shapes"),
    (b"", (), None, "answer.json"),
], ids=lambda value: value if isinstance(value, str) else "")  # fmt: skip
def test_what_must_not_be_believed_names_the_key(read, document, place, value, message):
    if place:
        document = with_part(document, place, value, leave_out=value is GONE)
    with pytest.raises(MalformedInputError, match=re.escape(message)) as caught:
        read(document)
    assert "answer.json" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_too_large_or_not_there(tmp_path):
    path = tmp_path / "huge.json"
    with path.open("wb") as file:
        file.write(b'{"maps": []')
        file.truncate((1 << 26) + 1)
    with pytest.raises(MalformedInputError, match="must not be larger than 67108864 bytes"):
        read_results(path)
    with pytest.raises(FileAccessError):
        read_results(tmp_path / "none.json")


NUMBERS = st.floats(-1e4, 1e4).map(lambda value: round(value, 9) + 0.0)
LENGTHS = st.floats(0, 1e4).map(lambda value: round(value, 9)) | st.just(math.inf)
POINTS = st.tuples(NUMBERS, NUMBERS)
LIMITS = st.builds(
    Bottleneck, NUMBERS, NUMBERS, LENGTHS, st.sampled_from(["passage", "start", "goal"])
)
GOALS = st.builds(
    GoalReach, st.builds(Goal, NUMBERS, NUMBERS, st.none() | st.text(max_size=8)), st.booleans(),
    st.integers(0, 255), LENGTHS, st.none() | LIMITS, st.none() | st.text(max_size=8),
    st.none() | POINTS,
)  # fmt: skip
PASSAGES = st.builds(
    Passage, NUMBERS, NUMBERS, LENGTHS, LENGTHS, st.booleans(), st.tuples(POINTS, POINTS)
)
TRIANGLE = Footprint.polygon([(0.3, 0.1), (-0.3, 0.1), (0, -0.2)])


@given(
    start=st.lists(NUMBERS, min_size=2, max_size=3).map(tuple), headings=st.integers(1, 255),
    robot=st.sampled_from([None, Footprint.circle(0.25), TRIANGLE]), through=st.booleans(),
    goals=st.lists(GOALS, max_size=3).map(tuple),
    passages=st.lists(PASSAGES, max_size=3).map(tuple),
)  # fmt: skip
def test_reach_comes_back(tmp_path_factory, start, robot, headings, through, goals, passages):
    layers = [np.ones((2, 3), np.uint8)] * 2 + [np.ones((2, 3), np.float32)] * 2
    reach = Reach(
        *layers, np.zeros((2, 3), np.int8), 0.5, (1.0, 2.0, 0.5), start, robot, headings, through,
        goals, passages,
    )  # fmt: skip
    path = tmp_path_factory.getbasetemp() / "reach_again.json"
    path.write_text(json.dumps(reach_document(reach)))
    document = json.loads(path.read_text())
    assert tuple(values_in(document, "goals", goal_of)) == goals
    assert tuple(values_in(document, "passages", report_documents.passage_of)) == passages
    results = read_results(path)
    place, *items = results.items
    assert place.place == start[:2]
    expected = [*goal_items(goals, robot, headings), *report_documents.passage_items(passages)]
    assert [item.text for item in items] == [item.text for item in expected]
    assert all("from the start" in item.text for item in items if item.text[:6] == "closed")
    rows = dict(results.tables[0].rows)
    assert rows["headings"] == str(headings)
    assert rows["robot"] == robot_text(robot)
    assert rows["unknown cells"] == ("open" if through else "closed")
    assert rows["reachable"] == rows["free"] == "1.5 m2"


@given(
    points=st.lists(POINTS, min_size=1, max_size=5), minimum=st.none() | POINTS,
    expanded=st.none() | st.integers(0, 10**9), figures=st.tuples(*[LENGTHS] * 4),
)  # fmt: skip
def test_routes_come_back(tmp_path_factory, points, minimum, expanded, figures):
    length, cost, least, mean = figures
    route = PlannedRoute(
        "descent", minimum is None, points[0], points[-1], np.array(points), length, cost, least,
        minimum, mean, expanded, False, map=None, costs=None,
    )  # fmt: skip
    path = tmp_path_factory.getbasetemp() / "route_again.json"
    path.write_text("".join(route.parts()))
    found = report_documents.route_of(read_document(path))
    assert [item.kind for item in read_results(path).items] == ["start", "goal", "route"]
    assert found.points_xy.tolist() == [list(point) for point in points]
    summary = (found.start, found.goal, found.local_minimum, found.expanded, found.reached)
    assert summary == (points[0], points[-1], minimum, expanded, minimum is None)
    assert (found.length, found.cost, found.min_clearance, found.mean_clearance) == figures


def test_findings_come_back_as_they_were_written_whatever_they_say(read):
    findings = (
        Finding("image.lossy", "warning", "a\udcff.yaml", 'a "quoted" \u2028 name', 4),
        Finding("yaml.origin", "error", "a\udcff.yaml", "<img onerror=1>\x1b[2J" + "x" * 9999, 3),
        *[Finding("a.b", "error", "a\udcff.yaml", str(k)) for k in range(MOST_ITEMS)],
    )
    maps = (MapReport("a\udcff.yaml", findings, suppressed=1), MapReport("b", (), is_folder=True))
    results = read(json.dumps(LintReport(maps, "1.0").document()).encode())
    assert results.files == ("a\udcff.yaml", "b")
    faulty, sound = results.parts
    first, second, *_, last = faulty.items
    assert (first.text, first.tone) == (r'image.lossy: a "quoted" \u2028 name (line 4)', "warning")
    assert second.text.startswith(r"yaml.origin: <img onerror=1>\x1b[2Jxxx")
    assert (second.text.isprintable(), len(second.text) < 500, second.place) == (True, True, None)
    assert (len(faulty.items), last.text) == (MOST_ITEMS + 1, "2 more findings not listed")
    assert not sound.items
    assert dict(faulty.tables[0].rows) == {
        "errors": str(MOST_ITEMS + 1), "warnings": "1", "notes": "0", "suppressed": "1",
    }  # fmt: skip


@pytest.mark.parametrize(("goal", "robot", "text", "tone"), [
    (GoalReach(Goal(3, 4, "dock"), True, 7, math.inf), TRIANGLE,
     "goal dock: reachable in 7 of 16 headings", "good"),
    (GoalReach(Goal(3, 4), True, 16, 0.31, Bottleneck(-2.0, 1.0, 0.62)), Footprint.circle(0.2),
     ("goal 3,4: reachable; a round robot gets there with a radius below 0.31 m: "
      "a passage at -2,1 is 0.62 m wide"), "good"),
    (GoalReach(Goal(3, 4, "a\nb"), False, 0, 0.0), None,
     r"goal a\nb: not reachable; by no robot, however small", "error"),
])  # fmt: skip
def test_goals_tell_what_limits_them(goal, robot, text, tone):
    (item,) = goal_items([goal], robot, 16)
    assert (item.kind, item.text, item.tone, item.place) == ("goal", text, tone, (3, 4))


POINTS_XY = np.array([[0.0, 1.0], [1.0, 1.0], [2.0, 3.0]])
ENDS = ((0.0, 1.0), (2.0, 3.0))


@pytest.mark.parametrize(("route", "goal", "text", "place"), [
    (Route("astar", True, *ENDS, POINTS_XY, 3.2, 4.5, 0.4, None, 0.5, 9, True), "goal, at 2, 3",
     "route by astar of 3.2 m, at least 0.4 m from obstacles, cost 4.5", (1.0, 1.0)),
    (Route("descent", False, *ENDS, POINTS_XY[:2], 1.0, 1.0, 0.4, (1.0, 1.0)),
     "goal, not reached, at 2, 3", ("route by descent of 1 m, at least 0.4 m from obstacles, cost 1"
     "; it ends in a local minimum at 1, 1"), (1.0, 1.0)),
    (Route("astar", False, *ENDS, [], 0.0, math.nan, math.nan), "goal, not reached, at 2, 3",
     "route by astar: no way", None),
], ids=["reached", "stuck", "no way"])  # fmt: skip
def test_a_route_is_a_line_from_its_start_to_its_goal(route, goal, text, place):
    start, end, line = report_documents.route_items(route)
    assert (start.place, end.place, end.text) == (*ENDS, goal)
    assert end.tone == line.tone == ("good" if route.reached else "error")
    assert (line.text, line.place) == (text, place)
    drawn = np.concatenate([*line.lines, np.empty((0, 2))])
    assert np.array_equal(drawn, np.reshape(route.points_xy, (-1, 2)))


def test_shapes_of_either_form_have_outlines(read):
    point = {"type": "Point", "coordinates": [1, 2]}
    (circle,) = read({"type": "Feature", "properties": {"radius": 0.5}, "geometry": point}).items
    assert (circle.text, circle.place) == ("circle of radius 0.5 m", (1.0, 2.0))
    (around,) = circle.lines
    assert around[0].tolist() == around[-1].tolist() == [1.5, 2.0]
    assert np.allclose(np.hypot(around[:, 0] - 1, around[:, 1] - 2), 0.5)
    gaps = np.hypot(*np.diff(around, axis=0).T)
    assert np.allclose(gaps, 2 * 0.5 * math.sin(math.pi / 64))  # sides of a regular 64-gon
    yaml = b"""shapes:
    - {type: polygon, points: [[0, 0], [4, 0], [4, 2]], value: 100,
       holes: [[[2, 0.5], [3, 0.5], [3, 1]]]}
    - {type: line, points: [[0, 0], [1, 1]], thickness: 0.25}
    """
    polygon, line = read(yaml, "s.yaml").items
    assert polygon.text == "polygon with 3 corners and 1 hole, value 100"
    assert [ring.tolist() for ring in polygon.lines] == [
        [[0, 0], [4, 0], [4, 2], [0, 0]], [[2, 0.5], [3, 0.5], [3, 1], [2, 0.5]],
    ]  # fmt: skip
    assert polygon.place == (2.0, 1.0)
    assert line.text == "line through 2 points, 0.25 m thick"
    assert line.lines[0].tolist() == [[0, 0], [1, 1]]
