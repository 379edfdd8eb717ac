"""The cells of a footprint in each heading against polygons drawn cell by cell."""

import math

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st

import oracles
from mapdeal.grid.footprint import Footprint, footprint_spans
from mapdeal.grid.frame import Frame
from mapdeal.kernels.paths import ConfigurationSpace

RECTANGLE = ((0.45, 0.225), (0.45, -0.225), (-0.45, -0.225), (-0.45, 0.225))
SHAPES = [
    RECTANGLE,
    ((0.5, 0.3), (-0.2, 0.25), (0.0, 0.0), (-0.2, -0.25), (0.5, -0.3)),  # concave
    ((0.9, 0.3), (0.4, 0.25), (0.7, -0.3)),  # the centre lies outside
    ((0.01, 0.02), (0.01, -0.02), (-0.01, 0.0)),  # smaller than a cell
    ((0.0, 0.8), (0.0, -0.7), (0.001, 0.0)),  # a line
]


def drawn(spans):
    """The cells (x, y) of runs, which must not overlap."""
    cells = [
        (col, row)
        for row, start, stop in zip(*(column.tolist() for column in spans), strict=True)
        for col in range(start, stop)
    ]
    assert len(cells) == len(set(cells))
    return set(cells)


def cells_of(corners, turn, resolution):
    """The cells (x, y) of a polygon around the middle of cell (0, 0), one by one."""
    cos, sin = math.cos(turn), math.sin(turn)
    cells = [
        (
            math.floor(0.5 + (x * cos - y * sin) / resolution + 1e-9),
            math.floor(0.5 + (x * sin + y * cos) / resolution + 1e-9),
        )
        for x, y in corners
    ]
    shift = 22
    ring = [(x + shift, y + shift) for x, y in cells]
    return {(x - shift, y - shift) for x, y in oracles.ring_fill([ring], 2 * shift, 2 * shift)}


@pytest.mark.usefixtures("mapdeal_warnings")
@given(
    corners=st.sampled_from(SHAPES),
    count=st.integers(1, 24),
    resolution=st.sampled_from([0.05, 0.3, 0.0504]),
    yaw=st.sampled_from([0.0, 0.4, -3.0, math.pi / 2]),
    heading=st.integers(0, 23),
)
def test_the_cells_are_those_of_costmap_2d_drawn_one_by_one(
    corners, count, resolution, yaw, heading
):
    frame = Frame(200, 300, resolution, (1.5, -2.0, yaw))
    headings = footprint_spans(Footprint.polygon(corners), frame, count)
    assert len(headings) == count
    k = heading % count
    turn = 2 * math.pi * k / count - yaw
    assert drawn(headings[k]) == cells_of(corners, turn, resolution)


def test_corners_between_two_cells_are_in_the_upper_one_whatever_the_rounding():
    # 0.225 m are 4.5 cells of 0.05 m, which in floats are a little less at some of the turns
    frame = Frame(99, 99, 0.05)
    along, across, back, _ = footprint_spans(Footprint.polygon(RECTANGLE), frame, 4)
    assert drawn(along) == {(x, y) for x in range(-9, 10) for y in range(-4, 6)}
    assert drawn(across) == {(y, x) for x in range(-9, 10) for y in range(-4, 6)}
    assert drawn(back) == drawn(along)


def test_a_circle_is_the_polygon_that_nav2_makes_of_it():
    frame = Frame(99, 99, 0.05, (0.0, 0.0, 0.3))
    circle = footprint_spans(Footprint.circle(0.4), frame, 5)
    polygon = footprint_spans(Footprint.sixteen_gon(0.4), frame, 5)
    assert [drawn(spans) for spans in circle] == [drawn(spans) for spans in polygon]


@pytest.mark.parametrize("resolution", [0.01, 1e-9, 1e-300])
def test_of_a_footprint_larger_than_the_grid_there_are_corners_alone(resolution):
    frame = Frame(19, 12, resolution)
    for spans in footprint_spans(Footprint.polygon(RECTANGLE), frame, 8):
        assert len(spans.rows) == 4
        assert (
            spans.rows.max() - spans.rows.min() >= 19 or max(spans.stops) - min(spans.starts) > 12
        )


ACROSS = np.arange(-45, 46)
X, Y = np.meshgrid(ACROSS, ACROSS)
SQUARES = shapely.box(X - 0.5, Y - 0.5, X + 0.5, Y + 0.5)


