"""The cells of a footprint in each heading against polygons drawn cell by cell."""

import math

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given
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
    corners=st.sampled_from(SHAPES), count=st.integers(1, 24),
    resolution=st.sampled_from([0.05, 0.3, 0.0504]),
    yaw=st.sampled_from([0.0, 0.4, -3.0, math.pi / 2]), heading=st.integers(0, 23),
)  # fmt: skip
def test_the_cells_are_those_of_costmap_2d_drawn_one_by_one(
    corners, count, resolution, yaw, heading
):
    frame = Frame(200, 300, resolution, (1.5, -2.0, yaw))
    headings = footprint_spans(Footprint.polygon(corners), frame, count)
    assert len(headings) == count
    k = heading % count
    turn = 2 * math.pi * k / count - yaw
    assert drawn(headings[k]) == cells_of(corners, turn, resolution)


def test_a_circle_is_the_polygon_that_nav2_makes_of_it():
    frame = Frame(99, 99, 0.05, (0.0, 0.0, 0.3))
    circle = footprint_spans(Footprint.circle(0.4), frame, 5)
    polygon = footprint_spans(Footprint.sixteen_gon(0.4), frame, 5)
    assert [drawn(spans) for spans in circle] == [drawn(spans) for spans in polygon]


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
