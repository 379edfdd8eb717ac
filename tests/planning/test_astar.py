import json
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, reject, strategies as st

import mapdeal
import oracles
from drawn import grid_from_text
from mapdeal import Costmap, ParameterError, esdf, read_map
from mapdeal.planning.routes import Terrain, route_over, surcharges_near_obstacles

ORIGIN = (1.5, -2.0, 0.4)
FACTORS = st.sampled_from([0.0, 2.0, 50.0]), st.sampled_from([0.0, 1.0, 20.0])


def shortest_route(costmap, start, goal, *, heuristic_weight=0.0, **options):
    terrain = Terrain.of(costmap, **options)
    surcharges = surcharges_near_obstacles(terrain, heuristic_weight)
    return route_over(terrain, start, goal, surcharges=surcharges)


def _weights(cost, multiplier, through_unknown, distance, field_weight):
    """What a metre costs in each cell, cell by cell; 0 for closed ones."""
    weights = np.zeros(cost.shape)
    for cell in np.ndindex(cost.shape):
        value = int(cost[cell])
        if value == 255 and through_unknown:
            value = 252
        if value <= 252:
            weights[cell] = 1 + multiplier * value / 252
            weights[cell] += field_weight * max(0.0, 1 - distance[cell] / 2.0)
    return weights


@st.composite
def problems(draw):
    """A costmap with any costs, and the centres of two open cells of it."""
    height, width = draw(st.integers(2, 8)), draw(st.integers(2, 8))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    cost = rng.choice([0, 0, 0, 1, 128, 252, 253, 254, 255], (height, width)).astype(np.uint8)
    ends = [draw(st.tuples(st.integers(0, height - 1), st.integers(0, width - 1))) for _ in "ab"]
    for end in ends:
        cost[end] = draw(st.sampled_from([0, 200]))
    return Costmap(cost, draw(st.sampled_from([0.05, 0.5, 2.0])), ORIGIN), *ends


def ends_of(problem):
    return [tuple(xy) for xy in problem[0].frame.xy_from_rowcol(problem[1:]).tolist()]


@given(problems(), st.booleans(), *FACTORS)
def test_the_route_has_the_lowest_cost_of_all(problem, through_unknown, multiplier, field_weight):
    costmap, start, goal = problem
    resolution, ends = costmap.resolution, ends_of(problem)
    options = {"through_unknown": through_unknown, "field_weight": field_weight}
    route = shortest_route(costmap, *ends, cost_travel_multiplier=multiplier, **options)
    distance = oracles.signed_distance(costmap.cost == 254, resolution, "center")
    weights = _weights(costmap.cost, multiplier, through_unknown, distance, field_weight)
    lowest = oracles.lowest_cost(weights.tolist(), start, goal)
    assert route.reached == (lowest is not None)
    if not route.reached:
        assert route.points_xy.shape == (0, 2)
        assert math.isnan(route.length)
        assert math.isnan(route.mean_clearance)
        return
    assert route.cost == pytest.approx(lowest * resolution, rel=1e-6, abs=1e-9)
    assert route.points_xy[[0, -1]] == pytest.approx(np.array(ends))
    steps = [math.dist(a, b) for a, b in pairwise(route.points_xy.tolist())]
    assert route.length == pytest.approx(sum(steps), abs=1e-9)
    assert max(steps) <= 1.5 * resolution
    assert start == goal or min(steps) > 0.9 * resolution  # no point twice
    cells = tuple(costmap.frame.unbounded_rowcol_from_xy(route.points_xy).T)
    assert (weights[cells] > 0).all()
    assert route.min_clearance == pytest.approx(distance[cells].min(), rel=1e-6)


@given(problems(), st.sampled_from([0.3, 2.0, 25.0]), st.sampled_from([0.0, 1.0]))
def test_the_field_in_the_heuristic_counts_as_estimate(problem, heuristic_weight, field_weight):
    costmap, start, goal = problem
    ends = ends_of(problem)
    distance = oracles.signed_distance(costmap.cost == 254, costmap.resolution, "center")
    weights = _weights(costmap.cost, 2.0, False, distance, field_weight)
    surcharges = np.zeros(costmap.shape)
    for cell in np.ndindex(costmap.shape):
        metres = heuristic_weight * max(0.0, 1 - np.float32(max(distance[cell], 0.0)) / 2.0)
        surcharges[cell] = metres / costmap.resolution
    layers = weights.tolist(), surcharges.tolist()
    cells, cost, expanded = oracles.best_first(*layers, start, goal, on_near_tie=reject)
    options = {"field_weight": field_weight, "heuristic_weight": heuristic_weight}
    route = shortest_route(costmap, *ends, **options)
    assert (route.reached, route.expanded, route.optimal) == (len(cells) > 0, expanded, False)
    if not route.reached:
        return
    assert route.cost == pytest.approx(cost * costmap.resolution, rel=1e-6, abs=1e-9)
    centres = costmap.frame.xy_from_rowcol(cells)
    assert route.points_xy == pytest.approx(centres if len(cells) > 1 else centres[[0, 0]])
    plain = shortest_route(costmap, *ends, field_weight=field_weight)
    assert plain.optimal
    assert plain.cost <= route.cost * (1 + 1e-6)


