"""Nav2's parameter files, against what the real code made of them and the rules of its sources."""

import json
import math
from functools import cache

import pytest

import mapdeal
from mapdeal.grid.costmap import InflationLayer, StaticLayer
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
def resolve(tmp_path):
    """Return what resolves texts as files, in their order."""

    def resolved(*texts, **options):
        paths = [tmp_path / f"{number}.yaml" for number in range(len(texts))]
        for path, text in zip(paths, texts, strict=True):
            path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return nav2_robot(paths, **options)

    return resolved


@pytest.fixture
def of_node(resolve):
    """Return what resolves lines of the global costmap's parameters, or of another node's."""

    def resolved(text, head=HEAD, **options):
        lines = "".join(f"      {line}\n" for line in text.splitlines())
        return resolve(head + lines, **options)

    return resolved


def told(problems):
    return [(one.check, one.level, one.parameter, one.line) for one in problems]


def refused(problems):
    return [one for one in problems if one.level == "refused"]


def with_line(text, line):
    """Return `GOOD` with a line of its own in place of the one with that key."""
    key = line.partition(":")[0]
    kept = [one for one in text.splitlines() if one.partition(":")[0] != key]
    return "\n".join([*kept, line])


def test_recorded_files_resolve_as_in_the_real_code(real_maps):
    recorded = json.loads((real_maps / "expected" / "params.json").read_text())
    cases = [case for case in recorded["cases"] if case["flavour"] == "nav2"]
    assert len(cases) == 116

    @cache  # many cases differ in their maps alone
    def resolved_as(files, costmap, namespace):
        return nav2_robot(
            [real_maps / name for name in files], costmap=costmap, namespace=namespace or None
        )

    for case in cases:
        costmap = case["costmap"].partition("_")[0]
        robot, problems = resolved_as(tuple(case["params_files"]), costmap, case["node_namespace"])
        if "one_level" in case["id"]:  # Nav2 takes nothing of it, and runs with its defaults
            assert told(problems) == [("params.one-level", "refused", "", 3)]
            assert case["resolved"]["robot_radius"] == 0.1
            continue
        assert _status(problems) == case["status"], case["id"]
        if robot is None:
            assert "obstacles.plugin" in case["error"]
            assert "obstacles.plugin" in refused(problems)[0].text
            continue
        resolved = case["resolved"]
        names = ("inscribed_radius", "circumscribed_radius", "padded_footprint", "use_radius",
                 "footprint_padding", "track_unknown_space", "rolling_window", "plugins",
                 "plugin_types", "filters", "ignored")  # fmt: skip
        ours = _as_recorded(robot)
        if case["static_layer_injected"]:  # it is no plugin of the file's, and has no type there
            ours["plugin_types"] = ours["plugin_types"][-len(resolved["plugin_types"]) :]
        assert {name: ours[name] for name in names} == {name: resolved[name] for name in names}
        if robot.robot_radius is not None:
            assert robot.robot_radius == resolved["robot_radius"]
        _compare_layers(robot, resolved)


def _status(problems):
    if refused(problems):
        return "refused"
    is_without = any(one.check == "params.no-static-layer" for one in problems)
    return "no_static_layer" if is_without else "ok"


def _as_recorded(robot):
    layers = [one for one in robot.layers if not one.is_filter]
    return {
        "inscribed_radius": robot.inscribed_radius,
        "circumscribed_radius": robot.circumscribed_radius,
        "padded_footprint": [list(corner) for corner in robot.footprint.vertices],
        "use_radius": robot.robot_radius is not None,
        "footprint_padding": robot.footprint_padding,
        "track_unknown_space": robot.track_unknown_space,
        "rolling_window": robot.rolling_window,
        "plugins": [one.name for one in layers],
        "plugin_types": [one.plugin for one in layers],
        "filters": [one.name for one in robot.layers if one.is_filter],
        "ignored": [
            ("filter " if one.is_filter else "") + f"{one.name} ({one.plugin})"
            for one in robot.ignored
        ],
    }


