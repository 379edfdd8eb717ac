"""Loading of a robot's files: recognition of their kind, errors and warnings."""

import pytest

from mapdeal import FileAccessError, MalformedInputError, MapdealWarning, ParameterError
from mapdeal.ros.load import flavour_of_file, is_ros2, load_robot, read_robot

NAV2 = """\
global_costmap:
  global_costmap:
    ros__parameters:
      robot_radius: 0.3
      track_unknown_space: true
      plugins: ["static_layer"]
      static_layer: {plugin: "nav2_costmap_2d::StaticLayer"}
"""
ROS1 = """\
robot_radius: 0.3
plugins:
  - {name: static, type: "costmap_2d::StaticLayer"}
"""


def _file(tmp_path, text, name="params.yaml"):
    path = tmp_path / name
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "expected"),
    [(NAV2, "nav2"), (ROS1, "ros1"), ("# ros__parameters:\n" + ROS1, "ros1"), ("", None)],
)
def test_files_of_ros_2_are_recognised_by_their_key(tmp_path, text, expected):
    path = _file(tmp_path, text)
    assert (is_ros2(path), flavour_of_file(path)) == (expected == "nav2", expected)


def test_files_of_two_kinds_are_no_robot(tmp_path):
    paths = [_file(tmp_path, NAV2, "nav2.yaml"), _file(tmp_path, ROS1, "common.yaml")]
    with pytest.raises(ParameterError, match="contains no parameters of ROS 2, but nav2"):
        read_robot(paths)
    with pytest.raises(ParameterError, match="takes at least one file"):
        read_robot([])
    with pytest.raises(FileAccessError):
        read_robot([tmp_path / "missing.yaml"])


def test_the_first_reason_to_refuse_is_an_error_with_file_and_line(tmp_path):
    path = _file(tmp_path, ROS1 + "  - {name: inflation}\n")
    with pytest.raises(MalformedInputError) as caught:
        read_robot([path])
    text = str(caught.value)
    assert text.startswith(f"{path}: plugins (line 3): entry 2 has no type")
    assert "costmap_2d::StaticLayer" in caught.value.hint


@pytest.mark.parametrize(("flavour", "text"), [("nav2", NAV2), ("ros1", ROS1)])
def test_warnings_are_emitted_and_stored_with_file_and_line(tmp_path, flavour, text):
    read_robot([_file(tmp_path, text)])  # warnings are errors here
    path = _file(tmp_path, text.replace("StaticLayer", "ObstacleLayer"))
    with pytest.warns(MapdealWarning, match="no static layer") as caught:
        robot = read_robot([path])
    assert robot.remarks == tuple(str(warning.message) for warning in caught)
    assert all(text.startswith(str(path)) for text in robot.remarks)
    assert (robot.paths, robot.flavour) == ((path,), flavour)


@pytest.mark.parametrize(("text", "rule", "hint"), [
    ("image: a.pgm\nresolution: 0.1\norigin: [1, 2, 0.5]\n", "is a map, not", "mapdeal info"),
    ("stages:\n  - inflate: {radius: 0.4}\n", "is a recipe, not", "--recipe"),
    ("launch:\n- node: {pkg: a, exec: b}\n", "no parameter of a costmap; it has launch",
     "ros__parameters"),
    ("max_vel_x: 0.5\nmin_vel_x: 0.1\na: 1\nb: 2\n", "it has max_vel_x, min_vel_x, a, ...",
     "ros__parameters"),
])  # fmt: skip
def test_files_of_other_kinds_are_not_taken_for_a_costmap_of_defaults(tmp_path, text, rule, hint):
    """ROS 1 would load each of them and use defaults for the costmap."""
    path = _file(tmp_path, text)
    with pytest.raises(MalformedInputError) as caught:
        read_robot([path])
    assert rule in str(caught.value)
    assert hint in caught.value.hint


def test_a_costmaps_file_beside_one_of_another_node_is_enough(tmp_path):
    paths = [_file(tmp_path, ROS1, "costmap.yaml"), _file(tmp_path, "max_vel_x: 0.5\n", "dwa.yaml")]
    assert read_robot(paths).robot_radius == 0.3
    layered = "inflation: {inflation_radius: 1.0}\n"
    robot, problems = load_robot([_file(tmp_path, layered)])
    assert robot is not None
    assert "params.namespace" not in {problem.check for problem in problems}
