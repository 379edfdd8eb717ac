"""Transforms against what they must do to points and to the cells of grids."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.errors import ParameterError
from mapdeal.grid.frame import Frame, Transform

METRES = st.floats(-50, 50)
TURNS = st.floats(-7, 7)
TRANSFORMS = st.builds(Transform, METRES, METRES, TURNS)


def by_complex_numbers(transform, x, y):
    """A turn and a shift as a product and a sum of complex numbers."""
    moved = complex(x, y) * complex(math.cos(transform.yaw), math.sin(transform.yaw))
    moved += complex(transform.x, transform.y)
    return [moved.real, moved.imag]


@given(TRANSFORMS, METRES, METRES)
def test_points_are_turned_and_then_shifted(transform, x, y):
    moved = transform.points([[x, y]])
    np.testing.assert_allclose(moved[0], by_complex_numbers(transform, x, y), atol=1e-9)
    np.testing.assert_allclose(transform.inverse().points(moved), [[x, y]], atol=1e-9)


@given(TRANSFORMS, TRANSFORMS, METRES, METRES)
def test_one_transform_after_another(first, second, x, y):
    both = second.after(first).points([[x, y]])
    np.testing.assert_allclose(both, second.points(first.points([[x, y]])), atol=1e-9)


@given(TRANSFORMS, TURNS)
def test_cells_of_a_moved_frame_lie_where_their_centres_are_brought(transform, yaw):
    frame = Frame(3, 5, 0.4, (-2.0, 1.5, yaw))
    cells = [[0, 0], [2, 4], [1, 3]]
    moved = transform.frame(frame).xy_from_rowcol(cells)
    np.testing.assert_allclose(moved, transform.points(frame.xy_from_rowcol(cells)), atol=1e-9)


def test_a_yaw_is_kept_within_half_a_turn():
    assert Transform(yaw=3 * math.pi / 2).yaw == pytest.approx(-math.pi / 2)


def test_no_turn_and_no_shift_leaves_a_frame_as_it_is():
    frame = Frame(3, 5, 0.4, (-2.0, 1.5, 0.3))
    assert Transform().frame(frame) is frame


@pytest.mark.parametrize("name", ["x", "y", "yaw"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -1e13])
def test_numbers_that_are_not_finite_are_refused(name, value):
    with pytest.raises(ParameterError, match=f"{name}: must be a finite number"):
        Transform(**{name: value})
