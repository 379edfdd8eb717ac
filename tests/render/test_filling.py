import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.render.filling import fill_discs, fill_polygons, thick_lines
from mapdeal.render.overlay import Brush

HEIGHT, WIDTH = 24, 31
places = st.integers(-8 * 4, 40 * 4).map(lambda quarter: quarter / 4)
points = st.tuples(places, places)


def inside(corners, x, y):
    """Which points are inside; an edge belongs to the shape above it, or right of it."""
    crossings = np.zeros(np.shape(x), int)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if ay != by:
            crossings += ((ay <= y) != (by <= y)) & (ax + (y - ay) * (bx - ax) / (by - ay) <= x)
    return crossings % 2 == 1


@given(st.tuples(points, points, points))
def test_a_polygon_is_the_pixels_whose_centres_are_inside(corners):
    pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
    fill_polygons(pixels, np.array([corners]), 7)
    y, x = np.indices(pixels.shape) + 0.5
    # Beside the edges the rounding of coordinates can tell.
    beside = [inside(np.array(corners), x + shift, y) for shift in (-0.01, 0.01)]
    assert (pixels[beside[0] & beside[1]] == 7).all()
    assert (pixels[~beside[0] & ~beside[1] & ~inside(np.array(corners), x, y)] == 0).all()


@given(st.lists(points, min_size=1, max_size=4), st.integers(0, 40).map(lambda k: k / 4))
def test_a_disc_is_the_pixels_whose_centres_are_near(centres, radius):
    pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
    fill_discs(pixels, np.array(centres), radius, 3)
    rows, cols = np.indices(pixels.shape) + 0.5
    distance = np.min([np.hypot(cols - x, rows - y) for x, y in centres], axis=0)
    assert (pixels[distance < radius - 0.01] == 3).all()
    assert (pixels[distance > radius + 0.01] == 0).all()


def test_triangles_side_by_side_neither_overlap_nor_leave_a_gap():
    corners = np.array([(2.5, 1.5), (20.5, 4.0), (17.5, 19.5), (3.0, 15.5)])
    whole = np.zeros((HEIGHT, WIDTH), np.uint8)
    fill_polygons(whole, corners[np.newaxis], 1)
    parts = [np.zeros_like(whole) for _ in range(2)]
    fill_polygons(parts[0], corners[np.newaxis, [0, 1, 2]], 1)
    fill_polygons(parts[1], corners[np.newaxis, [0, 2, 3]], 1)
    assert np.array_equal(parts[0] + parts[1], whole)


def test_far_away_corners_do_no_harm():
    pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
    fill_discs(pixels, np.array([[1e300, -1e300]]), 5.0, 1)
    fill_polygons(pixels, np.array([[[-1e30, -1e30], [1e30, -1e30], [0.0, 1e30]]]), 2)
    assert (pixels == 2).all()


@pytest.mark.parametrize("thickness", [1, 2, 3, 6])
def test_a_level_line_is_as_thick_as_asked_and_has_no_gaps(thickness):
    pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
    corners = thick_lines(np.array([[3.0, 10.0]]), np.array([[20.0, 10.0]]), thickness)
    fill_polygons(pixels, corners, 1)
    assert (pixels[:, 3:20].sum(axis=0) == thickness).all()
    assert not pixels[:, :3].any()
    assert not pixels[:, 20:].any()
    assert thick_lines(np.zeros((1, 2)), np.zeros((1, 2)), thickness).shape == (0, 4, 2)
    assert thick_lines(np.zeros((1, 2)), np.full((1, 2), 0.1), thickness).shape == (1, 4, 2)


def test_a_line_of_many_points_is_round_where_it_bends():
    pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
    path = np.array([[4.0, 4.0], [20.0, 4.0], [20.0, 18.0]])
    Brush(pixels).polyline(path, 1, thickness=6)
    assert pixels[4, 12] == pixels[12, 20] == 1
    assert pixels[2, 21] == 1  # outside of both lines, within the bend
    assert pixels[1, 22] == 0
    single = np.zeros_like(pixels)
    Brush(single).polyline(path[:1], 1, thickness=6)
    assert not single.any()


def test_an_arrow_is_wide_before_its_tip_and_thin_behind():
    pixels = np.zeros((40, 40), np.uint8)
    Brush(pixels).arrows(
        np.array([[20.0, 20.0]]), np.array([[1.0, 0.0]]), 1, length=30, thickness=2
    )
    widths = pixels.sum(axis=0)
    assert np.flatnonzero(widths)[[0, -1]].tolist() == [5, 33]
    assert (widths[5:23] == 2).all()
    assert widths[23] >= 12
    assert (np.diff(widths[23:34].astype(int)) <= 0).all()


def test_a_dart_points_ahead_and_has_a_notch():
    pixels = np.zeros((60, 60), np.uint8)
    Brush(pixels).dart(np.array([30.0, 30.0]), np.array([0.0, 1.0]), 1, length=30)
    rows = np.flatnonzero(pixels.any(axis=1))
    assert rows[[0, -1]].tolist() == [19, 46]
    assert pixels[21, 30] == 0  # the notch
    assert pixels[25, 30] == pixels[45, 30] == 1
    assert pixels[19].any()
    assert np.array_equal(pixels[:, 30:], pixels[:, 29::-1])
