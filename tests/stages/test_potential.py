"""The potential, and what the field says of itself."""

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mapdeal
import oracles
from drawn import grid_from_text
from strategies import RESOLUTIONS, occupancies


@pytest.fixture
def golden():
    """Design document 000's own case: ten by ten cells of 1 m, goal in the cell (5, 5)."""
    occupancy = np.zeros((10, 10), np.int8)
    for cell in range(1, 5):
        occupancy[cell, cell] = 100
    return mapdeal.potential(mapdeal.OccupancyGrid(occupancy, 1.0), goal=(5.5, 5.5))


def test_the_design_s_case_by_hand(golden):
    r2 = math.sqrt(2)
    sums = 1 / r2 + 1 / (2 * r2) + 1 / (3 * r2) + 1 / (4 * r2)
    assert golden.repulsive[0, 0] == pytest.approx(sums)
    assert golden.repulsive[5, 5] == pytest.approx(sums)
    assert golden.repulsive[1, 1] == pytest.approx(1 / r2 + 1 / (2 * r2) + 1 / (3 * r2))
    far = sum(1 / math.hypot(9 - cell, cell) for cell in range(1, 5))
    assert golden.repulsive[0, 9] == golden.repulsive[9, 0] == pytest.approx(far)
    assert golden.attractive[5, 5] == 0
    assert golden.attractive[0, 9] == pytest.approx(math.hypot(5, 4))
    assert golden.potential[0, 9] == pytest.approx(far + math.hypot(5, 4))
    assert (golden.normalised.min(), golden.normalised.max()) == (0.0, 10.0)


@settings(max_examples=40)
@given(occupancies(longest=8), RESOLUTIONS)
def test_the_parts_are_their_formulas(occupancy, resolution):
    origin = (1.5, -2.0, 0.4)
    grid = mapdeal.OccupancyGrid(occupancy, resolution, origin)
    goal = grid.frame.xy_from_rowcol([[-2, 1]])[0]
    with pytest.warns(mapdeal.MapdealWarning, match="outside"):
        field = mapdeal.potential(grid, goal=goal, attractive_gain=2.0, repulsive_gain=0.5)
    direct = oracles.sum_of_inverse_distances(occupancy == 100, resolution, 0.001)
    assert field.repulsive == pytest.approx(np.minimum(direct, 1e5), rel=1e-9, abs=1e-12)
    for row, col in np.ndindex(grid.shape):
        away = math.hypot(row + 2, col - 1) * resolution
        assert field.attractive[row, col] == pytest.approx(away)
    assert field.potential == pytest.approx(2 * field.attractive + 0.5 * field.repulsive)


@pytest.mark.parametrize("yaw", [0.0, 0.4, 2.0, -3.0])
def test_the_gradient_of_the_attraction_points_from_the_goal_whatever_the_yaw(yaw):
    grid = mapdeal.OccupancyGrid(np.zeros((30, 40), np.int8), 0.25, (1.5, -2.0, yaw))
    goal = grid.frame.xy_from_rowcol([[10, 12]])[0]
    field = mapdeal.potential(grid, goal=tuple(goal))
    for cell in [(25, 30), (2, 3), (20, 5), (5, 33)]:
        away = grid.frame.xy_from_rowcol([cell])[0] - goal
        expected = away / np.hypot(*away)
        assert field.gradient[(slice(None), *cell)] == pytest.approx(expected, abs=0.01)
        assert field.downhill()[(slice(None), *cell)] == pytest.approx(-expected, abs=0.01)


def test_repulsion_is_capped():
    grid = grid_from_text("###\n###", 0.25)
    field = mapdeal.potential(grid, repulsive_cap=9.5)
    assert field.repulsive.max() == 9.5
    assert mapdeal.potential(grid).repulsive.max() > 9.5


def test_distances_up_to_a_millimetre_are_left_out():
    field = mapdeal.potential(mapdeal.OccupancyGrid([[100, 0, 0]], 0.001))
    assert field.repulsive == pytest.approx(np.array([[0, 0, 500.0]]))
    field = mapdeal.potential(mapdeal.OccupancyGrid([[100, 0, 0]], 0.0011))
    assert field.repulsive == pytest.approx(np.array([[0, 1 / 0.0011, 1 / 0.0022]]))


def test_without_a_goal_there_is_only_repulsion():
    field = mapdeal.potential(grid_from_text(".#.\n..."), repulsive_gain=7.0)
    assert field.attractive is None
    assert np.array_equal(field.potential, field.repulsive)
    spread = field.repulsive.max() - field.repulsive.min()
    expected = 10 * (field.repulsive - field.repulsive.min()) / spread
    assert field.normalised == pytest.approx(expected)


GAINS = {"attractive_gain": 3.0, "repulsive_gain": 0.5}


