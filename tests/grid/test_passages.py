import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import ndimage

from conftest import NO_TEST_DATA, TEST_DATA
from drawn import cells
from mapdeal import OccupancyGrid, read_map
from mapdeal.grid.reaching import (
    Ground,
    Ways,
    bottleneck_on_way,
    disconnected,
    largest_closed_square,
    passages,
)
from mapdeal.kernels.paths import clearance_tree

RESOLUTION, ORIGIN = 0.07, (3.0, -2.0, 0.4)


def ways_of(grid):
    return Ground(grid.occupancy, grid.frame, through_unknown=False).ways()


def open_cells(ways, radius):
    distance = np.sqrt(ways.squared.astype(float)) * ways.frame.resolution
    return (ways.tree.basins >= 0) & (distance > radius)


def found(grid, start, radius, **rest):
    ways = ways_of(grid)
    return passages(ways, open_cells(ways, radius), start, radius=radius, **rest)


def flooded(is_open, start):
    """Return the cells that straight steps over open ones get to."""
    labels, _ = ndimage.label(is_open)
    return is_open & (labels == labels[start])


def climbed(squared, is_traversable, cell):
    """Return the top of the hill that a cell lies on, by the steepest steps; ties by index."""
    while True:
        row, col = cell
        around = [
            (squared[place], place)
            for place in (cell, (row - 1, col), (row, col - 1), (row, col + 1), (row + 1, col))
            if 0 <= place[0] < squared.shape[0]
            and 0 <= place[1] < squared.shape[1]
            and is_traversable[place]
        ]
        _, highest = max(around)
        if highest == cell:
            return cell
        cell = highest


def rooms(*doors, thickness=1, side=21):
    """Return rooms in a row, each `side` cells wide, with a door of so many cells between them.

    0 is a wall without a door.
    """
    occupancy = np.full((side + 2, 1 + (len(doors) + 1) * (side + thickness)), 100, dtype=np.int8)
    for index in range(len(doors) + 1):
        left = 1 + index * (side + thickness)
        occupancy[1:-1, left : left + side] = 0
        if index:
            first = 5
            occupancy[first : first + doors[index - 1], left - thickness : left] = 0
    return OccupancyGrid(occupancy, RESOLUTION, ORIGIN)


@pytest.mark.parametrize("thickness", [1, 2, 5])
@pytest.mark.parametrize("door", [3, 4])
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
    behind = flooded(open_cells(ways_of(grid), radius), (10, grid.shape[1] - 10))
    assert behind.sum() >= 17 * 17
    assert passage.cut_off == pytest.approx(behind.sum() * RESOLUTION**2)


def test_a_door_is_open_below_half_its_width_and_tight_up_to_a_margin():
    grid = rooms(7)  # four cells to each side
    half = 4 * RESOLUTION
    for radius, margin, told in (
        (half + 1e-6, 0.1, [False]),
        (half, 0.1, [False]),
        (half - 1e-6, 0.1, [True]),
        (half - 0.1, 0.1, [True]),
        (half - 0.1 - 1e-6, 0.1, []),
        (half - 0.1 - 1e-6, 0.11, [True]),
        (0.0, 0.1, []),
    ):
        assert [
            one.is_open for one in found(grid, (3, 3), radius, margin=margin, min_area=0.5)
        ] == told


def test_a_robot_that_turns_is_stopped_where_it_does_not_get_through():
    grid = rooms(7, 7, 5)
    radius, around = 0.15, 0.4  # doors of 4, 4 and 3 cells to each side: 0.28, 0.28, 0.21 m
    ways = ways_of(grid)
    is_open = open_cells(ways, radius)

    def told(reached):
        is_reached = np.zeros(grid.shape, dtype=bool)
        is_reached[:, :reached] = is_open[:, :reached]
        return [
            (round(one.width / RESOLUTION / 2), one.is_open)
            for one in passages(
                ways, is_open, (3, 3), radius=radius, circumscribed_radius=around,
                is_reached=is_reached,
            )
        ]  # fmt: skip

    # Only what is within the margin is told where it gets through,
    assert told(88) == [(3, True)]
    # and of what it does not get through only what it stands before.
    assert told(66) == [(3, False)]
    assert told(44) == [(3, False), (4, False)]
    assert told(22) == [(3, False), (4, False)]


def test_a_map_without_a_wall_has_no_passages():
    grid = OccupancyGrid(np.zeros((9, 14), np.int8), RESOLUTION, ORIGIN)
    assert found(grid, (3, 3), 0.2) == ()
    assert disconnected(grid, 0.2, 0.1) == []
    assert disconnected(OccupancyGrid(np.full((9, 14), 100, np.int8), RESOLUTION), 0.2) == []
    grid = OccupancyGrid(np.full((9, 14), 100, np.int8), RESOLUTION, ORIGIN)
    assert found(grid, (3, 3), 0.2) == ()