@given(problems(), st.tuples(*[st.floats(0.02, 0.98)] * 4))
def test_the_mean_clearance_weighs_each_piece_with_its_length(problem, inside):
    costmap, start, goal = problem
    places = [np.add(start, inside[:2]), np.add(goal, inside[2:])]
    ends = [tuple(xy) for xy in costmap.frame.xy_from_continuous_rowcol(places).tolist()]
    route = shortest_route(costmap, *ends)
    if not route.reached:
        return
    lethal = costmap.frame.xy_from_rowcol(np.argwhere(costmap.cost == 254)).tolist()
    least, mean = oracles.clearances(route.points_xy.tolist(), lethal)
    assert route.min_clearance == pytest.approx(least, rel=1e-6)
    assert route.mean_clearance == pytest.approx(mean, rel=1e-6)


def route_between(rows, start, goal, resolution=0.5, **options):
    """The route through costs between two places in cells, and its points in cells."""
    costmap = Costmap(np.array(rows, np.uint8), resolution, ORIGIN)
    ends = costmap.frame.xy_from_continuous_rowcol([start, goal])
    route = shortest_route(costmap, *map(tuple, ends), **options)
    assert route.points_xy[[0, -1]].tolist() == ends.tolist()
    return route, costmap.frame.continuous_rowcol_from_xy(route.points_xy)


def test_between_start_and_goal_are_centres_without_a_hook_at_the_ends():
    route, places = route_between(np.zeros((3, 5)), (0.1, 0.2), (2.9, 4.3))
    centres = places[1:-1]
    assert centres % 1 == pytest.approx(0.5)
    assert not (centres < 1).all(axis=1).any()
    assert not (centres > (2, 4)).all(axis=1).any()
    assert route.cost == pytest.approx(route.length)
    assert route.min_clearance == math.inf


def test_the_way_is_straight_within_a_cell_and_cuts_no_closed_one():
    _, places = route_between([[0, 254], [0, 0]], (0.1, 0.9), (1.1, 1.9))
    assert places == pytest.approx(np.array([[0.1, 0.9], [0.5, 0.5], [1.5, 1.5], [1.1, 1.9]]))
    route, _ = route_between(np.zeros((2, 3)), (0.5, 1.2), (0.5, 1.9), 1.0)
    assert (len(route.points_xy), route.reached) == (2, True)
    assert route.length == pytest.approx(0.7)


@pytest.mark.parametrize(("row", "last", "cost"), [(1, 7, 1.5), (2, 2, 0.5)])
def test_by_default_costs_count_double_and_distances_do_not(row, last, cost):
    rows = np.array([254, 0, 126])[:, np.newaxis] * np.ones(9)
    route, _ = route_between(rows, (row + 0.5, 1.5), (row + 0.5, last + 0.5), 0.25)
    assert (route.length, route.cost) == pytest.approx(((last - 1) * 0.25, cost))


def test_on_the_occupancy_scale_99_and_100_are_closed_and_98_is_the_highest_cost():
    for closed in (99, 100, -1):
        costmap = Costmap(np.array([[0, closed, 0]], np.int8), 1.0, scale="occupancy")
        assert not shortest_route(costmap, (0.5, 0.5), (2.5, 0.5)).reached
    costmap = Costmap(np.array([[0, 98, 49]], np.int8), 1.0, scale="occupancy")
    route = shortest_route(costmap, (0.5, 0.5), (2.5, 0.5), cost_travel_multiplier=4.0)
    assert route.cost == pytest.approx(5.0 + 3.0)


@pytest.mark.parametrize(
    ("start", "text"), [((0.25, 0.25), "cost 254"), ((0.75, 0.25), "unknown"), ((9, 0), "outside")]
)
def test_start_and_goal_must_be_open_and_the_nearest_open_cell_is_named(start, text):
    costmap = Costmap(np.array([[254, 255, 253, 0, 0]], np.uint8), 0.5)
    good = (2.25, 0.25)
    for points, name in (((start, good), "start"), ((good, start), "goal")):
        with pytest.raises(ParameterError, match=text) as caught:
            shortest_route(costmap, *points)
        assert caught.value.place == name
        if text != "outside":
            metres = abs(1.75 - start[0])
            assert caught.value.hint.endswith(f"is {metres:g} m away, at 1.75,0.25")


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_route_past_inscribed_cells_keeps_the_inscribed_radius(real_maps):
    field = esdf(read_map(next(real_maps.rglob("depot.yaml"))), convention="center")
    costs = {"inscribed_radius": 0.22, "inflation_radius": 0.7, "cost_scaling_factor": 3.0}
    route = shortest_route(mapdeal.exponential_cost(field, **costs), (2.0, 2.0), (28.0, 13.0))
    assert route.reached
    assert route.min_clearance > 0.22
    assert route.min_clearance == pytest.approx(field.query(route.points_xy).distance.min())


