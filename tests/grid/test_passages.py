import math
from collections import Counter
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import assume, example, given, strategies as st
from scipy import ndimage
from scipy.cluster.hierarchy import DisjointSet

from mapdeal import Footprint, Frame, Goal, OccupancyGrid, ParameterError, reach, read_map
from mapdeal.grid import reaching
from mapdeal.grid.reaching import cell_of_point, disconnected, largest_closed_square, passages
from mapdeal.kernels.paths import clearance_tree
from strategies import examples

RESOLUTION, ORIGIN = 0.07, (3.0, -2.0, 0.4)


def clearances_of(grid):
    return reaching.Ground(grid.occupancy, grid.frame, through_unknown=False).passage_tree()


def open_cells(clearances, radius):
    distance = np.sqrt(clearances.squared.astype(float)) * clearances.frame.resolution
    return (clearances.tree.basins >= 0) & (distance > radius)


def found(grid, start, radius, **options):
    clearances = clearances_of(grid)
    limits = {"radius": radius, "margin": 0.1, "min_area": 1.0, **options}
    return passages(clearances, open_cells(clearances, radius), start, **limits)


def flooded(is_open, start):
    """Return the cells that straight steps over open ones get to."""
    labels, _ = ndimage.label(is_open)
    return is_open & (labels == labels[start])


def holds(mask, cell):
    return all(0 <= k < side for k, side in zip(cell, mask.shape, strict=True)) and mask[cell]


def climbed(squared, is_traversable, cell):
    """Return the top of the hill that a cell lies on, by the steepest steps; ties by index."""
    while True:
        row, col = cell
        places = cell, (row - 1, col), (row, col - 1), (row, col + 1), (row + 1, col)
        traversable = (place for place in places if holds(is_traversable, place))
        _, highest = max((squared[place], place) for place in traversable)
        if highest == cell:
            return cell
        cell = highest


def rooms(*doors, thickness=1, side=21):
    """Return square rooms in a row, with a door of so many cells (0 is none) between them."""
    occupancy = np.full((side + 2, 1 + (len(doors) + 1) * (side + thickness)), 100, dtype=np.int8)
    for index in range(len(doors) + 1):
        first_col = 1 + index * (side + thickness)
        occupancy[1:-1, first_col : first_col + side] = 0
        if index:
            occupancy[5 : 5 + doors[index - 1], first_col - thickness : first_col] = 0
    return OccupancyGrid(occupancy, RESOLUTION, ORIGIN)


@pytest.mark.parametrize(("door", "thickness"), [(3, 1), (3, 2), (4, 1), (4, 5)])
def test_a_closed_door_is_where_it_is_and_cuts_off_the_room_behind(door, thickness):
    grid = rooms(door, thickness=thickness)
    radius = 0.2  # 2.9 cells; the doors have 2 cells on each side of their middle
    (passage,) = found(grid, (3, 3), radius)
    assert not passage.is_open
    assert passage.width == pytest.approx(2 * 2 * RESOLUTION)
    # rows 4 and 5 + door are obstacles; so is the middle column of the wall, or one of two
    ends = grid.frame.continuous_rowcol_from_xy(passage.ends) - 0.5
    assert ends[:, 0] == pytest.approx([4, 5 + door])
    assert ends[:, 1] == pytest.approx([ends[0, 1]] * 2)
    assert abs(ends[0, 1] - (22 + (thickness - 1) / 2)) <= 0.51
    assert (passage.x, passage.y) == pytest.approx(tuple(np.mean(passage.ends, axis=0)))
    # 21 cells less 2 that are too near on each side; a bulge before the door of thin walls
    behind = flooded(open_cells(clearances_of(grid), radius), (10, grid.shape[1] - 10))
    assert behind.sum() >= 17 * 17
    assert passage.cut_off == pytest.approx(behind.sum() * RESOLUTION**2)


HALF = 4 * RESOLUTION
"""Of a door of 7 cells: four to each side of its middle."""


