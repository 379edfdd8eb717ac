import json
import math
from dataclasses import fields
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oracles
from drawn import grid_from_text
from mapdeal import (
    InflationLayer,
    MapdealWarning,
    OccupancyGrid,
    ParameterError,
    esdf,
    exponential_cost,
    inflate,
    read_map,
)
from mapdeal.pipeline.step import make_step
from mapdeal.stages.exponential_cost import CostProfile, cost_table
from strategies import RESOLUTIONS, occupancies

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")


def _row(length, resolution, **parameters):
    grid = OccupancyGrid([[100] + [0] * (length - 1)], resolution, (1.0, 2.0, 0.3))
    return exponential_cost(grid, inflation_radius=length * resolution, **parameters).cost[0]


# Computed by hand from the formula of costmap_2d.
@pytest.mark.parametrize(
    ("resolution", "inscribed", "factor", "expected"),
    [
        (0.05, 0.2, 10, [254, 253, 253, 253, 253, 152, 92, 56, 34, 20, 12, 7]),
        (0.05, 0.325, 10, [254, *[253] * 6, 196, 119, 72, 43, 26, 16, 9, 5, 3]),
        (0.05, 0.22, 3, [254, *[253] * 4, 230, 198, 170, 146, 126, 108, 93]),
    ],
)
def test_golden_costs_along_a_row(resolution, inscribed, factor, expected):
    costs = _row(len(expected), resolution, inscribed_radius=inscribed, cost_scaling_factor=factor)
    assert costs.tolist() == expected


@pytest.mark.parametrize(
    ("squared", "cost"), [(0, 254), (1, 253), (4, 253), (5, 219), (9, 102), (10, 87), (16, 37)]
)
def test_golden_costs_of_squared_distances(squared, cost):
    layer = InflationLayer(inscribed_radius=2.1, cost_scaling_factor=1.0)
    table = cost_table(5, layer, 1.0)
    assert table[squared] == cost


def test_inflation_reaches_whole_cells_and_then_stops():
    grid = OccupancyGrid([[100] + [0] * 9], 0.1)
    cost = exponential_cost(grid, inflation_radius=0.42, cost_scaling_factor=0.0).cost
    assert cost.tolist() == [[254, 252, 252, 252, 252, 252, 0, 0, 0, 0]]


def test_the_unit_test_of_nav2_with_an_unknown_map():
    occupancy = np.full((9, 9), -1, np.int8)
    occupancy[4, 4] = 100
    costmap = exponential_cost(
        OccupancyGrid(occupancy, 1.0), inflation_radius=4.1, cost_scaling_factor=1.0,
        inflate_unknown=True,
    )  # fmt: skip
    unknown = {tuple(c) for c in np.argwhere(costmap.cost == 255).tolist()}
    assert unknown == {(0, 0), (0, 8), (8, 0), (8, 8)}


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        # Inscribed cells at 0.2 m and less; trunc(252 exp(-10 * 0.1)) is 92 at 0.3 m.
        ({}, [254, 253, 253, 255, 34, 255]),
        ({"inflate_unknown": True}, [254, 253, 253, 92, 34, 12]),
        ({"inflate_around_unknown": True}, [254, 254, 254, 254, 253, 254]),
    ],
)
def test_unknown_cells_take_inscribed_costs_always_and_others_if_told(options, expected):
    grid = grid_from_text("#???.?", resolution=0.1)
    cost = exponential_cost(grid, inscribed_radius=0.2, inflation_radius=0.5, **options).cost
    assert cost.tolist() == [expected]


def test_the_map_of_costmap_2d_s_own_tests(real_maps):
    grid = read_map(real_maps / "ros-planning__navigation/costmap_2d/test/TenByTen.yaml")
    radii = {"inscribed_radius": 1.0, "inflation_radius": 1.0}
    cost = exponential_cost(grid, **radii).cost
    assert (np.count_nonzero(cost == 254), np.count_nonzero(cost == 253)) == (20, 28)
    occupancy = grid.occupancy.copy()
    occupancy[0, 0] = 100
    cost = exponential_cost(OccupancyGrid(occupancy, grid.resolution), **radii).cost
    assert np.count_nonzero(cost >= 253) - np.count_nonzero(cost == 255) == 51


