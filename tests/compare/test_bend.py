"""Bends of maps: against maps that are bent by a known displacement, and numpy's solver."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from compare.buildings import OTHER_WALLS, WALLS, between, drawn, errors
from mapdeal import OccupancyGrid, Transform
from mapdeal.compare.align import bend_between, placed
from mapdeal.compare.score import place_text
from mapdeal.compare.walls import Bend, _solved, moved, walls_of
from strategies import examples

pytestmark = pytest.mark.slow


def bent(grid, amount):
    """A map whose points p of the original are at p + amount sin(pi x / width) along y."""
    height, width = grid.shape
    row, col = np.indices(grid.shape)
    by = amount / grid.resolution * np.sin(math.pi * (col + 0.5) / width)
    source = np.rint(row - by).astype(int)
    inside = (source >= 0) & (source < height)
    values = np.where(inside, np.asarray(grid.occupancy)[np.clip(source, 0, height - 1), col], -1)
    return OccupancyGrid(values.astype(np.int8), grid.resolution, grid.origin)


@examples(20)
@given(st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_systems_are_solved_as_lapack_does(size, seed):
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(3, size, size))
    matrices = roots @ roots.transpose(0, 2, 1) + np.eye(size)
    right = rng.normal(size=(3, size))
    expected = np.linalg.solve(matrices, right[..., None])[..., 0]
    np.testing.assert_allclose(_solved(matrices, right), expected, rtol=1e-8, atol=1e-9)


@examples(20)
@given(st.integers(0, 2**32 - 1))
def test_points_moved_there_and_back_are_where_they_were(seed):
    rng, walls = np.random.default_rng(seed), walls_of(drawn(WALLS, 0.2))
    size = np.array(walls.frame.size_xy)
    bend = Bend(walls.middle_xy, math.hypot(*size) / 2, rng.normal(0, 0.05, (2, 2, 10)))
    poses = np.column_stack([rng.uniform(-3, 3, 2), rng.uniform(-9, 9, (2, 2))])
    points = rng.random((20, 2)) * size
    there = bend.moved(poses, points)
    assert np.hypot(*(there - moved(poses, points)).T).max() > 0.01
    for k in range(2):
        only = Bend(bend.middle_xy, bend.reach, bend.coefficients[k : k + 1])
        back = only.moved_back(poses[k : k + 1], there[k])[0]
        np.testing.assert_allclose(back, points, atol=0.01)


@pytest.mark.parametrize("amount", [0.3, 0.5])
def test_a_bent_building_is_found_and_its_bend_measured(amount):
    first, there = drawn(WALLS, 0.1), Transform(4.0, -2.0, 0.8)
    found = placed(bent(first, amount), drawn(WALLS, 0.1, there))
    assert found.same_place, found.reason
    off, turn = errors(found.transform, between(Transform(), there), first)
    assert off < amount
    assert turn < 3
    # of a sine, what a shift does not undo is some half of it
    assert 0.15 * amount < found.bend < amount


def test_the_bend_between_maps_of_one_frame_and_none_that_makes_another_building_the_same():
    first = drawn(WALLS, 0.1)
    still = bend_between(first, first)
    assert still.metres < 0.02
    assert still.share == still.share_bent == 1
    found = bend_between(bent(first, 0.4), first)
    assert found.metres == pytest.approx(0.4, abs=0.12)
    x = found.point_xy[0]
    assert 0.25 < (x - first.origin[0]) / first.frame.size_xy[0] < 0.75  # the sine's middle
    assert found.share_bent > found.share + 0.2
    assert not placed(drawn(WALLS, 0.2), bent(drawn(OTHER_WALLS, 0.2), 0.3)).same_place


@pytest.mark.parametrize(
    ("point", "part"),
    [((1.6, 0.95), "middle"), ((4, 2.6), "north-east"), ((-4.0, 0.2), "west"), ((0, -3), "south")],
)
def test_where_in_a_map_a_point_is(point, part):
    grid = OccupancyGrid(np.zeros((60, 100), np.int8), 0.1, (-5.0, -3.0, 0.0))
    assert place_text(grid, point) == f"in the {part}, at {point[0]:g},{point[1]:g}"


def corridor(doors, length=40.0, width=2.0, resolution=0.1):
    """A corridor with doors that are recessed by 0.2 m: metres from its west end, and the side."""
    values = np.full((round(width / resolution) + 20, round(length / resolution) + 20), -1, np.int8)
    low, high = 10, 10 + round(width / resolution)
    values[low : high + 1, 10:-10] = 0
    values[[low, high], 10:-10] = 100
    values[low : high + 1, [10, -11]] = 100
    for at, side in doors:
        first = 10 + round(at / resolution)
        wall, step = (low, -1) if side < 0 else (high, 1)
        values[wall, first : first + 9] = values[wall + step, first : first + 9] = 0
        values[wall + 2 * step, first : first + 9] = 100
        values[wall + step, [first - 1, first + 9]] = 100
    return OccupancyGrid(values, resolution)


def test_the_length_of_a_corridor_is_no_evidence():
    rng = np.random.default_rng(2)
    for _ in range(2):
        first, second = (
            corridor(list(zip(rng.uniform(1, 37, 5), rng.choice([-1, 1], 5), strict=True)), length)
            for length in rng.uniform(38, 48, 2)
        )
        found = placed(first, second)
        assert not found.same_place
        assert found.agreement > 0.85  # the walls do agree
    # who says where it is has said that it is the same place
    doors = [(4.0, 1), (9.0, 1), (14.5, -1), (30.0, 1)]
    first, second = corridor(doors), corridor(doors[:3])
    found = placed(first, second, prior=Transform(0.8, 0.2, 0.05))
    assert found.same_place
    assert np.abs(found.transform.pose).max() < 0.1
