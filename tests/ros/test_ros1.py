"""ROS 1's costmap files, against what the real code made of them and the rules of its sources."""

import json

import pytest
import yaml

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
def resolve(tmp_path):
    """Return what resolves texts as files, in their order."""

    def resolved(*texts, **options):
        paths = [tmp_path / f"{number}.yaml" for number in range(len(texts))]
        for path, text in zip(paths, texts, strict=True):
            path.write_text(text)
        return ros1_robot(paths, **options)

    return resolved


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


# What is loaded where


def test_a_file_without_a_costmaps_name_is_loaded_into_the_one_that_is_asked_for(resolve):
    common, own = FOOTPRINT + PLUGINS, "local_costmap: {inflation_layer: {inflation_radius: 0.4}}"
    robot, _ = resolve(common, own, costmap="local")
    assert robot.node == "/move_base/local_costmap"
    assert robot.inflation_layers[0].inflation_radius == 0.4
    robot, _ = resolve(common, own, costmap="global")
    assert robot.inflation_layers[0].inflation_radius == 0.55


def test_later_files_come_before_earlier_ones(resolve):
    texts = ["inflation_layer: {inflation_radius: 0.7, cost_scaling_factor: 4}",
             "global_costmap: {inflation_layer: {inflation_radius: 0.9}}"]  # fmt: skip
    robot, _ = resolve(FOOTPRINT + PLUGINS, *texts)
    assert robot.inflation_layers[0].inflation_radius == 0.9
    assert robot.inflation_layers[0].cost_scaling_factor == 4.0
    robot, _ = resolve(FOOTPRINT + PLUGINS, *reversed(texts))
    assert robot.inflation_layers[0].inflation_radius == 0.7


@pytest.mark.parametrize(
    ("top", "namespace", "node"),
    [
        ("global_costmap: {%s}", None, "/move_base/global_costmap"),
        ("move_base: {global_costmap: {%s}}", None, "/move_base/global_costmap"),
        ("move_base_flex: {global_costmap: {%s}}", None, "/move_base_flex/global_costmap"),
        ("a: {move_base: {global_costmap: {%s}}}", None, "/a/move_base/global_costmap"),
        ("a: {move_base: {global_costmap: {%s}}}", "/a/", "/a/move_base/global_costmap"),
        ("/a/move_base/global_costmap: {%s}", None, "/a/move_base/global_costmap"),
        ("global_costmap: {%s}", "b/c", "/b/c/move_base/global_costmap"),
        ("global_costmap/robot_radius: 0.2", None, "/move_base/global_costmap"),
    ],
)
def test_costmaps_are_found_below_nodes_and_namespaces(resolve, top, namespace, node):
    robot, _ = resolve(top.replace("%s", "robot_radius: 0.2"), namespace=namespace)
    assert (robot.node, robot.robot_radius) == (node, 0.2)


def test_of_several_robots_one_must_be_named(resolve):
    text = "\n".join(
        f"{name}: {{move_base: {{global_costmap: {{robot_radius: {radius}}}}}}}"
        for name, radius in (("a", 0.2), ("b", 0.3))
    )
    robot, (problem,) = resolve(text)
    assert robot is None
    assert (problem.check, problem.level) == ("params.namespace", "refused")
    assert problem.hint == "choose one with --namespace a"
    assert resolve(text, namespace="b")[0].robot_radius == 0.3
    robot, (problem,) = resolve(text, namespace="c")
    assert robot is None
    assert problem.hint == "namespaces are a, b"


def test_files_of_the_other_costmap_alone_give_nothing(resolve):
    robot, (problem,) = resolve("local_costmap: {robot_radius: 0.2}")
    assert robot is None
    assert problem.text == "no parameters of /move_base/global_costmap"


# The shape


def test_a_list_is_printed_with_six_digits_and_read_as_float32(resolve):
    robot, _ = resolve(
        "footprint: [[0.1234567, 1], [-1, 1], [-1.0e-7, -2]]\nfootprint_padding: 0\n" + PLUGINS
    )
    # 0.123457 and 1e-07 as IEEE 754 singles
    assert robot.footprint.vertices == (
        (0.12345699965953827, 1.0), (-1.0, 1.0), (-1.0000000116860974e-07, -2.0),
    )  # fmt: skip


def test_a_string_is_a_footprint_too(resolve):
    listed, _ = resolve(FOOTPRINT + PLUGINS)
    robot, problems = resolve(
        FOOTPRINT.replace("footprint: ", "footprint: '").replace("\n", "'\n") + PLUGINS
    )
    assert robot.footprint == listed.footprint
    assert told(problems) == []