def _compare_layers(robot, resolved):
    found = {one.name: one for one in robot.layers if one.layer is not None}
    statics, inflations = resolved["static_layers"], resolved["inflation_layers"]
    assert set(found) == {*statics, *inflations}
    for name, values in statics.items():
        assert isinstance(found[name].layer, StaticLayer)
        for key in ("track_unknown_space", "lethal_cost_threshold", "unknown_cost_value",
                    "inscribed_obstacle_cost_value", "trinary_costmap", "use_maximum"):  # fmt: skip
            assert getattr(found[name].layer, key) == values[key]
        assert found[name].is_enabled == values["enabled"]
    for name, values in inflations.items():
        assert isinstance(found[name].layer, InflationLayer)
        for key in ("inflation_radius", "cost_scaling_factor", "inflate_unknown",
                    "inflate_around_unknown"):  # fmt: skip
            assert getattr(found[name].layer, key) == values[key]
        assert found[name].layer.inscribed_radius == values["inscribed_radius_used"]
        assert found[name].layer.lookup == "nav2"
        assert found[name].is_enabled == values["enabled"]


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.thorough)])
def test_files_of_public_robots_are_good_for_older_costmaps_too(real_maps, every):
    files = [
        path
        for path in sorted((real_maps / "params").rglob("*.yaml"))
        if "_synthetic" not in path.parts and "ros__parameters" in path.read_text()
    ]
    assert len(files) == 42
    for path in files[::every]:
        costmap = "global" if "\nglobal_costmap:" in path.read_text() else "local"
        robot, problems = nav2_robot([path], older=True, costmap=costmap)
        assert not refused(problems), path
        assert {one.lookup for one in robot.inflation_layers} <= {"exact"}


def test_a_good_file_has_nothing_to_tell(of_node):
    robot, problems = of_node(GOOD)
    assert problems == ()
    assert robot.node == "/global_costmap/global_costmap"
    assert robot.robot_radius == 0.22
    assert [one.path.name for one in robot.files] == ["0.yaml"]
    assert robot.static_layers == (
        StaticLayer("static_layer", True, 100, True, 255, inscribed_obstacle_cost_value=99),
    )
    (inflation,) = robot.inflation_layers
    assert (inflation.inflation_radius, inflation.cost_scaling_factor) == (0.55, 10.0)


def test_older_costmaps_have_exact_distances_and_no_rule_for_99(of_node):
    text = GOOD + "inflation_layer.custom_inscribed_radius: 0.5\n"
    text += "inscribed_obstacle_cost_value: none\ninflation_layer.num_threads: many\n"
    robot, problems = of_node(text, older=True)
    assert problems == ()
    assert robot.static_layers[0].inscribed_obstacle_cost_value is None
    (inflation,) = robot.inflation_layers
    assert inflation.lookup == "exact"
    assert inflation.inscribed_radius == robot.inscribed_radius
    assert [one.parameter for one in refused(of_node(text)[1])] == [
        "inscribed_obstacle_cost_value", "inflation_layer.num_threads",
    ]  # fmt: skip


def test_the_legacy_layer_has_exact_distances(of_node):
    text = GOOD.replace("::Inf", "::LegacyInf")
    text += "inflation_layer.custom_inscribed_radius: 0.5\n"
    robot, problems = of_node(text)
    assert problems == ()
    (inflation,) = robot.inflation_layers
    assert inflation.lookup == "exact"
    assert inflation.inscribed_radius == robot.inscribed_radius


WRONG_TYPES = {
    "robot_radius: 1": ("must be a double, is an integer", "write 1.0"),
    'robot_radius: "0.2"': ("must be a double, is a string", "write a number, without quotes"),
    "footprint_padding: 0": ("must be a double, is an integer", "write 0.0"),
    "width: 3.0": ("must be an integer, is a double", "write 3"),
    "height: 2.5": ("must be an integer, is a double", "write a whole number"),
    "track_unknown_space: 1": ("must be a bool, is an integer", "write true or false"),
    'trinary_costmap: "true"': ("must be a bool, is a string", "write true or false"),
    "unknown_cost_value: 255.0": ("must be an integer, is a double", "write 255"),
    "global_frame: 5": ("must be a string, is an integer", 'write "5"'),
    "footprint: [0.2, 0.1]": ("must be a string, is a list of doubles", 'write "[0.2, 0.1]"'),
    "plugins: static_layer": ("must be a list of strings, is a string", 'write ["static_layer"]'),
    "inflation_layer.inflation_radius: 1": ("must be a double, is an integer", "write 1.0"),
    "inflation_layer.enabled: 1": ("must be a bool, is an integer", "write true or false"),
    "static_layer.map_topic: true": ("must be a string, is a bool", 'write "true"'),
    "static_layer.plugin: 1": ("must be a string, is an integer", 'write "1"'),
    "publish_frequency: 2": ("must be a double, is an integer", "write 2.0"),
}


@pytest.mark.parametrize("line", WRONG_TYPES)
def test_values_of_another_type_are_refused(of_node, line):
    _, problems = of_node(with_line(GOOD, line))
    (one,) = refused(problems)
    rule, hint = WRONG_TYPES[line]
    assert one.check == "params.type"
    assert one.text == f"{rule}; Nav2 does not start"
    assert one.hint.startswith(hint)
    name, _, text = line.partition(": ")
    assert (one.parameter, one.got) == (name, text)
    assert one.line == len(with_line(GOOD, line).splitlines()) + 3