def test_of_equally_narrow_doors_the_one_that_cuts_off_more_comes_first():
    grid = rooms(3, 3)
    for start in ((3, 3), (3, 60)):
        told = found(grid, start, 0.2)
        assert [one.width for one in told] == [told[0].width] * 2
        assert told[0].cut_off > 1.5 * told[1].cut_off
    told = found(grid, (3, 30), 0.2)  # of equal areas that of the smaller ends
    assert told[0].cut_off == told[1].cut_off
    assert told[0].ends < told[1].ends


def test_nothing_is_told_of_a_start_without_ways():
    assert found(rooms(3), (0, 0), 0.2) == ()


def test_a_robot_that_turns_is_through_with_half_of_what_lies_behind():
    grid = rooms(7)
    ways = ways_of(grid)
    is_open = open_cells(ways, 0.15)
    behind = int(is_open[:, 22:].sum())

    def told(reached, cells):
        is_reached = is_open.copy()
        rows, cols = np.argwhere(is_open[:, 22:])[reached:].T
        is_reached[rows, cols + 22] = False
        return [
            one.is_open
            for one in passages(
                ways, is_open, (3, 3), radius=0.2, margin=0.1, is_reached=is_reached,
                min_area=cells * RESOLUTION**2, circumscribed_radius=0.4,
            )
        ]  # fmt: skip

    assert told(behind // 2 + 1, behind - 25) == [True]
    assert told(behind // 2 - 1, behind - 25) == [False]
    assert told(50, 50) == [True]
    assert told(49, 50) == [False]


def test_a_robot_that_turns_is_told_of_doors_up_to_the_margin():
    ways = ways_of(rooms(7))
    half = 4 * RESOLUTION
    for radius, told in ((half - 0.1, [True]), (half - 0.1 - 1e-6, [])):
        is_open = open_cells(ways, radius)
        found_by_it = passages(
            ways, is_open, (3, 3), radius=radius, margin=0.1, is_reached=is_open,
            circumscribed_radius=0.5,
        )  # fmt: skip
        assert [one.is_open for one in found_by_it] == told


@st.composite
def heights(draw):
    """Any order of cells by height; some are closed. Not distances: none are equal."""
    height, width = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    squared = rng.permutation(height * width).reshape(height, width).astype(np.int32) + 1
    closed = rng.random((height, width)) < draw(st.sampled_from([0, 0.1, 0.4]))
    return squared, ~closed


def brute(squared, is_open, is_traversable, start, radius, margin, min_cells):
    """Return the passages by adding cells one by one, the highest first: (square, cells behind).

    And whether there is one answer: not if a cell is the highest between the hill that it belongs
    to and two others that are joined already, since then it may join it to either.

    The areas are joined as rings of a tree; what is behind a passage is found by walking there.
    """
    order = sorted(
        (tuple(cell) for cell in np.argwhere(is_traversable).tolist()), key=lambda c: -squared[c]
    )
    told = []
    start = climbed(squared, is_traversable, start)
    is_certain = True
    hills = {
        cell: climbed(squared, is_traversable, cell)
        for cell in map(tuple, np.argwhere(is_open).tolist())
    }
    for wide, narrow in ((radius + margin, radius),):
        # what is connected by cells that are wider, and large enough
        wider = is_traversable & (np.sqrt(squared) > wide)
        large = set()
        for cell in map(tuple, np.argwhere(wider).tolist()):
            area = flooded(wider, cell)
            if sum(area[hill] for hill in hills.values()) >= min_cells or area[start]:
                large.add(frozenset(map(tuple, np.argwhere(area).tolist())))
        group = {}
        links = []  # of cells that joined two groups
        for cell in order:
            row, col = cell
            group[cell] = {cell}
            # a cell belongs to its highest neighbour, and joins others to that
            places = ((row + 1, col), (row - 1, col), (row, col + 1), (row, col - 1))
            places = sorted((p for p in places if p in group), key=lambda p: -squared[p])
            places[1:] = sorted(places[1:], reverse=True)  # as `ClearanceTree` orders its edges
            others = [id(group[p]) for p in places[1:] if group[p] is not group[places[0]]]
            is_certain &= len(others) == len(set(others))
            for place in places:
                if group[place] is group[cell]:
                    continue
                sides = [group[cell], group[place]]
                is_meeting = all(any(one <= side for one in large) for side in sides)
                within = narrow < math.sqrt(squared[cell]) <= wide
                links.append((cell, place, is_meeting and within))
                both = sides[0] | sides[1]
                for member in both:
                    group[member] = both
        for index, (cell, _, is_meeting) in enumerate(links):
            if not is_meeting or start not in group or group[cell] is not group[start]:
                continue
            tree = {}
            for other, (a, b, _) in enumerate(links):
                if other != index:
                    tree.setdefault(a, []).append(b)
                    tree.setdefault(b, []).append(a)
            ahead, waiting = {start}, [start]
            while waiting:
                for near in tree.get(waiting.pop(), ()):
                    if near not in ahead:
                        ahead.add(near)
                        waiting.append(near)
            behind = [one for one in group[start] if one not in ahead and is_open[one]]
            if behind:
                told.append((int(squared[cell]), len(behind)))
    ways, others = brute_closed(squared, is_traversable, order, start, radius, min_cells)
    return sorted(told + ways), others, is_certain


def brute_closed(squared, is_traversable, order, start, radius, min_cells):
    """Return the doors that stop a round robot on the widest ways: (square, cells behind).

    And those besides them.
    Cells are added one by one, the highest first; those too low to stand on become part of the
    area that they touch first.
    """
    labels, count = ndimage.label(is_traversable & (np.sqrt(squared) > radius))
    sizes = np.bincount(labels.ravel())
    large = {k for k in range(1, count + 1) if sizes[k] >= min_cells or k == labels[start]}
    root = {cell: cell for cell in order}  # by what is connected
    owner = {cell: int(labels[cell]) for cell in order}  # of the cells with one root

    def top(of, node):
        while of[node] != node:
            node = of[node]
        return node

    area = {cell: {cell} for cell in order}
    home = {cell: cell for cell in order}  # by what belongs to one area
    links, added = [], set()
    for cell in order:
        row, col = cell
        added.add(cell)
        places = ((row + 1, col), (row - 1, col), (row, col + 1), (row, col - 1))
        places = sorted((p for p in places if p in added), key=lambda p: -squared[p])
        places[1:] = sorted(places[1:], reverse=True)
        for place in places:
            if top(root, cell) == top(root, place):
                continue
            root[top(root, cell)] = top(root, place)
            one, other = top(home, cell), top(home, place)
            if owner[one] and owner[other] and owner[one] != owner[other]:
                links.append((cell, owner[one], owner[other]))
            else:
                home[one] = other
                owner[other] = owner[one] or owner[other]
                area[other] |= area[one]
    group = {k: k for k in range(1, count + 1)}
    is_meeting = []
    for _, one, other in links:
        ends = [top(group, one), top(group, other)]
        is_meeting.append(all(any(top(group, k) == end for k in large) for end in ends))
        if not is_meeting[-1]:
            group[ends[0]] = ends[1]
    cluster = {k: k for k in range(1, count + 1)}
    for (_, one, other), meets in zip(links, is_meeting, strict=True):
        if not meets and not {one, other} & large:
            cluster[top(cluster, one)] = top(cluster, other)
    for index, (_, one, other) in enumerate(links):
        small = {one, other} - large
        if not is_meeting[index] and len(small) == 1:
            (end,) = small
            inside = [k for k in cluster if k not in large and top(cluster, k) == top(cluster, end)]
            is_meeting[index] = sum(sizes[k] for k in inside) >= min_cells
    region = {k: k for k in range(1, count + 1)}
    for (_, one, other), meets in zip(links, is_meeting, strict=True):
        if not meets:
            region[top(region, one)] = top(region, other)
    doors = [link for link, meets in zip(links, is_meeting, strict=True) if meets]
    owned = {cell: owner[top(home, cell)] for cell in order}
    owned = {cell: top(region, k) for cell, k in owned.items() if k}
    if start not in owned:
        return [], []
    behind, leading = {}, {}  # a region: the cells behind the door to it, and that door

    def walk(node, before):
        total = sum(sizes[k] for k in region if top(region, k) == node)
        for cell, *ends in doors:
            ends = [top(region, k) for k in ends]
            if node in ends and (after := ends[1 - ends.index(node)]) != before:
                leading[after] = cell
                behind[after] = walk(after, node)
                total += behind[after]
        return total

    walk(owned[start], None)
    told = [(int(squared[leading[k]]), int(behind[k])) for k in behind]
    others = []
    # borders that hang together by the corners of cells
    borders = []
    for row, col in order:
        for beyond, corners in (
            ((row, col + 1), {(row, col + 1), (row + 1, col + 1)}),
            ((row + 1, col), {(row + 1, col), (row + 1, col + 1)}),
        ):
            ends = owned.get((row, col)), owned.get(beyond)
            if None not in ends and ends[0] != ends[1]:
                narrower, wider = sorted(((row, col), beyond), key=lambda c: squared[c])
                borders.append(
                    ((-squared[narrower], (-wider[0], -wider[1])), narrower, ends, corners)
                )
    while borders:
        door, corners = [borders.pop()], set()
        corners |= door[0][-1]
        while more := [one for one in borders if one[-1] & corners]:
            door += more
            corners = corners.union(*(one[-1] for one in more))
            borders = [one for one in borders if one not in more]
        joined = {k: k for k in region}
        for _, cell, ends, _ in sorted(door, key=lambda one: one[0]):
            if top(joined, ends[0]) == top(joined, ends[1]):
                continue
            joined[top(joined, ends[0])] = top(joined, ends[1])
            far = [end for end in ends if end in behind]
            if far and cell not in leading.values():
                far = min(far, key=lambda end: (behind[end], -squared[leading[end]]))
                if 2 * math.sqrt(squared[cell]) >= math.sqrt(squared[leading[far]]):
                    others.append((int(squared[cell]), int(behind[far])))
    return told, others


@pytest.mark.slow
@settings(max_examples=150)
@given(heights(), st.floats(0, 9), st.sampled_from([0.0, 0.7, 3.0]), st.integers(1, 12), st.data())
def test_passages_are_those_of_the_definition(drawn, radius, margin, min_cells, data):
    squared, is_traversable = drawn
    if not is_traversable.any():
        return
    places = [tuple(cell) for cell in np.argwhere(is_traversable).tolist()]
    start = data.draw(st.sampled_from(places))
    grid = OccupancyGrid(np.zeros(squared.shape, np.int8), 1.0)
    ways = Ways(clearance_tree(squared, is_traversable), squared, grid.frame)
    is_open = is_traversable & (np.sqrt(squared) > radius)
    told = passages(ways, is_open, start, radius=radius, margin=margin, min_area=float(min_cells))
    expected, others, is_certain = brute(
        squared, is_open, is_traversable, start, radius, margin, min_cells
    )
    squares = [round((one.width / 2) ** 2) for one in told]
    if is_certain:
        behind = [round(one.cut_off) for one in told]
        assert sorted(zip(squares, behind, strict=True)) == sorted(expected + others)
    else:
        assert not Counter(square for square, _ in expected) - Counter(squares)
    assert [one.width for one in told] == sorted(one.width for one in told)
    assert all(one.is_open == (one.width / 2 > radius) for one in told)


def widest_doors(told):
    """Return of the doors to the same areas the widest."""
    by_area = {one.cut_off: one for one in sorted(told, key=lambda one: one.width)}
    return list(by_area.values())


def split_by(grid, passage, start, radius):
    """Assert that a robot a hair narrower than a passage passes, and one a hair wider does not."""
    ways = ways_of(grid)
    resolution = grid.resolution
    distance = np.sqrt(ways.squared.astype(float)) * resolution
    is_traversable = ways.tree.basins >= 0
    width = passage.width
    start = climbed(ways.squared, is_traversable, start)
    row, col = grid.frame.continuous_rowcol_from_xy([(passage.x, passage.y)])[0].astype(int)
    near = np.argwhere(abs(distance - width / 2) < 1e-9)
    near = near[np.hypot(*(near - (row, col)).T) <= 2.5]
    is_open = distance > radius

    def sides_of(cell):
        narrower = flooded(is_traversable & (distance > width / 2 - 1e-6), cell)
        wider = narrower & (distance > width / 2 + 1e-6)
        sides = 0
        left = wider.copy()
        while left.any():
            side = flooded(wider, tuple(np.argwhere(left)[0]))
            left &= ~side
            hills = np.isin(ways.tree.basins, np.unique(ways.tree.basins[side]))
            sides += (hills & is_open).any() or side[start]
        return sides

    # A cell beside the passage may be as narrow as it is.
    assert any(sides_of(tuple(cell)) >= 2 for cell in near)


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.1, 0.15, 0.25]))
@example(7519, 0.15)
@settings(max_examples=25)
def test_a_robot_a_hair_narrower_passes_and_one_a_hair_wider_does_not(seed, radius):
    rng = np.random.default_rng(seed)
    occupancy = np.where(rng.random((30, 43)) < 0.04, 100, 0).astype(np.int8)
    occupancy[:, 20] = np.where(rng.random(30) < 0.8, 100, 0)
    grid = OccupancyGrid(occupancy, RESOLUTION, ORIGIN)
    free = np.argwhere(occupancy == 0)
    start = tuple(free[rng.integers(len(free))].tolist())
    for passage in widest_doors(found(grid, start, radius, min_area=0.1)):
        split_by(grid, passage, start, radius)