def touched(polygon):
    """Of the cells around (0, 0), those whose squares a polygon touches."""
    shapely.prepare(polygon)
    return shapely.intersects(polygon, SQUARES)


def turned(corners, turn, resolution):
    """The polygon in cells, turned exactly."""
    polygon = shapely.Polygon(np.array(corners) / resolution)
    return shapely.affinity.rotate(polygon, turn, origin=(0, 0), use_radians=True)


@pytest.mark.parametrize(
    ("length", "width", "resolution", "yaw"),
    [(0.9, 0.45, 0.05, 0.0), (0.83, 0.41, 0.0504, 0.1), (1.5, 1.1, 0.05, -0.4)],
)
def test_a_rectangle_in_72_headings_is_the_exact_one_but_for_a_cell(length, width, resolution, yaw):
    """Corners move by up to half a cell, and lines by another; cells are squares."""
    corners = [(sx * length / 2, sy * width / 2) for sx, sy in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    frame = Frame(500, 400, resolution, (1.5, -2.0, yaw))
    for k, spans in enumerate(footprint_spans(Footprint.polygon(corners), frame, 72)):
        cells = np.zeros(X.shape, dtype=bool)
        for col, row in drawn(spans):
            cells[row + 45, col + 45] = True
        exact = turned(corners, 2 * math.pi * k / 72 - yaw, resolution)
        assert not (cells & ~touched(exact.buffer(1, join_style="mitre"))).any()
        assert not (touched(exact.buffer(-1, join_style="mitre")) & ~cells).any()


@pytest.mark.slow
@pytest.mark.parametrize("every", [14, pytest.param(1, marks=pytest.mark.thorough)])
def test_poses_are_open_where_exact_geometry_is_clear_but_for_a_cell(every):
    rng = np.random.default_rng(7)
    blocked = rng.random((40, 51)) < 0.003
    frame = Frame(*blocked.shape, 0.05, (1.5, -2.0, 0.4))
    space = ConfigurationSpace(blocked, footprint_spans(Footprint.polygon(RECTANGLE), frame, 72))
    rows, cols = np.nonzero(np.pad(blocked, 1, constant_values=True))
    obstacles = shapely.union_all(shapely.box(cols - 1.5, rows - 1.5, cols - 0.5, rows - 0.5))
    shapely.prepare(obstacles)
    opened = np.array([[space.open_headings(*at) for at in row] for row in _cells_of(blocked)])
    differing = 0
    for k in range(0, 72, every):
        exact = turned(RECTANGLE, 2 * math.pi * k / 72 - 0.4, 0.05)
        clear = [
            ~shapely.intersects(obstacles, _at_all(exact.buffer(by, join_style="mitre"), blocked))
            for by in (1, 0, -1)
        ]
        assert not (clear[0] & ~opened[:, :, k]).any()
        assert not (opened[:, :, k] & ~clear[2]).any()
        assert clear[0].any()
        assert not clear[2].all()
        differing += int((clear[1] != opened[:, :, k]).sum())
    assert differing > 0  # so that the cell more or less is not for nothing


def _cells_of(grid):
    return [[(row, col) for col in range(grid.shape[1])] for row in range(grid.shape[0])]


def _at_all(polygon, grid):
    """The polygon around the middle of each cell."""
    return np.array(
        [
            [shapely.affinity.translate(polygon, col, row) for row, col in at]
            for at in _cells_of(grid)
        ]
    )


LENGTHWISE, CROSSWISE, BACKWARDS = 4, 22, 40


def two_rooms(corridor):
    """Rooms of 1.5 m x 1.5 m and a corridor between, so many cells wide, 2 m long."""
    free = np.zeros((34, 104), dtype=bool)
    free[2:32, 2:32] = free[2:32, 72:102] = True
    low = 17 - corridor // 2
    free[low : low + corridor, 32:72] = True
    # yaw of 20 degrees, four headings of 72
    frame = Frame(*free.shape, 0.05, (1.5, -2.0, math.radians(20)))
    robot = Footprint.polygon(RECTANGLE)
    return free, ConfigurationSpace(~free, footprint_spans(robot, frame, 72))


@pytest.mark.parametrize(
    ("corridor", "is_passed"), [(9, False), (10, True), (12, True), (17, True)]
)
def test_a_robot_passes_lengthwise_where_it_cannot_turn(corridor, is_passed):
    """0.9 m x 0.45 m covers 10 cells across; a corridor of 0.6 m has 12."""
    _, space = two_rooms(corridor)
    room, middle, other = (17, 17), (16, 52), (17, 87)
    assert space.open_headings(*room).all()
    opened = space.open_headings(*middle)
    assert opened[LENGTHWISE] == opened[BACKWARDS] == is_passed
    assert not opened[CROSSWISE]
    assert space.headings[middle] == opened.sum() < 36
    found = space.reach([(CROSSWISE, *room)], [middle, other])
    assert found.reachable[other] == found.reachable[middle] == is_passed
    assert found.headings[1].all() == found.headings[1].any() == is_passed
    np.testing.assert_array_equal(found.headings[0], opened)  # it turned before it went in


def test_a_robot_that_starts_in_a_corridor_cannot_turn_there():
    free, space = two_rooms(12)
    closed = ~free
    closed[:, [33, 70]] = True  # shut behind it, and in front
    frame = Frame(*free.shape, 0.05, (1.5, -2.0, math.radians(20)))
    shut = ConfigurationSpace(closed, footprint_spans(Footprint.polygon(RECTANGLE), frame, 72))
    middle = (16, 52)
    there = shut.reach([(LENGTHWISE, *middle)], [middle]).headings[0]
    back = shut.reach([(BACKWARDS, *middle)], [middle]).headings[0]
    assert there[LENGTHWISE]
    assert not there[BACKWARDS]
    assert not (there & back).any()
    np.testing.assert_array_equal(there | back, space.open_headings(*middle))


@st.composite
def robots_on_maps(draw):
    """A small map, a footprint of any form, headings, and poses to start from."""
    height, width = draw(st.integers(1, 20)), draw(st.integers(1, 28))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    blocked = rng.random((height, width)) < draw(st.sampled_from([0.0, 0.02, 0.1]))
    corners = draw(st.sampled_from(SHAPES))
    count = draw(st.integers(4, 24))
    yaw = draw(st.floats(-3.2, 3.2))
    seeds = [
        (int(rng.integers(count)), int(rng.integers(height)), int(rng.integers(width)))
        for _ in range(draw(st.integers(1, 5)))
    ]
    return blocked, corners, count, yaw, draw(st.sampled_from([0.1, 0.13, 0.3])), seeds


@pytest.mark.slow
@pytest.mark.usefixtures("mapdeal_warnings")
@settings(max_examples=40)
@given(robots_on_maps())
def test_ways_of_a_robot_are_those_of_a_search_with_polygons_drawn_cell_by_cell(case):
    assert_ways_are_those_of_a_search(*case)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(4))
