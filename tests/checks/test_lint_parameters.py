"""Checks of a robot's parameter files: each finds what it is about, and where."""

import re
from pathlib import Path

import pytest

import mapdeal
from mapdeal.checks.findings import CHECKS
from mapdeal.checks.parameter_checks import lint_parameters

GOOD = """\
footprint: [[-0.4, -0.3], [-0.4, 0.3], [0.4, 0.3], [0.4, -0.3]]
footprint_padding: 0
plugins:
  - {name: static_layer, type: "costmap_2d::StaticLayer"}
  - {name: obstacle_layer, type: "costmap_2d::ObstacleLayer"}
  - {name: inflation_layer, type: "costmap_2d::InflationLayer"}
inflation_layer:
  inflation_radius: 0.9
  cost_scaling_factor: 5.0
"""
# Circumscribed radius 0.5 m, inscribed 0.3 m.


def changed(before, after):
    assert before in GOOD
    return GOOD.replace(before, after)


ROUND = "robot_radius: 0.3\n" + GOOD.partition("\n")[2]
PLUGINS = GOOD[GOOD.index("plugins") : GOOD.index("inflation_layer:\n")]
STATIC = '  - {name: static_layer, type: "costmap_2d::StaticLayer"}\n'
INFLATION = '  - {name: inflation_layer, type: "costmap_2d::InflationLayer"}\n'

# What is wrong, the line that is told, and words of the message.
CASES = [
    ("params.syntax", "footprint: [[1, 2\n", 2, "not valid YAML"),
    ("params.other-kind", "image: a.pgm\nresolution: 0.1\norigin: [1, 2, 0]\n", None, "is a map"),
    ("params.empty", GOOD + "static_layer:\n", 10, "roslaunch exits"),
    ("params.name", GOOD + "1: 2\n", 10, "names must be text"),
    ("params.type", GOOD + "static_layer: {map_topic: 2024-01-01}\n", 10, "a date"),
    ("params.silent-default", changed("0.9", "'0.9'"), 8, "write 0.9, without quotes"),
    ("params.not-finite", changed("0.9", ".nan"), 8, "must be finite"),
    ("params.range", changed("5.0", "500"), 9, "dynamic_reconfigure makes it 100"),
    ("params.substitution", changed("0.9", "$(arg radius)"), 8, "a launch file would replace"),
    ("params.namespace", "local_costmap: {a: {x: 1}}\n", None, "no parameters of"),
    ("params.footprint", changed("[0.4, -0.3]]", "4]"), 1, "point 4 is not a pair of numbers"),
    ("params.footprint-unused", ROUND + "footprint: '[[1, 2]'\n", 10, "robot_radius is used"),
    ("params.no-shape", GOOD.partition("\n")[2], None, "a radius of 0.46 m"),
    ("params.plugins", changed("costmap_2d::InflationLayer", "costmap_2d::InflationLayr"), 4,
     "did you mean costmap_2d::InflationLayer?"),
    ("params.no-static-layer", changed(STATIC, ""), None, "does not read the map"),
    ("params.overridden", GOOD + "inflation_radius: 0.8\n", 8, "0.8, takes its place"),
    ("params.twice", changed("cost_scaling_factor: 5.0", "inflation_radius: 0.8"), 9, "8 and 9"),
    ("params.repeated", changed("cost_scaling_factor: 5.0", "inflation_radius: 0.9"), 9,
     "with one value"),
    ("params.inflation-radius", changed("0.9", "0.29"), 8, "less than the inscribed radius, 0.3 m"),
    ("params.inflation-below-circumscribed", changed("0.9", "0.49"), 8,
     "is below the circumscribed radius, 0.5 m"),
    ("params.no-inflation", changed("0.9", "0"), 8, "inflation_radius is 0"),
    ("params.cost-cliff", changed("5.0", "1.0"), 9, "costs drop from 138 to 0 at"),
    ("params.cost-ends-early", changed("5.0", "20"), 9, "costs are 0 from 0.576 m on"),
    ("params.inflation-defaults", changed("  inflation_radius: 0.9\n", ""), 8,
     "not set, and so inflation_radius is 0.55 m"),
    ("params.radius-and-footprint", GOOD + "robot_radius: 0.3\n", 10, "stands on line 1"),
    ("params.costmaps-differ",
     PLUGINS + "global_costmap: {robot_radius: 0.3}\nlocal_costmap: {robot_radius: 0.4}\n", 5,
     "in the global one 0.3"),
    ("params.resolution", GOOD + "resolution: 0.1\n", 10, "the map's, 0.05 m (m.yaml)"),
    ("params.layer-after-inflation", changed(INFLATION, "").replace(STATIC, INFLATION + STATIC), 4,
     "static_layer comes after inflation_layer: it overwrites the costs"),
    ("params.two-inflations",
     changed(INFLATION, INFLATION + INFLATION.replace("inflation_layer", "wide")), 4,
     "inflation_layer and wide both inflate"),
    ("params.layer-disabled", GOOD + "obstacle_layer: {enabled: false}\nstatic_layer: "
     "{enabled: false}\n", 11, "static_layer is switched off"),
    ("params.plugin-twice", changed(STATIC, STATIC + STATIC), 4, "listed 2 times"),
    ("params.unused-section", GOOD + "inflation_layers: {inflation_radius: 1.0}\n", 10,
     "did you mean inflation_layer?"),
    ("params.misspelt", changed("inflation_radius", "inflation_raduis"), 8,
     "did you mean inflation_radius?"),
    ("params.misplaced", GOOD + "static_layer: {robot_radius: 0.3}\n", 10,
     "static_layer/robot_radius has no effect"),
    ("params.without-effect", GOOD + "map_type: voxel\n", 10, "the layers are those of plugins"),
]  # fmt: skip


