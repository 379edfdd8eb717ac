"""Transforms over time, against scipy's rotations and what the made bags hold."""

import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from mapdeal import MalformedInputError
from mapdeal.kernels.rotations import normalised
from mapdeal.mapping.evidence import beams_in_plane, stances
from mapdeal.mapping.transforms import TransformTree

T0, MS = 1_700_000_000_123_456_789, 1_000_000
numbers = st.floats(-10, 10, allow_subnormal=False)
quaternions = (
    st.tuples(*[st.floats(-1, 1, allow_subnormal=False)] * 4)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: normalised(np.array(q)))
)
moves = st.tuples(numbers, numbers, numbers)


def matrix(move, quaternion):
    made = np.eye(4)
    made[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    made[:3, 3] = move
    return made


@pytest.mark.slow
@given(data=st.data(), lengths=st.lists(st.integers(1, 4), min_size=2, max_size=3))
def test_each_transform_of_a_chain_is_interpolated_alone(data, lengths):
    """Chains of several branches, edges upside down: the product of matrices, one by one."""
    tree, known = TransformTree(), {}
    for name, length in zip("abc", lengths, strict=False):
        frames = ["root", *(f"{name}{k}" for k in range(length))]
        for parent, child in pairwise(frames):
            is_static = data.draw(st.booleans())
            times = (
                [0]
                if is_static
                else sorted(data.draw(st.sets(st.integers(0, 1000), min_size=1, max_size=4)))
            )
            samples = [(t, data.draw(moves), data.draw(quaternions)) for t in times]
            for t, move, quaternion in data.draw(st.permutations(samples)):
                tree.add(f"/{parent}", child, T0 + t * MS, move, quaternion, is_static=is_static)
            known[child] = parent, samples, is_static
    asked = [data.draw(st.integers(-10, 1010)) for _ in range(4)]
    one, other = f"a{lengths[0] - 1}", f"b{lengths[1] - 1}"
    found = tree.lookup(one, other, np.array(asked) * MS + T0)

    def above(frame, time):
        whole = np.eye(4)
        while frame != "root":
            parent, samples, is_static = known[frame]
            step = at(samples, time) if not is_static else matrix(*samples[-1][1:])
            if step is None:
                return None
            whole = step @ whole
            frame = parent
        return whole

    for k, time in enumerate(asked):
        to_one, to_other = above(one, time), above(other, time)
        assert found.known[k] == (to_one is not None and to_other is not None)
        if found.known[k]:
            wanted = np.linalg.inv(to_one) @ to_other
            made = matrix(found.translations[k], found.quaternions[k])
            np.testing.assert_allclose(made, wanted, atol=1e-6)
        else:
            assert np.isnan(found.translations[k]).all()


def at(samples, time):
    """Return the matrix of one transform at a time: between the samples around it."""
    times = [t for t, _, _ in samples]
    if not times[0] <= time <= times[-1]:
        return None
    for (t, move, turn), (u, other, back) in pairwise(samples):
        if t <= time <= u:
            share = (time - t) / (u - t)
            middle = np.array(move) + share * (np.array(other) - np.array(move))
            if abs(turn @ back) > 1 - 1e-12:
                return matrix(middle, turn)
            rotation = Slerp([0, 1], Rotation.from_quat([turn, back]))(share)
            return matrix(middle, rotation.as_quat())
    return matrix(*samples[0][1:])


def test_times_of_this_century_keep_their_nanoseconds():
    tree = TransformTree()
    for after, x in ((0, 0.0), (100, 1.0)):
        tree.add("a", "b", T0 + after, (x, 0, 0), (0, 0, 0, 1), is_static=False)
    found = tree.lookup("a", "b", T0 + np.arange(0, 101, 10))
    np.testing.assert_allclose(found.translations[:, 0], np.arange(11) / 10, atol=1e-12)


def test_the_last_of_two_at_one_time_counts_and_a_static_one_replaces_what_was():
    tree = TransformTree()
    for x in (1.0, 2.0):
        tree.add("a", "b", 5, (x, 0, 0), (0, 0, 0, 1), is_static=False)
        tree.add("b", "c", 5, (0, x, 0), (0, 0, 0, 1), is_static=True)
    found = tree.lookup("a", "c", np.array([5]))
    assert found.translations.tolist() == [[2.0, 2.0, 0.0]]
    assert [(e.parent, e.child, e.count, e.is_static) for e in tree.edges()] == [
        ("a", "b", 2, False), ("b", "c", 1, True)
    ]  # fmt: skip


@pytest.mark.parametrize("place", [0, 2, 4])
@pytest.mark.parametrize("moving", [1, 4])
def test_what_comes_static_and_moving_is_what_it_comes_as_most_often(place, moving):
    """Whenever the static one comes, none of the others is lost."""
    tree = TransformTree()
    for k in range(moving + 1):
        if k == min(place, moving):
            tree.add("a", "b", 0, (9, 0, 0), (0, 0, 0, 1), is_static=True)
        if k < moving:
            tree.add("a", "b", T0 + k * MS, (k, 0, 0), (0, 0, 0, 1), is_static=False)
    is_static = moving == 1
    assert [(e.count, e.is_static) for e in tree.edges()] == [(moving, is_static)]
    assert tree.of_both_kinds == [("a", "b")]
    found = tree.lookup("a", "b", T0 + MS * np.array([-5, 0, moving - 1]))
    wanted = [9, 9, 9] if is_static else [np.nan, 0, moving - 1]
    np.testing.assert_array_equal(found.translations[:, 0], wanted)


@given(
    st.lists(st.tuples(st.integers(-3, 3), numbers), min_size=1),
    st.lists(st.tuples(st.integers(-3, 3), numbers)),
)
def test_samples_may_come_in_any_order_and_after_a_look_at_those_before(before, after):
    tree, known = TransformTree(), {}
    for some in (before, after):
        for time, x in some:
            tree.add("a", "b", T0 + time * MS, (x, 0, 0), (0, 0, 0, 1), is_static=False)
            known[time] = x
        found = tree.lookup("a", "b", T0 + MS * np.array(sorted(known)))
        assert found.translations[:, 0].tolist() == [known[time] for time in sorted(known)]
    (edge,) = tree.edges()
    assert (edge.count, edge.first, edge.last) == (
        len(before) + len(after), T0 + MS * min(known), T0 + MS * max(known)
    )  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("is_mixed", [False, True])
def test_samples_are_kept_once(is_mixed):
    """72 bytes each and some slack, while they are read, sorted and asked for."""
    count = 50_000
    tree = TransformTree()
    tree.add("a", "b", 0, (0, 0, 0), (0, 0, 0, 1), is_static=False)
    tracemalloc.start()
    try:
        for k in range(count):
            time = k ^ 1 if is_mixed else k
            tree.add("a", "b", time, (1, 2, 3), (0, 0, 0, 1), is_static=False)
        tree.edges()
        tree.lookup("a", "b", np.arange(10))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 110 * count


def test_what_means_nothing_is_left_out_and_counted():
    tree = TransformTree()
    for move, turn in [
        ((np.nan, 0, 0), (0, 0, 0, 1)),
        ((0, 0, 0), (0, 0, 0, 0)),
        ((0, 0, 0), (0, np.inf, 0, 1)),
        ((1e300, 0, 0), (0, 0, 0, 1)),
    ]:
        tree.add("a", "b", 0, move, turn, is_static=False)
    tree.add("a", "a", 0, (0, 0, 0), (0, 0, 0, 1), is_static=False)
    assert (tree.bad, tree.frames) == (5, [])


def test_a_frame_with_two_parents_keeps_the_one_that_comes_most_often():
    tree = TransformTree()
    for time in range(3):
        tree.add("odom", "base", time, (1, 0, 0), (0, 0, 0, 1), is_static=False)
    tree.add("odom2", "base", 1, (9, 0, 0), (0, 0, 0, 1), is_static=False)
    assert tree.several_parents == {"base": ["odom", "odom2"]}
    assert tree.leads("odom", "base")
    assert not tree.leads("odom2", "base")
    assert tree.root_of("base") == "odom"


def test_a_circle_ends():
    tree = TransformTree()
    for parent, child in ("ab", "bc", "ca"):
        tree.add(parent, child, 0, (1, 0, 0), (0, 0, 0, 1), is_static=True)
    assert tree.root_of("a") in "abc"
    tree.lookup("a", "b", np.array([0]))


def test_frames_that_no_transforms_join_are_named():
    tree = TransformTree()
    tree.add("map", "odom", 0, (1, 0, 0), (0, 0, 0, 1), is_static=True)
    told = r"no transforms lead from 'map' to 'laser': frames are map, odom"
    with pytest.raises(MalformedInputError, match=told):
        tree.lookup("/map", "/laser", np.array([0]))
    with pytest.raises(MalformedInputError, match="there are none"):
        TransformTree().lookup("map", "laser", np.array([0]))


def test_a_span_is_what_all_transforms_of_a_chain_cover():
    tree = TransformTree()
    for time in (10 * MS, 50 * MS):
        tree.add("map", "odom", time, (0, 0, 0), (0, 0, 0, 1), is_static=False)
        tree.add("odom", "base", time + 20 * MS, (0, 0, 0), (0, 0, 0, 1), is_static=False)
    tree.add("base", "laser", 0, (0, 0, 0), (0, 0, 0, 1), is_static=True)
    assert tree.span("map", "laser") == (30 * MS, 50 * MS)
    assert tree.span("base", "laser") is None
    assert tree.is_moving("map", "laser")
    assert not tree.is_moving("base", "laser")
    known = tree.lookup("map", "laser", np.array([29, 30, 50, 51]) * MS)
    assert known.known.tolist() == [False, True, True, False]
    just_outside = np.array([30 * MS - 999, 30 * MS - 1001])  # as seconds in a float64 may be
    assert tree.lookup("map", "laser", just_outside).known.tolist() == [True, False]


@pytest.mark.parametrize(
    ("angles", "is_flipped", "is_level", "leans"),
    [
        ((0.4, 0, 0), False, True, False),
        ((0.4, 0, np.pi), True, True, False),
        ((0.4, np.radians(9), 0), False, False, False),
        ((0.4, np.radians(11), 0), False, False, True),
        ((0.4, 0, np.pi - np.radians(9)), True, False, False),
        ((0.4, np.radians(60), 0), False, False, True),
    ],
)
def test_how_a_sensor_stands(angles, is_flipped, is_level, leans):
    turn = Rotation.from_euler("ZYX", angles)
    found = stances(np.array([[1.0, 2.0, 3.0]]), turn.as_quat()[np.newaxis])
    assert found.poses[0, :2].tolist() == [1.0, 2.0]
    ahead = turn.apply([1, 0, 0])
    assert found.poses[0, 2] == pytest.approx(np.arctan2(ahead[1], ahead[0]))
    flags = found.is_flipped[0], found.is_level[0], found.leans[0]
    assert flags == (is_flipped, is_level, leans)


ANGLES = np.radians([-80.0, -10.0, 0.0, 35.0, 90.0])
RANGES = np.array([1.5, 2.25, 3.0, 0.75, 4.0])


def hits_of(turn, move):
    """Return where beams end in the plane, by scipy."""
    points = np.column_stack([RANGES * np.cos(ANGLES), RANGES * np.sin(ANGLES), 0 * RANGES])
    return (turn.apply(points) + move)[:, :2]


def hits_of_pose(pose, angles, ranges):
    x, y, yaw = pose
    return np.column_stack([x + ranges * np.cos(yaw + angles), y + ranges * np.sin(yaw + angles)])


@given(st.floats(-3, 3), st.floats(-0.17, 0.17), st.floats(-0.17, 0.17), st.booleans())
def test_beams_of_leaning_sensors_end_below_where_they_hit(yaw, pitch, roll, is_flipped):
    turn = Rotation.from_euler("ZYX", [yaw, pitch, roll + np.pi * is_flipped])
    quaternions = np.broadcast_to(turn.as_quat(), (len(ANGLES), 4))
    headings, shares = beams_in_plane(quaternions, ANGLES)
    found = hits_of_pose((0.5, 2.0, 0.0), headings, RANGES * shares)
    np.testing.assert_allclose(found, hits_of(turn, [0.5, 2.0, 1.0]), atol=1e-12)


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 4), min_size=1, max_size=5))
def test_a_sensor_leans_if_its_axis_is_more_than_10_degrees_off_the_vertical(turns):
    turns = [turn for turn in turns if np.linalg.norm(turn) > 0.1] or [(0.0, 0.0, 0.0, 1.0)]
    found = stances(np.zeros((len(turns), 3)), normalised(np.array(turns)))
    up = Rotation.from_quat(turns).apply([0.0, 0.0, 1.0])
    tilt = np.arccos(np.clip(np.abs(up[:, 2]), 0, 1))
    is_clear = np.abs(tilt - np.radians(10)) > 1e-6
    np.testing.assert_array_equal(found.leans[is_clear], (tilt > np.radians(10))[is_clear])
