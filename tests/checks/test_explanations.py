"""Explanations of checks: each has its parts, and what it gives as an example is found."""

import re

import pytest
import yaml

from checks.pairs import ROOM, good_yaml, painted, pgm
from drawn import grid_from_text
from mapdeal import write_map
from mapdeal.checks.findings import CHECKS, declare_checks, parse_explanation
from mapdeal.checks.lint import lint_file
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
    names = {"m.pgm", "../m.pgm", value if name == "yaml.image-unquoted" else "m.pgm"}
    for image_name in names:
        (folder / image_name).write_bytes(image)
    replaced = (key, "mode" if name == "yaml.legacy-mode" else key)
    lines = good_yaml(image="m.pgm").splitlines()
    lines = [line for line in lines if line.partition(":")[0] not in replaced]
    (folder / "m.yaml").write_text("\n".join([*lines, snippet, ""]))
    assert name in [finding.check for finding in lint_file(folder / "m.yaml")]


def test_the_example_of_islands_is_found(tmp_path):
    write_map(tmp_path / "m.npz", grid_from_text(snippet_of("map.islands"), 1.0))
    assert "map.islands" in [finding.check for finding in lint_file(tmp_path / "m.npz")]


@pytest.mark.parametrize("name", PARAMETERS)
def test_examples_of_parameter_checks_are_found(name, tmp_path):
    snippet, path = snippet_of(name), tmp_path / "robot.yaml"
    is_ros1 = CHECKS[name].explanation.example.startswith("ROS 1")
    changes = yaml.safe_load(snippet)
    if is_ros1:
        changed = merged(yaml.safe_load(ROS1), changes)
        lines = yaml.safe_dump(changed, sort_keys=False)
        path.write_text(f"{lines}{snippet}\n" if name == "params.empty" else lines)
    elif next(iter(changes)) in ("global_costmap", "planner_server"):
        nodes = {"global_costmap": {"global_costmap": {"ros__parameters": yaml.safe_load(NAV2)}}}
        nodes.update(changes)
        path.write_text(yaml.safe_dump(nodes, sort_keys=False))
    else:
        node = {"ros__parameters": merged(yaml.safe_load(NAV2), changes)}
        path.write_text(
            yaml.safe_dump({"global_costmap": {"global_costmap": node}}, sort_keys=False)
        )
    found = [finding.check for finding in lint_parameters([path])[path]]
    assert name in found


def test_the_bases_of_the_examples_have_no_finding(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text(ROS1)
    assert lint_parameters([path]) == {path: []}
    node = {"ros__parameters": yaml.safe_load(NAV2)}
    path.write_text(yaml.safe_dump({"global_costmap": {"global_costmap": node}}, sort_keys=False))
    assert lint_parameters([path]) == {path: []}


def test_most_examples_are_code_that_is_run():
    assert len(MAPS) + len(PARAMETERS) > 40