NAV2 = """\
global_costmap:
  global_costmap:
    ros__parameters:
      footprint: "[[-0.4, -0.3], [-0.4, 0.3], [0.4, 0.3], [0.4, -0.3]]"
      track_unknown_space: true
      plugins: ["static_layer", "obstacle_layer", "inflation_layer"]
      static_layer:
        plugin: "nav2_costmap_2d::StaticLayer"
      obstacle_layer:
        plugin: "nav2_costmap_2d::ObstacleLayer"
      inflation_layer:
        plugin: "nav2_costmap_2d::InflationLayer"
        inflation_radius: 0.9
        cost_scaling_factor: 5.0
"""

ELSEWHERE = {"params.other-costmap"}
"""Checks that have a test of their own below."""


def other(before, after):
    assert before in NAV2
    return NAV2.replace(before, after)


def more(text):
    """Return the good file of Nav2 with more parameters of its costmap."""
    return NAV2 + "".join(f"      {line}\n" for line in text.splitlines())


ROBOTS = "".join(
    f"{name}:\n" + "".join(f"  {line}\n" for line in NAV2.splitlines()) for name in "ab"
)
NAV2_CASES = [
    ("params.syntax", other("0.9", "- 0.9"), 13, ""),
    ("params.empty", more("filters: []"), 15, "has no value"),
    ("params.type", other("0.9", "1"), 13, "write 1.0"),
    ("params.sensor-type", other("obstacle_layer:\n", "obstacle_layer:\n        enabled: 1\n"), 10,
     "must be a bool, is an integer"),
    ("params.not-finite", other("0.9", ".nan"), 13, "must be finite"),
    ("params.not-positive", other("5.0", "-5.0"), 14, "must not be below 0"),
    ("params.range", more("lethal_cost_threshold: 101"), 15, "takes it for 100"),
    ("params.substitution", other("0.9", "$(var radius)"), 13, "launch files replace it"),
    ("params.namespace", ROBOTS, None, "in the namespaces a, b"),
    ("params.only-namespace", ROBOTS[: len(ROBOTS) // 2], None, "the namespace a, which is taken"),
    ("params.no-node", "a: {ros__parameters: {b: 1}}\n", None, "it has /a"),
    ("params.one-level", NAV2.replace("  global_costmap:\n", ""), 2, "nest the name twice"),
    ("params.asymmetric", other("d::Inf", "d::AsymmetricInf") +
     "        cost_scaling_factor_left: 3.0\n", 15, "raises costs left of the robot's path"),
    ("params.hidden", more('footprint: "[]"\nfootprint: [0.1]'), 15, "ROS 2 goes by the type"),
    ("params.footprint-unused", other(", [0.4, 0.3], [0.4, -0.3]]", "]"), 4, "needs three points"),
    ("params.too-large", other("-0.4, -0.3", "-4000, -0.3"), 4, "within 1000 m"),
    ("params.outline", other("-0.4", "0.1"), 4, "(0, 0) lies outside"),
    ("params.no-shape", other("footprint:", "foot:"), None, "a radius of 0.1 m"),
    ("params.plugins", other("d::InflationLayer", "d::InflationLayr"), 12, "did you mean"),
    ("params.not-modelled", other("d::ObstacleLayer", "d::DenoiseLayer"), 10, "is not modelled"),
    ("params.no-static-layer", other('"static_layer", ', ""), 6, "does not read the map"),
    ("params.other-map", other('"static_layer", ', '"static_layer", "zones", ') +
     "      zones: {plugin: nav2_costmap_2d::StaticLayer, map_topic: /zones}\n", 15,
     "another map than map"),
    ("params.footprint-clearing", other("static_layer:\n",
     "static_layer:\n        footprint_clearing_enabled: true\n"), 8, "frees the cells"),
    ("params.inflation-radius", other("0.9", "0.3"), 13, "set it to 0.311 or more"),
    ("params.custom-inscribed-radius", other("0.9", "0.9\n        custom_inscribed_radius: 0.2"),
     14, "takes the place"),
    ("params.inflation-below-circumscribed", other("0.9", "0.5"), 13, "circumscribed radius, 0.51"),
    ("params.unknown-is-free", other("track_unknown_space: true", "origin_x: 0.0"), 6,
     "the map's unknown cells cost 0"),
    ("params.unused-section", more("voxel_layer: {enabled: true, z_voxels: 16}"), 15,
     "voxel_layer is not in the list"),
    ("params.misspelt", other("inflation_radius", "inflation_raduis"), 13,
     "inflation_layer.inflation_raduis: did you mean inflation_radius?"),
    ("params.misplaced", more("inflation_radius: 0.7"), 15, "it belongs below inflation_layer"),
    ("params.misplaced", other("static_layer:\n", "static_layer:\n        trinary_costmap: true\n"),
     8, "it is a parameter of the costmap"),
    ("params.plugin-twice", other('["static_layer"', '["static_layer", "static_layer"'), 6,
     "listed 2 times"),
]  # fmt: skip


@pytest.fixture
def findings(tmp_path):
    """Return what makes findings of texts, file by file."""

    def found(*texts, **options):
        paths = [tmp_path / f"{number}.yaml" for number in range(len(texts))]
        for path, text in zip(paths, texts, strict=True):
            path.write_text(text)
        by_file = lint_parameters(paths, **options)
        assert all(one.file == str(path) for path, many in by_file.items() for one in many)
        return [one for many in by_file.values() for one in many]

    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "text", "line", "words"),
    [pytest.param(*case, id=f"{case[0]}-{kind}")
     for kind, cases in (("ros1", CASES), ("nav2", NAV2_CASES)) for case in cases],
)  # fmt: skip
def test_a_check_finds_what_it_is_about(findings, name, text, line, words):
    options = {} if name == "params.costmaps-differ" else {"costmap": "global"}
    found = findings(text, map_resolutions=[("m.yaml", 0.05)], **options)
    (one, *_) = [one for one in found if one.check == name and words in one.message]
    assert (one.severity, one.line) == (CHECKS[name].severity, line)
    assert one.message.isprintable()
    if name == "params.other-kind":  # ``origin`` is no misspelt ``origin_z``
        assert len(found) == 1


