"""Shapes on pixels: whole pixels, so what is near an edge may fall to either side."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from mapdeal.pictures.overlay import Brush

HEIGHT, WIDTH = 24, 31
places = st.integers(-8 * 4, 40 * 4).map(lambda quarter: quarter / 4)
points = st.tuples(places, places)


def to_segment(start, end, x, y):
    """Distances of points to a segment."""
    start, along = np.array(start), np.subtract(end, start)
    part = ((x - start[0]) * along[0] + (y - start[1]) * along[1]) / max((along**2).sum(), 1e-12)
    part = np.clip(part, 0, 1)
    return np.hypot(x - start[0] - part * along[0], y - start[1] - part * along[1])


@given(st.lists(points, min_size=2, max_size=4), st.integers(1, 6))
def test_a_line_is_the_pixels_that_are_near_it(path, thickness):
    pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
    Brush(pixels).polyline(np.array(path), 7, thickness=thickness)
    y, x = np.indices(pixels.shape) + 0.5
    distance = np.min([to_segment(*ends, x, y) for ends in pairwise(path)], 0)
    assert set(np.unique(pixels)) <= {0, 7}
    assert (pixels[distance > thickness / 2 + 1.5] == 0).all()
    assert (pixels[distance < thickness / 2 - 1.75] == 7).all()


@given(points, st.integers(8, 40).map(lambda k: k / 4))
def test_a_disc_is_the_pixels_whose_centres_are_near(centre, radius):
    pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
    Brush(pixels).dot(np.array(centre), 3, radius=radius)
    rows, cols = np.indices(pixels.shape) + 0.5
    distance = np.hypot(cols - centre[0], rows - centre[1])
    assert (pixels[distance < radius - 1.1] == 3).all()
    assert (pixels[distance > radius + 1.1] == 0).all()


def test_far_away_places_do_no_harm():
    pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
    brush = Brush(pixels)
    brush.dot(np.array([1e300, -1e300]), 1, radius=5.0)
    assert not pixels.any()
    brush.polyline(np.array([[-1e30, 12.5], [1e30, 12.5]]), 2, thickness=3)
    assert (pixels[11:14] == 2).all()
    brush.segments(np.empty((0, 2)), np.empty((0, 2)), 3, thickness=2)
    assert not (pixels == 3).any()


def test_a_route_over_a_large_picture_is_drawn_part_by_part(monkeypatch):
    path = np.array([60, 40]) + np.random.default_rng(2).normal(size=(300, 2)).cumsum(axis=0)
    whole, parts = np.zeros((2, 90, 120), np.uint8)
    Brush(whole).polyline(path, 5, thickness=4)
    sizes = []
    monkeypatch.setattr("mapdeal.pictures.overlay._MOST_PIXELS", 400)
    fromarray = Image.fromarray
    monkeypatch.setattr(Image, "fromarray", lambda a: (sizes.append(a.size), fromarray(a))[1])
    Brush(parts).polyline(path, 5, thickness=4)
    assert whole.any()
    assert np.array_equal(parts, whole)
    assert max(sizes) <= 400
    Brush(parts).polyline(np.array([[2.0, 2.0], [110.0, 80.0]]), 6, thickness=4)  # in one piece
    assert (parts == 6).any()
