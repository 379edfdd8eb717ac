"""Turned maps against points that are turned by hand, and cells that are permuted."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mapdeal
from drawn import grid_from_text
from mapdeal.stages.resample import cells_when_turned

NUMBERED = np.arange(12, dtype=np.int8).reshape(3, 4)
ANGLES = st.floats(-4, 4)


def some_map(seed, height, width, yaw=0.0, resolution=0.07):
    values = np.random.default_rng(seed).choice(
        np.array([-1, 0, 0, 0, 30, 100], np.int8), (height, width)
    )
    return mapdeal.OccupancyGrid(values, resolution, (1.3, -2.6, yaw))


def turned_by_hand(points, angle):
    return [
        (x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle))
        for x, y in points
    ]


@given(
    seed=st.integers(0, 999), height=st.integers(1, 9), width=st.integers(1, 9),
    yaw=ANGLES, angle=ANGLES,
)  # fmt: skip
@settings(deadline=None, max_examples=40)
def test_no_point_of_an_obstacle_is_lost(seed, height, width, yaw, angle):
    grid = some_map(seed, height, width, yaw)
    result = mapdeal.rotate(grid, angle)
    assert result.origin[2] == 0
    assert result.resolution == grid.resolution
    assert result.occupancy.size == cells_when_turned(grid.frame, angle)
    rng = np.random.default_rng(seed)
    # not nearer to a border than quarter turns are rounded
    places = rng.integers(0, grid.shape, (300, 2)) + rng.uniform(0.001, 0.999, (300, 2))
    points = turned_by_hand(grid.frame.xy_from_continuous_rowcol(places).tolist(), angle)
    for (row, col), (x, y) in zip(places.astype(int).tolist(), points, strict=True):
        new_col = math.floor((x - result.origin[0]) / 0.07)
        new_row = math.floor((y - result.origin[1]) / 0.07)
        assert 0 <= new_row < result.shape[0]
        assert 0 <= new_col < result.shape[1]
        if grid.occupancy[row, col] > 0:
            assert result.occupancy[new_row, new_col] >= grid.occupancy[row, col]


@pytest.mark.parametrize("rule", ["area", "nearest"])
@pytest.mark.parametrize(
    ("yaw", "values", "origin"),
    [
        (0.0, NUMBERED.tolist(), (1.0, 2.0)),
        # (1, 2) goes to (-2, 1), and the rows that went north go west
        (math.pi / 2, [[8, 4, 0], [9, 5, 1], [10, 6, 2], [11, 7, 3]], (-3.5, 1.0)),
        (math.pi, NUMBERED[::-1, ::-1].tolist(), (-3.0, -3.5)),
        (-math.pi / 2, [[3, 7, 11], [2, 6, 10], [1, 5, 9], [0, 4, 8]], (2.0, -3.0)),
        (1.5708, [[8, 4, 0], [9, 5, 1], [10, 6, 2], [11, 7, 3]], (-3.5, 1.0)),
        (-3.1416, NUMBERED[::-1, ::-1].tolist(), (-3.0, -3.5)),
    ],
)
def test_quarter_turns_by_hand(rule, yaw, values, origin):
    result = mapdeal.rotate(mapdeal.OccupancyGrid(NUMBERED, 0.5, (1.0, 2.0, 0.0)), yaw, rule=rule)
    assert result.occupancy.tolist() == values
    assert result.origin == (*origin, 0.0)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_yaw_of_quarter_turns_is_baked_out_without_a_change_of_cells(quarters):
    """The corner moves to where the turned map's lowest x and y are, exactly."""
    grid = mapdeal.OccupancyGrid(NUMBERED, 0.05, (1.0, 2.0, quarters * math.pi / 2))
    result = mapdeal.rotate(grid)
    corners = {1: (0.85, 2.0), 2: (0.8, 1.85), 3: (1.0, 1.8)}
    assert result.origin == (*corners[quarters], 0.0)
    assert np.array_equal(result.occupancy, np.rot90(NUMBERED, -quarters))
    for row, col in np.ndindex(grid.shape):
        place = grid.frame.xy_from_rowcol([[row, col]])
        at = result.frame.unbounded_rowcol_from_xy(place)[0]
        assert result.occupancy[tuple(at)] == NUMBERED[row, col]


def test_a_yaw_and_a_turn_that_make_a_quarter_turn():
    grid = mapdeal.OccupancyGrid(NUMBERED, 0.05, (1.0, 2.0, 0.3))
    result = mapdeal.rotate(grid, math.pi / 2 - 0.3)
    assert np.array_equal(result.occupancy, np.rot90(NUMBERED, -1))
    ((x, y),) = turned_by_hand([(1.0, 2.0)], math.pi / 2 - 0.3)
    assert result.origin == pytest.approx((x - 0.15, y, 0.0), abs=1e-12)


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
    result = mapdeal.straighten(crooked)
    rows = (result.occupancy == 100).sum(axis=1)
    # both long walls, which were 60 cells, fill rows again, whichever side is up
    cols = (result.occupancy == 100).sum(axis=0)
    longest = max(rows.max(), cols.max())
    assert longest >= 55


