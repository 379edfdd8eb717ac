"""Files for use in other projects: the hook for pre-commit, the action, the workflows."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import mapdeal
from mapdeal import OccupancyGrid, write_map

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
HOOKS = ROOT / ".pre-commit-hooks.yaml"
ACTION = ROOT / ".github" / "actions" / "mapdeal-lint" / "action.yml"
INPUTS, RUNS = (yaml.safe_load(ACTION.read_text())[key] for key in ("inputs", "runs"))
PAGE = ROOT / "docs" / "lint.md"

needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
needs_git = pytest.mark.skipif(shutil.which("git") is None, reason="needs git")


def environment(**more):
    """Without what a hook of git, under which tests may run, sets; and with this mapdeal."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    path = [str(Path(mapdeal.__file__).parents[1]), inherited.get("PYTHONPATH", "")]
    return {**inherited, "PYTHONPATH": os.pathsep.join(filter(None, path)), **more}


@pytest.fixture
def maps(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cells = np.zeros((9, 14), np.int8)
    cells[0] = cells[-1] = cells[:, 0] = cells[:, -1] = 100
    Path("maps").mkdir()
    write_map("maps/good.yaml", OccupancyGrid(cells, 0.25, (1.0, -2.0, 0.0)))
    write_map("maps/turned map.yaml", OccupancyGrid(cells, 0.25, (1.0, -2.0, 0.5)))
    return tmp_path


def run(*words, **more):
    options = {"env": environment(**more), "capture_output": True, "text": True}
    return subprocess.run(words, check=False, **options)


@pytest.fixture
def repository(maps):
    """A git repository with the maps, and the hook as a user's configuration has it.

    The hook is ours but for its language: to install the project, pre-commit asks the network.
    """
    pytest.importorskip("pre_commit")
    (hook,) = yaml.safe_load(HOOKS.read_text())
    assert hook["language"] == "python"
    name = shutil.which("mapdeal") or "mapdeal"
    assert hook["entry"].split()[0] == Path(name).name
    local = {**hook, "language": "system", "entry": f"{sys.executable} -m {hook['entry']}"}
    config = {"repos": [{"repo": "local", "hooks": [local]}]}
    (maps / ".pre-commit-config.yaml").write_text(yaml.safe_dump(config))
    who = dict.fromkeys(["GIT_AUTHOR_NAME", "GIT_AUTHOR_EMAIL", "GIT_COMMITTER_NAME",
                         "GIT_COMMITTER_EMAIL"], "a@b")  # fmt: skip
    more = {**who, "PRE_COMMIT_HOME": str(maps / ".cache"), "GIT_CONFIG_GLOBAL": os.devnull}

    def git(*words):
        return run("git", *words, **more)

    completed = run(sys.executable, "-m", "pre_commit", "validate-manifest", str(HOOKS))
    assert (completed.returncode, completed.stderr) == (0, "")
    assert git("init", "-q").returncode == 0
    completed = run(sys.executable, "-m", "pre_commit", "install", **more)
    assert completed.returncode == 0, completed.stderr
    return git


@needs_git
def test_a_commit_is_refused_by_the_hook_if_a_map_is_bad(repository):
    def commit(*files):
        assert repository("add", *files).returncode == 0
        completed = repository("commit", "-m", "of maps")
        output = completed.stdout + completed.stderr
        return completed.returncode == 0, re.search(r"mapdeal lint\.+(.*)", output)[1], output

    assert commit("maps", ".pre-commit-config.yaml")[:2] == (True, "Passed")
    Path("maps/good.pgm").write_bytes(Path("maps/good.pgm").read_bytes()[:-20])
    *found, output = commit("maps/good.pgm")
    assert found == [False, "Failed"]
    assert "maps/good.yaml: error: file.malformed: " in output


@pytest.mark.thorough
@needs_git
def test_arguments_of_a_users_configuration_are_taken(repository):
    path = Path(".pre-commit-config.yaml")
    config = yaml.safe_load(path.read_text())
    (hook,) = config["repos"][0]["hooks"]
    (example,) = yaml.safe_load(blocks("# .pre-commit-config.yaml")[0])["repos"][0]["hooks"]
    assert example.pop("id") == hook["id"]
    hook.update(example)
    path.write_text(yaml.safe_dump(config))
    repository("add", "-A")
    completed = repository("commit", "-m", "strict")
    assert completed.returncode == 1
    assert "maps/turned map.yaml:4: warning: yaml.origin-yaw" in completed.stdout + completed.stderr


def test_the_hook_looks_at_files_of_maps():
    (hook,) = yaml.safe_load(HOOKS.read_text())
    looked_at = ["maps/m.yaml", "m.yml", "a/M.PGM", "m.png", "m.tiff", "m.jpeg", "m.npz",
                 "pyproject.toml", "a/mapdeal.toml"]  # fmt: skip
    ignored = ["m.py", "yaml", "m.yaml.txt", "x-mapdeal.toml", "m.toml"]
    assert [name for name in looked_at + ignored if re.search(hook["files"], name)] == looked_at


def blocks(first_line):
    found = re.findall(r"(?ms)^```yaml\n(.*?)^```", PAGE.read_text())
    return [text for text in found if text.startswith(first_line)]


@pytest.mark.thorough
def test_the_workflows_of_the_page_are_as_their_schema_says(tmp_path):
    pytest.importorskip("check_jsonschema")
    paths = [tmp_path / "0.yml", tmp_path / "1.yml"]
    for path, text in zip(paths, blocks("# .github/workflows/"), strict=True):
        path.write_text(text)
    words = ["-m", "check_jsonschema", "--builtin-schema", "vendor.github-workflows"]
    completed = run(sys.executable, *words, *map(str, paths))
    assert completed.returncode == 0, completed.stdout + completed.stderr


@pytest.mark.parametrize("number", [0, 1])
def test_the_workflows_of_the_page_give_inputs_that_the_action_has(number):
    (job,) = yaml.safe_load(blocks("# .github/workflows/")[number])["jobs"].values()
    (step,) = [entry for entry in job["steps"] if "mapdeal-lint" in entry.get("uses", "")]
    assert ROOT / step["uses"].removeprefix("./mapdeal/") == ACTION.parent
    assert set(step["with"]) <= set(INPUTS)


def test_the_page_has_every_input_of_the_action():
    text = PAGE.read_text()
    assert [name for name in INPUTS if f"`{name}`" not in text] == []


def run_step(name, folder, python=sys.executable, **inputs):
    (step,) = [entry for entry in RUNS["steps"] if entry.get("name") == name]
    assert "${{" not in step["run"]
    values = {f"inputs.{name}": entry["default"] for name, entry in INPUTS.items()}
    values |= {f"inputs.{name}": value for name, value in inputs.items()}
    values |= {"steps.python.outputs.python-path": python}
    more = {name: values[text[4:-3]] for name, text in step["env"].items()}  # within ${{ }}
    (folder / "script").write_text(step["run"])
    words = "bash", "--noprofile", "--norc", "-eo", "pipefail", str(folder / "script")
    return run(*words, RUNNER_TEMP=str(folder), GITHUB_ACTION_PATH=str(ACTION.parent), **more)


@needs_bash
@pytest.mark.parametrize(
    ("inputs", "code"),
    [({"strict": "true"}, 1), ({"strict": "true", "ignore": "yaml"}, 0),
     ({"strict": "true", "select": "image,map"}, 0), ({}, 0)],
)  # fmt: skip
def test_the_action_annotates_and_ends_as_lint_does(maps, inputs, code):
    completed = run_step("Lint maps", maps, **{"paths": "maps", **inputs})
    assert completed.returncode == code, completed.stderr
    annotation = "::warning file=maps/turned map.yaml,line=4,title=yaml.origin-yaw"
    assert completed.stdout.startswith(annotation) == (inputs in ({}, {"strict": "true"}))


@needs_bash
def test_paths_of_the_action_are_lines_and_never_commands(maps):
    paths = "\nmaps/good.yaml\r\nmaps/turned map.yaml\n$(touch oops); `touch oops`\n"
    completed = run_step("Lint maps", maps, paths=paths, **{"sarif-file": "maps.sarif"})
    assert completed.returncode == 1
    assert "file.access" in completed.stdout
    found = json.loads(Path("maps.sarif").read_text())["runs"][0]["results"]
    assert {result["ruleId"] for result in found} == {"yaml.origin-yaw", "file.access"}
    assert "turned map.yaml,line=4" in completed.stdout
    assert not Path("oops").exists()


@needs_bash
def test_the_action_installs_the_copy_that_it_lies_in(maps):
    (maps / "python").write_text('#!/bin/sh\nfor word; do echo "$word"; done\n')
    (maps / "python").chmod(0o755)
    words = run_step("Install mapdeal", maps, python=str(maps / "python")).stdout.splitlines()
    assert words[:3] == ["-m", "pip", "install"]
    assert words[-1] == f"{ACTION.parent}/../../.."
    assert (ACTION.parent / "../../..").resolve() == ROOT