def test_every_check_has_a_case():
    covered = {name for name, *_ in [*CASES, *NAV2_CASES]} | ELSEWHERE
    assert covered == {name for name in CHECKS if name.startswith("params.")}


def test_findings_that_both_costmaps_have_are_told_once(findings):
    costmaps = "global_costmap: {width: 1}\nlocal_costmap: {width: 1}\n"
    found = findings(changed("0.9", "0.49"), costmaps)
    (one,) = [one for one in found if one.check != "params.no-static-layer"]
    assert (one.check, one.line) == ("params.inflation-below-circumscribed", 8)


def test_findings_without_a_line_name_their_costmap(findings):
    text = "global_costmap: {a: 1}\nlocal_costmap: {plugins: []}\n"
    messages = [one.message for one in findings(text) if one.check == "params.no-shape"]
    assert [one.partition(":")[0] for one in messages] == ["global costmap", "local costmap"]


def test_each_finding_is_told_of_its_own_file(findings):
    found = findings("robot_radius: 0.3\n", GOOD, "inflation_layer: {inflation_radius: '1'}\n")
    assert [(Path(one.file).name, one.check, one.line) for one in found] == [
        ("0.yaml", "params.radius-and-footprint", 1),
        ("2.yaml", "params.silent-default", 1),
    ]