@pytest.mark.parametrize(("radius", "margin", "are_open"), [
    (HALF + 1e-6, 0.1, [False]), (HALF, 0.1, [False]),
    (HALF - 1e-6, 0.1, [True]), (HALF - 0.1, 0.1, [True]),
    (HALF - 0.1 - 1e-6, 0.1, []), (HALF - 0.1 - 1e-6, 0.11, [True]), (0.0, 0.1, []),
])  # fmt: skip
def test_a_door_is_open_below_half_its_width_and_tight_up_to_a_margin(radius, margin, are_open):
    grid = rooms(7)
    # a robot that can turn everywhere gets the same result
    turning = {"is_reached": open_cells(clearances_of(grid), radius), "circumscribed_radius": 0.5}
    for robot in ({}, turning)[: 1 + (radius < HALF)]:
        doors = found(grid, (3, 3), radius, margin=margin, min_area=0.5, **robot)
        assert [door.is_open for door in doors] == are_open


@pytest.mark.parametrize(("reached", "expected"), [
    (88, [(3, True)]),  # of passages that it can pass only those within the margin are reported,
    (66, [(3, False)]),  # and of passages that it cannot pass only those that it reaches
    (44, [(4, False)]), (22, [(4, False)]),
])  # fmt: skip
def test_a_robot_that_turns_is_stopped_where_it_does_not_get_through(reached, expected):
    grid = rooms(7, 7, 5)  # doors of 4, 4 and 3 cells to each side: 0.28, 0.28, 0.21 m
    is_reached = open_cells(clearances_of(grid), 0.15) & (np.arange(grid.shape[1]) < reached)
    doors = found(grid, (3, 3), 0.15, is_reached=is_reached, circumscribed_radius=0.4)
    assert [(round(door.width / RESOLUTION / 2), door.is_open) for door in doors] == expected


def test_a_robot_that_turns_is_through_with_half_of_what_lies_behind():
    grid = rooms(7)
    is_open = open_cells(clearances_of(grid), 0.2)
    behind = np.argwhere(is_open & (np.arange(grid.shape[1]) > 21))
    half, many = len(behind) // 2, len(behind) - 25
    for reached, cells_needed, is_through in (
        (half, many, True), (half - 1, many, False), (50, 50, True), (49, 50, False)
    ):  # fmt: skip
        is_reached = is_open.copy()
        is_reached[tuple(behind[reached:].T)] = False
        robot = {"is_reached": is_reached, "circumscribed_radius": 0.4, "margin": 0.1}
        (door,) = found(grid, (3, 3), 0.2, min_area=cells_needed * RESOLUTION**2, **robot)
        assert door.is_open == is_through


def test_the_narrowest_place_on_a_way_is_a_door_or_the_room_at_its_ends():
    grid, half = rooms(4), 0.12  # it gets through the door of 0.28 m in no heading
    start, *goals = grid.frame.xy_from_rowcol([(9, 8), (9, 30), (9, 14)]).tolist()
    robot = Footprint([(half, half), (half, -half), (-half, -half), (-half, half)])
    result = reach(grid, start=start, footprint=robot, margin=0, goals=[Goal(*xy) for xy in goals])
    places = [(goal.limited_by.width, goal.limited_by.at) for goal in result.goals]
    assert places == [(pytest.approx(0.28), "passage"), (pytest.approx(1.12), "start")]
    assert [(door.width, door.is_open) for door in result.passages] == [(places[0][0], False)]


@pytest.mark.parametrize(("yaw", "nearest"), [(0.4, None), (1.6, "0.6109"), (-0.8, "0.1745")])
def test_a_start_in_a_closed_heading_names_the_nearest_open_one(yaw, nearest):
    cells = np.pad(np.zeros((6, 58), np.int8), 1, constant_values=100)
    grid = OccupancyGrid(cells, RESOLUTION, ORIGIN)  # a corridor at 0.4 rad
    footprint = Footprint([(0.5, 0.05), (0.5, -0.05), (-0.5, -0.05), (-0.5, 0.05)])
    start = *grid.frame.xy_from_rowcol([(4, 30)])[0].tolist(), yaw
    if nearest is None:
        assert reach(grid, start=start, footprint=footprint).start == start
        return
    with pytest.raises(ParameterError, match="in this heading, only in 12 of 72") as error:
        reach(grid, start=start, footprint=footprint)
    assert error.value.hint.startswith(f"the nearest open heading is {nearest};")