@given(
    occupancies(),
    RESOLUTIONS,
    st.sampled_from([0.0, 0.1, 0.22, 0.5]),
    st.sampled_from([0.0, 0.3, 0.55, 2.0]),
    st.sampled_from([0.0, 1.0, 10.0, 1e4]),
    st.booleans(),
    st.booleans(),
)
def test_costs_equal_brute_force(
    occupancy, resolution, inscribed, inflation, factor, inflate_unknown, around_unknown
):
    old = np.zeros(occupancy.shape, np.uint8)
    old[occupancy == -1] = 255
    old[occupancy == 100] = 254
    expected = oracles.exponential_cost(
        old, resolution, inscribed, inflation, factor, inflate_unknown, around_unknown
    )
    parameters = {
        "inscribed_radius": inscribed,
        "inflation_radius": inflation,
        "cost_scaling_factor": factor,
        "inflate_unknown": inflate_unknown,
        "inflate_around_unknown": around_unknown,
    }
    grid = OccupancyGrid(occupancy, resolution)
    assert np.array_equal(exponential_cost(grid, **parameters).cost, expected)
    for convention in ("fast-planner", "center", "border"):
        field = esdf(grid, convention=convention, strength=1.5)
        assert np.array_equal(exponential_cost(field, **parameters).cost, expected)


@pytest.mark.slow
@settings(max_examples=200)
@given(
    occupancies(),
    st.sampled_from([0.04, 0.1, 0.25, 0.7]),
    st.sampled_from([0.0, 0.22549849949589046, 0.5]),
    st.sampled_from([0.4, 0.7, 1.4, 2.0]),
    st.sampled_from([0.0, 3.0, 10.0]),
    st.fixed_dictionaries({
        "lethal_threshold": st.sampled_from([1, 50, 65, 100]),
        "trinary_costmap": st.booleans(),
        "track_unknown_space": st.booleans(),
        "inscribed_obstacle_cost_value": st.sampled_from([None, 50, 99, 100]),
        "inflate_unknown": st.booleans(),
        "inflate_around_unknown": st.booleans(),
        "lookup": st.sampled_from(["exact", "nav2"]),
        "float32_resolution": st.sampled_from([None, True]),
    }),
    st.sampled_from(["free", "occupied"]),
)  # fmt: skip
def test_the_rules_of_the_static_layer_and_of_nav2_s_lookup_equal_brute_force(
    occupancy, resolution, inscribed, inflation, factor, about, unknown
):
    radii = {
        "inscribed_radius": inscribed, "inflation_radius": inflation, "cost_scaling_factor": factor
    }  # fmt: skip

    def expected(*, unknown_is_lethal):
        old = np.zeros(occupancy.shape, np.uint8)
        for index in np.ndindex(occupancy.shape):
            old[index] = oracles.static_layer_cost(
                int(occupancy[index]),
                about["lethal_threshold"],
                trinary=about["trinary_costmap"],
                track_unknown=about["track_unknown_space"],
                inscribed=about["inscribed_obstacle_cost_value"],
            )
            if unknown_is_lethal and occupancy[index] == -1:
                old[index] = 254
        return oracles.exponential_cost(
            old, resolution, inscribed, inflation, factor,
            about["inflate_unknown"], about["inflate_around_unknown"],
            lookup=about["lookup"],
            float32=about["float32_resolution"] or about["lookup"] == "nav2",
        )  # fmt: skip

    grid = OccupancyGrid(occupancy, resolution, (1.5, -2.0, 0.4))
    of_map = expected(unknown_is_lethal=False)
    assert np.array_equal(exponential_cost(grid, **radii, **about).cost, of_map)
    threshold = about["lethal_threshold"]
    for max_distance in (None, 2.5):
        field = esdf(
            grid, unknown=unknown, lethal_threshold=threshold, max_distance=max_distance
        )  # fmt: skip
        made = exponential_cost(field, **radii, **about).cost
        assert np.array_equal(
            made, expected(unknown_is_lethal=True) if unknown == "occupied" else of_map
        )


