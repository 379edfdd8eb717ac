import json
import re
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from mapdeal import OccupancyGrid, write_map
from mapdeal.checks.findings import CHECKS

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def maps(here):
    """A folder with a good map, a turned one, and another YAML file."""
    cells = np.pad(np.zeros((7, 12), np.int8), 1, constant_values=100)
    Path("maps/old").mkdir(parents=True)
    for name, yaw in (("good", 0.0), ("old/turned", 0.5)):
        write_map(f"maps/{name}.yaml", OccupancyGrid(cells, 0.25, (1.0, -2.0, yaw)))
    Path("maps/params.yaml").write_text("x: 1\n")
    return here


def test_a_folder_is_gated_by_one_line(sh, maps):
    message = "yaw 0.5 rad is ignored by costmap_2d and AMCL; lint --fix turns the cells"
    code, out, err = sh("lint maps")
    line, total = out.splitlines()
    assert (code, line) == (0, f"maps/old/turned.yaml:4: warning: yaml.origin-yaw: {message}")
    assert total == "2 maps: 0 errors, 1 warning, 0 notes"
    assert err == "note: 1 YAML file without the key image was left out: maps/params.yaml\n"
    assert sh("lint maps -q") == (0, f"{line}\n", "")


@pytest.mark.parametrize(("words", "code"), [
    ("--select image", 0), ("--select image,yaml.origin-yaw", 1),
    ("--select image --select yaml.", 1), ("--ignore yaml.origin-yaw", 0),
    ("--ignore 'map, yaml'", 0), ("--ignore map", 1), ("--select all", 1), ("--ignore ''", 2),
    ("--jobs 2", 1), ("", 1),
])  # fmt: skip
def test_what_is_selected_decides_the_exit_code(sh, maps, words, code):
    found, out, err = sh(f"lint maps --strict {words}")
    assert found == code, err
    assert (out == "") == (code > 1)


def test_the_command_line_comes_before_files_and_what_these_suppress_is_counted(sh, maps):
    rules = '[tool.mapdeal.lint]\nignore = ["yaml.origin-yaw"]\nstrict = true\n'
    Path("maps/pyproject.toml").write_text(rules)
    codes = [sh(f"lint maps {words}")[0] for words in ("", "--select yaml", "--no-config --strict")]
    assert codes == [0, 1, 1]
    Path("maps/pyproject.toml").unlink()
    with Path("maps/old/turned.yaml").open("a") as file:
        file.write("# mapdeal: ignore yaml\n")
    line = "2 maps: 0 errors, 0 warnings, 0 notes, 1 suppressed\n"
    assert sh("lint maps --strict")[:2] == (0, line)
    document = sh.json("lint maps --format json")
    assert [part["suppressed"] for part in document["maps"]] == [0, 1]
    assert document["suppressed"] == 1


@pytest.mark.parametrize(("form", "start", "end"), [
    ("json -q", "{", "}\n"), ("json -v", "{", "}\n"), ("sarif", "{", "}\n"),
    ("junit -v", "<?xml", "</testsuites>\n"), ("github", "::warning file=", "cells\n"),
])  # fmt: skip
def test_stdout_holds_the_report_alone(sh, maps, form, start, end):
    code, out, err = sh(f"lint maps maps/good.yaml --strict --format {form}")
    assert (code, out.startswith(start), out.endswith(end)) == (1, True, True)
    if start == "{":
        json.loads(out)
    assert ("1 map was named more than once, and is checked once" in err) == (form != "json -q")
    if form.startswith("json"):
        assert sh("lint maps maps/good.yaml --strict --json")[:2] == (1, out)
    else:
        line = f"lint maps maps/good.yaml --json --format {form}"
        assert "--format: cannot be given together with --json" in sh.err(line, 2)


