"""Explanations of checks and their examples; checks of parameter files by `cases`."""

import re
from pathlib import Path

import pytest
import yaml

from checks.pairs import ROOM, good_yaml, painted, pgm
from drawn import grid_from_text
from mapdeal import write_map
from mapdeal.checks.findings import CHECKS, declare_checks, parse_explanation
from mapdeal.checks.lint import check_parameters, lint_file
from mapdeal.checks.parameter_checks import lint_parameters

NAV2 = """\
robot_radius: 0.2
track_unknown_space: true
plugins: [static_layer, obstacle_layer, inflation_layer]
static_layer: {plugin: "nav2_costmap_2d::StaticLayer"}
obstacle_layer: {plugin: "nav2_costmap_2d::ObstacleLayer"}
inflation_layer:
  {plugin: "nav2_costmap_2d::InflationLayer", inflation_radius: 0.55, cost_scaling_factor: 3.0}
"""
ROS1 = """\
robot_radius: 0.2
track_unknown_space: true
plugins:
  - {name: static_layer, type: "costmap_2d::StaticLayer"}
  - {name: inflation_layer, type: "costmap_2d::InflationLayer"}
inflation_layer: {inflation_radius: 0.55, cost_scaling_factor: 3.0}
"""
NOT_RUN = {
    "params.alias",  # of the text, not of its values
    "params.hidden", "params.repeated", "params.twice",  # two lines
    "params.planner-turning-radius",  # with a map
    "params.resolution",  # with a map
    "params.filter-topic", "params.filter-type", "params.filter-lifecycle",  # with servers
}  # fmt: skip


def snippet_of(name):
    """Return the first code in a check's example; None if it has none."""
    code = re.match(r"(?:ROS 1: )?`([^`]+)`", CHECKS[name].explanation.example)
    return code and code[1]


def is_yaml(name):
    return bool(re.match(r"(\{|[a-z_0-9]+:)( |$)?", snippet_of(name) or ""))


def merged(base, changes):
    result = dict(base)
    for key, value in changes.items():
        is_part = isinstance(value, dict) and isinstance(result.get(key), dict)
        result[key] = merged(result[key], value) if is_part else value
    return {key: value for key, value in result.items() if value is not None}


def costmap_of(parameters):
    return {"global_costmap": {"global_costmap": {"ros__parameters": parameters}}}


PARAMETERS = [n for n in CHECKS if n.startswith("params.") and is_yaml(n) and n not in NOT_RUN]
AREAS = ("file", "image", "thresholds", "yaml", "readers")
MAPS = [name for name in CHECKS if name.partition(".")[0] in AREAS and is_yaml(name)]


@pytest.mark.parametrize("name", CHECKS)
def test_every_check_explains_itself_in_a_few_short_sentences(name):
    texts = CHECKS[name].explanation
    assert all((texts.about, texts.why, texts.example, texts.fix))
    sentences = re.split(r"(?<=[.!?]) (?=[A-Za-z])", f"{texts.about} {texts.why} {texts.fix}")
    assert 3 <= len(sentences) <= 5
    assert all(sentence.endswith(".") for sentence in sentences)
    assert max(len(sentence.split()) for sentence in sentences) <= 30
    assert len(texts.fix.split()) <= 14
    assert texts.fix[0].isupper()


@pytest.mark.parametrize("text", [
    "", "Finds.", "Finds.\n\nWhy.\nExample: a.", "Finds.\n\nWhy.\nFix: b.\nExample: a.",
])  # fmt: skip
def test_an_explanation_without_one_of_its_parts_is_refused(text):
    with pytest.raises(ValueError, match="needs a summary"):
        parse_explanation(text)


def test_a_declaration_without_an_explanation_is_refused():
    before = dict(CHECKS)
    with pytest.raises(ValueError, match="needs a summary"):
        declare_checks("map.unexplained (note)\n    Something.\n")
    assert before == CHECKS


@pytest.mark.parametrize("name", MAPS)
def test_examples_of_map_checks_are_found(name, tmp_path):
    snippet = snippet_of(name)
    key, _, value = snippet.partition(": ")
    grey = re.search(r"pixels of grey (\d+)", CHECKS[name].explanation.example)
    image = pgm(painted(5, 5, int(grey[1])) if grey else ROOM)
    folder = tmp_path / "maps"
    folder.mkdir()
    for image_name in {"m.pgm", "../m.pgm", value if name == "yaml.image-unquoted" else "m.pgm"}:
        (folder / image_name).write_bytes(image)
    replaced = (key, "mode" if name == "yaml.legacy-mode" else key)
    lines = good_yaml(image="m.pgm").splitlines()
    lines = [line for line in lines if line.partition(":")[0] not in replaced]
    (folder / "m.yaml").write_text("\n".join([*lines, snippet, ""]))
    assert name in [finding.check for finding in lint_file(folder / "m.yaml")]


def test_islands_are_found_and_the_bases_of_the_examples_have_no_finding(tmp_path):
    write_map(tmp_path / "m.npz", grid_from_text(snippet_of("map.islands"), 1.0))
    assert "map.islands" in [finding.check for finding in lint_file(tmp_path / "m.npz")]
    path = tmp_path / "robot.yaml"
    for document in (yaml.safe_load(ROS1), costmap_of(yaml.safe_load(NAV2))):
        path.write_text(yaml.safe_dump(document, sort_keys=False))
        assert lint_parameters([path]) == {path: []}
    assert len(MAPS) + len(PARAMETERS) > 40  # examples that are run