def test_nav2_looks_costs_up_at_hundredths_of_a_cell():
    # sqrt(2) cells are 1.41, of the float32 resolution: 252 exp(-3 * (0.0705 - 0)) = 203.9...
    layer = InflationLayer(cost_scaling_factor=3.0, lookup="nav2")
    costs = cost_table(2, layer, float(np.float32(0.05)))
    assert costs.tolist() == [
        254,
        int(252 * math.exp(-3 * 1.00 * 0.05000000074505806)),
        int(252 * math.exp(-3 * 1.41 * 0.05000000074505806)),
        int(252 * math.exp(-3 * 1.73 * 0.05000000074505806)),
        int(252 * math.exp(-3 * 2.00 * 0.05000000074505806)),
        0,
    ]


def test_a_float32_resolution_reaches_as_many_cells_as_in_ros():
    # float32(0.04) is 0.03999999910593033, and 0.4 m of it are more than ten cells
    grid = OccupancyGrid([[100] + [0] * 13], 0.04)
    for options, cells in (
        ({}, 10),
        ({"float32_resolution": True}, 11),
        ({"lookup": "nav2"}, 11),
        ({"float32_resolution": False}, 10),
    ):
        cost = exponential_cost(
            grid, inflation_radius=0.4, cost_scaling_factor=0.0, **options
        )  # fmt: skip
        assert np.count_nonzero(cost.cost) == 1 + cells


def test_lookup_nav2_has_no_other_resolution_than_a_message_s():
    with pytest.raises(ParameterError, match="float32_resolution: cannot be no with lookup nav2"):
        exponential_cost(grid_from_text("#.."), lookup="nav2", float32_resolution=False)
    with pytest.raises(ParameterError, match=r"cost\.float32_resolution"):
        make_step("cost", {"lookup": "nav2", "float32_resolution": "no"})
    for given_, told in (({}, False), ({"lookup": "nav2"}, True)):
        assert make_step("cost", given_).parameters["float32_resolution"] is told


@pytest.mark.parametrize("case", range(16))
def test_costs_equal_the_real_layer_within_the_brushfire_s_error(real_maps, case):
    about = json.loads((real_maps / "expected" / "peers.json").read_text())[f"inflation/{case}"]
    with np.load(real_maps / "expected" / "peers.npz") as expected:
        old, legacy = (expected[f"inflation/{case}/{name}"] for name in ("in", "legacy"))
    names = [one.name for one in fields(InflationLayer) if one.name in about]
    layer = InflationLayer(**{name: about[name] for name in names})
    grid = OccupancyGrid(np.zeros(old.shape, np.int8), about["resolution"])
    cost = old.copy()
    CostProfile(grid, layer, float32_resolution=False).raise_around_seeds(cost)
    differing = cost != legacy
    assert differing.mean() <= 0.003
    assert (cost[differing] > legacy[differing]).all()


def test_a_field_that_counts_unknown_as_occupied_makes_it_lethal():
    grid = grid_from_text("#..?", resolution=0.5)
    field = esdf(grid, unknown="occupied")
    cost = exponential_cost(field, inflation_radius=0.5, cost_scaling_factor=0.0).cost
    assert cost.tolist() == [[254, 252, 252, 254]]
    assert exponential_cost(esdf(grid)).cost[0, 3] == 255


def test_a_field_clipped_below_the_reach_is_refused():
    field = esdf(grid_from_text("#......", resolution=0.1), max_distance=0.5)
    with pytest.raises(ParameterError, match="max_distance"):
        exponential_cost(field, inflation_radius=0.55)


@pytest.mark.parametrize("convention", ["fast-planner", "border"])
@pytest.mark.parametrize("max_distance", [0.6, 0.601, 0.7])
def test_a_field_clipped_at_the_reach_or_beyond_gives_the_same_costs(convention, max_distance):
    grid = grid_from_text("#.........", resolution=0.1)
    parameters = {"inflation_radius": 0.6, "cost_scaling_factor": 1.0}
    whole = exponential_cost(grid, **parameters).cost
    clipped = esdf(grid, convention=convention, max_distance=max_distance)
    assert np.array_equal(exponential_cost(clipped, **parameters).cost, whole)
    assert whole[0, 6] > 0 == whole[0, 7]


def test_another_threshold_than_the_field_s_is_refused():
    field = esdf(grid_from_text("#.+"), lethal_threshold=50)
    with pytest.raises(ParameterError, match="lethal_threshold"):
        exponential_cost(field, lethal_threshold=100)


