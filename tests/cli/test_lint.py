"""``mapdeal lint`` as a gate, on the command line."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mapdeal import OccupancyGrid, write_map

LINT = [sys.executable, "-m", "mapdeal", "lint"]


@pytest.fixture
def maps(tmp_path, monkeypatch):
    """A folder with a good map, a turned one, and a YAML file that is no map."""
    monkeypatch.chdir(tmp_path)
    cells = np.zeros((9, 14), np.int8)
    cells[0] = cells[-1] = cells[:, 0] = cells[:, -1] = 100
    Path("maps/old").mkdir(parents=True)
    write_map("maps/good.yaml", OccupancyGrid(cells, 0.25, (1.0, -2.0, 0.0)))
    write_map("maps/old/turned.yaml", OccupancyGrid(cells, 0.25, (1.0, -2.0, 0.5)))
    Path("maps/params.yaml").write_text("x: 1\n")
    return tmp_path


def test_a_folder_is_gated_by_one_line(command, maps):
    code, out, err = command("lint", "maps")
    assert code == 0
    told = "yaml.origin-yaw: yaw 0.5 rad is ignored by costmap_2d and AMCL"
    assert out.splitlines() == [
        f"maps/old/turned.yaml:4: warning: {told}", "2 maps: 0 errors, 1 warning, 0 notes",
    ]  # fmt: skip
    assert err == "warning: 1 YAML file without the key image was left out: maps/params.yaml\n"
    assert command("lint", "maps", "--strict")[0] == 1
    assert command("lint", "maps", "-q") == (0, out.splitlines()[0] + "\n", "")


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--select", "image"], 0),
        (["--select", "image,yaml.origin-yaw"], 1),
        (["--select", "image", "--select", "yaml."], 1),
        (["--ignore", "yaml.origin-yaw"], 0),
        (["--ignore", "map, yaml"], 0),
        (["--ignore", "map"], 1),
        (["--select", "all"], 1),
        (["--select", "imge"], 2),
        (["--ignore", "yaml.origin-jaw"], 2),
        (["--ignore", ""], 2),
        (["--config", "none.toml"], 4),
        (["--config", "maps/params.yaml"], 3),
        (["--no-config", "--config", "x.toml"], 2),
        (["--format", "xml"], 2),
        (["--jobs", "0"], 2),
        (["--jobs", "2"], 1),
    ],
)
def test_what_is_selected_decides_the_exit_code(command, maps, words, code):
    found, out, err = command("lint", "maps", "--strict", *words)
    assert found == code, err
    assert (out == "") == (code > 1)


def test_the_command_line_comes_before_the_file(command, maps):
    Path("maps/pyproject.toml").write_text(
        '[tool.mapdeal.lint]\nignore = ["yaml.origin-yaw"]\nstrict = true\n'
    )
    assert command("lint", "maps")[0] == 0
    assert command("lint", "maps", "--select", "yaml")[0] == 1
    assert command("lint", "maps", "--no-config", "--strict")[0] == 1


def test_an_unknown_key_of_a_file_is_one_line_with_a_hint(command, maps):
    Path("mapdeal.toml").write_text("[lint]\nselct = []\n")
    code, out, err = command("lint", "maps")
    assert (code, out) == (2, "")
    assert err.splitlines()[-2:] == [
        f"error: {maps}/mapdeal.toml: lint.selct: unknown key", "hint: did you mean select?",
    ]  # fmt: skip


def test_what_is_suppressed_is_counted(command, maps):
    Path("mapdeal.toml").write_text('[lint.per-file-ignores]\n"maps/old" = ["yaml"]\n')
    code, out, _ = command("lint", "maps", "--strict")
    assert (code, out) == (0, "2 maps: 0 errors, 0 warnings, 0 notes, 1 suppressed\n")
    document = json.loads(command("lint", "maps", "--format", "json")[1])
    assert [one["suppressed"] for one in document["maps"]] == [0, 1]
    assert document["suppressed"] == 1


@pytest.mark.parametrize("form", ["json", "sarif", "junit", "github"])
def test_stdout_holds_the_report_alone(maps, form):
    """With its exit code, so that it can be redirected: `mapdeal lint ... > lint.sarif`."""
    for options in ([], ["-q"], ["-v"]):
        words = [*LINT, "maps", "maps/good.yaml", "--strict", "--format", form, *options]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert done.returncode == 1
        if form in ("json", "sarif"):
            json.loads(done.stdout)
        else:
            ends = {"junit": ("<?xml", "</testsuites>\n"), "github": ("::warning file=", "AMCL\n")}
            assert done.stdout.startswith(ends[form][0])
            assert done.stdout.endswith(ends[form][1])
        assert (
            "1 map was named more than once, and is checked once" in done.stderr or "-q" in options
        )


def test_a_repository_of_forty_maps_is_gated_by_one_line(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cells = np.zeros((9, 14), np.int8)
    cells[0] = cells[-1] = cells[:, 0] = cells[:, -1] = 100
    for k in range(40):
        folder = Path(f"maps/site{k % 4}")
        folder.mkdir(parents=True, exist_ok=True)
        write_map(folder / f"floor{k}.yaml", OccupancyGrid(cells, 0.25, (k, -2.0, 0.0)))
    assert command("lint", "maps") == (0, "40 maps: 0 errors, 0 warnings, 0 notes\n", "")
    text = Path("maps/site1/floor9.yaml").read_text()
    Path("maps/site1/floor9.yaml").write_text(text.replace("resolution: 0.25", "resolution: none"))
    code, out, _ = command("lint", "maps")
    assert code == 1
    assert out.splitlines()[0].startswith("maps/site1/floor9.yaml:3: error: file.malformed: ")
    assert out.splitlines()[1] == "40 maps: 1 error, 0 warnings, 0 notes"


def test_names_come_from_standard_input(maps):
    done = subprocess.run(
        [*LINT, "@-", "--strict"], input="maps/old/*.yaml\n", capture_output=True, text=True,
        check=False, env={**os.environ, "LC_ALL": "C"},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (1, "")
    assert done.stdout.splitlines()[-1] == "1 map: 0 errors, 1 warning, 0 notes"
