"""Checks of a robot's parameter files, whose cases are ``tests/ros/cases/lint_*.yaml``."""

import re
from pathlib import Path

import pytest
import yaml

from mapdeal.checks.findings import CHECKS
from mapdeal.checks.lint import check_parameters
from mapdeal.checks.parameter_checks import lint_parameters

CASES = Path(__file__).parents[1] / "ros" / "cases"

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