@pytest.mark.slow
@pytest.mark.skipif(not TEST_DATA.is_dir(), reason=NO_TEST_DATA)
@pytest.mark.parametrize(
    ("name", "count", "closed"),
    [
        pytest.param(
            "mit-racecar__racecar_simulator/maps/building_31", 29, 26, marks=pytest.mark.thorough
        ),
        ("turtlebot__turtlebot_apps/turtlebot_navigation/maps/willow-2010-02-18-0.10", 10, 5),
        ("ros-navigation__navigation2/nav2_bringup/maps/warehouse", 0, 0),
    ],
)
def test_doors_of_real_maps(name, count, closed):
    grid = read_map(TEST_DATA / f"{name}.yaml")
    ways = ways_of(grid)
    largest = ways.in_largest_area(largest_closed_square(0.45, grid.frame))
    height = np.where(largest, ways.squared, 0)
    start = divmod(int(height.argmax()), grid.shape[1])
    told = found(grid, start, 0.45)
    assert len(told) == count
    assert sum(not one.is_open for one in told) == closed
    assert told[:closed] == tuple(one for one in told if not one.is_open)
    assert [one.width for one in disconnected(grid, 0.45)] == [one.width for one in told[:closed]]
    for passage in widest_doors(told)[:2]:
        split_by(grid, passage, start, 0.45)


