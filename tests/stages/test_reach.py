"""Where a robot can go: stage ``reach`` beside floods over cells and over routes."""

import json
import math
from decimal import Decimal

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

import mapdeal
import oracles
from drawn import grid_from_text
from mapdeal.grid.reach import Goal
from mapdeal.grid.reaching import disconnected
from mapdeal.stages.structured import accept_goals, described_goals
from strategies import RESOLUTIONS, occupancies

ROOMS = """
    ##############
    #......#.....#
    #......#.....#
    #............#
    #......#.....#
    #......#..?..#
    ##############
"""


def centre(grid, row, col):
    return tuple(grid.frame.xy_from_rowcol([(row, col)])[0].tolist())


def by_contract(occupancy, resolution, radius, start, *, through_unknown=False):
    """Cells reached by a round robot: 8 neighbours, diagonally between two open straight ones."""
    squares = oracles.squared_distance(np.pad(occupancy == 100, 1, constant_values=True))
    squares = [row[1:-1] for row in squares[1:-1]]
    allowed = (occupancy != 100) & (through_unknown | (occupancy != -1))
    is_open = np.array(
        [[allowed[r, c] and math.sqrt(squares[r][c]) * resolution > radius + 1e-9
          for c in range(occupancy.shape[1])] for r in range(occupancy.shape[0])]
    )  # fmt: skip
    reached = np.zeros(occupancy.shape, dtype=bool)
    if not is_open[start]:
        return is_open, reached
    reached[start], edge = True, [start]
    while edge:
        row, col = edge.pop()
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                r, c = row + dr, col + dc
                if not (0 <= r < len(reached) and 0 <= c < reached.shape[1]):
                    continue
                straight = is_open[row, c] and is_open[r, col]
                if is_open[r, c] and not reached[r, c] and straight:
                    reached[r, c] = True
                    edge.append((r, c))
    return is_open, reached


def test_two_rooms_and_a_door_by_hand():
    grid = grid_from_text(ROOMS)  # 0.25 m, origin and yaw not 0
    start, goal = centre(grid, 3, 2), centre(grid, 3, 11)
    found = mapdeal.reach(grid, start=start, goals=[goal], radius=0.24)
    assert found.reachable.sum() == np.count_nonzero(grid.occupancy == 0)
    assert found.goals[0].reachable
    # the door is one cell wide: its centre is a cell, 0.25 m, from either jamb
    assert found.goals[0].widest_radius == 0.25
    limit = found.goals[0].limited_by
    assert (limit.width, limit.at) == (0.5, "passage")
    assert (limit.x, limit.y) == pytest.approx(centre(grid, 3, 7))
    assert found.widest[3, 11] == np.float32(0.25)
    assert found.clearance[3, 3] == np.float32(0.75)
    assert found.headings.max() == 72

    stopped = mapdeal.reach(grid, start=start, goals=[goal], radius=0.25, min_area=0.25)
    assert not stopped.goals[0].reachable
    assert stopped.goals[0].heading_count == 0
    (passage,) = [one for one in stopped.passages if not one.is_open]
    assert passage.width == 0.5
    assert (passage.x, passage.y) == pytest.approx(centre(grid, 3, 7))
    # open to the robot in the second room: 3 x 3 cells, without the unknown one's row at 2 m
    is_open, reached = by_contract(grid.occupancy, 0.25, 0.25, (3, 2))
    assert passage.cut_off == pytest.approx((is_open & ~reached).sum() * 0.25**2)
    assert stopped.reachable_area == pytest.approx(reached.sum() * 0.25**2)


@settings(max_examples=150, deadline=None)
@given(occupancies(), RESOLUTIONS, st.floats(0.0, 3.0), st.booleans(), st.data())
def test_reachable_cells_are_those_of_the_contract(occupancy, resolution, cells, through, data):
    row = data.draw(st.integers(0, occupancy.shape[0] - 1))
    col = data.draw(st.integers(0, occupancy.shape[1] - 1))
    radius = cells * resolution
    grid = mapdeal.OccupancyGrid(occupancy, resolution, (3.0, -1.0, 0.7))
    is_open, reached = by_contract(
        occupancy, resolution, radius, (row, col), through_unknown=through
    )
    options = {"start": centre(grid, row, col), "radius": radius, "through_unknown": through}
    if not is_open.any():
        with pytest.raises(mapdeal.MalformedInputError, match="no cell is open"):
            mapdeal.reach(grid, **options)
    elif not is_open[row, col]:
        with pytest.raises(mapdeal.ParameterError, match="closed cell") as caught:
            mapdeal.reach(grid, **options)
        assert "nearest open cell" in caught.value.hint
    else:
        found = mapdeal.reach(grid, **options)
        assert np.array_equal(found.reachable, reached)
        assert np.array_equal(found.headings > 0, is_open)
        assert found.reachable_area == pytest.approx(reached.sum() * resolution**2)


