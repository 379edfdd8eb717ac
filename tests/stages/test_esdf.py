import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from mapdeal import DistanceField, OccupancyGrid, ViewScale, esdf, field_view
from mapdeal.stages.esdf import squares_in
from strategies import RESOLUTIONS, occupancies

CONVENTIONS = st.sampled_from(["fast-planner", "center", "border"])


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


def test_max_distance_clips_both_signs_and_strength_only_lifts_the_positive():
    grid = OccupancyGrid([[100] * 4 + [0] * 4], 0.5)
    field = esdf(grid, max_distance=1.2, strength=1.5, convention="center")
    assert field.distance.tolist() == [
        [np.float32(v) for v in (-1.2, -1.2, -1.0, -0.5, 0.75, 1.5, 1.8, 1.8)]
    ]


@pytest.mark.parametrize("convention", ["fast-planner", "center", "border"])
@pytest.mark.parametrize("strength", [1.0, 1.3, 0.7])
@pytest.mark.parametrize("resolution", [0.05, 0.0504, 0.1, 0.05000000074505806, 1 / 3])
def test_squared_cells_come_back_exactly_below_2048_cells(resolution, convention, strength):
    squares = np.arange(2**22 - 2**16, 2**22).reshape(2**8, 2**8)
    squares[0, :8] = np.arange(8)
    occupancy = np.where(squares == 0, 100, 0).astype(np.int8)
    shift = 0.5 * resolution if convention == "border" else 0.0
    distance = strength * (np.sqrt(squares) * resolution - shift)
    field = DistanceField(
        distance.astype(np.float32), occupancy, resolution, convention=convention,
        strength=strength,
    )  # fmt: skip
    assert np.array_equal(squares_in(field, field.obstacles()), squares)


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


def test_a_strength_reaches_as_far_as_the_view_that_is_made_of_the_whole_map(monkeypatch):
    occupancy = np.zeros((3, 70), np.int8)
    occupancy[1, 5] = 100
    field = esdf(OccupancyGrid(occupancy, 0.05), strength=0.4)
    expected = oracles.metric_view(occupancy, occupancy >= 100, 0.05, 1.0, 0.4)
    assert np.array_equal(field_view(field, view_range=1.0).occupancy, expected)
    monkeypatch.setattr("mapdeal.stages.esdf._LARGEST_TABLE", 0)
    assert np.array_equal(field_view(field, view_range=1.0).occupancy, expected)


@given(occupancies(), RESOLUTIONS, CONVENTIONS, STRENGTHS)
def test_the_per_map_view_equals_brute_force(occupancy, resolution, convention, strength):
    field = esdf(OccupancyGrid(occupancy, resolution), convention=convention, strength=strength)
    expected = oracles.per_map_view(occupancy, occupancy >= 100, resolution, strength)
    assert np.array_equal(field_view(field, view="per-map").occupancy, expected)


def test_views_that_are_whole_on_paper_by_hand():
    # 0.1 m cells of a range of 2 m: 5 less for each, where floats make 64.99999999999999 of 65
    row = OccupancyGrid([[100, *[0] * 21]], 0.1, (0.5, -2.0, 1.0))
    assert field_view(esdf(row)).occupancy.tolist() == [[*range(100, -1, -5), 0]]
    # four rows of obstacles, the deepest 0.2 m, five free ones, up to 0.25 m, of 0.05 m cells:
    # the span is 0.25 - 0.05 + 0.2 m, of which a cell is an eighth
    columns = OccupancyGrid([[100] * 4 + [0] * 5] * 2, 0.05, (0.5, -2.0, 1.0))
    for convention in ("fast-planner", "center", "border"):
        view = field_view(esdf(columns, convention=convention), view="per-map")
        assert view.occupancy.tolist() == [[100] * 4 + [50, 37, 25, 12, 0]] * 2
        assert (view.scale.farthest, view.scale.deepest) == (0.25, 0.2)


@pytest.mark.parametrize(("view", "view_range"), [("metric", 1e13), ("per-map", 2.0)])
def test_a_free_cell_is_never_an_obstacle_in_the_view(view, view_range):
    # of a field by others, with a free cell nearer than a cell to an obstacle
    field = DistanceField(np.float32([[0.0, 0.01, 0.2]]), [[100, 0, 0]], 0.1)
    values = field_view(field, view=view, view_range=view_range).occupancy[0].tolist()
    assert values == [100, 99, 99 if view == "metric" else 0]


@pytest.mark.parametrize("convention", ["fast-planner", "center", "border"])
def test_the_per_map_view_of_a_clipped_field_takes_the_clip_for_the_extremes(convention):
    grid = OccupancyGrid([[100] * 9 + [0] * 9], 0.1)
    scale = field_view(
        esdf(grid, convention=convention, max_distance=0.33), view="per-map"
    ).scale  # fmt: skip
    outside, inside = {
        "fast-planner": (0.33, 0.43), "center": (0.33, 0.33), "border": (0.38, 0.38)
    }[convention]  # fmt: skip
    assert (scale.farthest, scale.deepest) == (outside, inside)


def test_the_view_of_a_clipped_field_ends_at_the_clip():
    grid = OccupancyGrid([[100] + [0] * 6], 0.5)
    view = field_view(esdf(grid, max_distance=1.0), view_range=2.0)
    assert view.occupancy.tolist() == [[100, 75, 50, 50, 50, 50, 50]]


def test_unknown_cells_in_the_view_are_unknown_or_obstacles():
    grid = OccupancyGrid([[100, 0, -1]], 0.5)
    assert field_view(esdf(grid)).occupancy.tolist() == [[100, 75, -1]]
    counted = esdf(grid, unknown="occupied")
    assert field_view(counted).occupancy.tolist() == [[100, 75, 100]]


@pytest.mark.parametrize("convention", ["fast-planner", "center", "border"])
@pytest.mark.parametrize("limit", [0.4, 0.5])
def test_the_per_map_view_of_a_field_that_is_clipped_within_a_cell(convention, limit):
    field = esdf(OccupancyGrid([[100, 0, 0]], 1.0), convention=convention, max_distance=limit)
    assert field_view(field, view="per-map").occupancy.tolist() == [[100, 0, 0]]
