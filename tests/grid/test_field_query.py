"""Distances and gradients at points."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from drawn import grid_from_text
from mapdeal import DistanceField, OccupancyGrid, esdf
from mapdeal.kernels.threads import use_threads
from strategies import RESOLUTIONS, occupancies

ROOM = esdf(grid_from_text("......#\n.#.....\n.....?.\n...#..."))
ORIGINS = [(0.0, 0.0, 0.0), (1.5, -2.0, 0.4), (-3.0, 7.25, -2.9), (5e5, 4e6, 1.0)]


@given(occupancies(), RESOLUTIONS, st.sampled_from(ORIGINS))
def test_at_centres_the_distance_is_that_to_the_nearest_obstacle(occupancy, resolution, origin):
    grid = OccupancyGrid(occupancy, resolution, origin)
    expected = oracles.signed_distance(occupancy == 100, resolution, "center").ravel()
    field = esdf(grid, convention="center")
    cells = np.argwhere(np.ones(grid.shape))
    distance, _, inside = field.query(grid.frame.xy_from_rowcol(cells))
    assert inside.all()
    assert distance == pytest.approx(expected, rel=1e-5, abs=1e-5 * resolution)


@given(st.integers(0, 2**32 - 1), RESOLUTIONS, st.floats(-3.1, 3.1))
def test_distances_and_gradients_are_those_of_the_interpolant_in_the_map_frame(
    seed, resolution, yaw
):
    """Up to the edges, where the outermost cells go on."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(-3, 3, (5, 7)).astype(np.float32)
    grid = OccupancyGrid(np.zeros((5, 7), np.int8), resolution, (1.5, -2.0, yaw))
    field = DistanceField(values, grid.occupancy, resolution, grid.origin)
    places = rng.uniform(0.01, 0.99, (20, 2)) * grid.shape
    found = field.query(grid.frame.xy_from_continuous_rowcol(places))
    value, up, right = np.transpose([oracles.bilinear(values, *place) for place in places])
    turned = (right + 1j * up) * np.exp(1j * yaw) / resolution
    assert found.distance == pytest.approx(value, abs=1e-6)
    expected = np.stack([turned.real, turned.imag], axis=1)
    assert found.gradient == pytest.approx(expected, rel=1e-6, abs=1e-6 / resolution)


def test_points_outside_are_marked_and_have_no_number():
    field = esdf(grid_from_text("......#\n.#.....\n.....?.\n...#...", 0.25, (1.5, -2.0, 0.0)))
    upper = [1.5 + 7 * 0.25, -2.0 + 4 * 0.25]
    far = [[np.nan, 0], [np.inf, 0], [1e300, 0]]
    points = [[1.4, -1.9], upper, [1.6, upper[1]], *far, [1.6, -1.9]]
    distance, gradient, inside = field.query(points)
    assert inside.tolist() == [False] * 6 + [True]
    assert np.isnan(distance[:6]).all()
    assert np.isnan(gradient[:6]).all()
    assert np.isfinite(distance[6])
    assert field.query(np.empty((0, 2))).gradient.shape == (0, 2)


@pytest.mark.parametrize(("drawing", "distance"), [("...", math.inf), ("###", -math.inf)])
def test_a_map_of_one_kind_has_infinite_distances_and_no_gradient(drawing, distance):
    found = esdf(grid_from_text(drawing, 0.5, (0.0, 0.0, 0.0))).query([[0.6, 0.3], [0.75, 0.25]])
    assert found.distance.tolist() == [distance, distance]
    assert np.isnan(found.gradient).all()
    assert found.inside.all()


def test_a_clip_stays():
    field = esdf(OccupancyGrid([[100, 0, 0, 0, 0, 0]], 0.5), max_distance=1.0, strength=3.0)
    distance, gradient, _ = field.query([[0.75, 0.25], [1.0, 0.25], [2.5, 0.25]])
    assert distance == pytest.approx([1.5, 2.25, 3.0])
    assert gradient[:, 0] == pytest.approx([3.0, 3.0, 0.0])


def test_many_points_in_threads_are_the_same_points():
    shares = np.random.default_rng(1).random((30_001, 2)) * 1.4 - 0.2
    points = ROOM.frame.xy_from_continuous_rowcol(shares * ROOM.shape)
    results = []
    for threads in (1, 3):
        with use_threads(threads):
            results.append([part.tobytes() for part in ROOM.query(points)])
    assert results[0] == results[1]
    alone = [ROOM.query(point).distance[0] for point in points[::2000]]
    assert np.array_equal(ROOM.query(points).distance[::2000], alone, equal_nan=True)


@pytest.mark.parametrize("origin", [(0.1, 0.7, 0.0), (-3.3, 2.2, 0.4), (500000.3, 4.2e6, 1.1)])
def test_at_centres_rounding_does_not_choose_the_side_of_the_gradient(origin):
    grid = OccupancyGrid([[0, 0, 0, 100, 0, 0, 0]] * 5, 0.1, origin)
    field = esdf(grid)
    cells = np.argwhere(np.ones(grid.shape))
    distance, gradient, _ = field.query(grid.frame.xy_from_rowcol(cells))
    assert np.array_equal(distance.astype(np.float32), field.distance.ravel())
    along = gradient @ [math.cos(origin[2]), math.sin(origin[2])]
    # towards the next column, which the last one has not
    expected = np.append(np.diff(field.distance[0]), 0) / 0.1
    assert along.reshape(grid.shape) == pytest.approx(np.tile(expected, (5, 1)), abs=1e-6)


def test_figures_of_a_field_are_its_range_and_its_obstacles():
    distance = np.array([[-0.5, -0.25, 1.5], [0.75, 2.25, 0.5]], np.float32)
    occupancy = np.array([[100, 100, 0], [-1, 0, 50]], np.int8)
    field = DistanceField(distance, occupancy, 0.25, (1.5, -2.0, 0.4), convention="border")
    assert field.figures() == {
        "width": 3, "height": 2, "resolution": 0.25, "origin": [1.5, -2.0, 0.4],
        "convention": "border", "obstacles": 2, "lowest_distance": -0.5, "highest_distance": 2.25,
    }  # fmt: skip
    counted = replace(field, lethal_threshold=50, unknown="occupied")
    assert counted.figures()["obstacles"] == 4
    for endless in (np.inf, -np.inf):
        figures = replace(field, distance=np.where(distance == 0.75, endless, distance)).figures()
        assert (figures["lowest_distance"], figures["highest_distance"]) == (None, None)


def test_figures_of_a_map_count_every_kind_of_cell():
    figures = OccupancyGrid([[100, 100, 100, 0, 0], [-1, 1, 99, 50, 98]], 0.25).figures()
    names = ("occupied", "free", "unknown", "between", "width", "height")
    assert [figures[name] for name in names] == [3, 2, 1, 4, 5, 2]
