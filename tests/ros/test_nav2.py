"""Nav2's parameter files, against recordings of the real code and the rules of its sources."""

import json
import re
from functools import cache

import pytest

import mapdeal
from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.static import StaticLayer
from mapdeal.ros.nav2 import nav2_robot
from recorded_costmaps import sum_of

HEAD = "global_costmap:\n  global_costmap:\n    ros__parameters:\n"
STATIC = 'static_layer: {plugin: "nav2_costmap_2d::StaticLayer"}\n'
INFLATION = 'inflation_layer: {plugin: "nav2_costmap_2d::InflationLayer"}\n'
GOOD = f"""\
robot_radius: 0.22
track_unknown_space: true
plugins: [static_layer, inflation_layer]
{STATIC}{INFLATION}"""


@pytest.fixture
def resolve(files):
    """Return a function that resolves texts as files, in their order."""
    return lambda *texts, **options: nav2_robot(files(*texts), **options)


@pytest.fixture
def of_node(resolve):
    """Return a function that resolves parameter lines of the global costmap or another node."""

    def resolve_lines(text, head=HEAD, **options):
        return resolve(head + "".join(f"      {line}\n" for line in text.splitlines()), **options)

    return resolve_lines


def summaries(problems):
    return [(problem.check, problem.level, problem.parameter, problem.line) for problem in problems]


def refused(problems):
    return [problem for problem in problems if problem.level == "refused"]


def with_line(text, line):
    key = line.partition(":")[0]
    return "\n".join([*(row for row in text.splitlines() if row.partition(":")[0] != key), line])


def test_recorded_files_resolve_as_in_the_real_code(real_maps):
    recorded = json.loads((real_maps / "expected" / "params.json").read_text())
    cases = [case for case in recorded["cases"] if case["flavour"] == "nav2"]
    assert len(cases) == 116

    @cache  # many cases differ in their maps alone
    def resolved_as(files, costmap, namespace):
        paths = [real_maps / name for name in files]
        return nav2_robot(paths, costmap=costmap, namespace=namespace or None)

    for case in cases:
        costmap = case["costmap"].partition("_")[0]
        robot, problems = resolved_as(tuple(case["params_files"]), costmap, case["node_namespace"])
        if "one_level" in case["id"]:  # Nav2 ignores the file and runs with its defaults
            assert summaries(problems) == [("params.one-level", "refused", "", 3)]
            assert case["resolved"]["robot_radius"] == 0.1
            continue
        assert _status(problems) == case["status"], case["id"]
        if robot is None:
            assert "obstacles.plugin" in case["error"]
            assert "obstacles.plugin" in refused(problems)[0].text
            continue
        resolved = case["resolved"]
        summary = _as_recorded(robot)
        if case["static_layer_injected"]:  # the file has no type for the layer
            summary["plugin_types"] = summary["plugin_types"][-len(resolved["plugin_types"]) :]
        assert summary == {name: resolved[name] for name in summary}
        if robot.robot_radius is not None:
            assert robot.robot_radius == resolved["robot_radius"]
        _compare_layers(robot, resolved)


def _status(problems):
    if refused(problems):
        return "refused"
    is_without = any(problem.check == "params.no-static-layer" for problem in problems)
    return "no_static_layer" if is_without else "ok"


def _as_recorded(robot):
    layers = [listed for listed in robot.layers if not listed.is_filter]
    names = ("inscribed_radius", "circumscribed_radius", "footprint_padding",
             "track_unknown_space", "rolling_window")  # fmt: skip
    return {
        **{name: getattr(robot, name) for name in names},
        "padded_footprint": [list(corner) for corner in robot.footprint.vertices],
        "use_radius": robot.robot_radius is not None,
        "plugins": [listed.name for listed in layers],
        "plugin_types": [listed.plugin for listed in layers],
        "filters": [listed.name for listed in robot.layers if listed.is_filter],
        "ignored": [f"{'filter ' * listed.is_filter}{listed.name} ({listed.plugin})"
                    for listed in robot.ignored],
    }  # fmt: skip


