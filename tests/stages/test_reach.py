"""Stage ``reach`` against flood fills, routes and inflated maps."""

import itertools
import json
import math
from decimal import Decimal

import numpy as np
import pytest
import yaml
from hypothesis import assume, given, strategies as st
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
THREE_ROOMS = """
    #######################
    #.....#.....##.......##
    #.....#.....##.......##
    #...........##.......##
    #.....#.....##.......##
    #.....#.....##.......##
    #######################
"""


def centre(grid, row, col):
    return tuple(grid.frame.xy_from_rowcol([(row, col)])[0].tolist())


def flood_fill(occupancy, resolution, radius, start, *, through_unknown=False):
    """Return open and reached cells of a round robot; diagonals need two open straight cells."""
    walled = np.pad(occupancy == 100, 1, constant_values=True)
    squares = np.array(oracles.squared_distance(walled), dtype=float)[1:-1, 1:-1]
    is_open = (occupancy != 100) & (through_unknown | (occupancy != -1))
    is_open &= np.sqrt(squares) * resolution > radius + 1e-9
    reached = np.zeros(occupancy.shape, dtype=bool)
    waiting = [start] if is_open[start] else []
    while waiting:
        row, col = waiting.pop()
        reached[row, col] = True
        for r, c in itertools.product((row - 1, row, row + 1), (col - 1, col, col + 1)):
            is_inside = 0 <= r < len(reached) and 0 <= c < reached.shape[1]
            if is_inside and not reached[r, c] and is_open[[r, row, r], [c, c, col]].all():
                waiting.append((r, c))
    return is_open, reached


def test_two_rooms_and_a_door_by_hand():
    grid = grid_from_text(ROOMS)  # 0.25 m, origin and yaw not 0
    start, goal = centre(grid, 3, 2), centre(grid, 3, 11)
    # a passage has precedence over an equally narrow start, and a start over a goal
    corner, beside = centre(grid, 1, 1), centre(grid, 3, 3)
    for first, last, at in ((corner, goal, "passage"), (corner, beside, "start"),
                            (beside, corner, "goal"), (beside, beside, "start")):  # fmt: skip
        (answer,) = mapdeal.reach(grid, start=first, goals=[last]).goals
        assert answer.limited_by.at == at
    # the door is one cell wide: its centre is a cell, 0.25 m, from either jamb
    found = mapdeal.reach(grid, start=start, goals=[goal], radius=0.24)
    assert (found.goals[0].reachable, found.goals[0].widest_radius) == (True, 0.25)
    assert found.clearance[3, 3] == np.float32(0.75)
    assert found.headings.max() == 72
    stopped = mapdeal.reach(grid, start=start, goals=[goal], radius=0.25, min_area=0.25)
    assert (stopped.goals[0].reachable, stopped.goals[0].heading_count) == (False, 0)
    (passage,) = [passage for passage in stopped.passages if not passage.is_open]
    for place in (found.goals[0].limited_by, passage):
        assert place.width == 0.5
        assert (place.x, place.y) == pytest.approx(centre(grid, 3, 7))
    # open to the robot in the second room: 3 x 3 cells, without the unknown one's row at 2 m
    is_open, reached = flood_fill(grid.occupancy, 0.25, 0.25, (3, 2))
    assert passage.cut_off == pytest.approx((is_open & ~reached).sum() * 0.25**2)


@given(occupancies(), RESOLUTIONS, st.floats(0.0, 3.0), st.booleans(), st.data())
def test_reachable_cells_equal_a_flood_fill(occupancy, resolution, cells, through, data):
    start = tuple(data.draw(st.integers(0, side - 1)) for side in occupancy.shape)
    radius = cells * resolution
    grid = mapdeal.OccupancyGrid(occupancy, resolution, (3.0, -1.0, 0.7))
    is_open, reached = flood_fill(occupancy, resolution, radius, start, through_unknown=through)
    options = {"start": centre(grid, *start), "radius": radius, "through_unknown": through}
    if not is_open.any():
        with pytest.raises(mapdeal.MalformedInputError, match="no cell is open"):
            mapdeal.reach(grid, **options)
    elif not is_open[start]:
        with pytest.raises(mapdeal.ParameterError, match="closed cell") as caught:
            mapdeal.reach(grid, **options)
        assert "nearest open cell" in caught.value.hint
    else:
        found = mapdeal.reach(grid, **options)
        assert np.array_equal(found.reachable, reached)
        assert np.array_equal(found.headings > 0, is_open)
        assert found.reachable_area == pytest.approx(reached.sum() * resolution**2)