AWAY = "{} m from {}, the robot's radius is 0.6 m".format


@pytest.mark.parametrize(("row", "col", "reason"), [
    (-1, 5, "outside of the map"), (9, 9, "an obstacle"), (4, 4, "unknown"),
    (1, 6, AWAY(0.5, "the map's edge")), (16, 6, AWAY(0.5, "the map's edge")),
    (6, 1, AWAY(0.5, "the map's edge")), (6, 16, AWAY(0.5, "the map's edge")),
    (9, 10, AWAY(0.25, "an obstacle")), (10, 10, AWAY(0.3536, "an obstacle")), (13, 13, None),
])  # fmt: skip
def test_goals_in_closed_cells_have_a_reason(row, col, reason):
    cells = np.zeros((18, 18), np.int8)
    cells[9, 9], cells[4, 4] = 100, -1
    grid = OccupancyGrid(cells, 0.25, ORIGIN)
    start, place = grid.frame.xy_from_rowcol([(13, 5), (row, col)]).tolist()
    (goal,) = reach(grid, start=start, goals=[Goal(*place)], radius=0.6).goals
    assert goal.reason == reason
    if reason is not None:
        with pytest.raises(ParameterError) as caught:
            reach(grid, start=place, radius=0.6)
        assert reason in str(caught.value)


def test_without_a_wall_or_a_way_there_are_no_passages():
    free, full = (OccupancyGrid(np.full((9, 14), v, np.int8), RESOLUTION, ORIGIN) for v in (0, 100))
    for grid in (free, full):
        assert found(grid, (3, 3), 0.2) == ()
        assert disconnected(grid, 0.2, 0.1) == []
    assert found(rooms(3), (0, 0), 0.2) == ()


def cells_in(mask):
    return [tuple(cell) for cell in np.argwhere(mask).tolist()]


def added(squared, is_traversable):
    """Yield the cells, the highest first, each with the higher ones beside it.

    It belongs to the highest of them, and joins the others to that in the order of `ClearanceTree`.
    """
    visited = set()
    for row, col in sorted(cells_in(is_traversable), key=lambda cell: -squared[cell]):
        visited.add((row, col))
        places = ((row + 1, col), (row - 1, col), (row, col + 1), (row, col - 1))
        places = sorted((p for p in places if p in visited), key=lambda p: -squared[p])
        yield (row, col), places[:1] + sorted(places[1:], reverse=True)


def brute_open(squared, is_open, is_traversable, start, radius, margin, min_cells):
    """Return the tight passages by adding cells one by one: (square, cells behind).

    And whether there is one answer: not if a cell is the highest between the hill that it belongs
    to and two others that are joined already, since then it may join it to either.
    """
    start = climbed(squared, is_traversable, start)
    hills = [climbed(squared, is_traversable, cell) for cell in cells_in(is_open)]
    wider = is_traversable & (np.sqrt(squared) > radius + margin)
    areas = {frozenset(cells_in(flooded(wider, cell))) for cell in cells_in(wider)}
    large = [area for area in areas
             if sum(hill in area for hill in hills) >= min_cells or start in area]  # fmt: skip
    group, links, is_certain = {}, [], True
    for cell, places in added(squared, is_traversable):
        group[cell] = {cell}
        merged = [id(group[p]) for p in places[1:] if group[p] is not group[places[0]]]
        is_certain &= len(merged) == len(set(merged))
        is_tight = radius < math.sqrt(squared[cell]) <= radius + margin
        for place in places:
            if (near := group[cell]) is (far := group[place]):
                continue
            is_meeting = all(any(area <= side for area in large) for side in (near, far))
            links.append((cell, place, is_meeting and is_tight))
            group |= dict.fromkeys(near | far, near | far)
    stopping = []
    for link in links:
        if link[2] and group[link[0]] is group[start]:
            without = DisjointSet(group)
            for near, far, _ in (connection for connection in links if connection is not link):
                without.merge(near, far)
            side = without[start]
            behind = sum(is_open[cell] and without[cell] != side for cell in group[start])
            if behind:
                stopping.append((int(squared[link[0]]), int(behind)))
    return stopping, is_certain