@settings(max_examples=40)
@given(occupancies(longest=8), RESOLUTIONS, st.sampled_from([0.0, 0.4, -3.0, 2.0]), st.booleans())
def test_the_gradient_is_that_of_the_repulsion_or_of_the_sum(occupancy, resolution, yaw, has_goal):
    grid = mapdeal.OccupancyGrid(occupancy, resolution, (1.5, -2.0, yaw))
    goal = tuple(grid.frame.xy_from_rowcol([[-2, 1]])[0].tolist()) if has_goal else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mapdeal.MapdealWarning)
        field = mapdeal.potential(grid, goal=goal, **GAINS)
    repulsive = np.minimum(
        oracles.sum_of_inverse_distances(occupancy == 100, resolution, 0.001), 1e5
    )
    values = repulsive
    if has_goal:
        rows, cols = np.indices(occupancy.shape)
        values = 3.0 * np.hypot(rows + 2, cols - 1) * resolution + 0.5 * repulsive
    expected = oracles.slopes_along_map_axes(values.tolist(), resolution, yaw)
    noise = 1e-9 * (1 + values.max()) / resolution
    entries = field.entries()
    assert entries["gradient"].shape == (2, *grid.shape)
    assert entries["gradient"][0] == pytest.approx(expected[0], rel=1e-9, abs=noise)
    assert entries["gradient"][1] == pytest.approx(expected[1], rel=1e-9, abs=noise)
    steepness = [math.hypot(*pair) for pair in zip(*(e.flat for e in expected), strict=True)]
    magnitude = entries["gradient_magnitude"]
    assert magnitude.ravel() == pytest.approx(np.array(steepness), rel=1e-9, abs=noise)
    assert field.figures()["steepest_gradient"] == pytest.approx(
        max(steepness), rel=1e-9, abs=noise
    )


def test_where_all_is_level_the_normalised_field_and_the_gradient_are_0():
    field = mapdeal.potential(grid_from_text("..."))
    assert not field.normalised.any()
    assert not field.gradient.any()
    assert not field.downhill().any()
    single = mapdeal.potential(grid_from_text("."), goal=(1.6, -1.9))
    assert not single.gradient.any()


def test_obstacles_are_those_of_the_field_or_of_the_threshold():
    grid = grid_from_text("..?\n+..")
    assert not mapdeal.potential(grid).obstacles().any()
    assert mapdeal.potential(grid, lethal_threshold=50).obstacles().sum() == 1
    field = mapdeal.esdf(grid, unknown="occupied", lethal_threshold=50)
    assert mapdeal.potential(field).obstacles().sum() == 2
    assert np.array_equal(mapdeal.potential(field).obstacles(), field.obstacles())


def test_a_lone_obstacle_is_no_pit_to_go_downhill_into():
    field = mapdeal.potential(grid_from_text(".....\n..#..\n.....", 0.25, (0.0, 0.0, 0.0)))
    assert field.potential[1, 2] < field.potential[1, 1]
    surface = field.downhill_surface()
    assert surface[1, 2] > surface[1, 1]
    assert surface[1, 2] == pytest.approx(2 / 0.25)
    grid = field.grid
    assert mapdeal.potential(grid, repulsive_gain=7.0).downhill_surface()[1, 2] == pytest.approx(8)
    pulled = mapdeal.potential(grid, goal=(0.1, 0.1), repulsive_gain=7.0)
    raised = pulled.downhill_surface() - pulled.potential
    assert raised == pytest.approx(np.where(field.obstacles(), 56.0, 0.0))
    assert field.downhill()[0, 1, 1] < 0 < field.downhill()[0, 1, 3]


@pytest.mark.parametrize("goal", [None, (1.7, -1.9)])
def test_a_file_holds_every_layer_and_gives_the_field_back(tmp_path, goal):
    field = mapdeal.potential(grid_from_text(".#.?\n...."), goal=goal, attractive_gain=3.0)
    mapdeal.write_map(tmp_path / "p.npz", field)
    with np.load(tmp_path / "p.npz") as entries:
        layers = {"repulsive", "normalised", "gradient", "gradient_magnitude"}
        if goal:
            layers |= {"attractive", "potential"}
            assert entries["goal"].tolist() == list(goal)
        assert entries["gradient"].shape == (2, 2, 4)
        assert np.array_equal(entries["gradient_magnitude"], field.gradient_magnitude)
        assert all(entries[name].dtype == np.float64 for name in layers)
        assert layers <= set(entries.files)
        assert ("potential" in entries.files) == (goal is not None)
    again = mapdeal.read_map(tmp_path / "p.npz")
    assert isinstance(again, mapdeal.PotentialField)
    for name in ("goal", "origin", "resolution", "attractive_gain", "repulsive_cap"):
        assert getattr(again, name) == getattr(field, name)
    assert np.array_equal(again.potential, field.potential)
    assert np.array_equal(again.gradient, field.gradient)
    assert np.array_equal(again.occupancy, field.occupancy)


def test_gains_may_be_0_and_no_less():
    grid = mapdeal.OccupancyGrid([[100, 0, 0, 0]], 0.5)
    field = mapdeal.potential(grid, goal=(1.75, 0.25), attractive_gain=0.0)
    assert field.potential.tolist() == field.repulsive.tolist()
    field = mapdeal.potential(grid, goal=(1.75, 0.25), repulsive_gain=0.0)
    assert field.potential.tolist() == [[1.5, 1.0, 0.5, 0.0]]