def test_a_link_to_nothing_beside_a_good_map_is_an_error(sh, maps):
    for name, target in {"gone.yaml": "x.yaml", "loop.yaml": "loop.yaml", "site": "y"}.items():
        Path("maps", name).symlink_to(target)
    code, out, _ = sh("lint maps")
    lines = [line for line in out.splitlines() if ": error: file.access: " in line]
    found = {line.split(": ")[0]: line for line in lines}
    assert code == 1
    assert set(found) == {"maps/gone.yaml", "maps/loop.yaml", "maps/site"}
    assert "cannot be read: it is a link to nothing" in found["maps/gone.yaml"]
    assert "Too many levels of symbolic links" in found["maps/loop.yaml"]
    assert sh("lint maps/g*.yaml")[0] == 1
    # a run of the folder, too, says so of each, and goes on with the others
    assert sh("run maps -o o --no-images -j 1")[0] == 5
    entries = json.loads(Path("o/summary.json").read_text())["maps"]
    assert {entry["map"]: (entry["status"], entry.get("exit_code")) for entry in entries} == {
        "good.yaml": ("done", None), "old/turned.yaml": ("done", None),
        **dict.fromkeys(("gone.yaml", "loop.yaml", "site"), ("failed", 4)),
    }  # fmt: skip
    assert sh("info maps/gone.yaml")[0] == 4


def test_names_come_from_standard_input(sh, maps, monkeypatch):
    Path("names.txt").write_text("maps/old/*.yaml\n")
    with open("names.txt") as names:
        monkeypatch.setattr(sys, "stdin", names)
        code, out, err = sh("lint @- --strict")
    assert (code, err) == (1, "")
    assert out.splitlines()[-1] == "1 map: 0 errors, 1 warning, 0 notes"


_, _, TEXT = (EXAMPLES / "robots/five_mistakes.yaml").read_text().partition("\n")
ROBOT = TEXT.replace("  inflation_layer:\n", "  resolution: 0.05\n  inflation_layer:\n")
FIVE_MISTAKES = [(line, "warning", f"params.{name}") for line, name in (
    (2, "radius-and-footprint"), (5, "layer-after-inflation"), (10, "silent-default"),
    (11, "misspelt"), (13, "silent-default"),
)]  # fmt: skip
ROBOT_LINT = "lint --params-file robot.yaml"
NAV2 = """\
{0}_costmap:
  {0}_costmap:
    ros__parameters:
      robot_radius: 0.2
      track_unknown_space: true
      plugins: [s]
      s: {{plugin: "nav2_costmap_2d::StaticLayer"}}
"""


@pytest.fixture
def robot(here):
    Path("robot.yaml").write_text(ROBOT)


def test_a_file_that_nav2_refuses_ends_with_1(sh, here):
    Path("nav2.yaml").write_text(
        'global_costmap: {global_costmap: {ros__parameters: {robot_radius: "0.3", plugins: [s],\n'
        's: {plugin: "nav2_costmap_2d::StaticLayr"}}}}\n'
    )
    code, out, _ = sh("lint --params-file nav2.yaml --select params.type,params.plugins")
    first, second, total = out.splitlines()
    assert first.startswith("nav2.yaml:1: error: params.type: robot_radius: must be a double")
    assert second.startswith("nav2.yaml:2: error: params.plugins: s.plugin: unknown class")
    assert second.endswith("; did you mean nav2_costmap_2d::StaticLayer?")
    assert (code, total) == (1, "1 parameter file: 2 errors, 0 warnings, 0 notes")
    for own in ("MyStaticLayer", "SimpleStaticLayer"):  # other packages' in the namespace
        Path("own.yaml").write_text(Path("nav2.yaml").read_text().replace("StaticLayr", own))
        assert "params.plugins" not in sh("lint --params-file own.yaml")[1]


def test_every_form_of_the_report_lists_five_mistakes_with_their_lines(sh, robot):
    assert sh.ok(ROBOT_LINT).splitlines()[-1] == "1 parameter file: 0 errors, 5 warnings, 0 notes"
    assert sh(f"{ROBOT_LINT} --strict")[0] == 1
    document = sh.json(f"{ROBOT_LINT} --format json")
    (entry,) = document["parameter_files"]
    found = [(line["line"], line["severity"], line["check"]) for line in entry["findings"]]
    assert (entry["file"], document["maps"], found) == ("robot.yaml", [], FIVE_MISTAKES)
    (run,) = sh.json(f"{ROBOT_LINT} --format sarif")["runs"]
    places = [result["locations"][0]["physicalLocation"] for result in run["results"]]
    found = [(p["artifactLocation"]["uri"], p["region"]["startLine"]) for p in places]
    assert found == [("robot.yaml", line) for line, *_ in FIVE_MISTAKES]
    github = sh(f"{ROBOT_LINT} --format github")[1].splitlines()
    assert github[0].startswith("::warning file=robot.yaml,line=2,title=params.radius-and-")
    assert len(github) == len(FIVE_MISTAKES)
    assert '<testcase name="robot.yaml" classname=".">' in sh(f"{ROBOT_LINT} --format junit")[1]