def test_a_number_of_another_type_still_means_what_it_says(of_node):
    robot, _ = of_node(with_line(GOOD, "inflation_layer.inflation_radius: 2"))
    assert robot.inflation_layers[0].inflation_radius == 2.0
    robot, _ = of_node(with_line(GOOD, "lethal_cost_threshold: 70.0"))
    assert robot.static_layers[0].lethal_cost_threshold == 70


SUBSTITUTIONS = ["robot_radius: $(var radius)", "trinary_costmap: <trinary>", "width: MAP_WIDTH",
                 "footprint: $(var footprint)"]  # fmt: skip


@pytest.mark.parametrize("line", SUBSTITUTIONS)
def test_what_launch_files_fill_in_is_refused_where_its_value_counts(of_node, line):
    _, problems = of_node(with_line(GOOD, line))
    (one,) = refused(problems)
    assert one.check == "params.substitution"
    assert "launch files replace it" in one.hint


def test_what_launch_files_fill_in_is_a_text_elsewhere(of_node):
    text = GOOD + "global_frame: $(var frame)\nstatic_layer.map_topic: <robot_namespace>/map\n"
    assert of_node(text)[1] == ()


def test_all_mistakes_are_found_at_once(of_node):
    text = """\
robot_radius: 1
width: -2
plugins: [static_layer, inflation_layer, extra]
static_layer: {plugin: "nav2_costmap_2d/StaticLayer"}
inflation_layer: {plugin: "nav2_costmap_2d::InflationLayer"}
filters: []
"""
    robot, problems = of_node(text)
    assert robot is None
    assert told(refused(problems)) == [
        ("params.empty", "refused", "filters", 9),
        ("params.type", "refused", "robot_radius", 4),
        ("params.not-positive", "refused", "width", 5),
        ("params.plugins", "refused", "static_layer.plugin", 7),
        ("params.plugins", "refused", "plugins", 6),
    ]
    assert refused(problems)[3].hint == "did you mean nav2_costmap_2d::StaticLayer?"


SIZES = ["width: 0", "height: -1", "resolution: 0.0", "resolution: .nan"]


@pytest.mark.parametrize("line", SIZES)
def test_sizes_that_are_none_are_refused(of_node, line):
    _, problems = of_node(with_line(GOOD, line))
    assert told(refused(problems)) == [
        ("params.not-positive", "refused", line.partition(":")[0], 9)
    ]
    is_size = line.startswith("resolution")
    assert bool(refused(of_node(with_line(GOOD, line), older=True)[1])) != is_size


NUMBERS = [
    "robot_radius: .nan", "robot_radius: 1e9",
    "footprint_padding: .inf", "inflation_layer.inflation_radius: .inf",
    "inflation_layer.cost_scaling_factor: -1.0",
]  # fmt: skip


@pytest.mark.parametrize("line", NUMBERS)
def test_numbers_that_no_costs_can_be_made_of_are_refused(of_node, line):
    _, problems = of_node(with_line(GOOD, line))
    (one,) = refused(problems)
    assert one.parameter == line.partition(":")[0]


def test_values_at_the_ends_of_what_counts(of_node):
    def inflation(line):
        return of_node(with_line(GOOD, line))[0].inflation_layers[0]

    assert inflation("inflation_layer.custom_inscribed_radius: 0.0").inscribed_radius == 0
    assert inflation("inflation_layer.custom_inscribed_radius: -0.1").inscribed_radius > 0.2
    assert inflation("inflation_layer.inflation_radius: -1.0").inflation_radius == 0
    padded, _ = of_node(with_line(GOOD, "footprint_padding: 0.1"))
    assert padded.footprint_padding == 0.10000000149011612  # a float in costmap_2d_ros.hpp


def test_an_enormous_radius_has_a_hint_like_others(of_node):
    _, problems = of_node(with_line(GOOD, "inflation_layer.custom_inscribed_radius: 1e308"))
    assert [one.hint for one in problems if one.check == "params.inflation-radius"] == [
        "set it to 1e+308 or more"
    ]


def test_a_radius_that_is_not_above_0_is_taken_as_nav2_takes_it(of_node):
    nothing, problems = of_node(with_line(GOOD, "robot_radius: 0.0"))
    assert told(problems) == [("params.range", "warning", "robot_radius", 8)]
    assert nothing.inscribed_radius == nothing.circumscribed_radius == 0  # padFootprint's sign0
    mirrored, problems = of_node(with_line(GOOD, "robot_radius: -0.3"))
    assert told(problems) == [("params.range", "warning", "robot_radius", 8)]
    same, _ = of_node(with_line(GOOD, "robot_radius: 0.3"))
    assert mirrored.inscribed_radius == pytest.approx(same.inscribed_radius, rel=1e-15)
    assert mirrored.circumscribed_radius == pytest.approx(same.circumscribed_radius, rel=1e-15)


