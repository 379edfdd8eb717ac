import functools

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import oracles
from drawn import grid_from_text
from mapdeal import (
    MapdealWarning,
    OccupancyGrid,
    ParameterError,
    esdf,
    exponential_cost,
    field_view,
    potential,
    ring_cost,
    threshold_cost,
)
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


THRESHOLDS = st.integers(0, 100) | st.integers(0, 40).map(lambda cells: f"{cells / 20:.2f}")


@given(
    occupancies(), st.sampled_from([0.04, 0.05, 0.1, 0.25]), st.sampled_from(["metric", "per-map"]),
    THRESHOLDS, THRESHOLDS, st.sampled_from([0.5, 1.0, 1.5]),
    st.sampled_from([(0.0, 1.5), (0.3, 1.1), (0.58, 0.07)]),
)  # fmt: skip
def test_threshold_costs_equal_brute_force_on_paper(
    occupancy, resolution, view, down, up, strength, factors
):
    """Thresholds are values of the view, or metres, as text; products of 0.58 are 29 of 50."""
    occupied = occupancy >= 100
    field = esdf(OccupancyGrid(occupancy, resolution, (0.5, -2.0, 1.0)), strength=strength)
    options = {"down_factor": factors[0], "up_factor": factors[1], "view": view}
    for name, value in (("down", down), ("up", up)):
        options |= {f"{name}_distance": float(value)} if isinstance(value, str) else {name: value}
    try:
        found = threshold_cost(field, **options).cost
    except ParameterError as error:
        assert "up" in str(error)  # in the wrong order
        assume(False)
    make = {"metric": functools.partial(oracles.metric_view, view_range=2.0)}
    values = make.get(view, oracles.per_map_view)(
        occupancy, occupied, resolution, strength=strength
    )  # fmt: skip
    squared = oracles.squared_distance(occupied)
    expected = oracles.threshold_cost(
        values, squared, resolution, strength, down=down, up=up, factors=factors
    )  # fmt: skip
    assert np.array_equal(found, expected)


def test_thresholds_in_the_wrong_order_are_refused():
    with pytest.raises(ParameterError, match="down"):
        threshold_cost(grid_from_text("#."), down=60, up=50)
    with pytest.raises(ParameterError, match=r"down_distance.*up_distance"):
        threshold_cost(grid_from_text("#."), down_distance=0.4, up_distance=0.5)
    with pytest.raises(
        ParameterError, match=r"down_distance: the view is 90 there, above up \(54\)"
    ) as e:
        threshold_cost(grid_from_text("#."), down_distance=0.2)
    assert e.value.hint == "give up_distance as well"
    with pytest.raises(
        ParameterError, match=r"up_distance: the view is 25 there, below down \(45\)"
    ) as e:
        threshold_cost(grid_from_text("#."), up_distance=1.5)
    assert e.value.hint == "give down_distance as well"
    with pytest.raises(ParameterError, match="down"):  # the view at 1.8 m is 10
        threshold_cost(grid_from_text("#."), down=11, up_distance=1.8)


def test_thresholds_in_metres_by_hand():
    # 0.25 m cells, views 100, 87, 75, 62, 50, 37, 25, -1
    grid = OccupancyGrid([[100, 0, 0, 0, 0, 0, 0, -1]] * 2, 0.25, (1.0, 2.0, 0.3))
    metres = {"down_distance": 1.25, "up_distance": 0.75, "down_factor": 0.5, "up_factor": 1.0}
    assert threshold_cost(grid, **metres).cost.tolist() == [[100, 87, 75, 31, 25, 0, 0, -1]] * 2
    doubled = esdf(grid, strength=2.0)  # 0.5, 1, 1.5 m and more: views 75, 50, 25, 0
    assert threshold_cost(doubled, **metres).cost.tolist() == [[100, 75, 25, 0, 0, 0, 0, -1]] * 2
    # one in metres and one as a value of the view
    mixed = threshold_cost(grid, down_distance=1.0, up=62, down_factor=1.0, up_factor=0.5)
    assert mixed.cost.tolist() == [[100, 43, 37, 62, 0, 0, 0, -1]] * 2


def test_thresholds_in_metres_are_met_between_the_steps_of_the_view():
    # 0.04 m cells of a range of 20 m: the view of the first five is 99
    grid = OccupancyGrid([[100, *[0] * 9]], 0.04, (0.5, -2.0, 1.0))
    options = {"down_distance": 0.12, "up_distance": 0.08, "down_factor": 0.5, "up_factor": 1.0}
    field = esdf(grid)
    cost = threshold_cost(field, view_range=20.0, **options).cost
    assert cost.tolist() == [[100, 99, 49, *[0] * 7]]
    # a view has no more than its values: 99 at both distances
    made = field_view(field, view_range=20.0)
    assert threshold_cost(made, view_range=20.0, **options).cost.tolist() == [[100, *[0] * 9]]


@pytest.mark.parametrize("name", ["down_distance", "up_distance"])
def test_a_threshold_beyond_the_metric_view_is_refused(name):
    with pytest.raises(ParameterError, match=rf"{name}.*view_range"):
        threshold_cost(grid_from_text("#."), **{"down": 0, name: 2.5})
    threshold_cost(grid_from_text("#."), down=0, **{name: 2.5}, view="per-map")
    threshold_cost(grid_from_text("#."), down=0, **{name: 2.5}, view_range=2.5)


