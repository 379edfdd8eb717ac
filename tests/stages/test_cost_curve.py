"""The cost curve of each model, against costmaps around a single obstacle cell."""

import math
from itertools import pairwise

import numpy as np
import pytest

import mapdeal
from mapdeal.grid.costmap import MOST_LISTED

ROWS, COLS, ROW, COL = 47, 63, 19, 24
PLACE = (1.5, -2.0, 0.4)
ROBOT = {"inscribed_radius": 0.2255, "inflation_radius": 0.7, "cost_scaling_factor": 3.0}
SMALL = {"inscribed_radius": 0.15, "inflation_radius": 0.6}
INFLATIONS = [
    (0.05, ROBOT), (0.05, {**ROBOT, "lookup": "nav2"}), (1.0, ROBOT),
    (0.07, {**ROBOT, "float32_resolution": True}),
    (0.05, SMALL), (0.05, {**SMALL, "float32_resolution": True}),
    (0.05, {"inscribed_radius": 0.265, "inflation_radius": 0.3, "lookup": "nav2"}),
    (0.05, {"inscribed_radius": 0.5, "inflation_radius": 0.2}), (0.05, {"inflation_radius": 0.0}),
    (0.05, {"inflation_radius": 0.01, "cost_scaling_factor": 0.0}),
]  # fmt: skip


def around_one_obstacle(resolution):
    occupancy = np.zeros((ROWS, COLS), np.int8)
    occupancy[ROW, COL] = 100
    return mapdeal.OccupancyGrid(occupancy, resolution, PLACE)


def table_of(costmap, distance=lambda row, col: row * row + col * col):
    """Return the cost of each distance that occurs, with plain whole numbers."""
    table = {}
    for (row, col), cost in np.ndenumerate(costmap.cost):
        assert table.setdefault(distance(abs(row - ROW), abs(col - COL)), int(cost)) == cost
    return table


def check(curve, table, reach):
    """Check a curve at all distances of a map: those up to the squared reach, and 0 beyond."""
    squares = np.round(curve.cells**2).astype(int).tolist()
    listed = dict(zip(squares, curve.cost.tolist(), strict=True))
    assert curve.cells.tolist() == [math.sqrt(square) for square in listed]
    assert list(listed) == sorted(listed)
    assert max(listed) == reach
    assert listed == {square: cost for square, cost in table.items() if square <= reach}
    assert {cost for square, cost in table.items() if square > reach} == {0}


@pytest.mark.parametrize(("resolution", "parameters"), INFLATIONS)
@pytest.mark.filterwarnings("ignore:cost. inscribed_radius")
def test_it_has_the_costs_of_a_map_with_one_obstacle(resolution, parameters):
    grid = around_one_obstacle(resolution)
    curve = mapdeal.cost_curve(grid, **parameters)
    is_float32 = parameters.get("float32_resolution") or parameters.get("lookup") == "nav2"
    side = float(np.float32(resolution)) if is_float32 else resolution
    cells = parameters["inflation_radius"] / side
    reach = math.ceil(cells) if is_float32 else math.ceil(cells - 1e-9)
    check(curve, table_of(mapdeal.exponential_cost(grid, **parameters)), reach**2)
    assert curve.reach_cells == reach
    assert curve.reach == pytest.approx(reach * resolution)


NEAR = {"inscribed_radius": 0.2, "inflation_radius": 0.4, "cost_scaling_factor": 2.0}
FAR = {"inscribed_radius": 0.2, "inflation_radius": 0.9, "cost_scaling_factor": 5.0}
MAXIMUM = {"static": {"use_maximum": True}}


@pytest.mark.parametrize(("layers", "inflations"), [
    (["static", {"inflation": {**FAR, "lookup": "nav2"}}], [{**FAR, "lookup": "nav2"}]),
    (["static", {"inflation": NEAR}, {"inflation": FAR}], [NEAR, FAR]),
    (["static", {"inflation": FAR}, {"inflation": NEAR}], [FAR, NEAR]),
    (["static", {"inflation": FAR}, "static", {"inflation": NEAR}], [NEAR]),
    (["static", {"inflation": FAR}, MAXIMUM, {"inflation": NEAR}], [FAR, NEAR]),
    ([{"inflation": FAR}, MAXIMUM, {"inflation": NEAR}], [NEAR]),
    (["static", {"inflation": NEAR}, "static"], []),
])  # fmt: skip
def test_layers_have_the_costs_of_the_map(layers, inflations):
    grid = around_one_obstacle(0.07)
    curve = mapdeal.cost_curve(grid, model="layers", layers=layers)
    radii = sorted(inflation["inflation_radius"] for inflation in inflations)
    reach = math.ceil(max(radii, default=0) / 0.07)
    check(curve, table_of(mapdeal.layered_cost(grid, layers=layers)), reach**2)
    if not inflations:
        return
    *radii, largest = radii
    assert (curve.inflation_radius, curve.inscribed_radius) == (largest, 0.2)
    assert [metres for _, metres in curve.marks] == radii
    near = curve.distance <= curve.reach
    above = curve.formula(curve.distance[near][1:]) - curve.cost[near][1:]
    assert all(-2 < metres < 3 for metres in above)