@st.composite
def heights(draw):
    """Any order of cells by height; some are closed. Not distances: none are equal."""
    height, width = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    squared = rng.permutation(height * width).reshape(height, width).astype(np.int32) + 1
    closed = rng.random((height, width)) < draw(st.sampled_from([0, 0.1, 0.4]))
    return squared, ~closed


def brute_closed(squared, is_traversable, start, radius, min_cells):
    """Return the doors that stop a round robot on the widest ways, and those besides them.

    Cells are added one by one, the highest first; those too low to stand on become part of the
    area that they touch first.
    """
    labels, count = ndimage.label(is_traversable & (np.sqrt(squared) > radius))
    sizes, every = np.bincount(labels.ravel()), range(1, count + 1)
    large = {k for k in every if sizes[k] >= min_cells or k == labels[start]}
    joined, home = DisjointSet(cells_in(is_traversable)), DisjointSet(cells_in(is_traversable))
    owner = {cell: int(labels[cell]) for cell in home}
    links = []
    for cell, places in added(squared, is_traversable):
        for place in places:
            if joined[cell] == joined[place]:
                continue
            joined.merge(cell, place)
            near, far = home[cell], home[place]
            if owner[near] and owner[far] and owner[near] != owner[far]:
                links.append((cell, owner[near], owner[far]))
            else:
                home.merge(near, far)
                owner[home[near]] = owner[near] or owner[far]
    group, is_meeting = DisjointSet(every), []
    for _, *ends in links:
        of_large = {group[k] for k in large}
        is_meeting.append(of_large >= {group[end] for end in ends})
        if not is_meeting[-1]:
            group.merge(*ends)
    cluster = DisjointSet(every)
    for (_, *ends), meets in zip(links, is_meeting, strict=True):
        if not meets and not large & set(ends):
            cluster.merge(*ends)
    for index, (_, *ends) in enumerate(links):
        small = set(ends) - large
        if not is_meeting[index] and len(small) == 1:
            end = cluster[next(iter(small))]
            inside = [k for k in every if k not in large and cluster[k] == end]
            is_meeting[index] = sum(sizes[inside]) >= min_cells
    region, doors = DisjointSet(every), []
    for link, meets in zip(links, is_meeting, strict=True):
        if meets:
            doors.append(link)
        else:
            region.merge(*link[1:])
    owned = {cell: owner[home[cell]] for cell in home}
    owned = {cell: region[k] for cell, k in owned.items() if k}
    if start not in owned:
        return [], []
    behind, leading = {}, {}  # a region: the cells behind the door to it, and that door

    def walk(node, before):
        total = sum(sizes[k] for k in every if region[k] == node)
        for cell, *ends in doors:
            ends = [region[k] for k in ends]
            if node in ends and (after := ends[1 - ends.index(node)]) != before:
                leading[after] = cell
                behind[after] = walk(after, node)
                total += behind[after]
        return total

    walk(owned[start], None)
    at_doors = [(int(squared[leading[k]]), int(behind[k])) for k in behind]
    other_doors = []
    for door in borders_of(owned, squared):
        met = DisjointSet(every)
        for _, cell, ends, _ in sorted(door, key=lambda entry: entry[0]):
            if met[ends[0]] == met[ends[1]]:
                continue
            met.merge(*ends)
            far = [end for end in ends if end in behind]
            if far and cell not in leading.values():
                far = min(far, key=lambda end: (behind[end], -squared[leading[end]]))
                if 2 * math.sqrt(squared[cell]) >= math.sqrt(squared[leading[far]]):
                    other_doors.append((int(squared[cell]), int(behind[far])))
    return at_doors, other_doors


