import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from drawn import grid_from_text
from mapdeal import OccupancyGrid, ParameterError, ViewScale, esdf, field_view
from mapdeal.stages.field_values import squares_in
from strategies import RESOLUTIONS, occupancies

CONVENTIONS = st.sampled_from(["fast-planner", "center", "border"])


def test_the_three_conventions_on_a_row():
    grid = OccupancyGrid([[100, 100, 100, 0, 0]], 0.5, (1.0, 2.0, 0.3))
    by_hand = {
        "seed": [-1.0, -0.5, 0.0, 0.5, 1.0],
        "center": [-1.5, -1.0, -0.5, 0.5, 1.0],
        "border": [-1.25, -0.75, -0.25, 0.25, 0.75],
    }
    for convention, expected in by_hand.items():
        assert esdf(grid, convention=convention).distance.tolist() == [expected]


@pytest.mark.slow
@given(occupancies(), RESOLUTIONS, CONVENTIONS, st.sampled_from(["free", "occupied"]))
def test_the_field_equals_brute_force_to_the_last_bit(occupancy, resolution, convention, unknown):
    occupied = occupancy >= 100
    if unknown == "occupied":
        occupied |= occupancy == -1
    field = esdf(OccupancyGrid(occupancy, resolution), convention=convention, unknown=unknown)
    expected = oracles.signed_distance(occupied, resolution, convention).astype(np.float32)
    assert field.distance.dtype == np.float32
    assert np.array_equal(field.distance, expected)


@pytest.mark.parametrize(("drawing", "distance"), [("...\n...", math.inf), ("###\n###", -math.inf)])
@pytest.mark.parametrize("convention", ["fast-planner", "center", "border"])
def test_maps_of_one_kind_are_infinitely_far_from_the_other(drawing, distance, convention):
    assert (esdf(grid_from_text(drawing), convention=convention).distance == distance).all()


def test_max_distance_clips_both_signs_and_strength_only_lifts_the_positive():
    grid = OccupancyGrid([[100] * 4 + [0] * 4], 0.5)
    field = esdf(grid, max_distance=1.2, strength=1.5, convention="center")
    assert field.distance.tolist() == [
        [np.float32(v) for v in (-1.2, -1.2, -1.0, -0.5, 0.75, 1.5, 1.8, 1.8)]
    ]


@given(occupancies(), RESOLUTIONS, CONVENTIONS, st.sampled_from([1.0, 1.5, 0.3]))
def test_squared_cells_come_back_exactly_from_metres(occupancy, resolution, convention, strength):
    grid = OccupancyGrid(occupancy, resolution)
    field = esdf(grid, convention=convention, strength=strength)
    expected = oracles.squared_distance(occupancy >= 100)
    squared = squares_in(field, field.obstacles())
    for index in np.ndindex(occupancy.shape):
        assert squared[index] == (math.inf if expected[index] is None else expected[index])


def test_squared_cells_come_back_exactly_over_a_thousand_cells():
    occupancy = np.zeros((3, 1001), np.int8)
    occupancy[0, 0] = 100
    for resolution in (0.05, 0.0504, 0.1):
        field = esdf(OccupancyGrid(occupancy, resolution))
        squared = squares_in(field, field.obstacles())
        rows, cols = np.indices(occupancy.shape)
        assert np.array_equal(squared, rows**2 + cols**2)


STRENGTHS = st.sampled_from([0.3, 1.0, 1.5, 7.0])


@given(occupancies(), RESOLUTIONS, CONVENTIONS, st.sampled_from([0.4, 1.0, 2.0]), STRENGTHS)
def test_the_metric_view_equals_brute_force_whatever_the_convention(
    occupancy, resolution, convention, view_range, strength
):
    field = esdf(OccupancyGrid(occupancy, resolution), convention=convention, strength=strength)
    expected = oracles.metric_view(occupancy, occupancy >= 100, resolution, view_range, strength)
    view = field_view(field, view_range=view_range)
    assert np.array_equal(view.occupancy, expected)
    assert view.scale == ViewScale("metric", view_range)


