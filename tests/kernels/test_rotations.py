"""Rotations, against scipy's and against turns around one axis, whose arcs are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mapdeal.kernels.rotations import (
    composed,
    from_yaw,
    inverse_matrices,
    multiplied,
    normalised,
    rotated,
    slerp,
    undone,
)

parts = st.floats(-1, 1, allow_subnormal=False)
axes = (
    st.tuples(parts, parts, parts)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: v / np.linalg.norm(v))
)
quaternions = st.tuples(axes, st.floats(-6, 6)).map(
    lambda turn: Rotation.from_rotvec(turn[0] * turn[1]).as_quat()
)


def some(shape, seed=7):
    rng = np.random.default_rng(seed)
    return normalised(rng.normal(size=(*shape, 4))), rng.normal(size=(*shape, 3))


@given(axes, st.floats(-12, 3.1).map(lambda x: 10**x if x < 0 else x), st.floats(0, 1))
def test_the_arc_is_run_through_at_one_speed(axis, angle, share):
    """Of turns around one axis, however small: the share of the angle."""
    start = Rotation.from_rotvec([0.3, -1.1, 0.7])
    end = start * Rotation.from_rotvec(axis * angle)
    wanted = start * Rotation.from_rotvec(axis * angle * share)
    for sign in (1, -1):  # a quaternion and its negative are one rotation
        found = slerp(start.as_quat()[None], sign * end.as_quat()[None], np.array([share]))[0]
        assert np.linalg.norm(found) == pytest.approx(1, abs=1e-15)
        off = (Rotation.from_quat(found) * wanted.inv()).magnitude()
        assert off < 1e-11


def test_the_shorter_arc_is_taken():
    """From 170 degrees to -170 the way is 20 degrees long, through 180."""
    ends = from_yaw(np.radians([170.0, -170.0]))
    found = slerp(ends[:1], ends[1:], np.array([0.25]))
    yaw = Rotation.from_quat(found[0]).as_euler("zyx", degrees=True)[0]
    assert yaw == pytest.approx(175, abs=1e-9)


def test_half_a_turn_keeps_to_a_rotation():
    found = slerp(from_yaw([0.0]), from_yaw([np.pi]), np.array([0.5]))
    assert abs(Rotation.from_quat(found[0]).magnitude() - np.pi / 2) < 1e-12


@pytest.mark.parametrize("shape", [(), (1,), (5,), (2, 3)])
def test_many_are_done_as_one_is(shape):
    quats, vectors = some(shape)
    others, moves = some(shape, seed=8)
    one, two = Rotation.from_quat(quats.reshape(-1, 4)), Rotation.from_quat(others.reshape(-1, 4))
    flat, flat_moves = vectors.reshape(-1, 3), moves.reshape(-1, 3)

    def same(found, wanted):
        np.testing.assert_allclose(found.reshape(wanted.shape), wanted, atol=1e-14)

    same(rotated(quats, vectors), one.apply(flat))
    same(rotated(undone((vectors, quats))[1], vectors), one.inv().apply(flat))
    made = Rotation.from_quat(multiplied(quats, others).reshape(-1, 4))
    same(made.as_matrix(), (one * two).as_matrix())
    move, turn = composed((moves, quats), (vectors, others))
    same(move, one.apply(flat) + flat_moves)
    same(turn, multiplied(quats, others))
    move, turn = composed(undone((moves, quats)), (moves, quats))
    same(move, np.zeros_like(flat))
    same(turn, np.broadcast_to([0.0, 0.0, 0.0, 1.0], quats.shape).reshape(-1, 4))


@given(quaternions, quaternions, st.tuples(parts, parts, parts))
def test_a_product_turns_by_its_second_first(one, other, vector):
    vector = np.array(vector)
    found = rotated(multiplied(one, other), vector)
    np.testing.assert_allclose(found, rotated(one, rotated(other, vector)), atol=1e-13)


def test_yaws_turn_the_x_axis():
    yaws = np.array([[-3.0, -0.4, 0.0], [0.7, 1.9, 3.1]])
    ahead = rotated(from_yaw(yaws), np.array([1.0, 0.0, 0.0]))
    wanted = np.stack([np.cos(yaws), np.sin(yaws), np.zeros_like(yaws)], axis=-1)
    np.testing.assert_allclose(ahead, wanted, atol=1e-15)


@pytest.mark.parametrize("shape", [(), (1,), (4, 5)])
def test_a_matrix_times_its_inverse_is_one(shape):
    matrices = np.random.default_rng(3).normal(size=(*shape, 3, 3)) + 3 * np.eye(3)
    product = np.einsum("...ij,...jk", matrices, inverse_matrices(matrices))
    assert product == pytest.approx(np.broadcast_to(np.eye(3), product.shape), abs=1e-12)
