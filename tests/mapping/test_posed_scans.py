"""Scans of sensors that stand anyhow, against scipy and against the log of the made bags."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from conftest import NO_TEST_DATA
from mapdeal.kernels.rotations import from_yaw, normalised
from mapdeal.mapping.evidence import beams_in_plane, stances
from mapdeal.mapping.transforms import TransformTree

T0, MS = 1_700_000_000_123_456_789, 1_000_000
ANGLES = np.radians([-80.0, -10.0, 0.0, 35.0, 90.0])
RANGES = np.array([1.5, 2.25, 3.0, 0.75, 4.0])


def hits_of(turn, move):
    """Return where beams end in the plane, by scipy."""
    points = np.column_stack([RANGES * np.cos(ANGLES), RANGES * np.sin(ANGLES), 0 * RANGES])
    return (turn.apply(points) + move)[:, :2]


def hits_of_pose(pose, angles, ranges):
    x, y, yaw = pose
    return np.column_stack([x + ranges * np.cos(yaw + angles), y + ranges * np.sin(yaw + angles)])


@pytest.mark.parametrize("flip", [0.0, np.pi])
@pytest.mark.parametrize("yaw", [-2.9, np.pi / 2, 0.4])
def test_level_scans_are_a_pose_and_their_angles_negated_if_upside_down(flip, yaw):
    turn, move = Rotation.from_euler("ZYX", [yaw, 0, flip]), np.array([1.25, -2.5, 0.4])
    found = stances(move[None], turn.as_quat()[None])
    assert found.is_level.all()
    assert found.is_flipped.tolist() == [flip > 0]
    angles = -ANGLES if found.is_flipped[0] else ANGLES
    np.testing.assert_allclose(
        hits_of_pose(found.poses[0], angles, RANGES), hits_of(turn, move), atol=1e-12
    )


@given(st.floats(-3, 3), st.floats(-0.17, 0.17), st.floats(-0.17, 0.17), st.booleans())
def test_beams_of_leaning_sensors_end_below_where_they_hit(yaw, pitch, roll, is_flipped):
    turn = Rotation.from_euler("ZYX", [yaw, pitch, roll + np.pi * is_flipped])
    quaternions = np.broadcast_to(turn.as_quat(), (len(ANGLES), 4))
    headings, shares = beams_in_plane(quaternions, ANGLES)
    found = hits_of_pose((0.5, 2.0, 0.0), headings, RANGES * shares)
    np.testing.assert_allclose(found, hits_of(turn, [0.5, 2.0, 1.0]), atol=1e-12)


def test_ranges_without_a_return_stay_infinite():
    tilted = Rotation.from_euler("y", 0.1).as_quat()[None]
    _, shares = beams_in_plane(tilted, np.zeros(1))
    assert 0 < shares[0] < 1
    assert np.isinf(np.inf * shares[0])


def test_the_robot_may_stand_above_the_fixed_frame():
    """As with localisers that publish base_link -> odom: the edge is taken upside down."""
    tree = TransformTree()
    for k in range(2):
        turn = from_yaw(np.pi / 2).tolist()
        tree.add("base", "odom", T0 + k * 100 * MS, (2.0 * k, 1.0, 0), turn, is_static=False)
    tree.add("base", "laser", 0, (0.5, 0, 0.2), from_yaw(-np.pi / 2).tolist(), is_static=True)
    found = tree.lookup("odom", "laser", np.array([T0 + 25 * MS]))
    pose = stances(found.translations, found.quaternions).poses[0]
    # base -> odom is (0.5, 1) and 90 degrees there, so p of base lies at R(-90) (p - (0.5, 1))
    np.testing.assert_allclose(pose[:2], [-1.0, 0.0], atol=1e-12)
    assert abs(pose[2]) == pytest.approx(np.pi)


def test_the_chain_may_lead_over_a_common_ancestor():
    """Of map -> {tracker, base -> laser}: the laser in the tracker's frame, by matrices."""
    tree = TransformTree()
    static = {"tracker": ("map", (3.0, -1.0, 2.0), (0.4, -0.2, 1.1)),
              "laser": ("base", (0.2, 0.1, 0.3), (3.1, 0.05, -0.6))}  # fmt: skip
    matrices = {}
    for child, (parent, move, angles) in static.items():
        turn = Rotation.from_euler("xyz", angles)
        tree.add(parent, child, 0, move, turn.as_quat().tolist(), is_static=True)
        matrices[child] = as_matrix(move, turn)
    ends = [Rotation.from_euler("xyz", a) for a in ([0, 0, 0.2], [0, 0, 1.0])]
    for time, x, turn in zip((0, 80), (1.0, 2.0), ends, strict=True):
        tree.add("map", "base", T0 + time * MS, (x, 5, 0), turn.as_quat().tolist(), is_static=False)
    base = as_matrix([1.75, 5, 0], Rotation.from_euler("z", 0.8))
    wanted = np.linalg.inv(matrices["tracker"]) @ base @ matrices["laser"]
    found = tree.lookup("tracker", "laser", np.array([T0 + 60 * MS]))
    turn = Rotation.from_quat(found.quaternions[0])
    np.testing.assert_allclose(as_matrix(found.translations[0], turn), wanted, atol=1e-12)