@given(occupancies(longest=9), st.integers(0, 2**32 - 1))
def test_a_micrometre_decides_at_the_widest_radius(occupancy, seed):
    free = [tuple(cell) for cell in np.argwhere(occupancy != 100).tolist()]
    assume(free)
    start, goal = (free[k] for k in np.random.default_rng(seed).integers(len(free), size=2))
    grid = mapdeal.OccupancyGrid(occupancy, 0.0504, (3.0, -1.0, 0.7))
    ends = {"start": centre(grid, *start), "goal": centre(grid, *goal)}
    found = mapdeal.reach(grid, start=ends["start"], goals=[ends["goal"]], through_unknown=True)
    widest, limit = found.goals[0].widest_radius, found.goals[0].limited_by
    assert np.float32(widest) == found.widest[goal]
    if limit is not None:
        assert limit.width == pytest.approx(2 * widest)
        assert limit.at == "passage" or (limit.x, limit.y) == pytest.approx(ends[limit.at])
    for radius, expected in ((widest - 1e-6, True), (widest + 1e-6, False)):
        if 0 <= radius < math.inf:
            _, reached = flood_fill(occupancy, 0.0504, radius, start, through_unknown=True)
            assert reached[goal] == expected


def test_the_default_start_is_the_widest_place_of_the_largest_area():
    grid = grid_from_text(THREE_ROOMS)
    # the third room is larger than each of the two, but smaller than both with their door
    for radius, cols in ((0.2, range(1, 12)), (0.25, range(14, 21))):
        found = mapdeal.reach(grid, radius=radius)
        row, col = grid.frame.clamped_rowcol_from_xy([found.start])[0].tolist()
        assert col in cols
        assert found.clearance[row, col] == found.clearance[found.reachable == 1].max()
    # but not the end of a stray beam, which is farther from obstacles than the middle of its room
    beam = np.full((25, 60), -1, np.int8)
    beam[8:17, 2:11] = 100
    beam[9:16, 3:10] = beam[12, 10:50] = 0
    grid = mapdeal.OccupancyGrid(beam, 0.1, (2.0, 1.0, math.pi / 6))
    found = mapdeal.reach(grid, radius=0.09)
    assert found.start == pytest.approx(centre(grid, 12, 6), abs=1e-9)
    assert found.reachable[12, 49]


def test_the_obstacles_of_costs_are_their_lethal_cells():
    grid = grid_from_text(ROOMS)
    start = centre(grid, 3, 2)
    of_map = mapdeal.reach(grid, start=start, radius=0.3)
    # inscribed costs also cover unknown cells, so `widest` differs there
    inflated = mapdeal.exponential_cost(grid, inscribed_radius=0.3)
    names = ["reachable", "headings", "clearance", "widest"]
    for costs, equal in ((mapdeal.Costmap.from_occupancy(grid), names), (inflated, names[:3])):
        of_costs = mapdeal.reach(costs, start=start, radius=0.3)
        for name in equal:
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
    # it fits into the corridor lengthwise but not crosswise
    middle = centre(grid, 8, 22)
    with pytest.raises(mapdeal.ParameterError, match="in this heading, only in"):
        mapdeal.reach(grid, start=(*middle, math.pi / 6 + math.pi / 2), footprint=robot)
    assert mapdeal.reach(grid, start=(*middle, math.pi / 6), footprint=robot).reachable[8, 36]


def test_goals_that_are_not_reached_do_not_affect_the_others():
    grid = grid_from_text(ROOMS)
    places = [(3, 4), (2, 7), (1, 10), (1, 2), (3, -5), (10**12, -(10**12))]
    goals = [Goal(*centre(grid, *place)) for place in places]
    corners = mapdeal.Footprint.polygon([[0.4, 0.1], [0.4, -0.1], [-0.4, -0.1], [-0.4, 0.1]])
    for robot, reason in (
        ({"footprint": corners}, "too narrow for the robot in every heading"),
        ({"radius": 0.3}, "0.25 m from an obstacle, the robot's radius is 0.3 m"),
    ):
        found = mapdeal.reach(grid, start=centre(grid, 3, 2), goals=goals, **robot)
        assert [goal.reachable for goal in found.goals] == [True] + [False] * 5
        reasons = [None, "an obstacle", "unknown", reason, *["outside of the map"] * 2]
        assert [goal.reason for goal in found.goals] == reasons
    is_open = grid.frame.xy_from_rowcol(np.argwhere(found.headings > 0))
    for goal in found.goals[1:]:
        place = goal.goal.x, goal.goal.y
        nearest = np.hypot(*(is_open - place).T).min()
        assert math.dist(goal.nearest_open, place) == pytest.approx(nearest)


def test_a_goal_in_an_unknown_keepout_cell_has_the_same_reason_for_every_shape():
    grid = grid_from_text(ROOMS)
    zone = np.zeros(grid.shape, np.int8)
    zone[1, 10] = 100  # unknown, too
    goals = [Goal(*centre(grid, 1, 10))]
    corners = [[0.2, 0.1], [0.2, -0.1], [-0.2, -0.1], [-0.2, 0.1]]
    shapes = (mapdeal.Footprint.circle(0.2), mapdeal.Footprint.polygon(corners))
    for mask, reason in ((None, "unknown"), (grid.with_values(zone), "in a keepout area")):
        for shape in shapes:
            start = centre(grid, 3, 2)
            found = mapdeal.reach(grid, start=start, goals=goals, footprint=shape, mask=mask)
            assert found.goals[0].reason == reason
            with pytest.raises(mapdeal.ParameterError, match=rf"closed cell \({reason}\)"):
                mapdeal.reach(grid, start=centre(grid, 1, 10), footprint=shape, mask=mask)