def test_without_a_list_of_plugins_there_are_nav2s_own(of_node):
    robot, problems = of_node("robot_radius: 0.3\ntrack_unknown_space: true\n")
    assert problems == ()
    assert [(one.name, one.plugin.rpartition(":")[2]) for one in robot.layers] == [
        ("static_layer", "StaticLayer"), ("obstacle_layer", "ObstacleLayer"),
        ("inflation_layer", "InflationLayer"),
    ]  # fmt: skip
    listed = "plugins: [static_layer, obstacle_layer, inflation_layer]\n"
    listed += "track_unknown_space: true\n"
    assert of_node(f"robot_radius: 0.3\n{listed}")[0].layers == robot.layers
    _, problems = of_node("robot_radius: 0.3\nplugins: [static_layer, inflation_layer]\n")
    assert [one.text for one in refused(problems)] == [
        "static_layer is listed, but has no static_layer.plugin; Nav2 does not start",
        "inflation_layer is listed, but has no inflation_layer.plugin; Nav2 does not start",
    ]
    assert '{plugin: "nav2_costmap_2d::InflationLayer"}' in refused(problems)[1].hint


CLASSES = {
    "nav2_costmap_2d::VoxelLayer": (None, "reads sensors"),
    "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer": (None, "reads sensors"),
    "nav2_costmap_2d/NonPersistentVoxelLayer": (None, "reads sensors"),
    "nav2_costmap_2d::DenoiseLayer": ("params.not-modelled", "not modelled: removes small groups"),
    "nav2_costmap_2d::PluginContainerLayer": (
        "params.not-modelled",
        "not modelled: contains layers",
    ),
    "my_robot::GradientLayer": ("params.not-modelled", "not modelled: a custom class"),
    "nav2_costmap_2d::KeepoutFilter": (None, "a filter without its mask"),
    "nav2_costmap_2d/VoxelLayer": ("params.plugins", "nav2_costmap_2d::VoxelLayer"),
    "costmap_2d::ObstacleLayer": ("params.plugins", "nav2_costmap_2d::ObstacleLayer"),
    "StaticLayer": ("params.plugins", "nav2_costmap_2d::StaticLayer"),
    "nav2_costmap_2d::InflationLayers": ("params.plugins", "nav2_costmap_2d::InflationLayer"),
}


@pytest.mark.parametrize("kind", CLASSES)
def test_classes_of_layers(of_node, kind):
    text = GOOD.replace("[static_layer,", "[static_layer, more,") + f'more.plugin: "{kind}"\n'
    robot, problems = of_node(text)
    check, said = CLASSES[kind]
    if check == "params.plugins":
        assert [one.hint for one in refused(problems)] == [f"did you mean {said}?"]
        return
    assert [one.check for one in problems] == ([] if check is None else [check])
    (more,) = robot.ignored
    assert more.why_ignored.startswith(said)
    off = of_node(text + "more.enabled: false\n")
    assert off[1] == ()
    assert not off[0].ignored[0].is_enabled


def test_types_in_layers_of_sensors_end_the_real_node_alone(of_node):
    text = GOOD.replace("[static_layer,", "[static_layer, scans,")
    text += "scans: {plugin: nav2_costmap_2d::ObstacleLayer, observation_sources: a b}\n"
    text += "scans.b.max_obstacle_height: 2\nscans.c.max_obstacle_height: 2\n"
    robot, problems = of_node(text)
    assert robot is not None
    assert told(problems) == [("params.sensor-type", "warning", "scans.b.max_obstacle_height", 10)]
    assert problems[0].hint == "write 2.0"


def test_filters_come_after_all_layers(of_node):
    text = GOOD + "filters: [zones]\nzones.plugin: nav2_costmap_2d::KeepoutFilter\n"
    robot, problems = of_node(text + "zones.enabled: KEEPOUT_ZONE_ENABLED\n")
    assert problems == ()
    assert [(one.name, one.is_filter) for one in robot.layers][-1] == ("zones", True)
    _, problems = of_node(GOOD + "filters: [zones]\n")
    assert told(refused(problems)) == [("params.plugins", "refused", "filters", 9)]


