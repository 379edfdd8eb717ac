"""ROS 1's costmap files, against recordings of the real code and the rules of its sources."""

import json

import pytest

from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.static import StaticLayer
from mapdeal.ros.robot import Problem
from mapdeal.ros.ros1 import ros1_robot


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
