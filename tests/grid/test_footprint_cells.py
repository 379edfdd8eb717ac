"""The cells of a footprint in each heading against polygons drawn cell by cell."""

import math

import numpy as np
import pytest
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
    corners=st.sampled_from([None, *SHAPES]), count=st.integers(1, 24),
    resolution=st.sampled_from([0.05, 0.3, 0.0504]),
    yaw=st.sampled_from([0.0, 0.4, -3.0, math.pi / 2]), heading=st.integers(0, 23),
)  # fmt: skip
def test_the_cells_are_those_of_costmap_2d_drawn_one_by_one(
    corners, count, resolution, yaw, heading
):
    frame = Frame(200, 300, resolution, (1.5, -2.0, yaw))
    robot = Footprint.polygon(corners) if corners else Footprint.circle(0.4)
    headings = footprint_spans(robot, frame, count)
    assert len(headings) == count
    k = heading % count
    turn = 2 * math.pi * k / count - yaw
    corners = corners or Footprint.sixteen_gon(0.4).vertices
    assert drawn(headings[k]) == cells_of(corners, turn, resolution)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(4))
def test_ways_on_a_large_map_are_those_of_a_search_in_all_72_headings(seed):
    blocked = np.random.default_rng(seed).random((64, 61)) < 0.004
    blocked[20, :50] = blocked[40, 12:] = True
    blocked[20, 9:17] = blocked[40, 30:38] = False
    corners = [(0.45, 0.16), (0.45, -0.16), (-0.35, -0.16), (-0.35, 0.16)]
    frame = Frame(*blocked.shape, 0.1, (1.5, -2.0, 0.4))
    space = ConfigurationSpace(blocked, footprint_spans(Footprint.polygon(corners), frame, 72))
    turns = [2 * math.pi * k / 72 - 0.4 for k in range(72)]
    covered = [{(y, x) for x, y in cells_of(corners, turn, 0.1)} for turn in turns]
    opened = oracles.open_poses(blocked, covered)
    seeds = [(heading, 9, 9) for heading in range(0, 72, 5)]
    reached = oracles.reached_poses(opened, seeds)
    found = space.reach(seeds, [(9, 9)])
    np.testing.assert_array_equal(space.headings, opened.sum(axis=0))
    np.testing.assert_array_equal(found.reachable, reached.any(axis=0))
    np.testing.assert_array_equal(found.headings[0], reached[:, 9, 9])
    assert reached[:, 21:].any()  # it gets through the first door