def test_a_footprint_wins_over_a_radius(of_node):
    corners = "[[0.3, 0.2], [0.3, -0.2], [-0.4, -0.2], [-0.4, 0.2]]"
    robot, problems = of_node(GOOD + f'footprint: "{corners}"\nfootprint_padding: 0.25\n')
    assert told(problems) == []  # lint alone says that the radius has no effect
    assert robot.robot_radius is None
    assert robot.footprint_padding == 0.25
    assert robot.footprint.vertices[0] == (0.25 + 0.30000001192092896, 0.25 + 0.20000000298023224)
    assert robot.inscribed_radius == 0.25 + 0.20000000298023224


def test_a_footprint_that_is_none_gives_way_to_the_radius(of_node):
    for text in ("[[0.3, 0.2], [0.3, -0.2]]", "[[1, 2], [3, 4], [5]]", "round", " []"):
        robot, problems = of_node(GOOD + f'footprint: "{text}"\n')
        assert told(problems) == [("params.footprint-unused", "warning", "footprint", 9)]
        assert "uses robot_radius of 0.22 m" in problems[0].text
        assert robot.robot_radius == 0.22
    for text in ('"[]"', '""'):
        assert of_node(GOOD + f"footprint: {text}\n")[1] == ()


def test_outlines_that_mean_little_are_warned_of(of_node):
    crossed = "[[1, 1], [-1, -1], [1, -1], [-1, 1]]"
    beside = "[[1, 1], [2, 1], [2, 2]]"
    for corners, what in ((crossed, "crosses itself"), (beside, "lies outside")):
        _, problems = of_node(with_line(GOOD, f'footprint: "{corners}"'))
        (one,) = [one for one in problems if one.check == "params.outline"]
        assert one.level == "warning"
        assert what in one.text


def test_without_a_shape_there_is_a_radius_of_a_tenth(of_node):
    robot, problems = of_node(GOOD.replace("robot_radius: 0.22\n", ""))
    assert told(problems) == [("params.no-shape", "warning", "", None)]
    assert robot.robot_radius == 0.1
    assert math.isclose(robot.inscribed_radius, 0.1 * math.cos(math.pi / 16) + 0.0097, abs_tol=1e-4)


def test_notes_and_warnings_of_nav2_itself(of_node):
    text = GOOD.replace("track_unknown_space: true\n", "")
    text += "static_layer.footprint_clearing_enabled: true\n"
    text += "inflation_layer.inflation_radius: 0.1\n"
    text += "inflation_layer.custom_inscribed_radius: 0.3\nlethal_cost_threshold: 150\n"
    robot, problems = of_node(text)
    assert sorted(told(problems)) == [
        ("params.custom-inscribed-radius", "warning",
         "inflation_layer.custom_inscribed_radius", 10),
        ("params.footprint-clearing", "note", "static_layer.footprint_clearing_enabled", 8),
        ("params.inflation-radius", "warning", "inflation_layer.inflation_radius", 9),
        ("params.range", "warning", "lethal_cost_threshold", 11),
    ]  # fmt: skip
    assert robot.inflation_layers[0].inscribed_radius == 0.3
    assert robot.static_layers[0].lethal_cost_threshold == 100
    assert robot.inscribed_radius != 0.3


def test_values_of_bytes_wrap_around(of_node):
    robot, _ = of_node(GOOD + "unknown_cost_value: -1\ninscribed_obstacle_cost_value: 306\n")
    assert robot.static_layers[0].unknown_cost_value == 255
    assert robot.static_layers[0].inscribed_obstacle_cost_value == 50


def test_a_value_hidden_by_one_of_another_type_is_warned_of(of_node):
    robot, problems = of_node(GOOD + "robot_radius: 0.5\n")
    assert (robot.robot_radius, problems) == (0.5, ())
    robot, problems = of_node(GOOD + 'footprint: "[]"\nfootprint: [0.1]\n')
    assert told(problems) == [("params.hidden", "warning", "footprint", 9)]
    assert "[0.1] on line 10" in problems[0].text


LOCAL = HEAD.replace("global", "local")


def test_a_local_costmap_gets_a_layer_that_reads_the_map(of_node):
    text = "robot_radius: 0.2\nplugins: [inflation_layer]\nlethal_cost_threshold: 60\n" + INFLATION
    robot, problems = of_node(text, LOCAL, costmap="local")
    assert [one.name for one in robot.layers] == ["injected_static", "inflation_layer"]
    assert robot.static_layers[0].lethal_cost_threshold == 60
    assert told(problems) == []
    robot, problems = of_node(text, costmap="global")
    assert told(problems)[0] == ("params.no-static-layer", "warning", "plugins", 5)
    assert problems[0].text.endswith("all cells are 0, free")
    assert robot.static_layers == ()


def test_a_static_layer_that_is_off_reads_no_map(of_node):
    robot, problems = of_node(GOOD + "static_layer.enabled: false\n")
    assert told(problems) == [("params.no-static-layer", "warning", "static_layer.enabled", 9)]
    assert robot.static_layers == ()