def on_way(text, start, goal):
    grid = OccupancyGrid(cells(text), RESOLUTION, ORIGIN)
    ways = ways_of(grid)
    told = bottleneck_on_way(ways.begun_at(start), goal)
    if told is None:
        return None
    row, col = grid.frame.continuous_rowcol_from_xy([(told.x, told.y)])[0] - 0.5
    return (
        round(row, 6) + 0.0,
        round(col, 6) + 0.0,
        round((told.width / 2 / RESOLUTION) ** 2),
        told.at,
    )


def test_a_way_is_limited_by_a_passage_the_start_or_the_goal():
    narrow = """
        #############
        #.....#.....#
        #.....#.....#
        #...........#
        #.....#.....#
        #.....#.....#
        #############
    """
    assert on_way(narrow, (3, 3), (3, 9)) == (3.0, 6.0, 1, "passage")
    assert on_way(narrow, (3, 3), (1, 1)) == (1.0, 1.0, 1, "goal")
    assert on_way(narrow, (1, 1), (3, 3)) == (1.0, 1.0, 1, "start")
    assert on_way(narrow, (1, 1), (3, 9)) == (3.0, 6.0, 1, "passage")  # before the start itself
    assert on_way(narrow, (3, 3), (0, 0)) is None


def test_a_way_over_nothing_is_limited_by_the_edge():
    assert on_way("...\n...", (0, 0), (1, 2)) == (0.0, 0.0, 1, "start")
    assert on_way("...\n...\n...", (1, 1), (1, 1)) == (1.0, 1.0, 4, "start")
    assert on_way("..#..", (0, 0), (0, 4)) is None


