import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapdeal import Frame
from mapdeal.grid.resample import obstacles_in, wholly_in


def corners(frame, row, col):
    places = [[row, col], [row, col + 1], [row + 1, col + 1], [row + 1, col]]
    return [tuple(p) for p in frame.xy_from_continuous_rowcol(places).tolist()]


def shared_area(first, second):
    """The area that two convex anticlockwise polygons share: the second clips the first."""
    polygon = first
    for (ax, ay), (bx, by) in zip(second, second[1:] + second[:1], strict=True):
        kept = []
        for (px, py), (qx, qy) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            p = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
            q = (bx - ax) * (qy - ay) - (by - ay) * (qx - ax)
            if p >= 0:
                kept.append((px, py))
            if (p > 0 > q) or (p < 0 < q):
                t = p / (p - q)
                kept.append((px + t * (qx - px), py + t * (qy - py)))
        polygon = kept
    ends = polygon[1:] + polygon[:1]
    return sum(x * v - u * y for (x, y), (u, v) in zip(polygon, ends, strict=True)) / 2


YAWS = st.one_of(st.sampled_from([0.0, math.pi / 2, -math.pi, math.pi / 4]), st.floats(-4, 4))
RESOLUTIONS = st.sampled_from([0.05, 0.1, 0.025, 0.07, 0.3])


@given(
    shapes=st.tuples(*[st.integers(1, 6)] * 4), resolutions=st.tuples(RESOLUTIONS, RESOLUTIONS),
    yaws=st.tuples(YAWS, YAWS), shift=st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)),
    seed=st.integers(0, 999), far=st.sampled_from([0.0, 5e6]),
)  # fmt: skip
@settings(deadline=None)
def test_a_cell_is_set_where_it_overlaps_an_obstacle(shapes, resolutions, yaws, shift, seed, far):
    frame = Frame(*shapes[:2], resolutions[0], (far - 1.5, 2.0, yaws[0]))
    source = Frame(*shapes[2:], resolutions[1], (far - 1.5 + shift[0], 2.0 + shift[1], yaws[1]))
    obstacles = np.random.default_rng(seed).random(source.shape) < 0.4
    found = obstacles_in(frame, obstacles, source)
    assert found.shape == frame.shape
    taken = [corners(source, *cell) for cell in np.argwhere(obstacles)]
    cell_area = min(resolutions) ** 2
    for cell in np.ndindex(frame.shape):
        area = max((shared_area(corners(frame, *cell), one) for one in taken), default=0.0)
        if area > 1e-5 * cell_area:
            assert found[cell]
        if found[cell] and not far:
            assert area > 1e-14 * cell_area


@pytest.mark.parametrize("far", [0.0, 3e5])
def test_the_same_lattice_is_copied(far):
    obstacles = np.random.default_rng(1).random((9, 14)) < 0.3
    source = Frame(9, 14, 0.05, (far + 0.1, -2.0, 0.3))
    found = obstacles_in(source.window(-2, 5, 8, 20), obstacles, source)
    expected = np.zeros((8, 20), bool)
    expected[2:, :9] = obstacles[:6, 5:]
    np.testing.assert_array_equal(found, expected)


def test_cells_that_only_touch_do_not_spread():
    """A wall of 0.1 m cells on lattices of 0.05 m and 0.2 m through the same corners."""
    wall = np.zeros((4, 4), bool)
    wall[:, 2] = True
    coarse = Frame(4, 4, 0.1, (-0.3, 0.7, 0.0))
    fine = obstacles_in(Frame(8, 8, 0.05, (-0.3, 0.7, 0.0)), wall, coarse)
    assert np.flatnonzero(fine.any(axis=0)).tolist() == [4, 5]
    assert fine[:, 4:6].all()
    coarser = obstacles_in(Frame(2, 2, 0.2, (-0.3, 0.7, 0.0)), wall, coarse)
    assert coarser.tolist() == [[False, True], [False, True]]


def test_a_quarter_turn_of_the_same_lattice():
    obstacles = np.array([[True, False, False], [False, False, True]])
    source = Frame(2, 3, 0.5, (1.0, 0.0, math.pi / 2))  # its columns go north, its rows west
    found = obstacles_in(Frame(3, 2, 0.5, (0.0, 0.0, 0.0)), obstacles, source)
    assert found.tolist() == [[False, True], [False, False], [True, False]]


def test_a_wall_stays_closed_when_it_is_turned():
    """A diagonal wall, whose cells touch at corners alone, keeps a path over 4 neighbours out."""
    source = Frame(40, 40, 0.05, (-1.0, -1.0, math.pi / 4))
    found = obstacles_in(Frame(60, 60, 0.05, (-1.5, -1.0, 0.0)), np.eye(40, dtype=bool), source)
    column = np.flatnonzero(found.any(axis=0))
    rows = np.flatnonzero(found.any(axis=1))
    assert len(column) <= 4  # the wall points north
    assert np.all(np.diff(rows) == 1)


@given(
    shapes=st.tuples(*[st.integers(1, 6)] * 4), resolutions=st.tuples(RESOLUTIONS, RESOLUTIONS),
    yaws=st.tuples(YAWS, YAWS), shift=st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)),
    seed=st.integers(0, 999),
)  # fmt: skip
@settings(deadline=None)
def test_a_cell_lies_wholly_in_those_that_take_all_of_its_area(
    shapes, resolutions, yaws, shift, seed
):
    frame = Frame(*shapes[:2], resolutions[0], (-1.5, 2.0, yaws[0]))
    source = Frame(*shapes[2:], resolutions[1], (-1.5 + shift[0], 2.0 + shift[1], yaws[1]))
    cells = np.random.default_rng(seed).random(source.shape) < 0.8
    found = wholly_in(frame, cells, source)
    taken = [corners(source, *cell) for cell in np.argwhere(cells)]
    for cell in np.ndindex(frame.shape):
        area = sum(shared_area(corners(frame, *cell), one) for one in taken)
        missing = resolutions[0] ** 2 - area
        if found[cell]:
            assert missing < 1e-4 * resolutions[0] ** 2
        else:
            assert missing > 1e-14 * resolutions[0] ** 2


def test_cells_of_the_same_lattice_are_wholly_in_what_they_are():
    known = np.random.default_rng(1).random((9, 14)) < 0.3
    source = Frame(9, 14, 0.05, (0.1, -2.0, 0.3))
    found = wholly_in(source.window(-2, 5, 8, 20), known, source)
    expected = np.zeros((8, 20), bool)
    expected[2:, :9] = known[:6, 5:]
    np.testing.assert_array_equal(found, expected)


def test_cells_of_many_bands_are_looked_at_once():
    """A fine grid of more cells than are looked at together, by coarse cells."""
    fine = Frame(700, 900, 0.01, (0.005, -0.005, 0.2))
    obstacles = np.zeros(fine.shape, bool)
    places = [(0, 0), (699, 899), (333, 7), (72, 899)]
    for row, col in places:
        obstacles[row, col] = True
    coarse = Frame(40, 50, 0.3, (-2.0, -1.0, 0.0))
    found = obstacles_in(coarse, obstacles, fine)
    for row, col in places:
        middle = fine.xy_from_rowcol([[row, col]])
        assert found[tuple(coarse.unbounded_rowcol_from_xy(middle)[0])]
    assert found.sum() <= 4 * len(places)
