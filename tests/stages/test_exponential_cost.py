import math
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
import oracles
from drawn import grid_from_text
from strategies import examples, occupancies

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")


def row_of(length, resolution):
    return mapdeal.OccupancyGrid([[100] + [0] * (length - 1)], resolution, (1.0, 2.0, 0.3))


# Computed by hand from the formula of costmap_2d.
@pytest.mark.parametrize(("resolution", "options", "expected"), [
    (0.05, {"inscribed_radius": 0.2, "cost_scaling_factor": 10},
     [254, 253, 253, 253, 253, 152, 92, 56, 34, 20, 12, 7]),
    # with float32 resolutions the last bits decide: 3 * float32(0.1) is 0.3000000045
    (0.1, {"inscribed_radius": 0.3, "float32_resolution": True}, [254, 253, 253, 251]),
], ids=str)  # fmt: skip
def test_golden_costs_along_a_row(resolution, options, expected):
    grid = row_of(len(expected), resolution)
    costs = mapdeal.exponential_cost(grid, inflation_radius=1.0, **options)
    assert costs.cost.tolist() == [expected]


def test_the_map_of_costmap_2d_s_own_tests(real_maps):
    grid = mapdeal.read_map(real_maps / "ros-planning__navigation/costmap_2d/test/TenByTen.yaml")
    radii = {"inscribed_radius": 1.0, "inflation_radius": 1.0}
    cost = mapdeal.exponential_cost(grid, **radii).cost
    assert (np.count_nonzero(cost == 254), np.count_nonzero(cost == 253)) == (20, 28)
    occupancy = grid.occupancy.copy()
    occupancy[0, 0] = 100
    cost = mapdeal.exponential_cost(mapdeal.OccupancyGrid(occupancy, grid.resolution), **radii).cost
    assert np.count_nonzero(cost >= 253) - np.count_nonzero(cost == 255) == 51


@pytest.mark.slow
@examples(80)
@given(
    occupancies(), st.sampled_from([0.04, 0.1, 0.25, 0.7]),
    st.fixed_dictionaries({
        "inscribed_radius": st.sampled_from([0.0, 0.22549849949589046, 0.5]),
        "inflation_radius": st.sampled_from([0.0, 0.3, 0.4, 0.7, 1.4, 2.0]),
        "cost_scaling_factor": st.sampled_from([0.0, 3.0, 10.0, 1e4]),
        "lethal_threshold": st.sampled_from([1, 50, 65, 100]),
        "trinary_costmap": st.booleans(), "track_unknown_space": st.booleans(),
        "inscribed_obstacle_cost_value": st.sampled_from([None, 50, 99, 100]),
        "inflate_unknown": st.booleans(), "inflate_around_unknown": st.booleans(),
        "lookup": st.sampled_from(["exact", "nav2"]),
        "float32_resolution": st.sampled_from([None, True]),
    }),
    st.fixed_dictionaries({
        "unknown": st.sampled_from(["free", "occupied"]), "strength": st.sampled_from([1.0, 1.5]),
        "convention": st.sampled_from(["fast-planner", "center", "border"]),
        "max_distance": st.sampled_from([None, 2.9]),
    }),
)  # fmt: skip
def test_the_rules_of_the_static_layer_and_of_nav2_s_lookup_equal_brute_force(
    occupancy, resolution, about, of_field
):
    grid = mapdeal.OccupancyGrid(occupancy, resolution, (1.5, -2.0, 0.4))

    def expected(*, unknown_is_lethal):
        old = np.zeros(occupancy.shape, np.uint8)
        for index in np.ndindex(occupancy.shape):
            old[index] = oracles.static_layer_cost(
                int(occupancy[index]), about["lethal_threshold"], trinary=about["trinary_costmap"],
                track_unknown=about["track_unknown_space"],
                inscribed=about["inscribed_obstacle_cost_value"],
            )  # fmt: skip
            if unknown_is_lethal and occupancy[index] == -1:
                old[index] = 254
        return oracles.exponential_cost(
            old, resolution, about["inscribed_radius"], about["inflation_radius"],
            about["cost_scaling_factor"], about["inflate_unknown"],
            about["inflate_around_unknown"], lookup=about["lookup"],
            float32=about["float32_resolution"] or about["lookup"] == "nav2",
        )  # fmt: skip

    cost = mapdeal.exponential_cost(grid, **about).cost
    assert np.array_equal(cost, expected(unknown_is_lethal=False))
    field = mapdeal.esdf(grid, lethal_threshold=about["lethal_threshold"], **of_field)
    cost = mapdeal.exponential_cost(field, **about).cost
    assert np.array_equal(cost, expected(unknown_is_lethal=of_field["unknown"] == "occupied"))