@settings(max_examples=60, deadline=None)
@given(occupancies(longest=9), st.integers(0, 2**32 - 1))
def test_a_hair_decides_at_the_widest_radius(occupancy, seed):
    free = np.argwhere(occupancy != 100)
    if not len(free):
        return
    rng = np.random.default_rng(seed)
    (row, col), goal = (tuple(free[rng.integers(len(free))].tolist()) for _ in range(2))
    grid = mapdeal.OccupancyGrid(occupancy, 0.0504, (3.0, -1.0, 0.7))
    found = mapdeal.reach(
        grid, start=centre(grid, row, col), goals=[centre(grid, *goal)], through_unknown=True
    )
    widest = found.goals[0].widest_radius
    assert np.float32(widest) == found.widest[goal]
    for radius, expected in ((widest - 1e-6, True), (widest + 1e-6, False)):
        if not 0 <= radius < math.inf:
            continue
        _, reached = by_contract(occupancy, 0.0504, radius, (row, col), through_unknown=True)
        assert reached[goal] == expected


def test_a_start_that_is_not_given_is_the_widest_place_of_the_largest_area():
    grid = grid_from_text(ROOMS)
    found = mapdeal.reach(grid, radius=0.3)
    row, col = grid.frame.clamped_rowcol_from_xy([found.start])[0].tolist()
    assert col < 7  # the first room is the larger one
    assert found.clearance[row, col] == found.clearance[found.reachable == 1].max()


def test_of_costs_the_lethal_cells_are_obstacles():
    grid = grid_from_text(ROOMS)
    start = centre(grid, 3, 2)
    of_map = mapdeal.reach(grid, start=start, radius=0.3)
    # inscribed costs take unknown cells, too, so that smaller robots have other ways there
    inflated = mapdeal.exponential_cost(grid, inscribed_radius=0.3)
    names = ["reachable", "headings", "clearance", "widest"]
    for costs, same in ((mapdeal.Costmap.from_occupancy(grid), names), (inflated, names[:3])):
        of_costs = mapdeal.reach(costs, start=start, radius=0.3)
        for name in same:
            assert np.array_equal(getattr(of_map, name), getattr(of_costs, name)), name
    of_field = mapdeal.reach(mapdeal.esdf(grid), start=start, radius=0.3)
    assert np.array_equal(of_map.reachable, of_field.reachable)


def test_a_long_robot_gets_through_a_door_but_cannot_turn_in_it():
    occupancy = np.full((16, 44), 100, np.int8)
    occupancy[1:15, 1:15] = occupancy[1:15, 29:43] = 0
    occupancy[6:10, 15:29] = 0  # a corridor of 4 cells, 0.4 m
    grid = mapdeal.OccupancyGrid(occupancy, 0.1, (2.0, 1.0, math.pi / 6))
    robot = mapdeal.Footprint.polygon([[0.45, 0.12], [0.45, -0.12], [-0.45, -0.12], [-0.45, 0.12]])
    goal = centre(grid, 8, 36)
    found = mapdeal.reach(grid, start=centre(grid, 8, 7), goals=[goal], footprint=robot)
    assert found.goals[0].reachable
    assert found.headings[8, 7] == found.headings[8, 36] == 72
    assert 0 < found.headings[8, 22] < 20
    # across the corridor it stands nowhere in it: the start's heading decides
    with pytest.raises(mapdeal.ParameterError, match="in this heading, only in"):
        mapdeal.reach(
            grid, start=(*centre(grid, 8, 22), math.pi / 6 + math.pi / 2), footprint=robot
        )
    along = mapdeal.reach(grid, start=(*centre(grid, 8, 22), math.pi / 6), footprint=robot)
    assert along.reachable[8, 36]


