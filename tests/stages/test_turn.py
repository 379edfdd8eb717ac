"""Turned maps against points that are turned by hand, and cells that are permuted."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
from drawn import grid_from_text
from mapdeal.stages.resample import cells_when_turned

NUMBERED = np.arange(12, dtype=np.int8).reshape(3, 4)
ANGLES = st.floats(-4, 4)


def some_map(seed, height, width, yaw=0.4, resolution=0.07):
    choices = np.array([-1, 0, 0, 0, 30, 100], np.int8)
    values = np.random.default_rng(seed).choice(choices, (height, width))
    return mapdeal.OccupancyGrid(values, resolution, (1.3, -2.6, yaw))


def turned_by_hand(points, angle):
    turned = [complex(x, y) * complex(math.cos(angle), math.sin(angle)) for x, y in points]
    return [(place.real, place.imag) for place in turned]


@given(seed=st.integers(0, 999), height=st.integers(1, 9), width=st.integers(1, 9), yaw=ANGLES,
       angle=ANGLES)  # fmt: skip
def test_no_point_of_an_obstacle_is_lost(seed, height, width, yaw, angle):
    grid = some_map(seed, height, width, yaw)
    result = mapdeal.rotate(grid, angle)
    assert (result.origin[2], result.resolution) == (0, grid.resolution)
    assert result.occupancy.size == cells_when_turned(grid.frame, angle)
    rng = np.random.default_rng(seed)
    # not nearer to a border than quarter turns are rounded
    places = rng.integers(0, grid.shape, (100, 2)) + rng.uniform(0.001, 0.999, (100, 2))
    points = turned_by_hand(grid.frame.xy_from_continuous_rowcol(places).tolist(), angle)
    for (row, col), (x, y) in zip(places.astype(int).tolist(), points, strict=True):
        new_col = math.floor((x - result.origin[0]) / 0.07)
        new_row = math.floor((y - result.origin[1]) / 0.07)
        assert 0 <= new_row < result.shape[0]
        assert 0 <= new_col < result.shape[1]
        if grid.occupancy[row, col] > 0:
            assert result.occupancy[new_row, new_col] >= grid.occupancy[row, col]


@pytest.mark.parametrize("rule", ["area", "nearest"])
@pytest.mark.parametrize(("yaw", "turn"), [
    *((0.0, turn) for turn in (0.0, math.pi / 2, math.pi, -math.pi / 2, 1.5708, -3.1416)),
    *((k * math.pi / 2 - turn, turn) for k in (1, 2, 3) for turn in (0.0, 0.3)),
])  # fmt: skip
def test_cells_that_end_up_along_the_axes_are_permuted(rule, yaw, turn):
    grid = mapdeal.OccupancyGrid(NUMBERED, 0.5, (1.0, 2.0, yaw))
    result = mapdeal.rotate(grid, turn, rule=rule)
    quarters = round((yaw + turn) / (math.pi / 2))
    assert np.array_equal(result.occupancy, np.rot90(NUMBERED, -quarters))
    corners = grid.frame.xy_from_continuous_rowcol([(0, 0), (0, 4), (3, 0), (3, 4)])
    lowest = np.min(turned_by_hand(corners, quarters * math.pi / 2 - yaw), axis=0)
    assert result.origin == pytest.approx((*lowest, 0.0), rel=0, abs=1e-12)
    if yaw == 0:
        assert result.origin == (*lowest.round(9), 0.0)


ROOM = "\n".join(
    ["#" * 60, *["#" + "." * 58 + "#"] * 12, "#" * 40 + "." * 10 + "#" * 10,
     *["#" + "." * 58 + "#"] * 12, "#" * 60]
)  # fmt: skip


@pytest.mark.parametrize("yaw", [0.0, 0.2, -0.7, 1.2, 2.9])
def test_a_room_whose_walls_are_along_its_cells_is_straightened_exactly(yaw):
    room = grid_from_text(ROOM, 0.1, (1.5, -2.0, yaw))
    turn = mapdeal.yaw_to_straighten(room)
    assert abs(turn) <= math.pi / 4
    assert turn == pytest.approx(-math.remainder(yaw, math.pi / 2))
    result = mapdeal.straighten(room)
    quarters = round((yaw + turn) / (math.pi / 2))
    assert np.array_equal(result.occupancy, np.rot90(room.occupancy, -quarters))


@pytest.mark.parametrize(("drawn", "yaw"), [(0.3, 0.0), (-0.35, 0.5), (0.6, -0.2)])
def test_a_crooked_room_is_straightened(drawn, yaw):
    crooked = mapdeal.rotate(grid_from_text(ROOM, 0.05, (1.5, -2.0, 0.0)), drawn)
    crooked = mapdeal.OccupancyGrid(crooked.occupancy, 0.05, (3.0, 1.0, yaw))
    turn = mapdeal.yaw_to_straighten(crooked)
    assert turn == pytest.approx(-math.remainder(drawn + yaw, math.pi / 2), abs=math.radians(0.3))
    # both long walls, which were 60 cells, fill rows again, whichever side is up
    is_wall = mapdeal.straighten(crooked).occupancy == 100
    assert max(is_wall.sum(axis=0).max(), is_wall.sum(axis=1).max()) >= 55


def test_the_outline_of_a_turned_map_is_no_wall():
    """A room at -0.3 rad in a large block of occupied cells: around the block it is unknown."""
    block = np.full((150, 200), 100, np.int8)
    block[50:80, 60:120] = 0
    block[60:62, 70:100] = 100
    turned = mapdeal.rotate(mapdeal.OccupancyGrid(block, 0.05, (1.5, -2.0, 0.0)), -0.3).occupancy
    room = np.pad(np.where(turned == 0, 0, 100).astype(np.int8), 30, constant_values=100)
    crooked = mapdeal.rotate(mapdeal.OccupancyGrid(room, 0.05), 0.5)
    assert mapdeal.yaw_to_straighten(crooked) == pytest.approx(-0.2, abs=0.01)


def test_without_walls_nothing_is_turned():
    empty = mapdeal.OccupancyGrid(np.zeros((20, 30), np.int8), 0.1, (1.0, 2.0, 0.3))
    assert mapdeal.yaw_to_straighten(empty) is None
    with pytest.warns(mapdeal.MapdealWarning, match="no direction of walls stands out"):
        assert mapdeal.straighten(empty) is empty


def test_walls_that_border_on_unknown_alone_and_lethal_costs_are_walls():
    wall = np.full((60, 80), -1, np.int8)
    wall[20:22, 5:75] = 100
    wall = mapdeal.OccupancyGrid(wall, 0.1, (1.5, -2.0, 0.25))
    room = grid_from_text(ROOM, 0.1, wall.origin)
    costs = np.where(room.occupancy == 100, 254, 3).astype(np.uint8)
    for grid in (wall, mapdeal.Costmap(costs, 0.1, wall.origin)):
        assert mapdeal.yaw_to_straighten(grid) == pytest.approx(-0.25)


def rescaled_by_hand(values, ratio, rule):
    """Compute with fractions: the largest value above 0 that overlaps, else that at the centre."""
    height, width = (math.ceil(Fraction(size) / ratio) for size in values.shape)
    result = np.full((height, width), -1, np.int8)
    for row, col in np.ndindex(height, width):
        rows, cols = (slice(math.floor(k * ratio), math.ceil((k + 1) * ratio)) for k in (row, col))
        under = values[rows, cols]
        at = tuple(math.floor((k + Fraction(1, 2)) * ratio) for k in (row, col))
        if under.max() > 0 and rule == "area":
            result[row, col] = under.max()
        elif at[0] < values.shape[0] and at[1] < values.shape[1]:
            result[row, col] = values[at]
    return result


@given(seed=st.integers(0, 999), height=st.integers(1, 8), width=st.integers(1, 8),
       old=st.sampled_from(["0.05", "0.1", "0.07", "0.25"]),
       new=st.sampled_from(["0.05", "0.1", "0.2", "0.03", "0.15", "1", "0.35"]))  # fmt: skip
def test_every_cell_is_as_by_hand(seed, height, width, old, new):
    grid = some_map(seed, height, width, resolution=float(old))
    for rule in ("area", "nearest"):
        result = mapdeal.rescale(grid, float(new), rule=rule)
        assert (result.resolution, result.origin) == (float(new), grid.origin)
        expected = rescaled_by_hand(grid.occupancy, Fraction(new) / Fraction(old), rule)
        np.testing.assert_array_equal(result.occupancy, expected)
        assert (result is grid) == (new == old)