def test_the_view_is_of_the_strengthened_distances_by_hand():
    # 0.25 m cells: 0.5, 1 and 1.5 m once doubled, of a range of 2 m
    grid = OccupancyGrid([[100, 0, 0, 0, -1], [100, 0, 0, 0, -1]], 0.25, (3.0, -1.0, 0.7))
    for convention in ("fast-planner", "center", "border"):
        view = field_view(esdf(grid, strength=2.0, convention=convention), view_range=2.0)
        assert view.occupancy.tolist() == [[100, 75, 50, 25, -1]] * 2
    # D = 2 m, of the unknown cells, which count as free, and I = 0.25 m
    view = field_view(esdf(grid, strength=2.0), view="per-map")
    assert view.occupancy.tolist() == [[100, 75, 50, 25, -1]] * 2
    assert (view.scale.farthest, view.scale.deepest) == (2.0, 0.25)


def test_a_strength_reaches_as_far_as_the_view_that_is_made_of_the_whole_map(monkeypatch):
    occupancy = np.zeros((3, 70), np.int8)
    occupancy[1, 5] = 100
    field = esdf(OccupancyGrid(occupancy, 0.05), strength=0.4)
    expected = oracles.metric_view(occupancy, occupancy >= 100, 0.05, 1.0, 0.4)
    assert np.array_equal(field_view(field, view_range=1.0).occupancy, expected)
    monkeypatch.setattr("mapdeal.stages.field_values._LARGEST_TABLE", 0)
    assert np.array_equal(field_view(field, view_range=1.0).occupancy, expected)


@given(occupancies(), RESOLUTIONS, CONVENTIONS, STRENGTHS)
def test_the_seed_view_equals_brute_force_up_to_rounding(
    occupancy, resolution, convention, strength
):
    field = esdf(OccupancyGrid(occupancy, resolution), convention=convention, strength=strength)
    expected = oracles.seed_view(occupancy, occupancy >= 100, resolution, strength)
    # I comes from float32 metres; only a value on the edge of two whole numbers may move.
    difference = field_view(field, view="per-map").occupancy.astype(int) - expected
    assert np.abs(difference).max() <= 1
    assert np.array_equal(expected == 100, occupancy >= 100)
    assert np.array_equal(expected == -1, occupancy == -1)


def test_the_view_of_a_clipped_field_ends_at_the_clip():
    grid = OccupancyGrid([[100] + [0] * 6], 0.5)
    view = field_view(esdf(grid, max_distance=1.0), view_range=2.0)
    assert view.occupancy.tolist() == [[100, 75, 50, 50, 50, 50, 50]]


def test_unknown_cells_in_the_view_are_unknown_or_obstacles():
    grid = OccupancyGrid([[100, 0, -1]], 0.5)
    assert field_view(esdf(grid)).occupancy.tolist() == [[100, 75, -1]]
    counted = esdf(grid, unknown="occupied")
    assert field_view(counted).occupancy.tolist() == [[100, 75, 100]]


@pytest.mark.parametrize(
    "wrong",
    [{"unknown": "lethal"}, {"convention": "middle"}, {"max_distance": 0}, {"strength": -1},
     {"lethal_threshold": 0}, {"lethal_threshold": 50.5}],
)  # fmt: skip
def test_parameters_that_are_none_are_refused_by_name(wrong):
    with pytest.raises(ParameterError, match=next(iter(wrong))):
        esdf(grid_from_text("..#"), **wrong)


@pytest.mark.parametrize("convention", ["fast-planner", "center", "border"])
@pytest.mark.parametrize("limit", [0.4, 0.5])
def test_the_seed_view_of_a_field_that_is_clipped_within_a_cell(convention, limit):
    field = esdf(OccupancyGrid([[100, 0, 0]], 1.0), convention=convention, max_distance=limit)
    assert field_view(field, view="per-map").occupancy.tolist() == [[100, 0, 0]]