ONE = "  global_costmap:\n    global_costmap:\n      ros__parameters: {robot_radius: 0.2}\n"


def test_namespaces(resolve):
    plain, two = "\n" + HEAD + "      robot_radius: 0.3\n", "a:\n" + ONE + "b:\n" + ONE
    robot, _ = resolve(plain)
    assert robot.robot_radius == 0.3
    robot, problems = resolve("a:\n" + ONE)
    assert robot.node == "/a/global_costmap/global_costmap"
    assert told(problems)[0][:2] == ("params.only-namespace", "warning")
    robot, problems = resolve(two)
    assert robot is None
    assert "in the namespaces a, b" in problems[0].text
    assert problems[0].hint == "choose one with --namespace a"
    robot, problems = resolve(two, namespace="/b/")
    assert robot.node == "/b/global_costmap/global_costmap"
    assert "params.namespace" not in [one.check for one in problems]
    robot, problems = resolve(two, namespace="c")
    assert robot is None
    assert "namespaces with such a node: a, b" in problems[0].text
    robot, problems = resolve(plain, namespace="c")
    assert problems[0].hint.startswith("leave --namespace out")
    robot, problems = resolve(plain + two)
    assert robot.robot_radius == 0.3


def test_wildcards_set_parameters_of_any_node(resolve):
    anywhere = "/**:\n  ros__parameters: {robot_radius: 0.4, use_sim_time: true}\n"
    robot, _ = resolve(anywhere, namespace="x")
    assert robot.robot_radius == 0.4
    robot, _ = resolve(anywhere + HEAD + "      robot_radius: 0.3\n")
    assert robot.robot_radius == 0.3
    robot, _ = resolve(HEAD + "      robot_radius: 0.3\n" + anywhere)
    assert robot.robot_radius == 0.4


OF_OTHERS = {
    "amcl: {ros__parameters: {alpha1: 0.2}}": "/amcl",
    "/**: {ros__parameters: {use_sim_time: true}}": "/**",
    "/**: {ros__parameters: {robot_base_frame: b, transform_tolerance: 0.1}}": "/**",
    "/**: {ros__parameters: {GridBased: {plugin: nav2_navfn_planner::NavfnPlanner}}}": "/**",
    "/global_costmap/global_costmap_client: {ros__parameters: {robot_radius: 0.3}}":
        "/global_costmap/global_costmap_client",
    "/*: {ros__parameters: {robot_radius: 0.3}}": "/*",
    "local_costmap: {local_costmap: {ros__parameters: {robot_radius: 0.3}}}":
        "/local_costmap/local_costmap",
}  # fmt: skip


@pytest.mark.parametrize("text", OF_OTHERS)
def test_files_of_other_nodes_alone_are_refused(resolve, text):
    robot, problems = resolve(text)
    assert robot is None
    assert told(problems) == [("params.no-node", "refused", "", None)]
    own = "/global_costmap/global_costmap"
    assert problems[0].text == f"holds no parameter of {own}; it has {OF_OTHERS[text]}"
    is_local = "local" in text
    assert problems[0].hint.startswith("--costmap local" if is_local else "pass the file that has")


ONE_LEVEL = "global_costmap:\n  ros__parameters: {robot_radius: 0.3}\n"


def test_a_costmap_that_is_named_once_is_refused(resolve):
    for text in (ONE_LEVEL, "/" + ONE_LEVEL, "planner_server/" + ONE_LEVEL, "a/" + ONE_LEVEL):
        robot, problems = resolve(text)
        assert robot is None
        assert told(problems) == [("params.one-level", "refused", "", 2)]
        assert problems[0].hint.startswith("nest the name twice: global_costmap: global_costmap:")
    for local in (HEAD.replace("global", "local"), "/**/local_costmap:\n    ros__parameters:\n"):
        _, problems = resolve(ONE_LEVEL + local + "      robot_radius: 0.2\n")
        assert told(problems) == [("params.one-level", "refused", "", 2)]


def test_a_costmap_that_is_named_once_beside_its_own_name_is_warned_of(resolve):
    for own in (HEAD, "/**:\n  ros__parameters:\n", "/*/global_costmap:\n  ros__parameters:\n"):
        robot, problems = resolve(own + "      robot_radius: 0.2\n", ONE_LEVEL)
        assert robot.robot_radius == 0.2
        assert told(problems)[0] == ("params.one-level", "warning", "", 2)
        assert problems[0].source.name == "1.yaml"