def test_padding_moves_each_corner_outwards(resolve):
    robot, _ = resolve("footprint: [[1, 0], [0, 2], [-4, -0.5]]\nfootprint_padding: 0.25\n")
    assert robot.footprint.vertices == ((1.25, 0.0), (0.0, 2.25), (-4.25, -0.75))


@pytest.mark.parametrize(
    ("text", "radius"),
    [
        ("global_costmap: {robot_radius: 0.3}", 0.3),
        ("robot_radius: 0.2\nglobal_costmap: {robot_radius: 0.3}", 0.3),
        ("robot_radius: 0.2\nglobal_costmap: {width: 3}", 0.2),
        ("/robot_radius: 0.2\nglobal_costmap: {width: 3}", 0.2),
        ("global_costmap: {robot_radius: 0.3, footprint: '[]'}", 0.3),
        ("global_costmap: {robot_radius: 0.3, footprint: ''}", 0.3),
        ("global_costmap: {width: 3}", 0.46),
        ("global_costmap: {robot_radius: '0.3'}", 1.234),
        ("global_costmap: {robot_radius: 3e-1}", 1.234),
        ("global_costmap: {robot_radius: 12}", 10.0),
    ],
)
def test_the_radius_is_searched_for_upwards(resolve, text, radius):
    robot, _ = resolve(text)
    assert robot.robot_radius == radius
    # the polygon of 16 corners, padded by 0.01: its first corner is on the x axis
    assert robot.footprint.vertices[0] == (radius + 0.01, 0.0)
    assert len(robot.footprint.vertices) == 16


def test_a_footprint_nearer_to_the_costmap_hides_one_above(resolve):
    above = (
        "footprint: [[1, 1], [-1, 1], [0, -1]]\nglobal_costmap: {footprint: %s, robot_radius: 2}"
    )
    assert resolve(above.replace("%s", "'[]'"))[0].robot_radius == 2.0
    assert resolve(above.replace("footprint: %s, ", ""))[0].robot_radius is None


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("[[1, 1], [0, 1]]", "a footprint needs three points or more, has 2; move_base exits"),
        ("[[1, 1], [0, 1], 3]", "point 3 is not a pair of numbers; move_base exits"),
        ("[[1, 1], [0, 1, 2], [1, 0]]", "point 2 is not a pair of numbers; move_base exits"),
        ("[[1, 1], [0, '1'], [1, 0]]", "point 2 is not a pair of numbers; move_base exits"),
        ("[[1, 1], [0, yes], [1, 0]]", "point 2 is not a pair of numbers; move_base exits"),
        ("[[1, 1], [0, .inf], [1, 0]]", "point 2 is out of range; move_base exits"),
        ("[]", "a footprint needs three points or more, has 0; move_base exits"),
    ],
)
def test_a_list_that_is_no_polygon_ends_move_base(resolve, value, text):
    robot, problems = resolve(f"robot_radius: 0.3\nfootprint: {value}\n{PLUGINS}")
    assert robot is None
    assert told(problems) == [("params.footprint", "refused", "footprint", 2)]
    assert problems[0].text == text


@pytest.mark.parametrize(
    "value", ["'[[1, 1], [0, 1]]'", "'[[1, 1], [0, 1], [1, 0]'", "5", "{a: 1}"]
)
def test_what_else_is_no_footprint_leaves_the_radius(resolve, value):
    robot, problems = resolve(f"robot_radius: 0.3\nfootprint: {value}\n{PLUGINS}")
    assert robot.robot_radius == 0.3
    assert told(problems) == [("params.footprint-unused", "warning", "footprint", 2)]


def test_a_bad_string_without_a_radius_leaves_no_shape(resolve):
    robot, problems = resolve("footprint: '[[1, 1]'\n" + PLUGINS)
    assert robot is None
    assert told(problems) == [("params.footprint", "refused", "footprint", 1)]


# The layers


def test_without_plugins_the_layers_are_those_of_old(resolve):
    robot, _ = resolve(
        FOOTPRINT + "static_map: true\nmap_type: voxel\ninflation_radius: 0.8\n"
        "cost_scaling_factor: 2\nlethal_cost_threshold: 60\nunknown_cost_value: 0\n"
        "track_unknown_space: false\n"
    )
    assert [(one.name, one.plugin) for one in robot.layers] == [
        ("static_layer", "costmap_2d::StaticLayer"),
        ("obstacle_layer", "costmap_2d::VoxelLayer"),
        ("inflation_layer", "costmap_2d::InflationLayer"),
    ]
    assert robot.effective_layers == (
        StaticLayer("static_layer", track_unknown_space=False, lethal_cost_threshold=60,
                    unknown_cost_value=0),
        InflationLayer("inflation_layer", robot.inscribed_radius, 0.8, 2.0),
    )  # fmt: skip


