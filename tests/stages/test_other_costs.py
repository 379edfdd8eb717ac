import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from drawn import grid_from_text
from mapdeal import OccupancyGrid, ParameterError, esdf, ring_cost, threshold_cost
from strategies import occupancies


def test_thresholds_on_the_metric_view_by_hand():
    # 0.25 m cells, view range 2 m: the view falls by 12.5 a cell, truncated.
    grid = OccupancyGrid([[100, 0, 0, 0, 0, 0, -1]], 0.25, (1.0, 2.0, 0.3))
    costmap = threshold_cost(grid, down=40, up=62, down_factor=0.5, up_factor=1.1)
    # views 100, 87, 75, 62, 50, 37, -1
    assert costmap.cost.tolist() == [[100, 95, 82, 31, 25, 0, -1]]
    assert costmap.scale == "occupancy"


def test_products_never_reach_the_obstacles_value():
    grid = OccupancyGrid([[100, 0, 0, 0]], 0.05)
    assert threshold_cost(grid, up_factor=1000.0).cost.tolist() == [[100, 99, 99, 99]]


@given(occupancies(), st.sampled_from(["metric", "seed"]), st.integers(0, 100), st.integers(0, 100))
def test_threshold_costs_equal_brute_force_on_the_view(occupancy, view, one, other):
    down, up = sorted((one, other))
    grid = OccupancyGrid(occupancy, 0.1)
    if view == "metric":
        values = oracles.metric_view(occupancy, occupancy >= 100, 0.1, 2.0)
    else:
        from mapdeal import field_view

        values = field_view(esdf(grid), view="seed").occupancy  # held to its oracle elsewhere
    cost = threshold_cost(esdf(grid), view=view, down=down, up=up, down_factor=0.3).cost
    for index in np.ndindex(occupancy.shape):
        v = int(values[index])
        expected = v
        if v == 100:
            pass
        elif 0 <= v <= down:
            expected = 0
        elif down < v <= up:
            expected = min(99, int(0.3 * v))
        elif up < v:
            expected = min(99, int(1.5 * v))
        assert cost[index] == expected


def test_thresholds_in_the_wrong_order_are_refused():
    with pytest.raises(ParameterError, match="down"):
        threshold_cost(grid_from_text("#."), down=60, up=50)


def test_rings_by_hand_cover_unknown_cells_and_keep_the_rest():
    grid = grid_from_text("?......\n?......\n#?...+.")
    expected = [[100, 90, 70, 50, 0, 50, 0], [90, 90, 70, 50, 0, 0, 0], [70, 70, 70, 50, 0, 0, 0]]
    assert ring_cost(grid).cost.tolist() == expected


@given(occupancies(), st.lists(st.integers(0, 100), min_size=1, max_size=4))
def test_rings_equal_brute_force(occupancy, values):
    inner = occupancy >= 100
    expected = occupancy.copy()
    for reach, value in enumerate(values, 1):
        outer = oracles.square_inflation(occupancy >= 100, reach)
        expected[outer & ~inner] = value
        inner = outer
    assert np.array_equal(ring_cost(OccupancyGrid(occupancy, 0.3), values=values).cost, expected)


def test_rings_of_a_field_take_its_obstacles():
    field = esdf(grid_from_text("#...?"), unknown="occupied")
    assert ring_cost(field, values=(80,)).cost.tolist() == [[100, 80, 0, 80, 100]]


@pytest.mark.parametrize("values", [(), (101,), ("a",), 5, "90,x"])
def test_values_that_are_no_costs_are_refused(values):
    with pytest.raises(ParameterError, match="values"):
        ring_cost(grid_from_text("#."), values=values)


def test_a_field_clipped_where_costs_still_fall_is_refused():
    grid = OccupancyGrid([[100] + [0] * 9], 0.25)
    with pytest.raises(ParameterError, match="max_distance"):
        threshold_cost(esdf(grid, max_distance=1.0))  # the view there is 50, above down
    with pytest.raises(ParameterError, match="max_distance"):
        threshold_cost(esdf(grid, max_distance=1.5), view="seed")
    whole = threshold_cost(esdf(grid)).cost
    # At 1.25 m the view is 37: beyond it everything costs 0, clipped or not.
    assert np.array_equal(threshold_cost(esdf(grid, max_distance=1.25)).cost, whole)
    assert np.array_equal(threshold_cost(esdf(grid, max_distance=9.0), view="seed").cost,
                          threshold_cost(esdf(grid), view="seed").cost)  # fmt: skip


@pytest.mark.parametrize(("max_distance", "is_refused"), [(1.07, True), (1.13, False)])
def test_a_clip_may_lie_where_the_view_is_down_at_most(max_distance, is_refused):
    # the view is 46 at 1.07 m and 43 at 1.13 m
    field = esdf(OccupancyGrid([[100] + [0] * 19], 0.1), max_distance=max_distance)
    if is_refused:
        with pytest.raises(ParameterError, match="the metric view still falls"):
            threshold_cost(field)
    else:
        threshold_cost(field)
    with pytest.raises(ParameterError, match="max_distance"):
        threshold_cost(field, down=42)


def test_a_field_clipped_inside_an_obstacle_only_has_no_seed_view():
    grid = OccupancyGrid([[100] * 9 + [0]], 0.25)
    field = esdf(grid, max_distance=0.5)
    assert field.distance.max() < 0.5
    with pytest.raises(ParameterError, match="the seed view still falls"):
        threshold_cost(field, view="seed")


def test_views_of_long_distances_are_those_of_short_ones(monkeypatch):
    grid = OccupancyGrid([[100, 0, 0, 0, 0, 0, -1]], 0.25, (1.0, 2.0, 0.3))
    monkeypatch.setattr("mapdeal.stages.field_values._LARGEST_TABLE", 0)
    costmap = threshold_cost(grid, down=40, up=62, down_factor=0.5, up_factor=1.1)
    assert costmap.cost.tolist() == [[100, 95, 82, 31, 25, 0, -1]]  # as by hand above
