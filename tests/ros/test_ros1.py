"""ROS 1's costmap and parameter files, against the real code, PyYAML and rosparam's rules."""

import json
from pathlib import Path

import pytest
import yaml

from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.static import StaticLayer
from mapdeal.ros import ros1
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
        paths = [
            real_maps / name
            for name, place in zip(case["params_files"], case["loaded_into"], strict=True)
            if not place.endswith("_costmap") or case["costmap"] in place
        ]
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
    assert [(problem.check, problem.level, problem.line) for problem in problems] == [
        ("params.too-large", "refused", 2)
    ]
    assert resolve(f"static_map: true\nfootprint: {corners[:2000]}\n")[0] is not None


def test_the_time_for_many_problems_is_linear(resolve, monkeypatch):
    compared = []
    equal = Problem.__eq__
    monkeypatch.setattr(
        Problem, "__eq__", lambda first, second: compared.append(first) or equal(first, second)
    )
    _, problems = resolve("static_map: true\nrobot_radius: 0.3\n" + "a: 1\n" * 300)
    assert len(problems) == 299  # each on its own line
    assert len(compared) <= 3 * len(problems)


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
