"""Commands that print or write a finding of severity error end with exit code 1."""

import json
import shutil
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from mapdeal.cli.main import command_names
from mapdeal.command import Result
from robots import write_robot

GOAL = "--from 0.55,1.05 --to dock=2.45,1.05 --robot-radius 0.25"
# Lines with an error, of each command whose document can have one. The door is 0.4 m wide.
LINES = [
    f"run m.yaml -o out --report {GOAL}",
    f"run m.yaml -o out {GOAL}",
    "run m.yaml -o out --recipe reach.yaml --robot-radius 0.25",
    f"run m.yaml twin.yaml -o out -j 1 {GOAL}",
    f"run m.yaml twin.yaml -o out -j 1 --report {GOAL}",
    "run m.yaml twin.yaml -o out -j 1 --recipe reach.yaml --robot-radius 0.25",
    "local --map m.yaml --pose 0.55,1.05,0 --recipe reach-local.yaml -o out",
    "report m.yaml reach.json -o out/page.html", "view m.yaml reach.json --no-browser",
    f"reach m.yaml {GOAL}",
    f"reach m.yaml {GOAL} -o out/reach.json",
    "route m.yaml --from 0.55,1.05 --to 2.45,1.05 --robot-radius 0.25",
    "route m.yaml --pairs pairs.csv --robot-radius 0.25 -o out/routes.jsonl",
    "plan m.yaml --params-file r.yaml --from 0.55,1.05 --to 2.45,1.05 -o out/plan.json",
    "plan m.yaml --params-file slim.yaml --against wide.yaml --from 0.55,1.05 --to 2.45,1.05",
    f"graph m.yaml {GOAL} -o out/graph.geojson",
    "mask m.yaml --file zones.geojson --from 0.55,1.05 --to dock=2.45,1.05 -o out",
    "query m.yaml --points bad.csv", "lint batch",
    "lint broken.yaml", "lint m.yaml broken.yaml --format github",
    "diff m.yaml --params-file slim.yaml --against wide.yaml",  # B has 0.9 m2 behind the door
    "diff m.yaml other.yaml --max-differing 0", "score m.yaml --max wall_thickness_m.median=0",
    "align m.yaml u.yaml",
]  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("gates"))
        write_files()
        return Path.cwd()


@pytest.fixture(autouse=True)
def files(written, here):
    shutil.copytree(written, here, dirs_exist_ok=True)


def write_files():
    cells = np.zeros((21, 30), dtype=np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    cells[:9, 15] = cells[12:, 15] = 100
    for name in ("m", "twin"):
        mapdeal.write_map(f"{name}.yaml", mapdeal.OccupancyGrid(cells, 0.1))
    cells[4, 4] = 100
    mapdeal.write_map("other.yaml", mapdeal.OccupancyGrid(cells, 0.1))
    mapdeal.write_map("u.yaml", mapdeal.OccupancyGrid(np.full((5, 5), -1, np.int8), 0.1))
    Path("broken.yaml").write_text("image: none.pgm\nresolution: 0.1\n")
    stage = "reach: {start: [0.55, 1.05], goals: {dock: [2.45, 1.05]}, radius: 0.25}"
    Path("reach.yaml").write_text(f"stages:\n  - {stage}\n")
    Path("reach-local.yaml").write_text(f"stages:\n  - {stage}\n")
    for name, radius in (("r", 0.25), ("slim", 0.15), ("wide", 0.35)):
        write_robot(f"{name}.yaml", radius)
    Path("bad.csv").write_text("x,y\n1,nan\n")
    Path("batch").mkdir()
    failed = {"map": "b.yaml", "status": "failed", "exit_code": 3, "error": "b.yaml: is empty"}
    Path("batch/summary.json").write_text(json.dumps({"maps": [failed]}))
    Path("pairs.csv").write_text("0.55,1.05,2.45,1.05\n")
    corners = [[1.2, 0], [1.8, 0], [1.8, 2.1], [1.2, 2.1], [1.2, 0]]
    zone = {
        "type": "Feature", "properties": {"kind": "keepout"},
        "geometry": {"type": "Polygon", "coordinates": [corners]},
    }  # fmt: skip
    Path("zones.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [zone]}))


QUIET = pytest.param(" -q", marks=pytest.mark.thorough)


@pytest.mark.parametrize("more", ["", " --strict -q", QUIET])
@pytest.mark.parametrize("line", LINES)
def test_a_finding_of_severity_error_ends_with_1(sh, line, more):
    if line.startswith(("report", "view")):
        sh(f"reach m.yaml {GOAL} -o reach.json")
    code, _, err = sh(line + more)
    is_run = line.startswith("run")
    if is_run and "recipe" in line and "strict" in more:  # a warning of the stage: not written
        assert code == (5 if "twin" in line else 1)
        return
    assert code == 1, err
    if line.split()[0] not in ("lint", "diff", "score", "align") and "-q" in more:
        assert err.splitlines()[-1].startswith(("error: ", "hint: "))
        assert err.count("error: ") == 1
    if is_run and "recipe" not in line:
        assert "warning: " not in err
        assert Path("out/m/manifest.json").exists()
        assert Path("out/report.json").exists() == ("--report" in line)


def test_every_command_whose_result_can_fail_is_tried_here():
    """Of `info` and `scan` only failed files count, as in any batch."""
    kinds = {
        name: [kind for kind in vars(import_module(f"mapdeal.commands.{name}")).values()
               if isinstance(kind, type) and issubclass(kind, Result)]
        for name in command_names() if find_spec(f"mapdeal.commands.{name}")
    }  # fmt: skip
    can_fail = {name for name in kinds for kind in kinds[name]
                if kind.check is not Result.check or kind.passes is not Result.passes}  # fmt: skip
    assert can_fail - {"info", "scan"} <= {line.split()[0] for line in LINES}


def test_a_batch_with_failures_ends_with_5_and_pages_that_exist_are_viewed_with_0(sh):
    line = f"run m.yaml broken.yaml -o out -j 1 --report {GOAL}"
    assert sh(line)[0] == 5
    assert sh(f"{line} --force -q")[0] == 5
    assert sh("view m.yaml --no-browser")[0] == 0
    assert sh(f"reach m.yaml {GOAL} -o reach.json")[0] == 1
    assert sh("report m.yaml reach.json -o page.html")[0] == 1
    assert sh("view page.html --no-browser")[0] == 0
