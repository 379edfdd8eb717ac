"""Transforms over time, against scipy's rotations and what the made bags hold."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation, Slerp

from mapdeal import MalformedInputError
from mapdeal.kernels.rotations import normalised
from mapdeal.mapping.evidence import beams_in_plane, stances
from mapdeal.mapping.transforms import TransformTree
from traced_memory import memory_below

T0, MS = 1_700_000_000_123_456_789, 1_000_000
numbers = st.floats(-10, 10, allow_subnormal=False)
parts = st.tuples(*[st.floats(-1, 1, allow_subnormal=False)] * 4)
turns = parts.filter(lambda q: np.linalg.norm(q) > 0.1)
quaternions = turns.map(lambda q: normalised(np.array(q)))
moves = st.tuples(numbers, numbers, numbers)


def matrix(move, quaternion):
    matrix_4x4 = np.eye(4)
    matrix_4x4[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix_4x4[:3, 3] = move
    return matrix_4x4


@pytest.mark.slow
@given(data=st.data(), lengths=st.lists(st.integers(1, 4), min_size=2, max_size=3))
def test_each_transform_of_a_chain_is_interpolated_alone(data, lengths):
    tree, known = TransformTree(), {}
    for name, length in zip("abc", lengths, strict=False):
        frames = ["root", *(f"{name}{k}" for k in range(length))]
        for parent, child in pairwise(frames):
            is_static = data.draw(st.booleans())
            several = st.sets(st.integers(0, 1000), min_size=1, max_size=4)
            times = [0] if is_static else sorted(data.draw(several))
            samples = [(t, data.draw(moves), data.draw(quaternions)) for t in times]
            for t, move, quaternion in data.draw(st.permutations(samples)):
                tree.add(f"/{parent}", child, T0 + t * MS, move, quaternion, is_static=is_static)
            known[child] = parent, samples, is_static
    query_times = [data.draw(st.integers(-10, 1010)) for _ in range(4)]
    first_leaf, second_leaf = f"a{lengths[0] - 1}", f"b{lengths[1] - 1}"
    found = tree.lookup(first_leaf, second_leaf, np.array(query_times) * MS + T0)

    def above(frame, time):
        product = np.eye(4)
        while frame != "root":
            parent, samples, is_static = known[frame]
            step = at(samples, time) if not is_static else matrix(*samples[-1][1:])
            if step is None:
                return None
            product = step @ product
            frame = parent
        return product

    for k, time in enumerate(query_times):
        to_first, to_second = above(first_leaf, time), above(second_leaf, time)
        assert found.known[k] == (to_first is not None and to_second is not None)
        if found.known[k]:
            expected = np.linalg.inv(to_first) @ to_second
            found_matrix = matrix(found.translations[k], found.quaternions[k])
            np.testing.assert_allclose(found_matrix, expected, atol=1e-6)
        else:
            assert np.isnan(found.translations[k]).all()


def at(samples, time):
    times = [t for t, _, _ in samples]
    if not times[0] <= time <= times[-1]:
        return None
    for (t, move, turn), (u, next_move, back) in pairwise(samples):
        if t <= time <= u:
            share = (time - t) / (u - t)
            middle = np.array(move) + share * (np.array(next_move) - np.array(move))
            if abs(turn @ back) > 1 - 1e-12:
                return matrix(middle, turn)
            return matrix(middle, Slerp([0, 1], Rotation.from_quat([turn, back]))(share).as_quat())
    return matrix(*samples[0][1:])


def tree_of(*edges):
    tree = TransformTree()
    for parent, child, time, x, is_static in edges:
        tree.add(parent, child, time, (x, 0, 0), (0, 0, 0, 1), is_static=is_static)
    return tree


def xs(tree, parent, child, times):
    return tree.lookup(parent, child, np.array(times)).translations[:, 0]


def test_times_of_this_century_keep_their_nanoseconds():
    tree = tree_of(("a", "b", T0, 0.0, False), ("a", "b", T0 + 100, 1.0, False))
    found = xs(tree, "a", "b", T0 + np.arange(0, 101, 10))
    np.testing.assert_allclose(found, np.arange(11) / 10, atol=1e-12)


def test_the_last_of_two_at_one_time_counts_and_a_static_one_replaces_what_was():
    tree = tree_of(
        ("a", "b", 5, 1.0, False), ("a", "b", 5, 2.0, False),
        ("b", "c", 5, 10.0, True), ("b", "c", 5, 20.0, True),
    )  # fmt: skip
    assert xs(tree, "a", "c", [5]).tolist() == [22.0]
    edges = [(e.parent, e.child, e.count, e.is_static) for e in tree.edges()]
    assert edges == [("a", "b", 2, False), ("b", "c", 1, True)]


@pytest.mark.parametrize(("moving", "place"), [(1, 0), (1, 1), (4, 0), (4, 2), (4, 4)])
def test_what_comes_static_and_moving_is_what_it_comes_as_most_often(moving, place):
    samples = [("a", "b", T0 + k * MS, k, False) for k in range(moving)]
    samples.insert(place, ("a", "b", 0, 9, True))
    tree = tree_of(*samples)
    is_static = moving == 1
    assert [(e.count, e.is_static) for e in tree.edges()] == [(moving, is_static)]
    assert tree.of_both_kinds == [("a", "b")]
    expected = [9, 9, 9] if is_static else [np.nan, 0, moving - 1]
    found = xs(tree, "a", "b", T0 + MS * np.array([-5, 0, moving - 1]))
    np.testing.assert_array_equal(found, expected)


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
    assert edge.count == len(before) + len(after)
    assert (edge.first, edge.last) == (T0 + MS * min(known), T0 + MS * max(known))


@pytest.mark.thorough
@pytest.mark.parametrize("is_mixed", [False, True])
def test_samples_are_kept_once(is_mixed):
    count = 50_000
    tree = tree_of(("a", "b", 0, 0, False))
    with memory_below(110 * count):
        for k in range(count):
            time = k ^ 1 if is_mixed else k
            tree.add("a", "b", time, (1, 2, 3), (0, 0, 0, 1), is_static=False)
        tree.edges()
        xs(tree, "a", "b", np.arange(10))


def test_what_means_nothing_is_left_out_and_counted():
    tree, still, level = TransformTree(), (0, 0, 0), (0, 0, 0, 1)
    for count, (parent, move, turn) in enumerate((
        ("a", (np.nan, 0, 0), level), ("a", (1e300, 0, 0), level), ("a", still, (0, 0, 0, 0)),
        ("a", still, (0, np.inf, 0, 1)), ("b", still, level),
    ), 1):  # fmt: skip
        tree.add(parent, "b", 0, move, turn, is_static=False)
        assert (tree.bad, tree.frames) == (count, [])


def test_a_frame_with_two_parents_keeps_the_one_that_comes_most_often():
    often = [("odom", "base", time, 1, False) for time in range(3)]
    tree = tree_of(*often, ("odom2", "base", 1, 9, False))
    assert tree.several_parents == {"base": ["odom", "odom2"]}
    assert tree.leads("odom", "base")
    assert not tree.leads("odom2", "base")
    assert tree.root_of("base") == "odom"
    # a circle ends
    tree = tree_of(*((parent, child, 0, 1, True) for parent, child in ("ab", "bc", "ca")))
    assert tree.root_of("a") in "abc"
    xs(tree, "a", "b", [0])


def test_frames_that_no_transforms_join_are_named():
    message = r"no transforms lead from 'map' to 'laser': frames are map, odom"
    with pytest.raises(MalformedInputError, match=message):
        xs(tree_of(("map", "odom", 0, 1, True)), "/map", "/laser", [0])
    with pytest.raises(MalformedInputError, match="there are none"):
        xs(TransformTree(), "map", "laser", [0])


def test_a_span_is_what_all_transforms_of_a_chain_cover():
    tree = tree_of(
        *(("map", "odom", time * MS, 0, False) for time in (10, 50)),
        *(("odom", "base", time * MS, 0, False) for time in (30, 70)),
        ("base", "laser", 0, 0, True),
    )
    assert tree.span("map", "laser") == (30 * MS, 50 * MS)
    assert tree.span("base", "laser") is None
    assert tree.is_moving("map", "laser")
    assert not tree.is_moving("base", "laser")
    # 999 ns outside, as seconds in a float64 may be, are not 1001
    times = np.array([29 * MS, 30 * MS - 1001, 30 * MS - 999, 30 * MS, 50 * MS, 51 * MS])
    known = tree.lookup("map", "laser", times).known
    assert known.tolist() == [False, False, True, True, True, False]


LEVEL, UPSIDE_DOWN = (0.0, 0.0, 0.6, 0.8), (0.8, 0.6, 0.0, 0.0)


@given(st.lists(turns, max_size=5))
def test_how_a_sensor_stands_and_that_it_leans_beyond_10_degrees(turns):
    turns = [LEVEL, UPSIDE_DOWN, *turns]
    found = stances(np.full((len(turns), 3), (1.0, 2.0, 3.0)), normalised(np.array(turns)))
    ahead, up = (Rotation.from_quat(turns).apply(axis) for axis in ([1, 0, 0], [0, 0, 1]))
    tilt = np.arctan2(np.hypot(*up[:, :2].T), np.abs(up[:, 2]))
    assert (found.poses[:, :2] == (1.0, 2.0)).all()
    headings = np.stack([np.cos(found.poses[:, 2]), np.sin(found.poses[:, 2])])
    np.testing.assert_allclose(headings * np.hypot(*ahead[:, :2].T), ahead[:, :2].T, atol=1e-12)
    for name, is_so, is_clear in (
        ("is_flipped", up[:, 2] < 0, np.abs(up[:, 2]) > 1e-9),
        ("is_level", tilt < 1e-6, (tilt < 1e-9) | (tilt > 1e-3)),
        ("leans", tilt > np.radians(10), np.abs(tilt - np.radians(10)) > 1e-6),
    ):
        np.testing.assert_array_equal(getattr(found, name)[is_clear], is_so[is_clear])


@given(st.floats(-3, 3), st.floats(-0.17, 0.17), st.floats(-0.17, 0.17), st.booleans())
def test_beams_of_leaning_sensors_end_below_where_they_hit(yaw, pitch, roll, is_flipped):
    angles, ranges = np.radians([-80.0, -10.0, 0.0, 35.0, 90.0]), [1.5, 2.25, 3.0, 0.75, 4.0]
    turn = Rotation.from_euler("ZYX", [yaw, pitch, roll + np.pi * is_flipped])
    points = np.stack([np.cos(angles), np.sin(angles), 0 * angles]) * ranges
    headings, shares = beams_in_plane(np.broadcast_to(turn.as_quat(), (5, 4)), angles)
    found = np.stack([np.cos(headings), np.sin(headings)]) * ranges * shares
    np.testing.assert_allclose(found, turn.apply(points.T).T[:2], atol=1e-12)


@pytest.mark.parametrize("in_seconds", [False, True])
def test_tf2_interpolates_moves_linearly_and_turns_on_the_sphere(in_seconds):
    tree, turns = TransformTree(), Rotation.from_euler("zyx", [[0.2, 0.1, -0.3], [1.4, 0.5, 0.2]])
    for k, move in enumerate([(1.0, 2.0, 3.0), (5.0, 4.0, -1.0)]):
        tree.add("a", "b", T0 + k * 1000 * MS, move, turns[k].as_quat(), is_static=False)
    move, turn = tree.tf2_lookup("a", "b", T0 + 250 * MS, in_seconds=in_seconds)
    assert move == pytest.approx((2.0, 2.5, 2.0))
    assert turn == pytest.approx(Slerp([0, 1], turns)(0.25).as_quat())
