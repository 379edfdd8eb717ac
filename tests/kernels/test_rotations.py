"""Rotations against scipy's, and slerp against turns around a single axis."""

import math
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from mapdeal.kernels import rotations

parts = st.floats(-1, 1, allow_subnormal=False)
axes = st.tuples(parts, parts, parts).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(axes, st.floats(-12, 3.1).map(lambda x: 10**x if x < 0 else x), st.floats(0, 1))
def test_slerp_turns_at_constant_speed(axis, angle, share):
    start, axis = Rotation.from_rotvec([0.3, -1.1, 0.7]), np.array(axis) / np.linalg.norm(axis)
    end = start * Rotation.from_rotvec(axis * angle)
    expected = start * Rotation.from_rotvec(axis * angle * share)
    for sign in (1, -1):  # a quaternion and its negative are one rotation
        found = rotations.slerp(
            start.as_quat()[None], sign * end.as_quat()[None], np.array([share])
        )[0]
        assert np.linalg.norm(found) == pytest.approx(1, abs=1e-15)
        error = (Rotation.from_quat(found) * expected.inv()).magnitude()
        assert error < 1e-11


def test_slerp_over_half_a_turn_is_a_rotation():
    found = rotations.slerp(rotations.from_yaw([0.0]), rotations.from_yaw([np.pi]), np.array([0.5]))
    assert abs(Rotation.from_quat(found[0]).magnitude() - np.pi / 2) < 1e-12


@pytest.mark.parametrize("shape", [(), (1,), (2, 3)])
def test_arrays_of_rotations_equal_single_rotations_of_scipy(shape):
    rng = np.random.default_rng(7)
    quats, second_quats = rotations.normalised(rng.normal(size=(2, *shape, 4)))
    vectors, moves = rng.normal(size=(2, *shape, 3))
    first, second = (Rotation.from_quat(q.reshape(-1, 4)) for q in (quats, second_quats))
    flat, flat_moves = vectors.reshape(-1, 3), moves.reshape(-1, 3)

    def assert_close(found, expected):
        np.testing.assert_allclose(found.reshape(expected.shape), expected, atol=1e-14)

    assert_close(rotations.rotated(quats, vectors), first.apply(flat))
    assert_close(
        rotations.rotated(rotations.undone((vectors, quats))[1], vectors), first.inv().apply(flat)
    )
    product = Rotation.from_quat(rotations.multiplied(quats, second_quats).reshape(-1, 4))
    assert_close(product.as_matrix(), (first * second).as_matrix())
    move, turn = rotations.composed((moves, quats), (vectors, second_quats))
    assert_close(move, first.apply(flat) + flat_moves)
    assert_close(turn, rotations.multiplied(quats, second_quats))
    move, turn = rotations.composed(rotations.undone((moves, quats)), (moves, quats))
    assert_close(move, np.zeros_like(flat))
    assert_close(turn, np.broadcast_to([0.0, 0.0, 0.0, 1.0], quats.shape).reshape(-1, 4))


def test_yaws_turn_the_x_axis():
    yaws = np.array([[-3.0, -0.4, 0.0], [0.7, 1.9, 3.1]])
    ahead = rotations.rotated(rotations.from_yaw(yaws), np.array([1.0, 0.0, 0.0]))
    expected = np.stack([np.cos(yaws), np.sin(yaws), np.zeros_like(yaws)], axis=-1)
    np.testing.assert_allclose(ahead, expected, atol=1e-15)


@pytest.mark.parametrize("shape", [(), (1,), (4, 5)])
def test_a_matrix_times_its_inverse_is_one(shape):
    matrices = np.random.default_rng(3).normal(size=(*shape, 3, 3)) + 3 * np.eye(3)
    product = np.einsum("...ij,...jk", matrices, rotations.inverse_matrices(matrices))
    assert product == pytest.approx(np.broadcast_to(np.eye(3), product.shape), abs=1e-12)


def energy_by_strips(points, angle, width):
    """Sum squared counts of strips; each point counts for the two nearest ones."""
    counts = defaultdict(float)
    for x, y in points - points.mean(axis=0):
        place = (y * math.cos(angle) - x * math.sin(angle)) / width
        lower = math.floor(place)
        counts[lower] += lower + 1 - place
        counts[lower + 1] += place - lower
    return sum(count**2 for count in counts.values())


@given(
    st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=12),
    st.floats(-4, 4),
    st.floats(0.3, 3),
)
def test_the_spectrum_counts_points_in_strips(points, angle, width):
    found = rotations.hough_spectrum(np.array(points), np.array([angle, angle + math.pi]), width)
    assert found[0] == pytest.approx(energy_by_strips(np.array(points), angle, width))
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


@pytest.mark.parametrize("degrees", [0.0, 0.4, -17.8, 44.5, 45.5, -100.0])
def test_the_main_direction_is_that_of_a_turned_building(degrees):
    found = rotations.main_direction(rooms(math.radians(degrees)))
    error = math.degrees(math.remainder(found - math.radians(degrees), math.pi / 2))
    assert abs(error) < (0.1 if degrees else 1e-300)  # a straight map gives exactly 0
    assert abs(found) <= math.pi / 4 + 1e-9


def test_circles_noise_and_nothing_have_no_main_direction():
    rows, cols = np.mgrid[:150, :210]
    circle = abs(np.hypot(rows - 70, cols - 100) - 60) < 1.5
    noise = np.random.default_rng(3).random((150, 210)) < 0.1
    for occupied in (circle, noise, np.zeros((30, 40), bool), np.ones((30, 40), bool)):
        assert rotations.main_direction(occupied) is None


@pytest.mark.parametrize("turns", [(2,), (1, 2, 3), ()])
def test_symmetric_maps_coincide_at_their_quarter_turns(turns):
    rng = np.random.default_rng(3)
    walls = np.zeros((41, 41 if turns == (1, 2, 3) else 57), dtype=bool)
    walls[rng.integers(0, walls.shape[0], 60), rng.integers(0, walls.shape[1], 60)] = True
    for k in turns:
        walls |= np.rot90(walls, k)
    walls[[0, -1]] = walls[:, [0, -1]] = True
    inside = np.pad(~walls, ((5, 0), (0, 9)))  # the centres of map and array differ
    found = rotations.coincidences(np.pad(walls, ((5, 0), (0, 9))), inside, tolerance=1)
    assert [k for k, shares in enumerate(found, 1) if min(shares) > 0.9] == list(turns)
    assert all(found[k - 1] == (1.0, 1.0) for k in turns), found