def _compare_layers(robot, resolved):
    modelled = [listed for listed in robot.layers if listed.layer is not None and not listed.needs]
    by_name = {listed.name: listed for listed in modelled}
    statics, inflations = resolved["static_layers"], resolved["inflation_layers"]
    assert set(by_name) == {*statics, *inflations}
    of_maps = [by_name[name].layer for name in statics if by_name[name].is_enabled]
    assert set(robot.static_layers) == set(of_maps)
    of_statics = ("track_unknown_space", "lethal_cost_threshold", "unknown_cost_value",
                  "inscribed_obstacle_cost_value", "trinary_costmap", "use_maximum")  # fmt: skip
    of_inflations = ("inflation_radius", "cost_scaling_factor", "inflate_unknown",
                     "inflate_around_unknown")  # fmt: skip
    for kind, keys, values in ((StaticLayer, of_statics, statics),
                               (InflationLayer, of_inflations, inflations)):  # fmt: skip
        for name, expected in values.items():
            assert isinstance(by_name[name].layer, kind)
            values_of_layer = {key: getattr(by_name[name].layer, key) for key in keys}
            assert expected.items() >= values_of_layer.items()
            assert by_name[name].is_enabled == expected["enabled"]
    for name, expected in inflations.items():
        assert by_name[name].layer.inscribed_radius == expected["inscribed_radius_used"]
        assert by_name[name].layer.lookup == "nav2"


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.thorough)])
def test_files_of_public_robots_are_good_for_older_costmaps_too(real_maps, every):
    paths = sorted((real_maps / "params").rglob("*.yaml"))
    files = [path for path in paths if "_synthetic" not in path.parts
             and "ros__parameters" in path.read_text()]  # fmt: skip
    assert len(files) == 42
    for path in files[::every]:
        costmap = "global" if "\nglobal_costmap:" in path.read_text() else "local"
        robot, problems = nav2_robot([path], up_to_kilted=True, costmap=costmap)
        assert not refused(problems), path
        assert {layer.lookup for layer in robot.inflation_layers} <= {"exact"}


NAMED = [
    "/global_costmap/global_costmap", "global_costmap/global_costmap", "/**/global_costmap",
    "**/global_costmap", "/*/global_costmap", "/*/*/global_costmap", "/global_costmap/*",
    "/global_costmap/**", "/**/global_costmap/**", "/a/**", "/a/**/global_costmap", "/a/*/*", "/**",
    "**", "/*/*", "/*/global_costmap/global_costmap", "/amcl", "/global_costmap",
    "/global_costmap/global_costmap_client", "/*/amcl",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize("namespace", ["", "a", "a/b"])
def test_names_apply_to_a_costmap_where_rclcpps_expression_matches(resolve, name, namespace):
    text = f"'{name}': {{ros__parameters: {{inflation_layer: {{inflation_radius: 0.8}}}}}}\n"
    expression = ("/" + name.removeprefix("/")).replace("/*", r"(/\w+)")  # as rclcpp makes it
    node = "/".join(["", *filter(None, [namespace]), "global_costmap/global_costmap"])
    robot, problems = resolve(text, namespace=namespace)
    assert (robot is not None) == (re.fullmatch(expression, node) is not None)
    if robot is not None:
        assert robot.node == node
        assert robot.inflation_layers[0].inflation_radius == 0.8
        assert robot.area == mapdeal.CostmapArea(50, 50, 0.1, (0.0, 0.0), is_rolling=False)
        assert [problem.check for problem in problems] == ["params.no-shape"]


@pytest.mark.usefixtures("mapdeal_warnings")
def test_asymmetric_inflation_makes_the_recorded_costs_of_inflation(real_maps, tmp_path):
    """Without a path its ``updateCosts`` is the inherited one, which was recorded."""
    recorded = json.loads((real_maps / "expected" / "params.json").read_text())["cases"]
    file_name = "params/ros-navigation__navigation2/nav2_bringup/params/nav2_params.yaml"
    text = (real_maps / file_name).read_text()
    text = text.replace("d::InflationLayer", "d::AsymmetricInflationLayer")
    text = text.replace("cost_scaling_factor: 3.0", "cost_scaling_factor_right: 3.0\n"
                        "        cost_scaling_factor_left: 1.5")  # fmt: skip
    path = tmp_path / "nav2_params.yaml"
    path.write_text(text)
    robot, _ = nav2_robot([path])
    cases = [case for case in recorded if case["params_files"] == [file_name]]
    cases = [case for case in cases if case["costmap"] == "global_costmap"]
    assert len(cases) == 3
    for case in cases:
        cost = mapdeal.apply_recipe(mapdeal.read_map(real_maps / case["map"]), robot)["cost"].cost
        assert sum_of(cost) == case["distance_transform"]["sha256"]


def test_long_lists_and_names_take_no_long_time(of_node, resolve):
    _, problems = resolve("? /" + "a/" * 100_000 + "b\n: {ros__parameters: {x: 1}}\n")
    assert summaries(problems) == [("params.no-node", "refused", "", None)]
    names = ", ".join(f"l{index}" for index in range(300))
    _, problems = of_node(f"robot_radius: 0.2\nplugins: [{names}]\n")
    assert [problem.text for problem in refused(problems)] == ["more than 200 layers and filters"]
    text = GOOD.replace("[static_layer,", "[static_layer, more,") + "more: {plugin: "
    _, problems = of_node(f'{text}"{"a" * 100_000}", enabled: true}}\n')
    assert [problem.check for problem in problems] == ["params.not-modelled"]


def test_footprints_with_too_many_or_too_distant_points_are_refused(of_node):
    for corners in ("[1, 1]" * 2001, "[1, 1][1, -1][-2e3, 0]"):
        robot, problems = of_node(with_line(GOOD, f'footprint: "[{corners}]"'))
        assert robot is None
        assert [problem.check for problem in refused(problems)] == ["params.too-large"]