def borders_of(owned, squared):
    """Yield the borders between regions, all that hang together by the corners of cells at once."""
    borders = []
    for row, col in owned:
        for beyond in ((row, col + 1), (row + 1, col)):
            ends = owned[row, col], owned.get(beyond)
            if None not in ends and ends[0] != ends[1]:
                narrower, wider = sorted(((row, col), beyond), key=lambda cell: squared[cell])
                rank = -squared[narrower], (-wider[0], -wider[1])
                borders.append((rank, narrower, ends, {beyond, (row + 1, col + 1)}))
    while borders:
        door = [borders.pop()]
        corners = set(door[0][-1])
        while more := [border for border in borders if border[-1] & corners]:
            door += more
            corners = corners.union(*(border[-1] for border in more))
            borders = [border for border in borders if border not in more]
        yield door


@pytest.mark.slow
@examples(80)
@given(heights(), st.floats(0, 9), st.sampled_from([0.0, 0.7, 3.0]), st.integers(1, 12), st.data())
def test_passages_are_those_of_the_definition(drawn, radius, margin, min_cells, data):
    squared, is_traversable = drawn
    assume(is_traversable.any())
    start = data.draw(st.sampled_from(cells_in(is_traversable)))
    frame = Frame(*squared.shape, 1.0)
    clearances = reaching.PassageTree(clearance_tree(squared, is_traversable), squared, frame)
    is_open = is_traversable & (np.sqrt(squared) > radius)
    limits = {"radius": radius, "margin": margin}
    doors = passages(clearances, is_open, start, min_area=float(min_cells), **limits)
    expected, is_certain = brute_open(
        squared, is_open, is_traversable, start, min_cells=min_cells, **limits
    )
    hill = climbed(squared, is_traversable, start)
    closed, other_doors = brute_closed(squared, is_traversable, hill, radius, min_cells)
    squares = [round((warning.width / 2) ** 2) for warning in doors]
    if is_certain:
        found_doors = zip(squares, [round(door.cut_off) for door in doors], strict=True)
        assert sorted(found_doors) == sorted(expected + closed + other_doors)
    else:
        assert not Counter(square for square, _ in expected + closed) - Counter(squares)
    assert [door.width for door in doors] == sorted(door.width for door in doors)
    assert all(door.is_open == (door.width / 2 > radius) for door in doors)


def assert_split_by(grid, passage, start, radius):
    clearances = clearances_of(grid)
    distance = np.sqrt(clearances.squared.astype(float)) * grid.resolution
    is_traversable = clearances.tree.basins >= 0
    half = passage.width / 2
    start = climbed(clearances.squared, is_traversable, start)
    place = grid.frame.continuous_rowcol_from_xy([(passage.x, passage.y)])[0].astype(int)
    near = np.argwhere(abs(distance - half) < 1e-9)
    near = near[np.hypot(*(near - place).T) <= 2.5]

    def sides_of(cell):
        narrower = flooded(is_traversable & (distance > half - 1e-6), cell)
        labels, count = ndimage.label(narrower & (distance > half + 1e-6))
        basins, is_open = clearances.tree.basins, distance > radius
        hills = [np.isin(basins, basins[labels == k + 1]) for k in range(count)]
        return sum((hill & is_open).any() or labels[start] == k for k, hill in enumerate(hills, 1))

    # A cell beside the passage may be as narrow as it is.
    assert any(sides_of(tuple(cell)) >= 2 for cell in near)