def test_files_are_of_the_costmaps_that_they_or_their_names_say(tmp_path):
    names = ["common.yaml", "local_costmap.yaml", "costmap_global.yaml"]
    texts = [GOOD.replace(STATIC, ""), "width: 3\n", PLUGINS]
    paths = [tmp_path / name for name in names]
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text)
    assert not any(lint_parameters(paths).values())
    found = lint_parameters(paths, costmap="local")
    assert [one.check for one in found[paths[2]]] == ["params.other-costmap"]
    assert not any(lint_parameters(paths[:2]).values())  # no global costmap that could miss a map
    found = lint_parameters(paths[:1])
    assert [one.check for one in found[paths[0]]] == ["params.no-static-layer"]


def test_a_round_robot_may_have_any_heading(findings):
    near = ROUND.replace("0.9", "0.299")  # between the radii of the polygon of 16 corners
    assert findings(near.replace("5.0", "10.0")) != []
    assert "params.inflation-below-circumscribed" not in [one.check for one in findings(near)]


def test_maps_of_one_resolution_are_told_of_together(findings):
    maps = [("a.yaml", 0.05), ("b.yaml", 0.05), ("c.yaml", 0.1), ("d.yaml", 0.2), ("e.yaml", 0.05)]
    found = findings(GOOD + "resolution: 0.1\n", map_resolutions=maps)
    shown = [one.message.rpartition(", ")[2] for one in found if one.check == "params.resolution"]
    assert shown == ["0.05 m (a.yaml and 2 more)", "0.2 m (d.yaml)"]


ONCE = "global_costmap: {ros__parameters: {robot_radius: 0.3}}\n"
SIDES = other("d::Inf", "d::AsymmetricInf").replace("factor:", "factor_left:")
SIDES += "        cost_scaling_factor_right: 5.0\n        plan_topic: plan\n"
INDENTED = "".join(f"  {line}\n" for line in GOOD.splitlines())
SHAPELESS = changed("[0.4, -0.3]]", "4]").replace("0.9", "'0.9'").replace("5.0", "yes")
SHAPELESS += "static_layer: {robot_radius: 0.3}\ntrack_unknown_spcae: true\n"


@pytest.mark.parametrize(("text", "costmap", "expected"), [
    (GOOD, None, {}), (ROUND, None, {}), (NAV2, None, {}), (SIDES, None, {}),
    # the right one is 4, by default
    (SIDES.replace("_right: 5.0", "_rigth: 4.0"), None, {14: "asymmetric", 15: "misspelt"}),
    # a costmap that is named once is found beside any other
    (ONCE + NAV2.replace("global", "local"), None, {1: "one-level"}),
    (NAV2 + ONCE, None, {15: "one-level"}),
    (ONCE + ONCE.replace("global", "local"), None, {1: "one-level", 2: "one-level"}),
    (ONCE + "amcl: {ros__parameters: {alpha1: 0.2}}\n", None, {1: "one-level"}),
    # of a file of one costmap the other is not missed
    (f"global_costmap:\n{INDENTED}", None, {}), (f"local_costmap:\n{INDENTED}", None, {}),
    (f"local_costmap:\n{INDENTED}", "global", {None: "namespace"}),
    (SHAPELESS, None, {1: "footprint", 8: "silent-default", 9: "silent-default", 10: "misplaced",
                       11: "misspelt"}),
])  # fmt: skip
def test_all_that_is_found_in_a_file(findings, text, costmap, expected):
    options = {} if costmap is None else {"costmap": costmap}
    found = findings(text, map_resolutions=[("m.yaml", 0.05)], **options)
    told = [(one.line, one.check) for one in found]
    assert told == [(line, f"params.{check}") for line, check in expected.items()]


def test_problems_of_the_loaders_are_checks_of_one_severity():
    """By the source: a name that is no check would fail where its finding is made."""
    severities = {"refused": {"error"}, "warning": {"error", "warning"}, "note": {"note"}}
    sources = (Path(mapdeal.__file__).parent / "ros").glob("*.py")
    text = "\n".join(path.read_text() for path in sources)
    told = set(re.findall(r'"(params\.[a-z-]+)",\s*"(refused|warning|note)"', text))
    assert len(told) > 10
    assert not [one for one in told if CHECKS[one[0]].severity not in severities[one[1]]]
    assert set(re.findall(r'"(params\.[a-z-]+)"', text)) <= set(CHECKS)