def test_parameters_and_maps_are_linted_together(sh, maps, robot):
    out = sh("lint maps --params-file robot.yaml --select params,yaml")[1]
    message = "the static layer takes the map's, 0.25 m (good.yaml and 1 more); remove it"
    line = f"robot.yaml:8: note: params.resolution: resolution 0.05 m has no effect: {message}\n"
    assert line in out
    assert "maps/old/turned.yaml:4: warning: yaml.origin-yaw" in out
    assert out.splitlines()[-1].startswith("1 parameter file, 2 maps: ")


def test_rules_count_for_parameter_files(sh):
    ignored = ROBOT.replace("0.3\n", "0.3 # mapdeal: ignore params.misspelt\n", 1)
    Path("robot.yaml").write_text(ignored)
    out = sh(ROBOT_LINT)[1]
    assert "params.misspelt" not in out
    assert out.splitlines()[-1] == "1 parameter file: 0 errors, 4 warnings, 0 notes, 1 suppressed"
    Path("mapdeal.toml").write_text("[lint]\nstrict = true\n")
    assert sh(ROBOT_LINT)[0] == 1
    nothing = "1 parameter file: 0 errors, 0 warnings, 0 notes\n"
    assert sh(f"{ROBOT_LINT} --ignore params")[1] == nothing


@pytest.mark.parametrize(("words", "code", "text"), [
    ("--params-file none.yaml", 1, "none.yaml: error: file.access: "),
    ("--params-file robot.yaml --costmap local", 1, "no parameters of"),
    ("--params-file robot.yaml --namespace a", 0, "params.misspelt"),
])  # fmt: skip
def test_options_of_parameter_files(sh, robot, words, code, text):
    found, out, err = sh(f"lint {words}")
    assert (found, text in out + err) == (code, True)


def test_a_parameter_file_is_recognised_among_maps(sh, maps, robot):
    Path("nav2.yaml").write_text(NAV2.format("global"))
    Path("common.yaml").write_text("obstacle_range: 2.0\n")
    assert sh("lint robot.yaml") == sh(ROBOT_LINT)
    out = sh("lint maps/good.yaml robot.yaml --select params,yaml")[1]
    assert out == sh("lint maps/good.yaml --params-file robot.yaml --select params,yaml")[1]
    files = "nav2.yaml maps/good.yaml common.yaml robot.yaml"
    code, out, _ = sh(f"lint {files} --select params --ignore params.resolution")
    found = [line.partition(": ")[0] for line in out.splitlines()]
    assert (code, found[0], len(found)) == (0, "nav2.yaml:6", 2 + len(FIVE_MISTAKES))
    assert found[1:-1] == [f"robot.yaml:{line}" for line, *_ in FIVE_MISTAKES]
    assert out.splitlines()[-1].startswith("3 parameter files, 1 map: ")
    assert sh("lint nav2.yaml --costmap local")[0] == 1
    assert sh("lint nav2.yaml --fix --in-place")[0] == 2
    assert sh("lint maps --costmap local")[0] == 2


@pytest.mark.parametrize("text", [
    NAV2.format("global"), "global_costmap: {plugins: []}\n", "robot_radius: 0.2\n",
])  # fmt: skip
def test_files_that_set_the_layers_again_belong_to_another_robot(sh, here, text):
    for name in ("a.yaml", "b.yaml"):
        Path(name).write_text(text)
    alone = "".join(sh(f"lint {name}.yaml -q")[1] for name in "ab")
    assert sh("lint a.yaml a.yaml b.yaml -q")[1] == sh("lint . -q --costmap global")[1] == alone
    assert sh("lint . --costmap global")[2] == ""
    assert sh("lint --params-file a.yaml --params-file b.yaml -q")[1] != alone
    assert len(sh("info a.yaml b.yaml --json")[1].splitlines()) == 2