def test_without_plugins_the_map_is_read_only_if_static_map_is_true(resolve):
    for text in ("", "static_map: false\n", "static_map: 'true'\n", "static_map: 1\n"):
        robot, problems = resolve(FOOTPRINT + text)
        assert robot.static_layers == ()
        assert "params.no-static-layer" in [one.check for one in problems]


def test_a_local_costmap_without_a_static_layer_gets_one_in_front(resolve):
    robot, problems = resolve(FOOTPRINT, costmap="local")
    assert robot.effective_layers[0] == StaticLayer("injected_static")
    assert told(problems) == []


def test_defaults_of_both_layers(resolve):
    robot, problems = resolve(FOOTPRINT + PLUGINS)
    assert robot.effective_layers == (
        StaticLayer("static_layer", True, 100, True, 255, None, False),
        InflationLayer(
            "inflation_layer", robot.inscribed_radius, 0.55, 10.0, False, False, "exact"
        ),
    )
    assert (robot.track_unknown_space, robot.rolling_window) == (False, False)
    assert told(problems) == []


def test_each_parameter_of_the_layers_is_read(resolve):
    robot, problems = resolve(
        FOOTPRINT + PLUGINS + "rolling_window: true\n"
        "static_layer: {enabled: false, trinary_costmap: false, use_maximum: true,\n"
        "  track_unknown_space: false, lethal_cost_threshold: 30, unknown_cost_value: 300}\n"
        "inflation_layer: {enabled: true, inflate_unknown: true, inflation_radius: 1,\n"
        "  cost_scaling_factor: 3}\n"
    )
    assert [one.layer for one in robot.layers] == [
        StaticLayer("static_layer", False, 30, False, 300 - 256, None, True),
        InflationLayer("inflation_layer", robot.inscribed_radius, 1.0, 3.0, inflate_unknown=True),
    ]
    assert [one.is_enabled for one in robot.layers] == [False, True]
    assert robot.rolling_window
    assert told(problems) == []


def test_what_the_costmap_says_takes_the_place_of_what_its_layers_say(resolve):
    robot, problems = resolve(
        FOOTPRINT + PLUGINS + "inflation_layer: {inflation_radius: 0.3}\ninflation_radius: 0.8\n"
        "track_unknown_space: false\nstatic_layer: {track_unknown_space: true}\n"
    )
    assert robot.inflation_layers[0].inflation_radius == 0.8
    assert not robot.static_layers[0].track_unknown_space
    assert told(problems) == [
        ("params.overridden", "warning", "static_layer/track_unknown_space", 8),
        ("params.overridden", "warning", "inflation_layer/inflation_radius", 5),
    ]


def test_wrong_types_are_told_of_with_the_default_that_ros_takes(resolve):
    robot, problems = resolve(
        FOOTPRINT + PLUGINS + "rolling_window: 1\n"
        "inflation_layer:\n  inflation_radius: '0.7'\n  cost_scaling_factor: 1e1\n  enabled: 1\n"
        "static_layer:\n  lethal_cost_threshold: 64.5\n  trinary_costmap: 'false'\n"
        "  unknown_cost_value: none\n"
    )
    assert robot.static_layers[0].lethal_cost_threshold == 65
    assert robot.inflation_layers[0].inflation_radius == 0.55
    assert [(one.parameter, one.line, one.text, one.hint) for one in problems] == [
        ("rolling_window", 5, "must be true or false; roscpp silently uses its default, false",
         "write true"),
        ("static_layer/lethal_cost_threshold", 11,
         "must be a whole number; roscpp rounds it to 65", None),
        ("static_layer/trinary_costmap", 12,
         "must be true or false; roscpp silently uses its default, true", "write false"),
        ("static_layer/unknown_cost_value", 13,
         "must be a whole number; roscpp silently uses its default, -1", None),
        ("inflation_layer/inflation_radius", 7,
         "must be a number; roscpp silently uses its default, 0.55 m",
         "write 0.7, without quotes"),
        ("inflation_layer/cost_scaling_factor", 8,
         "must be a number; roscpp silently uses its default, 10",
         "write 10.0; YAML 1.1 takes this for text"),
        ("inflation_layer/enabled", 9,
         "must be true or false; roscpp silently uses its default, true", "write true"),
    ]  # fmt: skip
    assert {one.check for one in problems} == {"params.silent-default"}


@pytest.mark.parametrize(
    ("written", "whole"), [("2.4", 2), ("2.5", 3), ("-1.2", -2), ("-1.8", -2), ("-3.0", -3)]
)
def test_numbers_are_rounded_as_roscpp_does(resolve, written, whole):
    robot, _ = resolve(FOOTPRINT + PLUGINS + f"unknown_cost_value: {written}\n")
    assert robot.static_layers[0].unknown_cost_value == whole % 256


