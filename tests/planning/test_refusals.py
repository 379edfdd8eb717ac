"""What has no route, by the parameter that is wrong."""

import math

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import Costmap, OccupancyGrid, ParameterError, descend, esdf, potential, shortest_route

GRID = grid_from_text("..#", 0.25)
COSTS = Costmap.from_occupancy(GRID)
INSIDE, WALL = (tuple(xy) for xy in GRID.frame.xy_from_rowcol([(0, 0), (0, 2)]).tolist())
FIELD = potential(GRID, goal=INSIDE)
FREE = Costmap(np.zeros((4, 9), np.uint8), 0.5)
ENDS = {"start": (0.25, 0.25), "goal": (3.75, 1.25)}


@pytest.mark.parametrize(("call", "message"), [
    (lambda: shortest_route(GRID, INSIDE, INSIDE), "exponential_cost"),
    (lambda: shortest_route(FREE, (1.6, 1.8, 0.5), (1.6, 1.8)), "two numbers"),
    (lambda: descend(COSTS, potential(GRID), INSIDE), "no goal"),
    (lambda: descend(COSTS, FIELD, WALL), "^start: .*closed"),
    (lambda: descend(COSTS, esdf(GRID), INSIDE), "PotentialField"),
    (lambda: descend(GRID, FIELD, INSIDE), "exponential_cost"),
    (lambda: descend(Costmap.from_occupancy(OccupancyGrid(GRID.occupancy, 0.25)), FIELD,
                     INSIDE), "same cells"),
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