def test_findings_name_their_costmap(sh, here):
    Path("local.yaml").write_text(NAV2.format("local"))
    Path("both.yaml").write_text(NAV2.format("global") + NAV2.format("local"))
    template = "warning: params.no-inflation: {} costmap: no inflation layer is listed: "
    assert template.format("local") in sh("lint local.yaml")[1]
    first, second, _ = sh("lint both.yaml")[1].splitlines()
    assert first.startswith("both.yaml:6: " + template.format("global"))
    assert second.startswith("both.yaml:13: " + template.format("local"))
    Path("common.yaml").write_text("robot_radius: 1\nplugins: []\n")
    for name in ("global", "local"):
        Path(f"{name}.yaml").write_text(f"{name}_costmap: {{global_frame: map}}\n")
    out = sh("lint common.yaml global.yaml local.yaml --select params.no-inflation")[1]
    (line,) = out.splitlines()[:-1]
    assert line.partition(" no ")[0] == "common.yaml:2: warning: params.no-inflation:"


def test_explanations_are_printed_by_name_area_and_all(sh):
    assert sh.ok("lint --explain yaml.nan-yaw") == (
        "yaml.nan-yaw (error)\n"
        "  A yaw of nan, which some map savers write.\n"
        "  Every pose computed with the yaw is nan, so the robot cannot be placed on the map.\n"
        "  Example: `origin: [-1.5, 2.0, nan]`.\n"
        "  Fix: Write 0, or run lint --fix.\n\n"
    )

    def explained(names):
        return re.findall(r"^(\S+) \(", sh.ok(f"lint --explain {names}"), re.MULTILINE)

    assert explained("all") == sorted(CHECKS)
    assert explained("readers,yaml.nan-yaw") == ["readers.differ", "yaml.nan-yaw"]
    graph = sorted(name for name in CHECKS if name.startswith("graph."))
    assert explained("graph.one-way --explain graph") == graph
    (check,) = json.loads(sh.ok("lint --explain image.gamma --json"))["checks"]
    assert list(check) == ["check", "severity", "on_request", "about", "why", "example", "fix"]
    assert (check["check"], check["severity"], check["on_request"]) == ("image.gamma", "note", True)


@pytest.mark.parametrize(("words", "message"), [
    ("--explain image.gama",
     "--explain: unknown check, got 'image.gama'\nhint: did you mean image.gamma?"),
    ("maps --explain image", "maps: cannot be given together with --explain"),
    ("--explain image --format sarif",
     "--format: cannot be given together with --explain, got 'sarif'"),
    ("maps --statistics --format junit",
     "--format: cannot be given together with --statistics, got 'junit'"),
])  # fmt: skip
def test_explanations_and_statistics_refuse_what_they_cannot_be(sh, maps, words, message):
    assert sh(f"lint {words}") == (2, "", f"error: {message}\n")


def test_statistics_count_findings_by_check(sh, maps):
    write_map("maps/more.yaml", OccupancyGrid([[0, 100]], 0.5, (0.3, 0.0, 0.5)))
    findings = json.loads(sh("lint maps --select all --format json")[1])["maps"]
    counts = Counter(found["check"] for entry in findings for found in entry["findings"])
    ranked = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    assert len(ranked) > 2
    assert ranked[0][1] > 1
    code, out, _ = sh("lint maps --select all --statistics")
    *lines, totals = out.splitlines()
    assert [(line.split()[1], int(line.split()[0])) for line in lines] == ranked
    findings_code, findings_out, _ = sh("lint maps --select all")
    assert (code, totals) == (findings_code, findings_out.splitlines()[-1])
    document = json.loads(sh("lint maps --select all --statistics --json")[1])
    expected = [(name, count, CHECKS[name].severity) for name, count in ranked]
    assert [(e["check"], e["count"], e["severity"]) for e in document["statistics"]] == expected
    assert list(document) == ["statistics", "errors", "warnings", "notes", "suppressed"]


def test_checks_on_request_run_if_they_are_named(sh, here):
    write_map("m.yaml", OccupancyGrid([[0, 100]], 0.5, (0.3, 0.0, 0.0)))
    lattice = "yaml.origin-off-lattice"
    assert lattice not in sh.ok("lint m.yaml --no-config")
    for words in (f"--select {lattice}", "--select yaml", "--select all"):
        assert lattice in sh.ok(f"lint m.yaml {words}")
    Path("mapdeal.toml").write_text('[lint]\nselect = ["all"]\n')
    assert lattice in sh.ok("lint m.yaml")
    assert lattice not in sh.ok(f"lint m.yaml --ignore {lattice}")