def test_no_part_of_a_robot_is_outside_of_the_map():
    walls = np.full((24, 31), 100, np.int8)
    walls[1:-1, 1:-1] = 0
    walls[8:12, 14] = 100
    walled = mapdeal.OccupancyGrid(walls, 0.1, (1.0, 2.0, 0.3))
    cut = mapdeal.OccupancyGrid(walls[1:-1, 1:-1], 0.1, walled.frame.window(1, 1, 22, 29).origin)
    corners = mapdeal.Footprint.polygon([[0.4, 0.2], [0.4, -0.2], [-0.4, -0.2], [-0.4, 0.2]])
    for robot in (mapdeal.Footprint.circle(0.4), corners):
        expected = mapdeal.reach(walled, footprint=robot, start=centre(walled, 15, 20))
        found = mapdeal.reach(cut, footprint=robot, start=centre(cut, 14, 19))
        for name in ("reachable", "headings", "clearance", "widest"):
            assert np.array_equal(getattr(expected, name)[1:-1, 1:-1], getattr(found, name)), name
    rule = r"0\.1 m from the map's edge, the robot's rad"
    with pytest.raises(mapdeal.ParameterError, match=rule):
        mapdeal.reach(cut, radius=0.4, start=centre(cut, 0, 12))


@pytest.mark.parametrize("cells", [1, 3, 6, 7, 13])
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
        assert mapdeal.route(costs, start=start, goal=goal).reached == passes
        if robot >= grid.resolution:
            inflated = mapdeal.inflate(grid, radius=robot)
            assert mapdeal.reach(inflated, start=start, goals=[goal]).goals[0].reachable == passes
        doors = [] if passes else [2 * radius]
        assert [passage.width for passage in disconnected(grid, robot, 0.001)] == doors
    assert found.passages[0].width == 2 * radius


def real_grids(folder, every):
    for path in sorted(folder.rglob("*.yaml"))[::every]:
        try:
            yield mapdeal.read_map(path)
        except mapdeal.MapdealError:
            continue  # parameter files, and maps made to be refused


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("every", [16, pytest.param(1, marks=pytest.mark.thorough)])
def test_reachable_cells_of_real_maps_equal_those_below_inscribed_cost(real_maps, every):
    checked = 0
    for grid in real_grids(real_maps, every):
        radius = 4.51 * grid.resolution
        walls = np.pad(grid.occupancy, 1, constant_values=100)
        walled = mapdeal.OccupancyGrid(walls, grid.resolution)
        radii = {"inscribed_radius": radius, "inflation_radius": 2 * radius}
        costs = mapdeal.exponential_cost(walled, **radii).cost
        groups, count = ndimage.label(costs[1:-1, 1:-1] < 253)  # four neighbours
        if count == 0:
            continue
        largest = int(np.argmax(np.bincount(groups.ravel())[1:])) + 1
        for group in {1, count, largest}:
            cells = np.argwhere(groups == group)
            found = mapdeal.reach(grid, start=centre(grid, *cells[len(cells) // 2]), radius=radius)
            assert np.array_equal(found.reachable, groups == group)
            checked += 1
    assert checked > 4


KITCHEN, HALL = Goal(7.1, 3.2, "kitchen"), Goal(1.5, -2.0, "hall")
UNNAMED = Goal(7.1, 3.2), Goal(1.5, -2.0)


@pytest.mark.parametrize(("value", "goals"), [
    ({"kitchen": [7.1, 3.2], "hall": "1.5,-2"}, (KITCHEN, HALL)),
    ([{"kitchen": [7.1, 3.2]}, {"hall": (1.5, -2)}], (KITCHEN, HALL)),
    ([KITCHEN, (1.5, -2)], (KITCHEN, UNNAMED[1])), (HALL, (HALL,)),
    (np.array([[7.1, 3.2], [1.5, -2]]), UNNAMED), (["7.1,3.2", "1.5,-2"], UNNAMED),
    ("7.1,3.2 1.5, -2", UNNAMED), ("7.1, 3.2", UNNAMED[:1]), ([7.1, 3.2], UNNAMED[:1]),
    ({12: [7.1, 3.2]}, (Goal(7.1, 3.2, "12"),)), ([], ()), ({}, ()),
], ids=repr)  # fmt: skip
def test_goals_in_every_plan_blocks_writing(value, goals):
    assert accept_goals("goals", value) == goals


numbers = st.floats(-1e6, 1e6)
names = st.text(st.characters(min_codepoint=32, max_codepoint=0x2FF), min_size=1, max_size=8)
names = st.none() | names.filter(lambda name: name.strip() and name.isprintable())
GOALS = st.lists(st.builds(Goal, numbers, numbers, names), max_size=4,
                 unique_by=lambda goal: goal.name or (goal.x, goal.y))  # fmt: skip


@given(GOALS)
def test_described_goals_are_read_back_unchanged(goals):
    described = described_goals(goals)
    assert accept_goals("goals", described) == tuple(goals)
    for text in (json.dumps(described), yaml.safe_dump(described, sort_keys=False)):
        assert accept_goals("goals", yaml.safe_load(text)) == tuple(goals)