NAMED = {  # for which of the namespaces none, a and a/b a name means the costmap
    "/global_costmap/global_costmap": [""],
    "global_costmap/global_costmap": [""],
    "/**/global_costmap": ["", "a", "a/b"],
    "**/global_costmap": ["", "a", "a/b"],
    "/*/global_costmap": [""],
    "/*/*/global_costmap": ["a"],
    "/global_costmap/*": [""],
    "/global_costmap/**": [""],
    "/**/global_costmap/**": ["", "a", "a/b"],
    "/a/**": ["a", "a/b"],
    "/a/**/global_costmap": ["a", "a/b"],
    "/a/*/*": ["a"],
    "/**": ["", "a", "a/b"],
    "**": ["", "a", "a/b"],
    "/*/*": [""],
    "/*/global_costmap/global_costmap": ["a"],
    "/amcl": [],
    "/global_costmap": [],
    "/global_costmap/global_costmap_client": [],
    "/*/amcl": [],
}


@pytest.mark.parametrize("name", NAMED)
def test_a_costmap_is_meant_where_rclcpps_expression_matches(resolve, name):
    import re  # its own, which no user's text reaches

    text = f"'{name}': {{ros__parameters: {{inflation_layer: {{inflation_radius: 0.8}}}}}}\n"
    expression = ("/" + name.removeprefix("/")).replace("/*", r"(/\w+)")
    for namespace in ("", "a", "a/b"):
        node = "/".join(["", *filter(None, [namespace]), "global_costmap/global_costmap"])
        is_meant = re.fullmatch(expression, node) is not None
        assert is_meant == (namespace in NAMED[name])
        robot, problems = resolve(text, namespace=namespace)
        assert (robot is not None) == is_meant
        if robot is not None:
            assert robot.node == node
            assert robot.inflation_layers[0].inflation_radius == 0.8
            assert [one.check for one in problems] == ["params.no-shape"]


def test_a_namespace_before_wildcards_is_found(resolve):
    text = "/a/**: {ros__parameters: {robot_radius: 0.4}}\n"
    robot, problems = resolve(text)
    assert robot.node == "/a/global_costmap/global_costmap"
    assert told(problems)[0][:2] == ("params.only-namespace", "warning")
    _, problems = resolve(text + "/b/**/global_costmap: {ros__parameters: {robot_radius: 0.4}}\n")
    assert "in the namespaces a, b" in problems[0].text
    _, problems = resolve("? /" + "a/" * 100_000 + "b\n: {ros__parameters: {x: 1}}\n")
    assert told(problems) == [("params.no-node", "refused", "", None)]


ASYMMETRIC = INFLATION.replace("d::Inf", "d::AsymmetricInf")


def test_asymmetric_inflation_without_a_path_is_that_of_the_larger_factor(of_node):
    """By the constructor and ``updateCosts`` of asymmetric_inflation_layer.cpp."""
    good = GOOD.replace(INFLATION, ASYMMETRIC)
    robot, problems = of_node(good)
    assert problems == ()
    inscribed = robot.inscribed_radius
    assert robot.inflation_layers == (
        InflationLayer("inflation_layer", inscribed_radius=inscribed, inflation_radius=2.0,
                       cost_scaling_factor=4.0, lookup="nav2"),
    )  # fmt: skip
    for left, right in ((5.0, 3.0), (3.0, 5.0), (6.0, 6.0), (1.0, None)):
        text = f"inflation_layer.cost_scaling_factor_left: {left}\n"
        text += f"inflation_layer.cost_scaling_factor_right: {right}\n" if right else ""
        text += "inflation_layer.cost_scaling_factor: 9.0\n"  # it reads none of that name
        text += "inflation_layer.custom_inscribed_radius: 0.5\n"
        robot, problems = of_node(good + text)
        (layer,) = robot.inflation_layers
        assert layer.cost_scaling_factor == max(left, right or 4.0)
        assert layer.inscribed_radius == inscribed
        assert [one.check for one in problems] == ["params.asymmetric"] * (left != right)
        if problems:
            assert problems[0].level == "note"
            assert f"raises costs {'left' if left < (right or 4.0) else 'right'} of" in (
                problems[0].text
            )


BELOW = {"inflation_radius": "-0.1", "cost_scaling_factor_left": "-1.0", "num_threads": "-2",
         "cost_scaling_factor_right": "-1.0", "goal_distance_threshold": "-0.5"}  # fmt: skip