def test_no_goal_takes_the_answers_for_the_others():
    grid = grid_from_text(ROOMS)
    far = 1e12
    places = {
        "open": centre(grid, 3, 4), "wall": centre(grid, 2, 7), "unknown": centre(grid, 1, 10),
        "near a wall": centre(grid, 1, 2), "outside": centre(grid, 3, -5), "far": (far, -far),
    }  # fmt: skip
    goals = [Goal(*place, name) for name, place in places.items()]
    found = mapdeal.reach(grid, start=centre(grid, 3, 2), goals=goals, radius=0.3)
    assert [one.reachable for one in found.goals] == [True] + [False] * 5
    assert [one.reason for one in found.goals] == [
        None, "an obstacle", "unknown", "0.25 m from an obstacle, the robot's radius is 0.3 m",
        "outside of the map", "outside of the map",
    ]  # fmt: skip
    is_open = np.argwhere(found.headings > 0)
    for one in found.goals[1:]:
        distance = np.hypot(*(grid.frame.xy_from_rowcol(is_open) - (one.goal.x, one.goal.y)).T)
        nearest = math.dist(one.nearest_open, (one.goal.x, one.goal.y))
        assert nearest == pytest.approx(distance.min())
    robot = mapdeal.Footprint.polygon([[0.4, 0.1], [0.4, -0.1], [-0.4, -0.1], [-0.4, 0.1]])
    found = mapdeal.reach(grid, start=centre(grid, 3, 2), goals=goals, footprint=robot)
    assert [one.reachable for one in found.goals] == [True] + [False] * 5
    assert found.goals[3].reason == "too narrow for the robot in every heading"


@pytest.mark.parametrize("shape", ["round", "corners"])
def test_no_part_of_a_robot_is_outside_of_the_map(shape):
    """The map of a room without its walls: as far from the edge as from the walls."""
    walls = np.full((24, 31), 100, np.int8)
    walls[1:-1, 1:-1] = 0
    walls[8:12, 14] = 100
    walled = mapdeal.OccupancyGrid(walls, 0.1, (1.0, 2.0, 0.3))
    origin = walled.frame.window(1, 1, 22, 29).origin
    cut = mapdeal.OccupancyGrid(walls[1:-1, 1:-1], 0.1, origin)
    robot = mapdeal.Footprint.circle(0.4)
    if shape == "corners":
        robot = mapdeal.Footprint.polygon([[0.4, 0.2], [0.4, -0.2], [-0.4, -0.2], [-0.4, 0.2]])
    expected = mapdeal.reach(walled, footprint=robot, start=centre(walled, 15, 20))
    found = mapdeal.reach(cut, footprint=robot, start=centre(cut, 14, 19))
    for name in ("reachable", "headings", "clearance", "widest"):
        assert np.array_equal(getattr(expected, name)[1:-1, 1:-1], getattr(found, name)), name
    with pytest.raises(mapdeal.ParameterError, match="closed cell") as refused:
        mapdeal.reach(cut, footprint=robot, start=centre(cut, 0, 12))
    if shape == "round":
        assert "0.1 m from the map's edge, the robot's radius is 0.4 m" in str(refused.value)