@settings(max_examples=80)
@given(st.integers(0, 2**32 - 1))
def test_the_width_of_a_way_is_that_at_which_floods_end(seed):
    rng = np.random.default_rng(seed)
    occupancy = np.where(rng.random((9, 13)) < 0.15, 100, 0).astype(np.int8)
    occupancy[rng.random((9, 13)) < 0.05] = -1
    occupancy[4, 6] = 100
    grid = OccupancyGrid(occupancy, RESOLUTION, ORIGIN)
    free = [tuple(cell) for cell in np.argwhere(occupancy == 0).tolist()]
    start, goal = (free[k] for k in rng.integers(len(free), size=2))
    ways = ways_of(grid)
    told = bottleneck_on_way(ways.begun_at(start), goal)
    is_traversable = occupancy == 0
    if told is None:
        assert not flooded(is_traversable, start)[goal]
        return
    distance = np.sqrt(ways.squared.astype(float)) * RESOLUTION
    assert flooded(is_traversable & (distance > told.width / 2 - 1e-6), start)[goal]
    assert not flooded(is_traversable & (distance > told.width / 2 + 1e-6), start)[goal]
    row, col = grid.frame.continuous_rowcol_from_xy([(told.x, told.y)])[0] - 0.5
    if told.at != "passage":
        assert (row, col) == pytest.approx(start if told.at == "start" else goal)
