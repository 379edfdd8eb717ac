"""Parameter files of all kinds, with the results in ``cases/*.yaml``, and those of lint."""

from dataclasses import fields
from pathlib import Path

import pytest

from checks.test_parameter_files import test_files_have_the_recorded_findings  # noqa: F401
from mapdeal.ros.nav2 import nav2_robot
from mapdeal.ros.ros1 import Ros1Namespace, read_ros1_parameters, ros1_robot
from mapdeal.ros.ros2_files import read_ros2
from recorded_cases import RecordedCases

CASES = RecordedCases(Path(__file__).with_name("cases"))


def describe(problem):
    place = f"{problem.source.name}:{problem.line}" if problem.source else "-"
    text = f"{problem.level} {problem.check} {problem.parameter!r} at {place}: {problem.text}"
    text += f", got {problem.got}" * (problem.got is not None)
    return text + f"; hint: {problem.hint}" * (problem.hint is not None)


def describe_robot(robot, problems):
    lines = [describe(problem) for problem in problems]
    if robot is None:
        return [*lines, "no robot"]
    size = f"radii {robot.inscribed_radius!r} {robot.circumscribed_radius!r}"
    corners = "" if robot.robot_radius is not None else f" corners {robot.footprint.vertices}"
    lines.append(f"{robot.flavour} {robot.costmap} {robot.node} radius {robot.robot_radius} {size}"
                 f" padding {robot.footprint_padding}{corners}"
                 + " track_unknown_space" * robot.track_unknown_space
                 + " rolling_window" * robot.rolling_window)  # fmt: skip
    for listed in robot.layers:
        words = ["off"] * (not listed.is_enabled) + ["filter"] * listed.is_filter
        effect = listed.why_ignored or changed_settings(listed.layer)
        lines.append(" ".join([listed.name, listed.plugin, *words, effect]))
    return lines


def changed_settings(layer):
    changed = {setting.name: getattr(layer, setting.name) for setting in fields(layer)
             if getattr(layer, setting.name) != setting.default}  # fmt: skip
    return f"{type(layer).__name__} {changed}"


def describe_ros2(paths):
    parameters = read_ros2(paths)
    return [
        f"{node.name} {name}: {value.kind} {value.value!r} "
        f"at {value.source.name}:{value.line}: {value.text}"
        + (f", not {value.ignored.value!r} in line {value.ignored.line}" if value.ignored else "")
        for node in parameters.nodes
        for name, value in node.entries
    ]


def describe_ros1(paths):
    def values(namespace, prefix):
        for name, value in namespace.members.items():
            if isinstance(value, Ros1Namespace):
                yield from values(value, f"{prefix}{name}/")
            else:
                text = f"{value.kind} {value.value!r} in line {value.line}: {value.text}"
                yield f"{prefix}{name}: {text}"

    (path,) = paths
    file = read_ros1_parameters(path)
    return [*map(describe, file.faults), *values(file.parameters, "")]


READERS = {
    "nav2": lambda paths, **options: describe_robot(*nav2_robot(paths, **options)),
    "ros1": lambda paths, **options: describe_robot(*ros1_robot(paths, **options)),
    "ros2_files": describe_ros2,
    "ros1_files": describe_ros1,
}


@pytest.mark.parametrize(("kind", "name"), CASES.names)
def test_files_give_the_recorded_result(files, kind, name):
    CASES.check(kind, name, files, READERS[kind])