def test_a_view_gives_the_costs_of_its_field():
    grid = OccupancyGrid([[100, 0, 0, 0, 0, -1], [-1, 0, 0, 30, 0, 100]], 0.25, (1.0, 2.0, 0.3))
    field = esdf(grid, strength=1.3)
    for view in ("metric", "per-map"):
        made = field_view(field, view=view, view_range=1.5)
        # metres that are multiples of the cells; of others a view has no more than its steps
        for more in ({}, {"down_distance": 0.65, "up_distance": 0.325, "down_factor": 0.4}):
            options = {"view": view, "view_range": 1.5, **more}
            expected = threshold_cost(field, **options)
            found = threshold_cost(made, **options)
            assert np.array_equal(found.cost, expected.cost)
            assert (found.origin, found.scale) == (expected.origin, expected.scale)


def test_a_view_is_taken_as_it_is_and_says_so():
    made = field_view(esdf(grid_from_text("#...", 0.25)), view_range=1.0)
    with pytest.warns(MapdealWarning, match="a view already, metric, 0 at 1 m"):
        assert threshold_cost(made, view_range=2.0).cost.tolist() == [[100, 99, 0, 0]]
    with pytest.raises(ParameterError, match="lethal_threshold"):
        threshold_cost(made, view_range=1.0, lethal_threshold=50)


@pytest.mark.parametrize("stage", [exponential_cost, ring_cost, potential])
def test_a_view_is_no_map_to_the_others(stage):
    with pytest.raises(ParameterError, match="view of a distance field"):
        stage(field_view(esdf(grid_from_text("#..."))))


@pytest.mark.parametrize("model", [exponential_cost, ring_cost])
def test_models_that_ignore_the_strength_warn(model):
    grid = grid_from_text("#...")
    with pytest.warns(MapdealWarning, match=r"no account of the field's strength, 1\.5"):
        found = model(esdf(grid, strength=1.5))
    assert np.array_equal(found.cost, model(esdf(grid)).cost)  # no warning here


def test_threshold_costs_are_of_the_strengthened_distances():
    grid = OccupancyGrid([[100, 0, 0, 0, 0, 0, -1]], 0.25, (1.0, 2.0, 0.3))
    options = {"down": 20, "up": 60, "down_factor": 0.5, "up_factor": 1.0}
    # doubled: 0.5, 1, 1.5, 2, 2.5 m: views 75, 50, 25, 0, 0
    found = threshold_cost(esdf(grid, strength=2.0), **options).cost
    assert found.tolist() == [[100, 75, 25, 12, 0, 0, -1]]
    # halved: 0.125 to 0.625 m: views 93, 87, 81, 75, 68
    found = threshold_cost(esdf(grid, strength=0.5), **options).cost
    assert found.tolist() == [[100, 93, 87, 81, 75, 68, -1]]


def test_a_clip_counts_with_the_strength():
    grid = OccupancyGrid([[100] + [0] * 19], 0.1)
    # clipped at 0.6 m, which doubled is 1.2 m: the view there is 40, below down
    whole = threshold_cost(esdf(grid, strength=2.0)).cost
    assert np.array_equal(threshold_cost(esdf(grid, max_distance=0.6, strength=2.0)).cost, whole)
    with pytest.raises(ParameterError, match="max_distance"):  # 1.2 m, which halved is 0.6 m
        threshold_cost(esdf(grid, max_distance=1.2, strength=0.5))


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
        threshold_cost(esdf(grid, max_distance=1.5), view="per-map")
    whole = threshold_cost(esdf(grid)).cost
    # At 1.25 m the view is 37: beyond it everything costs 0, clipped or not.
    assert np.array_equal(threshold_cost(esdf(grid, max_distance=1.25)).cost, whole)
    assert np.array_equal(threshold_cost(esdf(grid, max_distance=9.0), view="per-map").cost,
                          threshold_cost(esdf(grid), view="per-map").cost)  # fmt: skip


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


def test_a_field_clipped_inside_an_obstacle_only_has_no_view_per_map():
    grid = OccupancyGrid([[100] * 9 + [0]], 0.25)
    field = esdf(grid, max_distance=0.5)
    assert field.distance.max() < 0.5
    with pytest.raises(ParameterError, match="the per-map view still falls"):
        threshold_cost(field, view="per-map")


def test_views_of_long_distances_are_those_of_short_ones(monkeypatch):
    grid = OccupancyGrid([[100, 0, 0, 0, 0, 0, -1]], 0.25, (1.0, 2.0, 0.3))
    monkeypatch.setattr("mapdeal.stages.esdf._LARGEST_TABLE", 0)
    costmap = threshold_cost(grid, down=40, up=62, down_factor=0.5, up_factor=1.1)
    assert costmap.cost.tolist() == [[100, 95, 82, 31, 25, 0, -1]]  # as by hand above


@pytest.mark.parametrize(("cells", "view_range"), [(6, 1.0), (12, 2.0), (18, 3.0)])
def test_a_cell_as_far_as_the_threshold_is_not_lost_to_rounding(cells, view_range):
    grid = OccupancyGrid([[100, *[0] * 20]], 0.15, (0.5, -2.0, 1.0))
    distance = float(f"{0.15 * cells:.2f}")  # which 0.15 times the number of cells is not
    found = threshold_cost(grid, down_distance=distance, up_distance=0.0, down_factor=1.0,
                           view_range=view_range).cost[0]  # fmt: skip
    assert found[cells - 1] > 0
    assert not found[cells:].any()
