"""What documents say of a map, as items and tables of a report: told by hand."""

import json
import math

import numpy as np
import pytest

from mapdeal.commands.report_documents import (
    MOST_ITEMS,
    goal_items,
    passage_items,
    read_results,
    route_items,
    shape_items,
)
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import Bottleneck, Goal, GoalReach, Passage, Route
from mapdeal.grid.shapes import Circle, Line, Polygon
from robustness.seeds import ANSWERS

ROBOT = Footprint.polygon([(0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2)])
LIMIT = Bottleneck(-2.0, 1.0, 0.62)


@pytest.fixture
def read(tmp_path):
    def read(document):
        (tmp_path / "answer.json").write_text(json.dumps(document))
        return read_results(tmp_path / "answer.json")

    return read


@pytest.fixture
def linted(read):
    def linted(*findings, **more):
        keys = ("check", "severity", "message", "line", "places")
        told = [dict(zip(keys, one, strict=True)) for one in findings]
        entry = {"file": "a.yaml", "findings": told, "suppressed": 2, **more}
        counts = dict.fromkeys(("errors", "warnings", "notes", "suppressed"), 0)
        (part,) = read({"maps": [entry], **counts}).parts
        return part

    return linted


def test_a_finding_goes_to_each_of_its_places(linted):
    found = ("map.islands", "warning", "2 areas", None, [(1.5, -2.0), (3.0, 4.0)])
    first, second = linted(found).items
    assert (first.kind, first.tone, first.text) == ("finding", "warning", "map.islands: 2 areas")
    assert (first.place, second.place) == ((1.5, -2.0), (3.0, 4.0))
    assert second.text == "map.islands: place 2 of 2"


def test_a_finding_may_have_a_line_and_any_text(linted):
    odd = ("yaml.origin", "error", "<img onerror=1>\n\x1b[2J\udcff" + "x" * 9999, 3, [])
    (item,) = linted(odd).items
    assert item.text.startswith(r"yaml.origin: <img onerror=1>\n\x1b[2J\udcffxxx")
    assert item.text.isprintable()
    assert len(item.text) < 500
    assert item.place is None
    (item,) = linted(("a.b", "note", "turned", 7, [])).items
    assert (item.text, item.tone) == ("a.b: turned (line 7)", "note")


def test_of_very_many_findings_the_first_are_listed(linted):
    findings = [("a.b", "error", str(k), None, []) for k in range(MOST_ITEMS + 5)]
    part = linted(*findings, repairs=["mode"])
    assert [item.text for item in part.items[-2:]] == [
        f"a.b: {MOST_ITEMS - 1}", "5 more findings not listed",
    ]  # fmt: skip
    assert part.tables[0].rows == (
        ("errors", str(MOST_ITEMS + 5)), ("warnings", "0"), ("notes", "0"), ("suppressed", "2"),
        ("repair 1", "mode"),
    )  # fmt: skip


def test_passages_lie_between_their_ends():
    closed = Passage(-2.0, 1.0, 0.62, 12.3, False, ((-2.0, 0.7), (-2.0, 1.3)))
    narrow = Passage(5.0, 1.0, 1.25, 4.0, True, ((5.0, 0.5), (5.0, 1.5)))
    first, second = passage_items([closed, narrow])
    assert (first.text, first.tone, first.label) == (
        "closed passage of 0.62 m, cuts off 12.3 m2", "error", "62 cm",
    )  # fmt: skip
    assert first.place == (-2.0, 1.0)
    assert [line.tolist() for line in first.lines] == [[[-2.0, 0.7], [-2.0, 1.3]]]
    assert (second.text, second.tone, second.label) == (
        "narrow passage of 1.25 m, 4 m2 behind it", "warning", "1.25 m",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("goal", "robot", "text", "tone"),
    [
        (GoalReach(Goal(3, 4, "dock"), True, 7, math.inf), ROBOT,
         "goal dock: reachable in 7 of 16 headings", "good"),
        (GoalReach(Goal(3, 4), True, 16, 0.31, LIMIT), Footprint.circle(0.2),
         ("goal 3,4: reachable; a round robot gets there with a radius below 0.31 m: "
          "a passage at -2,1 is 0.62 m wide"), "good"),
        (GoalReach(Goal(3, 4, "a\nb"), False, 0, 0.0), None,
         r"goal a\nb: not reachable; by no robot, however small", "error"),
    ],
)  # fmt: skip
def test_goals_tell_what_limits_them(goal, robot, text, tone):
    (item,) = goal_items([goal], robot, 16)
    assert (item.kind, item.text, item.tone, item.place) == ("goal", text, tone, (3, 4))