@pytest.mark.usefixtures("mapdeal_warnings")
def test_asymmetric_inflation_makes_the_recorded_costs_of_inflation(real_maps, tmp_path):
    """Without a path its ``updateCosts`` is the inherited one, which was recorded."""
    recorded = json.loads((real_maps / "expected" / "params.json").read_text())["cases"]
    own = "params/ros-navigation__navigation2/nav2_bringup/params/nav2_params.yaml"
    text = (real_maps / own).read_text()
    text = text.replace("d::InflationLayer", "d::AsymmetricInflationLayer")
    text = text.replace("cost_scaling_factor: 3.0", "cost_scaling_factor_right: 3.0\n"
                        "        cost_scaling_factor_left: 1.5")  # fmt: skip
    path = tmp_path / "nav2_params.yaml"
    path.write_text(text)
    robot, _ = nav2_robot([path])
    cases = [case for case in recorded if case["params_files"] == [own]]
    cases = [case for case in cases if case["costmap"] == "global_costmap"]
    assert len(cases) == 3
    for case in cases:
        grid = mapdeal.read_map(real_maps / case["map"])
        cost = mapdeal.apply_recipe(grid, robot)["cost"].cost
        assert sum_of(cost) == case["distance_transform"]["sha256"]


def test_asymmetric_inflation_ends_the_node_where_its_constructor_throws(of_node):
    good = GOOD.replace(INFLATION, ASYMMETRIC)
    for name, value in BELOW.items():
        _, problems = of_node(f"{good}inflation_layer.{name}: {value}\n")
        (one,) = refused(problems)
        assert (one.check, one.parameter) == ("params.not-positive", f"inflation_layer.{name}")
    _, problems = of_node(good + "transform_tolerance: -0.1\n")
    assert told(refused(problems)) == [("params.not-positive", "refused", "transform_tolerance", 9)]
    assert of_node(GOOD + "transform_tolerance: -0.1\n")[1] == ()
    _, problems = of_node(good + "inflation_layer.cost_scaling_factor_left: 3\n")
    assert [one.hint for one in refused(problems)] == ["write 3.0"]


def test_a_container_of_layers_that_make_the_costs_is_refused(of_node):
    text = GOOD.replace("[static_layer, inflation_layer]", "[static_layer, box]")
    text += "box: {plugin: nav2_costmap_2d::PluginContainerLayer, plugins: [a, inside]}\n"
    text += "box.a.plugin: nav2_costmap_2d::ObstacleLayer\nbox.inside.plugin: "
    _, problems = of_node(text + "nav2_costmap_2d::InflationLayer\n")
    assert told(refused(problems)) == [("params.plugins", "refused", "box.inside.plugin", 11)]
    _, problems = of_node(text + "nav2_costmap_2d::VoxelLayer\n")
    assert [one.check for one in problems] == ["params.not-modelled"]
    _, problems = of_node(text + "nav2_costmap_2d::InflationLayer\nbox.enabled: false\n")
    assert problems == ()


def test_what_the_parser_refuses_is_one_problem(resolve):
    for text, line in ((HEAD + "      footprint: [[1, 2], [3, 4]]\n", 4), (b"\xff", None)):
        robot, problems = resolve(text)
        assert robot is None
        assert told(problems) == [("params.syntax", "refused", "", line)]
        assert problems[0].source.name == "0.yaml"


def test_long_lists_and_names_take_no_long_time(of_node):
    names = ", ".join(f"l{index}" for index in range(300))
    _, problems = of_node(f"robot_radius: 0.2\nplugins: [{names}]\n")
    assert [one.text for one in refused(problems)] == ["more than 200 layers and filters"]
    text = GOOD.replace("[static_layer,", "[static_layer, more,") + "more: {plugin: "
    _, problems = of_node(f'{text}"{"a" * 100_000}", enabled: true}}\n')
    assert [one.check for one in problems] == ["params.not-modelled"]


def test_footprints_have_an_end(of_node):
    for corners in ("[1, 1]" * 2001, "[1, 1][1, -1][-2e3, 0]"):
        robot, problems = of_node(with_line(GOOD, f'footprint: "[{corners}]"'))
        assert robot is None
        assert [one.check for one in refused(problems)] == ["params.too-large"]


def test_lists_of_another_type_are_refused_wherever_they_are_asked(of_node):
    text = "robot_radius: 0.2\nplugins: [static_layer, more]\nfilters: 5\n" + STATIC
    robot, problems = of_node(text)
    assert robot is None
    assert [one.parameter for one in refused(problems)] == ["filters", "plugins"]


def test_static_layers_of_different_maps_are_warned_of(of_node):
    text = GOOD.replace("[static_layer,", "[static_layer, zones,")
    text += "zones: {plugin: nav2_costmap_2d::StaticLayer, map_topic: /zones}\n"
    _, problems = of_node(text)
    assert told(problems) == [("params.other-map", "warning", "zones.map_topic", 9)]
    assert "reads zones, another map than map" in problems[0].text
    assert of_node(text.replace("/zones}", "/map}"))[1] == ()
    assert of_node(text.replace("/zones}", "/zones, enabled: false}"))[1] == ()
