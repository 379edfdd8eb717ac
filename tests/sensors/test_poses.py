import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal import MalformedInputError, MapdealWarning, read_poses


@pytest.fixture
def read(tmp_path):
    def read_text(text):
        path = tmp_path / "poses.txt"
        path.write_text(text)
        return read_poses(path)

    return read_text


@pytest.mark.parametrize("separator", [" ", ",", " ; ", "\t"])
def test_x_y_and_yaw(read, separator):
    lines = [["1", "-2.5", "0.25"], ["1e1", "0", "-3"]]
    rows = [["x", "y", "yaw"], *lines]
    text = "# a comment\n\n" + "".join(separator.join(row) + "\n" for row in rows)
    assert read(text).tolist() == [[1.0, -2.5, 0.25], [10.0, 0.0, -3.0]]


@given(yaw=st.floats(-math.pi, math.pi), x=st.floats(-9, 9), y=st.floats(-9, 9))
def test_tum_s_quaternions_about_the_vertical(tmp_path_factory, yaw, x, y):
    path = tmp_path_factory.mktemp("poses") / "p.txt"
    quaternion = f"0 0 {math.sin(yaw / 2)!r} {math.cos(yaw / 2)!r}"
    path.write_text(f"1700000000123456789 {x!r} {y!r} 3 {quaternion}\n")
    (pose,) = read_poses(path)
    assert pose[:2].tolist() == [x, y]
    assert math.cos(pose[2] - yaw) > 1 - 1e-12


def test_the_heading_of_a_robot_that_leans(read):
    """The rotation is 0.3 about the vertical, then 0.1 about the robot's y axis."""
    (a, b), (c, d) = ((math.sin(v / 2), math.cos(v / 2)) for v in (0.3, 0.1))
    (pose,) = read(f"0 1 2 3 {-a * c} {b * c} {a * d} {b * d}\n")
    np.testing.assert_allclose(pose, [1.0, 2.0, 0.3], atol=1e-15)


def test_unusual_poses_give_one_warning_of_each_kind(read):
    with pytest.warns(MapdealWarning, match="2 of 3 poses, the first of them pose 2.*degrees"):
        poses = read("0 0 0\n0 0 90\n0 0 -180\n")
    assert np.cos(poses[:, 2] - [0, 90, -180]) == pytest.approx(1.0)
    assert np.abs(poses[:, 2]).max() <= math.pi
    with pytest.warns(MapdealWarning, match="time"):
        read("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n")
    with pytest.warns(MapdealWarning, match="not of length 1"):
        (pose,) = read("0 1 2 3 0 0 2 2\n")
    assert pose.tolist() == [1.0, 2.0, pytest.approx(math.pi / 2)]
    with pytest.warns(MapdealWarning, match="leans"):
        read("0 1 2 3 0.2 0 0 0.9797958971132712\n")


@pytest.mark.parametrize("time", ["0", "-0.0", "12.5"])
def test_poses_with_a_constant_time_give_no_warning(read, time):
    poses = read("".join(f"{time} {x} 2 0 0 0 0 1\n" for x in (5, 3, 4)))  # a warning is an error
    assert poses[:, 0].tolist() == [5, 3, 4]
    far = read("-1.7e308 1 2 0 0 0 0 1\n1.7e308 3 4 0 0 0 0 1\n")
    assert far.tolist() == [[1.0, 2.0, 0.0], [3.0, 4.0, 0.0]]
    with pytest.warns(MapdealWarning, match="2 of 3 poses, the first of them pose 2.*a time"):
        read("3 5 2 0 0 0 0 1\n2 5 2 0 0 0 0 1\n1 5 2 0 0 0 0 1\n")


@pytest.mark.parametrize(("text", "place"), [
    ("1 2 3\n1 nan 3\n", "pose 2"),
    ("1 1e300 0\n", "pose 1"),
    ("0 1 2 3 0 0 0 1\nnan 1 2 3 0 0 0 1\n", "pose 2"),
    ("0 1 2 3 0 0 0 1\n0 1 2 3 0 0 0 0\n", "pose 2"),
    ("1 2\n", "line 1"),
    ("# a\n1 2 3\n1 2\n", "line 3"),
    ("1 2 3\n1 two 3\n", "line 2"),
    ("x y 1\n1 2 3\n", "line 1"),
    ("# none\n", "no poses"),
])  # fmt: skip
def test_invalid_poses_are_refused(read, text, place):
    with pytest.raises(MalformedInputError, match=place):
        read(text)
