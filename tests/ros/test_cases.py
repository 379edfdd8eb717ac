"""Parameter files of all kinds, with the expected results in ``cases/*.yaml``.

A case contains files, as texts, and the result of their reader, line by line: problems, then the
robot or the parameters; or the findings of lint. ``<good>`` stands for valid first lines, which a
case may replace. The results were checked by hand against the sources of ROS. To add a case, write
its files and record the result, then check it:
``MAPDEAL_RECORD=1 python -m pytest -n0 tests/ros/test_cases.py``.
"""

import os
from dataclasses import fields
from pathlib import Path

import pytest
import yaml

from mapdeal.checks.findings import CHECKS
from mapdeal.checks.parameter_checks import lint_parameters
from mapdeal.errors import MalformedInputError
from mapdeal.grid.frame import Frame
from mapdeal.ros.nav2 import nav2_robot
from mapdeal.ros.ros1 import Ros1Namespace, read_ros1_parameters, ros1_robot
from mapdeal.ros.ros2_files import read_ros2

FOLDER = Path(__file__).with_name("cases")
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
CASES = {path.stem: yaml.load(path.read_text("utf-8"), LOADER)  # noqa: S506 - a safe one
         for path in sorted(FOLDER.glob("*.yaml"))}  # fmt: skip


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


def describe_lint(paths, maps=(), **options):
    frames = [(name, Frame(200, 300, side)) for name, side in maps]
    by_file = lint_parameters(paths, map_frames=frames, **options)
    findings = [finding for path in paths for finding in by_file[path]]
    assert len(findings) == sum(map(len, by_file.values()))
    assert all(finding.severity == CHECKS[finding.check].severity for finding in findings)
    lines = [f"{f.check} at {Path(f.file).name}:{f.line}: {f.message}" for f in findings]
    return [line.replace(f"{paths[0].parent}/", "") for line in lines]


READERS = {
    "lint_nav2": describe_lint,
    "lint_ros1": describe_lint,
    "nav2": lambda paths, **options: describe_robot(*nav2_robot(paths, **options)),
    "ros1": lambda paths, **options: describe_robot(*ros1_robot(paths, **options)),
    "ros2_files": describe_ros2,
    "ros1_files": describe_ros1,
}


def read_case(kind, paths, options):
    try:
        return READERS[kind](paths, **options)
    except MalformedInputError as error:
        assert error.source == paths[0]
        line, hint = getattr(error, "line", None), error.hint
        return [f"refused in line {line}: {error.rule}" + (f"; hint: {hint}" if hint else "")]


class Readable(yaml.SafeDumper):
    """Dumper that writes texts of several lines in block style."""


Readable.add_representer(str, lambda dumper, text: dumper.represent_scalar(
    "tag:yaml.org,2002:str", text, style="|" if "\n" in text else None))  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind, cases in CASES.items() for name in cases["cases"]]
)
def test_files_give_the_recorded_result(files, kind, name):
    case, good = CASES[kind]["cases"][name], CASES[kind]["good"]
    for before, after in case.get("replace", {}).items():
        assert before in good
        good = good.replace(before, after)
    texts = [text.replace("<good>\n", good) if isinstance(text, str) else text
             for text in case["files"]]  # fmt: skip
    options = case.get("options", {})
    found = [line.encode("unicode_escape").decode() if not line.isprintable() else line
             for line in read_case(kind, files(*texts), options)]  # fmt: skip
    if "MAPDEAL_RECORD" in os.environ:
        case["found"] = found
        text = yaml.dump(CASES[kind], Dumper=Readable, sort_keys=False, width=1000)
        (FOLDER / f"{kind}.yaml").write_text(text, "utf-8")
    else:
        assert found == case["found"]
