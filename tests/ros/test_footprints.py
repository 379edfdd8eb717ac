"""Polygons of costmap_2d, by hand and by its own rules."""

import math

import numpy as np
import pytest

from mapdeal.ros.robot import (
    FootprintStringError,
    corners_of_string,
    oddities_of,
    padded_corners,
    radii_of,
    sixteen_corners,
)

SQUARE = "[[1, 1], [-1, 1], [-1, -1], [1, -1]]"


def f32(value):
    return float(np.float32(value))


READ = {
    "[[0.3,0.2],[0.3,-.2],[-3e-1,+0.2]]": ((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2)),
    "[[1 2][3\t4]  [5, 6]]": ((1, 2), (3, 4), (5, 6)),
    "[[1-2], [3+4], [5.5.5]]": ((1, -2), (3, 4), (5.5, 0.5)),
    "[[1,\n2], [3, 4], [5.,6e0]]": ((1, 2), (3, 4), (5, 6)),
    ",,[[1,,2],,[3,4],[5,6],],": ((1, 2), (3, 4), (5, 6)),
    "[[1, 2], [3, 4], [5, 1e-60]]": ((1, 2), (3, 4), (5, 0)),
}


@pytest.mark.parametrize("text", READ)
def test_texts_are_read_as_a_stream_of_c_reads_them(text):
    right = tuple((f32(x), f32(y)) for x, y in READ[text])
    assert corners_of_string(text) == right


REFUSED = {
    "": "needs three points",
    "[]": "needs three points",
    "[[1, 2], [3, 4]]": "needs three points or more, has 2",
    "[[1, 2], [3, 4], [5, 6]": "a bracket is not closed",
    "[[1, 2], [3, 4], [5, 6]]]": "more closing than opening",
    "[[[1, 2], [3, 4], [5, 6]]]": "nested deeper than two",
    "[1, 2, 3, 4, 5, 6]": "'1' stands outside",
    "[[1, 2], [3, 4], [5, 6]]\n": "'\\n' stands outside",
    "[[1, 2], [3, 4], [5]]": "pairs of numbers",
    "[[1, 2], [3, 4], [5, 6, 7]]": "pairs of numbers",
    "[[1, 2], [3, 4m], [5, 6]]": "'m' is not a number",
    "[[1, 2], [3, nan], [5, 6]]": "'nan' is not a number",
    "[[1, 2], [3, 1e], [5, 6]]": "'1e' is not a number",
    "[[1, 2], [3, .], [5, 6]]": "'.' is not a number",
    "[[1, 2], [3, 1e39], [5, 6]]": "'1e39' is too large",
    "[[0.3; 0.2], [1; 2], [3; 4]]": "is not a number",
}


@pytest.mark.parametrize("text", REFUSED)
def test_texts_that_costmap_2d_takes_no_footprint_from(text):
    with pytest.raises(FootprintStringError) as caught:
        corners_of_string(text)
    assert REFUSED[text] in str(caught.value)


@pytest.mark.slow
def test_long_texts_take_no_long_time():
    with pytest.raises(FootprintStringError):
        corners_of_string("[[" + "1" * 300_000)
    with pytest.raises(FootprintStringError):
        corners_of_string("[[" + "1 " * 200_000)


def test_padding_moves_each_coordinate_by_its_own_sign():
    padded = padded_corners(((1.0, -2.0), (0.0, 3.0), (-1.0, 0.0)), 0.25)
    assert padded == ((1.25, -2.25), (0.0, 3.25), (-1.25, 0.0))


def test_a_round_robot_has_sixteen_corners():
    corners = sixteen_corners(0.5)
    assert len(corners) == 16
    assert corners[0] == (0.5, 0.0)
    assert radii_of(corners)[0] == pytest.approx(0.5 * math.cos(math.pi / 16), abs=1e-15)
    assert radii_of(corners)[1] == 0.5


def test_radii_are_those_of_edges_and_corners():
    assert radii_of(corners_of_string(SQUARE)) == (1.0, math.sqrt(2))
    # the foot of the perpendicular on each edge lies beyond its end
    assert radii_of(((1.0, 1.0), (2.0, 1.5), (1.5, 2.0)))[0] == pytest.approx(math.sqrt(2))


def test_a_corner_that_stands_twice_changes_nothing():
    once = ((1.0, 1.0), (-1.0, 1.0), (0.0, -1.0))
    assert radii_of((once[0], *once)) == radii_of(once)


def test_oddities_of_outlines():
    assert list(oddities_of(corners_of_string(SQUARE))) == []
    (crossed,) = oddities_of(((1, 1), (-1, -1), (1, -1), (-1, 1)))
    assert "crosses itself (footprint vertex 1" in crossed
    (beside,) = oddities_of(((1, 1), (2, 1), (2, 2)))
    assert "lies outside" in beside


def test_edges_end_at_their_corners():
    # the line through (3, 1) and (1, 1) is 1 m away, but the edge ends before that
    inscribed, circumscribed = radii_of(((3.0, 1.0), (1.0, 1.0), (1.0, 3.0)))
    assert inscribed == pytest.approx(2**0.5, rel=1e-15)
    assert circumscribed == pytest.approx(10**0.5, rel=1e-15)


def test_tabs_within_a_footprint_are_blanks():
    assert corners_of_string("[[1,\t2],\t[3, 4],[5\t6]]") == ((1.0, 2.0), (3.0, 4.0), (5.0, 6.0))
