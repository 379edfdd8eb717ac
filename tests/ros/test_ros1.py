"""ROS 1's costmap files, against what the real code made of them and the rules of its sources."""

import json

import pytest

from mapdeal.grid.costmap import InflationLayer, StaticLayer
from mapdeal.ros.robot import Problem
from mapdeal.ros.ros1 import ros1_robot

FOOTPRINT = "footprint: [[-0.2, -0.1], [-0.2, 0.1], [0.3, 0.1], [0.3, -0.1]]\n"
PLUGINS = """\
plugins:
  - {name: static_layer, type: "costmap_2d::StaticLayer"}
  - {name: inflation_layer, type: "costmap_2d::InflationLayer"}
"""


@pytest.fixture
def resolve(files):
    """Return what reads texts as files, in their order."""
    return lambda *texts, **options: ros1_robot(files(*texts), **options)


def told(problems):
    return [(one.check, one.level, one.parameter, one.line) for one in problems]


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
        assert not [one for one in problems if one.level != "note"], case["id"]
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
    statics = [one for one in robot.layers if isinstance(one.layer, StaticLayer)]
    inflations = [one for one in robot.layers if isinstance(one.layer, InflationLayer)]
    return {
        "inscribed_radius": robot.inscribed_radius,
        "circumscribed_radius": robot.circumscribed_radius,
        "padded_footprint": [list(corner) for corner in robot.footprint.vertices],
        "footprint_padding": robot.footprint_padding,
        "robot_radius": robot.robot_radius,
        "track_unknown_space": robot.track_unknown_space,
        "ignored": [f"{one.name} ({one.plugin})" for one in robot.ignored],
        "plugins": [{"name": one.name, "type": one.plugin} for one in robot.layers],
        "static_layers": {
            one.name: {
                "track_unknown_space": one.layer.track_unknown_space,
                "lethal_cost_threshold": one.layer.lethal_cost_threshold,
                "unknown_cost_value": {255: -1}.get(one.layer.unknown_cost_value),
                "trinary_costmap": one.layer.trinary_costmap,
                "use_maximum": one.layer.use_maximum,
                "enabled": one.is_enabled,
            }
            for one in statics
        },
        "inflation_layers": {
            f"costmap/{one.name}": {
                "inflation_radius": one.layer.inflation_radius,
                "inscribed_radius_used": one.layer.inscribed_radius,
                "cost_scaling_factor": one.layer.cost_scaling_factor,
                "inflate_unknown": one.layer.inflate_unknown,
                "enabled": one.is_enabled,
            }
            for one in inflations
        },
    }


@pytest.mark.slow
def test_footprints_of_very_many_points_are_refused(resolve):
    corners = [[i, j] for i in range(25) for j in range(81)]
    robot, problems = resolve(f"static_map: true\nfootprint: {corners}\n")
    assert robot is None
    assert [(one.check, one.level, one.line) for one in problems] == [
        ("params.too-large", "refused", 2)
    ]
    assert resolve(f"static_map: true\nfootprint: {corners[:2000]}\n")[0] is not None


def test_many_problems_are_not_compared_with_each_other(resolve, monkeypatch):
    compared = []
    equal = Problem.__eq__
    monkeypatch.setattr(
        Problem, "__eq__", lambda one, other: compared.append(one) or equal(one, other)
    )
    _, problems = resolve("static_map: true\nrobot_radius: 0.3\n" + "a: 1\n" * 300)
    assert len(problems) == 299  # each on its own line
    assert len(compared) <= 3 * len(problems)
