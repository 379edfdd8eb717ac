"""Turned maps against points that are turned by hand, and cells that are permuted."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drawn import grid_from_text
from mapdeal import (
    Costmap,
    MapdealWarning,
    OccupancyGrid,
    ParameterError,
    esdf,
    rotate,
    straighten,
    yaw_to_straighten,
)
from mapdeal.grid.canvas import resampled
from mapdeal.stages.resample import cells_when_turned

NUMBERED = np.arange(12, dtype=np.int8).reshape(3, 4)
ANGLES = st.floats(-4, 4)


def some_map(seed, height, width, yaw=0.0, resolution=0.07):
    values = np.random.default_rng(seed).choice(
        np.array([-1, 0, 0, 0, 30, 100], np.int8), (height, width)
    )
    return OccupancyGrid(values, resolution, (1.3, -2.6, yaw))


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
    result = rotate(grid, angle)
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


@given(seed=st.integers(0, 999), angle=ANGLES)
@settings(deadline=None, max_examples=30)
def test_there_and_back_covers_all_obstacles(seed, angle):
    grid = some_map(seed, 6, 9, 0.4)
    back = rotate(rotate(grid, angle), -angle)
    there = resampled(back, grid.frame).occupancy
    assert (there >= grid.occupancy)[grid.occupancy > 0].all()


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
    result = rotate(OccupancyGrid(NUMBERED, 0.5, (1.0, 2.0, 0.0)), yaw, rule=rule)
    assert result.occupancy.tolist() == values
    assert result.origin == (*origin, 0.0)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_yaw_of_quarter_turns_is_baked_out_without_a_change_of_cells(quarters):
    """The corner moves to where the turned map's lowest x and y are, exactly."""
    grid = OccupancyGrid(NUMBERED, 0.05, (1.0, 2.0, quarters * math.pi / 2))
    result = rotate(grid)
    corners = {1: (0.85, 2.0), 2: (0.8, 1.85), 3: (1.0, 1.8)}
    assert result.origin == (*corners[quarters], 0.0)
    assert np.array_equal(result.occupancy, np.rot90(NUMBERED, -quarters))
    for row, col in np.ndindex(grid.shape):
        place = grid.frame.xy_from_rowcol([[row, col]])
        at = result.frame.unbounded_rowcol_from_xy(place)[0]
        assert result.occupancy[tuple(at)] == NUMBERED[row, col]


def test_a_yaw_and_a_turn_that_make_a_quarter_turn():
    grid = OccupancyGrid(NUMBERED, 0.05, (1.0, 2.0, 0.3))
    result = rotate(grid, math.pi / 2 - 0.3)
    assert np.array_equal(result.occupancy, np.rot90(NUMBERED, -1))
    ((x, y),) = turned_by_hand([(1.0, 2.0)], math.pi / 2 - 0.3)
    assert result.origin == pytest.approx((x - 0.15, y, 0.0), abs=1e-12)


def test_the_nearest_rule_takes_centres():
    grid = some_map(5, 30, 40, 0.2)
    result = rotate(grid, 0.5, rule="nearest")
    centres = result.frame.xy_from_rowcol(np.argwhere(np.ones(result.shape, bool)))
    cells, inside = grid.frame.bounded_rowcol_from_xy(turned_by_hand(centres.tolist(), -0.5))
    expected = np.where(inside, grid.occupancy[tuple(cells.T)], -1)
    assert np.mean(expected == result.occupancy.ravel()) == 1


def test_costs_are_turned_too():
    costs = np.array([[0, 255, 254], [128, 253, 0]], np.uint8)
    costmap = Costmap(costs, 0.1, (1.0, 2.0, 0.0), circumscribed_cost=70)
    result = rotate(costmap, math.pi)
    assert result.cost.tolist() == costs[::-1, ::-1].tolist()
    askew = rotate(costmap, 0.4)
    assert askew.circumscribed_cost == 70
    assert {254, 253, 128} <= set(askew.cost.ravel().tolist())
    assert askew.cost[0, 0] == 255


