"""Directions of walls against walls that were drawn in a known direction."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.kernels.rotations import edge_points, hough_spectrum, main_direction


def counted_strip_by_strip(points, angle, width):
    """The energy of one direction: every point goes to the two nearest middles of strips."""
    points = points - points.mean(axis=0)
    counts = {}
    for x, y in points:
        place = (y * math.cos(angle) - x * math.sin(angle)) / width
        lower = math.floor(place)
        counts[lower] = counts.get(lower, 0) + lower + 1 - place
        counts[lower + 1] = counts.get(lower + 1, 0) + place - lower
    return sum(count**2 for count in counts.values())


@given(
    st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=12),
    st.floats(-4, 4),
    st.floats(0.3, 3),
)
def test_the_spectrum_counts_points_in_strips(points, angle, width):
    found = hough_spectrum(np.array(points), np.array([angle, angle + math.pi]), width)
    assert found[0] == pytest.approx(counted_strip_by_strip(np.array(points), angle, width))
    assert found[1] == pytest.approx(found[0])


def rooms(turn, shape=(260, 340)):
    """A building of four rooms with open doors, its walls two cells thick, turned anticlockwise."""
    rows, cols = np.mgrid[: shape[0], : shape[1]].reshape(2, -1).astype(float)
    x, y = cols - shape[1] / 2, rows - shape[0] / 2
    x, y = x * math.cos(turn) + y * math.sin(turn), y * math.cos(turn) - x * math.sin(turn)
    inside = (abs(x) < 101) & (abs(y) < 61)
    outline = inside & ~((abs(x) < 99) & (abs(y) < 59))
    across = inside & (abs(y - 7.3) < 1) & ((abs(x) < 30) | (abs(x) > 55))
    along = inside & (abs(x + 21.7) < 1) & (abs(y) > 9)
    return (outline | across | along).reshape(shape)


@pytest.mark.parametrize("degrees", [0.4, 3.3, -17.8, 31.2, 44.5, 45.5, 90.0, -100.0])
def test_the_main_direction_is_that_of_a_turned_building(degrees):
    found = main_direction(rooms(math.radians(degrees)))
    wrong = math.degrees(math.remainder(found - math.radians(degrees), math.pi / 2))
    assert abs(wrong) < 0.1
    assert abs(found) <= math.pi / 4 + 1e-9


def test_a_building_that_is_straight_is_not_to_be_turned_at_all():
    assert main_direction(rooms(0.0)) == 0.0


def test_circles_noise_and_nothing_have_no_main_direction():
    rows, cols = np.mgrid[:150, :210]
    circle = abs(np.hypot(rows - 70, cols - 100) - 60) < 1.5
    noise = np.random.default_rng(3).random((150, 210)) < 0.1
    for occupied in (circle, noise, np.zeros((30, 40), bool), np.ones((30, 40), bool)):
        assert main_direction(occupied) is None


def test_edge_points_are_centres_of_obstacle_cells_beside_others():
    occupied = np.array([[0, 0, 0, 0, 0], [0, 1, 1, 1, 1], [0, 1, 1, 1, 1], [0, 1, 1, 1, 1]], bool)
    points = {tuple(point) for point in edge_points(occupied).tolist()}
    assert points == {(1.5, 1.5), (2.5, 1.5), (3.5, 1.5), (4.5, 1.5), (1.5, 2.5), (1.5, 3.5)}
