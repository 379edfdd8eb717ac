"""The cheapest route through a costmap."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oracles
from mapdeal import Costmap, ParameterError, esdf, exponential_cost, shortest_route

ORIGIN = (1.5, -2.0, 0.4)


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


@settings(max_examples=80)
@given(
    problems(), st.booleans(), st.sampled_from([0.0, 2.0, 50.0]), st.sampled_from([0.0, 1.0, 20.0])
)
def test_the_route_has_the_lowest_cost_of_all(problem, through_unknown, multiplier, field_weight):
    costmap, start, goal = problem
    frame = costmap.frame
    start_xy, goal_xy = (tuple(frame.xy_from_rowcol([cell])[0].tolist()) for cell in (start, goal))
    route = shortest_route(
        costmap, start_xy, goal_xy, cost_travel_multiplier=multiplier,
        through_unknown=through_unknown, field_weight=field_weight,
    )  # fmt: skip
    distance = oracles.signed_distance(costmap.cost == 254, costmap.resolution, "center")
    weights = _weights(costmap.cost, multiplier, through_unknown, distance, field_weight)
    lowest = oracles.lowest_cost(weights.tolist(), start, goal)
    assert route.reached == (lowest is not None)
    if not route.reached:
        assert route.points_xy.shape == (0, 2)
        assert math.isnan(route.length)
        return
    assert route.cost == pytest.approx(lowest * costmap.resolution, rel=1e-6, abs=1e-9)
    assert route.points_xy[0] == pytest.approx(start_xy)
    assert route.points_xy[-1] == pytest.approx(goal_xy)
    steps = [math.dist(a, b) for a, b in pairwise(route.points_xy.tolist())]
    assert route.length == pytest.approx(sum(steps), abs=1e-9)
    assert all(step <= 1.5 * costmap.resolution for step in steps)
    assert start == goal or min(steps) > 0.9 * costmap.resolution  # no point twice
    cells = frame.unbounded_rowcol_from_xy(route.points_xy)
    assert (weights[cells[:, 0], cells[:, 1]] > 0).all()
    clearance = distance[cells[:, 0], cells[:, 1]].min()
    assert route.min_clearance == pytest.approx(clearance, rel=1e-6)


@settings(max_examples=80)
@given(problems(), st.sampled_from([0.3, 2.0, 25.0]), st.sampled_from([0.0, 1.0]))
def test_the_field_in_the_heuristic_is_a_search_by_cost_and_estimate(
    problem, heuristic_weight, field_weight
):
    costmap, start, goal = problem
    ends = [tuple(xy) for xy in costmap.frame.xy_from_rowcol([start, goal]).tolist()]
    distance = oracles.signed_distance(costmap.cost == 254, costmap.resolution, "center")
    weights = _weights(costmap.cost, 2.0, False, distance, field_weight)
    surcharges = np.zeros(costmap.shape)
    for cell in np.ndindex(costmap.shape):
        metres = heuristic_weight * max(0.0, 1 - np.float32(max(distance[cell], 0.0)) / 2.0)
        surcharges[cell] = metres / costmap.resolution
    cells, cost, expanded = oracles.best_first(weights.tolist(), surcharges.tolist(), start, goal)
    route = shortest_route(
        costmap, *ends, field_weight=field_weight, heuristic_weight=heuristic_weight
    )
    assert (route.reached, route.expanded, route.optimal) == (len(cells) > 0, expanded, False)
    if not route.reached:
        assert math.isnan(route.mean_clearance)
        return
    assert route.cost == pytest.approx(cost * costmap.resolution, rel=1e-6, abs=1e-9)
    centres = costmap.frame.xy_from_rowcol(cells)
    assert route.points_xy == pytest.approx(centres if len(cells) > 1 else centres[[0, 0]])
    plain = shortest_route(costmap, *ends, field_weight=field_weight)
    assert plain.optimal
    assert plain.cost <= route.cost * (1 + 1e-6)


@settings(max_examples=60)
@given(problems(), st.tuples(*[st.floats(0.02, 0.98)] * 4))
def test_the_mean_clearance_weighs_each_piece_with_its_length(problem, inside):
    costmap, start, goal = problem
    places = [np.add(start, inside[:2]), np.add(goal, inside[2:])]
    ends = [tuple(xy) for xy in costmap.frame.xy_from_continuous_rowcol(places).tolist()]
    route = shortest_route(costmap, *ends)
    if not route.reached:
        return
    lethal = costmap.frame.xy_from_rowcol(np.argwhere(costmap.cost == 254)).tolist()
    points = route.points_xy.tolist()
    nearest = [min((math.dist(p, q) for q in lethal), default=math.inf) for p in points]
    length = area = 0.0
    for k in range(len(points) - 1):
        piece = math.dist(points[k], points[k + 1])
        length, area = length + piece, area + piece * (nearest[k] + nearest[k + 1]) / 2
    mean = area / length if length else nearest[0]
    assert route.mean_clearance == pytest.approx(mean, rel=1e-6)
    assert route.min_clearance == pytest.approx(min(nearest), rel=1e-6)


def _free(height, width, resolution=0.25):
    return Costmap(np.zeros((height, width), np.uint8), resolution, ORIGIN)


def test_between_start_and_goal_are_centres_without_a_hook_at_the_ends():
    costmap = _free(3, 5)
    frame = costmap.frame
    start, goal = frame.xy_from_continuous_rowcol([[0.1, 0.2], [2.9, 4.3]])
    route = shortest_route(costmap, tuple(start), tuple(goal))
    assert route.points_xy[0].tolist() == start.tolist()
    assert route.points_xy[-1].tolist() == goal.tolist()
    centres = frame.continuous_rowcol_from_xy(route.points_xy[1:-1])
    assert centres % 1 == pytest.approx(0.5)
    assert not (centres < 1).all(axis=1).any()
    assert not (centres > (2, 4)).all(axis=1).any()
    assert route.cost == pytest.approx(route.length)
    assert route.min_clearance == math.inf


def test_where_the_straight_way_would_cut_a_closed_cell_the_centre_stays():
    costmap = Costmap(np.array([[0, 254], [0, 0]], np.uint8), 0.5, ORIGIN)
    start, goal = costmap.frame.xy_from_continuous_rowcol([[0.1, 0.9], [1.1, 1.9]])
    route = shortest_route(costmap, tuple(start), tuple(goal))
    places = costmap.frame.continuous_rowcol_from_xy(route.points_xy)
    expected = np.array([[0.1, 0.9], [0.5, 0.5], [1.5, 1.5], [1.1, 1.9]])
    assert places == pytest.approx(expected)


def test_within_a_cell_the_way_is_straight():
    costmap = _free(2, 3, 1.0)
    start, goal = costmap.frame.xy_from_continuous_rowcol([[0.5, 1.2], [0.5, 1.9]])
    route = shortest_route(costmap, tuple(start), tuple(goal))
    assert (len(route.points_xy), route.reached) == (2, True)
    assert route.length == pytest.approx(0.7)


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
def test_start_and_goal_must_be_open_and_the_nearest_open_cell_is_told(start, text):
    costmap = Costmap(np.array([[254, 255, 253, 0, 0]], np.uint8), 0.5)
    good = (2.25, 0.25)
    for points, name in (((start, good), "start"), ((good, start), "goal")):
        with pytest.raises(ParameterError, match=text) as caught:
            shortest_route(costmap, *points)
        assert caught.value.place == name
        if text != "outside":
            metres = abs(1.75 - start[0])
            assert caught.value.hint.endswith(f"is {metres:g} m away, at 1.75,0.25")
    with pytest.raises(ParameterError) as caught:
        shortest_route(Costmap(np.full((1, 2), 254, np.uint8), 0.5), (0.25, 0.25), (0.6, 0.25))
    assert "no cell" in caught.value.hint


def test_a_route_past_inscribed_cells_keeps_the_inscribed_radius(real_maps):
    import warnings

    from mapdeal import read_map

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        grid = read_map(next(real_maps.rglob("depot.yaml")))
    field = esdf(grid, convention="center")
    costs = {"inscribed_radius": 0.22, "inflation_radius": 0.7, "cost_scaling_factor": 3.0}
    route = shortest_route(exponential_cost(field, **costs), (2.0, 2.0), (28.0, 13.0))
    assert route.reached
    assert route.min_clearance > 0.22
    assert route.min_clearance == pytest.approx(field.query(route.points_xy).distance.min())


def test_by_default_costs_count_double_and_distances_do_not():
    cost = np.zeros((3, 9), np.uint8)
    cost[0] = 254
    cost[2] = 126
    costmap = Costmap(cost, 0.25, ORIGIN)
    ends = [tuple(costmap.frame.xy_from_rowcol([[1, col]])[0].tolist()) for col in (1, 7)]
    route = shortest_route(costmap, *ends)
    assert (route.length, route.cost) == pytest.approx((1.5, 1.5))
    ends = [tuple(costmap.frame.xy_from_rowcol([[2, col]])[0].tolist()) for col in (1, 2)]
    route = shortest_route(costmap, *ends)
    assert (route.length, route.cost) == pytest.approx((0.25, 0.5))
