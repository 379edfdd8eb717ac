"""The cells of a footprint in each heading against polygons drawn cell by cell."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.footprint_cells import footprint_spans
from mapdeal.grid.frame import Frame

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
