"""ROS 1's costmap and parameter files, against the real code, PyYAML and rosparam's rules."""

import json
from pathlib import Path
from unittest.mock import Mock

import pytest
import yaml

from mapdeal import FileAccessError, MalformedInputError, MapdealWarning, ParameterError
from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.static import StaticLayer
from mapdeal.ros import ros1
from mapdeal.ros.load import flavour_of_file, is_ros2, load_robot, read_robot
from mapdeal.ros.robot import Problem
from mapdeal.ros.ros1 import Ros1Namespace, read_ros1_parameters, ros1_robot, why_unsendable


@pytest.fixture
def resolve(files):
    """Return a function that resolves the texts of files in their order."""
    return lambda *texts, **options: ros1_robot(files(*texts), **options)


def test_recorded_stacks_resolve_as_in_the_real_code(real_maps):
    recorded = json.loads((real_maps / "expected" / "params.json").read_text())
    cases = [case for case in recorded["cases"] if case["flavour"] == "ros1"]
    assert len(cases) == 14
    for case in cases:
        places = zip(case["params_files"], case["loaded_into"], strict=True)
        paths = [real_maps / name for name, place in places
                 if not place.endswith("_costmap") or case["costmap"] in place]  # fmt: skip
        robot, problems = ros1_robot(paths, costmap=case["costmap"].partition("_")[0])
        assert not [problem for problem in problems if problem.level != "note"], case["id"]
        assert _as_recorded(robot) == {
            **{name: case["resolved"][name] for name in (
                "inscribed_radius", "circumscribed_radius", "padded_footprint",
                "footprint_padding", "track_unknown_space", "inflation_layers", "ignored")},
            "robot_radius": case["resolved"]["robot_radius"] if case["resolved"]["use_radius"]
            else None,
            "plugins": case["plugins"],
            "static_layers": case["static_layers"],
        }, case["id"]  # fmt: skip


def _as_recorded(robot):
    def settings_of(kind, prefix, names, **derived):
        return {
            f"{prefix}{listed.name}": {
                **{name: getattr(listed.layer, name) for name in names},
                **{name: derive(listed.layer) for name, derive in derived.items()},
                "enabled": listed.is_enabled,
            }
            for listed in robot.layers if isinstance(listed.layer, kind)
        }  # fmt: skip

    names = ("inscribed_radius", "circumscribed_radius", "footprint_padding", "robot_radius",
             "track_unknown_space")  # fmt: skip
    return {
        **{name: getattr(robot, name) for name in names},
        "padded_footprint": [list(corner) for corner in robot.footprint.vertices],
        "ignored": [f"{listed.name} ({listed.plugin})" for listed in robot.layers if listed.needs],
        "plugins": [{"name": listed.name, "type": listed.plugin} for listed in robot.layers],
        "static_layers": settings_of(
            StaticLayer, "",
            ("track_unknown_space", "lethal_cost_threshold", "trinary_costmap", "use_maximum"),
            unknown_cost_value=lambda layer: {255: -1}.get(layer.unknown_cost_value),
        ),
        "inflation_layers": settings_of(
            InflationLayer, "costmap/",
            ("inflation_radius", "cost_scaling_factor", "inflate_unknown"),
            inscribed_radius_used=lambda layer: layer.inscribed_radius,
        ),
    }  # fmt: skip


@pytest.mark.slow
def test_footprints_of_very_many_points_are_refused(resolve):
    corners = [[i, j] for i in range(25) for j in range(81)]
    robot, problems = resolve(f"static_map: true\nfootprint: {corners}\n")
    assert robot is None
    (problem,) = problems
    assert (problem.check, problem.level, problem.line) == ("params.too-large", "refused", 2)
    assert resolve(f"static_map: true\nfootprint: {corners[:2000]}\n")[0] is not None


def test_the_time_for_many_problems_is_linear(resolve, monkeypatch):
    compared = Mock(side_effect=Problem.__eq__)
    monkeypatch.setattr(Problem, "__eq__", lambda *problems: compared(*problems))
    _, problems = resolve("static_map: true\nrobot_radius: 0.3\n" + "a: 1\n" * 300)
    assert len(problems) == 299  # each on its own line
    assert compared.call_count <= 3 * len(problems)


FILE = Path("a.yaml")


def as_mapping(namespace):
    """Return a namespace as plain dicts and values, as ``rosparam get`` prints it."""
    return {
        name: as_mapping(member) if isinstance(member, Ros1Namespace) else member.value
        for name, member in namespace.members.items()
    }


def read(text):
    return ros1.parse_ros1_parameters(FILE, text.encode())


SCALARS = """\
one: 1
octal: 010
minutes: 1:30
thousands: 1_000
no_number: 1e-1
number: 1.0e-1
bare: .5
yes: yes
off: off
text: "yes"
nested: {a: [1, [2.5, x]], b: {c: -0.0}}
anchor: &a {p: 1, q: 2}
merged: {<<: *a, q: 3}
aliased: *a
folded: >
  two
  lines
"""


def test_values_are_those_of_pyyaml():
    text = SCALARS.replace("yes: yes", '"yes": yes').replace("off: off", '"off": off')
    assert as_mapping(read(text).parameters) == yaml.safe_load(text)
    assert read(text).faults == ()


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.thorough)])
def test_real_files_hold_what_pyyaml_reads(real_maps, every):
    files = sorted((real_maps / "params").rglob("*.yaml"))
    assert len(files) > 60
    for path in files[::every]:
        if "wildcard" not in path.name:  # it has a name with a leading slash, for the root
            parameters = as_mapping(read_ros1_parameters(path).parameters)
            assert parameters == yaml.safe_load(path.read_text()), path


def test_later_values_stay_and_namespaces_are_merged():
    merged = Ros1Namespace()
    merged.merge(("x",), read("a: {b: 1, c: [1, 2]}\nd: 1\n").parameters)
    merged.merge(("x",), read("a: {c: [3]}\nd: {e: 2}\n").parameters)
    assert as_mapping(merged) == {"x": {"a": {"b": 1, "c": [3]}, "d": {"e": 2}}}
    merged.merge(("x",), read("a: 5").parameters)
    assert as_mapping(merged)["x"]["a"] == 5


def test_the_largest_whole_number_is_of_32_bits():
    assert why_unsendable(2**31 - 1) is None
    assert why_unsendable(-(2**31)) is None
    assert why_unsendable(2**31) is not None


NAV2 = """\
global_costmap: {global_costmap: {ros__parameters: {
  robot_radius: 0.3, track_unknown_space: true, plugins: ["static_layer"],
  static_layer: {plugin: "nav2_costmap_2d::StaticLayer"}}}}
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
    assert str(caught.value).startswith(f"{path}: plugins (line 3): entry 2 has no type")
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
    robot, problems, _ = load_robot([_file(tmp_path, "inflation: {inflation_radius: 1.0}\n")])
    assert robot is not None
    assert "params.namespace" not in {problem.check for problem in problems}
