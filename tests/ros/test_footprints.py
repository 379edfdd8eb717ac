"""Footprints against values computed by hand and the rules of costmap_2d."""

import numpy as np
import pytest

from mapdeal.ros import robot
from mapdeal.ros.robot import FootprintStringError, corners_of_string, radii_of


def f32(value):
    return float(np.float32(value))


READ = {
    "[[0.3,0.2],[0.3,-.2],[-3e-1,+0.2]]": ((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2)),
    "[[1 2][3\t4]  [5, 6]]": ((1, 2), (3, 4), (5, 6)),
    "[[1,\t2],\t[3, 4],[5\t6]]": ((1, 2), (3, 4), (5, 6)),
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
def test_texts_without_a_footprint_are_refused(text):
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
    padded = robot.padded_corners(((1.0, -2.0), (0.0, 3.0), (-1.0, 0.0)), 0.25)
    assert padded == ((1.25, -2.25), (0.0, 3.25), (-1.25, 0.0))


@pytest.mark.parametrize(("corners", "inscribed", "circumscribed"), [
    (((1, 1), (-1, 1), (-1, -1), (1, -1)), 1, 2**0.5),
    (((1, 1), (1, 1), (-1, 1), (-1, -1), (1, -1)), 1, 2**0.5),
    # the lines of two edges are 1 m away, but the edges end before that
    (((3, 1), (1, 1), (1, 3)), 2**0.5, 10**0.5),
    (((1, 1), (2, 1.5), (1.5, 2)), 2**0.5, 2.5),
])  # fmt: skip
def test_radii_are_those_of_edges_and_corners(corners, inscribed, circumscribed):
    found = radii_of(tuple((float(x), float(y)) for x, y in corners))
    assert found == pytest.approx((inscribed, circumscribed), rel=1e-15)