@pytest.mark.parametrize("name", PARAMETERS)
def test_examples_of_parameter_checks_are_found(name, tmp_path):
    snippet, path = snippet_of(name), tmp_path / "robot.yaml"
    is_ros1 = CHECKS[name].explanation.example.startswith("ROS 1")
    changes = yaml.safe_load(snippet)
    if is_ros1:
        document = merged(yaml.safe_load(ROS1), changes)
    elif next(iter(changes)) in ("global_costmap", "planner_server"):
        document = {**costmap_of(yaml.safe_load(NAV2)), **changes}
    else:
        document = costmap_of(merged(yaml.safe_load(NAV2), changes))
    lines = yaml.safe_dump(document, sort_keys=False)
    path.write_text(f"{lines}{snippet}\n" if name == "params.empty" else lines)
    assert name in [finding.check for finding in lint_parameters([path])[path]]


CASES = Path(__file__).with_name("cases")

SERVERS = """\
global_costmap:
  global_costmap:
    ros__parameters:
      robot_radius: 0.3
      track_unknown_space: true
      plugins: ["static_layer"]
      static_layer: {plugin: "nav2_costmap_2d::StaticLayer"}
      filters: [keep]
      keep: {plugin: "nav2_costmap_2d::KeepoutFilter", filter_info_topic: /zones}
mask: {ros__parameters: {topic_name: /mask}}
all: {ros__parameters: {node_names: [mask, info]}}
info: {ros__parameters: {type: 1, filter_info_topic: /info, mask_topic: /mask}}
"""
FILTERS = [
    ("params.filter-topic", {}, 9, "waits for /zones, and the servers here publish info"),
    ("params.filter-topic", {"name: /mask": "name: /other"}, 12, "names the mask /mask"),
    ("params.filter-topic", {"filter_info_topic: /zones": "a: 1"}, 9, "has no filter_info_topic"),
    ("params.filter-type", {"/zones": "info"}, 12, "has type 1, and KeepoutFilter"),
    ("params.filter-type", {"/zones": "info", "type: 1": "base: 2.0"}, 12,
     "takes base 0.0 and multiplier 1.0 only"),
    ("params.filter-type", {"/zones": "info", "KeepoutFilter": "ZoneParameterFilter"}, 12,
     "info has type 1, and ZoneParameterFilter needs 4"),
    ("params.filter-lifecycle", {"/zones": "info", "[mask, info]": "[mask]"}, 12,
     "in no node_names"),
]  # fmt: skip


@pytest.mark.parametrize(("check", "changes", "line", "words"), FILTERS)
def test_filters_and_their_servers_go_together(tmp_path, check, changes, line, words):
    text = SERVERS
    for before, after in changes.items():
        text = text.replace(before, after)
    (tmp_path / "nav2.yaml").write_text(text)
    findings = lint_parameters([tmp_path / "nav2.yaml"])[tmp_path / "nav2.yaml"]
    found = [f for f in findings if f.check == check and words in f.message]
    assert [finding.line for finding in found] == [line]


def test_a_missing_file_is_a_finding_of_its_own(tmp_path):
    present, missing = tmp_path / "nav2.yaml", tmp_path / "gone.yaml"
    present.write_text(SERVERS)
    found = check_parameters([present, missing], "global", None, [])
    checks = {path.name: [f.check for f in findings.findings] for path, findings in found.items()}
    assert checks == {"nav2.yaml": [], "gone.yaml": ["file.access"]}


@pytest.mark.parametrize(("plugin", "count"), [("SpatioTemporalVoxelLayer", 1), ("OwnLayer", 0)])
def test_a_layer_of_other_packages_that_marks_belongs_before_inflation(tmp_path, plugin, count):
    path = tmp_path / "nav2.yaml"
    layers = f"""[inflate, marks]
      inflate: {{plugin: "nav2_costmap_2d::InflationLayer"}}
      marks: {{plugin: "x/{plugin}"}}"""
    path.write_text(SERVERS.replace('["static_layer"]', layers))
    checks = [finding.check for finding in lint_parameters([path])[path]]
    assert checks.count("params.layer-after-inflation") == count


def test_every_check_has_a_case():
    text = "".join(path.read_text("utf-8") for path in CASES.glob("lint_*.yaml"))
    covered = {f"params.{name}" for name in re.findall(r"- '?params\.([a-z-]+) at ", text)}
    covered.add("params.other-costmap")  # below
    covered |= {row[0] for row in FILTERS}
    assert covered == {name for name in CHECKS if name.startswith("params.")}


def test_files_are_of_the_costmaps_that_they_or_their_names_say(tmp_path):
    good = yaml.safe_load((CASES / "lint_ros1.yaml").read_text("utf-8"))["good"]
    static = '  - {name: static_layer, type: "costmap_2d::StaticLayer"}\n'
    plugins = good[good.index("plugins:") : good.index("inflation_layer:\n")]
    texts = {"common": good.replace(static, ""), "local_costmap": "width: 3\n",
             "costmap_global": plugins}  # fmt: skip
    paths = [tmp_path / f"{name}.yaml" for name in texts]
    for path in paths:
        path.write_text(texts[path.stem])
    assert not any(lint_parameters(paths).values())
    by_file = lint_parameters(paths, costmap="local")
    assert [finding.check for finding in by_file[paths[2]]] == ["params.other-costmap"]
    assert not any(lint_parameters(paths[:2]).values())  # no global costmap that could miss a map
    by_file = lint_parameters(paths[:1])
    assert [finding.check for finding in by_file[paths[0]]] == ["params.no-static-layer"]