def test_ways_on_a_large_map_are_those_of_a_search_in_all_72_headings(seed):
    rng = np.random.default_rng(seed)
    blocked = rng.random((64, 61)) < 0.004
    blocked[20, :50] = blocked[40, 12:] = True
    blocked[20, 9:17] = blocked[40, 30:38] = False
    long = [(0.45, 0.16), (0.45, -0.16), (-0.35, -0.16), (-0.35, 0.16)]
    seeds = [(heading, 9, 9) for heading in range(0, 72, 5)]
    reached = assert_ways_are_those_of_a_search(blocked, long, 72, 0.4, 0.1, seeds)
    assert reached[:, 21:].any()  # it gets through the first door


def assert_ways_are_those_of_a_search(blocked, corners, count, yaw, resolution, seeds):
    frame = Frame(*blocked.shape, resolution, (1.5, -2.0, yaw))
    space = ConfigurationSpace(blocked, footprint_spans(Footprint.polygon(corners), frame, count))
    turns = [2 * math.pi * k / count - yaw for k in range(count)]
    covered = [{(y, x) for x, y in cells_of(corners, turn, resolution)} for turn in turns]
    opened = oracles.open_poses(blocked, covered)
    reached = oracles.reached_poses(opened, seeds)
    cells = [(row, col) for _, row, col in seeds]
    found = space.reach(seeds, cells)
    np.testing.assert_array_equal(space.headings, opened.sum(axis=0))
    np.testing.assert_array_equal(found.reachable, reached.any(axis=0))
    for headings, (row, col) in zip(found.headings, cells, strict=True):
        np.testing.assert_array_equal(headings, reached[:, row, col])
    return reached
