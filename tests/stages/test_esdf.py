import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from mapdeal import DistanceField, OccupancyGrid, ViewScale, esdf, field_view
from mapdeal.stages.esdf import squares_in
from strategies import RESOLUTIONS, occupancies

CONVENTIONS = ["fast-planner", "center", "border"]


@pytest.mark.slow
@given(occupancies(), RESOLUTIONS, st.sampled_from(CONVENTIONS), st.booleans())
def test_the_field_equals_brute_force_to_the_last_bit(occupancy, resolution, convention, counted):
    unknown = "occupied" if counted else "free"
    occupied = (occupancy == 100) | ((occupancy == -1) & counted)
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


@pytest.mark.parametrize("convention", CONVENTIONS)
@pytest.mark.parametrize("strength", [1.0, 1.3, 0.7])
@pytest.mark.parametrize("resolution", [0.05, 0.0504, 0.05000000074505806, 1 / 3])
def test_squared_cells_come_back_exactly_below_2048_cells(resolution, convention, strength):
    squares = np.arange(2**22 - 2**16, 2**22).reshape(2**8, 2**8)
    squares[0, :8] = np.arange(8)
    occupancy = np.where(squares == 0, 100, 0).astype(np.int8)
    shift = 0.5 * resolution if convention == "border" else 0.0
    distance = (strength * (np.sqrt(squares) * resolution - shift)).astype(np.float32)
    about = {"convention": convention, "strength": strength}
    field = DistanceField(distance, occupancy, resolution, **about)
    assert np.array_equal(squares_in(field, field.obstacles()), squares)


@given(
    occupancies(), RESOLUTIONS, st.sampled_from([0.4, 1.0, 2.0]),
    st.sampled_from(CONVENTIONS), st.sampled_from([0.3, 1.0, 1.5, 7.0]),
)  # fmt: skip
def test_views_equal_brute_force_whatever_the_convention(
    occupancy, resolution, view_range, convention, strength
):
    field = esdf(OccupancyGrid(occupancy, resolution), convention=convention, strength=strength)
    expected = oracles.metric_view(occupancy, occupancy >= 100, resolution, view_range, strength)
    view = field_view(field, view_range=view_range)
    assert np.array_equal(view.occupancy, expected)
    assert view.scale == ViewScale("metric", view_range)
    expected = oracles.per_map_view(occupancy, occupancy >= 100, resolution, strength)
    assert np.array_equal(field_view(field, view="per-map").occupancy, expected)


def test_a_strength_reaches_as_far_as_the_view_that_is_made_of_the_whole_map(monkeypatch):
    occupancy = np.zeros((3, 70), np.int8)
    occupancy[1, 5] = 100
    field = esdf(OccupancyGrid(occupancy, 0.05), strength=0.4)
    expected = oracles.metric_view(occupancy, occupancy >= 100, 0.05, 1.0, 0.4)
    assert np.array_equal(field_view(field, view_range=1.0).occupancy, expected)
    monkeypatch.setattr("mapdeal.stages.esdf._LARGEST_TABLE", 0)
    assert np.array_equal(field_view(field, view_range=1.0).occupancy, expected)


@pytest.mark.parametrize(("view", "view_range"), [("metric", 1e13), ("per-map", 2.0)])
def test_a_free_cell_is_never_an_obstacle_in_the_view(view, view_range):
    # of a field by others, with a free cell nearer than a cell to an obstacle
    field = DistanceField(np.float32([[0.0, 0.01, 0.2]]), [[100, 0, 0]], 0.1)
    values = field_view(field, view=view, view_range=view_range).occupancy[0].tolist()
    assert values == [100, 99, 99 if view == "metric" else 0]


@pytest.mark.parametrize(
    ("convention", "farthest", "deepest"),
    [("fast-planner", 0.33, 0.43), ("center", 0.33, 0.33), ("border", 0.38, 0.38)],
)
def test_the_per_map_view_of_a_clipped_field_takes_the_clip_for_the_extremes(
    convention, farthest, deepest
):
    grid = OccupancyGrid([[100] * 9 + [0] * 9], 0.1)
    scale = field_view(esdf(grid, convention=convention, max_distance=0.33), view="per-map").scale
    assert (scale.farthest, scale.deepest) == (farthest, deepest)
    for limit in (0.4, 0.5):  # within a cell
        field = esdf(OccupancyGrid([[100, 0, 0]], 1.0), convention=convention, max_distance=limit)
        assert field_view(field, view="per-map").occupancy.tolist() == [[100, 0, 0]]


@pytest.mark.parametrize(
    ("occupancy", "options", "expected"),
    [
        ([100] + [0] * 6, {"max_distance": 1.0}, [100, 75, 50, 50, 50, 50, 50]),
        ([100, 0, -1], {}, [100, 75, -1]),
        ([100, 0, -1], {"unknown": "occupied"}, [100, 75, 100]),
    ],
)
def test_views_of_clipped_fields_and_of_unknown_cells(occupancy, options, expected):
    field = esdf(OccupancyGrid([occupancy], 0.5), **options)
    assert field_view(field, view_range=2.0).occupancy.tolist() == [expected]