def test_the_circumscribed_cost_is_the_cost_at_that_distance():
    grid = OccupancyGrid([[100] + [0] * 11], 0.05)
    costmap = exponential_cost(
        grid, inscribed_radius=0.2, circumscribed_radius=0.35, cost_scaling_factor=10
    )
    assert costmap.circumscribed_cost == 56 == costmap.cost[0, 7]


def test_radii_that_do_not_fit_are_warned_of():
    grid = grid_from_text("#..")
    with pytest.warns(MapdealWarning, match="inscribed_radius"):
        exponential_cost(grid, inscribed_radius=0.6)
    with pytest.warns(MapdealWarning, match="circumscribed"):
        assert exponential_cost(grid, circumscribed_radius=0.6).circumscribed_cost == 0


@given(occupancies(), st.sampled_from([0.0, 1e-6, 0.3, 3.0, 40.0]), st.sampled_from([0.0, 0.4]))
def test_costs_end_by_their_own_decay_where_nothing_else_ends_them(occupancy, factor, inscribed):
    resolution = 0.25
    cost = exponential_cost(
        OccupancyGrid(occupancy, resolution),
        inscribed_radius=inscribed,
        inflation_radius=1e5,
        cost_scaling_factor=factor,
    ).cost
    squared = oracles.squared_distance(occupancy >= 100)
    for index in np.ndindex(occupancy.shape):
        if occupancy[index] >= 0 and squared[index] is not None:
            cells = math.sqrt(squared[index])
            assert cost[index] == oracles.cost_of_distance(cells, resolution, inscribed, factor)


def test_the_last_cost_above_0_is_kept_between_whole_cells():
    occupancy = np.zeros((40, 43), np.int8)
    occupancy[0, 0] = 100
    grid = OccupancyGrid(occupancy, 0.05)
    cost = exponential_cost(grid, inflation_radius=1e5, cost_scaling_factor=3.0).cost
    for row, col in np.ndindex(cost.shape):
        cells = math.hypot(row, col)
        assert cost[row, col] == oracles.cost_of_distance(cells, 0.05, 0.0, 3.0)
    assert (cost == 1).any()


@pytest.mark.parametrize("resolution", ["0.05", "0.1", "0.07"])
def test_a_cell_at_exactly_the_inscribed_radius_is_inscribed(resolution):
    # 3 * 0.1 is 0.30000000000000004 in floats, more than 0.3
    grid = OccupancyGrid([[100] + [0] * 40], float(resolution))
    for cells in range(1, 30):
        radius = float(cells * Decimal(resolution))
        cost = exponential_cost(grid, inscribed_radius=radius, inflation_radius=4.0).cost[0]
        assert (cost[1 : cells + 1] == 253).all()
        assert cost[cells + 1] < 253
        inflated = inflate(grid, radius=radius).occupancy[0]
        assert np.array_equal(inflated == 100, cost >= 253)


def test_with_float32_resolutions_the_last_bits_decide_as_in_costmap_2d():
    grid = OccupancyGrid([[100, 0, 0, 0]], 0.1)  # 3 * float32(0.1) is 0.3000000045
    cost = exponential_cost(grid, inscribed_radius=0.3, float32_resolution=True).cost
    assert cost.tolist() == [[254, 253, 253, 251]]


@pytest.mark.parametrize(
    ("inscribed", "circumscribed", "inflation", "cost", "warned"),
    [
        (0.3, 0.3, 0.6, 253, 0),
        (0.3, 0.2, 0.6, 253, 0),
        (0.3, 0.6, 0.6, 12, 0),  # trunc(252 exp(-10 * 0.3))
        (0.3, 0.601, 0.6, 0, 1),
        (0.6, 0.6, 0.6, 253, 0),
        (0.601, 0.6, 0.6, 253, 1),
    ],
)
def test_radii_that_are_equal_fit(recwarn, inscribed, circumscribed, inflation, cost, warned):
    costmap = exponential_cost(
        grid_from_text("#.."), inscribed_radius=inscribed, inflation_radius=inflation,
        circumscribed_radius=circumscribed,
    )  # fmt: skip
    assert costmap.circumscribed_cost == cost
    assert len(recwarn) == warned