def test_the_figures_of_a_reach(read):
    robot = {"radius": 0, "headings": 1}
    document = {**ANSWERS["reach"], "robot": robot, "passages": [], "share": 0.425}
    (table,) = read(document).tables
    rows = dict(table.rows)
    assert rows["robot"] == "a point"
    assert rows["reachable"] == "8.5 m2"
    assert rows["reachable share of free"] == "42.5 %"
    assert rows["goals reached"] == "1 of 2"
    assert rows["passages"] == "0, 0 of them closed"


def test_the_figures_of_a_route(read):
    (table,) = read({**ANSWERS["route"], "length_m": 3.2, "expanded": 9}).tables
    rows = dict(table.rows)
    assert (rows["length"], rows["cells expanded"]) == ("3.2 m", "9")
    assert (rows["mean clearance"], rows["certainly the cheapest"]) == ("-", "no")


def test_a_route_is_a_line_from_its_start_to_its_goal():
    points = np.array([[0.0, 1.0], [1.0, 1.0], [2.0, 3.0]])
    route = Route("astar", True, (0.0, 1.0), (2.0, 3.0), points, 3.2, 4.5, 0.4, None, 0.5, 9, True)
    start, goal, way = route_items(route)
    assert (start.place, goal.place, goal.tone) == ((0.0, 1.0), (2.0, 3.0), "good")
    assert way.text == "route by astar of 3.2 m, at least 0.4 m from obstacles, cost 4.5"
    assert way.lines[0].tolist() == points.tolist()
    assert way.place == (1.0, 1.0)


def test_routes_that_do_not_arrive():
    points = np.array([[0.0, 1.0], [1.0, 1.0]])
    stuck = Route("descent", False, (0.0, 1.0), (2.0, 3.0), points, 1.0, 1.0, 0.4, (1.0, 1.0))
    _, goal, way = route_items(stuck)
    assert (goal.text, goal.tone) == ("goal, not reached, at 2, 3", "error")
    assert way.text.endswith("; it ends in a local minimum at 1, 1")
    nowhere = Route("astar", False, (0.0, 1.0), (2.0, 3.0), [], 0.0, math.nan, math.nan)
    *_, way = route_items(nowhere)
    assert (way.text, way.lines, way.place) == ("route by astar: no way", (), None)


def test_shapes_have_outlines():
    ring, hole = ((0, 0), (4, 0), (4, 2)), ((2, 0.5), (3, 0.5), (3, 1))
    shapes = (
        Polygon(ring, (hole,), 100),
        Line(((0, 0), (1, 1)), 0.25),
        Circle((3.0, -1.0), 0.5, 0),
    )
    polygon, line, circle = shape_items(shapes)
    assert polygon.text == "polygon with 3 corners and 1 hole, value 100"
    assert [one.tolist() for one in polygon.lines] == [
        [[0, 0], [4, 0], [4, 2], [0, 0]], [[2, 0.5], [3, 0.5], [3, 1], [2, 0.5]],
    ]  # fmt: skip
    assert polygon.place == (2.0, 1.0)
    assert (line.text, line.lines[0].tolist()) == (
        "line through 2 points, 0.25 m thick", [[0, 0], [1, 1]],
    )  # fmt: skip
    assert circle.text == "circle of radius 0.5 m, value 0"
    around = circle.lines[0]
    assert around[0].tolist() == around[-1].tolist() == [3.5, -1.0]
    assert np.allclose(np.hypot(around[:, 0] - 3, around[:, 1] + 1), 0.5)
    gaps = np.hypot(*np.diff(around, axis=0).T)
    assert np.allclose(gaps, 2 * 0.5 * math.sin(math.pi / 64))  # sides of a regular 64-gon


def test_what_differs_is_listed(read):
    bounds = {
        "max_shift": {"allowed": 0.1, "found": None, "holds": False},
        "max_differing": {"allowed": 5.0, "found": 30.0, "holds": False},
    }
    figures, geometry, states = read(
        {
            **ANSWERS["diff"], "geometry": {"width": [3, 4]}, "metadata": {}, "bounds": bounds,
            "confusion": {"free": {"free": 7, "occupied": 3, "unknown": 0}},
            "walls": {
                "first_to_second": {"largest": 0.5, "percentile_95": 0.25, "mean": 0.125},
                "second_to_first": None,
            },
        }
    ).tables  # fmt: skip
    rows = dict(figures.rows)
    assert rows["differing"] == "3"
    assert rows["directed Hausdorff distance, first to second"] == (
        "0.5 m; 95 % within 0.25 m, mean 0.125 m"
    )
    assert rows["directed Hausdorff distance, second to first"] == "no obstacles"
    assert rows["max_shift"] == "at most 0.1: missed, nothing to compare"
    assert rows["max_differing"] == "at most 5: missed, found 30"
    assert geometry.rows == (("width", "3 → 4"),)
    assert states.rows == (("free → free", "7"), ("free → occupied", "3"))