def widest_doors(doors):
    by_area = {door.cut_off: door for door in sorted(doors, key=lambda door: door.width)}
    return list(by_area.values())


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.1, 0.15, 0.25]))
@example(7519, 0.15)
@examples(15)
def test_a_robot_a_hair_narrower_passes_and_one_a_hair_wider_does_not(seed, radius):
    rng = np.random.default_rng(seed)
    occupancy = np.where(rng.random((30, 43)) < 0.04, 100, 0).astype(np.int8)
    occupancy[:, 20] = np.where(rng.random(30) < 0.8, 100, 0)
    grid = OccupancyGrid(occupancy, RESOLUTION, ORIGIN)
    free = np.argwhere(occupancy == 0)
    start = tuple(free[rng.integers(len(free))].tolist())
    doors = found(grid, start, radius, min_area=0.1)
    assert list(doors) == sorted(doors, key=lambda door: (door.width, -door.cut_off, door.ends))
    for passage in widest_doors(doors):
        assert_split_by(grid, passage, start, radius)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "count", "closed"), [
    pytest.param("mit-racecar__racecar_simulator/maps/building_31", 29, 26,
                 marks=pytest.mark.thorough),
    ("turtlebot__turtlebot_apps/turtlebot_navigation/maps/willow-2010-02-18-0.10", 10, 5),
])  # fmt: skip
def test_doors_of_real_maps(real_maps, name, count, closed):
    grid = read_map(real_maps / f"{name}.yaml")
    clearances = clearances_of(grid)
    largest = clearances.in_largest_area(largest_closed_square(0.45, grid.frame))
    start = divmod(int(np.where(largest, clearances.squared, 0).argmax()), grid.shape[1])
    doors = found(grid, start, 0.45)
    assert len(doors) == count
    assert [warning.is_open for warning in doors] == [False] * closed + [True] * (count - closed)
    widths = [door.width for door in doors]
    assert [door.width for door in disconnected(grid, 0.45, 1.0)] == widths[:closed]
    for passage in widest_doors(doors)[:2]:
        assert_split_by(grid, passage, start, 0.45)


@pytest.mark.parametrize("resolution", ["0.05", "0.07", "0.3", "1e-3", "1000"])
def test_a_distance_of_the_radius_itself_is_closed(resolution):
    frame = Frame(100, 100, float(resolution))
    for square in range(1, 2000):
        radius = math.sqrt(square) * float(resolution)
        assert largest_closed_square(radius, frame) == square
        assert largest_closed_square(radius - 3e-9, frame) == square - 1
    for count in range(1, 50):  # on paper: 6 * 0.05 is more than 0.3 in floats
        radius = float(count * Decimal(resolution))
        assert largest_closed_square(radius, frame) == count**2


@pytest.mark.parametrize(("frame", "within"), [
    (Frame(3, 5, 0.5, (2.0, 1.0, math.pi / 2)), "x 0.5 .. 2, y 1 .. 3.5"),
    (Frame(2, 2, 0.5, (-0.5 - 1e-9, -1e-9, 0.0)), "x -0.5 .. 0.5, y 0 .. 1"),  # no zero below 0
])  # fmt: skip
def test_cells_of_points_and_where_the_map_lies(frame, within):
    corner = tuple(frame.xy_from_continuous_rowcol([[0.1, 0.1]])[0])
    assert cell_of_point(frame, corner, "start") == (0, 0)
    with pytest.raises(ParameterError, match="start: lies outside") as caught:
        cell_of_point(frame, (2.25, 1.25), "start")
    assert caught.value.hint == f"the map lies within {within}"


@given(st.integers(1, 70), st.integers(1, 70), st.integers(0, 3), st.integers(0, 2**32 - 1))
def test_the_nearest_open_cell_is_that_of_a_search_through_all(height, width, count, seed):
    rng = np.random.default_rng(seed)
    marked = np.zeros((height, width), dtype=bool)
    marked[rng.integers(height, size=count), rng.integers(width, size=count)] = True
    cell = (int(rng.integers(-height, 2 * height)), int(rng.integers(-width, 2 * width)))
    hint = reaching.nearest_open_text(Frame(height, width, 0.5, (-3.0, 2.0, 0.0)), marked, cell)
    if not count:
        assert hint == "no cell of the map is open"
        return
    distance, (row, col) = min((math.dist(place, cell), place) for place in cells_in(marked))
    place = f"{-3.0 + (col + 0.5) * 0.5:.10g},{2.0 + (row + 0.5) * 0.5:.10g}"
    assert hint == f"the nearest open cell is {distance * 0.5:.3g} m away, at {place}"


def test_the_nearest_cell_to_one_that_is_very_far_away():
    marked = np.zeros((60, 60), dtype=bool)
    marked[16, 16] = marked[0, 17] = marked[59, 0] = True
    assert reaching.nearest_marked(marked, (-(10**18), 10**18)) == (0, 17)
    assert reaching.nearest_marked(marked, (10**18, 30)) == (59, 0)