def as_matrix(move, turn):
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = turn.as_matrix(), move
    return made


def test_beams_of_a_turning_robot_start_where_the_sensor_was():
    """One scan of 100 ms, a robot that turns by 40 degrees and drives a metre meanwhile."""
    tree, count, step = TransformTree(), len(ANGLES), 25 * MS
    for k, yaw in enumerate(np.radians([30.0, 70.0])):
        turn = from_yaw(yaw).tolist()
        tree.add("odom", "base", T0 + k * 100 * MS, (k, 0, 0), turn, is_static=False)
    tree.add("base", "laser", 0, (0.25, 0, 0), (0, 0, 0, 1), is_static=True)
    found = tree.lookup("odom", "laser", T0 + step * np.arange(count))
    headings, shares = beams_in_plane(found.quaternions, ANGLES)
    yaws = np.radians(30 + 10.0 * np.arange(count))
    np.testing.assert_allclose(np.sin(headings - yaws - ANGLES), 0, atol=1e-12)
    np.testing.assert_allclose(shares, 1, atol=1e-15)
    starts = np.column_stack([np.arange(count) / 4 + 0.25 * np.cos(yaws), 0.25 * np.sin(yaws)])
    np.testing.assert_allclose(found.translations[:, :2], starts, atol=1e-12)


def test_scans_of_the_made_bags_stand_where_their_log_says(real_maps):
    """Read by rosbags alone. The nearest transforms would be off by more than 0.1 m."""
    tree, stamps = _recorded(real_maps / "bags" / "made" / "scans-mcap")
    wanted = _logged(real_maps / "bags" / "made" / "sim.log")
    found = tree.lookup("map", "laser", stamps)
    assert found.known.all()
    stance = stances(found.translations, found.quaternions)
    assert stance.is_level.all()
    assert not stance.is_flipped.any()
    assert len(wanted) == len(stamps) == 76
    assert np.abs(stance.poses[:, :2] - wanted[:, :2]).max() < 1e-9
    assert _turns(stance.poses[:, 2] - wanted[:, 2]).max() < 1e-9
    nearest = tree.lookup("map", "laser", _nearest(stamps)).translations
    assert np.hypot(*(nearest[:, :2] - wanted[:, :2]).T).max() > 0.1


def _recorded(path):
    highlevel = pytest.importorskip("rosbags.highlevel")
    typesys = pytest.importorskip("rosbags.typesys")
    if not path.exists():
        pytest.skip(NO_TEST_DATA)
    tree, stamps = TransformTree(), []
    store = typesys.get_typestore(typesys.Stores.LATEST)
    with highlevel.AnyReader([path], default_typestore=store) as reader:
        for connection, _, raw in reader.messages():
            if connection.topic not in ("/scan", "/tf", "/tf_static"):
                continue
            message = reader.deserialize(raw, connection.msgtype)
            if connection.topic == "/scan":
                stamps.append(_nanoseconds(message.header.stamp))
                continue
            for one in message.transforms:
                move, turn = one.transform.translation, one.transform.rotation
                tree.add(
                    one.header.frame_id,
                    one.child_frame_id,
                    _nanoseconds(one.header.stamp),
                    (move.x, move.y, move.z),
                    (turn.x, turn.y, turn.z, turn.w),
                    is_static=connection.topic == "/tf_static",
                )
    return tree, np.array(stamps, np.int64)


def _nanoseconds(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


def _logged(path):
    rows = [line.split() for line in path.read_text().splitlines() if line.startswith("FLASER")]
    return np.array([[float(word) for word in row[2 + int(row[1]) :][:3]] for row in rows])


def _nearest(stamps):
    """Return the times of the transforms, one each 0.2 s, that are nearest."""
    first, step = stamps[0] - 50 * MS, 200 * MS
    return first + (stamps - first + step // 2) // step * step


def _turns(angles):
    return np.abs(np.arctan2(np.sin(angles), np.cos(angles)))


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 4), min_size=1, max_size=5))
def test_a_sensor_leans_if_its_axis_is_more_than_10_degrees_off_the_vertical(turns):
    turns = [turn for turn in turns if np.linalg.norm(turn) > 0.1] or [(0.0, 0.0, 0.0, 1.0)]
    found = stances(np.zeros((len(turns), 3)), normalised(np.array(turns)))
    up = Rotation.from_quat(turns).apply([0.0, 0.0, 1.0])
    tilt = np.arccos(np.clip(np.abs(up[:, 2]), 0, 1))
    is_clear = np.abs(tilt - np.radians(10)) > 1e-6
    np.testing.assert_array_equal(found.leans[is_clear], (tilt > np.radians(10))[is_clear])
