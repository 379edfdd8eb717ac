import numpy as np
import pytest
from hypothesis import given, strategies as st

import oracles
from mapdeal import DistanceField, OccupancyGrid, ViewScale, esdf, field_view
from mapdeal.stages.esdf import bytes_in, squares_in
from strategies import RESOLUTIONS, occupancies

CONVENTIONS = ["fast-planner", "center", "border"]


@pytest.mark.slow
@given(occupancies(), RESOLUTIONS, st.sampled_from(CONVENTIONS),
       st.sampled_from(["free", "occupied"]))  # fmt: skip
def test_the_field_equals_brute_force_to_the_last_bit(occupancy, resolution, convention, unknown):
    occupied = (occupancy == 100) | ((occupancy == -1) & (unknown == "occupied"))
    field = esdf(OccupancyGrid(occupancy, resolution), convention=convention, unknown=unknown)
    expected = oracles.signed_distance(occupied, resolution, convention).astype(np.float32)
    assert field.distance.dtype == np.float32
    assert np.array_equal(field.distance, expected)


def test_max_distance_clips_both_signs_and_strength_scales_only_positive_distances():
    grid = OccupancyGrid([[100] * 4 + [0] * 4], 0.5)
    field = esdf(grid, max_distance=1.2, strength=1.5, convention="center")
    expected = np.float32([[-1.2, -1.2, -1.0, -0.5, 0.75, 1.5, 1.8, 1.8]])
    assert np.array_equal(field.distance, expected)


@pytest.mark.parametrize("convention", CONVENTIONS)
@pytest.mark.parametrize("strength", [1.0, 1.3, 0.7])
@pytest.mark.parametrize("resolution", [0.05, 0.0504, 0.05000000074505806, 1 / 3])
def test_squared_distances_are_recovered_exactly_below_2048_cells(resolution, convention, strength):
    squares = np.arange(2**22 - 2**16, 2**22).reshape(2**8, 2**8)
    squares[0, :8] = np.arange(8)
    occupancy = np.where(squares == 0, 100, 0).astype(np.int8)
    shift = 0.5 * resolution if convention == "border" else 0.0
    distance = (strength * (np.sqrt(squares) * resolution - shift)).astype(np.float32)
    field = DistanceField(distance, occupancy, resolution, convention=convention, strength=strength)
    assert np.array_equal(squares_in(field, field.obstacles()), squares)


@pytest.mark.parametrize("largest_table", [1 << 22, 4, 0])
@given(
    occupancies(), RESOLUTIONS, st.sampled_from([0.4, 1.0, 2.0]),
    st.sampled_from(CONVENTIONS), st.sampled_from([0.3, 1.0, 1.5, 7.0]),
)  # fmt: skip
def test_views_equal_brute_force_whatever_the_convention(
    largest_table, occupancy, resolution, view_range, convention, strength
):
    field = esdf(OccupancyGrid(occupancy, resolution), convention=convention, strength=strength)
    lengths = [0]
    with pytest.MonkeyPatch.context() as patch:  # by table, or computed
        patch.setattr("mapdeal.stages.esdf._LARGEST_TABLE", largest_table)
        patch.setattr("mapdeal.stages.esdf.bytes_in",
                      lambda *given: lengths.append(len(given[2])) or bytes_in(*given))  # fmt: skip
        views = [field_view(field, view_range=view_range), field_view(field, view="per-map")]
        found = [np.array(view.occupancy) for view in views]
    assert max(lengths) <= largest_table + 2
    assert views[0].scale == ViewScale("metric", view_range)
    cells = occupancy, occupancy >= 100, resolution
    assert np.array_equal(found[0], oracles.metric_view(*cells, view_range, strength))
    assert np.array_equal(found[1], oracles.per_map_view(*cells, strength))


@pytest.mark.parametrize(("view", "view_range"), [("metric", 1e13), ("per-map", 2.0)])
def test_a_free_cell_is_never_an_obstacle_in_the_view(view, view_range):
    # a field of another program: the free cell is closer than a cell to an obstacle
    field = DistanceField(np.float32([[0.0, 0.01, 0.2]]), [[100, 0, 0]], 0.1)
    values = field_view(field, view=view, view_range=view_range).occupancy[0].tolist()
    assert values == [100, 99, 99 if view == "metric" else 0]


@pytest.mark.parametrize(("convention", "farthest", "deepest"), [
    ("fast-planner", 0.33, 0.43), ("center", 0.33, 0.33), ("border", 0.38, 0.38),
])  # fmt: skip
def test_the_per_map_view_of_a_clipped_field_ends_at_max_distance(convention, farthest, deepest):
    grid = OccupancyGrid([[100] * 9 + [0] * 9], 0.1)
    scale = field_view(esdf(grid, convention=convention, max_distance=0.33), view="per-map").scale
    assert (scale.farthest, scale.deepest) == (farthest, deepest)
    for limit in (0.4, 0.5):  # within a cell
        field = esdf(OccupancyGrid([[100, 0, 0]], 1.0), convention=convention, max_distance=limit)
        assert field_view(field, view="per-map").occupancy.tolist() == [[100, 0, 0]]


def test_views_of_clipped_fields_and_of_unknown_cells():
    clipped = esdf(OccupancyGrid([[100] + [0] * 6], 0.5), max_distance=1.0)
    assert field_view(clipped).occupancy.tolist() == [[100, 75, 50, 50, 50, 50, 50]]
    field = esdf(OccupancyGrid([[100, 0, -1]], 0.5), unknown="occupied")
    assert field_view(field).occupancy.tolist() == [[100, 75, 100]]