@pytest.mark.parametrize("view", ["metric", "per-map"])
@pytest.mark.parametrize(("strength", "parameters"), [
    (1.0, {}), (2.5, {"down": 99, "up": 100}),
    *[(strength, {"down": 20, "up": 60, "down_factor": 0.5, "up_factor": 1.1})
      for strength in (1.0, 2.5)],
    (1.0, {"down": 30, "up": 70, "down_factor": 1.0, "up_factor": 0.0}),
])  # fmt: skip
def test_thresholds_have_the_costs_of_the_map(view, parameters, strength):
    grid = around_one_obstacle(0.07)
    field = mapdeal.esdf(grid, strength=strength, convention="border")
    parameters = {"view": view, "view_range": 1.1, **parameters}
    for source in (field, mapdeal.field_view(mapdeal.esdf(grid), view=view, view_range=1.1)):
        table = table_of(mapdeal.threshold_cost(source, **parameters))
        curve = mapdeal.cost_curve(source, model="threshold", **parameters)
        check(curve, table, max(square for square, cost in table.items() if cost > 0))
    assert curve.scale == "occupancy"
    assert curve.inscribed_radius is curve.inflation_radius is curve.circumscribed_cost is None


def test_marks_are_the_last_distances_before_a_threshold():
    options = {"down_factor": 0.5, "up_factor": 1.0, "down_distance": 1.0, "up_distance": 0.5}
    curve = mapdeal.cost_curve(0.05, model="threshold", **options)
    # the largest sums of two squares below 20^2 and 10^2 cells
    assert dict(curve.marks) == {"down, 1 m": 0.05 * 397**0.5, "up, 0.5 m": 0.05 * 98**0.5}
    marks = dict(mapdeal.cost_curve(0.05, model="threshold", down=0, up=75).marks)
    # the view is at least 1 and 76 up to there: 2 (1 - 0.01) and 2 (1 - 0.76) metres
    assert 1.97 < marks["down, view 0"] <= 1.98
    assert 0.47 < marks["up, view 75"] <= 0.48


@pytest.mark.parametrize("values", [(90, 70, 50), (5,), (0, 30, 100, 7)])
def test_rings_have_the_costs_of_the_map(values):
    grid = around_one_obstacle(0.07)
    curve = mapdeal.cost_curve(grid, model="rings", values=values)
    table = table_of(mapdeal.ring_cost(grid, values=values), max)
    assert dict(enumerate(curve.cost.tolist())) == {k: table[k] for k in range(len(values) + 1)}
    assert curve.cells.tolist() == list(range(len(values) + 1))
    assert {cost for rings, cost in table.items() if rings > len(values)} == {0}
    assert curve.metric == "chebyshev"


@pytest.mark.parametrize("lookup", ["exact", "nav2"])
def test_of_many_distances_the_ends_of_each_cost_are_listed(lookup):
    curve = mapdeal.cost_curve(0.01, lookup=lookup, **ROBOT)
    document = curve.document()
    assert document["distances"] == len(curve.cells) > MOST_LISTED
    assert not document["every_distance"]
    entries = document["curve"]
    assert len(entries) < MOST_LISTED
    places = np.searchsorted(curve.cells, [entry["cells"] for entry in entries])
    assert curve.cells[places].tolist() == [entry["cells"] for entry in entries]
    listed = np.zeros(len(curve.cells), int)
    for (first, entry), (last, _) in pairwise(zip(places, entries, strict=True)):
        listed[first:last] = entry["cost"]
    listed[-1] = entries[-1]["cost"]
    assert np.array_equal(listed, curve.cost)


def test_the_document_has_the_robot():
    radii = {"inscribed_radius": 0.2, "circumscribed_radius": 0.36, "inflation_radius": 0.53}
    document = mapdeal.cost_curve(0.05, cost_scaling_factor=5.0, **radii).document()
    curve = document.pop("curve")
    assert document == {
        **radii, "cost_scale": "costmap2d", "metric": "euclidean",
        "circumscribed_cost": int(252 * math.exp(-5 * 0.16)), "marks": {}, "reach_cells": 11.0,
        "reach_m": 11 * 0.05, "cost_at_reach": int(252 * math.exp(-5 * 0.35)),
        "distances": len(curve), "every_distance": True,
    }  # fmt: skip
    assert curve[2] == {"cells": math.sqrt(2), "distance_m": math.sqrt(2) * 0.05, "cost": 253}