HALL = "\n".join(["." * 24] * 6 + ["." * 12 + "#" + "." * 11] * 8)
FREE = Costmap(np.zeros((4, 9), np.uint8), 0.5)
ENDS = {"start": (0.25, 0.25), "goal": (3.75, 1.25)}
WALL = Costmap(np.array([[254, 0]], np.uint8), 1.0)


@pytest.fixture
def hall(tmp_path):
    mapdeal.write_map(tmp_path / "hall.yaml", grid_from_text(HALL, 0.25, (1.0, -2.0, 0.4)))
    return tmp_path / "hall.yaml"


@pytest.mark.usefixtures("mapdeal_warnings")
def test_files_and_grids_have_the_routes_of_the_command(command, hall):
    ends = read_map(hall).frame.xy_from_rowcol([(3, 3), (3, 20)]).round(3).tolist()
    start, goal = (",".join(map(str, end)) for end in ends)
    for options in ({}, {"heuristic": "field"}, {"method": "descent", "attractive_gain": 50.0}):
        more = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
        code, out, _ = command("route", hall, f"--from={start}", f"--to={goal}", *more)
        for source in (hall, str(hall), read_map(hall)):
            found = mapdeal.route(source, start=ends[0], goal=ends[1], **options)
            assert "".join(found.parts()) + "\n" == out
            assert found.document() == json.loads(out)
            assert found.passes is (code == 0)


def test_a_route_has_what_the_library_finds_and_a_picture():
    found = mapdeal.route(FREE, **ENDS, field_weight=1.0)
    alone = shortest_route(FREE, *ENDS.values(), field_weight=1.0)
    assert isinstance(found, mapdeal.Route)
    assert found.points_xy.tolist() == alone.points_xy.tolist()
    assert repr(found).startswith("PlannedRoute(")
    assert found.costs is FREE
    assert found.drawn().indices.ndim == 2
    found.check()
    assert mapdeal.draw_picture(FREE, route=found).indices.ndim == 2


def test_pairs_are_found_as_they_are_read(tmp_path):
    (tmp_path / "p.csv").write_text("0.25,0.25,3.75,1.25\n9,9,1,1\n")
    routes = mapdeal.route(FREE, pairs=tmp_path / "p.csv", compare=["plain"])
    assert routes.reached == 0
    first, second = map(json.loads, routes.parts())
    assert (first["pair"], first["method"], first["reached"]) == (1, "plain", True)
    assert "outside" in second["error"]
    assert (routes.reached, routes.counts["failed"]) == (1, 1)
    assert "".join(routes.remarks()).startswith("means of 1 pair")
    with pytest.raises(mapdeal.MapdealError, match="1 of 2 pairs have no routes"):
        routes.check()


@pytest.mark.parametrize(("call", "message"), [
    (lambda: mapdeal.route(FREE, start=(1.6, 1.8, 0.5), goal=(1.6, 1.8)), "two numbers"),
    (lambda: mapdeal.route(WALL, start=(0.5, 0.5), goal=(1.5, 0.5), method="descent"),
     "start: .*closed"),
    (lambda: mapdeal.route(FREE), "^start, goal: both are required"),
    (lambda: mapdeal.route(FREE, **ENDS, compare=["plain"]), "^compare: applies to pairs alone"),
    (lambda: mapdeal.route(FREE, **ENDS, heuristic_weight=1.0),
     "^heuristic_weight: applies to heuristic field alone"),
    (lambda: mapdeal.route(FREE, **ENDS, repulsive_cap=1.0),
     "^repulsive_cap: does not apply to method astar"),
    (lambda: mapdeal.route(FREE, **ENDS, footprint=mapdeal.Footprint.circle(1)),
     "^footprint: applies to maps"),
])  # fmt: skip
def test_what_does_not_go_together_is_refused(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


@pytest.mark.parametrize("name", ["cost_travel_multiplier", "field_weight", "heuristic_weight"])
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf, 1e7])
def test_factors_must_make_sense(name, value):
    with pytest.raises(ParameterError) as caught:
        shortest_route(FREE, *ENDS.values(), **{name: value})
    assert caught.value.place == name