def test_the_outline_of_a_turned_map_is_no_wall():
    """A room in a large block of occupied cells, turned once: all around it is unknown."""
    block = np.full((150, 200), 100, np.int8)
    block[50:80, 60:120] = 0
    block[60:62, 70:100] = 100
    crooked = mapdeal.rotate(
        mapdeal.OccupancyGrid(np.pad(rotated_room(block), 30, constant_values=100), 0.05), 0.5
    )
    assert mapdeal.yaw_to_straighten(crooked) == pytest.approx(-0.2, abs=0.01)


def rotated_room(block):
    """The block, in which the room lies at -0.3 rad to its outline."""
    turned = mapdeal.rotate(mapdeal.OccupancyGrid(block, 0.05, (1.5, -2.0, 0.0)), -0.3).occupancy
    return np.where(turned == 0, 0, 100).astype(np.int8)


def test_walls_that_border_on_unknown_alone_are_walls():
    wall = np.full((60, 80), -1, np.int8)
    wall[20:22, 5:75] = 100
    assert mapdeal.yaw_to_straighten(
        mapdeal.OccupancyGrid(wall, 0.1, (1.5, -2.0, 0.25))
    ) == pytest.approx(-0.25)


def test_lethal_costs_are_walls():
    room = grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.25))
    costs = np.where(room.occupancy == 100, 254, 3).astype(np.uint8)
    assert mapdeal.yaw_to_straighten(mapdeal.Costmap(costs, 0.1, room.origin)) == pytest.approx(
        -0.25
    )


def test_without_walls_nothing_is_turned():
    empty = mapdeal.OccupancyGrid(np.zeros((20, 30), np.int8), 0.1, (1.0, 2.0, 0.3))
    assert mapdeal.yaw_to_straighten(empty) is None
    with pytest.warns(mapdeal.MapdealWarning, match="no direction of walls stands out"):
        assert mapdeal.straighten(empty) is empty


CHOICES = np.array([-1, 0, 0, 0, 30, 100], np.int8)
ORIGIN = (1.3, -2.6, 0.4)


def a_map(seed, height, width, resolution="0.05"):
    values = np.random.default_rng(seed).choice(CHOICES, (height, width))
    return mapdeal.OccupancyGrid(values, float(resolution), ORIGIN)


def rescaled_by_hand(values, ratio):
    """In fractions: the largest above 0 that is overlapped, else what is at the centre."""
    height, width = (math.ceil(Fraction(size) / ratio) for size in values.shape)
    result = np.full((height, width), -1, np.int8)
    for row, col in np.ndindex(height, width):
        under = values[
            math.floor(row * ratio) : math.ceil((row + 1) * ratio),
            math.floor(col * ratio) : math.ceil((col + 1) * ratio),
        ]
        at = tuple(math.floor((k + Fraction(1, 2)) * ratio) for k in (row, col))
        inside = at[0] < values.shape[0] and at[1] < values.shape[1]
        result[row, col] = under.max() if under.max() > 0 else values[at] if inside else -1
    return result


@given(
    seed=st.integers(0, 999), height=st.integers(1, 12), width=st.integers(1, 12),
    old=st.sampled_from(["0.05", "0.1", "0.07", "0.25"]),
    new=st.sampled_from(["0.05", "0.1", "0.2", "0.03", "0.15", "1", "0.35"]),
)  # fmt: skip
@settings(deadline=None)
def test_every_cell_is_as_by_hand(seed, height, width, old, new):
    grid = a_map(seed, height, width, old)
    result = mapdeal.rescale(grid, float(new))
    assert (result.resolution, result.origin) == (float(new), ORIGIN)
    np.testing.assert_array_equal(
        result.occupancy, rescaled_by_hand(grid.occupancy, Fraction(new) / Fraction(old))
    )


@pytest.mark.parametrize("factor", [2, 3, 5])
@pytest.mark.parametrize("rule", ["area", "nearest"])
def test_finer_by_a_whole_factor_repeats_cells(factor, rule):
    grid = a_map(1, 7, 11, "0.1")
    result = mapdeal.rescale(grid, 0.1 / factor, rule=rule)
    expected = np.repeat(np.repeat(grid.occupancy, factor, axis=0), factor, axis=1)
    np.testing.assert_array_equal(result.occupancy, expected)
    back = mapdeal.rescale(result, 0.1, rule=rule)
    np.testing.assert_array_equal(back.occupancy, grid.occupancy)


def test_coarser_by_the_nearest_rule_takes_every_third_cell():
    grid = a_map(2, 9, 12)
    result = mapdeal.rescale(grid, 0.15, rule="nearest")
    np.testing.assert_array_equal(result.occupancy, grid.occupancy[1::3, 1::3])


def test_the_same_resolution_is_the_same_grid():
    grid = a_map(3, 4, 5)
    assert mapdeal.rescale(grid, 0.05) is grid


def test_unknown_costs_never_win():
    costs = np.array([[255, 0, 255, 254], [0, 0, 9, 255]], np.uint8)
    result = mapdeal.rescale(mapdeal.Costmap(costs, 0.1, ORIGIN), 0.2)
    assert result.cost.tolist() == [[0, 254]]