def test_numbers_out_of_range_are_moved_into_it(resolve):
    robot, problems = resolve(
        FOOTPRINT + PLUGINS + "inflation_radius: 60\ncost_scaling_factor: -1\n"
        "lethal_cost_threshold: 101\n"
    )
    layer = robot.inflation_layers[0]
    assert (layer.inflation_radius, layer.cost_scaling_factor) == (50.0, 0.0)
    assert robot.static_layers[0].lethal_cost_threshold == 100
    assert sorted(told(problems)) == [
        ("params.range", "warning", "cost_scaling_factor", 6),
        ("params.range", "warning", "inflation_radius", 5),
        ("params.range", "warning", "lethal_cost_threshold", 7),
    ]


@pytest.mark.parametrize(
    ("entry", "text"),
    [
        ("static_layer", "entry 2 must be a name and a type; move_base exits"),
        ("{type: x}", "entry 2 has no name; move_base exits"),
        ("{name: x}", "entry 2 has no type; move_base exits"),
        ("{name: x, type: 3}", "entry 2 has no type; move_base exits"),
        ("{name: x, type: 'costmap_2d::StaticLayr'}",
         "entry 2 has an unknown type, costmap_2d::StaticLayr; move_base exits"),
        ("{name: x, type: 'nav2_costmap_2d::InflationLayer'}",
         "entry 2 has an unknown type, nav2_costmap_2d::InflationLayer; move_base exits"),
    ],
)  # fmt: skip
def test_plugins_that_cannot_be_loaded_end_move_base(resolve, entry, text):
    robot, problems = resolve(
        FOOTPRINT + f"plugins:\n  - {{name: a, type: 'costmap_2d::InflationLayer'}}\n  - {entry}\n"
    )
    assert robot is None
    assert [one.text for one in problems if one.level == "refused"] == [text]


def test_plugins_must_be_a_list(resolve):
    robot, problems = resolve(FOOTPRINT + "plugins: static_layer\n")
    assert robot is None
    assert told(problems)[0] == ("params.plugins", "refused", "plugins", 2)


def test_layers_of_others_and_of_sensors_are_ignored(resolve):
    robot, _ = resolve(
        FOOTPRINT + PLUGINS + "  - {name: r, type: 'range_sensor_layer::RangeSensorLayer'}\n"
        "  - {name: o, type: 'costmap_2d::ObstacleLayer'}\n"
        "  - {name: n, type: 'costmap_2d::NonPersistentVoxelLayer'}\n"
    )
    assert [(one.name, one.why_ignored) for one in robot.ignored] == [
        ("r", "not of costmap_2d; needs live data"), ("o", "reads sensors"),
        ("n", "not of costmap_2d; needs live data"),
    ]  # fmt: skip


# What launch files fill in


def test_substitutions_matter_where_a_value_is_wanted(resolve):
    robot, problems = resolve(
        "robot_radius: $(arg radius)\nscan: {topic: $(arg topic)}\n"
        "inflation_layer: {inflation_radius: $(optenv R 0.5)}\n" + PLUGINS
    )
    assert told(problems) == [
        ("params.substitution", "refused", "robot_radius", 1),
        ("params.substitution", "refused", "inflation_layer/inflation_radius", 3),
    ]
    assert robot is None
    robot, problems = resolve(FOOTPRINT + PLUGINS + "scan: {topic: $(arg topic)}\n")
    assert told(problems) == []


def test_nothing_is_raised_for_what_a_file_holds(resolve):
    robot, problems = resolve("a: [1\n", FOOTPRINT + "x:\n")
    assert robot is None
    assert told(problems) == [
        ("params.syntax", "refused", "", 2), ("params.empty", "refused", "x", 2),
    ]  # fmt: skip


@pytest.mark.parametrize(
    "text", ["robot_radius: .nan", "footprint_padding: .inf", "inflation_radius: .nan"]
)
def test_numbers_that_are_not_finite_are_refused(resolve, text):
    _, problems = resolve(text + "\n" + PLUGINS)
    assert [one.check for one in problems if one.level == "refused"] == ["params.not-finite"]


def test_numbers_in_hints_are_numbers_to_yaml(resolve):
    _, problems = resolve("static_map: true\nrobot_radius: 1e-5\n")
    (hint,) = [one.hint for one in problems if one.parameter == "robot_radius"]
    assert hint == "write 1.0e-05; YAML 1.1 takes this for text"
    assert yaml.safe_load("1.0e-05") == 1e-5


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