@pytest.mark.parametrize("cells", [1, 3, 6, 7, 12, 13])
def test_a_robot_exactly_as_wide_as_the_door_does_not_pass(cells):
    # the obstacles beside the door lie 2 * cells apart, centre to centre
    side = 4 * cells + 9
    occupancy = np.full((side, 2 * side + 3), 100, np.int8)
    occupancy[1:-1, 1:side] = occupancy[1:-1, side + 1 : -2] = 0
    occupancy[side // 2 - cells + 1 : side // 2 + cells, side] = 0
    grid = mapdeal.OccupancyGrid(occupancy, 0.05)
    radius = float(cells * Decimal("0.05"))
    start, goal = (centre(grid, side // 2, col) for col in (side // 2, side + side // 2))
    for robot, passes in ((radius, False), (radius - 0.001, True)):
        found = mapdeal.reach(grid, start=start, goals=[goal], radius=robot, min_area=0.001)
        assert found.goals[0].reachable == passes
        assert found.goals[0].widest_radius == radius
        assert (found.widest[found.reachable == 1] > robot).all()
        costs = mapdeal.exponential_cost(grid, inscribed_radius=robot, inflation_radius=1.0)
        assert mapdeal.shortest_route(costs, start, goal).reached == passes
        if robot >= grid.resolution:
            inflated = mapdeal.inflate(grid, radius=robot)
            assert mapdeal.reach(inflated, start=start, goals=[goal]).goals[0].reachable == passes
    assert found.passages[0].width == 2 * radius
    assert [one.width for one in disconnected(grid, radius, 0.001)] == [2 * radius]
    assert disconnected(grid, radius - 0.001, 0.001) == []


def test_without_an_obstacle_the_edge_is_the_limit():
    found = mapdeal.reach(mapdeal.OccupancyGrid(np.zeros((3, 5), np.int8), 0.1), start=(0.25, 0.15))
    expected = np.float32([[1, 1, 1, 1, 1], [1, 2, 2, 2, 1], [1, 1, 1, 1, 1]]) / np.float32(10)
    assert np.allclose(found.widest, expected)
    assert np.array_equal(found.clearance, found.widest)
    assert found.share == 1.0
    assert found.passages == ()


def yaml_maps(folder, every):
    """Map_server maps below a folder, as many of them as can be read."""
    for path in sorted(folder.rglob("*.yaml"))[::every]:
        try:
            yield mapdeal.read_map(path)
        except mapdeal.MapdealError:
            continue  # parameter files, and maps made to be refused


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("every", [8, pytest.param(1, marks=pytest.mark.thorough)])
def test_real_maps_are_reached_as_over_inscribed_costs(real_maps, every):
    seen = 0
    for grid in yaml_maps(real_maps, every):
        radius = 4.51 * grid.resolution
        walled = mapdeal.OccupancyGrid(
            np.pad(grid.occupancy, 1, constant_values=100), grid.resolution
        )
        costs = mapdeal.exponential_cost(
            walled, inscribed_radius=radius, inflation_radius=2 * radius
        ).cost
        groups, count = ndimage.label(costs[1:-1, 1:-1] < 253)  # four neighbours
        if count == 0:
            continue
        sizes = np.bincount(groups.ravel())
        for group in {1, count, int(np.argmax(sizes[1:])) + 1}:
            cells = np.argwhere(groups == group)
            row, col = cells[len(cells) // 2].tolist()
            found = mapdeal.reach(grid, start=centre(grid, row, col), radius=radius)
            assert np.array_equal(found.reachable, groups == group)
            seen += 1
    assert seen > 5


def test_a_stray_beam_is_no_place_to_start():
    # the end of the beam is farther from the obstacles than the middle of the room
    occupancy = np.full((25, 60), -1, np.int8)
    occupancy[8:17, 2:11] = 100
    occupancy[9:16, 3:10] = 0
    occupancy[12, 10:50] = 0
    grid = mapdeal.OccupancyGrid(occupancy, 0.1, (2.0, 1.0, math.pi / 6))
    found = mapdeal.reach(grid, radius=0.09)
    assert found.start == pytest.approx(centre(grid, 12, 6), abs=1e-9)
    assert found.reachable[12, 49]


KITCHEN, HALL = Goal(7.1, 3.2, "kitchen"), Goal(1.5, -2.0, "hall")


@pytest.mark.parametrize(
    ("value", "goals"),
    [
        ({"kitchen": [7.1, 3.2], "hall": "1.5,-2"}, (KITCHEN, HALL)),
        ([{"kitchen": [7.1, 3.2]}, {"hall": (1.5, -2)}], (KITCHEN, HALL)),
        ([KITCHEN, (1.5, -2)], (KITCHEN, Goal(1.5, -2.0))),
        (HALL, (HALL,)),
        ([[7.1, 3.2], [1.5, -2]], (Goal(7.1, 3.2), Goal(1.5, -2.0))),
        (np.array([[7.1, 3.2], [1.5, -2]]), (Goal(7.1, 3.2), Goal(1.5, -2.0))),
        ([7.1, 3.2], (Goal(7.1, 3.2),)),
        ("7.1, 3.2", (Goal(7.1, 3.2),)),
        ("7.1,3.2 1.5, -2", (Goal(7.1, 3.2), Goal(1.5, -2.0))),
        (["7.1,3.2", "1.5,-2"], (Goal(7.1, 3.2), Goal(1.5, -2.0))),
        ({12: [7.1, 3.2]}, (Goal(7.1, 3.2, "12"),)),
        ([], ()),
        ({}, ()),
    ],
)
def test_goals_in_every_way_of_writing(value, goals):
    assert accept_goals("goals", value) == goals


numbers = st.floats(-1e6, 1e6)
names = st.text(st.characters(min_codepoint=32, max_codepoint=0x2FF), min_size=1, max_size=8)
some_goals = st.lists(
    st.builds(Goal, numbers, numbers, st.none() | names.filter(lambda n: n.strip())),
    max_size=4,
    unique_by=lambda goal: goal.name or (goal.x, goal.y),
)


@given(some_goals)
def test_what_is_described_is_read_again_as_the_same(goals):
    goals = [goal for goal in goals if goal.name is None or goal.name.isprintable()]
    described = described_goals(goals)
    assert accept_goals("goals", described) == tuple(goals)
    for text in (json.dumps(described), yaml.safe_dump(described, sort_keys=False)):
        assert accept_goals("goals", yaml.safe_load(text)) == tuple(goals)
