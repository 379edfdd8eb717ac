"""The JSON documents that mapdeal writes, read back; and what must not be believed."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.checks.findings import Finding
from mapdeal.checks.formats import LintReport, MapReport, json_lines
from mapdeal.commands.report_answers import (
    ComparisonAnswer,
    DiffAnswer,
    LintAnswer,
    ReachAnswer,
    RouteAnswer,
    ScoreAnswer,
    ShapesAnswer,
    read_answer,
)
from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import Bottleneck, Goal, GoalReach, Passage, Reach
from mapdeal.grid.route import Route
from mapdeal.grid.shapes import Circle, Polygon
from mapdeal.pipeline.documents import AlignmentAnswer, reach_json, route_json
from robustness.seeds import ANSWERS

SHAPES = {"type": "Feature", "properties": {"radius": 0.5},
          "geometry": {"type": "Point", "coordinates": [1, 2]}}  # fmt: skip
ALL = {**ANSWERS, "shapes": SHAPES}
LINT, REACH, ROUTE, DIFF, COMPARISON, ALIGNMENT, SCORE = ANSWERS.values()


@pytest.fixture
def read(tmp_path):
    def read(document, name="answer.json"):
        path = tmp_path / name
        path.write_bytes(document if isinstance(document, bytes) else json.dumps(document).encode())
        return read_answer(path)

    return read


def test_what_lint_has_found(read):
    answer = read(LINT)
    assert isinstance(answer, LintAnswer)
    assert (answer.errors, answer.warnings, answer.notes, answer.suppressed) == (0, 1, 1, 2)
    parameters, one = answer.files
    assert (parameters.file, parameters.findings, parameters.is_parameters) == (
        "nav2.yaml", (), True,
    )  # fmt: skip
    assert (one.file, one.suppressed, one.repairs) == ("a<b>.yaml", 2, ("free_thresh 0.196",))
    islands, turned = one.findings
    assert islands.message == "<img onerror=1>\n\x07"  # as it is: whoever shows it escapes it
    assert islands.places == ((1.5, -2.0), (0.0, 3.0))
    assert (turned.check, turned.severity, turned.line, turned.places) == (
        "yaml.origin-yaw", "note", 3, (),
    )  # fmt: skip


def test_what_a_robot_reaches(read):
    answer = read(REACH)
    assert isinstance(answer, ReachAnswer)
    assert answer.robot.vertices == ((0.3, 0.2), (0.3, -0.2), (-0.3, 0.0))
    assert (answer.heading_count, answer.start) == (16, (1.5, -2.0, 0.5))
    assert (answer.reachable_area, answer.open_area, answer.free_area) == (8.5, 12.0, 20.25)
    dock, other = answer.goals
    assert dock == GoalReach(Goal(3.0, 4.0, "dock"), True, 7, math.inf)
    assert (dock.reason, dock.nearest_open) == (None, None)
    assert other.limited_by == Bottleneck(-2.0, 1.0, 0.62, "passage")
    assert (other.reason, other.nearest_open) == ("unknown", (-3.0, 4.5))
    assert answer.passages == (Passage(-2.0, 1.0, 0.62, 12.3, False, ((-2.0, 0.7), (-2.0, 1.3))),)


def test_a_route(read):
    route = read(ROUTE).route
    assert isinstance(read(ROUTE), RouteAnswer)
    assert (route.method, route.reached, route.local_minimum) == ("descent", False, (1.0, 1.0))
    assert route.points_xy.tolist() == [[0.0, 1.0], [1.0, 1.0]]
    assert (route.length, route.cost, route.mean_clearance) == (1.0, 1.25, math.inf)


def test_what_differs(read):
    answer = read(DIFF)
    assert isinstance(answer, DiffAnswer)
    assert answer.first.file == "a.yaml"
    assert answer.first.sha256 == {"a.yaml": "ab" * 32, "a.pgm": "0" * 64}
    assert answer.second is None
    assert answer.geometry == {"width": ("3", "4"), "origin": ("[0, 0, 0]", "[1, 0, 0.5]")}
    assert answer.metadata == {"mode": ('"trinary"', '"scale"')}
    assert answer.confusion == {"free": {"free": 9, "occupied": 3}}
    assert answer.walls == ({"largest": 0.5, "percentile_95": 0.4, "mean": 0.1}, None)
    assert answer.bounds == {"max_shift": (0.1, None, False)}


def test_methods_compared(read):
    answer = read(COMPARISON)
    assert isinstance(answer, ComparisonAnswer)
    assert (answer.width, answer.height, answer.origin) == (4, 3, (1.0, 2.0, 0.0))
    assert answer.methods["tsdf"].figures == {"occupied": 3.0, "mean_thickness_m": None}
    assert answer.methods["tsdf"].vanished == ((1.25, 2.5, 4),)
    assert answer.differing == {("tsdf", "beams"): 5}


def test_an_alignment(read):
    answer = read(ALIGNMENT)
    assert isinstance(answer, AlignmentAnswer)
    assert answer.transform.pose == (1.5, -2.0, 0.25)
    assert (answer.first.file, answer.second) == ("a<b>.yaml", None)
    assert (answer.same_place, answer.reason) == (False, "another <place> fits")
    assert (answer.score, answer.runner_up) == (3.5, 3.25)
    assert (answer.overlap, answer.agreement) == (0.5, 1.0)
    with pytest.raises(MalformedInputError, match=r"overlap: must be a number from 0 to 1"):
        read({**ALIGNMENT, "overlap": 1.5})


def test_a_score(read):
    answer = read(SCORE)
    assert isinstance(answer, ScoreAnswer)
    assert (answer.file, answer.truth, answer.passes) == ("a<b>.yaml", None, False)
    assert (answer.width, answer.height, answer.resolution) == (4, 3, 0.25)
    assert answer.transform == (1.5, -2.0, 0.25)
    assert answer.figures == {
        "coverage": 0.9, "ssim_gauss": None, "dist_est_to_truth_m.n": 7.0,
        "dist_est_to_truth_m.mean": 0.5,
    }  # fmt: skip
    assert [(one.name, one.is_least, one.found, one.holds) for one in answer.bounds] == [
        ("coverage", True, 0.9, True),
        ("ssim_gauss", False, None, False),
    ]
    alone = read({**SCORE, "transform": None, "map": None})
    assert (alone.has_truth, alone.file, alone.sums) == (False, None, {})


def test_shapes_of_either_form(read):
    assert read(SHAPES) == ShapesAnswer((Circle((1.0, 2.0), 0.5),))
    yaml = b"shapes:\n- {type: polygon, points: [[0, 0], [2, 0], [2, 1]]}\n"
    corners = ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0))
    assert read(yaml, "s.yaml") == ShapesAnswer((Polygon(corners),))


def test_keys_that_are_not_known_yet_are_passed_over(read):
    for document in (LINT, REACH, ROUTE, DIFF, COMPARISON, SCORE):
        assert type(read({**document, "new": [{}]})) is type(read(document))


def _without(document, *keys):
    *path, last = keys
    copy = json.loads(json.dumps(document))
    within = copy
    for key in path:
        within = within[key]
    del within[last]
    return copy


def _with(document, value, *keys):
    *path, last = keys
    copy = json.loads(json.dumps(document))
    within = copy
    for key in path:
        within = within[key]
    within[last] = value
    return copy


FINDING = ("maps", 0, "findings", 0)


@pytest.mark.parametrize(
    ("document", "told"),
    [
        (_without(LINT, *FINDING, "check"), "maps[0].findings[0]: must have a key check"),
        (_with(LINT, "bad", *FINDING, "severity"),
         "maps[0].findings[0].severity: must be one of error, warning, note, got 'bad'"),
        (_with(LINT, 7, *FINDING, "message"), "maps[0].findings[0].message: must be a text, got 7"),
        (_with(LINT, [[1]], *FINDING, "places"),
         "maps[0].findings[0].places[0]: must be two numbers [x, y], got [1]"),
        (_with(LINT, [[1, True]], *FINDING, "places"), "places[0][1]: must be a number, got True"),
        (_with(LINT, [[1, 1e13]], *FINDING, "places"), "must be a number from -1e+12 to 1e+12"),
        (_with(LINT, 1.5, "errors"), "errors: must be a whole number, got 1.5"),
        (_with(LINT, -1, "errors"), "errors: must be a whole number from 0 to 9007199254740992"),
        (_with(LINT, 7, "maps", 0), "maps[0]: must be an object, got 7"),
        (_with(LINT, {}, "maps", 0, "findings"), "maps[0].findings: must be a list, got {}"),
        (_with(REACH, 0, "robot", "headings"), "robot.headings: must be a whole number from 1"),
        (_with(REACH, [[0, 0]], "robot", "footprint"), "at least three vertices"),
        (_with(REACH, "yes", "goals", 0, "reachable"), "must be true or false, got 'yes'"),
        (_with(REACH, None, "start", "x"), "start.x: must be a number, got None"),
        (_with(REACH, [[0, 0]], "passages", 0, "ends"), "passages[0].ends: must be two points"),
        (_with(REACH, [[0, 0]] * 3, "passages", 0, "ends"), "passages[0].ends: must be two points"),
        (_with(REACH, 2, "share"), "share: must be a number from 0 to 1, got 2"),
        (_with(REACH, -0.1, "passages", 0, "width_m"), "width_m: must be a number from 0"),
        (_with(ROUTE, [[0, 1], [2]], "points"), "points[1]: must be two numbers [x, y], got [2]"),
        (_with(ROUTE, [[0, 1], [True, 2]], "points"), "points[1][0]: must be a number, got True"),
        (_with(ROUTE, [[0, 10**400]], "points"), "points[0][1]: must be a number from -1e+12"),
        (_with(ROUTE, [[0, -2e12]], "points"), "points[0][1]: must be a number from -1e+12"),
        (_with(ROUTE, {}, "points"), "is not what lint, reach, route, diff, align, score"),
        (_with(ROUTE, "fly", "method"), "method: must be one of astar, descent, got 'fly'"),
        (_with(DIFF, "AB" * 32, "first", "sha256", "a.pgm"), "must be the 64 hexadecimal digits"),
        (_with(DIFF, [1], "geometry", "width"), "geometry.width: must be two values, got [1]"),
        (_without(DIFF, "walls", "second_to_first"), "walls: must have a key second_to_first"),
        (_with(SCORE, "low", "bounds", 0, "side"), "bounds[0].side: must be one of min, max"),
        (_with(SCORE, [], "values"), "values: must be an object, got []"),
        (_with(SCORE, {"a": {"b": "c"}}, "values"), "values.a.b: must be a number, got 'c'"),
        (_with(SCORE, 0, "lattice", "width"), "lattice.width: must be a whole number from 1"),
        (_without(SCORE, "truth"), "must have a key truth"),
        (_with(COMPARISON, [1, 2], "origin"), "origin: must be three numbers"),
        (_with(COMPARISON, 0, "width"), "width: must be a whole number from 1"),
    ],
)  # fmt: skip
def test_what_must_not_be_believed_names_the_key(read, document, told):
    with pytest.raises(MalformedInputError) as caught:
        read(document)
    text = str(caught.value)
    assert told in text
    assert "answer.json: " in text
    assert "\n" not in text


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (b'{"maps": [' + b"[" * 100_000, "nested too deep"),
        (b'{"maps": [NaN], "errors": 0, "suppressed": 0}', "NaN is not a JSON number"),
        (b'{"maps": [-Infinity]}', "-Infinity is not a JSON number"),
        (b'{"maps": [], "errors": 1e999, "suppressed": 0}', "errors: must be a whole number"),
        (b'{"points": [[0, 1e999]], "reached": true}', "points[0][1]: must be a number from"),
        (b'{"errors": ' + b"7" * 5000 + b"}", "no valid JSON"),
        (b'{"errors": 0, "errors": 1}', "key 'errors' appears twice"),
        (b'{"maps": [}', "line 1, column 11: no valid JSON"),
        (b'{"maps": "\xff"}', "not UTF-8"),
        (
            b"{}",
            "is not what lint, reach, route, diff, align, score or build --compare writes as JSON",
        ),
        (b'{"outputs": {}, "stages": []}', "is the manifest of a run, not what lint"),
        (b"image: a.pgm\nresolution: 1\n", "is a map, not a file of shapes"),
        (b"", "answer.json"),
    ],
)
def test_no_document_at_all(read, text, told):
    with pytest.raises(MalformedInputError) as caught:
        read(text)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("depth", [300, 900, 980])
def test_deep_values_that_json_takes(read, depth):
    deep = json.loads("[" * 200 + "]" * 200)
    for document in (_with(DIFF, [deep, deep], "geometry", "width"), _with(ROUTE, deep, "start")):
        text = json.dumps(document).replace("[" * 200, "[" * depth)
        text = text.replace("]" * 200, "]" * depth).encode()
        try:
            assert isinstance(read(text), DiffAnswer)
        except MalformedInputError as error:
            assert "\n" not in str(error)


def test_what_is_too_large_or_not_there(tmp_path):
    path = tmp_path / "huge.json"
    with path.open("wb") as file:
        file.write(b'{"maps": []')
        file.truncate((1 << 26) + 1)
    with pytest.raises(MalformedInputError, match="must not be larger than 67108864 bytes"):
        read_answer(path)
    with pytest.raises(FileAccessError):
        read_answer(tmp_path / "none.json")


NUMBERS = st.floats(-1e4, 1e4).map(lambda value: round(value, 9) + 0.0)
LENGTHS = st.floats(0, 1e4).map(lambda value: round(value, 9)) | st.just(math.inf)
POINTS = st.tuples(NUMBERS, NUMBERS)
LIMITS = st.builds(
    Bottleneck, NUMBERS, NUMBERS, LENGTHS, st.sampled_from(["passage", "start", "goal"])
)
GOALS = st.builds(
    GoalReach,
    st.builds(Goal, NUMBERS, NUMBERS, st.none() | st.text(max_size=8)),
    st.booleans(),
    st.integers(0, 255),
    LENGTHS,
    st.none() | LIMITS,
    st.none() | st.text(max_size=8),
    st.none() | POINTS,
)
PASSAGES = st.builds(
    Passage, NUMBERS, NUMBERS, LENGTHS, LENGTHS, st.booleans(), st.tuples(POINTS, POINTS)
)
ROBOTS = st.sampled_from(
    [None, Footprint.circle(0.25), Footprint.polygon([(0.3, 0.1), (-0.3, 0.1), (0, -0.2)])]
)


@given(
    start=st.lists(NUMBERS, min_size=2, max_size=3).map(tuple),
    robot=ROBOTS,
    headings=st.integers(1, 255),
    through=st.booleans(),
    goals=st.lists(GOALS, max_size=3).map(tuple),
    passages=st.lists(PASSAGES, max_size=3).map(tuple),
)
def test_reach_comes_back_as_it_was_written(
    tmp_path_factory, start, robot, headings, through, goals, passages
):
    layers = [np.ones((2, 3), np.uint8)] * 2 + [np.ones((2, 3), np.float32)] * 2
    reach = Reach(
        *layers, np.zeros((2, 3), np.int8), 0.5, (1.0, 2.0, 0.5), start, robot, headings, through,
        goals, passages,
    )  # fmt: skip
    path = tmp_path_factory.getbasetemp() / "reach_again.json"
    path.write_text(reach_json(reach))
    answer = read_answer(path)
    assert answer == ReachAnswer(
        robot, headings, start, through, 1.5, 1.5, 1.5, 1.0, goals, passages
    )


@given(
    points=st.lists(POINTS, min_size=1, max_size=5),
    minimum=st.none() | POINTS,
    expanded=st.none() | st.integers(0, 10**9),
    figures=st.tuples(LENGTHS, LENGTHS, LENGTHS, LENGTHS),
)
def test_routes_come_back_as_they_were_written(
    tmp_path_factory, points, minimum, expanded, figures
):
    length, cost, least, mean = figures
    route = Route(
        "descent", minimum is None, points[0], points[-1], np.array(points), length, cost, least,
        minimum, mean, expanded, False,
    )  # fmt: skip
    path = tmp_path_factory.getbasetemp() / "route_again.json"
    path.write_text(route_json(route))
    found = read_answer(path).route
    assert found.points_xy.tolist() == [list(point) for point in points]
    told = (found.start, found.goal, found.local_minimum, found.expanded, found.reached)
    assert told == (points[0], points[-1], minimum, expanded, minimum is None)
    assert (found.length, found.cost, found.min_clearance, found.mean_clearance) == figures


def test_lint_comes_back_as_it_was_written(read):
    found = Finding("image.lossy", "warning", "a\udcff.yaml", 'a "quoted" \u2028 name', 4)
    maps = (MapReport("a\udcff.yaml", (found,), suppressed=1), MapReport("b", (), is_folder=True))
    answer = read("\n".join(json_lines(LintReport(maps, "1.0"))).encode())
    assert [one.file for one in answer.files] == ["a\udcff.yaml", "b"]
    (told,) = answer.files[0].findings
    assert (told.check, told.severity, told.message, told.line) == (
        found.check, found.severity, found.message, found.line,
    )  # fmt: skip
    assert (answer.warnings, answer.suppressed) == (1, 1)


PLACES_IN_DOCUMENTS = st.randoms(use_true_random=False)
JUNK = st.sampled_from(
    [None, True, -1, 0.5, 1e308, 10**300, "", "<script>", "\ud800", [], [[]], {}, {"x": 1}]
)


@pytest.mark.filterwarnings("ignore::mapdeal.MapdealWarning")  # a shape may be left out
@given(name=st.sampled_from(sorted(ALL)), chance=PLACES_IN_DOCUMENTS, junk=JUNK)
def test_a_damaged_value_is_refused_or_read(tmp_path_factory, name, chance, junk):
    document = json.loads(json.dumps(ALL[name]))
    within = document
    while True:
        keys = list(within) if isinstance(within, dict) else list(range(len(within)))
        key = chance.choice(keys)
        if not isinstance(within[key], dict | list) or not within[key] or chance.random() < 0.2:
            break
        within = within[key]
    within[key] = junk
    path = tmp_path_factory.getbasetemp() / "damaged.json"
    path.write_text(json.dumps(document))
    try:
        read_answer(path)
    except MalformedInputError as error:
        assert str(error).startswith(str(path))
