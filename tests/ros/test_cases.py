"""Parameter files of all kinds, and what is found in them, as in ``cases/*.yaml``.

Each case has files, as texts, and what its reader finds: problems first, one a line, then the robot
or the parameters; or what lint finds. ``<good>`` stands for a good beginning, of which lines may be
replaced. The rules are those of ROS's own sources, and the cases were held against them by hand.
For a new case write its files, and record what is found, once it was looked at:
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
from mapdeal.ros.nav2 import nav2_robot
from mapdeal.ros.ros1 import Ros1Namespace, read_ros1_parameters, ros1_robot
from mapdeal.ros.ros2_files import read_ros2

FOLDER = Path(__file__).with_name("cases")
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
CASES = {path.stem: yaml.load(path.read_text("utf-8"), LOADER)  # noqa: S506 - a safe one
         for path in sorted(FOLDER.glob("*.yaml"))}  # fmt: skip


def told(problem):
    place = f"{problem.source.name}:{problem.line}" if problem.source else "-"
    text = f"{problem.level} {problem.check} {problem.parameter!r} at {place}: {problem.text}"
    return (
        text
        + f", got {problem.got}" * (problem.got is not None)
        + (f"; hint: {problem.hint}" * (problem.hint is not None))
    )


def robot_found(robot, problems):
    lines = [told(one) for one in problems]
    if robot is None:
        return [*lines, "no robot"]
    size = f"radii {robot.inscribed_radius!r} {robot.circumscribed_radius!r}"
    corners = "" if robot.robot_radius is not None else f" corners {robot.footprint.vertices}"
    lines.append(f"{robot.flavour} {robot.costmap} {robot.node} radius {robot.robot_radius} {size}"
                 f" padding {robot.footprint_padding}{corners}"
                 + " track_unknown_space" * robot.track_unknown_space
                 + " rolling_window" * robot.rolling_window)  # fmt: skip
    for one in robot.layers:
        words = ["off"] * (not one.is_enabled) + ["filter"] * one.is_filter
        lines.append(" ".join([one.name, one.plugin, *words, one.why_ignored or set_in(one.layer)]))
    return lines


def set_in(layer):
    """Return what a layer does otherwise than by default."""
    found = {one.name: getattr(layer, one.name) for one in fields(layer)
             if getattr(layer, one.name) != one.default}  # fmt: skip
    return f"{type(layer).__name__} {found}"


def of_ros2(paths):
    found = read_ros2(paths)
    return [
        f"{node.name} {name}: {one.kind} {one.value!r} at {one.source.name}:{one.line}: {one.text}"
        + (f", not {one.ignored.value!r} in line {one.ignored.line}" if one.ignored else "")
        for node in found.nodes
        for name, one in node.entries
    ]


def of_ros1(paths):
    def values(namespace, before):
        for name, one in namespace.members.items():
            if isinstance(one, Ros1Namespace):
                yield from values(one, f"{before}{name}/")
            else:
                yield f"{before}{name}: {one.kind} {one.value!r} in line {one.line}: {one.text}"

    (path,) = paths
    file = read_ros1_parameters(path)
    return [*map(told, file.faults), *values(file.parameters, "")]


def of_lint(paths, maps=(), **options):
    """Return the findings, line by line, and hold each against the list of checks."""
    by_file = lint_parameters(paths, map_resolutions=maps, **options)
    found = [one for path in paths for one in by_file[path]]
    assert len(found) == sum(map(len, by_file.values()))
    assert all(one.severity == CHECKS[one.check].severity for one in found)
    told = [f"{one.check} at {Path(one.file).name}:{one.line}: {one.message}" for one in found]
    return [line.replace(f"{paths[0].parent}/", "") for line in told]


READERS = {
    "lint_nav2": of_lint,
    "lint_ros1": of_lint,
    "nav2": lambda paths, **options: robot_found(*nav2_robot(paths, **options)),
    "ros1": lambda paths, **options: robot_found(*ros1_robot(paths, **options)),
    "ros2_files": of_ros2,
    "ros1_files": of_ros1,
}


def read_case(kind, paths, options):
    try:
        return READERS[kind](paths, **options)
    except MalformedInputError as error:
        assert error.source == paths[0]
        line, hint = getattr(error, "line", None), error.hint
        return [f"refused in line {line}: {error.rule}" + (f"; hint: {hint}" if hint else "")]


class Readable(yaml.SafeDumper):
    """Writes texts of several lines as such."""


Readable.add_representer(str, lambda dumper, text: dumper.represent_scalar(
    "tag:yaml.org,2002:str", text, style="|" if "\n" in text else None))  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind, cases in CASES.items() for name in cases["cases"]]
)
def test_what_is_found_in_files(files, kind, name):
    case, good = CASES[kind]["cases"][name], CASES[kind]["good"]
    for before, after in case.get("replace", {}).items():
        assert before in good
        good = good.replace(before, after)
    texts = [
        text.replace("<good>\n", good) if isinstance(text, str) else text for text in case["files"]
    ]
    options = case.get("options", {})
    found = [line.encode("unicode_escape").decode() if not line.isprintable() else line
             for line in read_case(kind, files(*texts), options)]  # fmt: skip
    if "MAPDEAL_RECORD" in os.environ:
        case["found"] = found
        text = yaml.dump(CASES[kind], Dumper=Readable, sort_keys=False, width=1000)
        (FOLDER / f"{kind}.yaml").write_text(text, "utf-8")
    else:
        assert found == case["found"]