ROOM = "\n".join(
    ["#" * 60, *["#" + "." * 58 + "#"] * 12, "#" * 40 + "." * 10 + "#" * 10,
     *["#" + "." * 58 + "#"] * 12, "#" * 60]
)  # fmt: skip


@pytest.mark.parametrize("yaw", [0.2, -0.7, 1.2, 2.9])
def test_a_room_whose_walls_are_along_its_cells_is_straightened_exactly(yaw):
    room = grid_from_text(ROOM, 0.1, (1.5, -2.0, yaw))
    turn = yaw_to_straighten(room)
    assert abs(turn) <= math.pi / 4
    assert turn == pytest.approx(-math.remainder(yaw, math.pi / 2))
    result = straighten(room)
    quarters = round((yaw + turn) / (math.pi / 2))
    assert np.array_equal(result.occupancy, np.rot90(room.occupancy, -quarters))


@pytest.mark.parametrize(("drawn", "yaw"), [(0.3, 0.0), (-0.35, 0.5), (0.6, -0.2)])
def test_a_crooked_room_is_straightened(drawn, yaw):
    crooked = rotate(grid_from_text(ROOM, 0.05, (1.5, -2.0, 0.0)), drawn)
    crooked = OccupancyGrid(crooked.occupancy, 0.05, (3.0, 1.0, yaw))
    turn = yaw_to_straighten(crooked)
    assert turn == pytest.approx(-math.remainder(drawn + yaw, math.pi / 2), abs=math.radians(0.3))
    result = straighten(crooked)
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
    crooked = rotate(OccupancyGrid(np.pad(rotated_room(block), 30, constant_values=100), 0.05), 0.5)
    assert yaw_to_straighten(crooked) == pytest.approx(-0.2, abs=0.01)


def rotated_room(block):
    """The block, in which the room lies at -0.3 rad to its outline."""
    turned = rotate(OccupancyGrid(block, 0.05, (1.5, -2.0, 0.0)), -0.3).occupancy
    return np.where(turned == 0, 0, 100).astype(np.int8)


def test_walls_that_border_on_unknown_alone_are_walls():
    wall = np.full((60, 80), -1, np.int8)
    wall[20:22, 5:75] = 100
    assert yaw_to_straighten(OccupancyGrid(wall, 0.1, (1.5, -2.0, 0.25))) == pytest.approx(-0.25)


def test_what_lies_straight_is_not_touched():
    room = grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.0))
    assert yaw_to_straighten(room) == 0
    assert np.array_equal(straighten(room).occupancy, room.occupancy)
    assert straighten(room).origin == room.origin


def test_lethal_costs_are_walls():
    room = grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.25))
    costs = np.where(room.occupancy == 100, 254, 3).astype(np.uint8)
    assert yaw_to_straighten(Costmap(costs, 0.1, room.origin)) == pytest.approx(-0.25)


def test_without_walls_nothing_is_turned():
    empty = OccupancyGrid(np.zeros((20, 30), np.int8), 0.1, (1.0, 2.0, 0.3))
    assert yaw_to_straighten(empty) is None
    with pytest.warns(MapdealWarning, match="no direction of walls stands out"):
        assert straighten(empty) is empty


@pytest.mark.parametrize(("yaw", "word"), [(math.nan, "yaw"), (math.inf, "yaw")])
def test_an_angle_is_a_finite_number(yaw, word):
    with pytest.raises(ParameterError, match=word):
        rotate(some_map(1, 3, 4), yaw)


def test_a_rule_is_refused_for_quarter_turns_too():
    with pytest.raises(ParameterError, match="rule"):
        rotate(some_map(1, 3, 4), rule="median")


def test_a_field_is_not_turned():
    field = esdf(some_map(3, 5, 6))
    for change in (rotate, straighten):
        with pytest.raises(ParameterError, match="a map or a costmap"):
            change(field)


def test_a_result_of_too_many_cells_is_refused(monkeypatch):
    monkeypatch.setattr("mapdeal.stages.resample.MOST_CELLS", 30)
    with pytest.raises(ParameterError, match=r"yaw: .*30 cells"):
        rotate(some_map(1, 5, 5), 0.7)