@pytest.mark.parametrize("convention", ["fast-planner", "border"])
@pytest.mark.parametrize("max_distance", [0.6, 0.601, 0.7])
def test_a_field_clipped_at_the_reach_or_beyond_gives_the_same_costs(convention, max_distance):
    grid = grid_from_text("#.........", resolution=0.1)
    parameters = {"inflation_radius": 0.6, "cost_scaling_factor": 1.0}
    expected = mapdeal.exponential_cost(grid, **parameters).cost
    clipped = mapdeal.esdf(grid, convention=convention, max_distance=max_distance)
    assert np.array_equal(mapdeal.exponential_cost(clipped, **parameters).cost, expected)
    assert expected[0, 6] > 0 == expected[0, 7]


@given(occupancies(), st.sampled_from([0.0, 1e-6, 0.3, 3.0, 40.0]), st.sampled_from([0.0, 0.4]))
def test_costs_end_by_their_own_decay_where_nothing_else_ends_them(occupancy, factor, inscribed):
    cost = mapdeal.exponential_cost(
        mapdeal.OccupancyGrid(occupancy, 0.25), inscribed_radius=inscribed,
        inflation_radius=1e5, cost_scaling_factor=factor,
    ).cost  # fmt: skip
    squared = oracles.squared_distance(occupancy >= 100)
    for index in np.ndindex(occupancy.shape):
        if occupancy[index] >= 0 and squared[index] is not None:
            cells = math.sqrt(squared[index])
            assert cost[index] == oracles.cost_of_distance(cells, 0.25, inscribed, factor)


@pytest.mark.parametrize("resolution", ["0.05", "0.1", "0.07"])
def test_a_cell_at_exactly_the_inscribed_radius_is_inscribed(resolution):
    # 3 * 0.1 is 0.30000000000000004 in floats, more than 0.3
    grid = row_of(41, float(resolution))
    for cells in range(1, 30):
        radius = float(cells * Decimal(resolution))
        cost = mapdeal.exponential_cost(grid, inscribed_radius=radius, inflation_radius=4.0).cost[0]
        assert (cost[1 : cells + 1] == 253).all()
        assert cost[cells + 1] < 253
        assert np.array_equal(mapdeal.inflate(grid, radius=radius).occupancy[0] == 100, cost >= 253)


@pytest.mark.parametrize(("inscribed", "circumscribed", "cost", "warned"), [
    (0.3, 0.6, 12, 0),  # trunc(252 exp(-10 * 0.3))
    (0.3, 0.3, 253, 0), (0.3, 0.2, 253, 0), (0.3, 0.601, 0, 1), (0.6, 0.6, 253, 0),
    (0.601, 0.6, 253, 1),
])  # fmt: skip
def test_radii_that_are_equal_fit(recwarn, inscribed, circumscribed, cost, warned):
    radii = {"inscribed_radius": inscribed, "circumscribed_radius": circumscribed}
    costmap = mapdeal.exponential_cost(grid_from_text("#.."), inflation_radius=0.6, **radii)
    assert costmap.circumscribed_cost == cost
    assert len(recwarn) == warned
